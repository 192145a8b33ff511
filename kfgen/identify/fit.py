"""Maximum likelihood over the parameters of a set of effects.

Sizes and times are fitted in their logarithm, inside a box that the record can speak about;
coefficients of deterministic effects are linear and solved for inside the likelihood. Priors
(mean and deviation of a logarithm) may hold trusted numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, Look
from kfgen.identify.allan import AllanCurve, allan_curve, octave_factors
from kfgen.identify.whittle import (
    Fitted,
    Ordinates,
    density_of_differences,
    log_likelihood,
    ordinates,
    sensitivity,
)

Array = NDArray[np.float64]

NUDGE = 1e-5
"""Step in a logarithm over which a density is differentiated."""

Key = tuple[int, str]
"""A parameter: index of its effect, name."""


def is_linear(effect: type[Effect] | Effect) -> bool:
    """Whether the effect is deterministic with one signed coefficient: a regressor."""
    estimated = effect.estimated()
    return len(estimated) == 1 and estimated[0].kind == "signed"


@dataclass(frozen=True)
class Record:
    """One evenly sampled channel with its drivers.

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
    """

    t: Array
    y: Array
    drive: Mapping[str, Array] = field(default_factory=dict)
    block: int = 1
    skip: tuple[tuple[float, float], ...] = ()

    @cached_property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float(self.t[-1] - self.t[0]) / (self.t.size - 1)

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.dt * self.t.size

    def ordinates(self, effects: Sequence[Effect]) -> Ordinates:
        """The binned transform, with a regressor for each deterministic effect in order."""
        unit = [
            replace(e, **{e.estimated()[0].name: 1.0}).mean(self.t, self.drive)
            for e in effects
            if is_linear(e)
        ]
        return ordinates(self.y, self.dt, self.block, unit, skip=self.skip)

    @cached_property
    def curve(self) -> AllanCurve:
        """Its overlapping Allan deviation."""
        return allan_curve(self.y, self.dt)

    @cached_property
    def octaves(self) -> AllanCurve:
        """Its overlapping Allan deviation at octaves: nearly independent points."""
        return allan_curve(self.y, self.dt, octave_factors(self.y.size))

    @cached_property
    def look(self) -> Look:
        """What effects guess their start values from; only drivers that change are shown."""
        means = {k: float(np.mean(v)) for k, v in self.drive.items() if np.ptp(v) > 0.0}
        return Look(self.curve.tau, self.curve.deviation, self.dt, self.duration, means)

    def box(self, kind: str) -> tuple[float, float]:
        """Bounds of the logarithm of a parameter of that kind."""
        if kind == "time":
            step = self.dt * self.block
            return float(np.log(5.0 * step)), float(np.log(max(0.5 * self.duration, 10.0 * step)))
        scale = float(np.std(self.y)) or 1.0
        return float(np.log(1e-9 * scale)), float(np.log(1e4 * scale * max(1.0, self.duration)))


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
    likelihood : Fitted
        Likelihood alone, with the coefficients of the regressors.
    free : tuple of Key
        Parameters that were fitted in their logarithm.
    point : ndarray, shape (k,)
        Their logarithms.
    """

    effects: tuple[Effect, ...]
    value: float
    likelihood: Fitted
    free: tuple[Key, ...]
    point: Array


