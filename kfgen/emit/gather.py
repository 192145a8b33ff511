"""Increments of a fast IMU, gathered for one prediction: coning and sculling between them are compensated.

A sensor that integrates gives changes of angle and velocity, some for each prediction. Their sums a and v alone miss
that rotations do not commute: with each increment the coning and the sculling sums grow by

    d_coning = (a + da_before / 6) x da / 2,
    d_sculling = ((a + da_before / 6) x dv + (v + dv_before / 6) x da) / 2,

a and v being the sums before it [1]_. The prediction is given ``(a + coning) / T`` and
``(v + sculling + a x (a x v) / 6) / T``; it turns the velocity by half of the rotation itself. Covariance and state then go at the divided rate.

References
----------
.. [1] P. G. Savage, Strapdown inertial navigation integration algorithm design, parts 1 and 2, Journal of Guidance,
   Control, and Dynamics 21(1) and 21(2), 1998.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from kfgen.emit.guards import every, possible_step, within
from kfgen.emit.ir.ir import (
    Argument,
    Bin,
    Compare,
    Expr,
    Let,
    Num,
    Ref,
    Routine,
    StatusFlag,
    Stmt,
    Store,
    When,
    add,
    mul,
    sub,
)
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.targets.names import argument
from kfgen.model.filter import FilterModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import ACCEL, GYRO, INCREMENTS, SAMPLES

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

ARRAY, STEP = "gathering", "gathered_dt"
TEXT = (
    "Increments of angle and velocity over a step: OK with the last one of a prediction, whose arguments then are in "
    "the arrays that begin with gathered, until then GATHERING."
)
GATHER_SAMPLES = Constant("GATHER_SAMPLES", "1", 10.0, "increments for each prediction")
Triad = Sequence[Expr]
DELTA = {GYRO.name: "delta_angle", ACCEL.name: "delta_velocity"}
UNIT = {GYRO.name: "rad", ACCEL.name: "m/s"}


def gathered_inputs(model: FilterModel) -> tuple[str, ...]:
    """The inputs whose increments are gathered, the gyro first; none where a filter takes rates."""
    if model.motion.chosen.get(SAMPLES.name) != INCREMENTS:
        return ()
    names = [i.name for i in model.motion.inputs]
    return tuple(n for n in (GYRO.name, ACCEL.name) if n in names)


def memory(model: FilterModel) -> dict[str, tuple[int, str]]:
    """Arrays of the filter that this takes: size and meaning."""
    inputs = gathered_inputs(model)
    if not inputs:
        return {}
    results = {f"gathered_{n}": (3, f"mean of {n} over the increments, for predict") for n in inputs}
    return {
        ARRAY: (9 * len(inputs) + 2, "sums, compensations and last increments; time and number of them"),
        **results,
        STEP: (1, "step of them [s], for predict"),
    }


def gather(program: Program) -> Routine:
    """The routine; its model has `gathered_inputs`."""
    inputs = gathered_inputs(program.discrete.model)
    given = [Argument(DELTA[n], 3, f"{DELTA[n].replace('_', ' ')} [{UNIT[n]}], body axes") for n in inputs]
    looked: list[Compare] = []
    for n, a in zip(inputs, given):
        looked += within(a, mul(program.input_limit(argument(n)), Ref("dt")))
    watch = program.supervisor
    refused = (StatusFlag("BAD_INPUT"), *watch.elapsed(), *watch.missed())
    allowed = When(every(looked), tuple(_gathered(inputs)), refused)
    body = (When(possible_step(program.discrete.max_step), (allowed,), (StatusFlag("BAD_STEP"),)),)
    return Routine("gather", TEXT, (*given, Argument("dt", 0, "step [s]")), tidy(body))


def _triad(input_index: int, quantity: int) -> Sequence[Expr]:
    """Three numbers of an input: 0 its sum, 1 its compensation, 2 its last increment."""
    first = 9 * input_index + 3 * quantity
    return [Ref(ARRAY, first + i) for i in range(3)]


def _cross(a: Sequence[Expr], b: Sequence[Expr], i: int) -> Expr:
    j, k = (i + 1) % 3, (i + 2) % 3
    return sub(mul(a[j], b[k]), mul(a[k], b[j]))


def _gathered(inputs: tuple[str, ...]) -> list[Stmt]:
    body: list[Stmt] = []
    sixth = Num(1.0 / 6.0)
    arms: list[Triad] = []
    new: list[Triad] = []
    for k, name in enumerate(inputs):
        names = [f"arm_{k}_{i}" for i in range(3)]
        sums, last = _triad(k, 0), _triad(k, 2)
        body += [Let(n, add(s, mul(sixth, b))) for n, s, b in zip(names, sums, last)]
        arms.append([Ref(n) for n in names])
        new.append([Ref(DELTA[name], i) for i in range(3)])
    for k in range(len(inputs)):
        for i, target in enumerate(_triad(k, 1)):
            grown = _cross(arms[0], new[k], i)
            if k:
                grown = add(grown, _cross(arms[k], new[0], i))
            body.append(_grow(target, mul(Num(0.5), grown)))
    for k in range(len(inputs)):
        body += [_grow(s, d) for s, d in zip(_triad(k, 0), new[k])]
        body += [_put(b, d) for b, d in zip(_triad(k, 2), new[k])]
    time, count = (Ref(ARRAY, 9 * len(inputs) + k) for k in range(2))
    body += [_grow(time, Ref("dt")), _grow(count, Num(1.0))]
    enough = Compare(">=", count, Num(GATHER_SAMPLES.value, GATHER_SAMPLES.name))
    return [*body, When(enough, tuple(_handed(inputs, time, count)), (StatusFlag("GATHERING"),))]


def _handed(inputs: tuple[str, ...], time: Ref, count: Ref) -> list[Stmt]:
    """Means for the prediction; the sums begin again, what was last stays."""
    body: list[Stmt] = [Let("over_time", Bin("/", Num(1.0), time)), Store(Ref(STEP, 0), time)]
    turned: list[Expr] = [Num(0.0)] * 3
    if len(inputs) > 1:
        body += [Let(f"side_{i}", _cross(_triad(0, 0), _triad(1, 0), i)) for i in range(3)]
        side = [Ref(f"side_{i}") for i in range(3)]
        turned = [mul(Num(1.0 / 6.0), _cross(_triad(0, 0), side, i)) for i in range(3)]
    for k, name in enumerate(inputs):
        for i, (s, c) in enumerate(zip(_triad(k, 0), _triad(k, 1))):
            total = add(add(s, c), turned[i]) if k else add(s, c)
            body.append(Store(Ref(f"gathered_{name}", i), mul(total, Ref("over_time"))))
    sums = [r for k in range(len(inputs)) for r in (*_triad(k, 0), *_triad(k, 1))]
    body += [_put(r, Num(0.0)) for r in sums]
    return [*body, Store(time, Num(0.0)), Store(count, Num(0.0))]


def _put(target: Expr, value: Expr) -> Stmt:
    assert isinstance(target, Ref)
    return Store(target, value)


def _grow(target: Expr, value: Expr) -> Stmt:
    return _put(target, add(target, value))
