"""Proves that a flight whose log is wrong is said to be, and that nothing is fitted to it.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen; what is wrong is done to their columns.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

import kfgen as kf
from kfgen.effects import make
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log
from kfgen.log.pauses import in_words, longest_part
from kfgen.model.filter import FilterModel

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

Columns = dict[str, NDArray[np.float64]]


@lru_cache
def model() -> FilterModel:
    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    return kf.build("ins15", options={"left_out": "false"}, sensors=sensors)


@lru_cache
def as_it_was() -> Log:
    found = trial.log_of(trial.Case("quadrotor", 112_351, 60.0), [])
    assert isinstance(found, Log)
    return found


def log_with(change: Callable[[Columns, NDArray[np.float64]], object]) -> Log:
    log = as_it_was()
    columns = {n: np.array(c.values) for n, c in log.channels.items()}
    change(columns, log.t)
    channels = {n: replace(c, values=columns[n]) for n, c in log.channels.items()}
    return Log(log.t, channels, source="flight")


def exchanged(a: str, b: str, sign: float = 1.0) -> Callable[[Columns, NDArray[np.float64]], object]:
    return lambda c, t: c.update({a: sign * c[b], b: sign * c[a]})


def held(sensor: str, start: float, stop: float) -> Callable[[Columns, NDArray[np.float64]], object]:
    def change(c: Columns, t: NDArray[np.float64]) -> None:
        for name in (n for n in c if n.startswith(sensor)):
            rows = np.flatnonzero(np.isfinite(c[name]) & (t >= start) & (t < stop))
            c[name][rows] = c[name][rows[0]]

    return change


def times(factor: float, *sensors: str) -> Callable[[Columns, NDArray[np.float64]], object]:
    return lambda c, t: c.update({n: factor * v for n, v in c.items() if n.startswith(sensors)})


def east_north_up(c: Columns, t: NDArray[np.float64]) -> None:
    for p in ("gnss_p", "gnss_v"):
        c[f"{p}_N"], c[f"{p}_E"], c[f"{p}_D"] = c[f"{p}_E"], c[f"{p}_N"], -c[f"{p}_D"]


def accel_and_gyro(c: Columns, t: NDArray[np.float64]) -> None:
    times(1.0 / 9.80665, "accel")(c, t)
    times(DEGREES, "gyro")(c, t)


DEGREES = 180.0 / np.pi
AXES_OF_ENU = (("axis_swap", "N"), ("axis_swap", "E"), ("sign_error", "D"))
ENU = {(name, f"{p}_{a}") for p in ("gnss_p", "gnss_v") for name, a in AXES_OF_ENU}
MISREAD = [
    (times(1.0 / 9.80665, "accel"), {"accel": 1.0 / 9.80665}),
    (times(DEGREES, "gyro"), {"gyro": DEGREES}),
    (accel_and_gyro, {"accel": 1.0 / 9.80665, "gyro": DEGREES}),
    (times(1e3, "gnss"), {"gnss_p": 1e3, "gnss_v": 1e3}),
    pytest.param(times(3.6, "gnss_v"), {"gnss_v": 3.6}, marks=pytest.mark.long),
    (times(1e6, "mag"), {"mag": 1e6}),
    pytest.param(times(10.0, "mag"), {"mag": 10.0}, marks=pytest.mark.long),
]


def faults(log: Log) -> set[tuple[str, str]]:
    scene = flight_scene(log, model())
    assert scene is not None
    return {(p.effect.name, p.where) for p in scene.faults()}


@pytest.mark.parametrize(
    ("change", "said"),
    in_part(
        [
            (exchanged("gyro_z", "gyro_z", -1.0), {("sign_error", "gyro_z")}),
            pytest.param(
                exchanged("mag_y", "mag_y", -1.0), {("sign_error", "mag_y")}, marks=pytest.mark.long
            ),
            (exchanged("gyro_x", "gyro_y"), {("axis_swap", "gyro_x"), ("axis_swap", "gyro_y")}),
            pytest.param(times(-1.0, "baro"), {("sign_error", "baro")}, marks=pytest.mark.long),
            pytest.param(
                times(-1.0, "mag_y", "mag_z"),
                {("sign_error", "mag_y"), ("sign_error", "mag_z")},
                marks=pytest.mark.long,
            ),
            (east_north_up, ENU),
            (held("gnss", 30.0, 40.0), {("stuck", "gnss_p"), ("stuck", "gnss_v")}),
            (held("baro", 0.0, 60.0), {("stuck", "baro")}),
            (held("gyro", 30.0, 32.0), {("stuck", "gyro")}),
            (lambda c, t: np.clip(c["accel_z"], -10.1, None, out=c["accel_z"]), {("clipping", "accel_z")}),
        ]
    ),
)
def test_what_is_wrong_with_a_log_is_named(
    change: Callable[[Columns, NDArray[np.float64]], object], said: set[tuple[str, str]]
) -> None:
    assert faults(log_with(change)) == said


@pytest.mark.parametrize(("change", "said"), in_part(MISREAD, 2))
def test_a_wrong_unit_is_named_with_its_factor(
    change: Callable[[Columns, NDArray[np.float64]], object], said: dict[str, float]
) -> None:
    scene = flight_scene(log_with(change), model())
    assert scene is not None
    found = {p.where: p.effect for p in scene.faults()}
    assert {e.name for e in found.values()} == {"unit_error"}
    assert {w: e.row("")["factor"][0] for w, e in found.items()} == pytest.approx(said, rel=1e-6)


@pytest.mark.long
def test_wrong_units_of_a_real_flight_are_named(recording: Callable[[str], Path]) -> None:
    """The receiver and the sensor as they were, then in g and degrees a second: a climb, and no heading at the start."""
    log, filter_ = kf.read_log(recording("flights/ecl_iris_gps_replay.csv")), kf.build("ins15")
    columns = {n: np.array(c.values) for n, c in log.channels.items()}
    as_logged = flight_scene(log, filter_)
    assert as_logged is not None
    assert as_logged.faults() == ()
    accel_and_gyro(columns, log.t)
    wrong = replace(log, channels={n: replace(c, values=columns[n]) for n, c in log.channels.items()})
    scene = flight_scene(wrong, filter_)
    assert scene is not None
    assert {(p.effect.name, p.where) for p in scene.faults()} == {
        ("unit_error", "accel"),
        ("unit_error", "gyro"),
    }


def test_a_receiver_that_holds_its_position_at_rest_is_none() -> None:
    """The vehicle rests for 3 s, 58 samples of the barometer; a flight as it is has no fault either."""
    assert faults(log_with(held("baro", 0.0, 2.9))) == set()
    assert faults(log_with(held("baro", 30.0, 32.9))) == {("stuck", "baro")}
    assert faults(log_with(lambda c, t: None)) == set()


def test_nothing_is_fitted_to_a_wrong_log() -> None:
    found = kf.find_gap(log_with(held("gnss", 30.0, 40.0)), model())
    assert found.verdict == "bad_data"
    stuck = next(f.effect for f in found.findings if f.where == "gnss_p")
    assert stuck.row("")["time"][0] == pytest.approx(30.0, abs=0.3)  # a fix is every 0.2 s
    assert stuck.row("")["lasting"][0] == pytest.approx(10.0, abs=0.5)


def test_no_error_in_proportion_to_a_reading_exceeds_it() -> None:
    """A wrong sign is minus twice a reading, a wrong unit many times it: both are asked for by themselves."""
    scene = flight_scene(as_it_was(), model())
    assert scene is not None

    def said(place: str, name: str, **values: float) -> bool:
        return bool(scene.unreached(Placed(make(name, **values), place)))

    assert said("gyro_z", "scale_factor", coefficient=-1.01)
    assert not said("gyro_z", "scale_factor", coefficient=0.99)
    assert said("mag", "soft_iron", yz=1.2)
    assert not said("mag", "soft_iron", xx=-0.9, zz=0.3)
    assert not said("accel_x", "bias_step", size=20.0, time=30.0)


def test_a_product_of_forces_costs_what_its_coefficient_must_be_larger() -> None:
    """The one that swings most costs nothing, one that swings e times less a nat, by the forces of the log itself."""
    scene = flight_scene(as_it_was(), model())
    assert scene is not None
    asked = [
        p for ps in scene.candidates(()) for p in ps if (p.effect.name, p.where) == ("g_squared", "gyro_x")
    ]
    costs = {
        n: p.prior_penalty_nats
        for p in asked
        for n in ("xx", "yy", "zz", "xy", "yz", "zx")
        if getattr(p.effect, n)
    }
    f = dict(zip("xyz", np.column_stack([as_it_was().channels[f"accel_{a}"].values for a in "xyz"]).T))
    swing = {n: float(np.ptp(f[n[0]] * f[n[1]])) for n in costs}
    most = max(swing, key=lambda n: swing[n])
    assert len(costs) == 6
    assert costs[most] == 0.0
    # The path's forces have less noise than the samples: what is small is smaller there.
    assert all(costs[n] >= np.log(swing[most] / swing[n]) - 0.7 for n in costs)
    assert max(costs.values()) > 1.0


def paused() -> Log:
    """The flight with 20 s of it not logged."""
    log = as_it_was()
    kept = (log.t < log.t[0] + 15.0) | (log.t > log.t[0] + 35.0)
    channels = {n: replace(c, values=c.values[kept]) for n, c in log.channels.items()}
    return Log(log.t[kept], channels, source="flight")


def test_the_longest_part_of_a_log_is_that_between_its_pauses() -> None:
    log = paused()
    part = longest_part(log)
    assert part.t[[0, -1]] - as_it_was().t[0] == pytest.approx((35.0, 60.0), abs=0.05)
    assert "no row for 20" in in_words(log)
    assert "pause" not in in_words(log)
    assert longest_part(as_it_was()) is as_it_was()


def test_a_run_through_a_pause_is_warned_of() -> None:
    said = kf.run(model(), paused()).cautions
    assert any("no row for 20" in w and "Cut the log there" in w for w in said)
    assert not any("no row" in w for w in kf.run(model(), as_it_was().cut(0, 500)).cautions)


@pytest.mark.long
def test_a_gap_of_a_log_with_a_pause_is_that_of_its_longest_part() -> None:
    found = kf.find_gap(paused(), model())
    start, stop = found.comparisons[0].span_s
    assert stop - start == pytest.approx(25.0, abs=1.5)
    assert any("no row for 20" in w and "its longest part" in w for w in found.warnings)
