"""States that drive one another, in factors: the prediction is the dense one, and costs little more than without them.

The dense formula is numpy's, in double precision; the transitions are the model's own, or random ones of a model file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from in_part import in_part

from kfgen.emit.covariance.order import in_groups, work
from kfgen.emit.folder import write_folder
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.plant.equations import filter_model
from kfgen.model.plant.file import parse_model
from kfgen.model.register import DT
from kfgen.model.symbols.rotation import atoms, matrix_of, rotated
from kfgen.verify.compare import verify

TURNING = {"earth_rate": "true"}
LEVEL = {**TURNING, "transport_rate": "true", "gravity_model": "normal"}
EARTH_FIXED = {"frame": "ecef"}
BODY = {"attitude_error": "local-quaternion"}
STEP = 0.02


Chosen = tuple[tuple[str, str], ...]


@cache
def discrete(name: str, options: Chosen) -> DiscreteModel:
    return DiscreteModel(
        circle(int(name[6:])) if name.startswith("circle") else build(name, None, dict(options))
    )


@cache
def program(name: str, options: Chosen, loops: bool = False) -> Program:
    made = Program(discrete(name, options), "ud", "double", loops, q_interval=0.0)
    if loops:
        first = program(name, options)
        first.covariance  # noqa: B018  computes the transition in symbols, which is slow
        vars(made).update({k: vars(first)[k] for k in ("atoms", "transition")})
    return made


def emitted(name: str, options: dict[str, str]) -> Program:
    """As `emit` makes it: noise of biases waits."""
    return Program(discrete(name, tuple(options.items())), "ud")


def linear(A: np.ndarray) -> FilterModel:
    """A model file of the states s0, s1, ... with these dynamics, an input that drives all, a measurement of the first."""
    rows = [" + ".join(f"({a})*s{j}" for j, a in enumerate(row) if a) or "0*s0" for row in A]
    states = "\n".join(f's{k} = {{ unit = "1", initial = "0", sd = "1" }}' for k in range(len(A)))
    dynamics = "\n".join(f's{k} = "{row} + u"' for k, row in enumerate(rows))
    text = f"""
format = "kfgen-model-1"
name = "circle"
[states]
{states}
[inputs]
u = "1"
[dynamics]
{dynamics}
[measurements.y]
unit = "1"
expression = "s0"
effects = [ {{ effect = "white_noise", N = "0.1 1/sqrt(Hz)" }} ]
"""
    return filter_model(parse_model(text, "circle.toml"))


def circle(seed: int) -> FilterModel:
    """Five states of which each drives some others at random, and a sixth that all of them need."""
    rng = np.random.default_rng(seed)
    A = np.round(rng.normal(size=(6, 6)) * (rng.random((6, 6)) < 0.5) * 8.0, 3)
    A[np.arange(5), (np.arange(5) + 1) % 5] = 3.0
    A[:5, 5], A[5] = 1.0, 0.0
    return linear(A)


def numbers(d: DiscreteModel) -> tuple[list[str], Callable[..., list[np.ndarray]]]:
    """Phi and Qd as a function of the numbers of symbols."""
    symbols = sorted(d.Phi.free_symbols | d.Qd.free_symbols, key=str)
    return [s.name for s in symbols], sp.lambdify(symbols, [d.Phi, d.Qd], cse=True)


@cache
def matrices(name: str, options: Chosen) -> tuple[list[str], Callable[..., list[np.ndarray]]]:
    return numbers(discrete(name, options))


def dense(
    name: str, options: Chosen, x: np.ndarray, given: dict[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Phi and Qd in numbers."""
    d = discrete(name, options)
    values = dict(zip(d.nominal_names, x, strict=True)) | given | {str(DT): STEP}
    values |= {c.name: c.value for c in d.model.constants}
    if d.model.attitude is not None:
        R = matrix_of(sp.Matrix([values[s.name] for s in d.model.attitude.quaternion]))
        values |= {s.name: float(e) for s, e in zip(d.model.attitude.nominal, R)}
    symbols, function = matrices(name, options)
    made = function(*(values[s] for s in symbols))
    return np.array(made[0], float), np.array(made[1], float)


def started(p: Program, seed: int) -> tuple[Machine, dict[str, float], np.ndarray]:
    """A machine at a random state with a random covariance, inputs, and that covariance."""
    rng = np.random.default_rng(seed)
    kf = Machine(p, np.float64)
    kf.call("init")
    x = rng.normal(size=len(p.discrete.nominal_names))
    if "q_w" in p.discrete.nominal_names:
        at = p.discrete.nominal_names.index("q_w")
        x[at : at + 4] /= np.linalg.norm(x[at : at + 4])
    kf.arrays["x"][:] = x
    sd = np.array([s.prior for s in p.discrete.model.states])
    A = rng.normal(size=(p.n, 2 * p.n)) * sd[:, None]
    P = A @ A.T
    at = np.array(p.covariance.order)
    L = np.linalg.cholesky(P[np.ix_(at, at)][::-1, ::-1])[::-1, ::-1]
    U, D = L / np.diag(L), np.diag(L) ** 2
    kf.arrays["UD"][:] = (U - np.eye(p.n) + np.diag(D))[np.triu_indices(p.n)]
    given = {c: float(rng.normal()) for i in p.discrete.model.motion.inputs for c in i.channels}
    return kf, given, P


def arguments(p: Program, given: dict[str, float]) -> Sequence[Sequence[float] | float]:
    inputs = p.discrete.model.motion.inputs
    return [*([given[c] for c in i.channels] if not i.scalar else given[i.name] for i in inputs), STEP]


