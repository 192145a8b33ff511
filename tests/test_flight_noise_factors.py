"""Proves that a noise that looks larger than assumed is split by what makes it so.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen, whose noises are those that the filter
assumes: with nothing missing no size is above 1.2 for certain, and what an effect explains leaves a size of one. Sizes of
this flight have standard deviations of 8 %; what is asked is four of them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import kfgen as kf
from kfgen.gap.flight_words import noise_factor_sentence

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
trial = pytest.importorskip("trial")
flight = pytest.importorskip("flight")

pytest.importorskip("numba")

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]


@pytest.mark.long
def test_a_late_receiver_is_why_the_accelerometers_seem_noisy() -> None:
    """Who tunes a filter whose receiver is 0.1 s late makes its accelerometers twenty times as noisy."""
    late = flight.Effect("time_delay", "gnss", {"delay": 0.1})
    log = trial.log_of(trial.Case("quadrotor", 77, 60.0), [late])
    gap = kf.find_gap(log, kf.build("ins15", options={"left_out": "false"}, sensors=SENSORS))
    (accel,) = [f for c in gap.comparisons for f in c.noise_factors if f.channel == "accel"]
    assert accel.times > 5.0
    assert [(p.cause, p.where) for p in accel.parts] == [("time_delay", "gnss")]
    assert accel.left == pytest.approx(1.0, abs=0.32)
    assert accel.times == pytest.approx(accel.left * accel.parts[0].factor)
    said = noise_factor_sentence(accel)
    assert "the noise of accel would seem" in said
    assert "time_delay of gnss" in said
    (written,) = [f for f in gap.to_dict()["noise_factors"] if f["channel"] == "accel"]
    assert written["parts"] == [{"cause": "time_delay", "channel": "gnss", "factor": accel.parts[0].factor}]
