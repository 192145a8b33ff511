"""What the cosine ordinates of a finite record show of noise through a filter, against drawn records."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import butter, lfilter

from kfgen.effects import filtered, make

N, DT, DRAWS = 200, 0.01, 6000


@pytest.mark.parametrize(("order", "corner"), [(1, 5.0), (2, 5.0), (2, 30.0), (2, 42.0)])
def test_the_ends_of_a_record_carry_power_to_where_a_filter_stops(order: int, corner: float) -> None:
    """Mean squares of 6000 draws within 5.5 standard deviations of them, 1e-5 for 800 ordinates; without the ends'
    share they are up to hundreds of times what the filter lets pass."""
    if order == 2:
        b, a = butter(2, 2.0 * corner * DT)
    else:
        phi = np.exp(-2.0 * np.pi * corner * DT)
        b, a = [1.0 - phi], [1.0, -phi]
    x = np.random.default_rng(order).standard_normal((DRAWS, N + 300))
    y = lfilter(b, a, x, axis=1)[:, 300:]
    power = np.mean(dct(y, type=2, norm="ortho", axis=1) ** 2, axis=0)[1:]
    omega = np.pi * np.arange(1, N) / N
    low_pass = make("low_pass", corner=corner, order=order)
    ratio = power / filtered([low_pass], omega, DT, n=N)
    assert np.all(np.abs(ratio - 1.0) < 5.5 * np.sqrt(2.0 / DRAWS))
    plain = power / filtered([low_pass], omega, DT)
    assert plain.max() > (1.05 if order == 1 else 10.0)
