"""Effects that begin at a time or hit single samples: step of the bias, change of the noise, outliers.

References
----------
.. [1] A. S. Willsky and H. L. Jones, A generalized likelihood ratio approach to the detection and estimation
   of jumps in linear systems, IEEE Trans. Automatic Control 21(1), 1976 (here integrated over the onset).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import AddsNothingAtRest, LinearProcess, parameter
from kfgen.effects.filter_role import (
    FilterPlace,
    FilterRole,
    LinearStates,
    NoiseFactor,
    NotModelled,
    SampleVariance,
)
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.samples.mixture import Mixture, chance_of_wide
from kfgen.effects.series import DECADES, Detection, WhiteSeries, coefficient_worth, log_mean, middle95

Array = NDArray[np.float64]

EDGE_MARGIN_SAMPLES = 8
"""Samples at either end at which no event is looked for."""
MAX_LEVEL_STEPS = 60
LEVEL_TOLERANCE = 1e-9
"""Step in the logarithm of a level at which it is the most probable one."""
MAX_DEVIATION_ITERATIONS = 100
"""Of the noise that is estimated beside outliers."""
DEVIATION_TOLERANCE = 1e-6
"""Relative change of its standard deviation at which that ends."""


@dataclass(frozen=True)
class BiasStep(LinearProcess):
    """A jump of the bias by `size` at `time` since the first sample: a one-off."""

    size: Any = parameter("U", "signed")
    time: Any = parameter("s", "place")

    name: ClassVar[str] = "bias_step"
    title: ClassVar[str] = "step of the bias"
    separating_experiment: ClassVar[str] = "a second record, for a step does not come again"
    sentence_template: ClassVar[str] = "jumps by {size} at {time}"
    repeatable: ClassVar[bool] = True

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """A constant; when it jumps, a filter's variance of it should grow by ``size^2`` [1]_."""
        return LinearSystem(A=((0,),), W=((0,),), C=(1,), x0=(0,), states=(State("bias", shared=True),))

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The next jump may come at any time: a random walk of its spread, one such jump in the time that this one took."""
        density = float(self.size) ** 2 / max(float(self.time), 1.0)
        return LinearStates(replace(self.form(), W=((density,),)))

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """``size`` from `time` on."""
        return np.where(np.asarray(t) >= self.time, float(self.size), 0.0)

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Every sample as its onset, by one transform: products of all steps with the white series."""
        from scipy.fft import dst

        n = series.n
        half = 2.0 * np.sin(0.5 * series.omega[1:])

        def product(X: Array) -> Array:
            return np.asarray(-np.sqrt(0.5 / n) * dst(X[1:] * series.weight[1:] / half, type=1))

        power = np.concatenate([[0.0], (series.weight[1:] / half) ** 2])
        energy = (power.sum() - np.fft.fft(power).real[1:]) / n
        for q in series.nuisance.T:
            energy = energy - product(q) ** 2
        margin = max(EDGE_MARGIN_SAMPLES, series.ends)
        keep = slice(margin, n - 1 - margin)
        size = product(series.X)[keep] / np.maximum(energy[keep], 1e-9 * energy.max())
        w = coefficient_worth(size * np.sqrt(np.maximum(energy[keep], 0.0)))
        k = int(np.argmax(w))
        at = series.t[1:][keep]
        effect = cls(float(size[k]), float(at[k]))
        return [Detection(effect, log_mean(w) - float(w[k]), ci95={"time": middle95(at, w)})]


def _at_its_level(power: Array, count: Array, mean: float, sd: float) -> Array:
    """The log-likelihood of noise at the most probable logarithm x of its level [nats], shape (k,).

    It is the most of ``-m x - S exp(-2 x) / 2 - (x - mean)^2 / 2 sd^2``, less its share that all levels have. Newton's
    steps from below, where the slope is convex, never go too far.

    Parameters
    ----------
    power, count : ndarray, shape (k,)
        Sums of squares S of so many samples m.
    mean, sd : float
        Of what is assumed about x.
    """
    x = np.minimum(0.5 * np.log(power / count), mean)
    for _ in range(MAX_LEVEL_STEPS):
        inside = power * np.exp(-2.0 * x)
        step = (inside - count - (x - mean) / sd**2) / (2.0 * inside + 1.0 / sd**2)
        x = x + step
        if np.abs(step).max() < LEVEL_TOLERANCE:
            break
    misfit = 0.5 * power * np.exp(-2.0 * x) - 0.5 * count
    return np.asarray(-count * x - misfit - 0.5 * ((x - mean) / sd) ** 2)


