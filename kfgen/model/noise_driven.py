"""The white noise that drives a filter: its densities, and the blocks that it moves and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import sympy as sp

from kfgen.model.register import DT
from kfgen.model.symbols.blocks import Block, Vector

if TYPE_CHECKING:
    from kfgen.model.filter import FilterModel

Named = dict[str, tuple[sp.Symbol, sp.Expr]]
"""Symbol and density of a noise, by the name of an input or sensor, or of one channel of it."""


def closed_under_noise(
    blocks: Sequence[Block], driven: Sequence[Vector], rates: Mapping[str, sp.Matrix]
) -> tuple[tuple[Vector, ...], sp.Matrix, sp.Matrix]:
    """The largest set of blocks whose rates are their own components times numbers, with A and W.

    Parameters
    ----------
    blocks : sequence of Block
        Of the whole state.
    driven : sequence of Vector
        Those that white noise drives.
    rates : mapping of str to Matrix
        By block, in the symbols of the estimate.

    Returns
    -------
    blocks : tuple of Vector
    A, W : Matrix, shape (m, m)
        Dynamics and driving density of their components.
    """
    own = [b for b in blocks if isinstance(b, Vector) and (b in driven or any(rates[b.name]))]
    x = sp.Matrix([s for b in own for s in b.nominal])
    while closed := [b for b in own if _linear(rates[b.name], x)]:
        if len(closed) == len(own):
            break
        own, x = closed, sp.Matrix([s for b in closed for s in b.nominal])
    A = sp.Matrix.vstack(*(rates[b.name].jacobian(x) for b in closed)) if closed else sp.zeros(0, 0)
    W = sp.diag(*(sp.Float(b.driven) ** 2 for b in closed for _ in b.error_names))
    return tuple(closed), A, W


def _linear(rate: sp.Matrix, x: sp.Matrix) -> bool:
    """Whether a rate is `x` times numbers and nothing else."""
    J = rate.jacobian(x)
    return not J.free_symbols and (rate - J * x).expand().is_zero_matrix is True


def densities(model: FilterModel, shared: Mapping[str, sp.Expr]) -> sp.Matrix:
    """Densities of a filter's `noise_symbols`, shape (q, q): inputs, driven blocks, effects' states.

    Parameters
    ----------
    model : FilterModel
    shared : mapping of str to expression
        Correlation of the white noise of input channels with that of the one that says the same.
    """
    channels = [(i, c) for i in model.motion.inputs for c in i.channels]
    inputs = [model.white(c)[0] + model.noise_change(c)[1] * DT + i.left_out**2 for i, c in channels]
    driven = [sp.Float(b.driven) ** 2 for b in model.driven for _ in b.error_names]
    W = sp.diag(*inputs, *driven, model.effect_dynamics[1])
    for (k, (_, a)), (l, (_, b)) in combinations(enumerate(channels), 2):
        if a in shared and shared.get(b) == shared[a]:
            W[k, l] = W[l, k] = shared[a] * sp.sqrt(model.white(a)[0] * model.white(b)[0])
    return W


def alone(W: sp.Matrix, k: int) -> bool:
    """Whether a noise has a number for its density, and is shared with no other.

    Parameters
    ----------
    W : Matrix, shape (q, q)
        Densities.
    k : int
        Its place.
    """
    return bool(W[k, k].is_number and W[k, k] != 0) and not any(W[k, j] for j in range(W.cols) if j != k)


def name_inputs(model: FilterModel, W: sp.Matrix) -> Named:
    """Put symbols for the densities of the inputs into the densities of a filter's noises.

    A density that depends on a driver or the step, or whose noise is shared with another channel, stays as it is; the
    others are named as `name_alike` says.

    Parameters
    ----------
    model : FilterModel
    W : Matrix, shape (q, q)
        Of `FilterModel.noise_symbols`, the inputs first; changed in place.

    Returns
    -------
    dict of str to (Symbol, Expr)
        Symbol and density [SI^2/Hz].
    """
    named: Named = {}
    first = 0
    for i in model.motion.inputs:
        places = {c: k for k, c in enumerate(i.channels, start=first) if alone(W, k)}
        first += len(i.channels)
        named |= name_alike(W, places, i.name, i.channels, "Q")
    return named


def name_alike(
    W: sp.Matrix, places: Mapping[str, int], owner: str, channels: Sequence[str], letter: str
) -> Named:
    """Put symbols for some densities of one sensor: one where all of its channels have one density, else each its own.

    Parameters
    ----------
    W : Matrix, shape (q, q)
        Densities, changed in place.
    places : mapping of str to int
        Of the noise of each channel that is to be named.
    owner : str
        Name of the input or sensor.
    channels : sequence of str
        All that it has.
    letter : str
        Begins the symbols.

    Returns
    -------
    dict of str to (Symbol, Expr)
    """
    same = len({W[k, k] for k in places.values()}) == 1 and set(places) == set(channels)
    named: Named = {}
    for channel, k in places.items():
        name = owner if same else channel
        symbol, _ = named.setdefault(name, (sp.Symbol(f"{letter}__{name}", positive=True), W[k, k]))
        W[k, k] = symbol
    return named
