"""Proves the supervisor in flight: emitted C, S-turns at 20 m/s with GNSS at 10 Hz, one fault at a time.

The flights and the list of faults are those of ``kfgen verify --faults``. For each fault: it is reported within a second,
the position is within three standard deviations again within ten seconds of the fault's end and stays there, no number
is ever infinite or none, and the filter is never wrong while it says OK for longer than a second.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kfgen.emit.folder import EmittedFilter, write_folder
from kfgen.emit.routines import Program
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.report.proof import faults_answer
from kfgen.verify.faults import FAULTS, REPORTED_WITHIN_S, RIGHT_WITHIN_S, SOUND, FlightFault
from kfgen.verify.flight import flight
from kfgen.verify.fly import FaultVerdict, fly_faults

BY_TITLE = {f.title: f for f in FAULTS if not f.needs}
FORMS = [("ud", "float"), ("ud", "double"), ("p", "float"), ("p", "double")]


def need_compiler() -> None:
    if shutil.which(os.environ.get("CC") or "cc") is None:
        pytest.skip("there is no C compiler on this machine")


@pytest.fixture(scope="module")
def emitted(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., EmittedFilter]:
    """`ins15` in a form and a precision."""
    made: dict[tuple[str, str], EmittedFilter] = {}

    def find(form: str = "ud", real: str = "float") -> EmittedFilter:
        need_compiler()
        if (form, real) not in made:
            program = Program(DiscreteModel(build("ins15")), form, real)
            folder = tmp_path_factory.mktemp("flight") / "c"
            write_folder(program, "c", None, folder)
            made[form, real] = EmittedFilter(program, "c", folder)
        return made[form, real]

    return find


def test_the_list_has_twenty_faults_with_floors() -> None:
    assert len({f.title for f in FAULTS}) == len(FAULTS) >= 20
    assert sum(f.reported_within <= REPORTED_WITHIN_S for f in FAULTS) >= 18


@pytest.mark.long
def test_without_a_fault_nothing_is_reported(emitted: Callable[..., EmittedFilter]) -> None:
    for seed in range(1, 4):
        (v,) = fly_faults(emitted(), faults=[SOUND], seed=seed)
        assert (v.reported, v.right, v.wrong, v.finite) == (np.inf, 0.0, 0.0, True)
        assert v.worst < 5.0


@pytest.mark.long
@pytest.mark.parametrize("title", BY_TITLE)
@pytest.mark.parametrize(("form", "real"), FORMS)
def test_in_every_form_over_many_seeds(
    title: str, form: str, real: str, emitted: Callable[..., EmittedFilter]
) -> None:
    for seed in range(1, 11):
        (v,) = fly_faults(emitted(form, real), faults=[BY_TITLE[title]], seed=seed)
        assert v.missed == (), seed


def test_a_flight_is_what_a_strapdown_integration_makes_of_it() -> None:
    """Without noise: position and velocity from the samples are the truth to the order of the midpoint."""
    field = np.array([20e-6, 0.0, 44e-6])

    class Still:
        def normal(self, size: Any) -> Any:
            return np.zeros(size)

    f = flight(100.0, 30.0, field, Still())  # type: ignore[arg-type]
    from scipy.spatial.transform import Rotation

    R, v, p = Rotation.from_quat(f.attitude, scalar_first=True), f.start.copy(), np.zeros(3)
    for k in range(len(f.t)):
        middle = R * Rotation.from_rotvec(f.gyro[k] * f.dt[k] / 2.0)
        step = np.add(middle.apply(f.accel[k]), [0.0, 0.0, 9.80665]) * f.dt[k]
        p, v, R = p + (v + step / 2.0) * f.dt[k], v + step, R * Rotation.from_rotvec(f.gyro[k] * f.dt[k])
    np.testing.assert_allclose(p, f.truth[-1], atol=1e-9)
    np.testing.assert_allclose(v, f.velocity[-1], atol=1e-9)
    np.testing.assert_allclose(R.inv().apply(field), f.field[-1], atol=1e-12)


@pytest.mark.long
def test_the_core_that_is_counted_flies_the_same(emitted: Callable[..., EmittedFilter]) -> None:
    """On an emulated Cortex-M4F, to every figure: the words are the same."""
    for module in ("ziglang", "unicorn", "elftools"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed (pip install 'kfgen[pil]')")
    fault = BY_TITLE["heading 120 deg off"]
    host, core = fly_faults(emitted(), ["host", "m4f"], [fault])
    assert core.core == "m4f"
    assert core.missed == ()
    assert (core.reported, core.right, core.wrong, core.worst) == (
        host.reported,
        host.right,
        host.wrong,
        host.worst,
    )


def test_what_a_floor_is() -> None:
    def verdict(
        fault: FlightFault, reported: float = 0.5, right: float = 1.0, wrong: float = 0.0
    ) -> FaultVerdict:
        return FaultVerdict(fault, "host", reported, right, wrong, 1.0, True)

    usual = FAULTS[0]
    assert verdict(usual).missed == ()
    assert "reported after" in verdict(usual, reported=REPORTED_WITHIN_S + 0.1).missed[0]
    assert "right after" in verdict(usual, right=RIGHT_WITHIN_S + 0.1).missed[0]
    assert "while it says OK" in verdict(usual, wrong=1.1).missed[0]
    assert verdict(SOUND, reported=np.inf).missed == ()


@pytest.mark.long
def test_every_fault_is_reported_and_the_filter_recovers(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    """On the command line: exit status 0, the table, the JSON and the page."""
    need_compiler()
    folder, out, page = tmp_path / "f", tmp_path / "v.json", tmp_path / "p.html"
    assert kfgen("emit", "ins15", "--target", "c", "-o", folder).exit_code == 0
    done = kfgen("verify", folder, "--faults", "--json", out, "--report", page)
    assert done.exit_code == 0, done.stdout
    flown = [f for f in FAULTS if not f.needs]
    assert len(flown) == len(FAULTS) - 1
    assert f"All {len(flown)} flights hold the floors" in done.stdout
    data = json.loads(out.read_text())
    assert (data["format"], data["ok"]) == ("kfgen-faults-1", True)
    assert [f["fault"] for f in data["flights"]] == [f.title for f in flown]
    assert all(f["finite"] and f["reported_after_s"] is not None and not f["missed"] for f in data["flights"])
    for f in flown:
        assert f.title in done.stdout
        assert f.title in page.read_text()


@pytest.mark.long
def test_a_filter_that_never_resets_misses_floors(
    emitted: Callable[..., EmittedFilter], tmp_path: Path
) -> None:
    """The answer is then a failed check, exit status 1."""
    program = emitted().program
    text = (emitted().folder / "ins15.h").read_text()
    for name in (
        "RESET_AFTER 2.0f",
        "RESET_COUNT 20.0f",
        "RESYNC_AFTER 0.200000003f",
        "NIS_SHARE 0.0250000004f",
    ):
        assert f"#define INS15_{name}" in text
        text = text.replace(f"#define INS15_{name}", f"#define INS15_{name.split()[0]} 1e9f")
    (tmp_path / "ins15.h").write_text(text)
    jump = BY_TITLE["a permanent jump of 1 km"]
    answer = faults_answer(fly_faults(EmittedFilter(program, "c", tmp_path), faults=[jump]))
    assert not answer.ok
    assert "a permanent jump of 1 km on host: right after" in answer.text


def test_what_cannot_be_flown_is_refused(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    for name, target, words in (
        ("ahrs6", "c", "gnss_position"),
        ("ins15", "numpy", "--target c"),
    ):
        folder = tmp_path / f"{name}-{target}"
        assert kfgen("emit", name, "--target", target, "-o", folder).exit_code == 0
        done = kfgen("verify", folder, "--faults")
        assert done.exit_code == 2
        assert words in str(done.exception)
    done = kfgen("verify", folder, "--faults", "--contract")
    assert done.exit_code == 2
    assert "--contract" in str(done.exception)
