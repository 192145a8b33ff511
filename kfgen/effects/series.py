"""`WhiteSeries`: a channel in white, in which effects that no start value finds look for themselves.

Priors are those of `kfgen.gap.rest.evidence`: sizes and times log-uniform, coefficients log-uniform in
size and of either sign, places uniform over the record or the band.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from kfgen.core.sampling_period import usual_period

if TYPE_CHECKING:
    from kfgen.effects.effect import Effect
    from kfgen.effects.linear_system import LinearSystem

Array = NDArray[np.float64]

DECADES = float(np.log(1e2))
"""Width of the log-uniform prior of a size."""
OF_A_COEFFICIENT = float(2.0 * np.log(1e4))
"""Normalisation of the log-uniform prior of a coefficient of either sign."""
SAME = 1e-9
"""Of the range: distance of values below which they are one."""


@dataclass(frozen=True)
class WhiteSeries:
    """A channel and what the model makes of it.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Time since switch-on [s], samples [SI] less what deterministic effects explain.
    dt : float
        Sampling period [s].
    weight : ndarray, shape (n,)
        ``1 / sqrt(S)`` by cosine ordinate, zero for the constant.
    slow : ndarray, shape (n,)
        Share of the density that is not white, by ordinate.
    nuisance : ndarray, shape (n, q)
        Orthonormal whitened ordinates of the regressors that are in the model.
    level : (mean, standard deviation)
        What is assumed about the logarithm of the noise's level over that of the fit.
    drive : mapping of str to ndarray, shape (n,)
    forms : tuple of Form
        The systems of the slow noise that is in the model.
    wander : (mean, standard deviation)
        As `level`, of the slow noise.
    ends : int
        Samples at either end whose noise a filter in the model keeps from being white.
    """

    t: Array
    y: Array
    dt: float
    weight: Array
    slow: Array
    nuisance: Array
    level: tuple[float, float]
    drive: Mapping[str, Array]
    forms: tuple[LinearSystem, ...] = ()
    wander: tuple[float, float] = (0.0, 1.0)
    ends: int = 0

    @property
    def n(self) -> int:
        """Samples."""
        return int(self.y.size)

    @cached_property
    def omega(self) -> Array:
        """Angular frequencies of the ordinates [rad per sample], shape (n,)."""
        return np.asarray(np.arange(self.n) * (np.pi / self.n), dtype=np.float64)

    @cached_property
    def X(self) -> Array:
        """Whitened cosine ordinates, unit normal deviates under the model, shape (n,).

        Where a filter in the model stops, and nothing is looked at, such deviates are drawn, the same ones each time.
        """
        from scipy.fft import dct

        X = dct(self.y, type=2, norm="ortho") * self.weight
        X = np.asarray(X - self.nuisance @ (self.nuisance.T @ X))
        stopped = np.flatnonzero(self.weight[1:] <= 0.0) + 1
        X[stopped] = np.random.default_rng(0).standard_normal(stopped.size)
        return X

    @cached_property
    def z(self) -> Array:
        """The white series in time, shape (n,); unit normal deviates are drawn over its ends."""
        return self._drawn_over_ends(self.in_time(self.X))

    @cached_property
    def fast(self) -> Array:
        """The white series without its lowest twentieth of frequencies, of unit variance, shape (n,)."""
        low = self.n // 20
        quick = self.in_time(np.where(np.arange(self.n) < low, 0.0, self.X))
        return self._drawn_over_ends(np.asarray(quick / np.sqrt(1.0 - low / self.n)))

    def _drawn_over_ends(self, z: Array) -> Array:
        """The series with unit normal deviates, the same ones each time, where it cannot be white."""
        if self.ends:
            drawn = np.random.default_rng(1).standard_normal((2, self.ends))
            z[: self.ends], z[self.n - self.ends :] = drawn
        return z

    def regression(self, x: Array) -> tuple[float, Array]:
        """On a shape (n,): the coefficient in standard deviations, and the shape's whitened ordinates."""
        from scipy.fft import dct

        u = dct(x - x.mean(), type=2, norm="ortho") * self.weight
        u -= self.nuisance @ (self.nuisance.T @ u)
        size = float(np.linalg.norm(u))
        return float(u @ self.X) / size if size > 0.0 else 0.0, u

    @property
    def driven(self) -> float:
        """What all channels together can explain at most, each by a coefficient [nats]."""
        shapes = [
            u / max(float(np.linalg.norm(u)), 1e-300)
            for u in (self.regression(x)[1] for x in self.drive.values())
        ]
        if not shapes:
            return 0.0
        B = np.array(shapes)
        return 0.5 * float((B @ self.X) @ np.linalg.lstsq(B @ B.T, B @ self.X, rcond=1e-9)[0])

    @staticmethod
    def in_time(X: Array) -> Array:
        """From ordinates to time."""
        from scipy.fft import idct

        return np.asarray(idct(X, type=2, norm="ortho"))

    @cached_property
    def noise(self) -> Array:
        """The white part of the samples [SI], shape (n,): what is left of them without the slow parts."""
        from scipy.fft import dct

        Y = dct(self.y, type=2, norm="ortho") * (1.0 - self.slow)
        return self.in_time(Y)

    @property
    def sd(self) -> float:
        """Standard deviation of the white part of a sample [SI], by the upper half of the band that a filter leaves."""
        passed = self.weight[self.weight > 0.0]
        return 1.0 / float(np.mean(passed[passed.size // 2 :])) if passed.size else 0.0


@dataclass(frozen=True)
class Detection:
    """An effect that was looked for.

    Parameters
    ----------
    effect : Effect
        Where it shows best.
    located : float
        Logarithm of the mean over all places of its likelihood, relative to the best place.
    evidence : float, optional
        Over the model without it [nats], where the effect is no sum of a spectrum or a shape; else a
        fit of it gives that.
    ci95 : mapping
        Intervals of what was looked for, where a fit does not give them.
    """

    effect: Effect
    located: float = 0.0
    evidence: float | None = None
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def log_mean(w: Array) -> float:
    """Logarithm of the mean of ``exp(w)``."""
    top = float(w.max())
    return top + float(np.log(np.mean(np.exp(w - top))))


def coefficient_worth(score: Array) -> Array:
    """Log of the likelihood of one coefficient integrated over its prior; `score` in standard deviations."""
    return np.asarray(
        0.5 * score**2 + 0.5 * np.log(2.0 * np.pi) - np.log(OF_A_COEFFICIENT * np.maximum(np.abs(score), 1.0))
    )


def middle95(at: Array, w: Array) -> tuple[float, float]:
    """The central 95 % of a place, from the logarithms of its weights."""
    p = np.exp(w - w.max())
    share = np.cumsum(p) / p.sum()
    lo, hi = np.searchsorted(share, [0.025, 0.975])
    return float(at[lo]), float(at[min(hi, at.size - 1)])


MIN_VALUES_ROUNDED_TWICE = 16
"""Distinct ones, from which a grid is told that rounding has made uneven: by chance none of 20,000 sets of so many."""
ADC_SAMPLES = 50_000
"""Samples that are looked at for an ADC grid."""
SWIFT = 6.0
"""Standard deviations of the noise by which a sample of a sensor that moves differs from the one before."""
ORDERS = (1, 2, 4, 6, 8)
"""Differences that are looked at: noise survives them all, and fast motion the first alone."""


def noise_of(x: Array) -> float:
    """Standard deviation of the white noise of samples that move, shape (n, ...): the least of several orders of differences."""
    return min(noise_of_differences(np.diff(x, n=k, axis=0), k) for k in ORDERS if k < len(x))


def noise_of_differences(differences: Array, order: int) -> float:
    """Standard deviation of white noise from its differences: those of order k have C(2k, k) times its variance."""
    moved = differences[differences != 0.0]
    spread = float(np.median(np.abs(moved - np.median(moved)))) if moved.size else 0.0
    return 1.4826 * spread / math.sqrt(math.comb(2 * order, order))


class OnGrid(Protocol):
    """Samples on an ADC grid: its step [U], zero without one, and the sampling period [s]."""

    @property
    def adc_step(self) -> float:
        """Distance of neighbouring values [U]."""

    @property
    def dt(self) -> float:
        """Sampling period [s]."""


def adc_step(y: Array) -> float:
    """Step of the ADC grid of samples, zero where they lie on none.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].

    Returns
    -------
    float
        Distance of neighbouring values [SI].
    """
    values = np.unique(y[:ADC_SAMPLES])
    # Values that are computed differ in their last digits.
    distinct = np.diff(values) > SAME * float(np.ptp(values))
    values = values[np.concatenate([[True], distinct])]
    if values.size < 2 or values.size > 0.5 * min(y.size, ADC_SAMPLES):
        return 0.0
    steps = np.diff(values)
    step = float(steps.min())
    off = np.abs(steps / step - np.round(steps / step))
    return step if float(np.mean(off < 0.05)) > 0.95 else _twice_rounded_step(values)


def _twice_rounded_step(values: Array) -> float:
    """Step of a grid whose values were rounded again, as to three digits of another unit; zero for none.

    Values that lie anywhere are within a quarter of a step of some grid as often as not.
    """
    steps = np.diff(values)
    whole = np.round(steps / float(np.median(steps)))
    if values.size < MIN_VALUES_ROUNDED_TWICE or float(np.mean(whole == 0.0)) > 0.05:
        return 0.0
    code = np.concatenate([[0.0], np.cumsum(whole)])
    step, first = np.polyfit(code, values, 1)
    off = np.abs(values - first - step * code) / step
    return float(step) if float(np.mean(off < 0.25)) > 0.95 else 0.0


@dataclass(frozen=True)
class RawSamples:
    """A channel as it was logged, before any model.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Time stamps [s] as they are, samples [SI].
    assumed : float
        Standard deviation of the white part of a sample that the model assumes [SI].
    stated : float
        How long the log says that it lasted [s], beside its times; zero where it does not.
    moves : bool
        Whether the sensor moved: differences between neighbours are then of its motion too.
    """

    t: Array
    y: Array
    assumed: float
    stated: float = 0.0
    moves: bool = False

    @property
    def n(self) -> int:
        """Samples."""
        return int(self.y.size)

    @cached_property
    def dt(self) -> float:
        """The usual step of time [s]."""
        return usual_period(self.t)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a sample's white part [SI], from differences between neighbours that are not equal."""
        if self.moves:
            return noise_of(self.y)
        steps = np.diff(self.y)
        moved = steps[steps != 0.0]
        middle = float(np.median(np.abs(moved))) if moved.size else 0.0
        return 1.4826 * middle / float(np.sqrt(2.0))

    @cached_property
    def chance_of_equals(self) -> float:
        """That two neighbours are equal on the ADC grid: of normal deviates ``q / (2 sqrt(pi) s)``."""
        return float(self.adc_step / (2.0 * np.sqrt(np.pi) * max(self.noise, 1e-300)))

    @cached_property
    def still(self) -> NDArray[np.bool_] | None:
        """Of a sensor that moves, the steps about which it does not move for sure, shape (n - 1,)."""
        if not self.moves:
            return None
        about = np.abs(self.y[3:] - self.y[:-3]) > 3.0 * (SWIFT * self.noise + self.adc_step)
        return ~np.concatenate([[False], about, [False]])

    @cached_property
    def steps(self) -> tuple[float, float]:
        """Mean square of the steps to the next sample and to the one after it [SI]."""
        one, two = (float(np.mean((self.y[k:] - self.y[:-k]) ** 2)) for k in (1, 2))
        return one, two

    @cached_property
    def adc_step(self) -> float:
        """Distance of neighbouring values [SI], zero where they lie on no ADC grid."""
        return adc_step(self.y)


@dataclass(frozen=True)
class DetectedFault:
    """A fault: the effect, how many samples show it, whether a fit would be meaningless."""

    effect: Effect
    samples: float
    spoils: bool = False


def periods(t: Array, dt: float) -> Array:
    """Whole periods from each time stamp to the next, at least one, shape (n - 1,).

    A long step beside a short one is jitter; a sample is missing where the three steps about it are long together.
    """
    d = np.diff(t) / dt
    whole = np.maximum(np.round(d), 1.0)
    three = np.convolve(np.concatenate([[1.0], d, [1.0]]), np.ones(3), "valid")
    beside = np.concatenate([[1.0], whole[:-1]]) + np.concatenate([whole[1:], [1.0]])
    return np.where(whole > 1.0, np.clip(np.round(three - beside), 1.0, whole), whole)
