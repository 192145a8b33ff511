"""Proves the hooks for lanes: what is told of jumps, how a lane is handed over, and the numbers by which one is chosen.

Jumps are compared with differences of states and with scipy's rotations, test ratios with a mean that is written here again,
the share of the covariance with dense matrices.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from in_part import in_part
from scipy.spatial.transform import Rotation

from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.watch.lanes import HEALTH, TAKE_OVER, jumping
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build

GRAVITY, STILL = [0.0, 0.0, -9.80665], [0.0, 0.0, 0.0]
QUATERNION = [f"q_{a}" for a in "wxyz"]


def started(form: str = "ud", lanes: bool = True) -> Machine:
    machine = Machine(Program(DiscreteModel(build("ins15")), form, lanes=lanes), np.float64)
    machine.call("init")
    return machine


def watched(machine: Machine) -> dict[str, float]:
    names = [n for n, _ in machine.program.supervisor.places]
    return dict(zip(names, machine.arrays["supervisor"].tolist(), strict=True))


def state(machine: Machine) -> dict[str, float]:
    return dict(zip(machine.program.discrete.nominal_names, machine.arrays["x"].tolist(), strict=True))


def run(machine: Machine, seconds: float, north: float, turning: float = 0.0) -> None:
    for k in range(round(100 * seconds)):
        machine.call("predict", [np.add(GRAVITY, 1e-6 * (k % 2)), [1e-6 * (k % 2), 0.0, turning], 0.01])
        if k % 10 == 9:
            machine.call("update_gnss_position", [[north, 0.0, 0.0]])
            machine.call("update_gnss_velocity", [STILL])


def jumps(machine: Machine) -> dict[str, float]:
    places = watched(machine)
    return {n: places[f"JUMP_{n.upper()}"] for n in jumping(machine.program.discrete.model)}


def turned(values: dict[str, float]) -> Rotation:
    return Rotation.from_quat([values[n] for n in QUATERNION], scalar_first=True)


@pytest.mark.long
@pytest.mark.parametrize("form", in_part(["ud", "p"]))
def test_a_reset_tells_what_it_moved_and_a_calm_filter_tells_nothing(form: str) -> None:
    machine = started(form)
    start = jumps(machine)
    run(machine, 5.0, 0.0)
    assert jumps(machine) == start
    run(machine, 2.0, 1000.0)
    first, before = jumps(machine), state(machine)
    assert abs(first["p_N"]) < 1e-6
    assert machine.call("update_gnss_position", [[1000.0, 0.0, 0.0]]) == "OK"
    after, moved = state(machine), jumps(machine)
    assert moved["p_N"] == pytest.approx(1000.0, abs=0.1)
    for n in set(moved) - set(QUATERNION):
        assert moved[n] - first[n] == pytest.approx(after[n] - before[n], abs=1e-9), n
    change = turned(after) * turned(before).inv()
    assert (turned(moved) * turned(first).inv() * change.inv()).magnitude() < 1e-9
    run(machine, 8.0, 1000.0)
    settled = jumps(machine)
    run(machine, 3.0, 1000.0)
    assert jumps(machine) == settled


@pytest.mark.parametrize("form", in_part(["ud", "p"]))
def test_a_hand_over_is_whole_and_its_jump_is_said(form: str) -> None:
    mine, other = started(form), started(form)
    run(mine, 3.0, 0.0, 0.1)
    run(other, 3.0, 7.0, -0.2)
    before, resets = state(mine), watched(mine)["RESETS"]
    array = mine.program.covariance.ARRAY
    assert mine.call(TAKE_OVER, [other.arrays["x"], other.arrays[array]]) == "OK"
    np.testing.assert_array_equal(mine.arrays["x"], other.arrays["x"])
    np.testing.assert_array_equal(mine.covariance(), other.covariance())
    moved, after = jumps(mine), state(other)
    for n in set(moved) - set(QUATERNION):
        assert moved[n] == pytest.approx(after[n] - before[n], abs=1e-12)
    assert (turned(moved) * turned(before) * turned(after).inv()).magnitude() < 1e-12
    assert turned(moved).magnitude() > 0.1
    assert watched(mine)["RESETS"] == resets + 1.0
    assert watched(mine)["SINCE_RESET"] == 0.0
    assert mine.call("supervise") == "DEGRADED"


@pytest.mark.parametrize("bad", in_part(["state", "quaternion", "variance", "covariance"]))
def test_a_broken_lane_is_refused(bad: str) -> None:
    mine, other = started("p"), started("p")
    before = mine.words().tobytes()
    if bad == "state":
        other.arrays["x"][3] = math.inf
    elif bad == "quaternion":
        other.arrays["x"][6:10] *= 1.01
    else:
        other.arrays["P"][0 if bad == "variance" else 1] = -1.0 if bad == "variance" else math.nan
    assert mine.call(TAKE_OVER, [other.arrays["x"], other.arrays["P"]]) == "BAD_INPUT"
    assert mine.words().tobytes() == before


def test_the_ratio_counts_rejected_samples_too_and_forgets() -> None:
    """A mean with the weight of `NIS_WEIGHT` of NIS over the squared gate, of 100 at most."""
    machine, wanted, status = started(), 0.0, []
    run(machine, 2.0, 0.0)
    wanted = watched(machine)["TESTED_GNSS_POSITION"] / 100.0
    for far in (0.0, 5.0, 60.0, 1e5, 0.0, 0.0, 1.0):
        status.append(machine.call("update_gnss_position", [[far, 0.0, 0.0]]))
        ratio = min(float(machine.arrays["nis"][0]) / 10.0**2, 100.0)
        wanted += 0.1 * (ratio - wanted)
        machine.call(HEALTH)
        assert watched(machine)["LANE_RATIO_GNSS_POSITION"] == pytest.approx(wanted, rel=1e-9)
    assert {"OK", "GATED"} == set(status)
    assert watched(machine)["LANE_RATIO"] == pytest.approx(wanted, rel=1e-9)
    assert watched(machine)["LANE_RATIO_GNSS_VELOCITY"] < watched(machine)["LANE_RATIO"]


@pytest.mark.parametrize("form", in_part(["ud", "p"]))
def test_age_share_and_status(form: str) -> None:
    machine = started(form)
    run(machine, 4.0, 0.0)
    for _ in range(30):
        machine.call("predict", [GRAVITY, STILL, 0.01])
    said = machine.call(HEALTH)
    assert said == machine.call("supervise") == "OK"
    assert watched(machine)["LANE_AGE"] == pytest.approx(0.3)
    priors = np.array([s.prior for s in machine.program.discrete.model.states])
    share = np.mean(np.diag(machine.covariance()) / priors**2)
    assert watched(machine)["LANE_SHARE"] == pytest.approx(share, rel=1e-12)
    machine.call("predict", [[math.nan] * 3, STILL, 0.01])
    assert machine.call(HEALTH) == machine.call("supervise") == "DEGRADED"


def test_without_lanes_nothing_of_them_is_there() -> None:
    plain, own = started(lanes=False).program, started().program
    assert {HEALTH, TAKE_OVER} == {r.name for r in own.entries} - {r.name for r in plain.entries}
    names = [n for n, _ in plain.supervisor.places]
    assert not [n for n in names if n.startswith(("LANE", "JUMP", "TESTED"))]
