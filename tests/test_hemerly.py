"""Proves the state space, the filters and the readings of Hemerly 2017 on their own terms.

Equations (18), (19) and (22) are typed in as printed; the expectation maximisation is held against the joint Gaussian
of a short record and against its law that no round lowers the likelihood; the extended filter against the emitted
filterpy class of the library model, stepped by hand. Statistical tests fix their seeds and state their rates.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from click.testing import Result
from in_part import in_part
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import norm

from kfgen.arma import state_space as ss
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name
from kfgen.identify.evidence.allan import allan_curve
from kfgen.identify.evidence.record import Record
from kfgen.identify.identify import identify
from kfgen.identify.methods import ekf, em
from kfgen.identify.methods.arma import solve
from kfgen.identify.methods.asymptotes import read_asymptotes, short_white
from kfgen.identify.methods.ekf import run_ekf
from kfgen.identify.methods.saini import Parameters
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.register import DT
from kfgen.run.run import load

Array = NDArray[np.float64]
Call = Callable[..., Result]

x1, x2, B, K, beta = ss.STATES
r = sp.sqrt(K**2 + beta**2 * B**2)
T = ss.SAMPLING_PERIOD
A_22 = sp.Matrix([
    [1, T, 0, 0, 0], [0, 1 - T * beta, 0, 0, -T * x2], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1],
])  # fmt: skip
C_22 = sp.Matrix([[K * beta, r, x2 * B * beta**2 / r, x1 * beta + x2 * K / r, x1 * K + x2 * B**2 * beta / r]])
POINT = Parameters(N=5.75e-2, B=1.55e-2, K=9e-4, beta=0.01)
TRIO = ("white_noise", "gauss_markov", "rate_random_walk")


def zero(M: sp.Matrix) -> bool:
    return all(sp.simplify(e) == 0 for e in M)


def test_equation_18_is_the_factor_of_both_noises() -> None:
    """|j w r + K beta|^2 / |j w (j w + beta)|^2 = beta^2 B^2 / (w^2 + beta^2) + K^2 / w^2."""
    w = sp.Symbol("w", positive=True)
    factor = (w**2 * r**2 + K**2 * beta**2) / (w**2 * (w**2 + beta**2))
    assert sp.simplify(factor - beta**2 * B**2 / (w**2 + beta**2) - K**2 / w**2) == 0


def test_equations_19_and_20() -> None:
    step = ss.step()
    assert zero(sp.Matrix(step[:2]) - sp.Matrix([[1, T], [0, 1 - beta * T]]) * sp.Matrix([x1, x2]))
    assert zero(sp.Matrix(step[2:]) - sp.Matrix([B, K, beta]))
    assert zero(sp.Matrix([ss.output()]) - sp.Matrix([[K * beta, r]]) * sp.Matrix([x1, x2]))


def test_equation_22_is_the_jacobian() -> None:
    assert zero(ss.transition() - A_22)
    assert zero(ss.output_row() - C_22)


def test_the_library_model_derives_equation_22() -> None:
    discrete = DiscreteModel(build("hemerly-ekf"))
    model = discrete.model
    assert zero(discrete.Phi - A_22.subs(T, DT))
    assert zero(model.H(model.sensors[0]) - C_22)
    assert zero(discrete.Qd - sp.diag(0, DT, 0, 0, 0))


def test_three_of_five_are_seen() -> None:
    """Rank 3 at exact rational points; both directions of the reference are null, symbolically and by name."""
    O = ss.frozen_observability()
    rng = np.random.default_rng(2)
    for _ in range(3):
        v = [sp.Rational(int(k), 7) for k in rng.integers(1, 30, 6)]
        beta_v, B_v = (
            sp.Rational(3, 5),
            sp.Rational(4, 3) * v[3],
        )  # r = K sqrt(1 + (beta B / K)^2) is rational
        B_v = sp.Rational(3, 4) * v[3] / beta_v
        at = {x1: v[0], x2: v[1], K: v[3], beta: beta_v, B: B_v, T: sp.Rational(1, 100)}
        assert O.subs(at).rank() == 3
    known = [
        sp.Matrix([-B * beta * x2 / (K * r), 0, 1, 0, 0]),
        sp.Matrix([-(K * x2 + r * beta * x1) / (K * r * beta), 0, 0, 1, 0]),
    ]
    for found, wanted in zip(ss.hidden_directions(), known):
        assert zero(found - wanted)
        assert zero(O * wanted)


def test_the_printed_condition_number_is_rounding() -> None:
    """In double precision the singular matrix has some huge condition number: of order 1e22 and more in the paper."""
    names = (*ss.STATES, T)
    O = sp.lambdify(names, ss.frozen_observability(), "numpy")
    values = [np.linalg.cond(O(5.0 * k, 3.0, 1.55e-2, 9e-4, 0.01, 0.01)) for k in range(1, 20)]
    assert min(values) > 1e15


def test_the_audit_explains_it(kfgen: Call) -> None:
    """Through the public entry: rank 3 of 5 and two hidden directions, along the trajectory of the nonlinear system too."""
    result = kfgen("audit", "hemerly-ekf")
    assert result.exit_code == 0, result.output
    assert "rank 3 of 5, 2 hidden" in result.stdout
    assert "nan" not in result.stdout
    for name in ("B", "K", "x1"):
        assert f" {name}" in result.stdout


# Expectation maximisation.


def joint(n: int, dt: float, a: float, c: Array, R: float) -> tuple[Array, Array]:
    """Covariance of [x1, x2] over all samples and of y, built from the definition."""
    A, V = np.array([[1.0, dt], [0.0, a]]), np.diag([1 / c[0] ** 2, dt / (1 - a * a)])
    X = np.zeros((2 * n, 2 * n))
    for k in range(n):
        X[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = V
        forward = V
        for m in range(k + 1, n):
            forward = A @ forward
            X[2 * m : 2 * m + 2, 2 * k : 2 * k + 2] = forward
            X[2 * k : 2 * k + 2, 2 * m : 2 * m + 2] = forward.T
        V = A @ V @ A.T + np.diag([0.0, dt])
    return X, np.kron(np.eye(n), c[None, :])


def test_smoother_is_that_of_the_joint_gaussian() -> None:
    n, dt, a, c, R = 7, 0.3, 0.8, np.array([0.4, 1.1]), 0.5
    y = np.random.default_rng(0).standard_normal(n)
    X, H = joint(n, dt, a, c, R)
    S = H @ X @ H.T + R * np.eye(n)
    gain = X @ H.T @ np.linalg.inv(S)
    mean, P = gain @ y, X - gain @ H @ X
    E = P + np.outer(mean, mean)
    first, second = np.arange(0, 2 * n, 2), np.arange(1, 2 * n, 2)
    wanted = [
        E[first, first].sum(), E[first, second].sum(), E[second, second].sum(), y @ mean[first], y @ mean[second],
        E[second[1:], second[:-1]].sum(), E[second[:-1], second[:-1]].sum(),
    ]  # fmt: skip
    value, known = em._forward(y, dt, a, c, R)
    assert em._backward(y, dt, a, known) == pytest.approx(wanted, rel=1e-10)
    assert value == pytest.approx(-0.5 * (np.linalg.slogdet(S)[1] + y @ np.linalg.solve(S, y)), rel=1e-12)


def noises(seed: int, n: int, dt: float, N: float, sigma: float, tau: float, K: float) -> Array:  # noqa: PLR0917
    """White noise, a Gauss-Markov process and a walk, by numpy and scipy."""
    rng = np.random.default_rng(seed)
    e = np.exp(-dt / tau)
    w = sigma * rng.standard_normal(n)
    w[1:] *= np.sqrt(1 - e * e)
    y = N / np.sqrt(dt) * rng.standard_normal(n) + lfilter([1.0], [1.0, -e], w)
    return np.asarray(y + np.cumsum(K * np.sqrt(dt) * rng.standard_normal(n)))


@pytest.mark.long
def test_no_round_lowers_the_likelihood() -> None:
    y = noises(4, 5000, 0.1, 0.1, 0.5, 5.0, 0.02)
    found = em.run_em(y - y.mean(), 0.1, Parameters(0.2, 1.0, 0.1, 0.05), rounds=60)
    steps = np.diff(found.values)
    assert len(steps) > 20
    assert steps.min() > -1e-9 * abs(found.values[0])
    assert steps[:5].min() > 0.0


def test_em_finds_a_strong_process() -> None:
    """sigma 0.5, tau 20 s over 4000 s: within 5 standard deviations of the bound (6e-7), and Euler's step."""
    N, sigma, tau = 0.5, 0.5, 20.0
    y = noises(8, 40_000, 0.1, N, sigma, tau, 0.001)
    found = identify(Record(np.arange(y.size) * 0.1, y), None, "em")
    markov = next(e for e in found.fit.effects if e.name == "gauss_markov")
    assert np.log(markov.sigma / sigma) == pytest.approx(0.0, abs=5 * found.bounds[1, "sigma"] + 0.02)
    assert np.log(markov.tau / tau) == pytest.approx(0.0, abs=5 * found.bounds[1, "tau"] + 0.02)
    assert np.log(found.fit.effects[0].N / N) == pytest.approx(0.0, abs=5 * found.bounds[0, "N"] + 0.02)


