"""Proves the alignment in motion: heading from two antennas, the course or the field, errors within their covariance.

Truth is the flight of `kfgen.verify.flight`: S-turns at 20 m/s. The error e = Log(R R_hat') over its covariance, e' P^-1 e,
is chi-squared of three degrees at most: each of 60 is below 28.9 with a chance of 1.5e-4 in all, their mean below 4.6 (5
standard deviations). Seeds are fixed.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from scipy.spatial.transform import Rotation

from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.targets import filterpy, plain
from kfgen.emit.targets.loaded import loaded
from kfgen.emit.watch.quiet import REASONS
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.verify.flight import flight, turning

RATE, DT = 100.0, 0.01
FIELD = np.array([20e-6, 0.0, 44e-6])
BODY = {"attitude_error": "local-quaternion"}
MAG = {"sensors": "gnss_position,gnss_velocity,mag", "field": "vector"}


@cache
def made(form: str = "ud", **options: str) -> tuple[Program, Any]:
    program = Program(DiscreteModel(build("ins15", None, options)), form, "double")
    return program, loaded(plain.module(program))


def started(form: str = "ud", **options: str) -> Any:
    program, module = made(form, **options)
    return getattr(module, filterpy.class_name(program))()


class Way:
    """Samples of the flight from a time on."""

    def __init__(self, seed: int, begins: float, seconds: float = 3.0) -> None:
        self.rng = np.random.default_rng(seed)
        trial = flight(RATE, begins + seconds, FIELD, self.rng)
        first = round(begins * RATE)
        self.accel, self.gyro = trial.accel[first:], trial.gyro[first:]
        at = begins + np.arange(len(self.accel) + 1) * DT
        self.R, v = turning(at)
        self.v = v + 0.1 * self.rng.normal(size=v.shape)
        self.field = self.R.inv().apply(FIELD) + 2e-7 * self.rng.normal(size=v.shape)
        ahead = self.R.apply([1.0, 0.0, 0.0])
        self.heading = np.arctan2(ahead[:, 1], ahead[:, 0])


def aligned(kf: Any, way: Way, how: str, sd: float = 0.0) -> int:
    """Samples until it is aligned; -1 where it is not."""
    for k in range(len(way.accel)):
        if k % 10 == 0:
            if how == "course":
                said = kf.align_course(way.v[k])
            elif how == "mag":
                said = kf.align_moving(way.v[k], way.field[k])
            else:
                said = kf.align_moving(way.v[k], way.heading[k] + sd * way.rng.normal())
            if said.name == "OK":
                return k
            assert said.name == "ALIGNING"
            assert kf.supervise().name == "ALIGNING"
        assert kf.align_gather(way.accel[k], way.gyro[k], DT).name == "ALIGNING"
    return -1


def reason(kf: Any, program: Program) -> str:
    names = [n for n, _ in program.supervisor.places]
    return REASONS[round(float(kf.supervisor[names.index("ALIGN_REASON")]))]


@pytest.mark.parametrize(
    ("how", "options"),
    in_part([("antennas", {}), ("course", BODY), ("mag", MAG)]),
    ids=["antennas", "course", "mag"],
)
def test_errors_are_within_their_covariance(how: str, options: dict[str, str]) -> None:
    program, _ = made("ud", **options)
    attitude = program.discrete.model.attitude
    assert attitude is not None
    names = list(program.discrete.nominal_names)
    states = [s.name for s in program.discrete.model.states]
    own = [states.index(n) for n in attitude.error_names]
    q = slice(names.index("q_w"), names.index("q_w") + 4)
    found, times = [], []
    for seed in range(60):
        way = Way(seed, 1.0 + 0.37 * seed % 25.0, 12.0 if how == "mag" else 3.0)
        kf = started("ud", **options)
        if how == "mag":
            kf.x[[names.index(f"mag_{a}") for a in "NED"]] = FIELD
        k = aligned(kf, way, how, 0.05)
        if k < 0:
            assert reason(kf, program) in ("TURNING", "NO_HORIZONTAL_FIELD")  # a bank along the field
            continue
        times.append(k)
        estimate, true = Rotation.from_quat(kf.x[q], scalar_first=True), way.R[k]
        e = (estimate.inv() * true if options is BODY else true * estimate.inv()).as_rotvec()
        P = kf.covariance()[np.ix_(own, own)]
        found.append(float(e @ np.linalg.solve(P, e)))
        assert kf.x[names.index("v_N") : names.index("v_N") + 3] == pytest.approx(way.v[k])
        assert kf.supervise().name == "OK"
    assert len(found) > 45
    assert min(times) == 100
    assert max(found) < 28.9
    assert 0.2 < np.mean(found) < 4.6


def test_it_waits_with_a_reason() -> None:
    """Too slow for a course, a force that the velocities do not explain, an inertial sample beyond any sensor, a dead fix."""
    program, _ = made()
    kf = started()
    names = [n for n, _ in program.supervisor.places]
    assert kf.align_course([1.0, 0.0, 0.0]).name == "ALIGNING"
    assert reason(kf, program) == "TOO_SLOW"
    kf = started()
    assert kf.align_moving([20.0, 0.0, 0.0], 0.0).name == "ALIGNING"
    for _ in range(120):
        kf.align_gather([0.0, 0.0, -2.0], [0.0, 0.0, 0.0], DT)
    assert kf.align_moving([20.0, 0.0, 0.0], 0.0).name == "ALIGNING"
    assert reason(kf, program) == "NOT_GRAVITY"
    assert kf.align_gather([np.nan, 0.0, 0.0], [0.0, 0.0, 0.0], DT).name == "BAD_INPUT"
    assert kf.supervisor[names.index("MOVING")] == 0.0
    assert kf.align_gather([0.0, 0.0, -9.8], [0.0, 0.0, 0.0], 0.0).name == "BAD_STEP"
    assert kf.align_moving([np.nan, 0.0, 0.0], 0.0).name == "BAD_INPUT"
    assert kf.align_moving([20.0, 0.0, 0.0], np.nan).name == "BAD_INPUT"


def test_a_level_way_without_errors_is_exact() -> None:
    """A constant velocity to the east, nose 10 deg up: the pitch and the heading that were given."""
    kf = started()
    kf.align_moving([0.0, 30.0, 0.0], np.pi / 2.0)
    R = Rotation.from_euler("ZYX", [90.0, 10.0, 0.0], degrees=True)
    force = R.inv().apply([0.0, 0.0, -9.80665])
    for _ in range(110):
        kf.align_gather(force, [0.0, 0.0, 0.0], DT)
    assert kf.align_moving([0.0, 30.0, 0.0], np.pi / 2.0).name == "OK"
    names = list(made()[0].discrete.nominal_names)
    found = Rotation.from_quat(kf.x[names.index("q_w") : names.index("q_w") + 4], scalar_first=True)
    assert (found.inv() * R).magnitude() < 1e-9


def test_filterpy_aligns_alike() -> None:
    program = Program(DiscreteModel(build("ins15")), "p")
    kf = getattr(loaded(filterpy.module(program)), filterpy.class_name(program))()
    machine = Machine(program, np.float64)
    machine.call("init")
    way = Way(5, 3.0)
    assert aligned(kf, way, "course") > 0
    way = Way(5, 3.0)
    for k in range(101):
        if k % 10 == 0 and machine.call("align_course", [way.v[k]]) == "OK":
            break
        machine.call("align_gather", [way.accel[k], way.gyro[k], DT])
    np.testing.assert_allclose(kf.nominal, machine.arrays["x"], atol=1e-12)
    np.testing.assert_allclose(kf.P, machine.covariance(), atol=1e-14)


def test_what_has_no_velocity_is_aligned_at_rest_only() -> None:
    assert Program(DiscreteModel(build("ahrs6"))).moving == ()
    assert not any(
        n.startswith("MOVING") for n, _ in Program(DiscreteModel(build("ahrs6"))).supervisor.places
    )
