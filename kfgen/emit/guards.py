"""What is looked at before a number enters the filter, and before it stays there."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from kfgen.emit.ir.ir import All, Argument, Bin, Compare, Condition, Expr, Let, Num, Ref, add, mul

MAX_SUM = 1e30
"""Finite numbers of a filter add up to less, in single precision as well."""
SHORTEST_STEP_S = 1e-6
"""Of a call: a noise density times less is no number that one may divide by in single precision."""


def within(given: Argument, limit: Expr) -> list[Compare]:
    """Each number of an argument is one, and no larger than its limit; by squares, which no sign escapes."""
    return [Compare("<=", mul(v, v), mul(limit, limit)) for v in numbers(given)]


def possible_step(longest_s: float) -> Condition:
    """Whether the argument ``dt`` is a step that a filter can take.

    Parameters
    ----------
    longest_s : float
        The longest [s].
    """
    step = Ref("dt")
    return All((Compare(">=", step, Num(SHORTEST_STEP_S)), Compare("<=", step, Num(longest_s))))


def numbers(given: Argument) -> list[Expr]:
    """The numbers of an argument."""
    return [Ref(given.name, k) for k in range(given.size)] if given.size else [Ref(given.name)]


def sum_of_squares(values: Sequence[Expr]) -> Expr:
    """Of numbers."""
    return reduce(add, (mul(v, v) for v in values))


def finite(values: Sequence[Expr], name: str) -> tuple[Let, Compare]:
    """Their sum, as a local of that name, and whether all are numbers: it less itself is zero, an infinite one is not."""
    total = Ref(name)
    return Let(name, reduce(add, values)), Compare("<=", Bin("-", total, total), Num(0.0))


def sensible(values: Sequence[Expr]) -> Condition:
    """All are numbers, none beyond `MAX_SUM`."""
    total = reduce(add, values)
    return All((Compare("<=", total, Num(MAX_SUM)), Compare(">=", total, Num(-MAX_SUM))))


def every(comparisons: Sequence[Compare]) -> Condition:
    """All of several comparisons."""
    return comparisons[0] if len(comparisons) == 1 else All(tuple(comparisons))
