"""Proves that spectral lines are found before any term is fitted, down to half a hertz over hours.

Lines are made by plain numpy and scipy: sinusoids, and complex first-order processes of a stated half width, of which
the peak density over the floor is ``rms^2 / (2 pi w)`` over ``N^2``. A line is called by chance in one of a thousand
records.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, cheby2, firwin, freqz, lfilter

from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.lines import PeriodicLine, find_lines, with_harmonics
from kfgen.identify.identify import identify, prepared

Array = NDArray[np.float64]
Find = Callable[[str], Path]
RATE = 25.0


def narrow(rng: np.random.Generator, t: Array, frequency: float, half_width: float, rms: float) -> Array:
    """A line that wanders: a sinusoid of random envelope."""
    dt = float(t[1] - t[0])
    a = np.exp(-2.0 * np.pi * half_width * dt)
    w = (rng.standard_normal(t.size) + 1j * rng.standard_normal(t.size)) * rms * np.sqrt(1.0 - a * a)
    return np.asarray((lfilter([1.0], [1.0, -a], w) * np.exp(2j * np.pi * frequency * t)).real)


def hours(seed: int, walk: float = 2e-5) -> Record:
    """Three hours of N = 1e-3 with a walk, a line of 21 times the floor at 0.5637 Hz, its third harmonic, and 10.1 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(3 * 3600 * RATE)) / RATE
    y = 1e-3 * np.sqrt(RATE) * rng.standard_normal(t.size)
    y += np.cumsum(walk / np.sqrt(RATE) * rng.standard_normal(t.size))
    rms = np.sqrt(21.0 * 1e-6 * 2.0 * np.pi * 0.002)
    y += narrow(rng, t, 0.5637, 0.002, rms) + narrow(rng, t, 1.6911, 0.003, 0.7 * rms)
    return Record(t, y + 3e-4 * np.sin(2 * np.pi * 10.1 * t))


@pytest.fixture(scope="module")
def three_hours() -> Record:
    return hours(1)


def test_lines_over_hours_are_found_with_their_overtone(three_hours: Record) -> None:
    lines = with_harmonics(find_lines(three_hours))
    assert [x.frequency for x in lines] == pytest.approx([0.5637, 1.6911, 10.1], abs=0.003)
    assert [x.harmonic for x in lines] == [1, 3, 1]
    assert lines[1].fundamental == lines[0].frequency
    # A sinusoid of the same power: for a random envelope sqrt(2) times the root mean square, known to a tenth here.
    assert lines[0].amplitude == pytest.approx(np.sqrt(2.0 * 21.0 * 1e-6 * 2.0 * np.pi * 0.002), rel=0.2)
    assert lines[2].amplitude == pytest.approx(3e-4, rel=0.15)


def test_a_line_goes_to_no_slow_term(three_hours: Record) -> None:
    """The walk and the white noise are what was put in: each within its interval, and nothing else is there."""
    found = identify(three_hours)
    names = [e.name for e in found.fit.effects]
    assert names == ["white_noise", "rate_random_walk"]
    lo, hi = found.intervals[0, "N"]
    assert lo < 1e-3 < hi
    lo, hi = found.intervals[1, "K"]
    assert lo < 2e-5 < hi
    assert len(found.lines) == 3


@pytest.mark.parametrize("walk", [0.0, 0.03, 1.0])
def test_noise_has_no_lines(walk: float) -> None:
    """Forty records of 30,000 samples: one in a thousand may have a line by chance."""
    t = np.arange(30_000) / RATE
    for seed in range(40):
        rng = np.random.default_rng(seed)
        y = rng.standard_normal(t.size) + np.cumsum(walk * rng.standard_normal(t.size))
        assert find_lines(Record(t, y)) == []


def test_a_hump_of_the_noise_is_no_line() -> None:
    """A Gauss-Markov process over white noise bends the spectrum; nothing about it is narrow."""
    t, rng = np.arange(100_000) / RATE, np.random.default_rng(3)
    slow = lfilter([1.0], [1.0, -np.exp(-1.0 / (RATE * 2.0))], rng.standard_normal(t.size))
    assert find_lines(Record(t, rng.standard_normal(t.size) + slow)) == []


