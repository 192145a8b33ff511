"""Proves that linear systems are discretised exactly, at any step against any time constant.

References are mpmath at 60 to 100 digits: closed forms of docs/noise.md (whose float64 versions cancel), polynomials
of integrated chains, and ``Qd = P - Phi P Phi'`` with ``P`` from a Kronecker solve, itself checked by quadrature.
Rounding tolerances: 1e-12 relative for each entry of Qd, 1e-13 absolute for Phi of a stable system.
The two Monte Carlo checks alarm falsely in 1e-6 of the seeds each; seeds are fixed.
"""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2

from kfgen.core import linear

Array = NDArray[np.float64]

STEPS = [10.0**k for k in range(-8, 7)]
COUPLED = np.array([[-0.1, 1.0, 0.0], [-1.0, -0.3, 0.5], [0.2, 0.0, -1.0]])
COUPLED_W = np.array([[0.5, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 2.0]])


def to_array(M: mp.matrix) -> Array:
    return np.array([[float(M[i, j]) for j in range(M.cols)] for i in range(M.rows)])


def lyapunov(A: mp.matrix, W: mp.matrix) -> mp.matrix:
    """P with A P + P A' + W = 0, by one linear system for its entries."""
    n = A.rows
    L, b = mp.zeros(n * n, n * n), mp.zeros(n * n, 1)
    for i in range(n):
        for j in range(n):
            b[i * n + j] = -W[i, j]
            for k in range(n):
                L[i * n + j, k * n + j] += A[i, k]
                L[i * n + j, i * n + k] += A[j, k]
    x = mp.lu_solve(L, b)
    return mp.matrix(n, n) + mp.matrix([[x[i * n + j] for j in range(n)] for i in range(n)])


def angle_and_bias(N: float, q: float, beta: float, dt: float) -> Array:
    """docs/noise.md, exact Qd of an angle that integrates white noise and a Gauss-Markov bias."""
    with mp.workdps(60):
        N, q, b, t = mp.mpf(N), mp.mpf(q), mp.mpf(beta), mp.mpf(dt)
        e = mp.exp(-b * t)
        q11 = N**2 * t + (q / b) ** 2 * (t - 2 * (1 - e) / b + (1 - e**2) / (2 * b))
        q12 = -((q / b) ** 2) / 2 * (1 - e) ** 2
        q22 = q**2 * (1 - e**2) / (2 * b)
        return to_array(mp.matrix([[q11, q12], [q12, q22]]))


@pytest.mark.parametrize("beta_dt", STEPS)
@pytest.mark.parametrize("beta", [1e-4, 1.0, 250.0])
def test_gauss_markov(beta: float, beta_dt: float) -> None:
    sigma, dt = 0.3, beta_dt / beta
    Phi, Qd = linear.van_loan(np.array([[-beta]]), np.array([[2 * sigma**2 * beta]]), dt)
    with mp.workdps(60):
        x = mp.mpf(beta) * mp.mpf(dt)
        assert Phi[0, 0] == pytest.approx(float(mp.exp(-x)), rel=1e-13, abs=1e-13)
        assert Qd[0, 0] == pytest.approx(float(mp.mpf(sigma) ** 2 * -mp.expm1(-2 * x)), rel=1e-12)


@pytest.mark.parametrize("beta_dt", STEPS)
def test_angle_with_gauss_markov_bias(beta_dt: float) -> None:
    N, q, beta = 0.02, 0.5, 0.1
    A, W = np.array([[0.0, -1.0], [0.0, -beta]]), np.diag([N**2, q**2])
    _, Qd = linear.van_loan(A, W, beta_dt / beta)
    np.testing.assert_allclose(Qd, angle_and_bias(N, q, beta, beta_dt / beta), rtol=1e-12)


@pytest.mark.parametrize("dt", STEPS)
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_integrated_chain(order: int, dt: float) -> None:
    """White noise integrated `order` times: Q_ij = q dt^(a+b+1) / (a! b! (a+b+1)), a, b integrations left."""
    A = np.diag(np.ones(order - 1), 1)
    W = np.zeros((order, order))
    W[-1, -1] = q = 0.7
    Phi, Qd = linear.van_loan(A, W, dt)
    f = math.factorial
    for i in range(order):
        for j in range(order):
            a, b = order - 1 - i, order - 1 - j
            assert Qd[i, j] == pytest.approx(q * dt ** (a + b + 1) / (f(a) * f(b) * (a + b + 1)), rel=1e-12)
            power = dt ** (j - i) / f(j - i) if j >= i else 0.0
            assert Phi[i, j] == pytest.approx(power, rel=1e-12, abs=0.0)


def coupled_reference(dt: float) -> tuple[Array, Array]:
    with mp.workdps(100):
        A, W = mp.matrix(COUPLED.tolist()), mp.matrix(COUPLED_W.tolist())
        P, Phi = lyapunov(A, W), mp.expm(A * mp.mpf(dt))
        return to_array(Phi), to_array(P - Phi * P * Phi.T)


