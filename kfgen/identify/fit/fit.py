"""Maximum likelihood over the parameters of a set of effects.

Sizes and times are fitted in their logarithm, inside a box that the record can speak about;
coefficients of deterministic effects are linear and solved for inside the likelihood. Priors
(mean and standard deviation of a logarithm) may hold trusted numbers.

The maximum is found by Fisher's scoring: Newton's step with the expected information in place of the
second derivatives, damped as Levenberg and Marquardt do, scaled by the curvature along the last step.

References
----------
.. [1] R. I. Jennrich and P. F. Sampson, Newton-Raphson and related algorithms for maximum likelihood
   variance component estimation, Technometrics 18(1), 1976.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.recent_results import RecentResults
from kfgen.core.time_budget import fit_is_over
from kfgen.effects import Effect
from kfgen.identify.evidence.likelihood import Likelihood
from kfgen.identify.evidence.record import MIN_TIME_IN_STEPS, Evidence
from kfgen.identify.evidence.shapes import RECENT, Key
from kfgen.identify.evidence.whittle import SpectralFit

Array = NDArray[np.float64]

__all__ = ["Fit", "Key", "Prior", "Problem", "curvature", "inverse", "maximise", "profile"]

MAX_ITERATIONS = 80
GAIN_TOLERANCE_NATS = 1e-7
"""Gain of log-likelihood [nats] below which the maximum is reached."""
GAIN_TOLERANCE_OF_PROFILE_NATS = 1e-3
"""The same where the likelihood is only compared with its maximum, a chi-square below."""
MIN_CURVATURE_SHARE = 1e-3
"""Of the expected information: the least curvature that counts."""
MAX_LOG_STEP = 1.5
"""Longest step in a logarithm."""
MAX_TIME_OVER_RECORD = 0.5
"""Of the record: the longest time that is fitted."""
PRIOR_REACH_DEVIATIONS = 3.0
"""Standard deviations about an assumed number that a fit may go to, whatever the record can show."""
LOG_STEP_OF_DERIVATIVE = 1e-4
"""Step in a logarithm over which a likelihood is differentiated where it has no slope of its own."""


@dataclass(frozen=True)
class Prior:
    """A Gaussian prior on the logarithm of a parameter."""

    mean: float
    deviation: float

    def log_density(self, value: float) -> float:
        """Without its constant: zero at the mean."""
        return -0.5 * ((value - self.mean) / self.deviation) ** 2


@dataclass(frozen=True)
class Fit:
    """A fitted set of effects.

    Parameters
    ----------
    effects : tuple of Effect
        With the fitted values.
    value : float
        Log-likelihood plus log prior at the maximum.
    likelihood : SpectralFit
        Likelihood alone, with the coefficients of the regressors.
    free : tuple of Key
        Parameters that were fitted in their logarithm.
    point : ndarray, shape (k,)
        Their logarithms.
    """

    effects: tuple[Effect, ...]
    value: float
    likelihood: SpectralFit
    free: tuple[Key, ...]
    point: Array


@dataclass(frozen=True)
class Problem:
    """What is fitted: evidence, effects with start values, priors, and fixed parameters.

    `times` bounds those of an effect (by its index) to a share of the record and to so many periods: half the
    record and `kfgen.identify.evidence.record.MIN_TIME_IN_STEPS` otherwise.
    """

    record: Evidence
    effects: tuple[Effect, ...]
    priors: Mapping[Key, Prior] = field(default_factory=dict)
    fixed: frozenset[Key] = frozenset()
    times: Mapping[int, tuple[float, float]] = field(default_factory=dict)

    def data(self, effects: tuple[Effect, ...]) -> Likelihood:
        """The likelihood with the regressors of these effects."""
        return self.record.likelihood(effects)

    @cached_property
    def free(self) -> tuple[Key, ...]:
        """The parameters fitted in their logarithm."""
        return tuple(
            (i, p.name)
            for i, e in enumerate(self.effects)
            for p in e.searched()
            if (i, p.name) not in self.fixed
        )

    @cached_property
    def bounds(self) -> list[tuple[float, float]]:
        """The box of the free parameters: what the record can show, and what is assumed about them."""
        return [self.box(key) for key in self.free]

    def box(self, key: Key) -> tuple[float, float]:
        """Logarithms between which a parameter is looked for."""
        i, name = key
        declared = self.effects[i].range_of(name)
        if declared is None:
            kind = {p.name: p.kind for p in self.effects[i].parameters()}[name]
            lo, hi = self.record.box(kind, *self.times.get(i, (MAX_TIME_OVER_RECORD, MIN_TIME_IN_STEPS)))
        else:
            lo, hi = np.log(declared).tolist()
        hi = max(min(hi, self.ceiling(key)), lo)
        prior = self.priors.get(key)
        if prior is None:
            return lo, hi
        reach = PRIOR_REACH_DEVIATIONS * prior.deviation
        most = max(self.ceiling(key), prior.mean)  # however wide the interval that a file states
        return min(lo, prior.mean - reach), max(hi, min(prior.mean + reach, most))

    def reach(self, key: Key) -> tuple[float, float]:
        """Logarithms between which the ends of an interval are looked for: the box, or from the first of declared ranges on."""
        ranges = self.effects[key[0]].ranges(key[1])
        return (float(np.log(ranges[0][0])), self.ceiling(key)) if ranges else self.box(key)

    def ceiling(self, key: Key) -> float:
        """Logarithm of the largest value of a parameter that the ADC grid of the samples allows."""
        most = self.effects[key[0]].ceiling(key[1], self.record)
        return float(np.log(most)) if most > 0.0 else -np.inf

    def start(self) -> Array:
        """Logarithms of the start values, inside the box."""
        point = [np.log(max(float(getattr(self.effects[i], name)), 1e-300)) for i, name in self.free]
        return np.array([min(max(p, lo), hi) for p, (lo, hi) in zip(point, self.bounds)])

    def at(self, point: Array) -> tuple[Effect, ...]:
        """The effects with these logarithms as values."""
        effects = list(self.effects)
        for (i, name), value in zip(self.free, point):
            effects[i] = replace(effects[i], **{name: float(np.exp(value))})
        return tuple(effects)

    @cached_property
    def _recent(self) -> RecentResults[tuple[tuple[Effect, ...], Likelihood]]:
        """A fit asks for the value, the slope and the information at one point."""
        return RecentResults(RECENT)

    def measured(self, point: Array) -> tuple[tuple[Effect, ...], Likelihood]:
        """The effects with these logarithms as values, and their likelihood.

        Parameters
        ----------
        point : ndarray, shape (k,)
            Logarithms of the free parameters.
        """

        def compute() -> tuple[tuple[Effect, ...], Likelihood]:
            effects = self.at(point)
            return effects, self.data(effects)

        return self._recent.recalled(point.tobytes(), compute)

    def objective(self, point: Array) -> float:
        """Minus log-likelihood minus log prior."""
        effects, data = self.measured(point)
        value = data.log_likelihood(effects).value
        for key, prior in self.priors.items():
            if key in self.free:
                value += prior.log_density(float(point[self.free.index(key)]))
        return -value

    def gradient(self, point: Array) -> Array:
        """Derivative of `objective`; the coefficients of regressors stand at their best."""
        effects, data = self.measured(point)
        g = -data.slope(effects, self.free)
        for k, (i, _) in enumerate(self.free):
            if effects[i].coefficients():  # the shape of a regressor
                up, down = (
                    point + h * np.eye(point.size)[k]
                    for h in (LOG_STEP_OF_DERIVATIVE, -LOG_STEP_OF_DERIVATIVE)
                )
                g[k] = (self.objective(up) - self.objective(down)) / (2.0 * LOG_STEP_OF_DERIVATIVE)
        for k, key in enumerate(self.free):
            if key in self.priors:
                prior = self.priors[key]
                g[k] += (float(point[k]) - prior.mean) / prior.deviation**2
        return np.where(np.isfinite(g), g, 0.0)  # beside parameters at which no number comes out

    def information(self, point: Array) -> Array:
        """Expected second derivative of `objective`, shape (k, k)."""
        effects, data = self.measured(point)
        J = data.information(effects, self.free)
        for k, key in enumerate(self.free):
            if effects[key[0]].coefficients():
                J[k, k] = self._sharpness(point, k)
            if key in self.priors:
                J[k, k] += 1.0 / self.priors[key].deviation ** 2
        return J

    def _sharpness(self, point: Array, k: int) -> float:
        """Second derivative in the shape of a regressor; at least a weak one, so that steps stay short."""
        h = 10.0 * LOG_STEP_OF_DERIVATIVE * np.eye(point.size)[k]
        centre = self.objective(point)
        second = self.objective(point + h) - 2.0 * centre + self.objective(point - h)
        return max(abs(second) / (10.0 * LOG_STEP_OF_DERIVATIVE) ** 2, 1.0)

    def pin(self, key: Key, value: float) -> Problem:
        """The same with one parameter held at `value` [SI].

        Parameters
        ----------
        key : Key
            Index of the effect, name of its parameter.
        value : float
            At which it is held [SI].
        """
        effects = list(self.effects)
        effects[key[0]] = replace(effects[key[0]], **{key[1]: value})
        return replace(self, effects=tuple(effects), fixed=self.fixed | {key})

    def starting(self, effects: tuple[Effect, ...]) -> Problem:
        """The same from other start values."""
        return replace(self, effects=effects)


def maximise(problem: Problem, tolerance_nats: float = GAIN_TOLERANCE_NATS) -> Fit:
    """The maximum from the problem's start values.

    Parameters
    ----------
    problem : Problem
        What is fitted.
    tolerance_nats : float
        Gain of log-likelihood [nats] below which the maximum is reached.
    """
    point = problem.start()
    return _fit_at(problem, _scored(problem, point, tolerance_nats) if point.size else point)


def as_it_stands(problem: Problem) -> Fit:
    """The problem's start values as a fit, with the coefficients of the regressors at their best.

    Parameters
    ----------
    problem : Problem
        What is fitted.
    """
    return _fit_at(problem, problem.start())


def _fit_at(problem: Problem, point: Array) -> Fit:
    effects, data = problem.measured(point)
    likelihood = data.log_likelihood(effects)
    effects = _with_coefficients(effects, likelihood.coefficients)
    return Fit(effects, -problem.objective(point), likelihood, problem.free, point)


def _scored(problem: Problem, point: Array, tolerance_nats: float) -> Array:
    """Damped scoring inside the box."""
    lo, hi = np.array(problem.bounds).T
    value, damping = problem.objective(point), 1e-3
    g, J = problem.gradient(point), problem.information(point)
    for _ in range(MAX_ITERATIONS):
        if fit_is_over():
            break
        held = ((point <= lo) & (g > 0.0)) | ((point >= hi) & (g < 0.0))
        step = _step(g, J, ~held, damping)
        trial = np.clip(point + step, lo, hi)
        found = problem.objective(trial)
        expected = -float(g @ (trial - point))
        if found < value:
            moved = trial - point
            gain, point, value, damping = value - found, trial, found, max(damping / 8.0, 1e-9)
            if gain < tolerance_nats and expected < 10.0 * tolerance_nats:
                break
            before, g = g, problem.gradient(point)
            J = _seen(problem.information(point), moved, g - before)
        else:
            if expected < tolerance_nats:
                break
            damping = max(8.0 * damping, 1e-3)
            if damping > 1e12:
                break
    return point


def _seen(J: Array, moved: Array, change: Array) -> Array:
    """The information, scaled by the curvature that was seen along the last step where that was smaller.

    Where the data are not of the model, the expected information may be far above the curvature of their likelihood, and its
    steps far too short.
    """
    seen, expected = float(change @ moved), float(moved @ J @ moved)
    if not (expected > 0.0 and np.isfinite(seen)):
        return J
    return J * min(max(seen / expected, MIN_CURVATURE_SHARE), 1.0)


def _step(g: Array, J: Array, free: NDArray[np.bool_], damping: float) -> Array:
    step = np.zeros(g.size)
    if free.any() and np.isfinite(g).all() and np.isfinite(J).all():
        K = J[np.ix_(free, free)]
        scale = np.sqrt(np.maximum(np.diag(K), 1e-8))
        K = K / np.outer(scale, scale) + damping * np.eye(scale.size)
        step[free] = -np.linalg.lstsq(K, g[free] / scale, rcond=1e-14)[0] / scale
        step *= min(1.0, MAX_LOG_STEP / max(float(np.abs(step).max()), 1e-300))
    return step


def _with_coefficients(effects: tuple[Effect, ...], coefficients: Array) -> tuple[Effect, ...]:
    values = iter(coefficients.tolist())
    return tuple(
        e.solved([next(values) for _ in e.coefficients()]) if e.coefficients() else e for e in effects
    )


def inverse(J: Array) -> Array:
    """The covariance of logarithms from their information, shape (k, k); large where there is little, zero where there is none."""
    scale = np.sqrt(np.maximum(np.diag(J), 1e-8))
    scaled = np.linalg.pinv(J / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    return np.asarray(scaled / np.outer(scale, scale))


def curvature(problem: Problem, point: Array, step: float = 1e-3) -> Array:
    """Second derivatives of the objective in the logarithms, shape (k, k), by central differences of the first.

    Parameters
    ----------
    problem : Problem
        What is fitted.
    point : ndarray, shape (k,)
        Logarithms of the free parameters.
    step : float
        Of the differences, in logarithms.
    """
    offsets = step * np.eye(point.size)
    rows = [problem.gradient(point + h) - problem.gradient(point - h) for h in offsets]
    H = np.array(rows).reshape(point.size, point.size) / (2.0 * step)
    return np.asarray(0.5 * (H + H.T))


def profile(problem: Problem, best: Fit, key: Key, value: float) -> Fit:
    """The best fit with one parameter held at `value` [SI].

    Parameters
    ----------
    problem : Problem
        What is fitted.
    best : Fit
        Its maximum.
    key : Key
        Index of the effect, name of its parameter.
    value : float
        At which it is held [SI].
    """
    return maximise(problem.starting(best.effects).pin(key, value), GAIN_TOLERANCE_OF_PROFILE_NATS)
