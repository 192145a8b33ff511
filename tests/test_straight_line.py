"""Proves the straight-line form and its interpreters: the same formula has the same value in all of them.

Values are those of Python's math, coefficients of power series those of sympy's derivatives.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy as sp
from in_part import in_part

from kfgen.audit.exact.padic import PRIMES, Ring
from kfgen.audit.exact.power_series import Runner, exact_writer
from kfgen.core.expression import FUNCTIONS, read_expression, symbol
from kfgen.core.straight_line import BINARY, UNARY, as_written, straight_line
from kfgen.core.tape import CODES, tape

U, V, T, A = symbol("u"), symbol("v"), symbol("t"), symbol("a")
RING = Ring(PRIMES[0], 6)
ORDERS = 7


def operations(text: str) -> list[str]:
    """Names of the operations of a formula, but variables and constants."""
    line = straight_line([read_expression(text, ["u", "v"]).value], [U, V])
    return [o.name for o in line.operations if o.operands]


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("u - v", ["sub"]),
        ("-u - v", ["neg", "sub"]),
        ("-u*v + u", ["mul", "sub"]),
        ("u/v/v", ["mul", "div"]),
        ("1/u", ["inv"]),
        ("u/sqrt(v)", ["sqrt", "div"]),
        ("u**5", ["mul", "mul", "mul"]),
        ("(u + v)**2", ["add", "mul"]),
        ("u**1.5", ["sqrt", "mul"]),
        ("u**v", ["pow"]),
        ("sin(u)*cos(v)/sin(u)", ["cos"]),
        ("u*v + sin(v*u)", ["mul", "sin", "add"]),
        ("max(u, v, 1)", ["max", "max"]),
        ("sqrt(2)*u", ["mul"]),
    ],
)
def test_operations_are_few(text: str, wanted: list[str]) -> None:
    assert sorted(operations(text)) == sorted(wanted)


def test_exact_numbers_are_those_that_are_written() -> None:
    line = straight_line([U * sp.Float(0.1) + sp.Rational(1, 3)], [U], numbers=as_written)
    assert {o.value for o in line.operations if o.name == "constant"} == {Fraction(1, 10), Fraction(1, 3)}
    assert [o.name for o in straight_line([U * sp.sqrt(2)], [U], numbers=as_written).operations].count(
        "sqrt"
    ) == 1


@pytest.mark.parametrize("name", UNARY + BINARY)
def test_the_compiled_loop_has_the_values_of_numpy(name: str) -> None:
    compiled = pytest.importorskip("kfgen.model.plant.compiled")
    r = np.zeros((3, 4))
    r[:2] = [[0.7, -0.4, 0.1, 0.9], [0.3, 2.0, -1.5, 0.9]]
    if name in ("log", "sqrt", "pow"):
        r[0] = np.abs(r[0])
    compiled.run_tape(np.array([[CODES[name], 0, 1]]), 2, r)
    operation = tape([U], [U])
    operation = type(operation)(2, np.zeros(0), np.array([[CODES[name], 0, 1]]), np.array([2]))
    (wanted,) = operation.values(list(r[:2]))
    assert r[2] == pytest.approx(wanted, rel=1e-15)


@pytest.mark.parametrize("size", [1, 6, 7, 8, 20])
def test_a_table_has_the_values_of_its_formulas_whatever_its_blocks(
    size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kfgen.core.tape.ROWS_AT_ONCE", 7)
    u = np.linspace(-1.0, 2.0, size)
    found = tape([U, U * V + 1, V, sp.Integer(3)], [U, V]).table([u, np.array([0.5])])
    np.testing.assert_allclose(
        found, np.column_stack([u, 0.5 * u + 1.0, np.full(size, 0.5), np.full(size, 3.0)])
    )


def series(formula: sp.Expr) -> list[int]:
    """Coefficients of a function of t, by the audit."""
    writer = exact_writer([T])
    place = writer.place(formula)
    time: list[int] = []
    runner = Runner(writer, RING, [time])
    for k in range(ORDERS):
        time.append(int(k == 1))
        runner.step(k)
    return runner.series[place]


def derivatives(formula: sp.Expr) -> list[sp.Expr]:
    """Coefficients of a function of t, by sympy."""
    out = []
    for k in range(ORDERS):
        out.append(formula.subs(T, 0) / math.factorial(k))
        formula = formula.diff(T)
    return out


def in_ring(e: sp.Expr, known: dict[sp.Expr, int]) -> int:
    """The residue of an expression of known numbers."""
    if e in known:
        return known[e]
    if e.is_Rational:
        return RING.of(Fraction(int(e.p), int(e.q)))
    parts = [in_ring(a, known) for a in e.args[: 1 if e.is_Pow else None]]
    if e.is_Pow:
        root = RING.sqrt(parts[0]) if e.exp.q == 2 else parts[0]
        return pow(root, int(e.exp.p), RING.m)
    return (sum(parts) if e.is_Add else math.prod(parts)) % RING.m


# Of each function: a formula with a start at which its coefficients are fractions.
EXACT = {
    "sin": "sin(t + t**2/3)",
    "cos": "cos(t + t**2/3)",
    "tan": "tan(t + t**2/3)",
    "asin": "asin(t + t**2/3)",
    "acos": "acos(t + t**2/3)",
    "atan": "atan(t + t**2/3)",
    "atan2": "atan2(t, 1 + t/2)",
    "exp": "exp(t + t**2/3)",
    "log": "log(1 + t + t**2/3)",
    "sqrt": "sqrt(1 + t + t**2/3)",
    "tanh": "tanh(t + t**2/3)",
    "power": "(1 + t)**(t + 1/3)",
    "quotient": "(2 + t)/(3 - t + t**2)",
    "inverse": "(3 - t + t**2)**-3",
}
BRANCHES = {
    "abs": "abs(1 + t)",
    "sign": "sign(1 + t)",
    "min": "min(1 + t, 2 + t)",
    "max": "max(1 + t, 2 + t)",
}


@pytest.mark.parametrize("name", in_part(EXACT, 2))
def test_a_power_series_has_the_coefficients_of_sympy(name: str) -> None:
    formula = read_expression(EXACT[name], ["t"]).value
    wanted = derivatives(formula)
    first = int(name == "acos")  # its constant is left out
    assert series(formula)[first:] == [in_ring(e, {}) for e in wanted[first:]]


@pytest.mark.parametrize("name", BRANCHES)
def test_what_has_corners_is_one_of_its_branches(name: str) -> None:
    found = series(read_expression(BRANCHES[name], ["t"]).value)
    assert found[1] == (name != "sign")
    assert not any(found[2:])


def test_every_function_of_a_formula_has_a_power_series() -> None:
    assert set(FUNCTIONS) <= EXACT.keys() | BRANCHES.keys()


@pytest.mark.parametrize(
    "function", [sp.sin, sp.cos, sp.tan, sp.asin, sp.atan, sp.exp, sp.log, sp.sqrt, sp.tanh]
)
def test_at_any_point_the_derivatives_are_those_of_sympy(function: Any) -> None:
    """There a function's value is a number like any other, of which its derivatives are made."""
    point = Fraction(3, 5) if function is sp.asin else Fraction(4, 9)
    moving = T - T**2 / 3
    found = series(function(sp.Rational(point) + moving))
    values = {A: RING.of(point), function(A): found[0]}
    if function in (sp.sin, sp.cos):
        other = sp.cos if function is sp.sin else sp.sin
        values[other(A)] = series(other(sp.Rational(point) + moving))[0]
        assert (found[0] ** 2 + values[other(A)] ** 2) % RING.m == 1
    wanted = [in_ring(e, values) for e in derivatives(function(A + moving))]
    assert found == wanted


def test_near_zero_functions_have_the_value_of_their_series() -> None:
    """At multiples of the prime, where series converge, the laws of functions hold."""
    x, y = RING.p * sp.Integer(3), RING.p * sp.Integer(5)

    def at(e: sp.Expr) -> int:
        return series(e)[0]

    assert at(sp.exp(x, evaluate=False) * sp.exp(y, evaluate=False)) == at(sp.exp(x + y, evaluate=False))
    assert at(sp.sin(x) ** 2 + sp.cos(x) ** 2) == 1
    assert at(sp.tan(sp.atan(x))) == at(sp.sin(sp.asin(x))) == at(x)
    assert at(sp.tanh(x)) == at((sp.exp(2 * x) - 1) / (sp.exp(2 * x) + 1))
