"""`control`: the inputs (body rate, specific force) that make a model follow a manoeuvre.

A manoeuvre gives the body rate and the rate of the velocity. Where the model's rates are ``J u + b`` of as many inputs,
these follow from it, whatever the model contains (Earth rate, Coriolis force, scale factors).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from kfgen.model.filter import FilterModel
from kfgen.model.symbols.blocks import Vector


@dataclass(frozen=True)
class Control:
    """Equations ``rates of the targets = J u + b``, to be solved for the inputs ``u``.

    Parameters
    ----------
    targets : tuple of str
        Blocks whose rates are given: the attitude, the velocity.
    channels : tuple of str
        The inputs that they determine.
    J : Matrix, shape (r, r)
    b : Matrix, shape (r, 1)
    """

    targets: tuple[str, ...]
    channels: tuple[str, ...]
    J: sp.Matrix
    b: sp.Matrix


def control(model: FilterModel) -> Control | None:
    """How inputs follow from a manoeuvre; None where they do not."""
    attitude = [model.attitude.name] if model.attitude is not None else []
    velocity = [b.name for b in model.blocks if isinstance(b, Vector) and b.name == "v" and len(b.axes) == 3]
    for targets in ([*attitude, *velocity], attitude, velocity):
        found = _control(model, targets)
        if found is not None:
            return found
    return None


def _control(model: FilterModel, targets: Sequence[str]) -> Control | None:
    channels = [c for i in model.motion.inputs for c in i.channels]
    if not targets or not channels:
        return None
    rates = model.rates(False)
    rows = sp.Matrix.vstack(*(rates[n] for n in targets))
    symbols = [sp.Symbol(c, real=True) for c in channels]
    J = rows.jacobian(symbols)
    used = [j for j in range(J.cols) if any(e != 0 for e in J.col(j))]
    J = J.extract(list(range(J.rows)), used)
    if J.rows != J.cols or J.free_symbols & set(symbols):
        return None
    b = rows.subs(dict.fromkeys(symbols, 0))
    return Control(tuple(targets), tuple(channels[j] for j in used), J, b)
