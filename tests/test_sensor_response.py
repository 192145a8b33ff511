"""A sensor whose own low-pass lies below half the rate: identify describes it, gap takes it from the file.

Records are white noise through filters of scipy, rounded to a tenth of its standard deviation as a converter does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.signal import butter, firwin, freqz, lfilter
from scipy.stats import chi2

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, parse_noise
from kfgen.effects.process.sensor_response import GAINS, SensorResponse
from kfgen.effects.samples.event import BiasStep
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.channel_gap import tests_of as battery_of
from kfgen.gap.rest.evidence import assumed, series_of
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.fit import Prior
from kfgen.identify.identify import Identified, identify
from kfgen.identify.screening.record_faults import roll_off

Array = NDArray[np.float64]

RATE = 100.0
N = 0.1
"""Density of the noise that is passed [rad/s/sqrt(Hz)]."""
STEP = 0.1 * N * RATE**0.5
"""Of the converter [rad/s]."""
FILTERS = {
    "first order": butter(1, 10.0, fs=RATE),
    "fourth order": butter(4, 20.0, fs=RATE),
    "finite impulse response": (firwin(31, 25.0, fs=RATE), [1.0]),
    "mean of five": (np.ones(5) / 5.0, [1.0]),
}


def passed(name: str, seed: int, n: int = 12_000) -> Array:
    """A record of the sensor."""
    white = N * RATE**0.5 * np.random.default_rng([seed, 1763]).standard_normal(n + 1000)
    return np.asarray(np.round(lfilter(*FILTERS[name], white)[1000:] / STEP) * STEP)


def true_power(name: str, f: Array) -> Array:
    """Of the samples over that of the noise that is passed; a converter adds a twelfth of the square of its step."""
    return np.asarray(np.abs(freqz(*FILTERS[name], worN=f, fs=RATE)[1]) ** 2 + STEP**2 / 12.0 / (N**2 * RATE))


def identified(y: Array) -> Identified:
    return identify(Record(np.arange(y.size) / RATE, y))


def log_of(y: Array, path: Path) -> str:
    """The record as a file."""
    t = np.arange(y.size) / RATE
    np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="t [s],gyro_x [rad/s]", comments="")
    return str(path)


@pytest.mark.parametrize("name", in_part(FILTERS))
def test_the_gain_is_that_of_the_filter(name: str) -> None:
    """In bands of 2.5 Hz: 300 ordinates of 12,000 samples are known to 8 %, and the line to less; four of those.

    The last gain ends a line that knows no lobe: behind the zero of a mean it ends a third too high.
    """
    found = identified(passed(name, 1))
    assert found.response is not None
    white = found.fit.effects[0]
    f = np.linspace(found.response.knots[0], 0.5 * RATE - 0.1, 2000)
    described = found.response.response(2.0 * np.pi * f / RATE, 1.0 / RATE) * (float(white.N) / N) ** 2
    band = (f // 2.5).astype(int)
    power, true = (np.bincount(band, x)[band.min() :] for x in (described, true_power(name, f)))
    np.testing.assert_allclose(power / true, 1.0, atol=0.32)
    assert abs(np.log(power.sum() / true.sum())) < 0.1
    assert found.response.gains[-1] == pytest.approx(np.sqrt(true_power(name, np.array([49.9]))[0]), rel=0.35)


@pytest.mark.parametrize(("order", "corner_hz"), in_part([(1, 3.0), (1, 10.0), (2, 3.0), (2, 10.0)]))
def test_a_slow_low_pass_takes_nothing_from_the_density(order: int, corner_hz: float) -> None:
    """A slow one has fallen over most of the band; 4.5 standard deviations, of the fit's own intervals, and 1 % by its law."""
    white = np.random.default_rng(1).standard_normal(203_000)
    found = identified(np.round(lfilter(*butter(order, corner_hz, fs=RATE), white)[3000:] / 0.05) * 0.05)
    assert [e.name for e in found.fit.effects] == ["white_noise"]
    lo, hi = np.log(found.intervals[0, "N"])
    assert abs(np.log(float(found.fit.effects[0].N) / N)) < 0.01 + 4.5 * (hi - lo) / 3.92


