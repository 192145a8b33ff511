"""Whether what is taken for telegraph noise has more than two levels: the likelihoods of two and of many are compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.process.population_monte_carlo import log_integral_about
from kfgen.effects.process.telegraph import MIDDLE_SD_OVER_SIZE, Cells, RandomTelegraph
from kfgen.effects.series import WhiteSeries

Array = NDArray[np.float64]

MANY_LEVELS = "it has more than two levels"
LEVEL_COUNT = 6
"""Of many: as far apart as the quantiles of a normal law."""
START_SD_OF_LOG = (0.2, 0.4)
"""Standard deviations of their logarithms of size and dwell time."""


def many_levels_log_odds(
    series: WhiteSeries, telegraph: RandomTelegraph, alone: WhiteSeries | None = None
) -> float:
    """How likely many levels are over the two of a telegraph of the same spectrum, both as likely before.

    Parameters
    ----------
    series : WhiteSeries
        The record without the telegraph in its model.
    telegraph : RandomTelegraph
        That was found.
    alone : WhiteSeries, optional
        The record without other slow noise that was found beside it either: two levels and that are compared with many levels.

    Returns
    -------
    float
        The logarithm of the odds [nats].
    """
    from scipy.special import ndtri

    two, one = Cells.of(series), Cells.of(alone or series)
    levels = ndtri((np.arange(LEVEL_COUNT) + 0.5) / LEVEL_COUNT)
    many = replace(one, switching=replace(one.switching, levels=0.5 * levels / levels.std()))
    return _log_likelihood(many, telegraph) - _log_likelihood(two, telegraph)


def _log_likelihood(cells: Cells, telegraph: RandomTelegraph) -> float:
    """Integrated over size and dwell time, and over the noise [nats]."""
    middle = MIDDLE_SD_OVER_SIZE * float(telegraph.size) / cells.still
    at = np.concatenate([np.log([float(telegraph.size), float(telegraph.dwell)]), cells.noise])
    spread = np.array([*START_SD_OF_LOG, middle, *cells.deviation[1:]])
    return log_integral_about(cells.gain, at, spread) + float(
        np.log(cells.still)
    )  # the middle is in units of it
