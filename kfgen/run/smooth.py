"""A smoother over a log: every estimate with all readings known, those after it as well.

The filter runs forward and its predictions are kept; one pass backward [1]_ carries what later readings say to the
estimates before them. Errors are those of the filter, so that attitudes are smoothed as small rotations.

References
----------
.. [1] H. E. Rauch, F. Tung, C. T. Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3(8), 1965.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.model.filter_equations import FilterEquations
from kfgen.run.filter_calls import FilterCalls
from kfgen.run.run import FilterRun

Array = NDArray[np.float64]

MAX_BYTES = 4e9
"""Of what is kept of the forward pass."""
KEPT_MATRICES = 4
"""Covariances before and after a prediction, its transition, and its gain."""


@dataclass
class ForwardPass:
    """What a filter did in each of its predictions.

    Attributes
    ----------
    before, after : list of ndarray, shape (stored,)
        Stored states before a prediction, with the readings until then, and after it.
    P_before, P_after, Phi : list of ndarray, shape (states, states)
        Their covariances, and the transition.
    """

    before: list[Array] = field(default_factory=list)
    after: list[Array] = field(default_factory=list)
    P_before: list[Array] = field(default_factory=list)
    P_after: list[Array] = field(default_factory=list)
    Phi: list[Array] = field(default_factory=list)

    def wrap(self, emitted: type[Any]) -> type[Any]:
        """An emitted filter class whose predictions are kept here.

        Parameters
        ----------
        emitted : type
            A class of a module that kfgen emitted for filterpy.
        """
        kept = self

        class Kept(emitted):  # type: ignore[misc]
            """The emitted filter; what it predicts is kept."""

            def predict(self, **given: Any) -> Any:
                """As emitted; a prediction that it refuses changes nothing."""
                kept.before.append(np.array(self.nominal))
                kept.P_before.append(np.array(self.P))
                self.F = np.eye(len(self.P))
                status = super().predict(**given)
                kept.Phi.append(np.array(self.F))
                kept.after.append(np.array(self.nominal))
                kept.P_after.append(np.array(self.P))
                return status

        return Kept


def check_smoothable(calls: FilterCalls, adapts: bool) -> None:
    """Raise `InputError` where a filter cannot be smoothed over a log.

    Parameters
    ----------
    calls : FilterCalls
        Of the filter over the log.
    adapts : bool
        Whether a rule or a class of the caller's changes what it does.
    """
    n, model = calls.program.n, calls.program.discrete.model
    if adapts:
        raise InputError(
            f"{model.name} with a rule by which it adapts cannot be smoothed: its covariances are not those of a model",
            where="--smooth",
            remedy="Leave out --adaptive; --tune estimates the noise by the innovations",
        )
    if n == 0:
        raise InputError(f"{model.name} has no state to be smoothed", where="--smooth", remedy="Leave it out")
    size = KEPT_MATRICES * 8.0 * n * n * sum(calls.parts(k) for k in range(calls.log.n))
    if size > MAX_BYTES:
        raise InputError(
            f"smoothing {calls.log.n} samples of {n} states takes {size / 1e9:.2g} GB of memory",
            where="--smooth",
            remedy=f"Cut the log into {int(np.ceil(size / MAX_BYTES))} parts or more",
        )


@dataclass(frozen=True)
class Smoothed:
    """The estimates with all readings known.

    Parameters
    ----------
    estimate : ndarray, shape (n, stored)
        Stored states [SI].
    P : ndarray, shape (n, states, states)
        Their covariances.
    """

    estimate: Array
    P: Array


def smoothed(result: FilterRun, calls: FilterCalls, forward: ForwardPass) -> Smoothed:
    """The estimates of a run at the times of its log, with all readings known.

    Parameters
    ----------
    result : FilterRun
    calls : FilterCalls
        Of that run.
    forward : ForwardPass
        Its predictions.
    """
    assert result.covariance is not None
    equations = FilterEquations(calls.program.discrete)
    x = np.array([*forward.before, result.estimate[-1]])
    P = np.array([*forward.P_before, result.covariance])
    error = np.zeros(P.shape[:2])
    if forward.after:
        error[1:] = equations.difference(np.array(forward.after), x[1:])
    s, P = _backward(error, P, np.array(forward.P_after), np.array(forward.Phi))
    at = np.concatenate([[0], np.cumsum([calls.parts(k) for k in range(calls.log.n - 1)])]).astype(int)
    return Smoothed(equations.injected(x[at], s[at]), P[at])


def of_all_readings(result: FilterRun, calls: FilterCalls, forward: ForwardPass) -> FilterRun:
    """A run whose estimates and standard deviations are the smoothed ones; its innovations are those of the filter.

    Parameters
    ----------
    result, calls, forward
        As of `smoothed`.

    Raises
    ------
    InputError
        The filter diverged.
    """
    found = smoothed(result, calls, forward)
    variances = np.diagonal(found.P, axis1=1, axis2=2)
    if not (np.isfinite(found.estimate).all() and np.isfinite(variances).all()):
        raise InputError(
            f"{result.model} diverges over the log, and nothing can be smoothed",
            where=calls.log.source,
            remedy="Check the units and axes of its inputs, or start it at rest",
        )
    deviation = np.sqrt(np.maximum(variances, 0.0))
    return replace(result, estimate=found.estimate, deviation=deviation, smoothed=True)


def _backward(u: Array, P: Array, P_after: Array, Phi: Array) -> tuple[Array, Array]:
    """Smoothed errors, shape (m + 1, states), about the filter's estimates, and their covariances.

    `u` is by how much the readings moved the filter's estimate, `P` its covariance then; `P_after` and `Phi` are those
    of the predictions. ``C = P Phi' (P_after)^-1``; from the last sample on ``s = C (u + s)`` of the next, and
    ``P + C (P_s - P_after) C'``.
    """
    s, out = np.zeros_like(u), P.copy()
    C = _gains(P[:-1], P_after, Phi)
    for k in range(len(C) - 1, -1, -1):
        s[k] = C[k] @ (u[k + 1] + s[k + 1])
        grown = out[k] + C[k] @ (out[k + 1] - P_after[k]) @ C[k].T
        out[k] = 0.5 * (grown + grown.T)
    return s, out


def _gains(P: Array, P_after: Array, Phi: Array) -> Array:
    """``P Phi' (P_after)^-1`` of every prediction; units are scaled out, and what has no variance has no gain."""
    if not len(P):
        return np.zeros_like(P)
    sd = np.sqrt(np.maximum(np.diagonal(P_after, axis1=1, axis2=2), 0.0))
    over = np.where(sd > 0.0, 1.0 / np.where(sd > 0.0, sd, 1.0), 0.0)
    correlation = P_after * over[:, :, None] * over[:, None, :]
    right = (Phi @ P) * over[:, :, None]
    try:
        found = np.linalg.solve(correlation, right)
    except np.linalg.LinAlgError:  # two states that are one, or one without variance
        found = np.linalg.pinv(correlation, rcond=1e-12, hermitian=True) @ right
    return np.swapaxes(found * over[:, :, None], 1, 2)