@dataclass(frozen=True)
class Problem:
    """What is fitted: a record, effects with start values, priors, and fixed parameters."""

    record: Record
    effects: tuple[Effect, ...]
    priors: Mapping[Key, Prior] = field(default_factory=dict)
    fixed: frozenset[Key] = frozenset()

    @cached_property
    def data(self) -> Ordinates:
        """The transform of the record for these effects."""
        return self.record.ordinates(self.effects)

    @cached_property
    def free(self) -> tuple[Key, ...]:
        """The parameters fitted in their logarithm."""
        return tuple(
            (i, p.name)
            for i, e in enumerate(self.effects)
            if not is_linear(e)
            for p in e.estimated()
            if (i, p.name) not in self.fixed
        )

    @cached_property
    def bounds(self) -> list[tuple[float, float]]:
        """The box of the free parameters."""
        kinds = [{p.name: p.kind for p in self.effects[i].parameters()}[name] for i, name in self.free]
        return [self.record.box(kind) for kind in kinds]

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

    def objective(self, point: Array) -> float:
        """Minus log-likelihood minus log prior."""
        value = log_likelihood(self.data, self.at(point)).value
        value += sum(
            prior.log_density(float(point[self.free.index(key)]))
            for key, prior in self.priors.items()
            if key in self.free
        )
        return -value

    def gradient(self, point: Array) -> Array:
        """Derivative of `objective`; the coefficients of regressors stand at their best."""
        effects = self.at(point)
        slope = sensitivity(self.data, effects, log_likelihood(self.data, effects).coefficients)
        g = np.array([-float(slope @ self._density_slope(effects[i], name)) for i, name in self.free])
        for k, key in enumerate(self.free):
            if key in self.priors:
                prior = self.priors[key]
                g[k] += (float(point[k]) - prior.mean) / prior.deviation**2
        return g

    def _density_slope(self, effect: Effect, name: str) -> Array:
        """Derivative of an effect's density with respect to the logarithm of a parameter, shape (m,)."""
        data, value = self.data, float(getattr(effect, name))
        up, down = (
            density_of_differences(
                [replace(effect, **{name: value * float(np.exp(h))})], data.omega, data.dt, data.block
            )
            for h in (NUDGE, -NUDGE)
        )
        return np.asarray((up - down) / (2.0 * NUDGE))

    def pin(self, key: Key, value: float) -> Problem:
        """The same with one parameter held at `value` [SI]."""
        effects = list(self.effects)
        effects[key[0]] = replace(effects[key[0]], **{key[1]: value})
        pinned = replace(self, effects=tuple(effects), fixed=self.fixed | {key})
        pinned.__dict__["data"] = self.data
        return pinned

    def starting(self, effects: tuple[Effect, ...]) -> Problem:
        """The same from other start values."""
        moved = replace(self, effects=effects)
        moved.__dict__["data"] = self.data
        return moved


def maximise(problem: Problem) -> Fit:
    """The maximum from the problem's start values."""
    from scipy.optimize import minimize

    point = problem.start()
    if point.size:
        options = {"maxiter": 200, "ftol": 1e-15, "gtol": 1e-4}
        result = minimize(
            problem.objective,
            point,
            jac=problem.gradient,
            method="L-BFGS-B",
            bounds=problem.bounds,
            options=options,
        )
        point = np.asarray(result.x)
    effects = problem.at(point)
    likelihood = log_likelihood(problem.data, effects)
    effects = _with_coefficients(effects, likelihood.coefficients)
    return Fit(effects, -problem.objective(point), likelihood, problem.free, point)


def _with_coefficients(effects: tuple[Effect, ...], coefficients: Array) -> tuple[Effect, ...]:
    values = iter(coefficients.tolist())
    return tuple(replace(e, **{e.estimated()[0].name: next(values)}) if is_linear(e) else e for e in effects)


def curvature(problem: Problem, point: Array, step: float = 1e-3) -> Array:
    """Second derivatives of the objective in the logarithms, shape (k, k), by central differences."""
    k = point.size
    H = np.zeros((k, k))
    offsets = step * np.eye(k)
    f0 = problem.objective(point)
    for i in range(k):
        for j in range(i + 1):
            if i == j:
                up, down = problem.objective(point + offsets[i]), problem.objective(point - offsets[i])
                H[i, i] = (up - 2.0 * f0 + down) / step**2
            else:
                a, b = offsets[i] + offsets[j], offsets[i] - offsets[j]
                H[i, j] = H[j, i] = (
                    problem.objective(point + a)
                    - problem.objective(point + b)
                    - problem.objective(point - b)
                    + problem.objective(point - a)
                ) / (4.0 * step**2)
    return H


def profile(problem: Problem, best: Fit, key: Key, value: float) -> Fit:
    """The best fit with one parameter held at `value` [SI]."""
    return maximise(problem.starting(best.effects).pin(key, value))
