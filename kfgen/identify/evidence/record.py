"""What is identified: an evenly sampled record of one channel.

`Evidence` is what a fit needs to know; a `Record` has it from its samples, a `JointRecord` from several
records, of which each was switched on anew. (`kfgen.identify.evidence.published` has a curve without samples.)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.recent_results import RecentResults
from kfgen.effects import Effect, Look
from kfgen.effects.series import DetectedFault, adc_step
from kfgen.identify.evidence.allan import AllanCurve, allan_curve, octave_factors, overlapping_variance
from kfgen.identify.evidence.in_means import Shapes, in_means
from kfgen.identify.evidence.likelihood import Likelihood
from kfgen.identify.evidence.peaks import SpectralPeak, spectral_peaks
from kfgen.identify.evidence.whittle import (
    BINS_PER_DECADE,
    Ordinates,
    block_means,
    coarse_transform,
    ordinates,
    transform,
)
from kfgen.identify.screening.left_out import LeftOut

Array = NDArray[np.float64]
Peaks = tuple[SpectralPeak, ...]

MAX_REGRESSOR_CELLS = 1 << 14
"""Stretches of a record between which a smooth regressor of searched shape is differenced."""
MIN_TIME_IN_STEPS = 10.0
"""Steps of the shortest time that is searched: a faster process takes its share of the white noise."""
MIN_CORNER_OVER_RATE = 0.005
"""Of the sampling rate: the lowest corner that is searched. Above the rate itself a low-pass does nothing."""
MAX_SAMPLES_OF_ANY_LENGTH = 10_000
"""Of which a transform is quick enough whatever their number is."""
MAX_KEPT_LIKELIHOODS = 8
"""Likelihoods that are kept, one for each set of regressors and bins."""


class Evidence(ABC):
    """What a fit needs to know of what was measured."""

    @property
    @abstractmethod
    def dt(self) -> float:
        """Sampling period [s]."""

    @property
    @abstractmethod
    def lengths(self) -> tuple[int, ...]:
        """Samples of each stretch in one piece."""

    @property
    def skip(self) -> tuple[tuple[float, float], ...]:
        """Bands [Hz] that are not looked at."""
        return ()

    @property
    def n(self) -> int:
        """Samples of all."""
        return sum(self.lengths)

    @property
    def longest(self) -> float:
        """The longest stretch in one piece [s]: slower than that, nothing can be seen."""
        return max(self.lengths) * self.dt

    @property
    @abstractmethod
    def curve(self) -> AllanCurve:
        """Its overlapping Allan deviation."""

    @property
    @abstractmethod
    def octaves(self) -> AllanCurve:
        """Its overlapping Allan deviation at octaves: nearly independent points."""

    @property
    @abstractmethod
    def step(self) -> float:
        """The shortest time [s] of which it can tell: a period, or a block."""

    @property
    @abstractmethod
    def scale(self) -> float:
        """Standard deviation of its samples [SI]."""

    @cached_property
    def adc_step(self) -> float:
        """Step of the ADC grid on which its samples lie [SI], zero where they lie on none or are not kept."""
        samples = getattr(self, "y", None)
        return 0.0 if samples is None else adc_step(samples)

    @property
    @abstractmethod
    def driven(self) -> Mapping[str, float]:
        """Mean of each recorded driver that changes [SI]."""

    @abstractmethod
    def ordinates(self, effects: Sequence[Effect], peaks: Peaks | None = None) -> Ordinates:
        """The binned transform, with a regressor for each coefficient of the effects in order.

        Parameters
        ----------
        effects : sequence of Effect
        peaks : sequence of SpectralPeak, optional
            About which bins are finer; the narrow peaks of `effects` when left out.
        """

    @cached_property
    def _known(self) -> dict[tuple[tuple[Effect, ...], Peaks], Likelihood]:
        return {}

    def likelihood(self, effects: Sequence[Effect]) -> Likelihood:
        """The likelihood with the regressors of these effects; kept while their shapes and peaks do not change."""
        shapes = tuple(e.shape for e in effects if e.coefficients())
        peaks = tuple(p.rounded() for p in spectral_peaks(effects))
        known = self._known
        if (shapes, peaks) not in known:
            if len(known) > MAX_KEPT_LIKELIHOODS:
                known.clear()
            known[shapes, peaks] = self.measure(shapes, peaks)
        return known[shapes, peaks]

    def measure(self, shapes: Sequence[Effect], peaks: Peaks = ()) -> Likelihood:
        """A new likelihood with the regressors of these effects, and bins for these peaks.

        Parameters
        ----------
        shapes : sequence of Effect
            Deterministic effects, whose coefficients are solved for.
        peaks : tuple of SpectralPeak
            Narrow peaks about which bins are finer.
        """
        return self.ordinates(shapes, peaks)

    def drift_variance(self, effects: Sequence[Effect]) -> Array:
        """The Allan variance [U^2] that deterministic effects give the curve, shape of its ``tau``."""
        return np.zeros(self.curve.tau.size)

    @property
    def duration(self) -> float:
        """Length of all of it [s]."""
        return self.dt * self.n

    @property
    def words(self) -> str:
        """How much of what, for a report."""
        return f"{self.duration:.6g} s at {1.0 / self.dt:.6g} Hz"

    @cached_property
    def look(self) -> Look:
        """What effects guess their start values from."""
        return Look(self.curve.tau, self.curve.deviation, self.dt, self.longest, self.driven)

    def box(self, kind: str, slowest: float = 0.5, fastest: float = MIN_TIME_IN_STEPS) -> tuple[float, float]:
        """Bounds of the logarithm of a parameter of that kind.

        Parameters
        ----------
        kind : str
            Of the parameter, see `kfgen.effects.Parameter`.
        slowest : float
            Longest time that is fitted, of the record.
        fastest : float
            Shortest time that is fitted, in steps.

        Returns
        -------
        tuple of float
            Lower and upper bound of the logarithm.
        """
        if kind == "time":
            least = fastest * self.step
            return float(np.log(least)), float(np.log(max(slowest * self.longest, 2.0 * least)))
        if kind == "frequency":
            return float(np.log(1.0 / self.longest)), float(np.log(0.5 / self.step))
        if kind == "corner":
            return float(np.log(MIN_CORNER_OVER_RATE / self.step)), float(np.log(1.0 / self.step))
        if kind == "ratio":
            return float(np.log(1e-3)), float(np.log(0.4))
        if kind == "width":
            return float(np.log(1e-6)), float(np.log(1e6))
        scale = self.scale or 1.0
        return float(np.log(1e-9 * scale)), float(np.log(1e4 * scale * max(1.0, self.longest)))


def means_of(drive: Mapping[str, Array]) -> dict[str, float]:
    """Mean of each driver that changes."""
    return {k: float(np.mean(v)) for k, v in drive.items() if np.ptp(v) > 0.0}


@dataclass(frozen=True)
class Record(Evidence):
    """One channel, evenly sampled, with its drivers.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Time [s] and samples [SI].
    drive : mapping of str to ndarray, shape (n,)
        Recorded drivers, ``temperature`` [K] for example.
    block : int
        Samples averaged to one before the transform.
    skip : tuple of (lo, hi)
        Bands [Hz] that the likelihood leaves out: lines, what lies beyond a low-pass.
    origin : float, optional
        Time [s] of switch-on; the first sample's when left out.
    per_decade : int
        Bins of the transform in a decade of frequency.
    faults : tuple of DetectedFault
        What was wrong with samples that were left out and drawn over.
    left_out : LeftOut
        Shocks and outliers that it had.
    averaged : int
        Samples of the sensor in each of `y`, which is their mean; `t` is then their middle.
    logged_step : float, optional
        Step of the ADC grid [SI] of the samples that were logged, where `y` is computed from them.
    """

    t: Array
    y: Array
    drive: Mapping[str, Array] = field(default_factory=dict)
    block: int = 1
    skip: tuple[tuple[float, float], ...] = ()
    origin: float | None = None
    per_decade: int = BINS_PER_DECADE
    faults: tuple[DetectedFault, ...] = ()
    left_out: LeftOut = field(default_factory=LeftOut)
    averaged: int = 1
    logged_step: float | None = None

    @property
    def since(self) -> float:
        """Time [s] of switch-on."""
        return float(self.t[0]) if self.origin is None else self.origin

    @property
    def elapsed(self) -> Array:
        """Time since switch-on [s], shape (n,)."""
        return self.t - self.since

    def cut(self, start: int, stop: int) -> Record:
        """A stretch of it, which remembers when it was switched on.

        Parameters
        ----------
        start, stop : int
            Samples, as of a slice.
        """
        drive = {k: v[start:stop] for k, v in self.drive.items()}
        return replace(self, t=self.t[start:stop], y=self.y[start:stop], drive=drive, origin=self.since)

    def quick(self) -> Record:
        """Without its last samples, 1.5 % at most, where its number of samples has a prime factor above 11.

        Transforms of such a number take several times as long.
        """
        from scipy.fft import prev_fast_len

        n = int(self.y.size)
        return self.cut(0, prev_fast_len(n)) if n > MAX_SAMPLES_OF_ANY_LENGTH else self

    @cached_property
    def adc_step(self) -> float:
        """Step of the ADC grid on which its samples were logged [SI], zero where they lie on none."""
        return super().adc_step if self.logged_step is None else self.logged_step

    @cached_property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float(self.t[-1] - self.t[0]) / (self.t.size - 1)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Its samples."""
        return (int(self.y.size),)

    @property
    def step(self) -> float:
        """A block [s]."""
        return self.dt * self.block

    @cached_property
    def scale(self) -> float:
        """Standard deviation of its samples [SI]."""
        return float(np.std(self.y))

    @cached_property
    def driven(self) -> Mapping[str, float]:
        """Mean of each recorded driver that changes [SI]."""
        return means_of(self.drive)

    @cached_property
    def curve(self) -> AllanCurve:
        """Its overlapping Allan deviation."""
        return allan_curve(self.y, self.dt)

    @cached_property
    def octaves(self) -> AllanCurve:
        """Its overlapping Allan deviation at octaves."""
        return allan_curve(self.y, self.dt, octave_factors(self.y.size))

    @cached_property
    def sines(self) -> Array:
        """The sine transform of the differences of its block means, shape (n // block - 1,)."""
        return transform(block_means(self.y, self.block))

    def drift_variance(self, effects: Sequence[Effect]) -> Array:
        """The Allan variance [U^2] of what deterministic effects give this record."""
        m = np.round(self.curve.tau / self.dt).astype(np.int64)
        return np.asarray(overlapping_variance(self.drift(effects), m))

    def drift(self, effects: Sequence[Effect]) -> Array:
        """What deterministic effects give this record [U], shape (n,)."""
        shapes = [e for e in effects if e.coefficients()]
        return np.asarray(sum(self._seen(lambda t, u: [e.mean(t, u) for e in shapes]), np.zeros(self.n)))

    def regressors(self, effect: Effect) -> list[Array]:
        """The regressors of an effect as this record has them [U], each of shape (n,)."""
        return self._seen(effect.regressors)

    def _seen(self, shapes: Shapes) -> list[Array]:
        """Functions of time since switch-on and of drivers, at its samples or in its means."""
        t, drive = self.elapsed, self.drive
        return list(shapes(t, drive)) if self.averaged == 1 else in_means(shapes, t, drive, self.dt)

    def leaving_out(self, *bands: tuple[float, float], y: Array | None = None) -> Record:
        """The same with more bands [Hz] left out of the likelihood, or with other samples in it; Allan curves stay."""
        step = self.logged_step if y is None else self.adc_step
        other = replace(self, skip=self.skip + bands, y=self.y if y is None else y, logged_step=step)
        for name in ("curve", "octaves") if y is not None else ("sines", "curve", "octaves", "scale"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    def ordinates(self, effects: Sequence[Effect], peaks: Peaks | None = None) -> Ordinates:
        """The binned transform, with a regressor for each coefficient of the effects in order.

        See `Evidence.ordinates`.
        """
        columns = [x for e in effects for x in self._regressors(e)]
        at = spectral_peaks(effects) if peaks is None else tuple(peaks)
        found = ordinates(
            [self.sines, *columns],
            self.dt / self.averaged,
            self.block * self.averaged,
            skip=self.skip,
            per_decade=self.per_decade,
            peaks=at,
        )
        return found.sharing(self._binned.recalled(at, lambda: found))

    @cached_property
    def _binned(self) -> RecentResults[Ordinates]:
        """One for each set of peaks: a searched shape changes the regressors, and no density."""
        return RecentResults(MAX_KEPT_LIKELIHOODS)

    @cached_property
    def _transforms(self) -> dict[Effect, list[Array]]:
        return {}

    def _regressors(self, effect: Effect) -> list[Array]:
        """The sine transforms of an effect's regressors; of a searched shape only the low ones."""
        if not effect.searched():
            known = self._transforms
            if effect not in known:
                known[effect] = [transform(block_means(x, self.block)) for x in self.regressors(effect)]
            return known[effect]
        cells, before = min(MAX_REGRESSOR_CELLS, self.sines.size + 1), 0.5 * self.dt * (self.averaged > 1)
        edges = self.elapsed[0] - before + np.arange(cells + 1) * (self.duration / cells)
        drive = {k: np.interp(edges, self.elapsed, v) for k, v in self.drive.items()}
        return [coarse_transform(x, self.sines.size) for x in effect.regressors(edges, drive)]
