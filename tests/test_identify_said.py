"""What is said of a record, in the digits and units of the field: times, lengths of records, channels, open intervals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import kfgen as kf
from kfgen.core import time_budget
from kfgen.core.numbers import few_digits, moment
from kfgen.effects import make
from kfgen.effects.noise_model import noise_text
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit import limits
from kfgen.identify.fit.fit import Problem, maximise
from kfgen.identify.fit.interval import interval95, stretched
from kfgen.identify.identification import Identification
from kfgen.identify.identify_log import identify_samples
from kfgen.identify.screening.motion import motion_in
from kfgen.identify.words import measured_by, no_limit, of_channels, record_length
from kfgen.log.log import Channel, Log
from kfgen.report.identify import identify_answer
from kfgen.run.run import SensorRun
from kfgen.run.words import consistency

pytestmark = pytest.mark.quick
RATE_HZ = 10.0
T = np.arange(600) / RATE_HZ


def log_of(**channels: tuple[np.ndarray, str]) -> Log:
    return Log(T, {k: Channel.of(v, u) for k, (v, u) in channels.items()}, "log.csv")


def test_moments_of_a_clock_that_began_long_ago_differ() -> None:
    assert [moment(t) for t in (0.0, 3.2e-6, 12.345678, 154.114514, 1756402252.75)] == [
        *("0", "3.2e-06", "12.3457", "154.1145", "1756402252.75")
    ]


def test_a_large_number_of_few_digits_has_no_exponent() -> None:
    assert [few_digits(x) for x in (0.0123, 1.26, 12.6, 123.0, 3120.0)] == [
        "0.012",
        "1.3",
        "13",
        "120",
        "3100",
    ]


@pytest.mark.parametrize(
    ("hours", "said"),
    [
        *((0.0055, "20 s"), (0.02, "72 s"), (0.74, "45 min"), (10.2, "10 h"), (930.0, "930 h")),
        *((1001.0, ""), (np.inf, ""), (np.nan, "")),
    ],
)
def test_the_length_of_a_record_is_one_that_can_be_logged(hours: float, said: str) -> None:
    assert record_length(hours) == said
    assert measured_by(hours).startswith(f"a {said} log" if said else "no log of 1000 h")


def test_a_sentence_is_said_once_of_all_channels() -> None:
    said = {**{f"gyro_{a}": ["two gaps", "a line"] for a in "xy"}, "gyro_z": ["two gaps"], "baro": ["a step"]}
    assert of_channels(said) == ["gyro: two gaps", "gyro_x, gyro_y: a line", "baro: a step"]
    assert of_channels({"accel_z": ["two gaps"]}) == ["accel_z: two gaps"]


def test_a_size_that_may_be_zero_is_stretched_from_its_estimate() -> None:
    assert stretched((0.0, 3.0), 1.0, 50.0) == pytest.approx((0.0, 101.0))


def test_an_interval_that_could_not_be_searched_is_open_where_nothing_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A random walk alone: of white noise beside it there is no information, and no time to follow the likelihood."""
    walk = np.cumsum(np.random.default_rng(3).standard_normal(T.size))
    problem = Problem(Record(T, walk), (make("white_noise", N=1e-9), make("rate_random_walk", K=3.0)))
    best = maximise(problem)
    monkeypatch.setattr(time_budget, "FIT_SECONDS", 0.0)
    walks = best.effects[1]
    small = replace(best, effects=(make("white_noise", N=1e-12), walks))
    small = replace(small, point=np.log([1e-12, walks.K]))  # type: ignore[attr-defined]
    with time_budget.time_budget():
        assert interval95(problem, small, (0, "N")) == (0.0, np.inf)
        lo, hi = interval95(problem, small, (1, "K"))
    # A walk of n steps knows the logarithm of K to 1 / sqrt(2 n): 0.029.
    assert np.log(hi / lo) == pytest.approx(2.0 * 1.96 / np.sqrt(2.0 * T.size), rel=0.3)


def not_identifiable(found: Identification) -> list[dict[str, Any]]:
    return list(found.to_dict()["channels"]["gyro_x"]["not_identifiable"])


def test_a_limit_for_which_there_was_no_time_is_said_with_what_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    """White noise, and no time for the limits of what else there may be: no number, in file, text and JSON."""
    white = log_of(gyro_x=(np.random.default_rng(8).standard_normal(T.size), "deg/s"))
    key = "gyro_x rate_random_walk K"
    in_time = kf.identify(white)
    assert in_time.noise.provenance[key].startswith("below ")
    monkeypatch.setattr(time_budget, "SEARCH_SECONDS", 0.0)
    monkeypatch.setattr(time_budget, "FIT_SECONDS", 0.0)
    found = kf.identify(white)
    why = "without an upper limit: the search ended before; give fewer channels or a shorter part of the log"
    assert found.noise.provenance[key] == why
    answer = identify_answer(found)
    assert f"  rate_random_walk K is {why}" in answer.text.splitlines()
    assert "unbounded" not in answer.text + noise_text(found.noise)
    (walk,) = (x for x in not_identifiable(found) if x["effect"] == "rate_random_walk")
    assert (walk["upper95"], walk["open"]) == (None, why)
    assert not any("open" in x for x in not_identifiable(in_time))
    assert found.cautions[-1].endswith("Give fewer channels or a shorter part of the log for a complete one")


