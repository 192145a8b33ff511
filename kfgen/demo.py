"""The demonstration: a simulated gyro with two effects that its model does not know.

A bench log at constant temperature gives the noise file. A field log, warmed by the sun and shaken by a
fan, disagrees with it. Both effects are named, the model updated, and the updated filter emitted and proven.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from kfgen.audit.audit import audit
from kfgen.effects import Effect, make
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.effects.noise_model import NoiseModel, write_noise
from kfgen.emit.folder import read_folder, write_folder
from kfgen.emit.routines import Program
from kfgen.gap.find_gap import find_gap
from kfgen.identify.evidence.record import Record
from kfgen.identify.identify import identify
from kfgen.log.log import Channel, Log
from kfgen.log.readers import write_log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.report.audit import audit_answer
from kfgen.report.filter import OPERATIONS, operation_rows
from kfgen.report.gap import gap_answer
from kfgen.report.identify import identify_answer, noise_model
from kfgen.report.model import STATE_HEAD, equation_parts, state_rows
from kfgen.report.page import Answer, Page, heading, sentence, table, text, write_page
from kfgen.report.proof import VERDICT_HEAD, verdict_rows, verify_answer, verify_sentence
from kfgen.verify.compare import verify

SEED = 20261121
RATE = 50.0
HOURS = 2.0
CHANNEL = "gyro_x"


def sensor() -> tuple[Effect, ...]:
    """The true noise of the simulated gyro: 0.21 deg/sqrt(h) and a bias that wanders by 7 deg/h."""
    return (make("white_noise", N=6.1e-5), make("gauss_markov", sigma=3.4e-5, tau=180.0))


def hidden() -> tuple[Effect, ...]:
    """What the model does not know: 41 deg/h per kelvin, and a fan at 7.3 Hz."""
    return (
        make("temperature", coefficient=2e-4),
        make("sinusoid", amplitude=4e-5, frequency=7.3, phase=0.4),
    )


def record_log(
    source: str, effects: tuple[Effect, ...], temperature: np.ndarray, t: np.ndarray, rng: np.random.Generator
) -> Log:
    """A simulated log of one gyro axis at rest with its thermometer."""
    drive: Mapping[str, np.ndarray] = {"temperature": temperature}
    y = sum((e.simulate(t, rng, drive) for e in effects), np.zeros(t.size))
    measured = temperature + 0.02 * rng.standard_normal(t.size)
    return Log(t, {CHANNEL: Channel(y, "deg/s"), "temperature": Channel(measured, "degC")}, source)


def run_demo(out: Path, say: Callable[[str], None]) -> Answer:
    """Run the chain into a folder; the answer's text ends with the path of the report."""
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED)
    t = np.arange(int(HOURS * 3600 * RATE)) / RATE
    bench = record_log("bench.npz", sensor(), np.full(t.size, 298.15), t, rng)
    field = record_log("field.npz", (*sensor(), *hidden()), DRIVERS["temperature"].course(t), t, rng)
    for log in (bench, field):
        write_log(log, out / log.source)
    say("1 identify the bench log")
    found = {CHANNEL: identify(Record(bench.t, bench.values(CHANNEL)))}
    believed = noise_model([bench], found)
    write_noise(believed, out / "noise.toml")
    say("2 compare the field log with it")
    compared = find_gap(field, believed)
    gap, updated = gap_answer(compared), compared.updated
    assert isinstance(updated, NoiseModel)
    write_noise(updated, out / "improved.toml")
    say("3 emit the updated filter and prove it")
    proof, filter_page = _filter(out, updated)
    identified = identify_answer([bench], found)
    page = (
        Page(
            "A gyro whose model did not know the temperature and a fan",
            (
                *gap.page.parts[1:4],
                text(
                    "How it was found: a bench log at constant temperature gave the model; a field "
                    "log disagreed with it; every effect that kfgen knows competed to explain why."
                ),
                *gap.page.parts[4:],
            ),
        )
        + filter_page
        + Page("", (heading("The bench log"), *identified.page.parts[1:]))
    )
    report = out / "report.html"
    write_page(page, report)
    words = "\n\n".join(
        [
            "The bench log",
            identified.text,
            "The field log",
            gap.text,
            "The updated filter",
            proof.text,
            f"report: {report.resolve()}",
        ]
    )
    data = {
        "format": "kfgen-demo-1",
        "identify": identified.data,
        "gap": gap.data,
        "verify": proof.data,
        "report": str(report.resolve()),
    }
    return Answer(words, data, page, ok=proof.ok and gap.data["verdict"] == "effects_found")


def _filter(out: Path, noise: NoiseModel) -> tuple[Answer, Page]:
    """Audit, emission and proof of the updated filter."""
    program = Program(DiscreteModel.at_rate(build("gyro-static", noise), RATE))
    for target in ("c", "filterpy"):
        write_folder(program, target, noise, out / target)
    cores = ["host", "m4f"] if _emulator() else ["host"]
    verdicts = verify(read_folder(out / "c"), cores) + verify(read_folder(out / "filterpy"), ["host"])
    hidden_states = audit_answer(audit(program.discrete.model))
    page = Page(
        "",
        (
            heading("The updated filter"),
            table(STATE_HEAD, state_rows(program.discrete)),
            *hidden_states.page.parts[1:],
            *equation_parts(program.discrete, ("F", "H", "Phi")),
            table(OPERATIONS, operation_rows(program)),
            heading("The proof"),
            sentence(verify_sentence(verdicts) + "."),
            table(VERDICT_HEAD, verdict_rows(verdicts)),
        ),
    )
    return verify_answer(program.discrete.hash, verdicts), page


def _emulator() -> bool:
    return all(importlib.util.find_spec(m) for m in ("ziglang", "unicorn", "elftools"))
