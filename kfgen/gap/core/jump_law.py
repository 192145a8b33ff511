"""Whether what is taken for a Gauss-Markov bias jumps: to any level, or by kicks of one sign that fade.

All have one spectrum. The likelihood of jumps is that of a hidden Markov chain on a grid of levels, that of the bias a Kalman
filter's, each averaged over the same sizes and times about those of the fit. How often the odds are large by chance is
measured where they are asked for, in `kfgen.gap.rest.course`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.process import markov_chain as chain
from kfgen.effects.process.stochastic import GaussMarkov
from kfgen.effects.process.switching_level import Slow, Switching, SwitchingParameters
from kfgen.effects.process.telegraph import Cells
from kfgen.effects.series import WhiteSeries, log_mean

Array = NDArray[np.float64]

ANY_LEVEL = "it jumps to any level and stays there"
FADING_KICKS = "it is kicked to one side and fades (doors)"
MAX_CELLS, CELLS_IN_A_TIME = 2400, 8.0
"""Means of samples in which a record is looked at, at most, and in the time of the bias: with less than a quarter of these
nothing is said."""
LEVELS = 160
"""Of the grid."""
REACH_SIGMAS = 5.0
"""Standard deviations of the bias, to either side of its mean, that the grid covers."""
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
    own = log_mean(np.concatenate([_log_bias(cells.switching, bias, factor) for factor in FACTORS]))
    x = np.linspace(-1.0, 1.0, LEVELS) * REACH_SIGMAS * sigma
    some = [BiasNumbers(a * sigma, b * of_a_time) for a, b in product(FACTORS, FACTORS)]
    levels = _log_chain(y, R, x, [_any_level(x, b) for b in some])
    kicks = [
        _log_chain(sign * y, R, x, [_fading(x, b, k) for b in some for k in KICKS_IN_A_TIME])
        for sign in (1.0, -1.0)
    ]
    laws = {ANY_LEVEL: log_mean(levels) - own, FADING_KICKS: log_mean(np.concatenate(kicks)) - own}
    return max(laws, key=lambda w: laws[w]), log_mean(np.array([*laws.values()]))


def _log_bias(cells: Switching, bias: GaussMarkov, factor: float) -> Array:
    """Log-likelihood of cells under the bias of a time so many times as long, of each size; shape (sizes,)."""
    form = replace(bias, tau=factor * float(bias.tau)).form()
    none, one = np.zeros(len(FACTORS)), np.ones(len(FACTORS))
    noise = replace(cells, slow=Slow.of((form,), cells.dt))
    return noise.log_likelihood(SwitchingParameters(none, one, none, one, np.array(FACTORS)))


def _log_chain(y: Array, R: float, x: Array, moved: list[Array]) -> Array:
    """The same of chains on the levels x, in white noise of variance R; shape (chains,)."""
    log_e = -0.5 * (y[:, None] - x) ** 2 / R - 0.5 * np.log(2.0 * np.pi * R)
    return chain.log_likelihood_of_levels(log_e, np.array(moved))


def _any_level(x: Array, bias: BiasNumbers) -> Array:
    """Where a level is in the next cell, shape (levels, levels), each row a law."""
    law = np.exp(-0.5 * (x / bias.sigma) ** 2)
    return np.asarray(chain.redrawn(np.exp([-1.0 / bias.cells]), (law / law.sum())[None])[0])


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
