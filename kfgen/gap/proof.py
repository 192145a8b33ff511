"""Does the gap shrink on data that the fit did not see.

On a held-out stretch the parameters are frozen. In each band of ``m`` ordinates the mean ratio
``r`` of power to expectation is one where the model holds; what the model loses against one that
has the band's own level is ``m/2 (r - 1 - ln r)`` nats, of which half a nat is chance. The sum per
sample is the gap, its floor zero.

References
----------
.. [1] S. Kullback, Information Theory and Statistics, 1959, ch. 9 (divergence of variances).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.gap.battery import bands
from kfgen.identify.fit import Fit
from kfgen.identify.record import Record
from kfgen.identify.whittle import residual_ratio

Array = NDArray[np.float64]

HELD_OUT = 0.3
"""Share of the record, at its end, that no fit sees."""
DRAWS = 2000
METRIC = "held-out log-likelihood per sample above the noise floor"


@dataclass(frozen=True)
class Gap:
    """The gap on held-out data [nats per sample] before and after, and the share that closed."""

    before: float
    after: float
    closed: float
    ci95: tuple[float, float]


def split(record: Record) -> tuple[Record, Record]:
    """The part that is fitted, and the held-out tail."""
    k = int(record.y.size * (1.0 - HELD_OUT))
    return record.cut(0, k), record.cut(k, record.y.size)


def held_out_gap(tail: Record, before: Fit, after: Fit) -> Gap:
    """Compare two fits, frozen, on a stretch that neither saw."""
    r0, m = _ratios(tail, before.effects, before.likelihood.coefficients)
    r1, _ = _ratios(tail, after.effects, after.likelihood.coefficients)
    rng = np.random.default_rng(0)
    chance = rng.chisquare(m, (DRAWS, m.size)) / m
    lost0, lost1 = float(_lost(r0, m)), float(_lost(r1, m))
    draws0, draws1 = (
        _lost(r0 * chance, m) - 0.5 * m.size,
        np.maximum(_lost(r1 * chance, m) - 0.5 * m.size, 0.0),
    )
    closed = 1.0 - max(lost1, 0.0) / lost0 if lost0 > 0.0 else 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(draws0 > 0.0, 1.0 - draws1 / draws0, 0.0)
    lo, hi = np.clip(np.quantile(shares, [0.025, 0.975]), -1.0, 1.0).tolist()
    closed, n = max(closed, -1.0), float(m.sum())
    return Gap(lost0 / n, lost1 / n, closed, (min(lo, closed), max(hi, closed)))


def _ratios(tail: Record, effects: Sequence[Effect], coefficients: Array) -> tuple[Array, Array]:
    data = tail.ordinates(effects)
    ratio = residual_ratio(data, effects, coefficients)
    parts = [
        (float(data.count[lo:hi].sum()), float(data.count[lo:hi] @ ratio[lo:hi])) for lo, hi in bands(data)
    ]
    m = np.array([p[0] for p in parts])
    return np.array([p[1] for p in parts]) / m, m


def _lost(r: Array, m: Array) -> Array:
    return np.asarray((0.5 * m * (r - 1.0 - np.log(r)) - 0.5).sum(axis=-1))