@pytest.mark.long
def test_what_is_nothing_is_left_out() -> None:
    """White noise alone: no parameter stands with an interval of no width, and N is right (5 bounds, 6e-7)."""
    y = 0.1 * np.random.default_rng(0).standard_normal(20_000)
    for method in ("em", "ekf"):
        found = identify(Record(np.arange(y.size) * 0.01, y), None, method)
        for lo, hi in found.intervals.values():
            assert hi > 1.001 * lo
        if method == "em":
            assert pytest.approx(0.01, rel=5 * 0.005) == found.fit.effects[0].N
    for end in (
        Parameters(1.0, 0.0, 1e-3, 0.1),
        Parameters(1.0, 0.1, 0.0, 0.1),
        Parameters(1.0, 0.0, 0.0, 0.1),
    ):
        assert len(end.effects()) == 1 + (end.B > 0) + (end.K > 0)


# The extended filter.


def test_the_filter_is_the_emitted_one() -> None:
    """The emitted filterpy class steps to second order, Euler to first: at 1e4 Hz both agree to the difference."""
    dt, y = 1e-4, np.deg2rad(noises(3, 300, 1e-4, 5.75e-4, 1.1e-3, 100.0, 9e-4))
    model = build("hemerly-ekf")
    program = Program(DiscreteModel(model, rate=1.0 / dt))
    kf = getattr(load(program), class_name(program))()
    x0, P0 = np.array(kf.nominal), np.diag([1e12, 1e6, *(0.5 * np.array(kf.nominal[2:])) ** 2])
    kf.P = P0.copy()
    R = float(program.discrete.measurement_variance(model.sensors[0], "gyro_x"))
    x, P = ekf._filter(y, dt, R, (-np.inf, np.inf), (x0, P0), ss.numbers())
    for value in y:
        kf.update_rest(np.array([value]))
        kf.predict(driver=0.0, dt=dt)
    deviations = np.sqrt(np.diag(P0))
    assert (np.array(kf.nominal) - x) / deviations == pytest.approx(np.zeros(5), abs=1e-6)
    assert (kf.P - P) / np.outer(deviations, deviations) == pytest.approx(np.zeros((5, 5)), abs=1e-6)
    assert abs(x[0] - x0[0]) > 5e-4 * deviations[0]  # it has moved


