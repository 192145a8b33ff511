"""The exact Gaussian likelihood of a record with gaps or uneven time, in the information form.

Successive samples are averaged to blocks that never reach over a gap. Over a block and the gap after it the effects'
states step exactly, ``x' = A x + w``, and the block's mean is ``y = c x + v`` with ``w`` and ``v`` correlated
(`kfgen.core.linear.accumulate` of the sampled system): a chain of Gaussian factors in ``(x, x')``. Their sum is a banded
precision matrix, whose Cholesky factor gives the same likelihood as a Kalman filter [1]_, with banded routines.

What blocks average away enters by the variances of differences inside them, see `block_differences`. The constant of the
record has a flat prior; coefficients of deterministic effects are solved for by generalised least squares.

References
----------
.. [1] H. Rue and L. Held, Gaussian Markov Random Fields, 2005, sec. 2.4 (banded Cholesky; state space).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.core import linear
from kfgen.effects import Effect, LinearSystem
from kfgen.identify.evidence.allan import AllanCurve
from kfgen.identify.evidence.block_differences import BlockDifferences, differences_inside
from kfgen.identify.evidence.likelihood import Likelihood
from kfgen.identify.evidence.record import Evidence, Peaks, means_of
from kfgen.identify.evidence.shapes import Key
from kfgen.identify.evidence.whittle import Ordinates, SpectralFit, least_squares
from kfgen.identify.fit.bounds import fisher

Array = NDArray[np.float64]

MAX_BLOCKS = 4096
"""Blocks to which a longer record is averaged."""
TIME_STEPS_PER_PERIOD = 64
"""Times are rounded to this part of a period, so that a jittered record has few different steps."""
MIN_WHITE_SHARE_OF_VARIANCE = 1e-10
"""Of the variance of a sample: white noise that every model is given, so that factors exist."""
LOG_STEP_OF_SLOPE = 1e-4
"""In a logarithm over which the likelihood is differentiated."""


@dataclass(frozen=True)
class Chain:
    """Block means of one record in one piece or several.

    Parameters
    ----------
    y : ndarray, shape (m, 2 + r)
        Means of the samples, of one, and of the regressors.
    count : ndarray of int, shape (m,)
        Samples in each block.
    step : ndarray, shape (m,)
        Time [s] from the first sample of a block to that of the next.
    dt : float
        Sampling period [s].
    n : int
        Samples.
    inside : BlockDifferences
        What the blocks average away.
    """

    y: Array
    count: NDArray[np.int64]
    step: Array
    dt: float
    n: int
    inside: BlockDifferences

    @cached_property
    def kinds(self) -> tuple[Array, NDArray[np.int64]]:
        """The different pairs of count and step, shape (u, 2), and which block has which."""
        pairs, index = np.unique(np.column_stack([self.count, self.step]), axis=0, return_inverse=True)
        return pairs, index.ravel()

    def log_likelihood(self, effects: Sequence[Effect], coefficients: Array | None = None) -> SpectralFit:
        """``ln L`` with the coefficients of the regressors, solved for when left out.

        See `kfgen.identify.evidence.record.Likelihood`.
        """
        try:
            logdet, G = self._products([e.form() for e in effects if not e.coefficients()])
        except np.linalg.LinAlgError:  # one noise so far below another that rounding swallows it
            return self._impossible
        if not (np.isfinite(G).all() and np.isfinite(logdet) and G[1, 1] > 0.0):
            return self._impossible
        # The constant, of flat prior, is integrated out: it takes its share of every product.
        flat = 0.5 * float(np.log(G[1, 1]))
        G = G - np.outer(G[:, 1], G[1]) / G[1, 1]
        keep = np.array([0, *range(2, G.shape[0])])
        theta, covariance, quadratic = least_squares(G[np.ix_(keep, keep)], coefficients)
        return SpectralFit(
            -0.5 * (logdet + quadratic) - flat + self.inside.log_likelihood(effects).value, theta, covariance
        )

    @property
    def _impossible(self) -> SpectralFit:
        """What is said of parameters at which no number comes out."""
        return SpectralFit(-np.inf, np.zeros(k := self.y.shape[1] - 2), np.zeros((k, k)))

    def slope(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Derivative of ``ln L`` in logarithms, by central differences; see `evidence.record.Likelihood`."""
        return np.array([self._slope(effects, key) for key in keys])

    def _slope(self, effects: Sequence[Effect], key: Key) -> float:
        def value(step: float) -> float:
            moved = [e.shifted(key[1], step) if i == key[0] else e for i, e in enumerate(effects)]
            return self.log_likelihood(moved).value

        return (value(LOG_STEP_OF_SLOPE) - value(-LOG_STEP_OF_SLOPE)) / (2.0 * LOG_STEP_OF_SLOPE)

    def information(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Fisher information of a whole record of as many samples.

        See `kfgen.identify.evidence.record.Likelihood`.
        """
        known, J = fisher(effects, self.dt, self.n)
        at = [known.index(key) if key in known else -1 for key in keys]
        out = np.zeros((len(keys), len(keys)))
        for a, i in enumerate(at):
            for b, j in enumerate(at):
                out[a, b] = J[i, j] if i >= 0 and j >= 0 else 0.0
        return out

    def _products(self, forms: Sequence[LinearSystem]) -> tuple[float, Array]:
        """Log determinant of the covariance of the means, and ``Y' C^-1 Y``, shape (2 + r, 2 + r)."""
        from scipy.linalg import cho_solve_banded, cholesky_banded

        pairs, kind = self.kinds
        system = _joined(forms, self.dt)
        white = sum(float(f.V) for f in forms) / self.dt + MIN_WHITE_SHARE_OF_VARIANCE * float(
            np.var(self.y[:, 0])
        )
        L, Q = system.steps(pairs, white, self.dt)
        k, m = system.order, self.count.size
        M = np.linalg.inv(Q)
        logdet = float(np.linalg.slogdet(Q)[1] @ np.bincount(kind, minlength=len(Q)))
        ML = M @ L
        H = np.swapaxes(L, 1, 2) @ ML
        b = -ML[kind, k, :, None] * self.y[:, None, :]
        c = (M[kind, k, k] * self.y.T) @ self.y
        if not k:
            return logdet, c
        P0 = np.linalg.inv(system.start)
        band = np.zeros((2 * k, (m + 1) * k), order="F")
        for i in range(2 * k):
            for j in range(i + 1):
                band[i - j, j : j + m * k : k] += H[kind, i, j]
        for i in range(k):
            for j in range(i + 1):
                band[i - j, j] += P0[i, j]
        rhs = np.zeros(((m + 1) * k, self.y.shape[1]), order="F")
        rhs[: m * k] += b[:, :k].reshape(m * k, -1)
        rhs[k:] += b[:, k:].reshape(m * k, -1)
        factor = cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        solved = cho_solve_banded((factor, True), rhs, check_finite=False)
        logdet += 2.0 * float(np.log(factor[0]).sum()) + float(np.linalg.slogdet(system.start)[1])
        G = c - rhs.T @ solved
        # where the states can be any constant, what is left of it is rounding, which may be negative
        G[1, 1] = max(float(G[1, 1]), float(np.finfo(float).eps * c[1, 1]))
        return logdet, G


@dataclass(frozen=True)
class _System:
    """The random effects of a channel as one sampled system, with the quantisation's last error as a state."""

    A: Array
    Q: Array
    C: Array
    continuous: tuple[Array, Array]
    start: Array
    quantised: float

    @property
    def order(self) -> int:
        """States."""
        return int(self.C.size)

    def steps(self, pairs: Array, white: float, dt: float) -> tuple[Array, Array]:
        """Over blocks of (count, time to the next): residuals ``L [x, x'] + (0, y)`` and their covariances.

        Parameters
        ----------
        pairs : ndarray, shape (u, 2)
            Samples in a block, time [s] to the next one.
        white : float
            Variance of the white part of a sample [U^2].
        dt : float
            Sampling period [s].

        Returns
        -------
        L : ndarray, shape (u, k + 1, 2 k)
        Q : ndarray, shape (u, k + 1, k + 1)
        """
        k, n = self.order, self.continuous[0].shape[0]
        A, Q = np.zeros((2, len(pairs), k + 1, k + 1))
        single = pairs[:, 0] == 1
        A[single, :n, :n], Q[single, :n, :n] = linear.van_loan(*self.continuous, pairs[single, 1])
        A[:, k, :k] = self.C
        for count in np.unique(pairs[~single, 0]):
            of_count = pairs[:, 0] == count
            gaps = np.maximum(pairs[of_count, 1] - count * dt, 0.0)
            A[of_count], Q[of_count] = self._blocks(int(count), gaps)
        Q[:, k, k] += white / pairs[:, 0]
        if self.quantised:  # the mean of a block has the error at its end less that at its beginning
            scale = 1.0 / (pairs[:, 0] * dt)
            A[:, :, k - 1] = 0.0
            A[:, k, k - 1] = -scale
            Q[:, k - 1], Q[:, :, k - 1] = 0.0, 0.0
            Q[:, k - 1, k - 1] = self.quantised
            Q[:, k, k - 1] = Q[:, k - 1, k] = scale * self.quantised
            Q[:, k, k] += scale**2 * self.quantised
        L = np.zeros((len(pairs), k + 1, 2 * k))
        L[:, :, :k] = -A[:, :, :k]
        L[:, :k, k:] = np.eye(k)
        return L, Q

    def _blocks(self, count: int, gaps: Array) -> tuple[Array, Array]:
        """Transitions and covariances of the states and the block's mean, over a block and the gaps after it."""
        k, n = self.order, self.continuous[0].shape[0]
        A, Q = linear.accumulate(self.A, self.Q, self.C / count, count)
        T = np.zeros((gaps.size, k + 1, k + 1))
        T[:] = np.eye(k + 1)
        T[:, :n, :n], Qd = linear.van_loan(*self.continuous, gaps)
        over = T @ Q @ np.swapaxes(T, 1, 2)
        over[:, :n, :n] += Qd
        return T @ A, over


def _joined(forms: Sequence[LinearSystem], dt: float) -> _System:
    """All random effects side by side."""
    random = [f for f in forms if f.order]
    A = linear.beside([np.array(f.A, float) for f in random])
    W = linear.beside([np.array(f.W, float) for f in random])
    C = np.concatenate([np.array(f.C, float) for f in random]) if random else np.zeros(0)
    Phi, Qd = linear.van_loan(A, W, dt)
    # A state that keeps no variance starts from what one period gives it: its level is the constant's.
    starts = [linear.stationary_covariance(np.array(f.A, float), np.array(f.W, float)) for f in random]
    start = linear.beside(starts)
    lost = ~start.any(axis=1) if random else np.zeros(0, bool)
    start[np.ix_(lost, lost)] = Qd[np.ix_(lost, lost)]
    Z = sum(float(f.Z) for f in forms)
    if Z:
        last = np.array([[Z]])
        Phi, Qd, start = (linear.beside(p) for p in ((Phi, 0.0 * last), (Qd, last), (start, last)))
        C = np.append(C, 0.0)
    return _System(Phi, Qd, C, (A, W), start, Z)


@dataclass(frozen=True)
class Exact(Evidence):
    """A record whose likelihood is exact: with the samples and the times as they are.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Times [s] and samples [SI] that were recorded.
    drive : mapping of str to ndarray, shape (n,)
        Recorded drivers.
    period : float
        Sampling period [s]: the time that one sample stands for.
    view : Evidence
        Even pieces of the record: for its Allan curve and for start values.
    shortest : float
        Time [s] below which nothing is looked at: what an internal low-pass changes.
    drawn : bool
        The view is drawn between uneven samples: what is fast in it is not real.
    """

    t: Array
    y: Array
    drive: Mapping[str, Array]
    period: float
    view: Evidence
    shortest: float = 0.0
    drawn: bool = False

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return self.period

    @property
    def lengths(self) -> tuple[int, ...]:
        """Samples, as if in one piece: what is slow is seen across a gap."""
        return (int(self.y.size),)

    @property
    def curve(self) -> AllanCurve:
        """Of the even pieces."""
        return self.view.curve

    @property
    def octaves(self) -> AllanCurve:
        """Of the even pieces."""
        return self.view.octaves

    @property
    def step(self) -> float:
        """A period, or what a low-pass leaves [s]."""
        return max(self.period, self.shortest)

    @cached_property
    def adc_step(self) -> float:
        """Step of the ADC grid on which its samples were logged [SI], zero where they lie on none."""
        return self.view.adc_step

    @property
    def scale(self) -> float:
        """Standard deviation of its samples [SI]."""
        return float(np.std(self.y))

    @property
    def driven(self) -> Mapping[str, float]:
        """Mean of each recorded driver that changes [SI]."""
        return means_of(self.drive)

    @property
    def skip(self) -> tuple[tuple[float, float], ...]:
        """What an internal low-pass changes [Hz]."""
        return ((1.0 / self.shortest, float("inf")),) if self.shortest else ()

    def drift_variance(self, effects: Sequence[Effect]) -> Array:
        """Of the even pieces."""
        return self.view.drift_variance(effects)

    def ordinates(self, effects: Sequence[Effect], peaks: Peaks | None = None) -> Ordinates:
        """Of the even pieces. See `Evidence.ordinates`."""
        return self.view.ordinates(effects, peaks)

    def measure(self, shapes: Sequence[Effect], peaks: Peaks = ()) -> Likelihood:
        """The chain with the regressors of these effects, from an even grid. See `Evidence.measure`."""
        t = self.t - self.t[0]
        grid = np.arange(0.0, t[-1] + self.period, self.period)
        drive = {k: np.interp(grid, t, v) for k, v in self.drive.items()}
        columns = [np.interp(t, grid, x) for e in shapes for x in e.regressors(grid, drive)]
        return chain(self.t, self.y - self.y.mean(), self.dt, columns, self.shortest, blocks=not self.drawn)


def chain(
    t: Array,
    y: Array,
    dt: float,
    regressors: Sequence[Array] = (),
    shortest: float = 0.0,
    *,
    blocks: bool = True,
) -> Chain:
    """Block means of a record.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Increasing times [s], samples.
    dt : float
        Sampling period [s]: the time that one sample stands for.
    regressors : sequence of ndarray, shape (n,)
    shortest : float
        Time [s] below which differences are not looked at.
    blocks : bool
        Whether samples may be averaged: only where they are evenly spaced between gaps.
    """
    columns = np.column_stack([y, np.ones(y.size), *regressors])
    t = np.round((t - t[0]) / dt * TIME_STEPS_PER_PERIOD) / TIME_STEPS_PER_PERIOD * dt
    missing = np.diff(t) - dt
    blind = max(0, int(np.ceil(np.log2(max(shortest / dt, 1.0)))))
    levels = max(blind, int(np.ceil(np.log2(y.size / MAX_BLOCKS)))) if blocks else 0
    edges = _edges(missing, y.size, 2**levels, dt)
    count = np.diff(edges)
    means = np.add.reduceat(columns, edges[:-1], axis=0) / count[:, None]
    step = np.round(np.append(np.diff(t[edges[:-1]]), dt) / dt * TIME_STEPS_PER_PERIOD)
    step = np.maximum(step, 1.0) / TIME_STEPS_PER_PERIOD * dt
    full = edges[:-1][count == 2**levels]
    return Chain(means, count, step, dt, y.size, differences_inside(y, full, levels, blind, dt))


def _edges(missing: Array, n: int, block: int, dt: float) -> NDArray[np.int64]:
    """Beginnings of blocks, none of which reaches over a gap, and the end."""
    if block == 1:
        return np.arange(n + 1)
    pieces = np.concatenate([[0], np.flatnonzero(missing > 0.5 * dt) + 1, [n]])
    starts = np.concatenate([np.arange(a, b, block) for a, b in pairwise(pieces.tolist())])
    return np.append(starts, n).astype(np.int64)
