"""The update of a filter by one sample of a sensor: guards, gate, fusion, and what follows a rejection."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from kfgen.core.errors import InputError
from kfgen.emit.check import widened_at_most
from kfgen.emit.covariance.correction import GAIN
from kfgen.emit.covariance.joint import gated
from kfgen.emit.covariance.packed import Row
from kfgen.emit.covariance.rollback import fused_with_rollback, kept
from kfgen.emit.covariance.scalars import fused
from kfgen.emit.guards import every, sum_of_squares, within
from kfgen.emit.ir.ir import (
    All,
    Argument,
    Compare,
    Expr,
    FunctionCall,
    Let,
    Note,
    Num,
    Ref,
    Routine,
    Scratch,
    StatusFlag,
    Stmt,
    Store,
    Una,
    When,
    mul,
    sub,
)
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.settings import sample_variance, squared_gate
from kfgen.emit.state import inject
from kfgen.emit.targets.names import identifier
from kfgen.emit.watch import lanes
from kfgen.emit.watch.biases import bounded
from kfgen.emit.watch.supervisor import DUE, widened
from kfgen.model.parts.sensors import Sensor

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

LEAST_SEEN = 1e-6
"""Share of a row's variance that the priors make of it at least, where P widens along it: of less nothing is seen."""


def linearised(program: Program, sensor: Sensor, lower: Lowering) -> tuple[list[Stmt], list[Row], list[Expr]]:
    """A sample at the predicted state: statements, non-zeros of the Jacobian by row, and the innovation.

    Raises
    ------
    InputError
        A row of it depends on no state.
    """
    h, H = program.discrete.expected(sensor), program.discrete.H(sensor)
    body = program.atoms.make(lower, [*h, *H])
    entries = [(i, j) for i in range(H.rows) for j in range(program.n) if H[i, j] != 0]
    blind = [c for i, c in enumerate(sensor.channels) if not any(k == i for k, _ in entries)]
    if blind:
        raise InputError(
            f"the measurement {blind[0]} depends on no state, so it can correct none",
            where=program.discrete.model.name,
            remedy="Leave it out, or write its expression in states",
        )
    values, statements = lower.many([*h, *(H[i, j] for i, j in entries)])
    body += statements
    rows: list[Row] = [{} for _ in range(H.rows)]
    for (i, j), value in zip(entries, values[H.rows :]):
        rows[i][j], made = lower.let(value, "h")
        body += made
    y = _innovation(sensor, values[: H.rows], lower, body)
    return body, rows, y


def update(program: Program, sensor: Sensor) -> Routine:
    """Fuse one sample of a sensor: all of its rows, or none; raises as `linearised` and `variances`."""
    lower = program.lowering()
    body, rows, y = linearised(program, sensor, lower)
    R = variances(program, sensor)
    gate = squared_gate(lower, sensor)
    given = list(zip(sensor.channels, rows, y, [Ref(R.name, i) for i in range(R.size)], strict=True))
    tested = lanes.tested(program, sensor, gate)
    after = [*tested, *program.supervisor.accepted(sensor.name, gate), *program.covariance_guard()]
    rejected = _rejected(program, sensor, rows, y, [r for *_, r in given], lower)
    corrected = [
        *lanes.kept(program),
        *inject(program, guarded=True, then=(*bounded(program), *lanes.jumped(program))),
    ]
    if program.covariance.gates_first:
        body += _joint(program, given, gate, corrected, after, rejected)
    else:
        body += fused_with_rollback(program.covariance, given, gate, [*corrected, *after], rejected)
    z = Argument("z", len(sensor.channels), f"{sensor.title} [{sensor.unit}]: " + ", ".join(sensor.channels))
    others = program.sample_arguments([*program.discrete.expected(sensor), *program.discrete.H(sensor)])
    memory = (*program.covariance.scratch, *kept(program.covariance, R.size))
    return Routine(
        f"update_{sensor.name}",
        f"Fuse one sample: {sensor.title}.",
        (z, *others, R),
        tidy(_plausible(program, sensor, (z, *others, R), lower, tuple(body))),
        (Scratch("dx", program.n), Scratch(DUE.name, 1), *memory, *lanes.scratch(program)),
    )


def variances(program: Program, sensor: Sensor) -> Argument:
    """The variances of a sample's rows, which a call may give.

    Raises
    ------
    InputError
        One is not positive, and the form of the covariance needs that.
    """
    least = min(program.discrete.measurement_variance(sensor, c) for c in sensor.channels)
    if not program.covariance.TAKES_EXACT and not least > 0.0:
        raise InputError(
            "a measurement without noise cannot be fused by factors",
            where="--form ud",
            remedy="Give its channel white noise, or use --form p",
        )
    text = f"variances of its rows [({sensor.unit})^2]"
    given = tuple(sample_variance(program.discrete, sensor, c) for c in sensor.channels)
    return Argument("R", len(given), text, given)


