"""Proves the bounds of biases: where a correction ends there, what is said, what stays as it was, and what it is worth.

The correction that is bounded is worked out here from dense matrices, ``P H' (H P H' + R)^-1 y``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects import make
from kfgen.emit.covariance.packed import place
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name, module
from kfgen.emit.targets.loaded import loaded
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter_file import read_filter
from kfgen.model.library import build, build_filter

GRAVITY, STILL = [0.0, 0.0, -9.80665], [0.0, 0.0, 0.0]
DAY_S, K_GYRO, K_ACCEL = 86400.0, 2e-5, 3e-4
MOST = 10.0 * (0.2**2 + K_ACCEL**2 * DAY_S) ** 0.5
"""Of the accelerometers [m/s^2]: ten times their turn-on bias of 0.2 after a day's walk."""


def program(**how: tuple[str, ...]) -> Program:
    return Program(DiscreteModel(build("ins15", None, {})), "p", **how)  # type: ignore[arg-type]


def number(machine: Machine, place: str) -> float:
    return float(machine.arrays["supervisor"][[n for n, _ in machine.program.supervisor.places].index(place)])


def correlated(p: Program) -> tuple[Machine, NDArray[np.float64]]:
    """A filter whose bias is 1.9 m/s^2 and moves with the velocity; and its covariance."""
    machine = Machine(p, np.float64)
    machine.call("init")
    states = [s.name for s in p.discrete.model.states]
    v, ba = states.index("v_N"), states.index("ba_x")
    machine.arrays["P"][place(p.n, v, ba)] = 0.75 * 1.0 * 0.2
    machine.arrays["x"][p.discrete.nominal_names.index("ba_x")] = 1.9
    return machine, machine.covariance()


def wanted(p: Program, P: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Correction of the error state by a sample of GNSS's velocity."""
    states = [s.name for s in p.discrete.model.states]
    H = np.zeros((3, p.n))
    H[range(3), [states.index(f"v_{a}") for a in "NED"]] = 1.0
    R = np.diag(
        [
            p.discrete.measurement_variance(p.discrete.model.sensors[1], c)
            for c in p.discrete.model.sensors[1].channels
        ]
    )
    return P @ H.T @ np.linalg.solve(H @ P @ H.T + R, y)


@pytest.mark.parametrize(("v", "held"), [(5.0, True), (0.05, False)])
def test_a_bias_stays_at_its_bound_and_it_is_said(v: float, held: bool) -> None:
    p = program()
    machine, P = correlated(p)
    x = dict(zip(p.discrete.nominal_names, machine.arrays["x"].copy(), strict=True))
    y = np.array([v, 0.0, 0.0]) - [x[f"v_{a}"] for a in "NED"]
    dx = dict(zip([s.name for s in p.discrete.model.states], wanted(p, P, y), strict=True))
    assert (x["ba_x"] + dx["ba_x"] > MOST) == held
    free, _ = correlated(program(without=("biases",)))
    assert free.call("update_gnss_velocity", [[v, 0.0, 0.0]]) == "OK"
    assert machine.call("update_gnss_velocity", [[v, 0.0, 0.0]]) == ("LIMITED" if held else "OK")
    after = dict(zip(p.discrete.nominal_names, machine.arrays["x"], strict=True))
    assert after["ba_x"] == pytest.approx(min(x["ba_x"] + dx["ba_x"], MOST), rel=1e-12)
    where = [i for i, n in enumerate(p.discrete.nominal_names) if n != "ba_x"]
    np.testing.assert_array_equal(machine.arrays["x"][where], free.arrays["x"][where])
    np.testing.assert_array_equal(machine.arrays["P"], free.arrays["P"])
    assert number(machine, "LIMITED_BA_X") == held
    assert number(machine, "LIMITED_BA_Y") == 0.0


def test_the_supervisor_says_degraded_for_its_settle_time() -> None:
    machine, _ = correlated(program())
    machine.call("update_gnss_velocity", [[5.0, 0.0, 0.0]])
    for k in range(310):
        said = machine.call("supervise")
        assert k in (299, 300, 301) or said == ("DEGRADED" if k < 300 else "OK"), k
        machine.call("predict", [np.add(GRAVITY, 1e-6 * (k % 2)), [1e-6 * (k % 2), 0.0, 0.0], 0.01])


def test_the_range_of_a_sensor_is_a_bound_where_it_is_less(tmp_path: Path) -> None:
    path = tmp_path / "f.toml"
    path.write_text('format = "kfgen-filter-1"\nmodel = "ins15"\n[limits]\ngyro = "5 deg/s"\n')
    limited = Program(DiscreteModel(build_filter(read_filter(str(path))))).settings
    assert limited["MAX_BIAS_GYRO"].value == pytest.approx(np.radians(5.0))
    assert program().settings["MAX_BIAS_GYRO"].value == pytest.approx(
        10.0 * (0.02**2 + K_GYRO**2 * DAY_S) ** 0.5
    )
    assert program().settings["MAX_BIAS_ACCEL"].value == pytest.approx(MOST)
    assert "MAX_BIAS_ACCEL" not in program(without=("biases",)).settings


def test_filterpy_holds_the_same_bias() -> None:
    p = program()
    machine, P = correlated(p)
    kf = getattr(loaded(module(p)), class_name(p))()
    kf.P = P.copy()
    kf.nominal[p.discrete.nominal_names.index("ba_x")] = 1.9
    for call in (
        machine.call("update_gnss_velocity", [[5.0, 0.0, 0.0]]),
        kf.update_gnss_velocity(np.array([5.0, 0.0, 0.0])).name,
    ):
        assert call == "LIMITED"
    np.testing.assert_allclose(kf.nominal, machine.arrays["x"], atol=1e-9)
    np.testing.assert_allclose(kf.supervisor, machine.arrays["supervisor"], rtol=1e-6)


def test_a_bias_that_walks_has_a_day_of_it() -> None:
    """Ten times the root of prior^2 + K^2 86400 s."""
    K, model = 1e-3, build("ins15", None, {"biases": "constant"})
    for axis in "xyz":
        model = model.augment(f"gyro_{axis}", make("rate_random_walk", K=K))
    found = Program(DiscreteModel(model)).settings["MAX_BIAS_GYRO"].value
    assert found == pytest.approx(10.0 * (0.02**2 + K**2 * DAY_S) ** 0.5, rel=1e-6)