def test_a_limit_that_a_record_does_not_set_is_not_laid_to_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A likelihood that stays flat to the end of its box, with time left."""
    record = Record(T, np.random.default_rng(9).standard_normal(T.size))
    monkeypatch.setattr(limits, "upper95", lambda *_: np.inf)
    with time_budget.time_budget():
        none = limits.limit(record, (make("white_noise", N=1.0),), "rate_random_walk")
    assert not none.is_known
    assert no_limit(none.ended_early) == "without an upper limit: this record sets none; a longer one may"


def test_a_barometer_is_not_explained_by_its_own_pressure() -> None:
    """Height of the standard atmosphere: 8.4 m are 101 Pa, and the noise of the one is that of the other."""
    pressure = 101325.0 + 4.0 * np.random.default_rng(1).standard_normal(T.size)
    log = log_of(baro_height=(-0.0832 * (pressure - 101325.0), "m"), pressure=(pressure, "Pa"))
    (found,) = kf.identify(log, channels=["baro_height"]).channels["baro_height"].effects
    assert found.name == "white_noise"
    assert found.values["N"] == pytest.approx(
        0.0832 * 4.0 / np.sqrt(RATE_HZ), rel=5.0 / np.sqrt(2.0 * T.size)
    )


def test_a_page_leads_with_the_motion_and_makes_no_sentence_of_what_is_not_shown() -> None:
    """A walk and no white noise in one channel, and a body that turns: limits instead of numbers, cautions first."""
    walk = 0.05 * np.cumsum(np.random.default_rng(6).standard_normal(T.size))
    found = kf.identify(
        log_of(gyro_x=(walk, "deg/s"), gyro_z=(20.0 * np.sin(0.1 * T) + 0.01 * walk, "deg/s")),
        effects=["white_noise", "rate_random_walk"],
    )
    page = identify_answer(found).page
    assert page.verdict[0].startswith("The sensors moved (gyro_z turns at")
    assert "N below" in page.verdict[1]
    said = [str(p.content) for p in page.parts if p.kind == "sentence"]
    assert [w for w in said if w.startswith("gyro_x carries white noise")] == []
    assert any(w.startswith("gyro_x") for w in said)
    assert page.parts[0].kind == "figure"  # all channels side by side


@pytest.mark.parametrize(
    ("nis", "said"),
    [(3.02, "as of a consistent"), (3.8, "too little noise"), (2.2, "more noise than there is")],
)
def test_a_run_says_whether_its_innovations_are_as_large_as_expected(nis: float, said: str) -> None:
    """Of 150 updates of three rows: a mean of chi-squares with 450 degrees of freedom, 3 +- 1.96 sqrt(6 / 150)."""
    run = SensorRun(
        np.arange(150.0), np.zeros((150, 3)), np.full(150, nis), ("gnss_p_N", "gnss_p_E", "gnss_p_D")
    )
    lo, hi = run.expected_nis95
    assert (lo, hi) == pytest.approx((3.0 - 1.96 * 0.2, 3.0 + 1.96 * 0.2), abs=0.02)
    assert said in consistency("gnss", nis, 150, (lo, hi))


def field(turn_deg: float) -> Log:
    """A magnetometer that turns about the vertical and back, 50 uT with a dip of 60 deg, noise of 0.3 uT."""
    angle = np.radians(turn_deg) * np.sin(np.pi * T / T[-1])
    level = np.column_stack([np.cos(angle), -np.sin(angle), np.full(T.size, np.tan(np.radians(60.0)))])
    B = 25.0 * level + 0.3 * np.random.default_rng(2).standard_normal(level.shape)
    return log_of(**{f"mag_{a}": (B[:, k], "uT") for k, a in enumerate("xyz")})


def test_a_field_that_turns_is_motion_and_a_current_nearby_is_none() -> None:
    """By 90 deg about the vertical a field that dips by 60 deg turns by 2 asin(cos 60 sin 45) = 41 deg at the most."""
    assert motion_in(field(90.0), ["mag_x"]).startswith("the field turns by")
    assert not motion_in(field(10.0), ["mag_x"])
    assert not motion_in(field(90.0), ["temperature"])


def test_a_receiver_that_walks_moves() -> None:
    v = 1.2 * np.sin(2.0 * np.pi * T / 20.0)
    rng = np.random.default_rng(4)
    assert motion_in(log_of(gnss_v_E=(v, "m/s")), ["gnss_v_E"]).startswith("gnss_v_E is -1.")
    assert not motion_in(log_of(gnss_v_E=(0.2 * rng.standard_normal(T.size), "m/s")), ["gnss_v_E"])


@pytest.mark.parametrize("scale", [1.0, 1e200, 1e-200])
def test_motion_is_seen_at_any_scale(scale: float) -> None:
    """Whose squares are no numbers: nothing is said of the size, which other checks look at."""
    log = field(90.0)
    scaled = {
        n.replace("mag", "accel"): Channel.of(scale * 1e6 * c.values, "m/s^2")
        for n, c in log.channels.items()
    }
    assert motion_in(replace(log, channels=scaled), list(scaled)).startswith("gravity turns by")


def test_a_value_that_is_repeated_for_a_while_is_said() -> None:
    """Runs of equal values on a coarse grid are chance; a hundred and more on a fine one are none (one in a million)."""
    rng = np.random.default_rng(176148)
    fine, coarse = (
        np.round(8.0 * rng.standard_normal(20_000)) / 8.0,
        np.round(0.4 * rng.standard_normal(20_000)),
    )
    slept = fine.copy()
    slept[5000:11_000] = slept[5000]
    said = [
        [
            w
            for w in identify_samples(y, rate=50.0, unit="deg/s", effects="white_noise").warnings
            if "repeated" in w
        ]
        for y in (fine, coarse, slept)
    ]
    assert said[:2] == [[], []]
    assert len(said[2]) == 1
    assert "for 120 s from t = 100 s" in said[2][0]