def test_the_filter_ends_where_it_starts() -> None:
    """Sec. 4: B stays near its start, K depends on it. Two starts a factor of nine apart on one record stay apart."""
    y = noises(1, 100_000, 0.01, 5.75e-2, 1.55e-2 * np.sqrt(0.005), 100.0, 9e-4)
    low, high = (
        run_ekf(y - y.mean(), 0.01, Parameters(5.75e-2, 1.55e-2 * f, 9e-4, 0.01)).end.B for f in (1 / 3, 3.0)
    )
    assert high > 3.0 * low


# The equivalent ARMA model and the asymptotes.


@pytest.mark.long
def test_section_2_3_with_B_as_a_deviation() -> None:
    """N and B without K at 10 Hz, 1e5 samples: errors within 5 standard deviations (6e-7) of bounds .002 and .084."""
    y = noises(0, 100_000, 0.1, 5.75e-2, 1.55e-2, 100.0, 0.0)
    found = solve(y, 0.1, ("white_noise", "gauss_markov"))
    size = {e.name: e for e in found.effects}
    assert np.log(size["white_noise"].N / 5.75e-2) == pytest.approx(0.0, abs=5 * 0.002)
    assert np.log(size["gauss_markov"].sigma / 1.55e-2) == pytest.approx(0.0, abs=5 * 0.084)


@pytest.mark.long
def test_section_2_2_shows_no_process() -> None:
    """The autoregression is no exp(-T/tau), as in the paper (-0.9783); N is within 5 bounds, 0.0022."""
    y = noises(0, 100_000, 0.01, 5.75e-2, 1.55e-2 * np.sqrt(0.005), 100.0, 9e-4)
    found = identify(Record(np.arange(y.size) * 0.01, y), None, "arma")
    assert found.fit.effects[0].name == "white_noise"
    assert pytest.approx(5.75e-2, rel=5 * 0.0022) == found.fit.effects[0].N
    assert "gauss_markov" not in [e.name for e in found.fit.effects]
    assert any("no exp(-dt/tau)" in w for w in found.warnings)


def test_a_variance_of_few_samples() -> None:
    """Remark 3.4: 6000 samples have a relative standard deviation of 1 / sqrt(12000); 5 of them (6e-7) and 0.1 % of drift."""
    y = noises(5, 100_000, 0.01, 5.75e-2, 1.1e-3, 100.0, 9e-4)
    assert short_white(y, 0.01) == pytest.approx(5.75e-2, rel=5 / np.sqrt(12_000) + 0.001)