@dataclass(frozen=True)
class NoiseChange(AddsNothingAtRest):
    """White noise whose standard deviation grows by the factor `ratio` at `time` since the first sample."""

    ratio: Any = parameter("", "ratio")
    time: Any = parameter("s", "place")

    name: ClassVar[str] = "noise_change"
    title: ClassVar[str] = "change of the noise's level"
    separating_experiment: ClassVar[str] = "a second record"
    sentence_template: ClassVar[str] = "has noise that grows by a factor of {ratio} at {time}"
    changes_samples: ClassVar[bool] = True

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The level that it has from now on."""
        return NoiseFactor(self.ratio**2)

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Every sample as its onset, by the sums of squares before and after."""
        square = np.cumsum(series.fast**2)
        n, total = series.n, float(square[-1])
        k = np.arange(10 * EDGE_MARGIN_SAMPLES, n - 10 * EDGE_MARGIN_SAMPLES)
        if k.size < 2:
            return []
        before, after = square[k] / (k + 1), (total - square[k]) / (n - 1 - k)
        mean, sd = series.level
        # The prior is of the noise before the change; without a change of all of it.
        whole = _at_its_level(np.array([total]), np.array([float(n)]), mean, sd)[0]
        parts = _at_its_level(square[k], np.asarray(k + 1.0, dtype=np.float64), mean, sd) - 0.5 * (
            n - 1 - k
        ) * np.log(after)
        spread = np.sqrt(0.5 / (k + 1) + 0.5 / (n - 1 - k))
        w = parts - whole + 0.5 * np.log(2.0 * np.pi) + np.log(spread / (2.0 * DECADES))
        best = int(np.argmax(w))
        ratio = float(np.sqrt(after[best] / before[best]))
        wide = 1.96 * float(spread[best])
        at = series.t[1:][k]
        ci95 = {
            "ratio": (ratio * float(np.exp(-wide)), ratio * float(np.exp(wide))),
            "time": middle95(at, w),
        }
        return [Detection(cls(ratio, float(at[best])), 0.0, log_mean(w), ci95)]

    def removed_from(self, series: WhiteSeries) -> Array:
        """The white part after the change brought to the level before it."""
        late = series.t >= self.time
        return np.where(late, series.y - series.noise * (1.0 - 1.0 / float(self.ratio)), series.y)

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """Steps between samples grow as the noise does; where it shrinks, slow parts shrink with it."""
        late = np.asarray(t) >= self.time
        sd = float(np.sqrt(0.5 * np.mean(np.diff(y) ** 2)))
        if self.ratio >= 1.0:
            more = sd * float(np.sqrt(self.ratio**2 - 1.0)) * rng.standard_normal(y.size)
            return np.where(late, y + more, y)
        return np.where(late, y.mean() + (y - y.mean()) * float(self.ratio), y)


@dataclass(frozen=True)
class Outliers(AddsNothingAtRest):
    """A `share` of the samples carries an error of standard deviation `sigma` beside the noise."""

    share: Any = parameter("", "ratio")
    sigma: Any = parameter("U", "size")

    name: ClassVar[str] = "outliers"
    title: ClassVar[str] = "outliers"
    separating_experiment: ClassVar[str] = "a longer record"
    sentence_template: ClassVar[str] = "has outliers of {sigma} in a share of {share}"
    changes_samples: ClassVar[bool] = True

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Of an input the variance of the mixture; what a filter expects it refuses by its gate, and R stays that of the rest."""
        if place.measured:
            return NotModelled("the gate refuses them", "Set the gate of the sensor, in standard deviations")
        return SampleVariance(self.share * self.sigma**2)

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """A mixture of two normal laws against one, by the histogram of the white series."""
        found = Mixture.fitted(series.z, series.level)
        if not found or found.is_the_noise or found.is_at_one_place(series.z):
            return []
        return [cls.of(found, series.sd)]

    @classmethod
    def of(cls, mixture: Mixture, sd: float) -> Detection:
        """From a mixture that was fitted to a series, with the 95 % intervals of share and sigma.

        Parameters
        ----------
        mixture : Mixture
        sd : float
            What one of that series is [U].

        Returns
        -------
        Detection
        """
        size = float(np.sqrt(mixture.kappa**2 - 1.0)) * sd * mixture.level
        half = np.minimum(1.96 * mixture.spread, 300.0)
        lo, hi = np.exp(-half), np.exp(half)
        ci95 = {
            "share": (mixture.share * float(lo[1]), mixture.share * float(hi[1])),
            "sigma": (size * float(lo[2]), size * float(hi[2])),
        }
        return Detection(cls(mixture.share, size), 0.0, mixture.evidence, ci95)

    def chance(self, noise: Array, sd: float) -> Array:
        """Probability of each sample to be one, shape (n,).

        Parameters
        ----------
        noise : ndarray, shape (n,)
            White noise with outliers [U].
        sd : float
            Standard deviation of the noise without them [U].

        Returns
        -------
        ndarray, shape (n,)
        """
        return chance_of_wide(noise / sd, float(self.share), float(np.hypot(1.0, self.sigma / sd)))

    def deviation_between(self, noise: Array) -> float:
        """Standard deviation of the samples that are none [U], by expectation and maximisation.

        Parameters
        ----------
        noise : ndarray, shape (n,)
            White noise with outliers [U].
        """
        sd = float(np.sqrt(np.mean(noise**2)))
        for _ in range(MAX_DEVIATION_ITERATIONS):
            none = 1.0 - self.chance(noise, sd)
            before, sd = sd, float(np.sqrt((none @ noise**2) / none.sum()))
            if abs(sd - before) < DEVIATION_TOLERANCE * before:
                break
        return sd

    def removed_from(self, series: WhiteSeries) -> Array:
        """The samples with those that are outliers drawn anew from the noise: a draw from their posterior."""
        rng, noise = np.random.default_rng(series.n), series.sd * series.z
        sd = self.deviation_between(noise)  # the series is scaled by the size that outliers give it
        hit = rng.random(series.n) < self.chance(noise, sd)
        return np.where(hit, series.y - noise + sd * rng.standard_normal(series.n), series.y)

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """Some samples, drawn at random, with their error."""
        hit = rng.random(y.size) < float(self.share)
        return np.asarray(y + hit * float(self.sigma) * rng.standard_normal(y.size))
