"""What looks at the whole filter: its check, and the way back to the priors."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from kfgen.emit.covariance.forms import HEALTH
from kfgen.emit.guards import sensible, sum_of_squares
from kfgen.emit.ir.ir import All, Compare, Num, Ref, Routine, StatusFlag, Stmt, When
from kfgen.emit.settings import MAX_BY_UNIT

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

MAX_NORM_ERROR = 1e-3
"""By which the squared length of a quaternion may differ from one."""
MAX_HEALTH = 1.1
"""A pivot over its variance is one at most, but for rounding; a larger one, or none, is no number."""

MAX_WIDENED = 1e3
"""Prior standard deviations up to which rejected samples widen a state that is no position, velocity or attitude."""
MAX_WIDENED_ATTITUDE = 10.0
"""The same of an attitude [rad]."""


def check(program: Program) -> Routine:
    """The health of the covariance, and whether the state is finite and its quaternion of unit length."""
    health = program.covariance.health
    names = program.discrete.nominal_names
    spoiled = (StatusFlag("NOT_FINITE"),)
    body: list[Stmt] = [*health.body, When(Compare("<=", HEALTH, Num(MAX_HEALTH)), (), spoiled)]
    if names:
        body.append(When(sensible([Ref("x", i) for i in range(len(names))]), (), spoiled))
    attitude = program.discrete.model.attitude
    if attitude:
        square = sum_of_squares([Ref("x", names.index(n)) for n in attitude.nominal_names])
        low, high = (Num(1.0 + s * MAX_NORM_ERROR) for s in (-1.0, 1.0))
        unit = All((Compare(">=", square, low), Compare("<=", square, high)))
        body.append(When(unit, (), spoiled))
    return replace(health, body=tuple(body))


def widest(program: Program) -> list[Num]:
    """The priors, of an attitude `RESET_ATTITUDE` where that is more."""
    attitude = program.discrete.model.attitude
    turning = attitude.error_names if attitude else ()
    least = program.setting("RESET_ATTITUDE")
    return [
        least if s.name in turning and s.prior < least.value else program.prior(i)
        for i, s in enumerate(program.discrete.model.states)
    ]


def widened_at_most(program: Program) -> list[float]:
    """Standard deviations up to which rejected samples widen states [SI]: a position or velocity as far as its sensor shows."""
    attitude = program.discrete.model.attitude
    turning = attitude.error_names if attitude else ()
    return [
        MAX_WIDENED_ATTITUDE
        if s.name in turning
        else 2.0 * MAX_BY_UNIT[s.unit]
        if s.unit in ("m", "m/s")
        else MAX_WIDENED * w.value
        for s, w in zip(program.discrete.model.states, widest(program), strict=True)
    ]


def widen(program: Program) -> Routine:
    """The covariance back at the priors."""
    return program.covariance.widen(widest(program))
