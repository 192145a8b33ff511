"""What the numerical tools say of the same question, for comparison.

python-control's observability matrix, numpy's rank and condition number of it: they mix units and
have a tolerance, so they may differ from the exact answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy as sp

from kfgen.audit.null import operating_point
from kfgen.model.filter import FilterModel


@dataclass(frozen=True)
class Numeric:
    """Rank and condition number of python-control's observability matrix (infinite when singular)."""

    rank: int
    condition: float


def numeric(model: FilterModel) -> Numeric:
    """Rank and condition number in floating point at the audit's operating point; drivers at one."""
    import control

    values = {sp.Symbol(d, real=True): 1.0 for d in model.drivers}
    values |= {c.symbol: c.value for c in model.constants}
    point = operating_point(model)
    F = np.array(model.F.subs(point).subs(values), dtype=np.float64)
    H = np.array(
        sp.Matrix.vstack(*(model.H(s) for s in model.sensors)).subs(point).subs(values), dtype=np.float64
    )
    O = np.asarray(control.obsv(F, H))
    return Numeric(int(np.linalg.matrix_rank(O)), float(np.linalg.cond(O)))
