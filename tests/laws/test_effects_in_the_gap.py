"""The law, in the gap: an effect of motion is named where the model lacks it, and is no gap where the model has it.

Simulated logs of library models, whose truth is continuous; every channel of the sensor competes. Seeds are fixed; a
wrong answer by chance has a rate of 0.1 % (the family-wise rate of the tests) beside that of the names themselves.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from in_part import in_part
from strong_effects import INERTIAL, Strong

import kfgen as kf
from kfgen.effects import make
from kfgen.gap.find_gap import find_gap
from kfgen.gap.result import GapResult
from kfgen.log.log import Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import LIBRARY, build
from kfgen.run.run import run
from kfgen.simulate.simulate import simulate

RATE_HZ = 50.0
DURATION_S = 30.0
SHAKEN = "vibration_rectification"
VIBRATION_M_S2 = 3.0
TESTED = [
    (s, w)
    for s in INERTIAL
    for w in s.where
    if (s.name, w) != ("bandwidth", "mag")  # at 50 Hz a delay does the same
]
NAMED = [(s, w) for s, w in TESTED if s.name != "earth_rate" and w != "imu"]
"""The Earth's own rate, beyond which nothing is its rotation, is below what these gyros show in such a log; beside a
reference each sensor has an answer of its own."""
DISTINCT = {
    ("time_delay", "mag"): make("time_delay", delay=0.06),
    ("bandwidth", "accel"): make("bandwidth", corner=2.0),
}
"""Of a size at which nothing else does the same: late by 0.02 s a magnetometer is one with a corner of 8 Hz."""
NEEDS_POSITION = {(SHAKEN, "accel_x"), ("lever_arm", "gnss"), ("time_delay", "gnss"), ("clock_drift", "gnss")}
NAMED_QUICKLY = {
    ("clock_drift", "gnss"),
    ("scale_factor", "gyro_x"),
    ("scale_temperature", "gyro_x"),
    ("g_sensitivity", "gyro_x"),
    (SHAKEN, "gyro_x"),
    ("time_delay", "accel"),
    ("bandwidth", "gyro"),
    ("hard_iron", "mag"),
    ("declination", "mag"),
    ("static_pressure_error", "baro"),
}
MOVING = [n for n in LIBRARY if n not in ("gyro-static", "imu-static", "hemerly-ekf")]


@lru_cache
def bare(name: str = "ahrs6") -> FilterModel:
    return build(name)


def model_for(strong: Strong, where: str) -> FilterModel:
    """A model that has the place, and moves as the effect needs."""
    if where == "baro":
        return with_barometer()
    return bare("ins15" if (strong.name, where) in NEEDS_POSITION else "ahrs6")


@lru_cache
def with_barometer() -> FilterModel:
    return kf.build("ins15", sensors=["gnss_position", "gnss_velocity", "barometer"])


def log_with(model: FilterModel, strong: Strong | None = None, seed: int = 3) -> Log:
    shaken = VIBRATION_M_S2 if strong is not None and strong.name == SHAKEN else 0.0
    return simulate(
        DiscreteModel.at_rate(model, RATE_HZ),
        "generic",
        DURATION_S,
        np.random.default_rng(seed),
        decoys=["temperature"],
        vibration=shaken,
    )


def gap_of(log: Log, model: FilterModel, where: str) -> GapResult:
    sensor = where.partition("_")[0]
    return find_gap(log, model, channels=[c for c in model.channel_units if c.startswith(sensor)])


def label(value: object) -> str:
    return value.name if isinstance(value, Strong) else str(value)


@pytest.mark.parametrize(
    ("strong", "where"),
    [pytest.param(*p, marks=[] if (p[0].name, p[1]) in NAMED_QUICKLY else pytest.mark.long) for p in NAMED],
    ids=label,
)
def test_an_effect_that_the_model_lacks_is_named(strong: Strong, where: str) -> None:
    model = model_for(strong, where)
    effect = DISTINCT.get((strong.name, where), strong.effect)
    found = gap_of(log_with(model.augment(where, effect), strong), model, where)
    meant = {(strong.name, where), *((strong.name, f"{where}_{a}") for a in "xyz")}
    assert meant & {(f.name, f.where) for f in found.findings}


@pytest.mark.long
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_of_two_effects_that_do_nearly_the_same_none_is_certain(seed: int) -> None:
    """In slow motion a pole of 5 Hz is a delay of 32 ms, and what both models leave out decides between them."""
    strong = Strong(make("bandwidth", corner=5.0), ("accel",))
    model = bare()
    found = gap_of(log_with(model.augment("accel", strong.effect), strong, seed), model, "accel")
    (named,) = found.findings
    alternatives = {(name, where): p for name, where, p in named.alternatives}
    either = {("bandwidth", "accel"), ("time_delay", "accel")}
    assert (named.name, named.where) in either
    (rival,) = either - {(named.name, named.where)}
    assert named.probability < 0.9
    assert alternatives[rival] > 0.1


@pytest.mark.parametrize(
    ("strong", "where"),
    in_part(
        [pytest.param(*p, marks=[] if p[0].name == "scale_factor" else pytest.mark.long) for p in TESTED]
    ),
    ids=label,
)
def test_an_effect_that_the_model_has_is_no_gap(strong: Strong, where: str) -> None:
    model = model_for(strong, where)
    changed = model.augment(where, strong.effect)
    assert gap_of(log_with(changed, strong), changed, where).verdict == "no_gap"


@pytest.mark.parametrize(
    "name",
    in_part([n if n in ("ahrs25", "ins15") else pytest.param(n, marks=pytest.mark.long) for n in MOVING]),
)
def test_a_log_of_a_model_itself_shows_no_gap(name: str) -> None:
    """Point 4: ten effects were named in a log of ins15, and ahrs25 ended in a KeyError."""
    model = bare(name)
    found = find_gap(log_with(model, seed=5), model)
    assert found.verdict == "no_gap"
    assert not found.findings


@pytest.mark.parametrize(("strong", "where"), in_part(TESTED, 3), ids=label)
def test_the_filter_that_has_an_effect_is_consistent_on_a_log_of_it(strong: Strong, where: str) -> None:
    """Mean NIS over 150 updates or more: 2.34 to 3.66 of 3 components holds 99.9 %, of one 0.62 to 1.38; a start has room above."""
    name = "ins15" if where == "baro" or (strong.name, where) in NEEDS_POSITION else "ahrs6"
    model = with_barometer() if where == "baro" else bare(name)
    if name == "ahrs6":
        model = build(name, None, {"left_out": "false"})
    shaken = strong.name == SHAKEN and name == "ahrs6"  # vibration is not in an attitude filter at all
    if not model.channels_of(where) or shaken:
        return
    changed = model.augment(where, strong.effect)
    if changed.omitted:
        return
    nis = run(changed, log_with(changed, strong)).to_dict()["sensors"]
    for sensor, values in nis.items():
        lo, hi = (2.3, 4.2) if len(model.sensor(sensor).channels) == 3 else (0.62, 1.6)
        assert lo < values["mean_nis"] < hi, (name, sensor)
