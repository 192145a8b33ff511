"""What recorded drivers explain of a channel: every driver of the log competes, with its square and its rate.

A bench that warms up and cools down moves a bias by more than a random walk or a warm-up curve of the sensor; a
thermometer in the log says so. Each driver is tried alone, and with the other shapes that it has in the catalogue; a
shape stays where it gains more than its threshold, and where it follows the driver alike in slow and fast bands.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, catalogue
from kfgen.effects.driven.proportional import coupled, driver_named
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.evidence.whittle import Ordinates
from kfgen.identify.fit.fit import Fit

Array = NDArray[np.float64]
Group = tuple[Effect, ...]

MIN_CHANCE_OF_EQUAL_BANDS = 1e-3
"""Chance below which the bands of a driven effect disagree."""
MAX_SPREAD_OF_BANDS = 0.3
"""Of the coefficient: bands that differ by no more than that agree for all that is needed."""
BANDS_PER_DECADE = 2.0


def driver_groups(record: Evidence) -> list[Group]:
    """Sets of effects of each driver that changes in the record, with coefficients of zero: its own, and with others.

    Parameters
    ----------
    record : Evidence
        What is identified.
    """
    groups: list[Group] = []
    for name, mean in record.driven.items():
        own = driver_named(name).effect
        cls = catalogue()[own] if own else coupled(name)
        first = _about(cls, mean)
        others = [
            _about(c, mean)
            for c in catalogue().values()
            if c.driver == name and c is not cls and {p.kind for p in c.parameters()} <= {"signed", "setting"}
        ]
        groups += [(first, *more) for k in range(len(others) + 1) for more in combinations(others, k)]
    return groups


def _about(cls: type[Effect], mean: float) -> Effect:
    """An effect without size, about the mean of its driver."""
    values = {p.name: mean if p.kind == "setting" else 0.0 for p in cls.parameters()}
    return cls(**values)


def promise(record: Evidence, effects: Sequence[Effect], group: Group) -> float:
    """Twice the gain of log-likelihood of a group beside noise that stays as it is.

    Parameters
    ----------
    record : Evidence
        What is identified.
    effects : sequence of Effect
        Fitted; deterministic ones among them are left out.
    group : tuple of Effect
        That is tried.
    """
    held = tuple(e for e in effects if not e.coefficients())
    known = record.likelihood(held).log_likelihood(held).value
    return 2.0 * (record.likelihood((*held, *group)).log_likelihood((*held, *group)).value - known)


def follow_their_drivers(record: Evidence, fit: Fit) -> bool:
    """Whether every driven effect of a fit has the same coefficient in every band.

    A driver's own noise that leaks into a channel, by a compensation for instance, is no drift with it: slow
    and fast then follow the driver by different amounts.

    Parameters
    ----------
    record : Evidence
        What was fitted.
    fit : Fit
    """
    shapes = [e for e in fit.effects if e.coefficients()]
    data = record.ordinates(shapes) if any(e.driver for e in shapes) else None
    if not isinstance(data, Ordinates):
        return True
    columns = [e for e in shapes for _ in e.coefficients()]
    return all(_is_even(data, fit, k) for k, e in enumerate(columns) if e.driver)


def _is_even(data: Ordinates, fit: Fit, column: int) -> bool:
    """Whether the bands give one coefficient to a regressor, the others standing as they were fitted."""
    from scipy.stats import chi2

    left = np.concatenate([[1.0], -fit.likelihood.coefficients])
    left[1 + column] = 0.0
    weight = data.weight(fit.effects)
    band = np.floor(BANDS_PER_DECADE * np.log10(data.omega / data.omega.min())).astype(int)
    xy = np.bincount(band, (data.gram[:, :, 1 + column] @ left) * weight)
    xx = np.bincount(band, data.gram[:, 1 + column, 1 + column] * weight)
    some = xx > 0.0
    coefficient, bands = float(xy.sum() / xx.sum()), max(int(some.sum()) - 1, 1)
    spread = float(np.sum((xy[some] - coefficient * xx[some]) ** 2 / xx[some]))
    if chi2.sf(spread, bands) > MIN_CHANCE_OF_EQUAL_BANDS:
        return True
    # Variance between bands by the method of moments of DerSimonian and Laird.
    between = (spread - bands) / max(float(xx.sum() - np.sum(xx**2) / xx.sum()), 1e-300)
    return between < (MAX_SPREAD_OF_BANDS * coefficient) ** 2
