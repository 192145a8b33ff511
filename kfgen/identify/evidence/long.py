"""A record too long to be kept: one pass leaves what identification needs.

Block means of all of it hold what is slow; the Allan variances at the octaves inside a block what is fast;
its beginning at the full rate shows lines and an internal low-pass. Memory stays bounded, time is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.time_budget import not_counted
from kfgen.effects import Effect
from kfgen.identify.evidence.allan import AllanCurve, curve_from_variance, log_factors, octave_factors
from kfgen.identify.evidence.block_differences import BlockDifferences, IndependentLikelihoods
from kfgen.identify.evidence.likelihood import Likelihood
from kfgen.identify.evidence.peaks import spectral_peaks
from kfgen.identify.evidence.record import MAX_REGRESSOR_CELLS, Evidence, Peaks, Record, means_of
from kfgen.identify.evidence.running_allan import Phase
from kfgen.identify.evidence.whittle import Ordinates, coarse_transform, ordinates, transform
from kfgen.identify.screening.record_faults import Spread, interpolated

Array = NDArray[np.float64]

MAX_BLOCK_MEANS = 1 << 18
"""Block means to which a record is brought."""
HARDLY_FOLDED_SHARE_OF_NYQUIST = 0.15
"""Of the Nyquist frequency of block means: below it a fiftieth of their power is folded from above."""
HEAD_SAMPLES = 1 << 19
"""Samples at the beginning that are kept as they are."""
CHUNK_SAMPLES = 1 << 20
"""Samples that are looked at together."""


@dataclass(frozen=True)
class Stream:
    """Samples that can be read from the beginning, as often as needed.

    Parameters
    ----------
    chunks : callable
        An iterable of pieces of the samples [SI], of about `CHUNK_SAMPLES`.
    n : int
        Samples in all.
    dt : float
        Sampling period [s].
    """

    chunks: Callable[[], Iterable[Array]]
    n: int
    dt: float

    @staticmethod
    def of(y: Array, dt: float) -> Stream:
        """The samples of an array, shape (n,).

        Parameters
        ----------
        y : ndarray, shape (n,)
            Samples [SI].
        dt : float
            Sampling period [s].
        """
        return Stream(lambda: (y[a : a + CHUNK_SAMPLES] for a in range(0, y.size, CHUNK_SAMPLES)), y.size, dt)


@dataclass(frozen=True)
class Long(Evidence):
    """What one pass over a long record has left.

    Parameters
    ----------
    means : ndarray, shape (m,)
        Block means [SI].
    block : int
        Samples in a block, a power of two.
    period : float
        Sampling period [s].
    samples : int
        Of the whole record.
    allan, at_octaves : AllanCurve
        Of the whole record.
    head : Record
        Its beginning.
    drive : mapping of str to ndarray, shape (m,)
        Block means of recorded drivers.
    lost : int
        Outliers and samples that are not numbers, interpolated.
    skip : tuple of (lo, hi)
        Bands [Hz] that are left out.
    """

    means: Array
    block: int
    period: float
    samples: int
    allan: AllanCurve
    at_octaves: AllanCurve
    head: Record
    drive: Mapping[str, Array] = field(default_factory=dict)
    lost: int = 0
    skip: tuple[tuple[float, float], ...] = ()

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return self.period

    @property
    def curve(self) -> AllanCurve:
        """Of the whole record."""
        return self.allan

    @property
    def octaves(self) -> AllanCurve:
        """Of the whole record, at octaves."""
        return self.at_octaves

    @property
    def lengths(self) -> tuple[int, ...]:
        """All samples."""
        return (self.samples,)

    @property
    def step(self) -> float:
        """A sampling period: what is inside a block is looked at too."""
        return self.period

    @cached_property
    def scale(self) -> float:
        """Standard deviation of the samples [SI]: of the block means, and of what they average away."""
        return float(np.hypot(np.std(self.means), self.octaves.deviation[0]))

    @cached_property
    def adc_step(self) -> float:
        """Step of the ADC grid on which its samples lie [SI], zero where they lie on none."""
        return self.head.adc_step

    @property
    def driven(self) -> Mapping[str, float]:
        """Mean of each recorded driver that changes [SI]."""
        return means_of(self.drive)

    @cached_property
    def slow(self) -> Record:
        """The block means as a record of their own."""
        t = np.asarray((np.arange(self.means.size) + 0.5) * (self.block * self.period), dtype=np.float64)
        return Record(t, self.means, self.drive, skip=self.skip, origin=0.0, averaged=self.block)

    def leaving_out(self, *bands: tuple[float, float]) -> Long:
        """The same with more bands [Hz] left out of the likelihood."""
        return replace(self, skip=self.skip + bands, head=self.head.leaving_out(*bands))

    @cached_property
    def _sines(self) -> Array:
        return transform(self.means)

    def ordinates(self, effects: Sequence[Effect], peaks: Peaks | None = None) -> Ordinates:
        """The binned transform of the block means, with a regressor for each coefficient of the effects.

        See `Evidence.ordinates`.
        """
        cells = min(MAX_REGRESSOR_CELLS, self.means.size)
        edges = np.asarray(np.arange(cells + 1) * (self.duration / cells), dtype=np.float64)
        drive = {k: np.interp(edges, self.slow.t, v) for k, v in self.drive.items()}
        columns = [
            coarse_transform(x, self.means.size - 1) for e in effects for x in e.regressors(edges, drive)
        ]
        narrow = spectral_peaks(effects) if peaks is None else peaks
        skip = (*self.skip, (self._top, np.inf))
        return ordinates([self._sines, *columns], self.period, self.block, skip=skip, peaks=narrow)

    @property
    def _top(self) -> float:
        """Up to it the block means are looked at [Hz]: where an internal low-pass takes power away, they fold less into it."""
        nyquist = 0.5 / (self.period * self.block)
        passed = all(hi < np.inf for _, hi in self.skip)
        return nyquist if passed else HARDLY_FOLDED_SHARE_OF_NYQUIST * nyquist

    def measure(self, shapes: Sequence[Effect], peaks: Peaks = ()) -> Likelihood:
        """Block means, and what is inside the blocks: of all of it, or, with bands left out, of the beginning.

        See `Evidence.measure`.
        """
        main = self.ordinates(shapes, peaks)
        if self.skip:
            inside_blocks = self.head.leaving_out((0.0, self._top))
            return IndependentLikelihoods((main, inside_blocks.ordinates((), peaks)))
        m = 2 ** np.arange(int(np.log2(self.block)))
        inside = self.octaves
        count = np.asarray(self.samples / (2.0 * m), dtype=np.float64)
        haar = BlockDifferences(inside.tau[: m.size], count, inside.deviation[: m.size] ** 2)
        return IndependentLikelihoods((main, haar))


def condense(stream: Stream) -> Long:
    """One pass over a long record; of the time of a search it takes none.

    Raises
    ------
    InputError
        Another number of samples comes than was said, or most of a piece is missing.
    """
    with not_counted():
        return _condensed(stream)


def _condensed(stream: Stream) -> Long:
    block = 1 << max(1, int(np.ceil(np.log2(stream.n / MAX_BLOCK_MEANS))))
    m, octaves = log_factors(stream.n), octave_factors(stream.n)
    factors = np.union1d(m, octaves)
    phase, means = Phase(factors, stream.n), _Means(block)
    head: list[Array] = []
    spread, lost, kept = None, 0, 0
    for raw in stream.chunks():
        y = np.asarray(raw, dtype=np.float64)
        spread = spread or Spread.of(y[np.isfinite(y)])
        bad = spread.is_outlier(y)
        if bad.mean() > 0.5:
            raise InputError(
                "most of the samples are missing in a part of the log", remedy="Cut the log there"
            )
        lost += int(bad.sum())
        y = interpolated(y, bad)
        phase.add(y)
        means.add(y)
        if kept < HEAD_SAMPLES:
            head.append(y[: HEAD_SAMPLES - kept])
            kept += head[-1].size
    avar = phase.variance()
    curve, eights = (
        curve_from_variance(avar[np.searchsorted(factors, f)], stream.n, f, stream.dt) for f in (m, octaves)
    )
    beginning = np.concatenate(head)
    t = np.asarray(np.arange(beginning.size) * stream.dt, dtype=np.float64)
    record = Record(t, beginning)
    return Long(means.done(), block, stream.dt, stream.n, curve, eights, record, lost=lost)


class _Means:
    """Means of successive blocks of a stream; an incomplete last block is left out."""

    def __init__(self, block: int) -> None:
        self._block, self._out = block, [np.zeros(0)]
        self._rest = np.zeros(0)

    def add(self, y: Array) -> None:
        """Take the samples that follow."""
        y = np.concatenate([self._rest, y]) if self._rest.size else y
        full = y.size // self._block * self._block
        self._out.append(y[:full].reshape(-1, self._block).mean(axis=1))
        self._rest = y[full:].copy()

    def done(self) -> Array:
        """All means."""
        return np.concatenate(self._out)
