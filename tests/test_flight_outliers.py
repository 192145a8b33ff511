"""Proves that outliers of aiding sensors in a flight are named and left out, and that manoeuvres and noise are none.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen; outliers are added to their columns. Of
normal noise a reading is beyond five standard deviations in 6e-7, and three have to be: no false one is expected in the
lifetime of these tests.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part

import kfgen as kf
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.log.log import Log
from kfgen.model.build import filter_of
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]
MODEL = kf.build("ins15", options={"left_out": "false"}, sensors=SENSORS)


def flight(sensor: str = "", share: float = 0.0, size: float = 0.0, seed: int = 0) -> Log:
    """A flight of a minute; a share of the readings of a sensor has errors of a size beside its noise."""
    return with_outliers(
        trial.log_of(trial.Case("quadrotor", 112_361 + seed, 60.0), []), sensor, share, size, seed
    )


def with_outliers(log: Log, sensor: str, share: float, size: float, seed: int = 0) -> Log:
    rng, channels = np.random.default_rng(seed), dict(log.channels)
    for name in (n for n in log.channels if sensor and n.startswith(sensor)):
        y = np.array(channels[name].values)
        there = np.flatnonzero(np.isfinite(y))
        far = there[rng.random(there.size) < share]
        y[far] += size * rng.standard_normal(far.size)
        channels[name] = replace(channels[name], values=y)
    return replace(log, channels=channels)


def left_out(log: Log, model: FilterModel = MODEL) -> dict[str, tuple[float, float]]:
    """Share and size of what was left out, by sensor."""
    scene = flight_scene(log, model)
    assert scene is not None
    return {p.where: (float(p.effect.share), float(p.effect.sigma)) for p in scene.said}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("sensor", "share", "size"),
    in_part([("gnss_p", 0.05, 10.0), ("gnss_p", 0.02, 30.0), ("baro", 0.05, 10.0), ("mag", 0.02, 1e-5)]),
)
def test_outliers_are_left_out_with_their_share_and_size(sensor: str, share: float, size: float) -> None:
    """Those within the noise are not seen: up to a third of them of a size of ten times the noise."""
    found = left_out(flight(sensor, share, size))
    assert set(found) == {sensor}
    count = share * (300 if sensor != "mag" else 1500) * (1 if sensor == "baro" else 3)
    four_sigmas = 4.0 / np.sqrt(count)
    assert 0.65 - four_sigmas < found[sensor][0] / share < 1.0 + four_sigmas
    assert 1.0 - four_sigmas < found[sensor][1] / size < 1.3 + four_sigmas


@pytest.mark.parametrize("seed", in_part(range(4)))
def test_a_clean_flight_has_none(seed: int) -> None:
    assert left_out(flight(seed=seed)) == {}


def test_a_delay_in_manoeuvres_is_none() -> None:
    """Fixes of 0.25 s ago: errors of many standard deviations, for as long as a manoeuvre lasts."""
    log = flight()
    late = {
        n: replace(c, values=np.roll(c.values, 25)) for n, c in log.channels.items() if n.startswith("gnss")
    }
    assert left_out(replace(log, channels={**log.channels, **late})) == {}


@pytest.mark.long
def test_planted_in_a_real_flight_they_are_found_and_its_delay_is_none(
    recording: Callable[[str], Path],
) -> None:
    """A replay whose receiver is some 0.16 s late in a climb; with outliers its positions are in no other unit."""
    log, model = kf.read_log(recording("flights/ecl_iris_gps_replay.csv")), kf.build("ins15")
    assert left_out(log, model) == {}
    with_them = with_outliers(log, "gnss_p", 0.03, 20.0, 1)
    scene = flight_scene(with_them, model)
    assert scene is not None
    assert scene.faults() == ()
    assert set(left_out(with_them, model)) == {"gnss_p"}


@pytest.mark.long
def test_the_answer_names_them_alone_and_the_filter_knows_them() -> None:
    log = flight("gnss_p", 0.05, 10.0)
    found = kf.find_gap(log, MODEL)
    assert [(f.effect.name, f.where) for f in found.findings] == [("outliers", "gnss_p")]
    improved = filter_of(found.improved)
    assert left_out(log, improved) == {}
    # The gate refuses them: counted in R as well they would be counted twice.
    before, after = (DiscreteModel.at_rate(m, 100.0) for m in (MODEL, improved))
    position = MODEL.sensor("gnss_position")
    assert after.sample_variance(position, "gnss_p_N") == before.sample_variance(position, "gnss_p_N")
    assert kf.find_gap(log, improved).verdict == "no_gap"
