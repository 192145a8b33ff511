"""What of a model's truth is drawn at random: its constants, and the courses of what noise alone moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.core import linear
from kfgen.model.filter import FilterModel
from kfgen.model.symbols.blocks import Attitude, Vector

Array = NDArray[np.float64]


def noise_driven(model: FilterModel, t: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Random courses of the blocks that noise alone moves, from a draw of their priors on.

    Parameters
    ----------
    model : FilterModel
    t : ndarray, shape (n,)
        Even times [s].
    rng : numpy Generator

    Returns
    -------
    dict of str to ndarray, shape (n,)
    """
    blocks, A, W = model.noise_driven_blocks
    if not blocks:
        return {}
    names = [n for b in blocks for n in b.nominal_names]
    start = np.array([b.prior for b in blocks for _ in b.nominal_names]) * rng.standard_normal(len(names))
    dt = float(t[1] - t[0]) if t.size > 1 else 1.0
    Phi, Qd = linear.van_loan(np.array(A, dtype=np.float64), np.array(W, dtype=np.float64), dt)
    x = linear.simulate(Phi, Qd, start, t.size, rng)
    return {n: x[:, k] for k, n in enumerate(names)}


def drawn(model: FilterModel, rng: np.random.Generator) -> dict[str, float]:
    """A truth of the constant states, drawn from their priors.

    Parameters
    ----------
    model : FilterModel
    rng : numpy Generator

    Returns
    -------
    dict of str to float
        By name [SI].
    """
    still = [
        b
        for b in model.blocks
        if not isinstance(b, Attitude) and all(e == 0 for e in model.rates(False)[b.name])
    ]
    return {
        name: start + sd * float(rng.standard_normal())
        for b in still
        if isinstance(b, Vector)
        for name, start, sd in zip(b.nominal_names, b.start, b.deviations)
    }
