"""`PathFilter`: a Kalman filter of how far a plant is off a path, its innovations, and the smoothed course of what drove it.

All that is asked of it is linear in what is measured, and many columns are filtered at once: the recursions over the samples are
cut into blocks that are run side by side, and put together from where each block began.

References
----------
.. [1] J. Durbin and S. J. Koopman, Time Series Analysis by State Space Methods, 2nd ed., 2012, sec. 4.3 to 4.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.plant.noise.linear_path import LinearPath

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recursion:
    """``x[i + 1] = M[i] x[i] + b[i]`` of many columns.

    Parameters
    ----------
    M : ndarray, shape (n - 1, k, k)
    """

    M: Array

    @cached_property
    def _blocks(self) -> tuple[Array, Array]:
        """The matrices in blocks, shape (blocks, length, k, k), and their products from the start of each on."""
        steps, k = self.M.shape[:2]
        length = max(int(np.ceil(np.sqrt(steps))), 1)
        blocks = -(-steps // length)
        M = np.tile(np.eye(k), (blocks * length, 1, 1))
        M[:steps] = self.M
        M = M.reshape(blocks, length, k, k)
        F = np.empty((blocks, length + 1, k, k))
        F[:, 0] = np.eye(k)
        for j in range(length):
            F[:, j + 1] = M[:, j] @ F[:, j]
        return M, F

    def solved(self, b: Array, first: Array) -> Array:
        """All x, shape (n, k, columns), of b, shape (n - 1, k, columns), and the first x, shape (k, columns)."""
        if not b.shape[0]:
            return first[None]
        M, F = self._blocks
        blocks, length, k, _ = M.shape
        driven = np.zeros((blocks * length, *b.shape[1:]))
        driven[: b.shape[0]] = b
        driven = driven.reshape(blocks, length, *b.shape[1:])
        x = np.zeros((blocks, length + 1, *b.shape[1:]))
        for j in range(length):
            x[:, j + 1] = M[:, j] @ x[:, j] + driven[:, j]
        begun = np.empty((blocks, k, b.shape[2]))
        at = first
        for i in range(blocks):
            begun[i] = at
            at = F[i, -1] @ at + x[i, -1]
        out = x[:, :-1] + F[:, :-1] @ begun[:, None]
        return np.concatenate([out.reshape(-1, *b.shape[1:]), at[None]])[: b.shape[0] + 1]


def gains(
    path: LinearPath, driving: Callable[[int], Array], P0: Array
) -> Iterator[tuple[Array, Array, Array]]:
    """Of every sample the covariance of the prediction, the gain, and the inverse root of the innovations' covariance.

    Parameters
    ----------
    path : LinearPath
    driving : callable
        Covariance of what drives the states in a step, shape (..., states, states).
    P0 : ndarray, shape (..., states, states)
        Covariance of where they begin; several filters run side by side.
    """
    P, of_channels, of_states = P0, *map(np.eye, path.C.shape[1:])
    for i, (C, R) in enumerate(zip(path.C, path.R)):
        PC = P @ C.T
        W = np.asarray(
            np.linalg.solve(np.linalg.cholesky(C @ PC + np.diag(R)), of_channels), dtype=np.float64
        )
        K = np.asarray(PC @ (W.swapaxes(-1, -2) @ W))
        yield P, K, W
        if i < path.steps.size:
            A = path.A[i] @ (of_states - K @ C)  # by Joseph: it stays positive, however sure a sample is
            AK = path.A[i] @ K
            P = A @ P @ A.swapaxes(-1, -2) + (AK * R) @ AK.swapaxes(-1, -2) + driving(i)
            P = 0.5 * (P + P.swapaxes(-1, -2))


@dataclass(frozen=True)
class PathFilter:
    """The filter of a path.

    Parameters
    ----------
    path : LinearPath
    Q : ndarray, shape (n - 1, states, states)
        Covariance of what drives the states in each step.
    P0 : ndarray, shape (states, states)
        Covariance of where they begin.
    """

    path: LinearPath
    Q: Array
    P0: Array

    @cached_property
    def _gains(self) -> tuple[Array, Array, Array]:
        """Covariances of the prediction, shape (n, k, k), gains (n, k, m), and inverse roots of those of innovations (n, m, m)."""
        P, K, W = zip(*gains(self.path, lambda i: self.Q[i], self.P0))
        return np.array(P), np.array(K), np.array(W)

    @cached_property
    def _ahead(self) -> Recursion:
        K, C, A = self._gains[1], self.path.C, self.path.A
        return Recursion(A @ (np.eye(A.shape[1]) - K[:-1] @ C[:-1]))

    @cached_property
    def _back(self) -> Recursion:
        return Recursion(self._ahead.M[::-1].transpose(0, 2, 1))

    @property
    def log_widths(self) -> Array:
        """Logarithm of the standard deviation of each innovation over that of the sample's noise, shape (n, channels)."""
        roots = np.diagonal(self._gains[2], axis1=1, axis2=2)
        return np.asarray(-np.log(roots * np.sqrt(self.path.R)))

    def _predicted(self, y: Array, d: Array, first: Array) -> Array:
        """How far the states are off the path by all samples before, shape (n, k, columns)."""
        driven = self.path.A @ (self._gains[1][:-1] @ y[:-1]) + d
        return self._ahead.solved(driven, first)

    def innovations(self, y: Array, d: Array, first: Array) -> Array:
        """Normalised innovations, shape (n, channels, columns): independent unit normal deviates under a right model.

        Parameters
        ----------
        y : ndarray, shape (n, channels, columns)
            As of `LinearPath`.
        d : ndarray, shape (n - 1, states, columns)
            As of `LinearPath`.
        first : ndarray, shape (states, columns)
            Where the states begin, less the path.
        """
        left = y - self.path.C @ self._predicted(y, d, first)
        return np.asarray(self._gains[2] @ left)

    def _pulls(self, z: Array) -> Array:
        """What innovations and all after them say of the states, shape (n, k, columns), see [1]_, eq. (4.44)."""
        said = self.path.C.transpose(0, 2, 1) @ (self._gains[2].transpose(0, 2, 1) @ z)
        return self._back.solved(said[-2::-1], said[-1])[::-1]

    def smoothed(self) -> Array:
        """The path with what the readings say of it, shape (n, states)."""
        path = self.path
        y, d = path.y[:, :, None], path.d[:, :, None]
        first = np.zeros((path.X.shape[1], 1))
        z = self.innovations(y, d, first)
        off = self._predicted(y, d, first) + self._gains[0] @ self._pulls(z)
        return np.asarray(path.X + off[:, :, 0])

    def drove(self, z: Array, state: int, density: float) -> Array:
        """The smoothed noise that drove a state in each step, shape (n - 1, columns) [SI], see [1]_, sec. 4.5.

        Parameters
        ----------
        z : ndarray, shape (n, channels, columns)
            Normalised innovations.
        state : int
            Which state.
        density : float
            Root density of its noise [SI/sqrt(Hz)].
        """
        g = self.path.directions[:, :, state]
        return np.asarray(density**2 * np.einsum("nk,nkp->np", g, self._pulls(z)[1:]))