@pytest.mark.parametrize("dt", STEPS)
def test_coupled_system(dt: float) -> None:
    Phi, Qd = linear.van_loan(COUPLED, COUPLED_W, dt)
    Phi_ref, Qd_ref = coupled_reference(dt)
    np.testing.assert_allclose(Phi, Phi_ref, rtol=0, atol=1e-13)
    np.testing.assert_allclose(Qd, Qd_ref, rtol=1e-11, atol=1e-13 * np.abs(Qd_ref).max())


def test_the_reference_is_the_integral() -> None:
    dt = 2.0
    with mp.workdps(30):
        A, W = mp.matrix(COUPLED.tolist()), mp.matrix(COUPLED_W.tolist())

        def entry(i: int, j: int) -> mp.mpf:
            def integrand(s: mp.mpf) -> mp.mpf:
                E = mp.expm(A * s)
                return (E * W * E.T)[i, j]

            return mp.quad(integrand, [0, dt], maxdegree=4)

        _, Qd = linear.van_loan(COUPLED, COUPLED_W, dt)
        for i, j in ((0, 0), (0, 2), (1, 2)):
            assert Qd[i, j] == pytest.approx(float(entry(i, j)), rel=1e-12)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 5), log_dt=st.floats(-6, 1))
def test_lyapunov_identity(seed: int, n: int, log_dt: float) -> None:
    """Any system, stable or not: d Qd / d dt is both A Qd + Qd A' + W and Phi W Phi'."""
    rng = np.random.default_rng(seed)
    A, root, dt = rng.standard_normal((n, n)) / n, rng.standard_normal((n, n)), 10.0**log_dt
    W = root @ root.T
    Phi, Qd = linear.van_loan(A, W, dt)
    left, right = A @ Qd + Qd @ A.T + W, Phi @ W @ Phi.T
    scale = np.abs(A @ Qd).max() + np.abs(W).max() + np.abs(right).max()
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-11 * scale)
    np.testing.assert_array_equal(Qd, Qd.T)
    assert np.linalg.eigvalsh(Qd).min() >= -1e-13 * np.abs(Qd).max()


@pytest.mark.parametrize("dt", [1e3, 1e6, 1e12])
def test_no_overflow_when_the_step_is_long(dt: float) -> None:
    """exp(-A dt) of the plain method is beyond any float here; Qd is the stationary covariance."""
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        Phi, Qd = linear.van_loan(COUPLED, COUPLED_W, dt)
    with mp.workdps(120):
        P = to_array(lyapunov(mp.matrix(COUPLED.tolist()), mp.matrix(COUPLED_W.tolist())))
    np.testing.assert_allclose(Phi, 0.0, atol=1e-15)
    np.testing.assert_allclose(Qd, P, rtol=1e-11)


