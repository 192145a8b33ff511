"""The routines of the delayed horizon: a step, a measurement with its age, and a new start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from kfgen.emit.guards import SHORTEST_STEP_S, every, possible_step, within
from kfgen.emit.horizon.memory import FAR, HorizonMemory
from kfgen.emit.horizon.predictor import Predictor
from kfgen.emit.ir.ir import (
    All,
    Argument,
    Compare,
    Cursor,
    Expr,
    For,
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
    When,
    add,
    sub,
)
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.targets.names import argument
from kfgen.emit.update import variances
from kfgen.emit.watch.rest import ROUTINE as DETECT_REST
from kfgen.model.parts.motion import ACCEL, GYRO
from kfgen.model.parts.sensors import Sensor

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

AGE = "age"
REBASE_S = 1.0
"""After which the clock begins again: times on it keep their digits."""
LEFT, BOUND, SOONEST = Ref("left", 0), Ref("bound", 0), Ref("soonest", 0)
FUSIONS_PER_SENSOR = 2
"""In one step; more of them wait for the next one."""
STEP_TEXT = (
    "The newest inputs: the present state over one step, the filter over the oldest step of the ring, with the "
    "measurements that were taken within it."
)
START_TEXT = "The ring and the queue are emptied, and the present state begins at the filter's: after its state was set."
QUEUE_TEXT = (
    "One sample that was taken `age` ago: it waits until the filter comes to its time. OK, or OUT_OF_ORDER (one of "
    "its sensor that is younger waits already; it is fused in the right order); and not to be fused: DOUBLED (one of "
    "its age waits), NO_ROOM (too many wait), TOO_OLD (the filter is past its time)."
)


def delayed(program: Program) -> tuple[Routine, ...]:
    """Step, start, and a measurement of each sensor; none without a horizon."""
    if not program.horizon:
        return ()
    memory = HorizonMemory(program)
    return (_start(memory), _step(memory), *(_queued(memory, s) for s in memory.sensors))


def _start(memory: HorizonMemory) -> Routine:
    dt = memory.given("row", "dt")
    body: tuple[Stmt, ...] = (
        For("row", 0, memory.rows, (Store(dt, Num(0.0)),)),
        For("row", 0, memory.entries, (Store(memory.entry("row", 0), Num(FAR)),)),
        *(Store(memory.number(n), Num(0.0)) for n in ("AT", "STARTED", "CLOCK")),
        Store(memory.number("NEXT"), Num(FAR)),
    )
    return Routine("delayed_start", START_TEXT, (), body)


def _step(memory: HorizonMemory) -> Routine:
    program, predictor = memory.program, Predictor(memory)
    row, number = "row", memory.number
    started = Compare("<=", number("STARTED"), Num(0.0))
    begin = (FunctionCall("delayed_start", (), True), Store(number("STARTED"), Num(1.0)), *predictor.begin())
    body: list[Stmt] = [
        When(started, begin),
        Cursor(row, number("AT")),
        Store(LEFT, memory.given(row, "dt")),
        When(Compare(">", LEFT, Num(0.0)), tuple(_behind(memory, predictor, row))),
    ]
    looked = [c for a in memory.inputs[:-1] for c in within(a, program.input_limit(a.name))]
    stepped = tuple(predictor.step())
    body.append(Note("the present state"))
    body += [When(every(looked), stepped, (StatusFlag("BAD_INPUT"),))] if looked else stepped
    for a in memory.inputs:
        values = [Ref(a.name, k) for k in range(a.size)] if a.size else [Ref(a.name)]
        body += [Store(memory.given(row, a.name, k), v) for k, v in enumerate(values)]
    body += predictor.keep(row)
    body.append(Store(number("AT"), add(number("AT"), Num(1.0))))
    again = (Store(number("AT"), Num(0.0)), *predictor.turn())
    body.append(When(Compare(">=", number("AT"), Num(float(memory.rows))), again))
    possible = possible_step(program.discrete.max_step)
    guarded = When(possible, tuple(body), (StatusFlag("BAD_STEP"),))
    return Routine("delayed_predict", STEP_TEXT, memory.inputs, tidy((guarded,)), memory.scratch)


def _behind(memory: HorizonMemory, predictor: Predictor, row: str) -> list[Stmt]:
    """The filter over the oldest step, measurements on the way; then the present state follows."""
    number, tolerance = memory.number, memory.program.setting("STAMP_TOLERANCE")
    clock, following = number("CLOCK"), number("NEXT")
    body: list[Stmt] = [
        Store(Ref(f"step_{a.name}", k), memory.given(row, a.name, k))
        for a in memory.inputs
        for k in range(a.size)
    ]
    due = Compare("<=", sub(following, clock), add(LEFT, tolerance))
    turns = min(memory.entries, FUSIONS_PER_SENSOR * len(memory.sensors))
    body.append(When(due, (For("turn", 0, turns, (When(due, tuple(_due(memory, row))),)),)))
    body.append(
        When(
            Compare(">=", LEFT, Num(SHORTEST_STEP_S)),
            (_predicted(memory, row, LEFT), Store(clock, add(clock, LEFT))),
        )
    )
    body.append(When(Compare(">=", clock, Num(REBASE_S)), tuple(_rebased(memory))))
    if memory.program.resting:
        triads = tuple(Ref(f"step_{argument(i.name)}") for i in (ACCEL, GYRO))
        body.append(FunctionCall(DETECT_REST, (*triads, memory.given(row, "dt")), True))
    return [*body, *predictor.correct(row, memory.given(row, "dt"))]


def _predicted(memory: HorizonMemory, row: str, dt: Expr) -> Stmt:
    given = [Ref(f"step_{a.name}") if a.size else memory.given(row, a.name) for a in memory.inputs[:-1]]
    return FunctionCall("predict", (*given, dt), True)


def _due(memory: HorizonMemory, row: str) -> list[Stmt]:
    """The filter at the time of the next measurement, and all of that time fused."""
    number, tolerance = memory.number, memory.program.setting("STAMP_TOLERANCE")
    clock, following = number("CLOCK"), number("NEXT")
    part, rest = Ref("part"), Ref("rest")
    within_step = (
        _predicted(memory, row, part),
        Store(LEFT, rest),
        Store(clock, following),
    )
    to_its_end = (
        When(
            Compare(">", LEFT, Num(0.0)),
            (_predicted(memory, row, LEFT), Store(clock, add(clock, LEFT)), Store(LEFT, Num(0.0))),
        ),
    )
    ahead = When(Compare(">", rest, tolerance), within_step, to_its_end)
    return [
        Let("part", sub(following, clock)),
        Let("rest", sub(LEFT, part)),
        Store(BOUND, following),
        Store(SOONEST, Num(FAR)),
        When(Compare(">", part, tolerance), (ahead,)),
        *(_fused_where_due(memory, s, row) for s in memory.sensors),
        Store(following, SOONEST),
    ]


def _fused_where_due(memory: HorizonMemory, sensor: Sensor, row: str) -> Stmt:
    time, places = memory.entry("waiting", 0), memory.places(sensor)
    due = When(Compare("<=", time, BOUND), (*_fused(memory, sensor, row), Store(time, Num(FAR))))
    next_one = When(Compare("<", time, SOONEST), (Store(SOONEST, time),))
    return For("waiting", places.start, places.stop, (due, next_one))


def _fused(memory: HorizonMemory, sensor: Sensor, row: str) -> list[Stmt]:
    """The sample at its own time: what the filter knows of its delay is over by then."""
    size, lags = len(sensor.channels), memory.lags(sensor)
    z, R = Ref(f"sample_z_{size}"), Ref(f"sample_R_{size}")
    body: list[Stmt] = [
        Store(Ref(target.name, k), memory.entry("waiting", first + k))
        for target, first in ((z, 1), (R, 1 + memory.program.rows))
        for k in range(size)
    ]
    routine = next(r for r in memory.program.routines if r.name == f"update_{sensor.name}")
    stepping = {a.name: Ref(f"step_{a.name}") if a.size else memory.given(row, a.name) for a in memory.inputs}
    others = [stepping[a.name] for a in routine.required[1:]]
    body += [Store(Ref("lag", i), Ref("k", k)) for i, k in enumerate(lags)]
    body += [Store(Ref("k", k), Num(0.0)) for k in lags]
    body.append(FunctionCall(routine.name, (z, *others, R), True))
    return [*body, *(Store(Ref("k", k), Ref("lag", i)) for i, k in enumerate(lags))]


def _rebased(memory: HorizonMemory) -> list[Stmt]:
    """The clock begins again; what is empty stays far off, for so large a number does not change."""
    clock, time, following = memory.number("CLOCK"), memory.entry("waiting", 0), memory.number("NEXT")
    return [
        For("waiting", 0, memory.entries, (Store(time, sub(time, clock)),)),
        Store(following, sub(following, clock)),
        Store(clock, Num(0.0)),
    ]


def _queued(memory: HorizonMemory, sensor: Sensor) -> Routine:
    """A sample into the queue."""
    program, size = memory.program, len(sensor.channels)
    z = Argument("z", size, f"{sensor.title} [{sensor.unit}]: " + ", ".join(sensor.channels))
    age = Argument(AGE, 0, "how long before the end of the newest step it was taken [s]")
    arguments = (z, age, variances(program, sensor))
    number, tolerance = memory.number, program.setting("STAMP_TOLERANCE")
    clock, span, when = number("CLOCK"), Ref("span", 0), Ref("when")
    lag: Expr = Ref(AGE)
    for k in memory.lags(sensor):
        lag = add(lag, Ref("k", k))
    dt = memory.given("row", "dt")
    body: list[Stmt] = [
        For("row", 0, memory.rows, (Store(span, add(span, dt)),)),
        Let("due", sub(span, lag)),
        Let("when", add(clock, Ref("due"))),
    ]
    place, doubled, younger = Ref("place", 0), Ref("same", 0), Ref("younger", 0)
    places = memory.places(sensor)
    body += [Store(place, Num(-1.0)), Store(Ref("number", 0), Num(float(places.start)))]
    body.append(For("waiting", places.start, places.stop, tuple(_looked(memory, when, tolerance))))
    stored: list[Stmt] = [
        Cursor("free", place),
        Store(memory.entry("free", 0), when),
    ]
    for name, first in (("z", 1), ("R", 1 + program.rows)):
        stored += [Store(memory.entry("free", first + k), Ref(name, k)) for k in range(size)]
    stored.append(When(Compare("<", when, number("NEXT")), (Store(number("NEXT"), when),)))
    stored.append(When(Compare(">", younger, Num(0.0)), (StatusFlag("OUT_OF_ORDER"),)))
    there = When(Compare(">=", place, Num(0.0)), tuple(stored), (StatusFlag("NO_ROOM"),))
    once = When(Compare(">", doubled, Num(0.0)), (StatusFlag("DOUBLED"),), (there,))
    old = When(Compare(">=", add(Ref("due"), tolerance), Num(0.0)), (once,), (StatusFlag("TOO_OLD"),))
    body.append(old)
    longest = Num(program.discrete.max_step)
    possible = All(
        (
            Compare(">", number("STARTED"), Num(0.0)),
            Compare(">=", add(Ref(AGE), longest), Num(0.0)),
            Compare("<=", Ref(AGE), Num(FAR)),
        )
    )
    scratch = tuple(Scratch(n, 1) for n in ("span", "place", "same", "younger", "number"))
    return Routine(
        f"delayed_update_{sensor.name}",
        QUEUE_TEXT,
        arguments,
        tidy((When(possible, tuple(body), (StatusFlag("BAD_INPUT"),)),)),
        scratch,
    )


def _looked(memory: HorizonMemory, when: Expr, tolerance: Expr) -> Sequence[Stmt]:
    """A row of the sensor's own: an empty place, a sample of the same time, or one that is younger."""
    time, counted = memory.entry("waiting", 0), Ref("number", 0)
    later = Let("later", sub(time, when))
    near = All(
        (Compare("<=", Ref("later"), tolerance), Compare(">=", add(Ref("later"), tolerance), Num(0.0)))
    )
    of_it = (
        later,
        When(near, (Store(Ref("same", 0), Num(1.0)),)),
        When(Compare(">", Ref("later"), tolerance), (Store(Ref("younger", 0), Num(1.0)),)),
    )
    empty = Compare(">=", time, Num(FAR / 2.0))
    return [
        When(empty, (Store(Ref("place", 0), counted),), of_it),
        Store(counted, add(counted, Num(1.0))),
    ]
