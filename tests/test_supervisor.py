"""Proves what enters a filter and what watches over it: limits, the gate on a field's length, counters, resets, condition.

The reference is asked in double precision; `kfgen verify` compares the C with it to the last bit, the same calls among
them (`kfgen.emit.scenario`). A flight with faults is in `tests/test_flight_faults.py`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from in_part import in_part

from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.scenario import scenario, split
from kfgen.emit.settings import MAX_BY_UNIT
from kfgen.emit.targets.filterpy import class_name, module
from kfgen.emit.targets.loaded import loaded
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter_file import read_filter
from kfgen.model.library import build, build_filter

GRAVITY = [0.0, 0.0, -9.80665]
FIELD = [20e-6, 0.0, 44e-6]
STILL = [0.0, 0.0, 0.0]


def started(name: str, form: str = "ud", **options: str) -> Machine:
    machine = Machine(Program(DiscreteModel(build(name, None, options)), form), np.float64)
    machine.call("init")
    return machine


def watched(machine: Machine) -> dict[str, float]:
    names = [n for n, _ in machine.program.supervisor.places]
    return dict(zip(names, machine.arrays["supervisor"].tolist(), strict=True))


def estimate(machine: Machine) -> bytes:
    return machine.words()[: -len(machine.arrays["supervisor"])].tobytes()


WRONG = [("gyro", 1e8), ("gyro", math.nan), ("accel", 1e10), ("accel", -math.inf)]


@pytest.mark.parametrize("form", ["p", "ud"])
@pytest.mark.parametrize(("where", "value"), WRONG)
def test_an_implausible_input_is_refused_and_time_goes_by(where: str, value: float, form: str) -> None:
    machine = started("ins15", form)
    before = estimate(machine)
    accel, gyro = list(GRAVITY), list(STILL)
    {"gyro": gyro, "accel": accel}[where][1] = value
    assert machine.call("predict", [accel, gyro, 0.01]) == "BAD_INPUT"
    assert estimate(machine) == before
    assert watched(machine)["MISSED"] == pytest.approx(0.01)
    assert machine.call("supervise") == "DEGRADED"
    assert machine.call("predict", [GRAVITY, STILL, 0.01]) == "OK"
    assert watched(machine)["MISSED"] == 0.0


def test_what_is_within_the_limits_never_makes_a_number_infinite() -> None:
    """Ten minutes of every input and sample at its limit, signs by chance: refused, rejected or fused, but finite."""
    machine = started("ins15", "p")
    rng = np.random.default_rng(1)
    limit = {c.name: c.value for c in machine.program.settings.values()}
    for k in range(600):
        accel, gyro = (limit[f"MAX_{n}"] * rng.choice([-1.0, 1.0], 3) for n in ("ACCEL", "GYRO"))
        machine.call("predict", [accel, gyro, 0.1])
        if k % 10 == 0:
            for s in machine.program.discrete.model.sensors:
                most = limit[f"MAX_{s.name.upper()}_SAMPLE"]
                machine.call(f"update_{s.name}", [most * rng.choice([-1.0, 1.0], 3)])
        assert np.isfinite(machine.words()).all()


def test_a_covariance_that_is_no_number_is_said_and_starts_again() -> None:
    for form in ("p", "ud"):
        machine = started("ins15", form)
        machine.arrays[machine.program.covariance.ARRAY][0] = math.nan
        assert machine.call("check") != "OK"
        assert machine.call("predict", [GRAVITY, STILL, 0.01]) == "NOT_FINITE"
        assert machine.call("predict", [GRAVITY, STILL, 0.01]) == "OK"
        assert machine.call("check") == "OK"


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e31])
def test_check_looks_at_the_state_and_its_quaternion(bad: float) -> None:
    machine = started("ahrs6")
    assert machine.call("check") == "OK"
    machine.arrays["x"][5] = bad
    assert machine.call("check") == "NOT_FINITE"
    machine = started("ahrs6")
    machine.arrays["x"][0] = 1.01
    assert machine.call("check") == "NOT_FINITE"


def test_a_declared_range_is_the_limit(tmp_path: Any) -> None:
    """As the filter file says it, 1 % more; the default where it says nothing."""
    path = tmp_path / "f.toml"
    path.write_text('format = "kfgen-filter-1"\nmodel = "ins15"\n[limits]\ngyro = "2000 deg/s"\n')
    machine = Machine(Program(DiscreteModel(build_filter(read_filter(str(path)))), "ud"), np.float64)
    machine.call("init")
    for rate, status in ((2010.0, "OK"), (2030.0, "BAD_INPUT")):
        gyro = [math.radians(rate), 0.0, 0.0]
        assert machine.call("predict", [GRAVITY, gyro, 0.01]) == status
    assert machine.call("predict", [[1.01 * MAX_BY_UNIT["m/s^2"], 0.0, 0.0], STILL, 0.01]) == "BAD_INPUT"


@pytest.mark.parametrize("form", ["p", "ud"])
def test_a_dead_magnetometer_is_refused(form: str) -> None:
    machine = started("ahrs6", form)
    before = estimate(machine)
    assert machine.call("update_mag", [[0.0, 0.0, 0.0]]) == "BAD_INPUT"
    assert estimate(machine) == before
    assert machine.call("update_mag", [FIELD]) == "OK"


@pytest.mark.parametrize(("share", "status"), [(0.91, "OK"), (1.09, "OK"), (0.89, "GATED"), (1.11, "GATED")])
def test_the_gate_on_the_length_of_the_field_is_in_the_code(share: float, status: str) -> None:
    """As `run` does it, in the reference and in filterpy."""
    machine = started("ahrs6", "p", field_gate="0.1")
    z = [share * m for m in FIELD]
    assert machine.call("update_mag", [z]) == status
    kf = getattr(loaded(module(machine.program)), class_name(machine.program))()
    assert kf.update_mag(np.array(z)).name == status


def reject(machine: Machine, seconds: float, far: float) -> list[str]:
    """A fix every tenth of a second, far off; a prediction every hundredth."""
    found = []
    for k in range(round(100 * seconds)):
        machine.call("predict", [np.add(GRAVITY, 1e-6 * (k % 2)), [1e-6 * (k % 2), 0.0, 0.0], 0.01])
        if k % 10 == 9:
            found.append(machine.call("update_gnss_position", [[far, 0.0, 0.0]]))
            machine.call("update_gnss_velocity", [STILL])
    return found


@pytest.mark.long
@pytest.mark.parametrize("form", [pytest.param("p", marks=pytest.mark.long), "ud"])
def test_a_jump_is_rejected_for_its_time_and_then_followed(form: str) -> None:
    """2 s, as `RESET_AFTER` says; the position then is the fix, at its variance, and nothing else was widened."""
    machine = started("ins15", form)
    reject(machine, 5.0, 0.0)
    sd = np.sqrt(np.diag(machine.covariance()))
    found = reject(machine, 2.0, 1000.0)
    assert set(found) == {"GATED"}
    assert machine.call("supervise") == "DEGRADED"
    assert watched(machine)["RESETS"] == 1.0
    assert reject(machine, 0.1, 1000.0) == ["OK"]
    assert machine.arrays["x"][0] == pytest.approx(1000.0, abs=0.1)
    now = np.sqrt(np.diag(machine.covariance()))
    assert now[0] == pytest.approx(1.5, rel=0.1)
    assert (now[3:] < 1.3 * sd[3:]).all()
    assert machine.call("check") == "OK"
    reject(machine, 3.0, 1000.0)
    assert machine.call("supervise") == "OK"


def test_predictions_that_were_missed_for_long_widen_all() -> None:
    machine = started("ins15")
    reject(machine, 5.0, 0.0)
    for _ in range(30):
        assert machine.call("predict", [[math.nan] * 3, STILL, 0.01]) == "BAD_INPUT"
    small = np.sqrt(np.diag(machine.covariance()))
    machine.call("predict", [GRAVITY, STILL, 0.01])
    wide = np.sqrt(np.diag(machine.covariance()))
    assert (wide[:9] > small[:9]).all()
    prior = [s.prior for s in machine.program.discrete.model.states]
    np.testing.assert_allclose(wide[9:], prior[9:], rtol=1e-3)
    np.testing.assert_allclose(wide[6:9], machine.program.settings["RESET_ATTITUDE"].value, rtol=1e-3)


@pytest.mark.long
def test_a_second_reset_of_one_sensor_widens_all() -> None:
    machine = started("ins15")
    reject(machine, 5.0, 0.0)
    reject(machine, 2.1, 1000.0)
    assert np.sqrt(np.diag(machine.covariance()))[12] < 0.02
    reject(machine, 2.0, 0.0)
    assert np.sqrt(np.diag(machine.covariance()))[12] == pytest.approx(0.02, rel=1e-3)


def test_without_an_accepted_sample_the_filter_is_lost() -> None:
    machine = started("ins15")
    for _ in range(100):
        machine.call("predict", [GRAVITY, STILL, 0.099])
    assert machine.call("supervise") != "LOST"
    for _ in range(5):
        machine.call("predict", [GRAVITY, STILL, 0.099])
    assert machine.call("supervise") == "LOST"


def test_an_input_that_does_not_change_is_stuck() -> None:
    machine = started("ins15")
    rng = np.random.default_rng(3)
    for k in range(200):
        machine.call("predict", [GRAVITY + rng.normal(size=3) * 0.01, rng.normal(size=3) * 1e-3, 0.01])
        assert machine.call("supervise") == "OK", k
    stuck = GRAVITY + rng.normal(size=3) * 0.01
    for _ in range(52):
        machine.call("predict", [stuck, rng.normal(size=3) * 1e-3, 0.01])
    assert machine.call("supervise") == "DEGRADED"


@pytest.mark.parametrize("name", in_part(["ahrs6", "ins15"]))
def test_an_open_gate_rejects_nothing_and_widens_nothing(name: str) -> None:
    """As `kfgen run` has it: every sample counts, and no reset comes between a log and its innovations."""
    machine = started(name, "p")
    machine.arrays["k"][-len(machine.program.discrete.model.sensors) :] = math.inf
    routines = {r.name: r for r in machine.program.routines}
    for call in scenario(machine.program)[:300]:
        if call.routine != "predict" or call.inputs[-1] > 0.0:
            machine.call(call.routine, split(routines[call.routine], call.inputs))
    assert watched(machine)["RESETS"] == 0.0


@pytest.mark.parametrize("share", [0.01, 0.9])
def test_filterpy_widens_along_the_rows_of_the_reference_and_no_further(share: float) -> None:
    """A field that no attitude explains, of a hundredth of what a sample may be and of nearly all of it, up to resets."""
    program = Program(DiscreteModel(build("ahrs6")), "p")
    machine, kf = Machine(program, np.float64), getattr(loaded(module(program)), class_name(program))()
    machine.call("init")
    z = share * program.setting("MAX_MAG_SAMPLE").value * np.array([1.0, 0.1, 0.01])
    widest = 0.0
    for _ in range(60):
        for call, values in (("predict", [STILL, 0.05]), ("update_mag", [z.tolist()])):
            assert getattr(kf, call)(*values).name == machine.call(call, values)
        P = machine.covariance()
        np.testing.assert_allclose(kf.P, P, rtol=1e-6, atol=1e-9 * np.abs(P).max())
        widest = max(widest, float(P[0, 0]))
    assert watched(machine)["RESETS"] > 0.0
    assert widest > 2.0 * program.prior(0).value ** 2