CASES = [*((f"circle{k}", {}) for k in range(6)), ("ins15", TURNING)]
CASES += [pytest.param("ins15", o, marks=pytest.mark.long) for o in (LEVEL, EARTH_FIXED)]


@pytest.mark.parametrize("loops", in_part([False, True]))
@pytest.mark.parametrize(("name", "options"), in_part(CASES))
def test_prediction_is_the_dense_one(name: str, options: dict[str, str], loops: bool) -> None:
    """To rounding: 1e-11 of the product of the two standard deviations, at three states."""
    chosen = tuple(options.items())
    p = program(name, chosen, loops)
    for seed in range(3):
        kf, given, P = started(p, seed)
        Phi, Qd = dense(name, chosen, kf.arrays["x"].copy(), given)
        assert kf.call("predict", arguments(p, given)) == "OK"
        wanted = Phi @ P @ Phi.T + Qd
        sd = np.sqrt(np.diag(wanted))
        assert np.abs((kf.covariance() - wanted) / np.outer(sd, sd)).max() < 1e-11


def test_a_diagonal_of_zero_is_turned_away() -> None:
    """``1 - 2 dt u`` is exactly zero at ``u = 2`` and a step of a quarter; the covariance has full rank all the same."""
    p = Program(DiscreteModel(linear(np.array([[0.0, 2.0], [-2.0, 0.0]])), max_step=0.25), "ud", "double")
    kf = Machine(p, np.float64)
    kf.call("init")
    first, second = p.covariance.order
    sign = 1.0 if (first, second) == (0, 1) else -1.0
    kf.arrays["UD"][:] = 1.0, sign * 2.0, 1.0
    P = kf.covariance()
    assert kf.call("predict", (0.0, 0.25)) == "OK"
    Phi = np.array([[1.0, 0.5], [-0.5, 1.0]])
    _, Qd = numbers(p.discrete)[1](0.25)
    np.testing.assert_allclose(kf.covariance(), Phi @ P @ Phi.T + np.array(Qd, float), rtol=1e-13)


@pytest.mark.parametrize(
    ("Phi", "groups"),
    [
        ({0: [0, 1], 1: [1, 2]}, ((0,), (1,), (2,), (3,))),
        ({1: [0, 1]}, ((1,), (0,), (2,), (3,))),
        ({1: [1, 3], 3: [1, 3], 0: [0, 3]}, ((0,), (1, 3), (2,))),
    ],
)
def test_groups_need_later_ones_only(Phi: dict[int, list[int]], groups: tuple[tuple[int, ...], ...]) -> None:
    assert in_groups(4, Phi) == groups


def test_a_rotation_times_its_transpose_is_one() -> None:
    """``R (R' c + d) = c + R d``, with what is no multiple of a whole column left alone."""
    R, c, d = atoms("R"), sp.Matrix(sp.symbols("c0:3")), sp.Matrix(sp.symbols("d0:3"))
    assert rotated(R, R.T * c + d) == c + R * d
    assert (rotated(R, R * c) - R * (R * c)).expand().is_zero_matrix


def test_the_order_of_a_group_is_the_cheapest_of_all() -> None:
    """Runs of states are moved; here every order is tried."""
    needs = {0: {1, 4}, 1: {2}, 2: {0, 3}, 3: {5}, 4: {3}, 5: {2, 4}}
    driven = {0, 3}
    (found,) = in_groups(6, {i: sorted({i, *row}) for i, row in needs.items()}, tuple(driven))
    least = min(work(order, needs, (0, 6), driven) for order in permutations(range(6)))
    assert work(found, needs, (0, 6), driven) == least


FLAT_TIMES = {"ins15": 1.5, "ins23": 1.5, "ins33": 1.5}


@pytest.mark.parametrize(
    "name", [*list(FLAT_TIMES)[:1], *(pytest.param(n, marks=pytest.mark.long) for n in list(FLAT_TIMES)[1:])]
)
def test_a_turning_earth_costs_half_as_much_again_at_most(name: str) -> None:
    """Operations of a whole prediction against the one without Earth rate."""
    flat, turning = (emitted(name, o).predict.operations for o in ({}, TURNING))
    assert flat < turning <= FLAT_TIMES[name] * flat


@pytest.mark.parametrize(
    ("options", "most"), [(TURNING, 1460), (LEVEL, 2400), (EARTH_FIXED, 1790), (BODY, 1392)]
)
def test_budget(options: dict[str, str], most: int) -> None:
    """Counts are the same on every machine; a covariance itself takes 1433, 2911, 1941 and 1227."""
    assert emitted("ins15", options).predict.operations <= most


@pytest.mark.long
@pytest.mark.parametrize(("options", "most"), [(TURNING, 2100), (LEVEL, 3830), (EARTH_FIXED, 2930)])
def test_words_on_a_core_are_those_of_the_host(options: dict[str, str], most: int, tmp_path: Path) -> None:
    """And the instructions of a prediction on a Cortex-M4F stay within 3 % of what they are (1604 without Earth rate).

    One in which the noise of a bias comes in takes 1730 more, as it does without Earth rate.
    """
    p = Program(DiscreteModel(build("ins15", None, options)), "ud")
    write_folder(p, "c", None, tmp_path / "f")
    found = verify(tmp_path / "f", ["host", "m4f", "rv32imfc"]).verdicts
    assert [v.differing for v in found] == [0, 0, 0]
    assert all(v.words > 1000 for v in found)
    assert found[1].cost.least["predict"] <= most
    assert found[1].cost.instructions["predict"] <= most + 1800
