"""Proves that intervals include what the model of the spectrum leaves: on simulated misfit, and on halves of recordings.

Under the model a parameter is widened in at most one record of a hundred by its spectrum and one of fifty by the level
of its noise; of 100 records more than 9 have a probability of 0.2 %. Halves of one recording differ by more than their
joint 95 % band in 5 %: of nine channels more than two have a probability of 0.8 %.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.goodness import level_variance, widening
from kfgen.identify.fit.interval import stretched
from kfgen.identify.identify import Identified, identify

Array = NDArray[np.float64]
Find = Callable[[str], Path]
TERMS = ("white_noise", "rate_random_walk")


def found(y: Array, rate: float = 100.0) -> Identified:
    return identify(Record(np.arange(y.size) / rate, y), TERMS)


def N_of(result: Identified) -> tuple[float, float]:
    """Logarithm of N, and the standard deviation that its interval stands for."""
    lo, hi = result.intervals[0, "N"]
    return float(np.log(result.fit.effects[0].N)), float(np.log(hi / lo)) / 2.0 / 1.96  # type: ignore[attr-defined]


def test_an_interval_that_is_stretched_keeps_its_estimate_and_open_ends() -> None:
    assert stretched((1.0, 4.0), 2.0, 2.0) == pytest.approx((0.5, 8.0))
    assert stretched((0.0, np.inf), 2.0, 3.0) == (0.0, np.inf)
    assert stretched((1.0, 4.0), 2.0, 1.0) == (1.0, 4.0)
    assert stretched((1.0, 4.0), 2.0, 1e5) == (0.0, np.inf)  # of noise that is motion


@pytest.mark.long
def test_noise_of_the_model_is_not_widened() -> None:
    widened = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        y = rng.standard_normal(10_000) + np.cumsum(0.01 * rng.standard_normal(10_000))
        result = found(y)
        widened += any(f > 1.0 for f in widening(result.record, result.fit).values())
    assert widened <= 9


def test_a_spectrum_that_is_not_flat_widens_N() -> None:
    """White noise with a ripple of 5 % over the band, as of an internal filter: an echo of a few samples."""
    y = lfilter([1.0, 0.0, 0.0, 0.0, 0.05], [1.0], np.random.default_rng(1).standard_normal(100_000))
    result = found(np.asarray(y))
    assert widening(result.record, result.fit)[0, "N"] > 2.0
    assert N_of(result)[1] > 2.0 / np.sqrt(2.0 * y.size)
    assert any("the spectrum differs from that of the terms" in w for w in result.warnings)


@pytest.mark.parametrize("course", ["walk", "wave", "ramp"])
def test_a_level_that_drifts_covers_the_other_half(course: str) -> None:
    """Halves of 40,000 samples; the level goes by some per cent. With the interval of steady noise one in ten would hold."""
    n, inside = 40_000, 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = np.arange(2 * n) / (2 * n)
        walk = np.exp(np.repeat(np.cumsum(0.03 * rng.standard_normal(64)), 2 * n // 64))
        level = {"walk": walk, "wave": 1.0 + 0.05 * np.sin(20.0 * x), "ramp": 1.0 + 0.3 * x}[course]
        y = rng.standard_normal(2 * n) * level
        halves = [(float(np.log(np.std(p))), 1.0 / (2 * n) + level_variance(p)) for p in (y[:n], y[n:])]
        (a, v), (b, w) = halves
        inside += abs(a - b) < 1.96 * np.sqrt(v + w)
    assert inside >= 16


def channels(recording: Find) -> dict[str, tuple[float, Array]]:
    mpu = np.load(recording("static/mpu6050_static_450s.npz"))
    both = {"gyro": mpu["gyr_counts"], "accel": mpu["acc_counts"]}
    at_rest = {f"{k} {i}": (100.0, v[300:, i].astype(float)) for k, v in both.items() for i in range(3)}
    warm = np.load(recording("static/gyro_875mdps_warmup.npz"))["gyr_counts"].astype(float)
    tof = np.load(recording("static/tof_vl53l0x_1h.npz"))["dist_mm"].astype(float)
    baro = np.load(recording("static/baro_ms5611_400s.npz"))["alt"].astype(float)
    return at_rest | {"warm": (200.0, warm), "tof": (55.62, tof), "baro": (80.0, baro)}


def test_halves_of_recordings_agree_within_their_bands(recording: Find) -> None:
    outside = []
    for name, (rate, y) in channels(recording).items():
        (a, s), (b, r) = (N_of(found(half, rate)) for half in np.array_split(y, 2))
        if abs(a - b) > 1.96 * np.hypot(s, r):
            outside.append((name, a - b, s, r))
    assert len(outside) <= 2, outside


def test_a_gyro_whose_spectrum_is_not_that_of_its_terms_has_a_wide_band(recording: Find) -> None:
    """Between halves its N differs by 0.7 %, which steady white noise would know to 0.2 % each."""
    _, y = channels(recording)["warm"]
    result = found(y, 200.0)
    assert N_of(result)[1] > 2.0 / np.sqrt(2.0 * y.size)
