"""Proves that whitening keeps power, leaves white noise white, and is the likelihood that everything is fitted by."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects import make
from kfgen.gap.core.whitener import DENSITY_GRID_POINTS, Whitener
from kfgen.gap.rest.evidence import assumed, series_of
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import residual_ratio

Array = NDArray[np.float64]

DT = 0.05
SLOW = (make("white_noise", N=0.3), make("gauss_markov", sigma=0.8, tau=2.0), make("quantisation", Q=0.01))


def samples(n: int, seed: int = 1) -> Array:
    return np.cumsum(np.random.default_rng(seed).standard_normal(n)) * 0.1 + 3.0


@pytest.mark.parametrize("n", [7, 64, 3 * DENSITY_GRID_POINTS + 5])
def test_of_white_noise_the_series_is_the_samples_over_their_deviation(n: int) -> None:
    """N^2 / dt is the variance of a sample; the constant has no weight. Parseval follows, and is asked for."""
    y, sd = samples(n), 0.3 / np.sqrt(DT)
    white = Whitener.of([make("white_noise", N=0.3)], n, DT)
    np.testing.assert_allclose(white.series(y), (y - y.mean()) / sd, atol=1e-10)
    X = white.ordinates(y)
    assert pytest.approx(np.sum((y - y.mean()) ** 2) / sd**2, rel=1e-10) == X @ X
    whole = Whitener.of([make("white_noise", N=0.3)], n, DT, constant=True)
    np.testing.assert_allclose(whole.series(y), y / sd, rtol=1e-10)
    np.testing.assert_allclose(Whitener.back(whole.ordinates(y)), y / sd, rtol=1e-10)


def test_columns_are_whitened_alike() -> None:
    Y = np.column_stack([samples(200, seed) for seed in range(3)])
    white = Whitener.of(SLOW, 200, DT)
    np.testing.assert_allclose(
        white.series(Y), np.column_stack([white.series(y) for y in Y.T]), rtol=0, atol=1e-12
    )


def test_coloured_noise_becomes_white() -> None:
    """Simulated here: ordinates of a unit normal, their mean square within 4.5 sqrt(2 / m) in every octave.

    7e-6 of the seeds for each of 11 octaves; leakage of a Gauss-Markov process is far below that.
    """
    n, rng = 1 << 14, np.random.default_rng(5)
    a = np.exp(-DT / 2.0)
    x = np.empty(n)
    x[0] = 0.8 * rng.standard_normal()
    for k, w in enumerate(0.8 * np.sqrt(1 - a * a) * rng.standard_normal(n - 1)):
        x[k + 1] = a * x[k] + w
    y = x + 0.3 / np.sqrt(DT) * rng.standard_normal(n) + np.diff(0.01 * rng.standard_normal(n + 1)) / DT
    X = Whitener.of(SLOW, n, DT).ordinates(y)
    edges = 2 ** np.arange(3, 15)
    for lo, hi in itertools.pairwise(edges):
        assert abs(np.mean(X[lo:hi] ** 2) - 1.0) < 4.5 * np.sqrt(2.0 / (hi - lo)), (lo, hi)


def test_it_is_the_sine_transform_of_the_differences() -> None:
    """Ordinate by ordinate: the lowest stand alone in the likelihood; and the sum over all that are binned."""
    n = 1000
    y = samples(n)
    data = Record(np.arange(n) * DT, y).ordinates(())
    ratio = residual_ratio(data, SLOW, np.zeros(0))
    X = Whitener.of(SLOW, n, DT).ordinates(y)
    np.testing.assert_allclose(ratio[:96], X[1:97] ** 2, rtol=1e-9)
    assert data.count.sum() == n - 1
    assert data.count @ ratio == pytest.approx(X @ X, rel=2e-3)


def test_the_interpolated_density_is_that_of_the_effects() -> None:
    """Between grid points a density of decades of slope is a straight line in logarithms to 1e-4."""
    n = 20_000
    S = sum(e.sampled_density(np.arange(1, n) * np.pi / n, DT) for e in SLOW)
    np.testing.assert_allclose(Whitener.of(SLOW, n, DT).weight[1:] ** -2.0, S, rtol=1e-3)


def test_a_series_tells_its_white_part_from_its_slow_one() -> None:
    """Shares of the density: the low-frequency end is the process, the upper end is white."""
    n = 8192
    record = Record(np.arange(n) * DT, samples(n))
    series = series_of(assumed(record, SLOW[:2], {}))
    fitted = assumed(record, SLOW[:2], {}).fit.effects
    omega = np.arange(1, n) * np.pi / n
    parts = [e.sampled_density(omega, DT) for e in fitted]
    np.testing.assert_allclose(series.slow[1:], parts[1] / (parts[0] + parts[1]), rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(series.in_time(series.X), series.z, atol=1e-12)


def test_a_constant_is_weighed_by_the_lowest_density() -> None:
    """Of slow noise every frequency has another; that of the constant is the lowest one's."""
    weight = Whitener.of(SLOW, 64, DT, constant=True).weight
    assert weight[0] == pytest.approx(weight[1])
    assert weight[2] != pytest.approx(weight[1])
