"""The demonstration: a simulated gyro with two effects that its model does not know.

A bench log at constant temperature gives the noise file. A field log, warmed by the sun and shaken by a
fan, disagrees with it. Both effects are named, the model updated, and the updated filter emitted and proven.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from kfgen.effects import Effect, make
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.effects.noise_model import NoiseModel, write_noise
from kfgen.emit.emit import emit
from kfgen.gap.find_gap import find_gap
from kfgen.identify.identify_log import identify
from kfgen.log.log import Channel, Log
from kfgen.log.readers import write_log
from kfgen.model.build import build
from kfgen.model.derive import Derivation
from kfgen.report.audit import audit_answer
from kfgen.report.gap import gap_answer
from kfgen.report.identify import identify_answer
from kfgen.report.model import STATE_HEAD, equation_parts, state_rows
from kfgen.report.page import Answer, Page, heading, sentence, table, text, write_page
from kfgen.report.proof import verify_answer
from kfgen.run.audit import audit
from kfgen.verify.compare import verify

SEED = 20261121
RATE_HZ = 50.0
RECORD_HOURS = 2.0
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
    """A simulated log of one gyro axis at rest with its thermometer.

    Parameters
    ----------
    source : str
        Its name.
    effects : tuple of Effect
        What acts on the gyro.
    temperature : ndarray, shape (n,)
        Of the sensor [K].
    t : ndarray, shape (n,)
        Times [s].
    rng : numpy.random.Generator
    """
    drive: Mapping[str, np.ndarray] = {"temperature": temperature}
    y = sum((e.simulate(t, rng, drive) for e in effects), np.zeros(t.size))
    measured = temperature + 0.02 * rng.standard_normal(t.size)
    return Log(t, {CHANNEL: Channel(y, "deg/s"), "temperature": Channel(measured, "degC")}, source)


def write_logs(out: Path) -> tuple[Log, Log]:
    """The log from the bench and that from the field, written into a folder, which is made where there is none.

    Parameters
    ----------
    out : Path
    """
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED)
    t = np.arange(int(RECORD_HOURS * 3600 * RATE_HZ)) / RATE_HZ
    bench = record_log("bench.npz", sensor(), np.full(t.size, 298.15), t, rng)
    field = record_log("field.npz", (*sensor(), *hidden()), DRIVERS["temperature"].course(t), t, rng)
    for log in (bench, field):
        write_log(log, out / log.source)
    return bench, field


def run_demo(out: Path, say: Callable[[str], None]) -> Answer:
    """Run the chain into a folder; the answer's text ends with the path of the report.

    Parameters
    ----------
    out : Path
        The folder; made where there is none.
    say : callable
        Takes a line when a step begins.
    """
    bench, field = write_logs(out)
    say("1 identify the bench log")
    found = identify(bench)
    assumed = found.noise
    write_noise(assumed, out / "noise.toml")
    identified = identify_answer(found)
    say("2 compare the field log with it")
    compared = find_gap(field, assumed)
    gap, updated = gap_answer(compared), compared.updated
    assert isinstance(updated, NoiseModel)
    write_noise(updated, out / "improved.toml")
    say("3 emit the updated filter and prove it")
    proof, filter_page = _filter(out, updated)
    return _summary(out / "report.html", identified, gap, proof, filter_page)


def _summary(report: Path, identified: Answer, gap: Answer, proof: Answer, filter_page: Page) -> Answer:
    """The answers of the steps as one, with its page."""
    how = text(
        "How it was found: a bench log at constant temperature gave the model; a field log disagreed with it; "
        "every effect that kfgen knows competed to explain why."
    )
    parts = (how, *gap.page.parts, *filter_page.parts, heading("The bench log"), *identified.page.parts[1:])
    title = "A gyro whose model did not know the temperature and a fan"
    page = Page(title, parts, (*gap.page.verdict, *proof.page.verdict), proof.ok, gap.page.facts)
    write_page(page, report)
    path = str(report.resolve())
    steps = {"The bench log": identified, "The field log": gap, "The updated filter": proof}
    words = "\n\n".join([*(f"{title}\n\n{a.text}" for title, a in steps.items()), f"report: {path}"])
    data = {
        "format": "kfgen-demo-1",
        "identify": identified.data,
        "gap": gap.data,
        "verify": proof.data,
        "report": path,
    }
    return Answer(words, data, page, ok=proof.ok and gap.data["verdict"] == "effects_found")


def _filter(out: Path, noise: NoiseModel) -> tuple[Answer, Page]:
    """Audit, emission and proof of the updated filter."""
    model = build("gyro-static", noise)
    emitted = emit(model, out / "c", rate=RATE_HZ)
    module = emit(model, out / "filterpy", "filterpy", rate=RATE_HZ)
    proof = verify(emitted, ["host", "m4f"] if _emulator() else ["host"])
    proof = replace(proof, verdicts=(*proof.verdicts, *verify(module).verdicts))
    derived = Derivation(emitted.program.discrete)
    proven = verify_answer(proof)
    page = Page(
        "",
        (
            heading("The updated filter"),
            table(STATE_HEAD, state_rows(derived.discrete)),
            *audit_answer(audit(model, rate=RATE_HZ)).page.parts[1:],
            *equation_parts(derived, ("F", "H", "Phi")),
            table(*emitted.short_table()),
            heading("The proof"),
            *map(sentence, proven.page.verdict),
            *proven.page.parts,
        ),
    )
    return proven, page


def _emulator() -> bool:
    return all(importlib.util.find_spec(m) for m in ("ziglang", "unicorn", "elftools"))
