"""Proves the detector of rest: what is rest to it, how often v = 0 then is fused, what it cannot tell, and what it is worth.

Expected numbers are those of the settings and of a detector written again here, window by window, in plain Python; the
reference is asked in double precision, and the C flies parked as ``kfgen verify --faults`` flies it.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kfgen.core.errors import InputError
from kfgen.emit.folder import EmittedFilter, read_folder, write_folder
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.watch.quiet import REASONS
from kfgen.emit.watch.rest import ROUTINE
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.verify.faults import FAULTS
from kfgen.verify.fly import fly_faults

GRAVITY = (0.0, 0.0, -9.80665)
STILL = (0.0, 0.0, 0.0)
DT = 0.05
SENSORS = {"sensors": "gnss_velocity,zero_velocity"}
Sample = tuple[Sequence[float], Sequence[float]]


def made(name: str = "ins15", without: tuple[str, ...] = (), **options: str) -> Program:
    return Program(DiscreteModel(build(name, None, SENSORS | options)), "p", without=without)


@pytest.fixture(scope="module")
def program() -> Program:
    return made()


def started(program: Program) -> Machine:
    machine = Machine(program, np.float64)
    machine.call("init")
    return machine


def number(machine: Machine, place: str) -> float:
    names = [n for n, _ in machine.program.supervisor.places]
    return float(machine.arrays["supervisor"][names.index(place)])


def look(machine: Machine, samples: Sequence[Sample], dt: float = DT) -> int:
    """Gives samples to the detector; returns how often v = 0 was fused: each time the covariance shrinks."""
    fused = 0
    for accel, gyro in samples:
        before = machine.arrays["P"].copy()
        assert machine.call(ROUTINE, [accel, gyro, dt]) == "OK"
        fused += not np.array_equal(before, machine.arrays["P"])
    return fused


def test_rest_takes_its_time_and_v_is_fused_once_a_spacing(program: Program) -> None:
    """1 s until it rests, then every 0.2 s: in 5 s one at 1 s and twenty after it, whatever the rate of the samples."""
    for dt in (0.05, 0.01):
        machine = started(program)
        assert look(machine, [(GRAVITY, STILL)] * round(0.9 / dt), dt) == 0
        assert number(machine, "AT_REST") == 0.0
        assert look(machine, [(GRAVITY, STILL)] * round(4.1 / dt), dt) in (20, 21)
        assert number(machine, "AT_REST") == pytest.approx(4.0, abs=2.0 * dt)


def test_what_it_fuses_is_the_sensor_with_its_own_noise(program: Program) -> None:
    """As `update_zero_velocity` with zeros does it, to the last bit; and P of the velocity is what theory says."""
    found, asked = started(program), started(program)
    for machine in (found, asked):
        machine.arrays["x"][3:6] = [0.1, -0.2, 0.05]
    look(found, [(GRAVITY, STILL)] * 24)
    asked.call("update_zero_velocity", [STILL])
    np.testing.assert_array_equal(found.arrays["P"], asked.arrays["P"])
    np.testing.assert_array_equal(found.arrays["x"], asked.arrays["x"])
    P, R = 1.0, 0.02**2
    found.call("init")
    look(found, [(GRAVITY, STILL)] * 24)
    assert found.covariance()[3, 3] == pytest.approx(P * R / (P + R), rel=1e-3)


MOVED = {
    "TURNING": (GRAVITY, (0.0, 0.08, 0.08)),
    "SHAKEN": ((0.6, 0.0, -9.80665), STILL),
    "NOT_GRAVITY": ((0.0, 0.0, -8.7), STILL),
}


@pytest.mark.parametrize("reason", MOVED)
def test_one_sample_that_is_not_at_rest_ends_it(program: Program, reason: str) -> None:
    machine = started(program)
    look(machine, [(GRAVITY, STILL)] * 30)
    assert number(machine, "AT_REST") > 0.0
    assert look(machine, [MOVED[reason]]) == 0
    assert number(machine, "AT_REST") == 0.0
    said = number(machine, "REST_REASON")
    assert said == REASONS.index(reason) or reason == "NOT_GRAVITY"
    assert look(machine, [(GRAVITY, STILL)] * 19) == 0


@pytest.mark.parametrize(("speed", "rests"), [(20.0, False), (0.51, False), (0.49, True)])
def test_steady_flight_is_no_rest_and_a_slow_drift_is(program: Program, speed: float, rests: bool) -> None:
    """What an IMU cannot tell: the filter's own speed decides, and below `REST_MAX_SPEED` uniform motion counts as rest."""
    machine = started(program)
    machine.arrays["x"][3:6] = [0.6 * speed, 0.8 * speed, 0.0]
    fused = look(machine, [(GRAVITY, STILL)] * 40)
    assert (fused > 0) == rests
    assert rests or number(machine, "REST_REASON") == REASONS.index("TOO_FAST")
    assert number(machine, "RESETS") == 0.0


