"""Does the record disagree with the model, and where: tests with one family-wise rate.

Under the right model every ordinate of the sine transform over its expectation is an independent
chi-square of one degree of freedom. So the power in each band is a chi-square, and the regression
on a driver or on time a normal deviate; their p values are held together by Holm's method [1]_.

References
----------
.. [1] S. Holm, A simple sequentially rejective multiple test procedure, Scand. J. Statist. 6, 1979.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kfgen.effects import Effect, catalogue
from kfgen.identify.record import Record
from kfgen.identify.whittle import Ordinates, residual_ratio

RATE = 0.01
"""Family-wise false alarm rate of the battery."""
BANDS_PER_DECADE = 3


@dataclass(frozen=True)
class Test:
    """One test: what it looked at, where, its adjusted p value and the ratio of powers found."""

    name: str
    p: float
    band_hz: tuple[float, float]
    ratio: float

    @property
    def significant(self) -> bool:
        """At the family-wise rate."""
        return self.p < RATE


def battery(record: Record, effects: Sequence[Effect], coefficients: np.ndarray) -> list[Test]:
    """All tests on what the model leaves of a record, by adjusted p value.

    Parameters
    ----------
    record : Record
    effects : sequence of Effect
        The model, with its deterministic effects' `coefficients` in order.
    """
    data = record.ordinates(effects)
    ratio = residual_ratio(data, effects, coefficients)
    tests = [_band(data, ratio, lo, hi) for lo, hi in bands(data)]
    for name, cls in catalogue().items():
        shown = cls.starts(record.look)
        if shown and cls.coefficients() and not any(e.name == name for e in effects):
            tests.append(_driven(record, effects, coefficients, shown[0]))
    return _holm(tests)


def bands(data: Ordinates) -> list[tuple[int, int]]:
    """Slices of the bins into bands evenly spaced in the logarithm of frequency."""
    decades = np.log10(data.omega[-1] / data.omega[0]) if data.omega.size > 1 else 0.0
    edges = np.geomspace(data.omega[0], data.omega[-1], max(2, int(decades * BANDS_PER_DECADE) + 1))
    at = np.unique(np.concatenate([[0], np.searchsorted(data.omega, edges[1:-1]), [data.omega.size]]))
    return list(zip(at[:-1].tolist(), at[1:].tolist()))


def _band(data: Ordinates, ratio: np.ndarray, lo: int, hi: int) -> Test:
    from scipy.stats import chi2

    m = float(data.count[lo:hi].sum())
    total = float(data.count[lo:hi] @ ratio[lo:hi])
    p = 2.0 * min(float(chi2.sf(total, m)), float(chi2.cdf(total, m)))
    f = data.frequency
    return Test("power", min(p, 1.0), (float(f[lo]), float(f[hi - 1])), total / m)


def _driven(record: Record, effects: Sequence[Effect], coefficients: np.ndarray, effect: Effect) -> Test:
    """Regression of the residual on a deterministic effect."""
    from scipy.stats import norm

    data = record.ordinates([*effects, effect])
    held = np.append(coefficients, 0.0)
    base = data.log_likelihood(effects, held).value
    best = data.log_likelihood(effects).value
    z = np.sqrt(max(2.0 * (best - base), 0.0))
    f = data.frequency
    return Test(effect.title, float(2.0 * norm.sf(z)), (0.0, float(f[min(5, f.size - 1)])), 1.0 + z**2)


def _holm(tests: list[Test]) -> list[Test]:
    ordered = sorted(tests, key=lambda t: t.p)
    adjusted, floor = [], 0.0
    for i, test in enumerate(ordered):
        floor = max(floor, min(1.0, test.p * (len(ordered) - i)))
        adjusted.append(replace(test, p=floor))
    return adjusted
