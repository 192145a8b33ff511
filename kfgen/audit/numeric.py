"""What an engineer would get from the usual tool, beside the exact answer.

python-control's observability matrix, numpy's rank and condition number of it: they mix units and
have a tolerance, and see one instant of a motion, so they may differ from the exact answer. They are said because
this rank is what other tools print, and a reader should see where the two part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from kfgen.manoeuvre.flight import Flight
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.filter import FilterModel


@dataclass(frozen=True)
class Numeric:
    """Rank and condition number of python-control's observability matrix (infinite when singular)."""

    rank: int
    condition: float


def numeric(model: FilterModel, manoeuvre: Manoeuvre, start: Mapping[str, float]) -> Numeric:
    """Rank and condition number in floating point where a manoeuvre starts.

    Parameters
    ----------
    model : FilterModel
        Its drivers are taken as one.
    manoeuvre : Manoeuvre
        Of which the start alone is looked at.
    start : mapping of str to float
        As of `Flight`.

    Returns
    -------
    Numeric
    """
    import control

    t = np.array([0.0, 1e-2, 2e-2])
    flight = Flight(model, manoeuvre, t, {d: np.ones(t.size) for d in model.drivers}, start)
    H = sp.Matrix.vstack(sp.zeros(0, len(model.states)), *(model.H(s) for s in model.sensors))
    O = np.asarray(control.obsv(flight.matrix(model.F)[0], flight.matrix(H)[0]))
    if not O.size or not np.isfinite(O).all():
        return Numeric(0, float("inf"))
    return Numeric(int(np.linalg.matrix_rank(O)), float(np.linalg.cond(O)))
