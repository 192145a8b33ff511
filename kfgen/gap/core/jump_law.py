"""Whether what is taken for a Gauss-Markov bias jumps: to any level, or by kicks of one sign that fade.

All have one spectrum. The likelihood of jumps is that of a hidden Markov chain on a grid of levels, that of the bias a Kalman
filter's, each averaged over the same sizes and times about those of the fit. How often the odds are large by chance is
measured where they are asked for, in `kfgen.gap.rest.course`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.process.stochastic import GaussMarkov
from kfgen.effects.process.telegraph import Cells
from kfgen.effects.series import WhiteSeries, log_mean

Array = NDArray[np.float64]

ANY_LEVEL = "it jumps to any level and stays there"
FADING_KICKS = "it is kicked to one side and fades (doors)"
MAX_CELLS, CELLS_IN_A_TIME = 2400, 8.0
"""Means of samples in which a record is looked at, and in the time of the bias, of which there are at least a quarter."""
LEVELS = 160
"""Of the grid."""
REACH_SIGMAS = 5.0
"""Standard deviations of the bias, to either side, that the grid covers about the range of what is slow."""
FACTORS = (0.7, 1.0, 1.4)
"""Of sizes and times of the fit."""
KICKS_IN_A_TIME = (0.15, 0.5)
"""On average."""
KICK_LOG_SD = 0.5
"""Standard deviation of the logarithm of a kick's size."""


@dataclass(frozen=True)
class BiasNumbers:
    """A size and a time about those of a fit.

    Parameters
    ----------
    sigma : float
        Standard deviation [SI].
    cells : float
        Of its time.
    """

    sigma: float
    cells: float


def jumps_log_odds(series: WhiteSeries, bias: GaussMarkov) -> tuple[str, float]:
    """Whether a Gauss-Markov bias has one of the other laws: the likelier, and how likely they are together.

    Parameters
    ----------
    series : WhiteSeries
        The record without the bias in its model.
    bias : GaussMarkov
        Fitted.

    Returns
    -------
    (str, float)
        Its words, and the logarithm of the odds of both, each as likely as the other, over the bias, which is as likely
        before as they are together [nats]; minus infinity beside other slow noise, or where the record has few cells.
    """
    duration = series.n * series.dt
    cells = Cells.of(series, int(min(MAX_CELLS, max(CELLS_IN_A_TIME * duration / float(bias.tau), LEVELS))))
    of_a_time = float(bias.tau) / cells.switching.dt
    if cells.switching.slow.order or not cells.even or of_a_time < 0.25 * CELLS_IN_A_TIME:
        return "", -np.inf
    y, R, sigma = cells.switching.mean, cells.switching.sd**2, float(bias.sigma)
    own = log_mean(
        np.array(
            [_log_noise(y, R, BiasNumbers(a * sigma, b * of_a_time)) for a, b in product(FACTORS, FACTORS)]
        )
    )
    x = np.linspace(-1.0, 1.0, LEVELS) * REACH_SIGMAS * sigma
    some = [BiasNumbers(a * sigma, b * of_a_time) for a, b in product(FACTORS, FACTORS)]
    levels = _log_chain(y, R, x, [_any_level(x, b) for b in some])
    kicks = [
        _log_chain(sign * y, R, x, [_fading(x, b, k) for b in some for k in KICKS_IN_A_TIME])
        for sign in (1.0, -1.0)
    ]
    laws = {ANY_LEVEL: log_mean(levels) - own, FADING_KICKS: log_mean(np.concatenate(kicks)) - own}
    return max(laws, key=lambda w: laws[w]), log_mean(np.array([*laws.values()]))


def _log_noise(y: Array, R: float, bias: BiasNumbers) -> float:
    """Log-likelihood of cells under the bias and white noise of variance R."""
    phi, P = float(np.exp(-1.0 / bias.cells)), bias.sigma**2
    q, x, total = P * (1.0 - phi**2), 0.0, 0.0
    for v in y.tolist():
        S, left = P + R, v - x
        total -= 0.5 * (left**2 / S + float(np.log(2.0 * np.pi * S)))
        x, P = phi * (x + P / S * left), phi**2 * P * R / S + q
    return total


def _log_chain(y: Array, R: float, x: Array, moved: list[Array]) -> Array:
    """The same of chains on the levels x, from where each is in the long run; shape (chains,)."""
    log_e = -0.5 * (y[:, None] - x) ** 2 / R - 0.5 * np.log(2.0 * np.pi * R)
    top = log_e.max(axis=1)
    seen = np.exp(log_e - top[:, None])
    T = np.array(moved)
    p = np.full((len(moved), 1, x.size), 1.0 / x.size)
    settled = np.linalg.matrix_power(T, 4096)
    p, total = p @ settled, np.full(len(moved), float(top.sum()))
    for k, e in enumerate(seen):
        p = (p @ T if k else p) * e
        whole = np.maximum(p.sum(axis=2), 1e-300)
        total += np.log(whole[:, 0])
        p = p / whole[:, :, None]
    return np.asarray(total)


def _any_level(x: Array, bias: BiasNumbers) -> Array:
    """Where a level is in the next cell, shape (levels, levels), each row a law."""
    anywhere = _rows(np.broadcast_to(np.exp(-0.5 * (x / bias.sigma) ** 2), (x.size, x.size)))
    chance = -float(np.expm1(-1.0 / bias.cells))
    return np.asarray((1.0 - chance) * np.eye(x.size) + chance * anywhere)


def _fading(x: Array, bias: BiasNumbers, kicks: float) -> Array:
    """The same of kicks upwards about their mean; what lies between two levels of the grid is shared by them."""
    one = np.exp(0.5 * KICK_LOG_SD**2)
    size = bias.sigma / np.sqrt(0.5 * kicks) / one**2  # the variance is half that of the kicks in a time
    mean = kicks * size * one
    at = (x + mean) * np.exp(-1.0 / bias.cells) - mean
    place = np.clip((at - x[0]) / (x[1] - x[0]), 0.0, x.size - 1.001)
    low = place.astype(np.intp)
    fades = np.zeros((x.size, x.size))
    fades[np.arange(x.size), low], fades[np.arange(x.size), low + 1] = 1.0 - place + low, place - low
    up = np.maximum((x - x[:, None]) / size, 1e-9)
    kick = np.where(x > x[:, None], np.exp(-0.5 * (np.log(up) / KICK_LOG_SD) ** 2) / up, 0.0)
    kick[-1, -1] = 1.0
    chance = -float(np.expm1(-kicks / bias.cells))
    return np.asarray(fades @ ((1.0 - chance) * np.eye(x.size) + chance * _rows(kick)))


def _rows(law: Array) -> Array:
    return np.asarray(law / np.maximum(law.sum(axis=1, keepdims=True), 1e-300))