@pytest.mark.parametrize(("order", "corner_hz"), in_part([(1, 3.0), (2, 10.0)]))
def test_nor_in_a_long_record(order: int, corner_hz: float) -> None:
    """Of 2.5 million samples, whose block means have power folded into them."""
    white = np.random.default_rng(1).standard_normal(2_503_000)
    found = identified(np.round(lfilter(*butter(order, corner_hz, fs=RATE), white)[3000:] / 0.05) * 0.05)
    assert [e.name for e in found.fit.effects] == ["white_noise"]
    assert float(found.fit.effects[0].N) == pytest.approx(N, rel=0.02)


def test_a_short_record_shows_the_low_pass_of_its_sensor() -> None:
    """Of 500 samples: of 40 records through a filter of eighth order all; of 400 of white noise ten at most.

    A false alarm is one in a hundred records, so that more than ten of 400 are one in 350.
    """
    rng = np.random.default_rng(9)

    def is_seen(y: Array) -> bool:
        return roll_off(Record(np.arange(y.size) / RATE, y)) is not None

    low_pass = butter(8, 30.0, fs=RATE)
    assert all(is_seen(lfilter(*low_pass, rng.standard_normal(700))[200:]) for _ in range(40))
    assert sum(is_seen(rng.standard_normal(500)) for _ in range(400)) <= 10
    assert identified(lfilter(*low_pass, rng.standard_normal(700))[200:]).response is not None


def test_white_noise_has_no_response() -> None:
    white = np.random.default_rng(3).standard_normal(12_000)
    assert identified(white).response is None


@pytest.mark.parametrize("name", in_part(FILTERS))
@pytest.mark.parametrize("seed", in_part([2, 3]))
def test_another_record_of_the_sensor_has_no_gap(name: str, seed: int, tmp_path: Path) -> None:
    """Without the response each is a low-pass that is missing. A gap that is none is found in 0.5 % of records."""
    kf.identify(log_of(passed(name, seed), tmp_path / "a.csv")).save(tmp_path / "n.toml")
    found = kf.find_gap(log_of(passed(name, seed + 100), tmp_path / "b.csv"), str(tmp_path / "n.toml"))
    assert found.verdict == "no_gap"


@pytest.mark.parametrize(
    ("hidden", "what"),
    in_part(
        [
            (lambda t, _: 0.15 * np.sin(2.0 * np.pi * 31.3 * t), "sinusoid"),
            (lambda t, _: 0.5 * (t > 70.0), "bias_step"),
            (lambda t, _: 1.7 * passed("fourth order", 7) * (t > 50.0), "noise_change"),
        ]
    ),
)
def test_an_effect_beside_the_response_is_named(
    hidden: Callable[[Array, Array], Array], what: str, tmp_path: Path
) -> None:
    """A line above the corner, a step, and noise that doubles."""
    kf.identify(log_of(passed("fourth order", 5), tmp_path / "a.csv")).save(tmp_path / "n.toml")
    y = passed("fourth order", 6)
    log = log_of(y + hidden(np.arange(y.size) / RATE, y), tmp_path / "b.csv")
    found = kf.find_gap(log, str(tmp_path / "n.toml"))
    assert [f.name for f in found.findings] == [what]
    assert found.findings[0].probability > 0.9


def test_several_logs_have_one_response() -> None:
    parts = [passed("first order", s, 6000) for s in (8, 9)]
    records = tuple(Record(np.arange(y.size) / RATE, y) for y in parts)
    found = identify(JointRecord(records)).response
    assert found is not None
    assert found.gains[-1] == pytest.approx(np.sqrt(true_power("first order", np.array([49.9]))[0]), rel=0.2)


