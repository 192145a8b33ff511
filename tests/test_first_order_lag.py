"""Proves lags and backlash over whole arrays against their definitions, sample by sample.

No statistics: records with seeds that are fixed.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects.driven.first_order_lag import behind, faded
from kfgen.effects.plant.sensor import Backlash

Array = NDArray[np.float64]
BATCH = 3


def times(n: int, *, even: bool) -> Array:
    return np.arange(n) * 0.02 if even else np.cumsum(np.random.default_rng(4).uniform(0.001, 0.1, n))


@pytest.mark.quick
@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("n", [1, 2, 3, 1000])
@pytest.mark.parametrize("tau", [[1e-4, 0.05, 30.0], [0.05]])
def test_what_fades_is_its_recursion(n: int, even: bool, tau: list[float]) -> None:
    rng = np.random.default_rng(n)
    t, driven = times(n, even=even), rng.standard_normal((n, BATCH))
    stay = np.exp(-np.diff(t)[:, None] / np.array(tau))
    x = driven.copy()
    for k in range(1, n):
        x[k] = stay[k - 1] * x[k - 1] + driven[k]
    assert faded(t, stay, driven) == pytest.approx(x, abs=1e-11)


@pytest.mark.quick
@pytest.mark.parametrize("even", [True, False])
def test_behind_a_lag_a_ramp_is_late_by_its_time_constant(even: bool) -> None:
    """Settled on a ramp of slope 2/s, it is ``2 tau`` below it, whatever the steps of time."""
    t, tau = times(400, even=even), np.array([0.03, 0.5])
    ramp = 2.0 * t[:, None]
    assert ramp - behind(t, ramp, tau, ramp[0] - 2.0 * tau) == pytest.approx(np.tile(2.0 * tau, (400, 1)))


@pytest.mark.quick
@pytest.mark.parametrize("n", [1, 2, 1000])
def test_backlash_follows_once_it_is_used_up(n: int) -> None:
    rng = np.random.default_rng(5)
    h, width = np.cumsum(rng.standard_normal((n, 1)), axis=0), np.array([0.0, 0.5, 20.0])
    now, out = np.repeat(h[0], BATCH), np.empty((n, BATCH))
    for k in range(n):
        now = np.clip(now, h[k] - 0.5 * width, h[k] + 0.5 * width)
        out[k] = now
    assert np.array_equal(Backlash(width).shown(np.arange(n), h), out)
