"""python-control as an independent witness: one step by `c2d`, the steady covariance by `dlqe`, plants by responses.

It shares no code with what it is held against: its matrix exponential and its Riccati solver are scipy's.
"""

from __future__ import annotations

import control
import numpy as np
import pytest
import sympy as sp
from in_part import in_part
from numpy.typing import NDArray

from kfgen.audit.degree import Horizon, degree
from kfgen.core.linear import van_loan
from kfgen.effects import make
from kfgen.emit.routines import Program
from kfgen.log.log import Channel, Log
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.discretise import DT, DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.motion import AtRestMotion
from kfgen.model.parts.sensors import AtRest
from kfgen.model.plant.file import parse_model
from kfgen.model.plant.plant import simulate
from kfgen.run.run import run

Array = NDArray[np.float64]

MODELS = {
    "walk": (make("rate_random_walk", K=1e-4), make("bias", sd=0.2)),
    "markov": (
        make("gauss_markov", sigma=2e-3, tau=0.7),
        make("rate_random_walk", K=2e-3),
        make("bias", sd=0.2),
    ),
    "resonance": (
        make("resonance", frequency=3.0, damping=0.1, rms=1e-3),
        make("gauss_markov", sigma=2e-3, tau=2.0),
    ),
}
WHITE = make("white_noise", N=1e-4)


def model(name: str) -> FilterModel:
    return FilterModel(name, name, AtRestMotion(), (AtRest(),), {"gyro_x": (WHITE, *MODELS[name])})


def numbers(M: sp.Matrix, dt: float = 0.0) -> Array:
    return np.array(M.subs(DT, dt), dtype=np.float64)


def step_of(A: Array, dt: float) -> Array:
    """The transition of ``dx/dt = A x`` over `dt` [s]."""
    n = len(A)
    return np.asarray(control.c2d(control.ss(A, np.eye(n), np.eye(n), np.zeros((n, n))), dt).A)


def noise_of(A: Array, W: Array, dt: float) -> Array:
    """The covariance of its noise of density `W`: Van Loan's blocks, in the transition of a larger system."""
    n = len(A)
    step = step_of(np.block([[-A, W], [np.zeros((n, n)), A.T]]), dt)
    return np.asarray(step[n:, n:].T @ step[:n, n:])


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("dt", [1e-3, 0.01, 0.1])
def test_a_step_is_that_of_c2d(name: str, dt: float) -> None:
    discrete = DiscreteModel(model(name))
    F, G, W = (numbers(M) for M in (discrete.model.F, discrete.model.G, discrete.model.W))
    Phi, Qd = step_of(F, dt), noise_of(F, G @ W @ G.T, dt)
    np.testing.assert_allclose(numbers(discrete.Phi, dt), Phi, rtol=1e-7, atol=1e-7 * np.abs(Phi).max())
    np.testing.assert_allclose(numbers(discrete.Qd, dt), Qd, rtol=1e-5, atol=1e-6 * np.abs(Qd).max())


def test_a_step_of_any_stable_system_is_that_of_c2d() -> None:
    rng = np.random.default_rng(5)
    for n in range(1, 7):
        A = rng.standard_normal((n, n)) - 2.0 * np.eye(n)
        root = rng.standard_normal((n, n))
        Phi, Qd = van_loan(A, root @ root.T, 0.3)
        np.testing.assert_allclose(Phi, step_of(A, 0.3), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(Qd, noise_of(A, root @ root.T, 0.3), rtol=1e-8, atol=1e-12)


def steady(discrete: DiscreteModel, R: float) -> Array:
    """Standard deviations after an update, in the steady state."""
    dt = 1.0 / discrete.rate
    H, n = numbers(discrete.H(discrete.model.sensors[0])), len(discrete.model.states)
    _, P, _ = control.dlqe(numbers(discrete.Phi, dt), np.eye(n), H, numbers(discrete.Qd, dt), np.array([[R]]))
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return np.asarray(np.sqrt(np.diag((np.eye(n) - K @ H) @ P)))


@pytest.mark.parametrize("name", in_part(MODELS))
def test_the_steady_covariance_is_that_of_dlqe(name: str) -> None:
    """Of the emitted filter over a log, and of the audit at a sample a step."""
    discrete = DiscreteModel.at_rate(model(name), 50.0)
    R = 50.0 * 1e-4**2
    wanted = steady(discrete, R)
    log = Log(np.arange(4000) / 50.0, {"gyro_x": Channel(np.zeros(4000), "rad/s")})
    np.testing.assert_allclose(run(Program(discrete), log).deviation[-1], wanted, rtol=2e-3)
    along = degree(discrete, LIBRARY["static"], Horizon(12.0, 50.0), 0)
    np.testing.assert_allclose(along.sigma[-1], wanted, rtol=0.02 if name != "resonance" else 0.05)


SPRING = """
format = "kfgen-model-1"
name = "spring"
[states]
x = { unit = "m", initial = "0.1 m", sd = "0.01 m" }
v = { unit = "m/s", initial = "-0.3 m/s", sd = "0.01 m/s" }
[inputs]
u = "N"
[dynamics]
x = "v"
v = "-30.0*x - 0.8*v + 2.0*u"
[measurements.place]
unit = "m"
expression = "x + 0.05*v"
effects = [ { effect = "white_noise", N = "1e-3 m/sqrt(Hz)" } ]
"""


def test_a_plant_moves_as_a_forced_response() -> None:
    t = np.arange(600) * 0.01
    u = np.sign(np.sin(2.1 * t)) * np.cos(0.37 * t)
    plant = control.ss([[0.0, 1.0], [-30.0, -0.8]], [[0.0], [2.0]], [[1.0, 0.05]], [[0.0]])
    held = control.forced_response(control.c2d(plant, 0.01), t, u, [0.1, -0.3])
    found = simulate(parse_model(SPRING, "spring.toml"), t, {"u": u})
    np.testing.assert_allclose(found.channels["place"][:, 0], held.outputs, atol=1e-7)
    np.testing.assert_allclose(found.states[:, :, 0], held.states.T, atol=1e-6)