def test_the_ends_of_a_record_are_not_white_behind_a_filter() -> None:
    """Of 400 records of the true filter: one at the end has more variance, those after the ends have 1 to 4.5 / sqrt(200).

    Where the filter stops unit deviates are drawn.
    """
    name, dt = "finite impulse response", 1.0 / RATE
    f = np.linspace(15.0, 50.0, GAINS + 1)
    response = SensorResponse.through(f[0], f[1:].tolist(), np.sqrt(true_power(name, f[1:])).tolist())
    effects = [make("white_noise", N=N), response]
    whitener = Whitener.of(effects, 2000, dt)
    ends = whitener.ends(effects, dt)
    rng = np.random.default_rng(12)
    drawn = [
        response.apply_to(N * RATE**0.5 * rng.standard_normal(6000), np.arange(6000) * dt, rng)
        for _ in range(400)
    ]
    power = np.mean([whitener.series(y[2000:4000]) ** 2 for y in drawn], axis=0)
    power += np.mean(whitener.weight[1:] <= 0.0)
    assert 0 < ends < 100
    assert power[:ends].max() > 1.32
    np.testing.assert_allclose(power[ends : ends + 50], 1.0, atol=0.4)
    assert whitener.ends(effects[:1], dt) == 0


@pytest.mark.parametrize(("order", "corner_hz"), in_part([(4, 5.0), (6, 5.0), (8, 8.0)]))
@pytest.mark.parametrize("seed", in_part([0, 1, 3]))
def test_a_filter_that_stops_more_than_the_ends_leak(
    order: int, corner_hz: float, seed: int, tmp_path: Path
) -> None:
    """Samples that are hardly rounded; before, some of these ended in an error of linear algebra, the others had
    certain names, up to seven. The sensor keeps its terms, so that the names are false alarms, one in 200."""
    white = np.random.default_rng([seed, order]).standard_normal(7000)
    y = np.round(lfilter(*butter(order, corner_hz, fs=RATE), white)[1000:] / 1e-4) * 1e-4
    kf.identify(log_of(y[:3000], tmp_path / "a.csv")).save(tmp_path / "n.toml")
    found = kf.find_gap(log_of(y[3000:], tmp_path / "b.csv"), str(tmp_path / "n.toml"))
    assert found.verdict == "no_gap", [f.name for f in found.findings]


@pytest.mark.parametrize("seed", in_part(range(8)))
def test_one_knock_is_neither_outliers_nor_intermittent(seed: int, tmp_path: Path) -> None:
    """Too small to be left out, it rings down within 40 samples of 8,000; before, six of these eight were intermittent."""
    rng, m = np.random.default_rng([seed, 5]), np.arange(40)
    y = N * RATE**0.5 * rng.standard_normal(8000)
    y[3000 + 137 * seed + m] += 6.0 * N * RATE**0.5 * np.exp(-m / 8.0) * np.cos(2.0 * np.pi * 0.23 * m + seed)
    found = kf.find_gap(log_of(y, tmp_path / "a.csv"), white_noise())
    assert not {f.name for f in found.findings} & {"outliers", "intermittent_noise"}


def test_measured_gains_are_as_uncertain_as_their_record() -> None:
    """The widest band of a record that is as long as that of the gains: a mean of twice the variance, half the ordinates.

    Its power is about 9 % too high. The p value is that of a chi-square law by scipy, times 74 tests at most; the count
    of its ordinates is known to one in a hundred.
    """
    record = Record(np.arange(12_000) / RATE, passed("first order", 5))
    f = np.linspace(1.0, 50.0, GAINS + 1)
    gains = np.sqrt(true_power("first order", f[1:]) / 1.09).tolist()
    p = []
    for measured_over, share in ((0.0, 1.0), (record.duration, 0.5)):
        response = SensorResponse.through(f[0], f[1:].tolist(), gains, measured_over)
        trusted = {(0, "N"): Prior(np.log(N), 1e-6)}
        tests = battery_of("gyro_x", assumed(record, [make("white_noise", N=N), response], trusted))
        (band,) = [t for t in tests if t.name == "power" and t.band_hz[1] > 40.0]
        m = share * 2.0 * (band.band_hz[1] - band.band_hz[0]) * record.duration
        alone = 2.0 * chi2.sf(band.ratio * m, m)
        assert 0.5 * alone < band.p < 148.0 * alone
        p.append(band.p)
    assert p[0] < 0.005 < p[1]
    described = identify(record).response
    assert described is not None
    assert described.measured_over == pytest.approx(record.duration)


