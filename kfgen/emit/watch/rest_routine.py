"""The routine `detect_rest` of an emitted filter: `kfgen.emit.watch.rest` says how."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kfgen.emit.guards import every, possible_step, sum_of_squares, within
from kfgen.emit.ir.ir import (
    Argument,
    Compare,
    FunctionCall,
    Num,
    Ref,
    Routine,
    Scratch,
    StatusFlag,
    Stmt,
    Store,
    When,
    add,
)
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.settings import sample_variance
from kfgen.emit.targets.names import argument
from kfgen.emit.watch.quiet import FORCE, WHY, Quiet, because, squared
from kfgen.emit.watch.rest import ROUTINE, TEXT
from kfgen.model.parts.motion import ACCEL, GYRO
from kfgen.model.parts.sensors import Sensor

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

ZERO, VARIANCE = "rest_z", "rest_R"
"""Scratch: what the sensor is given."""


def detect_rest(program: Program) -> tuple[Routine, ...]:
    """The routine, of a program that has this part."""
    sensor = program.resting
    return (_routine(program, sensor),) if sensor else ()


def _routine(program: Program, sensor: Sensor) -> Routine:
    triads = [Argument(argument(i.name), 3, f"{i.title} [{i.unit}], body axes") for i in (ACCEL, GYRO)]
    looked = [c for a in triads for c in within(a, program.input_limit(a.name))]
    allowed = When(every(looked), tuple(_looked_at(program, sensor)), (StatusFlag("BAD_INPUT"),))
    step = possible_step(program.discrete.max_step)
    size = len(sensor.channels)
    return Routine(
        ROUTINE,
        TEXT,
        (*triads, Argument("dt", 0, "step [s]")),
        tidy((When(step, (allowed,), (StatusFlag("BAD_STEP"),)),)),
        (Scratch(WHY, 1), Scratch(ZERO, size), Scratch(VARIANCE, size)),
    )


def _looked_at(program: Program, sensor: Sensor) -> list[Stmt]:
    """Whether the sample is one at rest, and what follows."""
    quiet = Quiet(program, "REST", {FORCE: ACCEL.name}, ACCEL.name, GYRO.name)
    watch, setting = program.supervisor, program.setting
    names = program.discrete.nominal_names
    v = next(b for b in program.discrete.model.blocks if b.name == "v").nominal_names
    speed = sum_of_squares([Ref("x", names.index(n)) for n in v])
    fast = Compare(">", speed, squared(setting("REST_MAX_SPEED")))
    rest, waited = watch.number("AT_REST"), watch.number("REST_WAITED")
    moves: tuple[Stmt, ...] = (
        Store(watch.number("REST_REASON"), Ref(WHY, 0)),
        Store(rest, Num(0.0)),
        Store(waited, setting("REST_SPACING")),
        Store(watch.at("REJECTED", sensor.name), Num(0.0)),
        *quiet.emptied(),
    )
    given = tuple(sample_variance(program.discrete, sensor, c) for c in sensor.channels)
    fuse: tuple[Stmt, ...] = (
        Store(waited, Num(0.0)),
        *(Store(Ref(VARIANCE, i), R) for i, R in enumerate(given)),
        FunctionCall(f"update_{sensor.name}", (Ref(ZERO), Ref(VARIANCE)), True),
    )
    twice = Compare(">=", quiet.at("GATHERED"), add(setting("ALIGN_TIME"), setting("ALIGN_TIME")))
    rested = When(
        quiet.enough,
        (
            Store(rest, add(rest, Ref("dt"))),
            Store(waited, add(waited, Ref("dt"))),
            When(twice, tuple(quiet.halved())),
            When(Compare(">=", waited, setting("REST_SPACING")), fuse),
        ),
    )
    disturbed = Compare(">", Ref(WHY, 0), Num(0.0))
    return [
        *quiet.disturbed(),
        When(fast, (because("TOO_FAST"),)),
        When(disturbed, moves, (*quiet.gathered(), rested)),
    ]