def _innovation(sensor: Sensor, h: list[Expr], lower: Lowering, body: list[Stmt]) -> list[Expr]:
    """``z - h`` at the uncorrected state; of an angle the nearest."""
    y: list[Expr] = []
    for i, value in enumerate(h):
        residual, made = lower.let(sub(Ref("z", i), value), "r")
        body += made
        if sensor.period:
            turns = mul(Una("rint", mul(residual, Num(1.0 / sensor.period))), Num(sensor.period))
            residual, made = lower.let(sub(residual, turns), "r")
            body += made
        y.append(residual)
    return y


def _joint(
    program: Program,
    given: Sequence[tuple[str, Row, Expr, Expr]],
    gate: Expr,
    corrected: Sequence[Stmt],
    after: Sequence[Stmt],
    rejected: Sequence[Stmt],
) -> list[Stmt]:
    """The gate on the covariance of the whole sample, then row by row into covariance and correction."""
    _, rows, y, noise = zip(*given)
    before, S = program.covariance.innovation_covariance(rows, noise)
    accepted: list[Stmt] = []
    for i, (channel, H, residual, R) in enumerate(given):
        accepted += [Note(channel), *fused(program.covariance, i, H, residual, R)]
    kept: list[Stmt] = []
    for i, value in enumerate(y):
        kept += [Store(Ref("innovation", i), value), Store(Ref("variance", i), S[i, i])]
    return [*before, *gated(S, y, gate, [*accepted, *corrected, *after], [*kept, *rejected])]


def _rejected(
    program: Program, sensor: Sensor, rows: list[Row], y: list[Expr], R: list[Ref], lower: Lowering
) -> list[Stmt]:
    """It is counted; where that has gone on for too long, P widens along each row that sees something of the priors, as far as states may widen."""
    wide: list[Stmt] = program.supervisor.reset(sensor.name)
    for i, row in enumerate(rows):
        a, projection, c = widened(y[i], row, {j: program.prior(j) for j in row})
        direction = [Store(Ref(GAIN, k), a.get(k, Num(0.0))) for k in range(program.n)]
        along, limit, spread = (Ref(f"{name}_{i}") for name in ("along", "limit", "spread"))
        call = (Let(spread.name, c), FunctionCall("inflate", (Ref(GAIN), spread)))
        most = Num(widened_share(program, row))
        seen = Compare(">", along, mul(R[i], Num(LEAST_SEEN)))
        near = Compare("<=", mul(y[i], y[i]), limit)
        wide += [Let(along.name, projection), Let(limit.name, mul(most, along))]
        wide.append(When(All((seen, near)), (*direction, *call)))
    tested = lanes.tested(program, sensor, squared_gate(lower, sensor))
    return [
        *tested,
        *program.supervisor.rejected(sensor.name),
        When(Compare(">", DUE, Num(0.0)), tuple(wide)),
    ]


def widened_share(program: Program, states: Iterable[int]) -> float:
    """Square of an innovation up to which P widens along a row of these states, over the priors' variance of the row."""
    sd = widened_at_most(program)
    known = [j for j in states if program.prior(j).value > 0.0]
    return float(min((sd[j] / program.prior(j).value for j in known), default=0.0) ** 2)


def _plausible(
    program: Program, sensor: Sensor, arguments: tuple[Argument, ...], lower: Lowering, body: tuple[Stmt, ...]
) -> tuple[Stmt, ...]:
    """The body, where every argument is one that the sensor can give."""
    z, *others, R = arguments
    looked = within(z, program.setting(f"MAX_{identifier(sensor.name).upper()}_SAMPLE"))
    for a in others:
        looked += within(a, program.input_limit(a.name))
    at_least = ">=" if program.covariance.TAKES_EXACT else ">"
    looked += [Compare(at_least, Ref(R.name, i), Num(0.0)) for i in range(R.size)]
    squared = sum_of_squares([Ref("z", i) for i in range(z.size)])
    if sensor.min_length:
        least = program.setting(f"MIN_{identifier(sensor.name).upper()}")
        looked.append(Compare(">=", squared, mul(least, least)))
    expected, share = sensor.gated_length()
    if share <= 0.0:
        return (When(every(looked), body, (StatusFlag("BAD_INPUT"),)),)
    (length,), before = lower.many([expected])
    low, high = (mul(Num((1.0 + s * share) ** 2), length) for s in (-1.0, 1.0))
    inside = every([Compare(">=", squared, low), Compare("<=", squared, high)])
    inner = When(inside, body, (StatusFlag("GATED"),))
    return (When(every(looked), (*before, inner), (StatusFlag("BAD_INPUT"),)),)