def test_a_rejected_rest_is_forgotten_with_the_rest(program: Program) -> None:
    """Else a count of rejected zeros would say DEGRADED for the whole flight that follows."""
    machine = started(program)
    machine.arrays["k"][[c.name for c in program.constants].index("gate_zero_velocity")] = 1e-3
    machine.arrays["x"][3] = 0.3
    for _ in range(40):
        said = machine.call(ROUTINE, [GRAVITY, STILL, DT])
    assert said in ("OK", "GATED")
    assert number(machine, "REJECTED_ZERO_VELOCITY") > 1.0
    look(machine, [MOVED["TURNING"]])
    assert number(machine, "REJECTED_ZERO_VELOCITY") == 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e9])
def test_what_cannot_be_is_refused(program: Program, bad: float) -> None:
    machine = started(program)
    before = machine.words().tobytes()
    assert machine.call(ROUTINE, [(bad, 0.0, -9.8), STILL, DT]) == "BAD_INPUT"
    assert machine.call(ROUTINE, [GRAVITY, (0.0, bad, 0.0), DT]) == "BAD_INPUT"
    assert machine.call(ROUTINE, [GRAVITY, STILL, bad]) == "BAD_STEP"
    assert machine.words().tobytes() == before


class Detector:
    """The same detector from its description: means over what was quiet, forgetting by halves."""

    def __init__(self) -> None:
        self.time = self.rest = 0.0
        self.waited, self.count = 0.0, 0.0
        self.mean = np.zeros(3)

    def look(self, accel: Sequence[float], gyro: Sequence[float], dt: float) -> bool:
        f, size = np.array(accel), float(np.linalg.norm(accel))
        quiet = np.linalg.norm(gyro) <= 0.1 and abs(size - 9.80665) <= 1.0
        if self.count and np.linalg.norm(f - self.mean) > 0.5:
            quiet = False
        if not quiet:
            self.time = self.rest = self.count = 0.0
            self.waited, self.mean = 0.2, np.zeros(3)
            return False
        self.mean = (self.mean * self.count + f) / (self.count + 1.0)
        self.count, self.time = self.count + 1.0, self.time + dt
        if self.time < 1.0:
            return False
        self.rest, self.waited = self.rest + dt, self.waited + dt
        if self.time >= 2.0:
            self.time, self.count = self.time / 2.0, self.count / 2.0
        if self.waited < 0.2:
            return False
        self.waited = 0.0
        return True


sizes = st.tuples(*[st.integers(-3, 3)] * 3)
stretches = st.lists(st.tuples(sizes, sizes, st.integers(1, 60)), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(stretches)
def test_it_is_the_detector_of_its_description(
    program: Program, stretches: list[tuple[Sample, Sample, int]]
) -> None:
    """Stretches of constant samples, steps of force and rate between them; eighths are exact, so that no sum rounds."""
    machine, model = started(program), Detector()
    for force, rate, n in stretches:
        accel = np.add(GRAVITY, np.multiply(force, 0.17))
        gyro = np.multiply(rate, 0.03)
        for _ in range(n):
            wanted = model.look(accel, gyro, 0.0625)
            assert look(machine, [(accel, gyro)], 0.0625) == wanted
            assert number(machine, "AT_REST") == model.rest


@pytest.mark.long
def test_it_is_there_where_the_sensor_is_and_can_be_left_out(tmp_path: Path) -> None:
    def routines(program: Program) -> set[str]:
        return {r.name for r in program.entries}

    plain = Program(DiscreteModel(build("ins15", None, {"sensors": "gnss_velocity"})), "p")
    without = made(without=("rest",))
    assert ROUTINE in routines(made())
    assert ROUTINE in routines(made(frame="ecef"))
    assert ROUTINE not in routines(plain) | routines(without)
    assert {"REST_MAX_SPEED", "REST_SPACING"} <= made().settings.keys() - without.settings.keys()
    write_folder(without, "numpy", None, tmp_path / "f")
    assert read_folder(tmp_path / "f").program.without == ("rest",)
    with pytest.raises(InputError, match="no part 'brakes'"):
        made(without=("brakes",))


@pytest.mark.long
@pytest.mark.parametrize(
    ("without", "most", "least"), [((), 1.0, 0.0), pytest.param(("rest",), 50.0, 5.0, marks=pytest.mark.long)]
)
def test_a_parked_vehicle_does_not_drift(
    without: tuple[str, ...], most: float, least: float, tmp_path: Path
) -> None:
    """30 s without GNSS: below a metre with it, of three draws metres without it. 0.32 and 12.2 m of ten."""
    if shutil.which(os.environ.get("CC") or "cc") is None:
        pytest.skip("there is no C compiler on this machine")
    sensors = {"sensors": "gnss_position,gnss_velocity,zero_velocity"}
    program = Program(DiscreteModel(build("ins15", None, sensors)), without=without, form="ud")
    write_folder(program, "c", None, tmp_path / "c")
    fault = replace(next(f for f in FAULTS if f.needs == ROUTINE), needs="")
    emitted = EmittedFilter(program, "c", tmp_path / "c")
    found = [v for seed in range(1, 4) for v in fly_faults(emitted, faults=[fault], seed=seed)]
    assert least < max(v.worst for v in found) < most
    assert [v.missed for v in found] == [()] * 3
    assert all(np.isinf(v.reported) != bool(without) for v in found)
