"""The correction of the state that gathers while the rows of a sample are fused."""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.emit.ir.ir import Expr, For, Ref, Stmt, Store, add, mul

GAIN = "gain"
"""Scratch of an update: what a call takes of the gain."""


def gathered(row: int, dx: Ref, value: Expr) -> Store:
    """An element of the correction grows by what a row corrects; the first one begins it.

    Parameters
    ----------
    row : int
        Of the sensor.
    dx : Ref
    value : Expr
        Gain times innovation.
    """
    return Store(dx, add(dx, value) if row else value)


def corrected(row: int, n: int, y: Expr, loops: bool, order: Sequence[int] = ()) -> list[Stmt]:
    """The correction gathers gain times innovation, the gain from its array, in an order of the states.

    Parameters
    ----------
    row : int
        Of the sensor.
    n : int
        States.
    y : Expr
        The innovation.
    loops : bool
        In a loop where the order is that of the states.
    order : sequence of int, optional
        The state of each element of the gain; their own order where left out.
    """
    if loops and list(order) in ([], list(range(n))):
        dx = Ref("dx", "i")
        return [For("i", 0, n, (gathered(row, dx, mul(Ref(GAIN, "i"), y)),))]
    places = [(k, Ref("dx", s)) for k, s in enumerate(order or range(n))]
    return [gathered(row, dx, mul(Ref(GAIN, k), y)) for k, dx in places]
