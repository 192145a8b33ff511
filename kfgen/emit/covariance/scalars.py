"""One scalar of a measurement that is accepted: innovation at the corrected state, and the form's arithmetic."""

from __future__ import annotations

from functools import reduce

from kfgen.emit.covariance.forms import CovarianceForm
from kfgen.emit.covariance.packed import Row
from kfgen.emit.ir.ir import Bin, Compare, Expr, Let, Num, Ref, StatusFlag, Stmt, Store, When, mul, sub


def fused(form: CovarianceForm, row: int, H: Row, residual: Expr, R: Expr) -> list[Stmt]:
    """Statements that fuse one scalar measurement.

    The correction gathers in ``dx``; the residual of a later scalar is taken at the state corrected by the
    earlier ones. An innovation variance that is not positive changes nothing but the status.

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
    corrected = residual if row == 0 else reduce(sub, (mul(h, Ref("dx", j)) for j, h in H.items()), residual)
    fusion = form.fuse(f"{row}", H, R)
    apply: tuple[Stmt, ...] = (
        Let(s.name, Bin("/", Num(1.0), fusion.S)),
        *fusion.apply,
        Store(Ref("fused", 0), Num(1.0)),
    )
    return [
        Let(y.name, corrected),
        *fusion.before,
        Store(Ref("innovation", row), y),
        Store(Ref("variance", row), fusion.S),
        When(Compare(">", fusion.S, Num(0.0)), apply, (StatusFlag("NOT_POSITIVE"),)),
    ]
