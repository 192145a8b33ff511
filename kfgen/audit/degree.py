"""How well each state shows: the covariance along a manoeuvre, with the noise of the model.

In units of the priors the covariance starts as the identity. ``P' = F P + P F' + G W G'`` is stepped exactly for the
rates of each step; the samples of a step act as one of their mean, with its variance.

References
----------
.. [1] A. Gelb (ed.), Applied Optimal Estimation, 1974, sec. 4.3.
.. [2] F. M. Ham, R. G. Brown, Observability, eigenvalues, and Kalman filtering, IEEE TAES 19(2), 1983.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.linear import van_loan
from kfgen.core.numbers import is_sampling_rate
from kfgen.manoeuvre.flight import Flight
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel

Array = NDArray[np.float64]

MAX_STEPS = 600
"""Steps of a covariance run."""
MAX_STEPS_OF_FAST_MODELS = 6000
"""The same where a time constant is shorter than a step: its samples must not act as one of their mean."""
PRACTICAL = 0.9
"""Share of its prior that a state keeps which does not show in practice."""


MIN_DURATION_S, MAX_DURATION_S = 1e-6, 1e7
"""Length of a covariance run."""


@dataclass(frozen=True)
class Horizon:
    """How long and how fast is measured.

    Parameters
    ----------
    duration : float, optional
        [s]; the length of each manoeuvre where it is left out.
    rate : float
        Samples of every sensor [Hz].
    """

    duration: float | None = None
    rate: float = 100.0

    def __post_init__(self) -> None:
        if self.duration is not None and not MIN_DURATION_S <= self.duration <= MAX_DURATION_S:
            raise InputError(
                f"a duration of {self.duration:g} s is no length of a manoeuvre",
                where="--duration",
                remedy=f"Give a number between {MIN_DURATION_S:g} and {MAX_DURATION_S:g}",
            )
        if not is_sampling_rate(self.rate):
            raise InputError(f"a rate of {self.rate:g} Hz is none", remedy="Give --rate a positive number")


@dataclass(frozen=True)
class Degree:
    """A covariance run.

    Parameters
    ----------
    t : ndarray, shape (k,)
        After each step [s]; the first is zero.
    sigma : ndarray, shape (k, n)
        Standard deviations of the states [SI]; the first row is the prior.
    singular : ndarray, shape (r,)
        Singular values of the measurements with respect to the start, in units of priors and of noise: sigmas of
        information, largest first, of the visible directions.
    weakest : tuple of (state, share)
        The states of the weakest visible direction, the largest first, in units of their priors.
    """

    t: Array
    sigma: Array
    singular: Array
    weakest: tuple[tuple[int, float], ...]

    @property
    def bits_per_minute(self) -> Array:
        """Information about each state, shape (n,)."""
        kept = np.maximum(self.sigma[-1], 1e-300) / np.maximum(self.sigma[0], 1e-300)
        bits: Array = np.maximum(-np.log2(kept), 0.0) / (self.t[-1] / 60.0)
        return bits

    @property
    def condition(self) -> float:
        """Of the visible directions, scaled; infinite where the weakest is gone before the first sample."""
        if not self.singular.size:
            return 1.0
        largest, smallest = float(self.singular[0]), float(self.singular[-1])
        return largest / smallest if smallest > 0.0 else float("inf")

    def reaches(self, state: int, wanted: float) -> float | None:
        """When a standard deviation is first reached [s]; None where it is not."""
        below = np.flatnonzero(self.sigma[:, state] <= wanted)
        return float(self.t[below[0]]) if below.size else None


def degree(
    discrete: DiscreteModel,
    manoeuvre: Manoeuvre,
    horizon: Horizon,
    hidden: int,
    start: Mapping[str, float] | None = None,
) -> Degree:
    """Run the covariance.

    Parameters
    ----------
    discrete : DiscreteModel
        Its rate is the sensors'.
    hidden : int
        Dimension of what is exactly hidden.
    start : mapping of str to float, optional
        As of `Flight`.
    """
    model = discrete.model
    seconds = manoeuvre.length if horizon.duration is None else horizon.duration
    samples = max(1, np.ceil(seconds * horizon.rate))
    steps = int(min(MAX_STEPS, samples))
    if _fastest(model, manoeuvre, start or {}) * seconds / steps > 1.0:
        steps = int(min(MAX_STEPS_OF_FAST_MODELS, samples))
    dt = seconds / steps
    t: Array = np.linspace(0.0, seconds, steps + 1)
    flight = Flight(model, manoeuvre, t, start=start or {})
    scale = np.array([s.prior if s.prior > 0.0 else 1.0 for s in model.states])
    F = _finite(model, t, flight.matrix(model.F)) * (scale / scale[:, None])
    G = _finite(model, t, flight.matrix(model.G)) / scale[:, None]
    W = np.array(model.W, dtype=np.float64).reshape(G.shape[2], G.shape[2])
    H, R = _measurement(discrete, flight, dt * horizon.rate)
    H = _finite(model, t, H) * scale
    P = np.diag([float(s.prior > 0.0) for s in model.states])
    one, M = np.eye(len(scale)), np.eye(len(scale))
    sigma, rows = [np.sqrt(np.diag(P)) * scale], []
    Phi, Qd = one, 0 * one
    for k in range(steps):
        if k == 0 or (F[k] != F[k - 1]).any() or (G[k] != G[k - 1]).any():
            Phi, Qd = van_loan(F[k], G[k] @ W @ G[k].T, dt)
        P, M = Phi @ P @ Phi.T + Qd, Phi @ M
        rows.append(H[k + 1] @ M / np.sqrt(R)[:, None])
        P = _updated(P, H[k + 1], R)
        sigma.append(np.sqrt(np.maximum(np.diag(P), 0.0)) * scale)
    _finite(model, t, np.array(sigma)[:, :, None])
    singular, weakest = _information(np.vstack(rows), len(scale) - hidden)
    return Degree(t, np.array(sigma), singular, weakest)


def _finite(model: FilterModel, t: Array, matrices: Array) -> Array:
    """Matrices at times [s], shape (k, rows, columns), once every number in them is one; else `InputError`."""
    bad = np.flatnonzero(~np.isfinite(matrices).all(axis=(1, 2)))
    if bad.size:
        raise InputError(
            f"how well the states of {model.name} are known cannot be measured: its linearised equations or its "
            f"covariance are beyond any number at t = {t[bad[0]]:.6g} s",
            remedy="Check signs, units and values of its equations and of the manoeuvre, start its states where the "
            "equations have derivatives, or choose a shorter --duration",
        )
    return matrices


def _fastest(model: FilterModel, manoeuvre: Manoeuvre, start: Mapping[str, float]) -> float:
    """The largest size of an eigenvalue of the dynamics where a manoeuvre starts [1/s]."""
    F = Flight(model, manoeuvre, np.zeros(1), start=start).matrix(model.F)[0]
    return float(np.abs(np.linalg.eigvals(F)).max(initial=0.0)) if np.isfinite(F).all() else 0.0


def _measurement(discrete: DiscreteModel, flight: Flight, samples: float) -> tuple[Array, Array]:
    """H at every time, shape (n, m, states), and the variance of the mean of a step's samples, shape (m,)."""
    model = discrete.model
    H = sp.Matrix.vstack(sp.zeros(0, len(model.states)), *(model.H(s) for s in model.sensors))
    R = [discrete.measurement_variance(s, c) / max(samples, 1.0) for s in model.sensors for c in s.channels]
    return flight.matrix(H), np.maximum(np.array(R, dtype=np.float64), 1e-300)


def _updated(P: Array, H: Array, R: Array) -> Array:
    """The covariance after a measurement, in Joseph's form."""
    S = H @ P @ H.T + np.diag(R)
    K = np.linalg.solve(S, H @ P).T
    A = np.eye(P.shape[0]) - K @ H
    P = A @ P @ A.T + (K * R) @ K.T
    return 0.5 * (P + P.T)


def _information(O: Array, rank: int) -> tuple[Array, tuple[tuple[int, float], ...]]:
    """Singular values of the visible directions, and the states of the weakest of these.

    A value within the rounding of the largest is zero: what decays before the first sample leaves nothing.
    """
    if not rank or not np.isfinite(O).all():
        return np.zeros(0), ()
    n = O.shape[1]
    _, values, vectors = np.linalg.svd(np.vstack([O, np.zeros((max(0, n - len(O)), n))]), full_matrices=False)
    values = np.where(values > values[0] * n * np.finfo(np.float64).eps, values, 0.0)
    weakest = vectors[rank - 1]
    order = np.argsort(-np.abs(weakest))[:2]
    return values[:rank], tuple((int(k), float(weakest[k])) for k in order)