def test_many_steps_at_once_are_as_exact_as_one_by_one() -> None:
    """Short steps must not lose digits to the longest one that happens to be in the same call."""
    dt = np.array(STEPS).reshape(3, 5)
    A, W = np.array([[0.0, 1.0], [0.0, -1.0]]), np.diag([0.3, 2.0])
    Phi, Qd = linear.van_loan(A, W, dt)
    assert Phi.shape == Qd.shape == (3, 5, 2, 2)
    for at in np.ndindex(dt.shape):
        one_Phi, one_Qd = linear.van_loan(A, W, dt[at])
        np.testing.assert_allclose(Phi[at], one_Phi, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(Qd[at], one_Qd, rtol=1e-12)


@pytest.mark.parametrize("dt", [1e-6, 0.3, 40.0])
def test_states_of_their_own_that_share_noise(dt: float) -> None:
    """``W_ik`` times the integral of ``exp((a_i + a_k) s)`` over the step, by quadrature; a walk and a growing state too."""
    own, W = [-0.3, 0.0, -40.0, 0.02], COUPLED_W @ COUPLED_W.T
    W = np.pad(W, (0, 1)) + np.outer([0.1, 0.2, 0.3, 1.0], [0.1, 0.2, 0.3, 1.0])
    Phi, Qd = linear.van_loan(np.diag(own), W, dt)
    ends = [0.0, dt / 1000.0, dt / 100.0, dt / 10.0, dt]
    for i, k in np.ndindex(4, 4):
        integral = mp.quad(lambda s: mp.exp((own[i] + own[k]) * s), ends)  # noqa: B023 - used at once
        assert Qd[i, k] == pytest.approx(W[i, k] * float(integral), rel=1e-12)
        assert Phi[i, k] == pytest.approx(math.exp(own[i] * dt) if i == k else 0.0, rel=1e-14, abs=0.0)


def test_no_state_and_no_time() -> None:
    Phi, Qd = linear.van_loan(np.zeros((0, 0)), np.zeros((0, 0)), 1.0)
    assert Phi.shape == Qd.shape == (0, 0)
    Phi, Qd = linear.van_loan(COUPLED, COUPLED_W, 0.0)
    np.testing.assert_array_equal(Phi, np.eye(3))
    np.testing.assert_array_equal(Qd, np.zeros((3, 3)))


def test_stationary_covariance() -> None:
    with mp.workdps(120):
        P = to_array(lyapunov(mp.matrix(COUPLED.tolist()), mp.matrix(COUPLED_W.tolist())))
    np.testing.assert_allclose(linear.stationary_covariance(COUPLED, COUPLED_W), P, rtol=1e-12)


@pytest.mark.parametrize("A", [[[0.0]], [[0.0, 1.0], [0.0, -1.0]], [[0.1]]])
def test_what_is_not_stable_has_no_stationary_covariance(A: list[list[float]]) -> None:
    W = np.eye(len(A))
    np.testing.assert_array_equal(linear.stationary_covariance(np.array(A), W), np.zeros_like(W))


@pytest.mark.parametrize("steps", [0, 1, 2, 3, 7, 8, 100])
def test_accumulate_is_the_sum(steps: int) -> None:
    """Against sums over powers: w_j reaches x_n by Phi^(n-1-j), the running sum by C (I + ... + Phi^(n-2-j))."""
    Phi, Qd = linear.van_loan(COUPLED, COUPLED_W, 0.3)
    C = np.array([1.0, -2.0, 0.5])
    powers = [np.linalg.matrix_power(Phi, k) for k in range(steps + 1)]
    sums = [sum(powers[:k], np.zeros((3, 3))) for k in range(steps + 1)]
    reach = [np.vstack([powers[steps - 1 - j], C @ sums[steps - 1 - j]]) for j in range(steps)]
    Phi_ref = np.vstack([np.hstack([powers[steps], np.zeros((3, 1))]), [*(C @ sums[steps]), 1.0]])
    Q_ref = sum((M @ Qd @ M.T for M in reach), np.zeros((4, 4)))
    Phi_a, Q_a = linear.accumulate(Phi, Qd, C, steps)
    np.testing.assert_allclose(Phi_a, Phi_ref, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(Q_a, Q_ref, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 64, 101])
def test_propagate(n: int) -> None:
    Phi, _ = linear.van_loan(COUPLED, COUPLED_W, 0.1)
    x0 = np.array([1.0, -2.0, 3.0])
    expected = [np.linalg.matrix_power(Phi, k) @ x0 for k in range(n)]
    np.testing.assert_allclose(linear.propagate(Phi, x0, n), expected, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("A", [np.diag([-0.1, -2.0, 0.0]), COUPLED], ids=["diagonal", "coupled"])
def test_simulate_obeys_the_system(A: Array) -> None:
    """It starts at x0, and its steps, whitened with Qd, are chi-square (two-sided, 1e-6)."""
    Phi, Qd = linear.van_loan(A, COUPLED_W, 0.2)
    x0, n = np.array([5.0, -4.0, 3.0]), 4000
    X = linear.simulate(Phi, Qd, x0, n, np.random.default_rng(1))
    np.testing.assert_allclose(X[0], x0, rtol=1e-14)
    white = np.linalg.solve(np.linalg.cholesky(Qd), (X[1:] - X[:-1] @ Phi.T).T)
    assert X.shape == (n, 3)
    lo, hi = chi2.ppf([0.5e-6, 1 - 0.5e-6], white.size)
    assert lo < float((white**2).sum()) < hi
    product = white @ white.T / white.shape[1]
    off = product[np.triu_indices(3, 1)] * math.sqrt(white.shape[1])
    assert np.abs(off).max() < 5.0


def of_many_digits(A: Array, W: Array, h: float) -> tuple[Array, Array]:
    """Van Loan's one exponential: what it loses of 120 digits is none of a double's sixteen."""
    with mp.workdps(120):
        block = np.block([[-A, W], [np.zeros_like(A), A.T]])
        E = mp.expm(mp.matrix(block.tolist()) * mp.mpf(h), method="taylor")
        Phi = E[2:4, 2:4].T
        return to_array(Phi), to_array(Phi * E[0:2, 2:4])


@pytest.mark.parametrize("turn", [0.05, 0.6, 3.0, 14.0])
@pytest.mark.parametrize("damping", [2e-4, 0.02, 0.7, 3.0])
def test_two_states_that_drive_each_other_are_exact(turn: float, damping: float) -> None:
    """A resonance and an overdamped pair, steps from 0.05 rad to two periods, the position first or second."""
    w = 40.0
    A, W = np.array([[0.0, 1.0], [-(w**2), -2.0 * damping * w]]), np.diag([1.0, 4.0 * damping * w**3])
    for order in ([0, 1], [1, 0]):
        own, driven, unit = A[np.ix_(order, order)], W[np.ix_(order, order)], np.array([1.0, w])[order]
        Phi, Qd = linear.van_loan(own, driven, turn / w)
        wanted, noise = of_many_digits(own, driven, turn / w)
        size = np.sqrt(np.outer(np.diag(noise), np.diag(noise)))
        np.testing.assert_allclose(
            Phi * unit / unit[:, None], wanted * unit / unit[:, None], atol=1e-13, rtol=0
        )
        np.testing.assert_allclose(Qd / size, noise / size, atol=1e-12, rtol=0)
