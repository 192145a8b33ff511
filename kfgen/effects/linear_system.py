"""`LinearSystem`: one effect as a linear stochastic system, and everything that follows from it.

``dx = A x dt + dw``, ``E[dw dw'] = W dt``; ``y = C x + v``; with ``v`` white of two-sided density
``V`` and a white sequence of variance ``Z`` added to the integral of ``y`` (quantisation).
States start at ``x0`` plus, when the system is stable, its stationary spread. Entries may be
numbers, arrays over time (``C`` of a driven effect) or sympy expressions: the declaration is
the same for all, and the functions here are the only place where an Allan variance, a
spectrum, a simulation or a discretisation of an effect is computed.

References
----------
.. [1] IEEE Std 952-1997, annex C.
.. [2] D. W. Allan, Statistics of atomic frequency standards, Proc. IEEE 54(2), 1966.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core import linear

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """A state that an effect appends.

    Parameters
    ----------
    name : str
        Short.
    unit : str
        Unit template, ``U`` being the channel's.
    shared : bool
        It keeps its value and shows in the output as it is: a bias. Effects that gather in the bias
        of one channel (a constant, a random walk, a ramp) cannot be distinguished there and share it.
    """

    name: str
    unit: str = "U"
    shared: bool = False


@dataclass(frozen=True)
class LinearSystem:
    """The system of one effect.

    Parameters
    ----------
    A, W : tuple of rows, (k, k)
        Dynamics [1/s] and driving density.
    C : tuple, (k,)
        Output row; of a driven effect its entries depend on the driver.
    V : scalar
        Density of the white part [U^2/Hz].
    Z : scalar
        Variance of the white sequence on the integral [U^2 s^2].
    x0 : tuple, (k,)
        Initial mean; the only source of an effect without noise.
    states : tuple of State, (k,)
        What the states are called in a filter.
    """

    A: tuple[tuple[Any, ...], ...] = ()
    W: tuple[tuple[Any, ...], ...] = ()
    C: tuple[Any, ...] = ()
    V: Any = 0.0
    Z: Any = 0.0
    x0: tuple[Any, ...] = ()
    states: tuple[State, ...] = ()

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def deterministic(self) -> bool:
        """Whether nothing in it is random: its output is a function of time and drivers."""
        noisy = any(w != 0 for row in self.W for w in row)
        return self.order > 0 and not noisy and self.V == 0 and self.Z == 0


def _matrices(form: LinearSystem) -> tuple[Array, Array]:
    k = form.order
    A = np.array(form.A, dtype=np.float64).reshape(k, k)
    return A, np.array(form.W, dtype=np.float64).reshape(k, k)


def _row(form: LinearSystem) -> Array:
    return np.array(form.C, dtype=np.float64).reshape(form.order)


def discretise(form: LinearSystem, dt: float) -> tuple[Array, Array]:
    """Exact ``Phi`` and ``Qd``, shape (k, k), over a step `dt` [s]."""
    return linear.van_loan(*_matrices(form), dt)


def initial_covariance(form: LinearSystem) -> Array:
    """The stationary covariance of the states, shape (k, k), zero where there is none."""
    return linear.stationary_covariance(*_matrices(form))


def allan_variance(form: LinearSystem, tau: Array) -> Array:
    """The Allan variance [U^2] at averaging times `tau` [s], shape (m,).

    Half the mean square of the difference of the averages over two adjoining intervals [2]_,
    from the exact covariance of the system augmented by the integral of its output. The output
    row must not be driven.
    """
    tau = np.asarray(tau, dtype=np.float64)
    k = form.order
    avar = 3.0 * float(form.Z) / tau**2
    A, W = np.zeros((k + 1, k + 1)), np.zeros((k + 1, k + 1))
    A[:k, :k], W[:k, :k] = _matrices(form)
    A[k, :k], W[k, k] = _row(form), float(form.V)
    Phi, Q = linear.van_loan(A, W, tau)
    psi = Phi[:, k, :k]
    x0 = np.array(form.x0, dtype=np.float64).reshape(k)
    M0 = np.outer(x0, x0) + initial_covariance(form)
    start = np.einsum("ti,tij->tj", psi, Phi[:, :k, :k] - np.eye(k))
    spread = np.einsum("ti,ij,tj->t", start, M0, start)
    carried = np.einsum("ti,tij,tj->t", psi, Q[:, :k, :k], psi) - 2.0 * np.einsum(
        "ti,ti->t", psi, Q[:, :k, k]
    )
    return np.asarray(avar + (spread + carried + 2.0 * Q[:, k, k]) / (2.0 * tau**2))


def density(form: LinearSystem, f: Array) -> Array:
    """Two-sided power spectral density [U^2/Hz] of the continuous output at `f` [Hz], shape (m,).

    Deterministic effects have none. The sequence on the integral counts by its density per
    unit of time, so it is left to `sampled_density`, which knows the sampling period.
    """
    k = form.order
    s = 2j * np.pi * np.asarray(f, dtype=np.float64)
    A, W = _matrices(form)
    out = np.full(s.shape, float(form.V))
    if k and not form.deterministic:
        g = np.linalg.solve(
            np.swapaxes(s[:, None, None] * np.eye(k) - A, 1, 2),
            np.broadcast_to(_row(form)[:, None], (s.size, k, 1)),
        )[..., 0]
        out = out + np.einsum("fi,ij,fj->f", g, W, g.conj()).real
    return out


def sampled_density(form: LinearSystem, omega: Array, dt: float, block: int = 1) -> Array:
    """Spectral density [U^2] of the samples, or of averages of `block` of them.

    Parameters
    ----------
    omega : ndarray, shape (m,)
        Angular frequency in radians per sample (or block), 0 < omega <= pi.
    dt : float
        Sampling period [s].
    block : int
        Samples averaged before.

    Returns
    -------
    ndarray, shape (m,)
        ``S`` with variance ``= (1 / 2 pi) int S d omega``: exact for the sampled system.
    """
    k = form.order
    z = np.exp(1j * np.asarray(omega, dtype=np.float64))
    out = np.full(z.shape, float(form.V) / (dt * block))
    out += np.abs(1.0 - 1.0 / z) ** 2 * float(form.Z) / (block * dt) ** 2
    if k == 0 or form.deterministic:
        return out
    Phi, Qd = discretise(form, dt)
    Phi, Q = linear.accumulate(Phi, Qd, _row(form) / block, block)
    g = np.ones((k + 1, z.size), dtype=complex)
    g[:k] = _resolvent(z, Phi[:k, :k], Phi[k, :k])
    return np.asarray(out + np.einsum("if,if->f", g, (Q @ g.conj())).real)


def _resolvent(z: NDArray[np.complex128], Phi: Array, row: Array) -> NDArray[np.complex128]:
    """``(z I - Phi')^-1 row``, shape (k, m): states of their own and pairs in closed form, for that takes the time."""
    k, own = row.size, np.diagonal(Phi)
    if np.array_equal(Phi, np.diag(own)):
        return np.asarray(row[:, None] / (z - own[:, None]))
    if k == 2:
        (a, b), (c, d) = Phi.T
        det = (z - a) * (z - d) - b * c
        return np.array([((z - d) * row[0] + b * row[1]) / det, (c * row[0] + (z - a) * row[1]) / det])
    lhs = z[:, None, None] * np.eye(k) - Phi.T
    right = np.broadcast_to(row[:, None], (z.size, k, 1))
    return np.asarray(np.linalg.solve(lhs, right)[..., 0].T)


def mean(form: LinearSystem, t: Array) -> Array:
    """The expected output, shape (n,), on evenly spaced times `t` [s] since the states were `x0`."""
    n, k = t.size, form.order
    if k == 0:
        return np.zeros(n)
    A, W = _matrices(form)
    x0 = np.array(form.x0 or (0.0,) * k, dtype=np.float64)
    if A.any():
        dt = float(t[-1] - t[0]) / (n - 1) if n > 1 else 0.0
        (before, Phi), _ = linear.van_loan(A, W, np.array([float(t[0]), dt]))
        X = linear.propagate(Phi, before @ x0, n)
    else:  # a constant
        X = np.broadcast_to(x0, (n, k))
    return sum(
        (np.broadcast_to(np.asarray(c, float), (n,)) * X[:, i] for i, c in enumerate(form.C)), np.zeros(n)
    )


def simulate(form: LinearSystem, t: Array, rng: np.random.Generator) -> Array:
    """One random output, shape (n,), on evenly spaced times `t` [s]."""
    n, k = t.size, form.order
    dt = float(t[-1] - t[0]) / (n - 1) if n > 1 else 1.0
    y = mean(form, t)
    if float(form.V):
        y = y + rng.standard_normal(n) * np.sqrt(float(form.V) / dt)
    if float(form.Z):
        q = rng.standard_normal(n + 1) * np.sqrt(float(form.Z))
        y = y + np.diff(q) / dt
    if k and not form.deterministic:
        Phi, Qd = discretise(form, dt)
        P0 = initial_covariance(form)
        x0 = rng.multivariate_normal(np.zeros(k), P0) if P0.any() else np.zeros(k)
        y = y + linear.simulate(Phi, Qd, x0, n, rng) @ _row(form)
    return y
