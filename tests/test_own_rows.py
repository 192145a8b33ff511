"""Proves that the rows of a slower sensor are found in a log that holds its values, and no others are taken for such.

A row of the log has the sample that was the newest then: what is wanted is known from how the log was made.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

import kfgen as kf
from kfgen.calibrate.calibrate import calibrate
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.gap.find_gap import find_gap
from kfgen.identify.identify_log import identify
from kfgen.log.log import Channel, Log
from kfgen.log.own_rows import OwnSamples, with_own_samples
from kfgen.run.run import run

Array = NDArray[np.float64]

N, ROW_S = 20_000, 0.01
INERTIAL = tuple(f"{s}_{a}" for s in ("gyro", "accel") for a in "xyz")
T = ROW_S * np.arange(N)


def newest(rate_hz: float, values: Array, late: float = 0.3) -> Array:
    """A row for every hundredth of a second, with the newest of the samples of a slower sensor."""
    return np.asarray(values[np.floor(T * rate_hz + late).astype(int)])


@pytest.mark.parametrize(
    ("rate_hz", "step"),
    [
        *((r, 0.0) for r in (0.7, 3.0, 26.36, 41.7, 50.0, 62.0, 83.0)),
        *((r, 0.7) for r in (0.7, 10.0, 30.1, 41.7)),
    ],
)
def test_new_values_are_found_by_their_clock(rate_hz: float, step: float) -> None:
    """On a coarse grid, too, where a new value often equals the one before it; of the last ones that is not seen."""
    x = np.random.default_rng(int(rate_hz)).standard_normal(N)
    own = OwnSamples.of(T, newest(rate_hz, np.round(x / step) if step else x))
    count = int(np.floor(T[-1] * rate_hz + 0.3)) + 1
    assert abs(int(own.rows.sum()) - count) <= (3 if step else 1)
    assert own.held == N - own.rows.sum()
    assert np.diff(own.t[1:]) == pytest.approx(1.0 / rate_hz, rel=1e-3)
    assert own.t == pytest.approx(T[own.rows], abs=1.1 / rate_hz)


def test_a_slower_sensor_whose_rows_are_empty_between_keeps_its_clock() -> None:
    y = np.full(N, np.nan)
    at = np.unique(np.ceil(np.arange(5000) / 26.36 / ROW_S).astype(int))
    y[at[at < N]] = 1.0
    own = OwnSamples.of(T, y)
    assert own.held == 0
    assert np.diff(own.t) == pytest.approx(1.0 / 26.36, rel=1e-3)


def repeated(share: float) -> Array:
    """Samples that repeat the one before at random."""
    rng = np.random.default_rng(3)
    new = rng.random(N) >= share
    new[0] = True
    return np.asarray(rng.standard_normal(N)[np.maximum.accumulate(np.where(new, np.arange(N), 0))])


WHITE = np.random.default_rng(5).standard_normal(N)
NOT_HELD = {
    "white noise": WHITE,
    "one in ten repeats": repeated(0.1),
    "one in six repeats": repeated(0.17),
    "one in three repeats": repeated(0.33),
    "half repeats": repeated(0.5),
    "most repeat": repeated(0.9),
    "a coarse ADC": np.round(WHITE / 3.0),
    "a random walk on a coarse ADC": np.round(np.cumsum(WHITE) / 5.0),
    "a ramp on a grid": np.round(7.0 * T),
    "a stuck channel": np.where((np.arange(N) >= 9000) & (np.arange(N) < 13000), WHITE[9000], WHITE),
    "a square wave": np.sign(np.sin(20.0 * T + 0.1)),
    "a slow sine on a grid": np.round(20.0 * np.sin(T)),
    "a channel that never changes": np.ones(N),
}


@pytest.mark.parametrize("name", NOT_HELD)
def test_what_no_clock_holds_is_left_as_it_is(name: str) -> None:
    own = OwnSamples.of(T, NOT_HELD[name])
    assert own.rows.all()
    assert own.held == 0
    assert own.said == []
    assert own.t == pytest.approx(T)


def test_a_merged_log_is_identified_and_compared_at_each_sensors_own_rate() -> None:
    """White noise of one unit: its N is one over the root of the sensor's rate [per hertz]; nothing is missing in the model."""
    rng = np.random.default_rng(8)
    held = newest(30.1, rng.standard_normal(N))
    empty = np.where(np.arange(N) % 4 == 0, rng.standard_normal(N), np.nan)
    channels = {"mag_x": Channel.of(held, "T"), "mag_y": Channel.of(empty, "T")}
    log = Log(T, channels)
    found = identify(log)
    for name, rate_hz in (("mag_x", 30.1), ("mag_y", 25.0)):
        (white,) = found.channels[name].effects
        lo, hi = white.ci95["N"]
        assert lo < 1.0 / np.sqrt(rate_hz) < hi
        assert hi / lo < 1.07  # 4 / sqrt(2 n) of it, were all ordinates counted
    assert [w for w in found.warnings if "slower than the log" in w] != []
    gap = find_gap(log, found.noise)
    assert gap.verdict == "no_gap"
    for name in found.channels:  # nothing changed: the updated file knows as much as the file
        assert gap.updated.channels[name].covariance == found.noise.channels[name].covariance is not None


