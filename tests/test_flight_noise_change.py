"""Proves that noise of an aiding sensor that changes during a flight is named with time and factor, and a delay is none.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen; noise is added to their columns.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part

import kfgen as kf
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.noise.changed_noise import with_noise_changes
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log
from kfgen.model.build import filter_of
from kfgen.model.discretise import DiscreteModel

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]
MODEL = kf.build("ins15", options={"left_out": "false"}, sensors=SENSORS)
DEVIATIONS = {"gnss_p": 1.5, "gnss_v": 0.1, "baro": 0.3, "mag": 2e-7}
"""Of the noise of the flights [SI]."""


DURATION_S = 60.0
"""Of a flight."""


@lru_cache
def flight(seed: int = 0) -> Log:
    found = trial.log_of(trial.Case("quadrotor", 112_361 + seed, DURATION_S), [])
    assert isinstance(found, Log)
    return found


def louder(log: Log, sensor: str, ratio: float) -> Log:
    """From the middle on the noise of a sensor is so many times as large."""
    rng, channels, t = np.random.default_rng(5), dict(log.channels), np.asarray(log.t)
    late = t > 0.5 * (t[0] + t[-1])
    for name in (n for n in log.channels if n.startswith(sensor)):
        y = np.array(channels[name].values)
        y[late] += DEVIATIONS[sensor] * np.sqrt(ratio**2 - 1.0) * rng.standard_normal(int(late.sum()))
        channels[name] = replace(channels[name], values=y)
    return replace(log, channels=channels)


def later(log: Log, samples: int) -> Log:
    """Fixes so many samples later."""
    late = {
        n: replace(c, values=np.concatenate([np.full(samples, np.nan), np.asarray(c.values)[:-samples]]))
        for n, c in log.channels.items()
        if n.startswith("gnss")
    }
    return replace(log, channels={**log.channels, **late})


def changes(log: Log) -> tuple[Placed, ...]:
    scene = flight_scene(log, MODEL)
    assert scene is not None
    return with_noise_changes(scene.path)[1]


@pytest.mark.parametrize("sensor", in_part(DEVIATIONS))
def test_the_level_changes_where_and_as_much_as_it_did(sensor: str) -> None:
    """Within 3 standard deviations of a ratio of two levels, one test in 370, and ten samples of the middle."""
    found = changes(louder(flight(), sensor, 3.0))
    assert [p.where for p in found] == [sensor]
    effect, log = found[0].effect, flight()
    names = [n for n in log.channels if n.startswith(sensor)]
    count = int(np.isfinite(log.channels[names[0]].values).sum())
    sd = float(np.sqrt(2.0 / (len(names) * count)))
    assert np.log(effect.ratio / 3.0) == pytest.approx(0.0, abs=3.0 * sd)  # type: ignore[attr-defined]
    assert effect.time == pytest.approx(0.5 * DURATION_S, abs=10.0 * DURATION_S / count)  # type: ignore[attr-defined]


@pytest.mark.parametrize("seed", in_part(range(3)))
def test_a_clean_flight_has_none(seed: int) -> None:
    """15 nats beside the choice of a time: one sensor in a million."""
    assert changes(flight(seed)) == ()


@pytest.mark.long
def test_the_answer_names_it_beside_a_delay_and_the_filter_knows_it() -> None:
    log = louder(later(flight(), 16), "gnss_p", 3.0)
    found = kf.find_gap(log, MODEL)
    assert [(f.name, f.where) for f in found.findings] == [("noise_change", "gnss_p"), ("time_delay", "gnss")]
    assert found.verdict == "effects_found"
    ratio = float(found.findings[0].effect.ratio)  # type: ignore[attr-defined]
    before, after = (DiscreteModel.at_rate(m, 100.0) for m in (MODEL, filter_of(found.improved)))
    position = MODEL.sensor("gnss_position")
    grown = after.sample_variance(position, "gnss_p_N") / before.sample_variance(position, "gnss_p_N")
    assert grown == pytest.approx(ratio**2, rel=1e-6)


@pytest.mark.long
def test_a_delay_alone_is_no_change_of_the_noise() -> None:
    found = kf.find_gap(later(flight(), 25), MODEL)
    assert [(f.name, f.where) for f in found.findings] == [("time_delay", "gnss")]
