"""The floor of a spectrum, and the narrow bands that stand above it: found without any model of the noise.

The floor is the median of the ordinates of cells of a few per cent of their frequency, which a line inside a cell
does not move, made smooth by a running median over cells. It follows any noise that is smooth in frequency, so that
lines are found before slow terms are fitted, which else would take their power. Over the floor every ordinate is a
chi-square of one degree of freedom and the sum of w of them one of w: Fisher's test, at every width [1]_.

References
----------
.. [1] R. A. Fisher, Tests of significance in harmonic analysis, Proc. R. Soc. A 125, 1929.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import frequencies

Array = NDArray[np.float64]
Marks = NDArray[np.bool_]

FALSE_ALARM_PER_RECORD = 1e-3
"""Of one record."""
FIRST_ORDINATE = 16
"""Ordinates at the bottom that are not looked at for a floor."""
MIN_ORDINATE_OF_LINE = 30
"""Ordinates at the bottom in which a drift is no line."""
MIN_ORDINATES_OF_CELL = 64
RATIO_OF_CELLS = 1.2
"""Of the frequencies of neighbouring cells."""
CELLS_OF_RUNNING_MEDIAN = 5
MEDIAN_OF_CHI_SQUARE_1 = 0.454936
SPREAD_OF_MEDIAN = 2.33
"""Relative standard deviation of the level that a median of m ordinates gives, times the root of m."""
FLOOR_SPREADS = 3.0
"""Of these standard deviations by which a floor may be too low."""
WIDTHS = (1, 4, 16, 64, 256, 1024)
"""Ordinates whose sum is looked at."""
MAX_WIDTH_OVER_FREQUENCY = 0.1
"""Of such a sum: a wider bump is no line."""
MIN_RATIO_OF_WIDE_LINE = 2.0
"""Power over the floor of a line of several ordinates."""
ORDINATES_BESIDE = 41
"""Of the medians on both sides of an ordinate where a filter bends the floor within a cell."""
ORDINATES_OF_SKIRT = 4
"""Beside a line that are in neither of them."""
MARGIN_OF_LARGER_SIDE = 1.4
"""Factor by which the larger of two such medians may be too low, so that one record in a thousand is falsely alarmed."""


@dataclass(frozen=True)
class SpectralFloor:
    """The ordinates of a record beside their floor.

    Parameters
    ----------
    omega : ndarray, shape (n,)
        Angular frequency [rad per block].
    power : ndarray, shape (n,)
        Of the values [U^2].
    floor : ndarray, shape (n,)
        What it would be without lines [U^2].
    margin : ndarray, shape (n,)
        Factor by which a floor of so few ordinates may be too low.
    """

    omega: Array
    power: Array
    floor: Array
    margin: Array

    @staticmethod
    def of(record: Record) -> SpectralFloor | None:
        """The floor of an even record; None where it has too few ordinates.

        Parameters
        ----------
        record : Record
        """
        X = record.sines
        n = X.size
        edges = _cells(n)
        if edges.size < CELLS_OF_RUNNING_MEDIAN + 1:
            return None
        omega = frequencies(n)
        power = (X / (2.0 * np.sin(0.5 * omega))) ** 2
        level = np.array([np.median(power[a:b]) for a, b in pairwise(edges)]) / MEDIAN_OF_CHI_SQUARE_1
        middle = np.log(0.5 * (edges[1:] + edges[:-1]))
        logs = _smoothed(np.log(np.maximum(level, np.finfo(float).tiny)), middle)
        at = np.log(np.arange(1, n + 1, dtype=np.float64))
        floor = np.exp(np.interp(at, middle, logs))
        low = slice(0, int(np.exp(middle[0])))
        floor[low] = np.exp(logs[0] + (at[low] - middle[0]) * (logs[1] - logs[0]) / (middle[1] - middle[0]))
        counted = 1.0 + FLOOR_SPREADS * SPREAD_OF_MEDIAN / np.sqrt(np.diff(edges))
        return SpectralFloor(omega, power, floor, np.interp(at, middle, counted))

    def above(self) -> Marks:
        """The ordinates of lines, shape (n,): of fine ones first, of wider ones in what these leave."""
        from scipy.stats import chi2

        n = self.power.size
        ratio = self.power / (self.floor * self.margin)
        marks = np.zeros(n, dtype=bool)
        for width in (w for w in WIDTHS if w * 8 <= n):
            sums = ratio[: n // width * width].reshape(-1, width).mean(axis=1)
            least = chi2.isf(FALSE_ALARM_PER_RECORD * width / (n * len(WIDTHS)), width) / width
            hit = np.flatnonzero(sums > (least if width == 1 else max(least, MIN_RATIO_OF_WIDE_LINE)))
            hit = hit[hit * width >= max(MIN_ORDINATE_OF_LINE, width / MAX_WIDTH_OVER_FREQUENCY)]
            if hit.size:
                found = (hit[:, None] * width + np.arange(width)).ravel()
                marks[found], ratio[found] = True, 1.0
        return marks

    @cached_property
    def beside(self) -> Array:
        """The larger of the levels on both sides of each ordinate, shape (n,) [U^2]: a slope is no line."""
        from scipy.ndimage import median_filter, shift

        if self.power.size < 4 * ORDINATES_BESIDE:
            return np.full(self.power.size, np.inf)
        level = median_filter(self.power, ORDINATES_BESIDE, mode="nearest") / MEDIAN_OF_CHI_SQUARE_1
        away = ORDINATES_BESIDE // 2 + ORDINATES_OF_SKIRT
        below, above = (shift(level, k, order=0, mode="nearest") for k in (away, -away))
        return np.asarray(np.maximum(below, above))

    def stands_out(self, first: int, last: int) -> bool:
        """Whether ordinates are above those on both sides, as many or `ORDINATES_BESIDE`: the shoulder of a filter is not.

        Parameters
        ----------
        first, last : int
            Of the ordinates of a line.
        """
        width = max(last + 1 - first, ORDINATES_BESIDE)
        sides = (self.power[max(first - width, 0) : first], self.power[last + 1 : last + 1 + width])
        level = max(float(np.median(side)) for side in sides if side.size) / MEDIAN_OF_CHI_SQUARE_1
        return float(self.power[first : last + 1].mean()) > MIN_RATIO_OF_WIDE_LINE * level

    def narrow(self) -> Marks:
        """The single ordinates of lines above a low-pass, shape (n,): far above what is on both sides of them."""
        from scipy.stats import chi2

        least = MARGIN_OF_LARGER_SIDE * float(chi2.isf(FALSE_ALARM_PER_RECORD / self.power.size, 1))
        return np.asarray(self.power > least * self.beside)


def _cells(n: int) -> NDArray[np.int64]:
    """Edges of cells of ordinates, the same ratio apart, none of them smaller than `MIN_ORDINATES_OF_CELL`."""
    edges = [FIRST_ORDINATE]
    while edges[-1] < n:
        edges.append(edges[-1] + max(MIN_ORDINATES_OF_CELL, int(edges[-1] * (RATIO_OF_CELLS - 1.0))))
    edges[-1] = n
    if len(edges) > 2 and edges[-1] - edges[-2] < MIN_ORDINATES_OF_CELL:
        del edges[-2]
    return np.array(edges, dtype=np.int64)


def _smoothed(logs: Array, at: Array) -> Array:
    """A running median over cells of the logarithm, less its slope: a bump narrower than half of them goes."""
    half = CELLS_OF_RUNNING_MEDIAN // 2
    out = logs.copy()
    for k in range(logs.size):
        first = min(max(k - half, 0), logs.size - CELLS_OF_RUNNING_MEDIAN)
        near = slice(first, first + CELLS_OF_RUNNING_MEDIAN)
        x, y = at[near] - at[k], logs[near]
        pairs = [(y[j] - y[i]) / (x[j] - x[i]) for i in range(x.size) for j in range(i)]
        slope = float(np.median(pairs))
        out[k] = float(np.median(y - slope * x))
    return out