def test_the_crossing_is_no_bias_instability() -> None:
    """At the point of sec. 2.2 with B of eq. (18), and without any B, nothing is read; a true floor is."""
    own_floor = []
    for seed in range(12):
        y = noises(seed, 100_000, 0.01, 5.75e-2, 1.1e-3 * (seed % 2), 100.0, 9e-4)
        own_floor.append(read_asymptotes(allan_curve(y, 0.01)).B_is_own)
    assert sum(own_floor) <= 2
    flicker = make("bias_instability", B=0.05, shortest=0.1, longest=1e4)
    y = noises(3, 100_000, 0.1, 0.1, 0.0, 1.0, 1e-5) + flicker.simulate(
        np.arange(100_000) * 0.1, np.random.default_rng(0)
    )
    seen = read_asymptotes(allan_curve(y, 0.1))
    assert seen.B_is_own
    assert seen.B.size == pytest.approx(0.05, rel=0.25)


def test_asymptotes_of_exact_curves() -> None:
    """Curves of IEEE Std 952: N / sqrt(tau) at 1 s and K sqrt(tau / 3) at 3 s, far from the crossing."""
    y = noises(0, 400_000, 0.1, 0.02, 0.0, 1.0, 1e-3)
    seen = read_asymptotes(allan_curve(y, 0.1))
    assert seen.N is not None
    assert seen.K is not None
    assert seen.N.size == pytest.approx(0.02, rel=0.05)
    assert np.log(seen.K.size / 1e-3) == pytest.approx(0.0, abs=norm.isf(1e-4) * seen.K.deviation + 0.1)


# The command line.


def write(path: Path, y: Array) -> Path:
    lines = ["t [s],gyro_x [deg/s]", *(f"{k / 10:.1f},{v:.7f}" for k, v in enumerate(y))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("method", in_part(["arma", "ekf", "em", "asymptotes"]))
def test_methods_by_name(kfgen: Call, tmp_path: Path, method: str) -> None:
    log = write(tmp_path / "log.csv", noises(2, 20_000, 0.1, 0.1, 0.5, 5.0, 0.01))
    out = tmp_path / "id.json"
    result = kfgen("identify", log, "--method", method, "--json", out, "-o", tmp_path / "n.toml",
                   "--report", tmp_path / "r.html")  # fmt: skip
    assert result.exit_code == 0, result.output
    effects = json.loads(out.read_text())["channels"]["gyro_x"]["effects"]
    (N,) = (e["parameters"]["N"]["value"] for e in effects if e["effect"] == "white_noise")
    assert np.rad2deg(N) == pytest.approx(0.1, rel=1.0 if method == "ekf" else 0.25)
    assert f'"method" = "{method}"' in (tmp_path / "n.toml").read_text()


@pytest.mark.parametrize(("method", "effects", "words"), [
    ("ekf", "white_noise", "exactly"),
    ("em", "white_noise,gauss_markov", "exactly"),
    ("arma", "white_noise,warm_up", "no equivalent ARMA model"),
    ("arma", "gauss_markov,rate_random_walk,quantisation", "does not tell"),
    ("asymptotes", "gauss_markov", "no asymptote"),
])  # fmt: skip
def test_effects_that_a_method_has_not(
    kfgen: Call, tmp_path: Path, method: str, effects: str, words: str
) -> None:
    log = write(tmp_path / "log.csv", noises(2, 2000, 0.1, 0.1, 0.5, 5.0, 0.01))
    result = kfgen("identify", log, "--method", method, "--effects", effects)
    assert result.exit_code == 2
    assert words in f"{result.exception} {result.stderr}"


def test_a_curve_has_no_samples(kfgen: Call, tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(
        "tau [s],gyro_x [deg/s]\n" + "\n".join(f"{2.0**k},{0.1 * 2 ** (-k / 2)}" for k in range(12))
    )
    result = kfgen("identify", path, "--method", "em")
    assert result.exit_code == 2
    assert isinstance(result.exception, InputError)


def test_the_model_runs_on_a_log_without_its_driver(kfgen: Call, tmp_path: Path) -> None:
    """The driver is noise alone; simulating along a manoeuvre is refused in words."""
    log = write(tmp_path / "log.csv", noises(2, 500, 0.1, 0.1, 0.1, 5.0, 0.01))
    assert kfgen("run", "hemerly-ekf", log).exit_code == 0
    refused = kfgen("simulate", "hemerly-ekf", "-o", tmp_path / "s.csv")
    assert refused.exit_code == 2
    assert "driver" in str(refused.exception)
