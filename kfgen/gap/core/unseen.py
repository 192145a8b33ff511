"""Does an addition shrink the gap on data that its fit did not see.

The record is left out part by part; each part is predicted from the others, linearly about the fit to all of them. Of
residuals ``r`` with derivatives ``J`` and information ``H`` on what is fitted, all at the best point, the part ``U`` is
predicted from the rest with the log-likelihood

    -|r_U|^2 / 2 - g' H_S^-1 g / 2 - ln(det H / det H_S) / 2,     g = J_U' r_U,     H_S = H - J_U' J_U

which counts how well the rest knows what is fitted: a part that alone shows an event, a step or a burst, is
no proof against it, for the event is looked for in it again. What follows a process that is really there is predicted by
it; what was fitted to a misfit is not.

References
----------
.. [1] A. P. Dawid, Present position and potential developments: the prequential approach, J. R. Statist. Soc. A 147, 1984.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PARTS = 4
"""Into which a record is cut, each predicted from the others."""
MAX_UNSEEN_LOSS_NATS = 3.0
"""Loss that chance alone exceeds in fewer than one of a hundred effects that are there, at their detection limit."""
TAIL_SHARE = 0.3
"""Share of the record, at its end."""
MIN_KNOWN_SHARE = 1e-3
"""Share of that information below which a number is looked for again in the part: where a segment starts, when a step was."""
UNKNOWN_SHARE = 1e-4
"""Share of the information on a number that is left of it where the rest knows nothing: its prior."""


@dataclass(frozen=True)
class LinearFit:
    """A fit as its best point sees it.

    Parameters
    ----------
    residual : ndarray, shape (N,)
        White, in the order of time channel by channel.
    jacobian : ndarray, shape (N, p)
    information : ndarray, shape (p, p)
        With what priors give.
    gradient : ndarray, shape (p,), optional
        Of minus the log-likelihood and the log prior, where the fit ended; zero if left out.
    """

    residual: Array
    jacobian: Array
    information: Array
    gradient: Array | None = None

    @cached_property
    def settled(self) -> Array:
        """The residuals where the slope is none, shape (N,): a fit may have ended a little before."""
        if self.gradient is None:
            return self.residual
        scale = np.sqrt(np.maximum(np.diag(self.information), 1e-300))
        K = self.information / np.outer(scale, scale)
        step = np.linalg.lstsq(K, self.gradient / scale, rcond=1e-10)[0] / scale
        return np.asarray(self.residual - self.jacobian @ step)

    def predicted(self, unseen: Mask) -> float:
        """Log-likelihood of samples, predicted from all others [nats].

        Parameters
        ----------
        unseen : ndarray of bool, shape (N,)
        """
        r, J, H = self.residual[unseen], self.jacobian[unseen], self.information
        value = -0.5 * float(r @ r)
        if not J.shape[1]:
            return value
        scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
        J, settled = J / scale, self.settled[unseen]
        whole = H / np.outer(scale, scale) + UNKNOWN_SHARE * np.eye(scale.size)
        rest, g = whole - J.T @ J, J.T @ settled
        values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
        pull = (vectors.T @ g) ** 2 * (values > MIN_KNOWN_SHARE)
        values = np.maximum(values, UNKNOWN_SHARE)
        loss = float(np.sum(pull / values) - np.log(values).sum() + np.linalg.slogdet(whole)[1])
        return value - 0.5 * loss


def unseen_gain(before: LinearFit, after: LinearFit, parts: Iterable[Mask]) -> float:
    """What is gained on parts of a record, each predicted from all others [nats].

    Parameters
    ----------
    before, after : LinearFit
        Without and with an addition.
    parts : iterable of ndarray of bool, shape (N,)
    """
    return sum(after.predicted(rows) - before.predicted(rows) for rows in parts)


def parts_of(lengths: Sequence[int]) -> list[Mask]:
    """The parts of equal length of all channels, one after the other.

    Parameters
    ----------
    lengths : sequence of int
        Samples of each channel.
    """
    part = [np.minimum(np.arange(n) * PARTS // max(n, 1), PARTS - 1) for n in lengths]
    whole = np.concatenate(part)
    return [whole == k for k in range(PARTS)]


def tail_of(lengths: Sequence[int]) -> Mask:
    """The last samples of all channels, one after the other.

    Parameters
    ----------
    lengths : sequence of int
        Samples of each channel.
    """
    return np.concatenate([np.arange(n) >= int(n * (1.0 - TAIL_SHARE)) for n in lengths])
