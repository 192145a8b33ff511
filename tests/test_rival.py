"""Two wrong models that are equally good are distinguished no more often than by chance; a right one is, from a wrong one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.signal import lfilter

from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.rival import _by_stretch, log_odds
from kfgen.gap.scene.scene import ScenePoint

Array = NDArray[np.float64]
N, DRAWS = 1600, 400
NINETEEN_TO_ONE = np.log(19.0)


@dataclass(frozen=True)
class One:
    """A scene of one channel, of which no more is asked."""

    lengths = (N,)


def of(left: Array, level: float = 1.0) -> SceneFit:
    """A fit that leaves this in time, shape (n,)."""
    none = np.zeros(0)
    residual = dct(left, type=2, norm="ortho")
    return SceneFit(
        ScenePoint((), none), residual, np.array([level]), 0.0, np.zeros((0, 0)), (), none, np.zeros((N, 0))
    )


def value(left: Array) -> float:
    return -0.5 * float(left @ left)


def odds(one: Array, other: Array) -> tuple[float, float]:
    """What the better of two has over the other by likelihood, and by the scatter over the log."""
    best, rival = sorted((one, other), key=value, reverse=True)
    lost = value(best) - value(rival)
    return lost, log_odds(One(), of(best), of(rival), lost)  # type: ignore[arg-type]


def test_equally_wrong_models_are_distinguished_as_often_as_by_chance() -> None:
    """Neither is there, each resembles a part of what is: 19 to 1, for either of the two, should come in a tenth of the
    logs. Of 400 it comes in 24 to 62 with a chance of 99.9 % (and sixteen stretches are few: up to 75)."""
    rng = np.random.default_rng(20)
    t = np.arange(N)
    by_likelihood = by_scatter = 0
    for _ in range(DRAWS):
        unknown = lfilter([1.0], [1.0, -0.8], rng.standard_normal(N))
        one, other = 0.5 * np.sin(0.31 * t), 0.5 * np.sin(0.37 * t + 1.0)
        lost, found = odds(unknown + one, unknown + other)
        assert found <= lost
        by_likelihood += lost > NINETEEN_TO_ONE
        by_scatter += found > NINETEEN_TO_ONE
    assert by_likelihood > 0.8 * DRAWS
    assert 20 < by_scatter < 75


def test_a_right_model_is_distinguished_from_a_wrong_one() -> None:
    rng = np.random.default_rng(21)
    noise = rng.standard_normal(N)
    lost, found = odds(noise, noise + 0.5 * np.sin(0.31 * np.arange(N)))
    assert lost > 50.0
    assert found > 0.3 * lost > NINETEEN_TO_ONE


def test_levels_count_and_short_logs_are_as_their_likelihood_says() -> None:
    """The log-likelihoods of the stretches are that of the log; of ten readings nothing scatters."""
    left = np.random.default_rng(22).standard_normal(N)
    whole = _by_stretch(One(), of(left, 1.5)).sum()  # type: ignore[arg-type]
    assert whole == pytest.approx(value(left) / 1.5**2 - N * np.log(1.5))
    assert log_odds(One(), of(left), of(left), 3.0) == 3.0  # type: ignore[arg-type]
    assert log_odds(One(), of(left), of(left), 0.0) == 0.0  # type: ignore[arg-type]

    @dataclass(frozen=True)
    class Few:
        lengths = (10,)

    assert log_odds(Few(), of(left), of(2.0 * left), 7.0) == 7.0  # type: ignore[arg-type]
