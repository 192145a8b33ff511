"""Proves the alignment of the emitted filters: any attitude at rest, its covariance, and why it waits.

Truth is a rotation of scipy; samples are gravity and field in its body axes with biases of the priors' size. The error
e = Log(R R_hat') over its covariance, e' P^-1 e, is chi-squared of three degrees at most: each of 150 is below 30.7 with
a chance of 1.5e-4 in all, their mean below 4 (5 standard deviations). Seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
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

G = np.array([0.0, 0.0, -9.80665])
FIELD = np.array([20e-6, 0.0, 44e-6])
DT = 0.05
BODY = {"attitude_error": "local-quaternion"}
CASES = [("ahrs6", "p", {}), ("ahrs6", "ud", BODY), ("ins15", "ud", {}), ("ins15", "p", BODY)]
FIRST = [[0.0, 0.0, 0.0], [180.0, 0.0, 0.0], [0.0, 90.0, 0.0], [30.0, -90.0, 0.0], [-90.0, 0.0, 179.0]]
"""Roll, pitch, yaw [deg] beside those by chance: level, upside down, nose up and down, on its side."""


def started(name: str, form: str, options: dict[str, str], real: Any = np.float64) -> Machine:
    machine = Machine(Program(DiscreteModel(build(name, None, options)), form), real)
    machine.call("init")
    return machine


class Sample:
    """What a body at rest shows: specific force, rate, and the field or the heading of the axis that is ahead."""

    def __init__(self, rng: np.random.Generator, R: Rotation, magnetic: bool) -> None:
        self.rng, self.R, self.magnetic = rng, R, magnetic
        self.biases = 0.2 * rng.normal(size=3), 0.02 * rng.normal(size=3)
        down = R.inv().apply([0.0, 0.0, 1.0])
        ahead = R.apply([1.0, 0.0, 0.0] if abs(down[0]) < 0.9 else [0.0, 0.0, 1.0])
        self.heading = float(np.arctan2(ahead[1], ahead[0])) + 0.1 * rng.normal()

    def __call__(self) -> list[Any]:
        noise = [self.rng.normal(size=3) for _ in range(3)]
        f = self.R.inv().apply(G) + self.biases[0] + 0.02 * noise[0]
        w = np.clip(self.biases[1] + 1.5e-3 * noise[1], -0.055, 0.055)
        m = self.R.inv().apply(FIELD) + 2e-7 * noise[2]
        return [f, w, m if self.magnetic else self.heading, DT]


def magnetic(machine: Machine) -> bool:
    return any(s.at_rest == "north" for s in machine.program.discrete.model.sensors)


def attitude(machine: Machine) -> Rotation:
    first = machine.program.discrete.nominal_names.index("q_w")
    return Rotation.from_quat(machine.arrays["x"][first : first + 4], scalar_first=True)


def number(machine: Machine, name: str) -> float:
    return float(machine.arrays["supervisor"][[n for n, _ in machine.program.supervisor.places].index(name)])


@pytest.mark.parametrize(("name", "form", "options"), in_part(CASES))
def test_any_attitude_is_found_within_its_covariance(name: str, form: str, options: dict[str, str]) -> None:
    rng = np.random.default_rng(11)
    machine = started(name, form, options)
    model = machine.program.discrete.model
    assert model.attitude is not None
    states = [s.name for s in model.states]
    own = [states.index(n) for n in model.attitude.error_names]
    found = []
    given = [Rotation.from_euler("ZYX", a[::-1], degrees=True) for a in FIRST]
    for R in [*given, *Rotation.random(145, random_state=3)]:
        machine.call("init")
        sample, calls = Sample(rng, R, magnetic(machine)), 1
        while machine.call("align", sample()) == "ALIGNING":
            assert machine.call("supervise") == "ALIGNING"
            calls += 1
        assert calls in (20, 21)
        assert machine.call("supervise") == "OK"
        estimate = attitude(machine)
        e = (estimate.inv() * R if options else R * estimate.inv()).as_rotvec()
        P = machine.covariance()
        found.append(e @ np.linalg.solve(P[np.ix_(own, own)], e))
        other = np.delete(np.diag(P), own)
        np.testing.assert_allclose(
            np.sqrt(other), [s.prior for i, s in enumerate(model.states) if i not in own]
        )
    assert max(found) < 30.7
    assert 0.5 < np.mean(found) < 4.0
    assert machine.call("check") == "OK"


def turning(f: Any, w: Any, k: int) -> tuple[Any, Any]:
    return f, np.add(w, [0.0, 0.3, 0.0])


def shaken(f: Any, w: Any, k: int) -> tuple[Any, Any]:
    return np.add(f, [0.8 * (-1) ** (k // 4), 0.0, 0.0]), w


def falling(f: Any, w: Any, k: int) -> tuple[Any, Any]:
    return 0.2 * f, w


@pytest.mark.parametrize(
    ("disturbed", "reason"), in_part([(turning, "TURNING"), (shaken, "SHAKEN"), (falling, "NOT_GRAVITY")])
)
@pytest.mark.parametrize("name", in_part(["ahrs6", "ins15"]))
def test_no_attitude_until_it_is_at_rest(
    disturbed: Callable[[Any, Any, int], tuple[Any, Any]], reason: str, name: str
) -> None:
    """Five seconds of it, with the reason; then a second of rest aligns."""
    machine = started(name, "ud", {})
    before = machine.arrays["x"].copy()
    sample = Sample(
        np.random.default_rng(5),
        Rotation.from_euler("ZYX", [40.0, 5.0, -10.0], degrees=True),
        magnetic(machine),
    )
    for k in range(100):
        f, w, last, dt = sample()
        assert machine.call("align", [*disturbed(f, w, k), last, dt]) == "ALIGNING"
        assert machine.call("supervise") == "ALIGNING"
    assert REASONS[round(number(machine, "ALIGN_REASON"))] == reason
    assert (machine.arrays["x"] == before).all()
    calls = 1
    while machine.call("align", sample()) == "ALIGNING":
        calls += 1
    assert calls <= 25
    assert machine.call("supervise") == "OK"
    assert number(machine, "ALIGN_REASON") == 0.0


def test_a_field_along_the_vertical_shows_no_north() -> None:
    machine = started("ahrs6", "ud", {})
    for _ in range(60):
        assert machine.call("align", [G, [0.0] * 3, [1e-6, 0.0, 50e-6], DT]) == "ALIGNING"
    assert REASONS[round(number(machine, "ALIGN_REASON"))] in ("NO_HORIZONTAL_FIELD", "NONE")
    assert machine.call("align", [G, [0.0] * 3, [0.0, 0.0, 0.0], DT]) == "BAD_INPUT"
    assert machine.call("align", [G, [float("nan")] * 3, FIELD, DT]) == "BAD_INPUT"
    assert machine.call("align", [G, [0.0] * 3, FIELD, 0.0]) == "BAD_STEP"


def test_the_declination_of_the_models_field_turns_the_heading() -> None:
    """A field of 5 deg east: a body whose forward axis follows the needle heads 5 deg east of north."""
    machine = started("ahrs6", "p", {"field": "vector"})
    names = machine.program.discrete.nominal_names
    east = np.radians(5.0)
    for name, value in (("mag_N", 20e-6 * np.cos(east)), ("mag_E", 20e-6 * np.sin(east)), ("mag_D", 44e-6)):
        machine.arrays["x"][names.index(name)] = value
    while machine.call("align", [G, [0.0] * 3, [21e-6, 0.0, 40e-6], DT]) == "ALIGNING":
        pass
    assert attitude(machine).as_rotvec() == pytest.approx([0.0, 0.0, east], abs=1e-9)
    field = [float(machine.arrays["x"][names.index(f"mag_{a}")]) for a in "NED"]
    assert field == pytest.approx([21e-6 * np.cos(east), 21e-6 * np.sin(east), 40e-6])


@pytest.mark.parametrize("name", ["ahrs6", "ins15"])
def test_python_aligns_alike(name: str) -> None:
    """filterpy to rounding, numpy to the last bit of the reference in single precision."""
    machine, single = started(name, "p", {}), started(name, "p", {}, np.float32)
    modules = [loaded(t.module(machine.program)) for t in (filterpy, plain)]
    kf, npf = (getattr(m, filterpy.class_name(machine.program))() for m in modules)
    sample = Sample(
        np.random.default_rng(8),
        Rotation.from_euler("ZYX", [130.0, -20.0, 170.0], degrees=True),
        magnetic(machine),
    )
    for _ in range(21):
        given = sample()
        wanted = machine.call("align", given)
        assert kf.align(*given).name == wanted
        assert npf.align(*given).name == single.call("align", given)
        assert kf.supervise().name == machine.call("supervise")
    np.testing.assert_allclose(kf.nominal, machine.arrays["x"], atol=1e-12)
    np.testing.assert_allclose(kf.P, machine.covariance(), atol=1e-15)
    assert npf.x.tobytes() == single.arrays["x"].tobytes()
    assert modules[0].Reason(2).name == modules[1].Reason(2).name == "SHAKEN"


def test_a_heading_beyond_any_turn_is_refused() -> None:
    """Of 1e12 rad single precision has no sine: it is finite, and must not become an attitude that is not."""
    for heading, status in ((900.0, "ALIGNING"), (1e12, "BAD_INPUT"), (np.inf, "BAD_INPUT")):
        machine = started("ins15", "ud", {}, np.float32)
        assert machine.call("align", [tuple(G), (0.0, 0.0, 0.0), heading, DT]) == status
        for _ in range(40):
            machine.call("align", [tuple(G), (0.0, 0.0, 0.0), heading, DT])
        assert np.linalg.norm(machine.arrays["x"][6:10]) == pytest.approx(1.0)


def test_without_an_attitude_there_is_nothing_to_align() -> None:
    program = Program(DiscreteModel(build("gyro-static")))
    assert program.align == ()
    assert not any(n.startswith("ALIGN") for n in program.settings)