def test_a_tenth_of_a_hertz_in_twenty_minutes() -> None:
    t, rng = np.arange(int(1200 * RATE)) / RATE, np.random.default_rng(4)
    y = rng.standard_normal(t.size) + 0.15 * np.sin(2 * np.pi * 0.1 * t)
    (line,) = find_lines(Record(t, y))
    assert line.frequency == pytest.approx(0.1, abs=1.0 / 1200.0)


def test_frequencies_that_are_no_multiples_are_no_harmonics() -> None:
    def line(f: float) -> PeriodicLine:
        return PeriodicLine(f, 1.0, (f - 0.005, f + 0.005))

    assert [x.harmonic for x in with_harmonics([line(1.0), line(2.5), line(3.37)])] == [1, 1, 1]
    assert [x.harmonic for x in with_harmonics([line(3.0), line(1.0), line(2.001)])] == [1, 2, 3]


def test_the_line_of_a_gyro_that_warms_up(recording: Find) -> None:
    """Manifest: a weak line at 0.050 of the sampling rate; the warm-up is two hundred times larger than it."""
    data = np.load(recording("static/gyro_875mdps_warmup.npz"))
    y = data["gyr_counts"] * float(data["gyr_lsb"])
    lines = find_lines(Record(np.arange(y.size, dtype=float), y))
    assert any(x.frequency == pytest.approx(0.050, abs=0.0005) for x in lines)


@pytest.mark.parametrize("amplitude", [4e-3, 2e-2])
def test_the_skirts_of_a_strong_line_are_no_slow_term(amplitude: float) -> None:
    """A sinusoid of thousands of times the floor reaches beyond any band; N is held to 3.3 standard deviations (1e-3)."""
    t = np.arange(int(3 * 3600 * RATE)) / RATE
    white = 1e-3 * np.sqrt(RATE) * np.random.default_rng(11).standard_normal(t.size)
    found = identify(Record(t, white + amplitude * np.sin(2 * np.pi * 0.5637 * t + 1.0)))
    assert [e.name for e in found.fit.effects] == ["white_noise"]
    assert pytest.approx(1e-3, rel=3.3 / np.sqrt(2.0 * t.size)) == found.fit.effects[0].N  # type: ignore[attr-defined]
    assert found.warnings == ()


FILTERS = {
    "Butterworth": butter(8, 0.04),
    "moving average": (np.ones(16) / 16.0, [1.0]),
    "Chebyshev": cheby2(6, 40.0, 0.4),
    "window": (firwin(65, 0.4), [1.0]),
}


@pytest.mark.parametrize("name", FILTERS)
def test_the_shoulders_of_a_low_pass_are_no_lines(name: str) -> None:
    """Of 372 records behind 31 filters four are falsely alarmed; 24 had been, of these moving averages."""
    rng = np.random.default_rng(176146)
    for n in (20_000, 150_000, 150_000):
        y = lfilter(*FILTERS[name], rng.standard_normal(n + 4000))[4000:] + 1e-4 * rng.standard_normal(n)
        record, _ = prepared(Record(np.arange(n) / 100.0, y))
        assert isinstance(record, Record)
        assert find_lines(record) == []


@pytest.mark.parametrize("seed", range(3))
def test_a_line_above_a_low_pass_is_a_line(seed: int) -> None:
    """A fan at 14.2 Hz of 320 times the floor, in noise that falls from 5 Hz on, had been a gain of the sensor."""
    rng = np.random.default_rng([176145, seed])
    n, t = 5000, np.arange(5000) / 128.0
    b, a = butter(2, 5.0 / 64.0)
    y = lfilter(b, a, rng.standard_normal(n))
    gain = abs(freqz(b, a, worN=[14.2], fs=128.0)[1][0])
    y += gain * np.sqrt(2.0 * 320.0 / n) * np.sin(2.0 * np.pi * 14.2 * t + rng.uniform(0.0, 6.0))
    record, said = prepared(Record(t, y))
    assert any("low-pass" in w for w in said)
    assert isinstance(record, Record)
    assert [line.frequency for line in find_lines(record)] == pytest.approx([14.2], abs=0.03)
