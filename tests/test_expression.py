"""Proves that formulas of model files mean what mathematics says, and that nothing else gets through.

Values are compared with Python's own arithmetic of the same formula, written in the test; malicious texts are
refused at once, with the column.
"""

from __future__ import annotations

import contextlib
import math
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kfgen.core.errors import InputError
from kfgen.core.expression import (
    FUNCTIONS,
    MAX_FORMULA_CHARACTERS,
    MAX_NESTING_LEVELS,
    read_expression,
    symbol,
)
from kfgen.core.tape import tape

X, Y = 0.7, -1.3

VALUES: list[tuple[str, Any]] = [
    ("x + 2*y - 3", X + 2 * Y - 3),
    ("-x**2", -(X**2)),
    ("(-x)**2", X**2),
    ("2**-1*x", 0.5 * X),
    ("2**3**2*x", 512 * X),
    ("x - y - 1", X - Y - 1),
    ("x/y/2", X / Y / 2),
    ("x/(y/2)", X / (Y / 2)),
    ("1.5e-3*x + .5 + 1.", 1.5e-3 * X + 1.5),
    ("--x", X),
    ("x**0.5 + x**1.5", X**0.5 + X**1.5),
    ("x**y", X**Y),
    ("sin(x)*cos(y) + tan(x)", math.sin(X) * math.cos(Y) + math.tan(X)),
    ("asin(x) + acos(x/2) + atan(y)", math.asin(X) + math.acos(X / 2) + math.atan(Y)),
    ("atan2(y, x) + atan2(0, y)", math.atan2(Y, X) + math.atan2(0, Y)),
    ("exp(y) + log(x) + sqrt(x)", math.exp(Y) + math.log(X) + math.sqrt(X)),
    ("abs(y) + sign(y) + sign(x)", 1.3),
    ("min(x, y, 0) + max(x, y)", Y + X),
    ("tanh(x/0.1)", math.tanh(X / 0.1)),
    ("sqrt(2)*x", math.sqrt(2) * X),
    ("1/3*x", X / 3),
    ("x - x", 0.0),
    ("x**-3 + 1/x**2", X**-3 + X**-2),
    ("x**7", X**7),
]


def value(text: str) -> float:
    expression = read_expression(text, ["x", "y"]).value
    (found,) = tape([expression], [symbol("x"), symbol("y")]).values([np.array([X]), np.array([Y])])
    return float(np.broadcast_to(found, (1,))[0])


@pytest.mark.parametrize(("text", "wanted"), VALUES, ids=[t for t, _ in VALUES])
def test_a_formula_has_its_value(text: str, wanted: float) -> None:
    assert value(text) == pytest.approx(wanted, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "column", "what"),
    [
        ("__import__('os').system('ls')", 12, "no part"),
        ("__import__(x)", 1, "'__import__' is not known"),
        ("x.__class__", 2, "no part"),
        ("lambda: x", 7, "no part"),
        ("x; y", 2, "no part"),
        ("x[0]", 2, "no part"),
        ("x if y else 1", 3, "expected an operator"),
        ("eval(x)", 1, "'eval' is not known"),
        ("E", 1, "'E' is not known"),
        ("x ^ 2", 3, "no part"),
        ("2x", 2, "expected an operator"),
        ("(x", 3, r"expected '\)'"),
        ("x +", 4, "found the end"),
        ("", 1, "found the end"),
        ("sin x", 5, r"expected '\(' after sin"),
        ("sin(x, y)", 1, "takes 1 arguments, not 2"),
        ("atan2(x)", 1, "takes 2 arguments, not 1"),
        ("z + 1", 1, "'z' is not known"),
        ("1/0", 2, "division by zero"),
        ("x/(y - y)", 2, "division by zero"),
        ("log(0)", 1, "no number"),
        ("sqrt(-1)", 1, "no number"),
        ("(-8)**(1/3)", 5, "no number"),
        ("1e999*x", 1, "beyond any number"),
        ("9**9**9", 2, "exponent"),
        ("x**1000000", 2, "exponent"),
        ("exp(exp(exp(9)))", 5, "no number"),
        ("ｘ + 1", 1, "no part"),
    ],
)
def test_what_is_no_formula_is_refused_at_its_column(text: str, column: int, what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        read_expression(text, ["x", "y"], "m.toml: [dynamics] x")
    assert caught.value.where == f"m.toml: [dynamics] x, column {column}"


@pytest.mark.parametrize(
    "text",
    [
        "(" * 5000 + "x" + ")" * 5000,
        "(" * 900 + "x" + ")" * 900,
        "-" * 1500 + "x",
        "x**" * 500 + "x",
        "sin(" * 400 + "x" + ")" * 400,
        "((((x**20)**20)**20)**20)**20",
        "((((9**20)**20)**20)**20)**20*x",
        "((x + y)**20)**20",
        "999999999999999**20*" * 60 + "x",
        "x + " * 499 + "x**21",
    ],
)
def test_what_would_take_long_is_refused_at_once(text: str) -> None:
    start = time.perf_counter()
    with pytest.raises(InputError):
        read_expression(text, ["x", "y"])
    assert time.perf_counter() - start < 2.0


def test_limits_are_wide_enough() -> None:
    assert value("(" * (MAX_NESTING_LEVELS - 1) + "x" + ")" * (MAX_NESTING_LEVELS - 1)) == X
    long = "+".join(["x"] * (MAX_FORMULA_CHARACTERS // 2))
    assert value(long) == pytest.approx(MAX_FORMULA_CHARACTERS // 2 * X, rel=1e-12)


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="Known are theta, omega; functions sin, cos") as caught:
        read_expression("thta", ["theta", "omega"])
    assert all(f in str(caught.value) for f in FUNCTIONS)


def test_text_is_kept_and_names_are_found() -> None:
    e = read_expression("  -g*sin(x) + 0*y ", ["x", "y", "g"])
    assert e.text == "-g*sin(x) + 0*y"
    assert e.names == {"g", "x"}


TEXTS = st.text(alphabet="xy0123456789+-*/()., esincoxpabq_^", max_size=40)


@settings(max_examples=300, deadline=None)
@given(TEXTS)
def test_any_text_is_a_formula_or_an_input_error(text: str) -> None:
    with contextlib.suppress(InputError):
        assert read_expression(text, ["x", "y"]).names <= {"x", "y"}


def formulas() -> st.SearchStrategy[str]:
    leaf = st.one_of(st.sampled_from(["x", "y"]), st.floats(0.1, 9.0).map(lambda v: f"{v:.3f}"))
    return st.recursive(
        leaf,
        lambda inner: st.one_of(
            st.tuples(inner, st.sampled_from(["+", "-", "*"]), inner).map(
                lambda p: f"({p[0]} {p[1]} {p[2]})"
            ),
            inner.map(lambda a: f"tanh({a})"),
            inner.map(lambda a: f"-{a}"),
            inner.map(lambda a: f"cos({a})"),
        ),
        max_leaves=8,
    )


@settings(max_examples=150, deadline=None)
@given(formulas())
def test_values_are_those_of_python(text: str) -> None:
    scope = {"x": X, "y": Y, "tanh": math.tanh, "cos": math.cos}
    wanted = eval(text, {"__builtins__": {}}, scope)  # the test's own texts
    assert value(text) == pytest.approx(wanted, rel=1e-9, abs=1e-9 * (1 + abs(wanted)))
