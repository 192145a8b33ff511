"""Quadratic functions of effects, whose size is a factor: only the shape is computed, and each shape once."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.recent_results import RecentResults
from kfgen.effects import Effect

Array = NDArray[np.float64]

LOG_STEP_OF_SLOPE = 1e-6
"""Step in a logarithm over which a density is differentiated, to one side: half of it is the shift of a maximum."""
RECENT = 4
"""Points of a fit whose densities and slopes are kept."""
MAX_KEPT_SHAPES = 512
"""Shapes of effects that are kept."""

Key = tuple[int, str]
"""A parameter: index of its effect, name."""


class Shapes:
    """Quadratic functions of an effect (a density, an Allan variance), each computed once.

    They grow with the square of the one size of the effect, so that only the shape is computed.

    Parameters
    ----------
    compute : callable
        The function of an effect, shape (m,).
    factor : callable, optional
        What effects that filter make of the sum, shape (m,).
    """

    def __init__(
        self,
        compute: Callable[[Effect], Array],
        factor: Callable[[Sequence[Effect]], Array] | None = None,
    ) -> None:
        self._compute = compute
        self._factor = factor
        self._known: dict[tuple[Hashable, ...], Array] = {}
        self._recent_slopes = RecentResults[Array](RECENT)
        self._recent_factors = RecentResults[Array](RECENT)

    def of(self, effect: Effect) -> Array:
        """The function, shape (m,)."""
        sizes = effect.sizes()
        if len(sizes) != 1:
            return self._compute(effect)
        (size,) = sizes
        key = (type(effect), *(getattr(effect, p.name) for p in effect.parameters() if p.name != size))
        if key not in self._known:
            if len(self._known) > MAX_KEPT_SHAPES:
                self._known.clear()
            self._known[key] = self._compute(replace(effect, **{size: 1.0}))
        return np.asarray(float(getattr(effect, size)) ** 2 * self._known[key])

    def total(self, effects: Sequence[Effect]) -> Array:
        """The sum over the random effects, positive."""
        return np.maximum(self.factor(effects) * self._sum(effects), np.finfo(float).tiny)

    def _sum(self, effects: Sequence[Effect]) -> Array | float:
        return sum(self.of(e) for e in effects if not e.coefficients())

    def factor(self, effects: Sequence[Effect]) -> Array | float:
        """What is passed of the sum, by the effects that filter."""
        filters = tuple(e for e in effects if e.is_filter)
        make = self._factor
        if make is None or not filters:
            return 1.0
        return self._recent_factors.recalled(filters, lambda: make(filters))

    def slopes(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Derivative of the sum in the logarithms of the keys' parameters, shape (k, m).

        Parameters
        ----------
        effects : sequence of Effect
            With their values [SI].
        keys : sequence of Key
            Parameters: index of the effect, name.
        """
        key = (tuple(effects), tuple(keys))
        return self._recent_slopes.recalled(key, lambda: self._slopes(effects, keys))

    def _slopes(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        factor, total = self.factor(effects), self._sum(effects)
        rows = [
            total * self._difference(effects[i], name, effects)
            if effects[i].is_filter
            else factor * self._slope(effects[i], name)
            for i, name in keys
        ]
        return np.array(rows).reshape(len(keys), -1)

    def _difference(self, effect: Effect, name: str, effects: Sequence[Effect]) -> Array | float:
        """Derivative of what is passed in a number of one that filters."""
        others = [e for e in effects if e.is_filter and e is not effect]
        moved = self.factor([*others, effect.shifted(name, LOG_STEP_OF_SLOPE)])
        return (moved - self.factor(effects)) / LOG_STEP_OF_SLOPE

    def _slope(self, effect: Effect, name: str) -> Array:
        if effect.coefficients():  # the shape of a regressor
            return np.zeros_like(self.of(effect.shape))
        sizes = effect.sizes()
        if sizes == (name,):
            return 2.0 * self.of(effect)
        moved = self.of(effect.shifted(name, LOG_STEP_OF_SLOPE))
        return np.asarray((moved - self.of(effect)) / LOG_STEP_OF_SLOPE)
