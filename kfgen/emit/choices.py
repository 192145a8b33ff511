"""What may be chosen for a program, and together with what."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from kfgen.core.errors import InputError
from kfgen.emit.targets.names import check_names
from kfgen.emit.watch.parts import checked

if TYPE_CHECKING:
    from kfgen.emit.covariance.forms import CovarianceForm
    from kfgen.emit.routines import Program


def check_choices(
    program: Program, forms: Mapping[str, type[CovarianceForm]], reals: Mapping[str, type[Any]]
) -> None:
    """Look at a program's choices.

    Parameters
    ----------
    program : Program
    forms, reals : mapping
        What there is, by name.

    Raises
    ------
    InputError
        One that there is not, or that does not go with the others.
    """
    from kfgen.emit.routines import MAX_WAITING_PREDICTIONS

    d, waits = program.discrete, program.q_interval or 0.0
    checked(program.without)
    for option, value, known in (("--form", program.form, forms), ("--real", program.real, reals)):
        if value not in known:
            raise InputError(f"there is no '{value}'", where=option, remedy=f"Known are {', '.join(known)}")
    if not 0.0 <= waits < float("inf") or (waits and not forms[program.form].HAS_Q_INTERVAL):
        raise InputError(
            f"noise cannot wait for {waits:g} s with --form {program.form}",
            where="--q-interval",
            remedy="Give zero or more seconds, with --form ud",
        )
    if waits * d.rate > MAX_WAITING_PREDICTIONS:
        raise InputError(
            f"noise that waits for {waits:g} s misses {waits * d.rate:.6g} predictions",
            where="--q-interval",
            remedy=f"Give {MAX_WAITING_PREDICTIONS / d.rate:g} s or less, {MAX_WAITING_PREDICTIONS} predictions",
        )
    if d.rate * d.max_step < 1.0:
        raise InputError(
            f"the period of {d.rate:g} Hz is longer than the longest step of {d.max_step:g} s",
            remedy="Give a longer --max-step, or a higher --rate",
        )
    check_names(d)
    if not 0.0 <= program.horizon < float("inf"):
        raise InputError(f"a horizon of {program.horizon:g} s is none", where="--horizon")
    if program.horizon and not program.delayed_memory.moving:
        raise InputError(
            f"nothing of {d.model.name} moves, so that its measurements have no times to be fused at",
            where="--horizon",
            remedy="Leave it out",
        )
