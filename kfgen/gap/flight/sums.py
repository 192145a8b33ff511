"""Effects along a flight as sums of effects of unit size, whose responses serve every other size as well."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from kfgen.effects.inertial.errors import Mounting
from kfgen.effects.inertial.inertial_error import free
from kfgen.effects.inertial.lag import ClockDrift, Lag, TimeDelay
from kfgen.gap.scene.scene import Placed

SHORT = {TimeDelay.name: ("delay", 2e-3), ClockDrift.name: ("rate", 2e-5)}
"""Delay [s] and drift by which the readings' rates are had along the path; larger ones are in proportion, until the path
is theirs."""
TURN_RAD = 1e-3
"""Mounting angle by which the readings turn along the path; larger ones are in proportion, until the path is theirs."""
NODE_LOG_STEP = 0.25
"""Step of the logarithm of a corner or a time constant between which responses are interpolated."""
REMEMBERED_UNITS = 4096
"""Effects whose sums are kept."""


@lru_cache(maxsize=REMEMBERED_UNITS)
def units_of(placed: Placed) -> tuple[tuple[Placed, float], ...]:
    """An effect as a sum of effects with their weights, which serve other values of it as well.

    What is linear in its coefficients is a sum of effects of unit size, what is short is in proportion. One that has a
    corner or a time constant besides is interpolated between neighbours in its logarithm.

    Parameters
    ----------
    placed : Placed

    Returns
    -------
    tuple of (Placed, float)
    """
    if (short := SHORT.get(placed.effect.name)) is not None:
        name, small = short
        unit = replace(placed, effect=replace(placed.effect, **{name: small}))
        return ((unit, float(getattr(placed.effect, name)) / small),)
    names = {p.name for p in free(placed.effect)}
    positive = [p.name for p in placed.effect.parameters() if p.name in names and p.kind != "signed"]
    signed = [p.name for p in placed.effect.parameters() if p.name in names and p.kind == "signed"]
    if len(positive) > 1 or not names or (positive and signed and isinstance(placed.effect, Lag)):
        return ((placed, 1.0),)
    sizes = {n: float(getattr(placed.effect, n)) for n in signed}
    bare = Placed(replace(placed.effect, **dict.fromkeys(signed, 0.0)), placed.where)
    one = TURN_RAD if isinstance(placed.effect, Mounting) else 1.0
    linear = [(replace(bare, effect=replace(bare.effect, **{n: one})), s / one) for n, s in sizes.items()]
    if not positive:
        return tuple(linear)
    nodes = _nodes(float(getattr(placed.effect, positive[0])))
    return tuple(
        (replace(p, effect=replace(p.effect, **{positive[0]: x})), size * w)
        for p, size in (linear or [(bare, 1.0)])
        for x, w in nodes
    )


def _nodes(value: float) -> list[tuple[float, float]]:
    """Neighbours of a positive number, evenly in the logarithm, and their weights: a cubic through four of them."""
    at = np.log(max(value, 1e-300)) / NODE_LOG_STEP
    first = int(np.floor(at)) - 1
    s, k = at - first, np.arange(4)
    weights = [float(np.prod([(s - j) / (i - j) for j in k if j != i])) for i in k]
    return [(float(np.exp((first + i) * NODE_LOG_STEP)), w) for i, w in zip(k, weights)]
