"""Exact discretisation, propagation and simulation of linear stochastic systems.

For ``dx = A x dt + dw`` with ``E[dw dw'] = W dt`` the sampled system is
``x[k+1] = Phi x[k] + w[k]`` with ``Phi = exp(A dt)`` and
``Qd = int_0^dt exp(A s) W exp(A s)' ds`` [1]_. Van Loan's one exponential of a matrix with
``-A`` in it overflows when ``dt`` is long against the time constants; here a series is taken over a
short step, which is then doubled: ``Q <- Q + Phi Q Phi'``, ``Phi <- Phi Phi``.

References
----------
.. [1] C. F. Van Loan, Computing integrals involving the matrix exponential,
   IEEE Trans. Automatic Control 23(3), 1978, eq. (1.4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


MAX_SERIES_NORM = 0.25
"""Norm of ``A h`` at which the series is taken at most; the rest is doubling."""
MIN_TURN_OF_DIFFERENCE_RAD, MIN_DECAY_OF_DIFFERENCE = 0.5, 1e-3
"""Of an oscillator in a step, and of its power: below, the noise of a step is no difference of covariances, in which
digits are lost; twelve are left."""
SERIES_RELATIVE_TOLERANCE = 2e-17
"""Next term of the series over its first: below the rounding."""


def taylor(one: Any, A: Any, W: Any, h: Any, order: int) -> tuple[Any, Any]:
    """The Taylor series of ``Phi`` and ``Qd`` to `order` in `h`, for numbers or for symbols.

    ``Phi = sum_k A^k h^k / k!``; from ``dQ/dt = A Q + Q A' + W``, ``Qd = sum_k Q_k h^(k+1) / (k+1)!`` with
    ``Q_0 = W`` and ``Q_(k+1) = A Q_k + Q_k A'`` (differentiate eq. (1.4) of [1]_ at zero): no
    difference of large terms, so nothing cancels.

    Parameters
    ----------
    one, A, W : matrix, shape (n, n)
        Identity, dynamics [1/s] and density of the driving noise [U^2/s].
    h : scalar, or ndarray of shape (..., 1, 1)
        Step [s].
    order : int
        The highest power of `h` in ``Phi``.

    Returns
    -------
    Phi, Qd : matrix, shape (n, n), or (..., n, n) for an array of steps
    """
    Phi, Qd, power, density, scale = one, 0 * W, one, W, 1
    for k in range(1, order + 1):
        power, scale = power @ A, scale * h / k
        Phi, Qd = Phi + power * scale, Qd + density * scale
        product = A @ density
        density = product + product.T
    return Phi, Qd


def van_loan(A: Array, W: Array, dt: ArrayLike) -> tuple[Array, Array]:
    """Transition and process noise covariance over `dt`.

    Parameters
    ----------
    A : ndarray, shape (n, n)
        Dynamics [1/s].
    W : ndarray, shape (n, n)
        Density of the driving noise, ``E[dw dw'] = W dt``.
    dt : array_like, shape (...)
        Steps [s].

    Returns
    -------
    Phi, Qd : ndarray, shape (..., n, n)
        Not a number where A is none, or is beyond any.
    """
    dt = np.asarray(dt, dtype=np.float64)
    n = A.shape[0]
    if n == 0:
        return np.zeros((*dt.shape, 0, 0)), np.zeros((*dt.shape, 0, 0))
    norm = float(np.abs(A).sum(axis=1).max()) * dt
    if not np.isfinite(norm).all():
        return (np.full((*dt.shape, n, n), np.nan),) * 2
    own = np.diagonal(A)
    if np.count_nonzero(A) == np.count_nonzero(own):
        return _of_own_states(own * dt[..., None], W * dt[..., None, None])
    if n == 2 and not dt.ndim and A[0, 1] * A[1, 0] != 0.0:
        return _of_pair(A, W, dt)
    return _by_doubling(A, W, dt, norm)


def _by_doubling(A: Array, W: Array, dt: Array, norm: Array) -> tuple[Array, Array]:
    """The same by a series over a short step, from the norm of ``A dt``."""
    doublings = np.ceil(np.log2(np.maximum(norm, MAX_SERIES_NORM) / MAX_SERIES_NORM)).astype(int)
    terms = _terms(float((norm / 2.0**doublings).max(initial=0.0)))
    Phi, Qd = taylor(np.eye(len(A)), A, W, (dt / 2.0**doublings)[..., None, None], terms)
    fewest = int(doublings.min(initial=int(doublings.max(initial=0))))
    for k in range(int(doublings.max(initial=0))):
        twice = Qd + Phi @ Qd @ np.swapaxes(Phi, -1, -2), Phi @ Phi
        if k >= fewest:  # some steps have all of theirs
            more = (doublings > k)[..., None, None]
            twice = np.where(more, twice[0], Qd), np.where(more, twice[1], Phi)
        Qd, Phi = twice
    return Phi, 0.5 * (Qd + np.swapaxes(Qd, -1, -2))


def _of_own_states(decay: Array, driven: Array) -> tuple[Array, Array]:
    """The same in closed form where no state drives another.

    ``exp(a_i h)`` and ``W_ik h (exp((a_i + a_k) h) - 1) / (a_i + a_k) h``, from ``a_i h``, shape (..., n), and ``W h``.
    """
    both = decay[..., :, None] + decay[..., None, :]
    constant = both == 0.0
    share = np.where(constant, 1.0, np.expm1(both) / np.where(constant, 1.0, both))
    return np.exp(decay)[..., None] * np.eye(decay.shape[-1]), driven * share


def _of_pair(A: Array, W: Array, dt: Array) -> tuple[Array, Array]:
    """The same of two states that drive each other, one in units that make both couplings about as large."""
    # A power of two rounds nothing.
    scale = np.array([1.0, 2.0 ** round(0.5 * math.log2(abs(A[1, 0] / A[0, 1])))])
    A, W = A * scale / scale[:, None], W / np.outer(scale, scale)
    found = _of_oscillator(A, W, float(dt))
    if found is None:
        found = _by_doubling(A, W, dt, np.abs(A).sum(axis=1).max() * dt)
    return found[0] * scale[:, None] / scale, found[1] * np.outer(scale, scale)


def _of_oscillator(A: Array, W: Array, h: float) -> tuple[Array, Array] | None:
    """The same in closed form where two states swing; None where they do not, or the step is too short for a difference.

    With ``s = tr A / 2`` and ``q^2 = det A - s^2``: ``Phi = exp(s h) (cos(q h) I + sin(q h) / q (A - s I))`` (Cayley and
    Hamilton), ``Qd = P - Phi P Phi'`` with ``P = -(det A W + (A - tr A I) W (A - tr A I)') / (2 tr A det A)``.
    """
    (a, b), (c, d) = A.tolist()
    trace, det = a + d, a * d - b * c
    s, q2 = 0.5 * trace, det - 0.25 * trace * trace
    if not (
        q2 > 0.0 and -trace * h > MIN_DECAY_OF_DIFFERENCE and det * h * h > MIN_TURN_OF_DIFFERENCE_RAD**2
    ):
        return None
    q = math.sqrt(q2)
    cosine, sine = math.exp(s * h) * math.cos(q * h), math.exp(s * h) * math.sin(q * h) / q
    Phi = np.array([[cosine + sine * (a - s), sine * b], [sine * c, cosine + sine * (d - s)]])
    turned = np.array([[-d, b], [c, -a]])  # A - tr A I
    P = -(det * W + turned @ W @ turned.T) / (2.0 * trace * det)
    Qd = P - Phi @ P @ Phi.T
    return Phi, 0.5 * (Qd + Qd.T)


def _terms(norm: float) -> int:
    """Terms of the series at a norm of ``A h``: of ``Qd`` the next over the first is ``(2 norm)^k / (k + 1)!``."""
    terms, following = 1, norm
    while following > SERIES_RELATIVE_TOLERANCE:
        terms += 1
        following *= 2.0 * norm / (terms + 1)
    return terms


def stationary_covariance(A: Array, W: Array) -> Array:
    """The covariance that the system keeps, zero for a system that has none.

    Parameters
    ----------
    A, W : ndarray, shape (n, n)
        As in `van_loan`.

    Returns
    -------
    ndarray, shape (n, n)
        ``P`` with ``A P + P A' + W = 0`` when every eigenvalue of A is stable, else zero
        (a random walk starts at zero: where it stood before the record is a constant).
    """
    if A.shape[0] == 1:
        return W / (-2.0 * A) if A[0, 0] < 0.0 else np.zeros_like(A)
    decay = -np.linalg.eigvals(A).real if A.shape[0] else np.zeros(1)
    if decay.min() <= np.finfo(float).eps * np.abs(decay).max():  # at that, rounding decides
        return np.zeros_like(A)
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov

    # Balanced by powers of two: a slow resonance has a one beside the square of its frequency.
    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    P: Array = solve_continuous_lyapunov(balanced, -W / np.outer(scale, scale)) * np.outer(scale, scale)
    return 0.5 * (P + P.T)


def beside(parts: Sequence[Array]) -> Array:
    """Square matrices one after the other on the diagonal of one, zeros elsewhere."""
    # scipy's block_diag takes twenty times as long on small ones, of which a likelihood has many.
    edges = np.cumsum([0, *(p.shape[0] for p in parts)])
    out = np.zeros((edges[-1], edges[-1]))
    for a, b, part in zip(edges[:-1], edges[1:], parts):
        out[a:b, a:b] = part
    return out


def accumulate(Phi: Array, Qd: Array, C: Array, steps: int) -> tuple[Array, Array]:
    """The system of the state and of the running sum of its output, over many steps.

    Parameters
    ----------
    Phi, Qd : ndarray, shape (n, n)
        One step.
    C : ndarray, shape (n,)
        Output row; the sum takes ``C x`` before each step.
    steps : int
        How many.

    Returns
    -------
    Phi_a, Q_a : ndarray, shape (n + 1, n + 1)
        Transition and noise covariance of ``[x, sum]`` over all steps, by binary powers.
    """
    n = C.size
    Phi_1 = np.zeros((n + 1, n + 1))
    Q_1 = np.zeros((n + 1, n + 1))
    Phi_1[:n, :n], Phi_1[n, :n], Phi_1[n, n] = Phi, C, 1.0
    Q_1[:n, :n] = Qd
    Phi_a, Q_a = np.eye(n + 1), np.zeros((n + 1, n + 1))
    while steps:
        if steps & 1:
            Phi_a, Q_a = Phi_1 @ Phi_a, Phi_1 @ Q_a @ Phi_1.T + Q_1
        Phi_1, Q_1 = Phi_1 @ Phi_1, Phi_1 @ Q_1 @ Phi_1.T + Q_1
        steps >>= 1
    return Phi_a, Q_a


def propagate(Phi: Array, x0: Array, n: int) -> Array:
    """The noise-free trajectory ``x[k] = Phi^k x0``, by doubling.

    Parameters
    ----------
    Phi : ndarray, shape (m, m)
        Transition of one step.
    x0 : ndarray, shape (m,)
        State at the first sample.
    n : int
        Samples.

    Returns
    -------
    ndarray, shape (n, m)
    """
    X = np.empty((n, x0.size))
    X[0], done, power = x0, 1, Phi
    while done < n:
        take = min(done, n - done)
        X[done : done + take] = X[:take] @ power.T
        power, done = power @ power, done + take
    return X


def simulate(Phi: Array, Qd: Array, x0: Array, n: int, rng: np.random.Generator) -> Array:
    """A random trajectory of ``x[k+1] = Phi x[k] + w[k]``, ``w ~ N(0, Qd)``.

    States that nothing couples are filtered one by one; a coupled system is stepped.

    Parameters
    ----------
    Phi, Qd : ndarray, shape (m, m)
        Transition and process noise covariance of one step.
    x0 : ndarray, shape (m,)
        State at the first sample.
    n : int
        Samples.
    rng : numpy Generator

    Returns
    -------
    ndarray, shape (n, m)
    """
    from scipy.signal import lfilter

    k = x0.size
    root = _root(Qd)
    w = rng.standard_normal((n, k)) @ root.T
    w[1:] = w[:-1].copy()
    w[0] = x0
    if np.count_nonzero(Phi - np.diag(np.diag(Phi))) == 0:
        return np.column_stack([np.asarray(lfilter([1.0], [1.0, -Phi[i, i]], w[:, i])) for i in range(k)])
    X = np.empty((n, k))
    x = np.zeros(k)
    for i in range(n):
        x = Phi @ x + w[i]
        X[i] = x
    return X


def _root(Q: Array) -> Array:
    """A square root of a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(Q)
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))