def held(rows: int, values: Array) -> Array:
    """Values of shape (n, ...), each over some rows."""
    return np.asarray(values[np.arange(len(values)) // rows * rows])


def test_a_filter_takes_a_held_value_for_one_measurement() -> None:
    """As one whose cells are empty between; as many as there are rows make the NIS of a barometer meaningless."""
    model = kf.build("ins15", sensors=["barometer"])
    rng, n = np.random.default_rng(12), 2000
    baro = 0.5 * rng.standard_normal(n)
    still = {c: Channel.of(1e-3 * rng.standard_normal(n), model.channel_units[c]) for c in INERTIAL}
    still["accel_z"] = Channel.of(still["accel_z"].values - STANDARD_GRAVITY, "m/s^2")
    heights = (held(4, baro), np.where(np.arange(n) % 4 == 0, baro, np.nan))
    logs = [Log(T[:n], {**still, "baro": Channel.of(values, "m")}) for values in heights]
    one, other = (run(model, log) for log in logs)
    assert one.sensors["barometer"].t.size == other.sensors["barometer"].t.size == n // 4
    assert one.estimate == pytest.approx(other.estimate)
    assert ["holds each value over 4 rows" in w for w in one.cautions] == [True]


@pytest.mark.long
def test_a_flight_whose_receiver_is_held_is_compared_at_its_rate() -> None:
    """Five fixes a second in a log of 50 Hz: before, both channels were said to be stuck for all of the flight."""
    flown = kf.simulate("ins15", duration=30.0, rate=50.0, rates={"gnss": 5.0}, manoeuvre="figure-8", seed=3)
    channels = {n: c for n, c in flown.channels.items() if not n.startswith("ref_")}
    for name in (n for n in channels if n.startswith("gnss")):
        values = channels[name].values
        newest = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(values.size), 0))
        channels[name] = replace(channels[name], values=values[newest])
    gap = kf.find_gap(replace(flown, channels=channels), "ins15")
    assert gap.verdict == "no_gap"
    assert [w.split(":")[0] for w in gap.warnings if "over 10 rows" in w] == [
        "gnss_p_N, gnss_p_E, gnss_p_D",
        "gnss_v_N, gnss_v_E, gnss_v_D",
    ]


