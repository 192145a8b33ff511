"""Proves what is emitted by running it: covariances against dense products, expressions against sympy, and each guard.

Statements are run by a few lines of this file in double precision, so that nothing of the targets is in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp

from kfgen.core.errors import InputError
from kfgen.emit.covariance.packed import (
    PackedColumn,
    _acyclic,
    at,
    batches,
    cell,
    each,
    packed_size,
    place,
    predict_covariance,
    total,
)
from kfgen.emit.ir.ir import Bin, For, Let, Note, Num, Ref, Stmt, Store, Una, neg
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.update import variances
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build

RNG = np.random.default_rng(12)


class Runner:
    """Runs statements on a packed triangle ``P`` and locals."""

    def __init__(self, n: int, P: np.ndarray) -> None:
        self.n, self.env = n, dict[str, Any]()
        self.cells = {(i, j): float(P[i, j]) for i in range(n) for j in range(i, n)}

    def index(self, ref: Ref) -> tuple[int, int]:
        i, j = (self.env[k] if isinstance(k, str) else k for k in ref.index)  # type: ignore[union-attr]
        assert i <= j, "an element below the diagonal is stored nowhere"
        return i, j

    def value(self, e: Any) -> float:
        if isinstance(e, Num):
            return e.value
        if isinstance(e, Ref):
            return self.cells[self.index(e)] if isinstance(e.index, tuple) else self.env[e.name]
        if isinstance(e, Una):
            a = self.value(e.a)
            return {"neg": lambda: -a, "sqrt": lambda: math.sqrt(a), "rint": lambda: float(np.rint(a))}.get(
                e.op, lambda: {"abs": abs(a), "sign": float(np.sign(a))}[e.op]
            )()
        a, b = self.value(e.a), self.value(e.b)
        return {"+": lambda: a + b, "-": lambda: a - b, "*": lambda: a * b, "/": lambda: a / b}[e.op]()

    def run(self, body: Sequence[Stmt]) -> None:
        for s in body:
            if isinstance(s, Let):
                self.env[s.name] = self.value(s.value)
            elif isinstance(s, Store):
                self.cells[self.index(s.target)] = self.value(s.value)
            elif isinstance(s, For):
                for k in range(s.start, s.stop):
                    self.env[s.var] = k
                    self.run(s.body)
            else:
                assert isinstance(s, Note)

    def matrix(self) -> np.ndarray:
        M = np.zeros((self.n, self.n))
        for (i, j), v in self.cells.items():
            M[i, j] = M[j, i] = v
        return M


STRUCTURES: dict[str, tuple[int, dict[int, dict[int, float]]]] = {
    "a chain": (6, {0: {0: 1.0, 1: 0.1}, 1: {1: 1.0, 2: 0.2}, 2: {2: 0.9}}),
    "three beside each other": (8, {k: {k: 0.9, 3 + k: 0.5, 6: 0.3} for k in range(3)}),
    "one needs another's": (7, {0: {0: 1.0, 3: 2.0, 4: -1.0}, 1: {1: 0.5, 4: 3.0}, 2: {2: 1.1}}),
    "a circle of three": (7, {0: {0: 0.9, 1: 0.2}, 1: {1: 0.8, 2: 0.3, 5: 1.5}, 2: {0: -0.4, 2: 0.7}}),
    "a circle and what it needs": (
        6,
        {1: {1: 0.9, 2: 0.2}, 2: {1: -0.2, 2: 0.9, 4: 2.0}, 4: {4: 0.5, 5: 1.0}},
    ),
    "without itself": (5, {0: {3: 2.0}, 2: {2: 0.5, 4: 0.25}}),
    "last ones": (6, {4: {4: 0.5, 0: 1.0}, 5: {5: 0.4, 0: 2.0, 1: 3.0}}),
}


@pytest.mark.parametrize("loops", [False, True])
@pytest.mark.parametrize("name", STRUCTURES)
def test_a_prediction_is_the_dense_product(name: str, loops: bool) -> None:
    n, rows = STRUCTURES[name]
    root = RNG.standard_normal((n, n))
    P, Phi, Q = root @ root.T, np.eye(n), np.zeros((n, n))
    for i, row in rows.items():
        Phi[i] = 0.0
        for j, v in row.items():
            Phi[i, j] = v
    Q[0, 0], Q[1, 2], Q[2, 1], Q[3, 3] = 0.5, 0.25, 0.25, 0.125
    noise = {(0, 0): Num(0.5), (1, 2): Num(0.25), (3, 3): Num(0.125)}
    written = {i: {j: Num(v) for j, v in row.items()} for i, row in rows.items()}
    body = predict_covariance(n, written, noise, [f"s{k}" for k in range(n)], loops)
    machine = Runner(n, P)
    machine.run(body)
    assert machine.matrix() == pytest.approx(Phi @ P @ Phi.T + Q, rel=1e-12, abs=1e-12)
    assert body[-4] == Note("process noise")


def test_triangles_are_stored_by_rows() -> None:
    assert packed_size(4) == 10
    assert [place(4, i, j) for i in range(4) for j in range(i, 4)] == list(range(10))
    assert cell(3, 1).index == (1, 3)
    assert cell(1, 3, "U") == Ref("U", (1, 3))
    assert cell("k", 1).index == ("k", 1)


def test_a_loops_column_is_right_of_what_is_before_it() -> None:
    """Behind the special column 2 the rows up to 2 come first in an element, later ones second."""
    column = PackedColumn("col", 2)
    assert at(2, column).index == (2, "col")
    assert at(3, column).index == ("col", 3)
    assert at(3, 1).index == (1, 3)
    seen: list[Any] = []

    def of(k: Any) -> list[Stmt]:
        seen.append(k)
        return [Let("v", Num(1.0))]

    each([0, 1, 4, 5, 6, 8], {2, 3, 7}, of, True)
    assert seen == [0, 1, PackedColumn("col", 3), 8]
    assert each([0, 1, 2], {5}, lambda _: [], True) == []
    assert [s.start for s in each([0, 1, 2], {5}, of, True) if isinstance(s, For)] == [0]
    assert seen[-1] == PackedColumn("col", -1)


def test_rows_that_drive_each_other_are_no_batch() -> None:
    one = sp.Integer(1)
    rows = {0: {0: one, 3: one}, 1: {1: one, 0: one}, 2: {2: one, 3: one}}
    assert _acyclic(rows, 2, [0])
    assert not _acyclic(rows, 1, [0])
    assert not _acyclic(rows, 0, [1])
    assert not _acyclic({**rows, 4: {4: one, 2: one}}, 0, [2, 4])
    assert batches({0: {0: one}, 1: {1: one, 2: one}, 2: {2: one}}) == [[0, 1], [2]]


def test_sums_are_from_the_left() -> None:
    a, b, c = (Ref(n) for n in "abc")
    assert total([a, b, c]) == Bin("+", Bin("+", a, b), c)


X, Y = sp.symbols("x y", real=True)


def run(expressions: Sequence[sp.Expr], **values: float) -> tuple[list[float], list[Stmt]]:
    lower = Lowering({n: Ref(n) for n in values}, "k")
    found, body = lower.many(list(expressions))
    machine = Runner(0, np.zeros((0, 0)))
    machine.env |= values
    machine.run(body)
    return [machine.value(e) for e in found], body


@pytest.mark.parametrize(
    "expression",
    [
        X + Y,
        X - Y,
        X * Y,
        X / Y,
        1 / X,
        -X,
        sp.sqrt(X),
        sp.sin(X),
        sp.cos(Y),
        sp.tan(X),
        sp.exp(Y),
        sp.tanh(X),
        sp.atan(Y),
        sp.atan2(Y, X),
        sp.Abs(Y),
        sp.sign(Y),
        X**3 - 2 * X * Y + sp.Rational(1, 3),
        sp.Float(2.5),
    ],
    ids=str,
)
def test_an_expression_is_lowered_to_its_value(expression: sp.Expr) -> None:
    (found,), _ = run([expression], x=0.7, y=-0.4)
    assert found == pytest.approx(float(expression.subs({X: 0.7, Y: -0.4})), rel=1e-12)


def test_what_two_expressions_share_is_made_once() -> None:
    values, body = run([sp.sqrt(X + Y) + 1, sp.sqrt(X + Y) * 2, X], x=3.0, y=1.0)
    assert values == [3.0, 4.0, 3.0]
    assert [s for s in body if isinstance(s, Let)] == [Let("kt0", Una("sqrt", Bin("+", Ref("x"), Ref("y"))))]
    assert run([X + Y], x=1.0, y=2.0)[1] == []


def test_atoms_need_no_local_and_names_are_never_used_twice() -> None:
    lower = Lowering({"x": Ref("x")}, "p")
    assert lower.let(Ref("x")) == (Ref("x"), [])
    assert lower.let(Num(2.0)) == (Num(2.0), [])
    assert lower.let(neg(Ref("x"))) == (neg(Ref("x")), [])
    product = Bin("*", Ref("x"), Ref("x"))
    assert lower.let(product) == (Ref("pt0"), [Let("pt0", product)])
    assert lower.let(neg(product), "h") == (neg(Ref("ph1")), [Let("ph1", product)])
    assert [lower.fresh(), lower.fresh("q")] == ["pt2", "pq3"]
    root = Una("sqrt", Ref("x"))
    assert lower.let(root) == (Ref("pt4"), [Let("pt4", root)])


def test_what_cannot_be_emitted_is_refused() -> None:
    with pytest.raises(InputError, match="the symbol y has no place"):
        Lowering({"x": Ref("x")}).many([X + Y])
    with pytest.raises(InputError, match="cannot be emitted"):
        Lowering({"x": Ref("x")}).many([sp.log(X)])


# The update of a filter at its guards.


@cache
def program_of(form: str, name: str, sensors: str) -> Program:
    return Program(DiscreteModel(build(name, options={"sensors": sensors} if sensors else {})), form)


def machine(form: str, name: str = "ins15", sensors: str = "") -> Machine:
    """A filter at its start, in double precision."""
    found = Machine(program_of(form, name, sensors), np.float64)
    found.call("init")
    return found


@pytest.mark.parametrize("form", ["p", "ud"])
def test_samples_and_variances_that_no_sensor_gives_are_bad_input(form: str) -> None:
    m = machine(form)
    assert m.call("update_gnss_position", [[1.0, 2.0, 3.0]]) == "OK"
    before = m.words().copy()
    for z in ([1e8, 0.0, 0.0], [0.0, 0.0, -1e8], [0.0, math.nan, 0.0]):
        assert m.call("update_gnss_position", [z]) == "BAD_INPUT"
    assert m.call("update_gnss_position", [[0.0, 0.0, 0.0], [1.0, -1.0, 1.0]]) == "BAD_INPUT"
    assert m.call("update_gnss_position", [[0.0, 0.0, 0.0], [1.0, 1.0, math.nan]]) == "BAD_INPUT"
    assert m.words() == pytest.approx(before, nan_ok=True)
    # Only factors need noise.
    exact = m.call("update_gnss_position", [[1.0, 2.0, 3.0], [1.0, 0.0, 1.0]])
    assert exact == ("OK" if form == "p" else "BAD_INPUT")


@pytest.mark.parametrize(("length", "status"), [(0.99, "BAD_INPUT"), (1.0, "OK"), (1.01, "OK")])
def test_a_sample_is_as_long_as_its_sensor_allows(length: float, status: str) -> None:
    """An accelerometer that shows less than 1 m/s^2 says nothing of the vertical."""
    said = machine("p", "ahrs6").call("update_accel", [[0.0, 0.0, -length]])
    assert said == status or (status == "OK" and said != "BAD_INPUT")


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
def test_an_angle_is_compared_with_the_nearest(turns: int) -> None:
    m = machine("p", "ins15", sensors="heading")
    (sensor,) = m.program.discrete.model.sensors  # type: ignore[union-attr]
    assert sensor.period == pytest.approx(2.0 * math.pi)
    m.call(f"update_{sensor.name}", [[0.1 + 2.0 * math.pi * turns]])
    assert m.arrays["innovation"][0] == pytest.approx(0.1)


@pytest.mark.parametrize("form", ["p", "ud"])
def test_a_sample_that_cannot_be_is_gated_and_those_that_go_on_widen(form: str) -> None:
    """Twenty in a row are more than a fault: the covariance of what they show grows."""
    m = machine(form)
    for _ in range(30):
        m.call("update_gnss_position", [[0.0, 0.0, 0.0]])
    before = m.covariance()
    far = 1e3 * math.sqrt(before[0, 0]) + 1e3
    statuses = []
    for _ in range(25):
        if m.covariance()[0, 0] > 10.0 * before[0, 0]:
            break
        statuses.append(m.call("update_gnss_position", [[far, 0.0, 0.0]]))
    assert statuses[0] == "GATED"
    assert len(statuses) == 20
    after = m.covariance()
    assert after[0, 0] > 10.0 * before[0, 0]
    assert np.linalg.eigvalsh(after).min() > -1e-9 * np.abs(after).max()


def test_variances_of_a_call_default_to_those_of_the_model() -> None:
    m = machine("p")
    program, model = m.program, m.program.discrete.model  # type: ignore[union-attr]
    sensor = model.sensors[0]
    R = variances(program, sensor)  # type: ignore[arg-type]
    assert (R.name, R.size, len(R.default)) == ("R", 3, 3)
    given = [program.discrete.measurement_variance(sensor, c) for c in sensor.channels]  # type: ignore[union-attr]
    one, other = machine("p"), machine("p")
    one.call("update_gnss_position", [[1.0, 2.0, 3.0]])
    other.call("update_gnss_position", [[1.0, 2.0, 3.0], given])
    assert one.words() == pytest.approx(other.words(), rel=1e-6)


def test_a_sample_without_noise_needs_the_covariance() -> None:
    for form, is_refused in (("p", False), ("ud", True)):
        program = machine(form).program
        sensor = copy(program.discrete.model.sensors[0])  # type: ignore[union-attr]
        sensor.sd, sensor.left_out = 0.0, 0.0  # type: ignore[misc]
        if is_refused:
            with pytest.raises(InputError, match="without noise"):
                variances(program, sensor)  # type: ignore[arg-type]
        else:
            assert variances(program, sensor).size == 3  # type: ignore[arg-type]


def test_one_exact_channel_is_enough_to_need_the_covariance() -> None:
    """Of three variances 1, 0 and 1 the least counts."""
    program = machine("ud").program
    sensor = program.discrete.model.sensors[0]  # type: ignore[union-attr]
    exact = dict(zip(sensor.channels, (1.0, 0.0, 1.0), strict=True))

    class Discrete:
        @staticmethod
        def measurement_variance(_: object, channel: str) -> float:
            return exact[channel]

    class Exact:
        covariance, discrete = program.covariance, Discrete  # type: ignore[union-attr]

    with pytest.raises(InputError, match="without noise"):
        variances(Exact, sensor)  # type: ignore[arg-type]
