"""Proves what the captions of a gap's pictures say of the band that residuals should keep to."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import norm

from kfgen.run.band import BAND_SIGMAS, CHANCE_OUTSIDE_PERCENT, outside_words


def test_the_share_by_chance_is_that_of_the_normal_distribution() -> None:
    assert pytest.approx(100.0 * 2.0 * norm.sf(BAND_SIGMAS), abs=0.05) == CHANCE_OUTSIDE_PERCENT


def test_white_residuals_leave_their_band_by_chance_alone() -> None:
    """4.55 % of 20 000: the share's standard deviation is 0.15 %; a part of 500 has a quarter outside never."""
    said = outside_words(
        "Assumed", np.random.default_rng(112_341).standard_normal(20_000), np.linspace(0.0, 200.0, 20_000)
    )
    assert float(re.findall(r"Assumed: ([0-9.]+) %", said)[0]) == pytest.approx(4.55, abs=0.6)
    assert "mostly" not in said


def test_the_time_in_which_residuals_leave_their_band_is_said() -> None:
    x = np.random.default_rng(112_342).standard_normal(20_000)
    x[5000:7000] *= 4.0
    assert outside_words("Updated", x, np.linspace(100.0, 300.0, x.size)).endswith(
        "mostly from 150 to 170 s."
    )


def test_few_residuals_are_counted_too() -> None:
    assert "100.0 % outside" in outside_words("Assumed", np.full(7, 3.0), np.linspace(0.0, 1.0, 7))