def turned() -> Array:
    """A field of 50 uT in the body, turned through all directions, with a hard iron of 3 uT in x and noise of 0.3 uT."""
    rng = np.random.default_rng(13)
    rates = gaussian_filter1d(20.0 * rng.standard_normal((N // 2, 3)), 40, axis=0)
    attitude, field = Rotation.identity(), []
    for w in rates:
        attitude = attitude * Rotation.from_rotvec(w * ROW_S)
        field.append(attitude.inv().apply([30.0, 0.0, 40.0]))
    return np.asarray(np.array(field) + [3.0, 0.0, 0.0] + 0.3 * rng.standard_normal((N // 2, 3)))


@pytest.mark.parametrize("empty", [False, True], ids=["held", "empty between"])
def test_a_slower_magnetometer_is_calibrated_by_its_own_samples(empty: bool) -> None:
    """Of 2500 the hard iron is known to 0.3 sqrt(3 / 2500) = 0.01 uT."""
    field = turned()
    rows = np.arange(len(field)) % 4 == 0
    field = np.where(rows[:, None], field, np.nan) if empty else held(4, field)
    channels = {f"mag_{a}": Channel.of(field[:, k], "uT") for k, a in enumerate("xyz")}
    (mag,) = calibrate(Log(ROW_S * np.arange(len(field)), channels)).sensors
    assert mag.readings == rows.sum()
    x = next(v for e, v in zip(mag.entries, mag.fit.values) if e.parameter == "x" and e.effect == "hard_iron")
    assert 1e6 * x == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize(("rows", "step"), [(2, 0.0), (3, 1e-3), (3, 0.1), (7, 1e-6), (40, 0.0)])
def test_lines_between_values_are_no_samples(rows: int, step: float) -> None:
    """As `numpy.interp` draws them, and a file rounds: the rows of the values, whatever their step."""
    x = np.random.default_rng(rows).standard_normal(N // rows + 2)
    y = np.interp((np.arange(N) + 1) / rows, np.arange(x.size), x)
    own = OwnSamples.of(T, np.round(y / step) * step if step else y)
    assert own.is_drawn
    assert np.array_equal(np.flatnonzero(own.rows), np.arange(rows - 1, N, rows))
    assert own.t == pytest.approx(T[own.rows])
    assert f"{rows:.3g} rows apart" in own.said[0]


NOT_DRAWN = {
    "white noise": WHITE,
    "smooth noise": gaussian_filter1d(WHITE, 20.0),
    "a ramp": T,
    "a triangle": np.abs((T / 0.2) % 2.0 - 1.0),
    "a square wave": np.sign(np.sin(2.0 * np.pi * T / 0.2 + 0.1)),
    "a coarse grid": np.round(gaussian_filter1d(WHITE, 20.0) * 20.0),
    "lines over a number of rows that is not whole": np.interp(np.arange(N) / 2.5, np.arange(N), WHITE),
    "one value": np.ones(N),
}


@pytest.mark.parametrize("name", NOT_DRAWN)
def test_rows_of_other_signals_are_samples(name: str) -> None:
    assert not OwnSamples.of(T, NOT_DRAWN[name]).is_drawn


def test_a_filter_over_drawn_rows_warns() -> None:
    """Of held rows it takes the new values; a comparison takes those between which lines are drawn, too."""
    log = Log(T, {"altitude": Channel.of(np.interp(np.arange(N) / 4, np.arange(N), WHITE), "m")})
    over = with_own_samples(log, [["altitude"]], by_filter=True)
    assert np.array_equal(over.channels["altitude"].values, log.channels["altitude"].values)
    (said,) = over.held
    assert said.startswith("altitude: the log draws straight lines")
    assert "4 rows apart" in said
    beside = with_own_samples(log, [["altitude"]])
    assert np.array_equal(np.isfinite(beside.channels["altitude"].values), np.arange(N) % 4 == 0)
    (said,) = beside.held
    assert said.startswith("altitude: its sensor is slower than the log, which draws straight lines")


def test_a_log_brought_to_a_higher_rate_is_identified_at_its_own() -> None:
    """White noise of 0.1 rad/s at 25 Hz, drawn to 100 Hz: N = 0.02, to 4.5 of 0.7 % in 10,000 samples."""
    x = 0.1 * np.random.default_rng(8).standard_normal(10_001)
    log = Log(
        ROW_S * np.arange(40_000),
        {"gyro_x": Channel.of(np.interp(np.arange(40_000) / 4, np.arange(x.size), x), "rad/s")},
    )
    found = identify(log)
    (white,) = found.noise.channels["gyro_x"].effects
    assert white.name == "white_noise"
    assert pytest.approx(0.02, rel=0.032) == white.N  # type: ignore[attr-defined]
    assert find_gap(log, found.noise).verdict == "no_gap"
