"""Bounds of biases: no bias leaves what its sensor can be off by.

Where a correction takes one beyond the bound of its sensor it stays at the bound, the update says LIMITED, the supervisor
counts which one and is DEGRADED for `SETTLE_TIME`. The covariance stays as it is, as PX4's EKF2 and ArduPilot's EKF3
have it: a truth within the bound is nearer to the bound than to what was beyond it, so P still covers the error; a
truth beyond it shows in innovations, and those widen P.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from kfgen.emit.guards import sum_of_squares
from kfgen.emit.ir.ir import Compare, Num, Ref, StatusFlag, Stmt, Store, When, add, mul, neg
from kfgen.emit.targets.names import identifier
from kfgen.model.biases import biases, parts
from kfgen.model.filter import FilterModel
from kfgen.model.parts.constant import Constant

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

BOUND_SIGMAS = 10.0
"""Times the prior of a bias, or the turn-on bias of such sensors, that it may be off by: as many as a gate has."""
WANDER_S = 86400.0
"""Time over which a bias without a restoring force may wander [s]."""
SINCE = "SINCE_LIMITED"


def places(model: FilterModel) -> tuple[tuple[str, str], ...]:
    """Numbers of the supervisor that this takes; none where there are no biases."""
    names = [model.states[k].name for states in biases(model).values() for k in states]
    own = [(_count(n), f"biases: how often {n} was held at its bound") for n in names]
    return ((SINCE, "biases: since one was held at its bound [s]"), *own) if own else ()


def constants(model: FilterModel) -> tuple[Constant, ...]:
    """The bound of each sensor's biases [SI]: from priors, starts, what drives them over `WANDER_S`, and the sensor's range."""
    owners = parts(model)
    A, W = model.effect_dynamics
    first = len(model.states) - A.rows

    def most(place: int, name: str) -> float:
        state, k = model.states[place], place - first
        free = W[k, k].is_number and not any(A[k, :])
        wander = float(W[k, k]) * WANDER_S if free else 0.0
        usual = float(getattr(type(owners[name]), "bias_prior", 0.0))
        prior = max(state.prior, owners[name].bias_prior, usual)
        return abs(state.start) + BOUND_SIGMAS * float((prior**2 + wander) ** 0.5)

    return tuple(
        Constant(
            _setting(name),
            owners[name].unit,
            min(max(most(k, name) for k in states), model.limits.get(name, float("inf"))),
            f"largest plausible bias: {owners[name].title}",
        )
        for name, states in biases(model).items()
    )


def bounded(program: Program) -> list[Stmt]:
    """After a correction: a triad of biases that is short as a whole has no component beyond its bound."""
    if not program.bounds_biases:
        return []
    model = program.discrete.model
    body: list[Stmt] = []
    for name, states in biases(model).items():
        most = program.setting(_setting(name))
        where = {
            model.states[k].name: program.discrete.nominal_names.index(model.states[k].name) for k in states
        }
        short = Compare("<=", sum_of_squares([Ref("x", i) for i in where.values()]), mul(most, most))
        body.append(When(short, (), tuple(_held(program, where, most))))
    return body


def _held(program: Program, where: Mapping[str, int], most: Num) -> list[Stmt]:
    watch = program.supervisor
    body: list[Stmt] = []
    for name, i in where.items():
        x, count = Ref("x", i), watch.number(_count(name))
        said = (
            Store(count, add(count, Num(1.0))),
            Store(watch.number(SINCE), Num(0.0)),
            StatusFlag("LIMITED"),
        )
        body.append(When(Compare(">", x, most), (Store(x, most), *said)))
        body.append(When(Compare("<", x, neg(most)), (Store(x, neg(most)), *said)))
    return body


def _setting(name: str) -> str:
    return f"MAX_BIAS_{identifier(name).upper()}"


def _count(state: str) -> str:
    return f"LIMITED_{identifier(state).upper()}"
