"""One scalar of a measurement that is accepted: innovation at the corrected state, and the form's arithmetic."""

from __future__ import annotations

from functools import reduce

from kfgen.emit.covariance.forms import CovarianceForm
from kfgen.emit.covariance.packed import Row
from kfgen.emit.ir.ir import Bin, Compare, Expr, Let, Num, Ref, StatusFlag, Stmt, Store, When, mul, sub


def at_corrected(row: int, H: Row, residual: Expr) -> Expr:
    """The residual of a row at the state as the rows before it have corrected it.

    Parameters
    ----------
    row : int
        Of the sensor.
    H : Row
        Non-zeros of its Jacobian.
    residual : Expr
        ``z - h`` at the uncorrected state.
    """
    return residual if row == 0 else reduce(sub, (mul(h, Ref("dx", j)) for j, h in H.items()), residual)


def fused(form: CovarianceForm, row: int, H: Row, residual: Expr, R: Expr) -> list[Stmt]:
    """Statements that fuse one scalar measurement.

    The correction gathers in ``dx``; the residual of a later scalar is taken at the state corrected by the
    earlier ones. A variance of a later row that is not positive
    changes nothing but the status; that of the first one is positive once the gate has looked at it.

    Parameters
    ----------
    form : Form
    row : int
        Of the sensor.
    H : Row
        Non-zeros of its Jacobian.
    residual : Expr
        ``z - h`` at the uncorrected state.
    R : Expr
        Variance of the noise.
    """
    y, s = Ref(f"y_{row}"), Ref(f"s_{row}")
    fusion = form.fuse(row, H, R)
    apply: tuple[Stmt, ...] = (Let(s.name, Bin("/", Num(1.0), fusion.S)), *fusion.apply)
    positive = When(Compare(">", fusion.S, Num(0.0)), apply, (StatusFlag("NOT_POSITIVE"),))
    return [
        Let(y.name, at_corrected(row, H, residual)),
        *fusion.before,
        Store(Ref("innovation", row), y),
        Store(Ref("variance", row), fusion.S),
        *((positive,) if row else apply),
    ]