def white_noise() -> NoiseModel:
    """Assumed of the sensor."""
    return NoiseModel({"gyro_x": ChannelNoise("rad/s", (Term(make("white_noise", N=N)),))})


@pytest.mark.parametrize("order", in_part([1, 2]))
def test_noise_behind_a_low_pass_of_the_file_is_no_gap(order: int, tmp_path: Path) -> None:
    """One of second order stops much of the band: before, steps, lines and changes of the noise were fitted to what
    it leaves there, for certain. False alarms are one in 200; the seeds are fixed."""
    low = make("low_pass", corner=3.0, order=order)
    noise = NoiseModel({"gyro_x": ChannelNoise("rad/s", (Term(make("white_noise", N=N)), Term(low)))})
    for seed in range(4):
        rng = np.random.default_rng([seed, order])
        white = N * RATE**0.5 * rng.standard_normal(12_000)
        y = low.apply_to(white, np.arange(white.size) / RATE, rng)[2000:]
        found = kf.find_gap(log_of(y, tmp_path / "a.csv"), noise)
        assert found.verdict == "no_gap", [f.name for f in found.findings]


def test_a_response_is_simulated_as_it_is_described() -> None:
    """Power in tenths of the band: 1000 ordinates are known to 4.5 %, four of those."""
    response = SensorResponse.through(10.0, np.linspace(12.0, 50.0, GAINS), np.geomspace(0.95, 0.1, GAINS))
    t, rng = np.arange(20_000) / RATE, np.random.default_rng(11)
    y = response.apply_to(rng.standard_normal(t.size), t, rng)
    power = np.abs(np.fft.rfft(y))[1:] ** 2 / t.size
    omega = np.arange(1, power.size + 1) * 2.0 * np.pi / t.size
    ratio = (power / response.response(omega, 1.0 / RATE)).reshape(10, -1).mean(axis=1)
    np.testing.assert_allclose(ratio, 1.0, atol=0.18)


@pytest.mark.parametrize(
    ("change", "said"),
    [(("gain_3", "0"), "gain is not positive"), (("frequency_3", "60 Hz"), "frequencies do not rise")],
)
def test_a_response_that_is_none_is_refused(change: tuple[str, str], said: str) -> None:
    numbers = {f"frequency_{k}": f"{10 + k} Hz" for k in range(1, GAINS + 1)}
    numbers |= {f"gain_{k}": "0.5" for k in range(1, GAINS + 1)} | dict([change])
    entry = ", ".join(f'{k} = "{v}"' for k, v in numbers.items())
    text = f'format = "kfgen-noise-1"\n[gyro_x]\nunit = "rad/s"\neffects = [{{ effect = "sensor_response", start = "10 Hz", {entry} }}]\n'
    with pytest.raises(InputError, match=said):
        parse_noise(text, "noise.toml")


@pytest.mark.parametrize(("samples_left", "time_s"), [(10, None), (40, 119.6)])
def test_no_step_stands_where_a_record_ends_behind_a_filter(samples_left: int, time_s: float | None) -> None:
    """Behind a mean of five the last 14 samples are not white again; a step of 1.5 rad/s before them is found."""
    f = np.linspace(15.0, 50.0, GAINS + 1)
    response = SensorResponse.through(
        f[0], f[1:].tolist(), np.sqrt(true_power("mean of five", f[1:])).tolist()
    )
    record = Record(np.arange(12_000) / RATE, passed("mean of five", 4))
    series = series_of(assumed(record, [make("white_noise", N=N), response], {}))
    assert series.ends > 10
    y = series.y + 1.5 * (np.arange(record.n) >= record.n - samples_left)
    (found,) = BiasStep.detect(replace(series, y=y))
    assert isinstance(found.effect, BiasStep)
    assert found.effect.time < series.t[record.n - series.ends]
    if time_s is not None:
        assert found.effect.time == pytest.approx(time_s)
