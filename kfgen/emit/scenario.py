"""A run of the reference over a simulated motion: the calls, their inputs, state and covariance after each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.emit.align import HEADING
from kfgen.emit.covariance.packed import place
from kfgen.emit.ir.ir import Routine
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.targets.names import argument
from kfgen.emit.watch import lanes
from kfgen.emit.watch.rest import ROUTINE as DETECT_REST
from kfgen.log.log import Channel, Log
from kfgen.model.discretise import DiscreteModel
from kfgen.simulate.rates import at_every_sample
from kfgen.simulate.simulate import simulate

MIN_PREDICTIONS = 500
"""Predictions, or twice those for which noise waits where they are more."""
PREDICTIONS_PER_UPDATE = 4
"""One update of each sensor per so many predictions."""
REFUSED = (27, 28, 59)
"""Predictions at which a step is impossible, or a sample so far off that the gate refuses it."""
JUMPED = range(100, 230)
"""Predictions during which samples are off by `JUMP`: rejected at first, followed after a while, and back again."""
JUMP = 40.0
"""By how many standard deviations of the innovation."""
UNKNOWN = range(300, 340)
"""Predictions whose inputs are beyond any sensor."""
FAST_CALLS, FAST_STEP_S = 25, 0.001
"""Calls with increments, and their step [s]."""
INCREMENT_SIZES = (2e-3, 1e-3, -4e-3)
"""Of a triad [rad, m/s]."""
CALLS_AT_REST, SHAKEN, SLOW_STEP_S = 16, 4, 0.1
"""Calls of the alignment, the one that is shaken, and their step [s]: the others last longer than it takes."""
SEED = 20261121


@dataclass(frozen=True)
class RecordedCall:
    """One call: the routine, its inputs in a row, state and covariance after it."""

    routine: str
    inputs: tuple[float, ...]
    words: NDArray[np.floating[Any]]


def scenario(program: Program, most: int | None = None) -> tuple[RecordedCall, ...]:
    """Simulated inputs through the reference in the program's precision, from ``init`` on.

    Parameters
    ----------
    program : Program
    most : int, optional
        The first so many calls only.
    """
    discrete, steps = program.discrete, max(MIN_PREDICTIONS, 2 * program.settling)
    rng, more = np.random.default_rng(SEED), late_steps(program)
    seconds = (steps + more + 1) / discrete.rate
    log = _log(discrete, seconds, rng)
    machine = Machine(program)
    machine.call("init")
    calls: list[RecordedCall] = []
    off: dict[str, NDArray[np.float64]] = {}
    for k in range(steps):
        due = (
            program.routines[1:]
            if k % PREDICTIONS_PER_UPDATE == PREDICTIONS_PER_UPDATE - 1
            else program.routines[1:2]
        )
        for routine in due:
            inputs = _spoiled(k, routine, _inputs(discrete, routine, log, k), off)
            machine.call(routine.name, split(routine, inputs))
            if k < JUMPED.start and routine.required[0].name == "z":
                sizes = machine.arrays["variance"][: routine.required[0].size]
                off[routine.name] = JUMP * np.sqrt(np.maximum(sizes.astype(float), 0.0))
            calls.append(RecordedCall(routine.name, inputs, machine.words()))
            if len(calls) == most:
                return tuple(calls)
    given = list(late(program, log, steps)) if program.delayed else []
    given += [(routine, moved_origin(routine)) for routine in program.recentre]
    given += in_motion(program)
    for routine in (*program.align, *program.gather):
        given += [(routine, row) for row in (at_rest if routine.name == "align" else fast)(program, routine)]
    given += [*resting(program), *among_lanes(program)]
    for routine, inputs in given:
        machine.call(routine.name, split(routine, inputs))
        calls.append(RecordedCall(routine.name, inputs, machine.words()))
    return tuple(calls)


def calm(program: Program, steps: int) -> Iterator[tuple[Routine, tuple[float, ...]]]:
    """Calls of a simulated motion of which nothing is spoiled, and of the routines around them; nothing is run.

    Parameters
    ----------
    program : Program
    steps : int
        Predictions.
    """
    log = _log(program.discrete, (steps + 1) / program.discrete.rate, np.random.default_rng(SEED))
    for k in range(steps):
        for routine in program.routines[1:]:
            if routine.name == "predict" or k % PREDICTIONS_PER_UPDATE == PREDICTIONS_PER_UPDATE - 1:
                yield routine, _inputs(program.discrete, routine, log, k)
        if k % LOOKED_AT == 0:
            yield program.check, ()
            yield program.supervisor.condition, ()
    for routine in program.align:
        yield from ((routine, row) for row in at_rest(program, routine))
    for routine in program.gather:
        yield from ((routine, row) for row in fast(program, routine))
    yield from in_motion(program)
    yield from resting(program)
    yield from among_lanes(program)


LOOKED_AT = 50
"""Predictions from one look at the whole filter to the next."""


def _log(discrete: DiscreteModel, seconds: float, rng: np.random.Generator) -> Log:
    """A simulated motion; of a filter whose inputs are zero but for their noise, the noise of its samples."""
    inputs = discrete.model.motion.inputs
    if not inputs or not all(i.quiet for i in inputs):
        return simulate(discrete, "generic", seconds, rng, rates=at_every_sample(discrete))
    t = np.arange(round(seconds * discrete.rate)) / discrete.rate
    channels = {c: Channel(np.zeros(t.size), i.unit) for i in inputs for c in i.channels}
    for s in discrete.model.sensors:
        for c in s.channels:
            sd = discrete.sample_variance(s, c) ** 0.5
            channels[c] = Channel(sd * rng.normal(size=t.size), s.unit)
    return Log(t, channels)


def at_rest(program: Program, routine: Routine) -> Iterator[tuple[float, ...]]:
    """Calls of the alignment: a body that lies on its side, is shaken in between, and rests until it is aligned."""
    dt = float(np.float32(min(program.discrete.max_step, SLOW_STEP_S)))
    for k in range(CALLS_AT_REST):
        force = [0.3, -9.7, 1.2 + 0.01 * (k % 3) + 4.0 * (k == SHAKEN)]
        rate = [0.01 * (k % 2), -0.004, 0.002]
        rest = {argument("gyro"): rate, "dt": [dt], HEADING: [0.7]}
        field = [21e-6, 36e-6 + 1e-7 * (k % 5), -11e-6]
        given = [rest.get(a.name, force if n == 0 else field) for n, a in enumerate(routine.arguments)]
        yield tuple(float(np.float32(v)) for values in given for v in values)


def resting(program: Program) -> Iterator[tuple[Routine, tuple[float, ...]]]:
    """Calls of the detector of rest, of a filter that has it: moving at first, shaken in between, at rest, pushed."""
    routines = {r.name: r for r in program.entries}
    if not program.resting:
        return
    update, found = routines[f"update_{program.resting.name}"], routines[DETECT_REST]
    rows = list(at_rest(program, found))
    for k, row in enumerate([*rows, *rows[SHAKEN + 1 :], *rows]):
        if k == SHAKEN:
            yield from ((update, (0.0, 0.0, 0.0)) for _ in range(UNTIL_FOLLOWED))
        yield found, row
    yield update, (30.0, 0.0, 0.0)
    yield found, (BEYOND, *row[1:])


def among_lanes(program: Program) -> Iterator[tuple[Routine, tuple[float, ...]]]:
    """Calls of the hooks for lanes, of a filter that has them: a lane at its start is taken over, and one that is broken."""
    routines = {r.name: r for r in lanes.routines(program)}
    if not routines:
        return
    start = [float(np.float32(v)) for v in program.discrete.start]
    P = [0.0] * program.covariance.size
    for i, s in enumerate(program.covariance.order):
        P[place(program.n, i, i)] = float(np.float32(program.prior(s).value ** 2)) or 1.0
    for x, stored in ((start, P), ([float("nan"), *start[1:]], P), (start, [-1.0, *P[1:]])):
        yield routines[lanes.HEALTH], ()
        yield routines[lanes.TAKE_OVER], (*x, *stored)


UNTIL_FOLLOWED = 30
"""Samples after which a sensor that was rejected has been followed."""


def _inputs(discrete: DiscreteModel, routine: Routine, log: Log, k: int) -> tuple[float, ...]:
    """The arguments of a routine at sample k, as single precision numbers in a row."""
    places: Mapping[str, tuple[str, ...]] = (
        {argument(i.name): i.channels for i in discrete.model.motion.inputs}
        | {argument(d): (d,) for d in discrete.model.drivers}
        | {"z": next((s.channels for s in discrete.model.sensors if routine.name == f"update_{s.name}"), ())}
    )
    row: list[float] = []
    for a in routine.required:
        values = (
            [1.0 / discrete.rate] if a.name == "dt" else [log.channels[c].values[k] for c in places[a.name]]
        )
        with np.errstate(over="ignore"):
            row += [float(np.float32(v)) for v in values]
        if np.isinf(row).any():
            raise InputError(
                f"the samples of {a.name} are beyond single precision, in which the code is proven",
                where=discrete.model.name,
                remedy="Check the sizes and units of the model",
            )
    return tuple(row)


def _spoiled(
    k: int, routine: Routine, inputs: tuple[float, ...], off: Mapping[str, NDArray[np.float64]]
) -> tuple[float, ...]:
    """The inputs of a call at sample k, with what goes wrong there."""
    if k in REFUSED:
        return _refused(routine, inputs)
    if k in UNKNOWN and routine.name == "predict":
        return (*(v + BEYOND for v in inputs[:-1]), inputs[-1])
    if k in JUMPED and routine.name in off:
        shift = off[routine.name]
        return (*(float(np.float32(v + s)) for v, s in zip(inputs, shift)), *inputs[shift.size :])
    return inputs


BEYOND = 1e20
"""An input that no sensor gives, in any unit."""


def _refused(routine: Routine, inputs: tuple[float, ...]) -> tuple[float, ...]:
    """Inputs that the routine must refuse: no step, or a sample beyond any gate."""
    if routine.name == "predict":
        return (*inputs[:-1], 0.0)
    return tuple(float(np.float32(v + 1e6)) for v in inputs)


def split(routine: Routine, inputs: tuple[float, ...]) -> list[tuple[float, ...] | float]:
    """The inputs of a call by argument, without those that it may leave out.

    Parameters
    ----------
    routine : Routine
    inputs : tuple of float
        All its required arguments in a row.
    """
    out: list[tuple[float, ...] | float] = []
    at = 0
    for a in routine.required:
        out.append(inputs[at : at + a.size] if a.size else inputs[at])
        at += a.size or 1
    return out


def fast(program: Program, routine: Routine) -> Iterator[tuple[float, ...]]:
    """Increments of a body that cones and is shaken, one of them beyond any sensor.

    Parameters
    ----------
    program : Program
    routine : Routine
        What gathers them.
    """
    for k in range(FAST_CALLS):
        wave = [np.sin(0.3 * k), np.cos(0.3 * k), 0.5]
        row = [s * w for _ in routine.arguments[:-1] for w, s in zip(wave, INCREMENT_SIZES)]
        row[0] += BEYOND * (k == SHAKEN)
        yield tuple(float(np.float32(v)) for v in (*row, FAST_STEP_S))


def moved_origin(routine: Routine) -> tuple[float, ...]:
    """An origin 300 m to the south-east, with scales and constants of a place that is not there."""
    sizes = [a.size for a in routine.arguments]
    row = [-200.0, 220.0, 1.001, 0.9990, *(0.01 * k + 0.1 for k in range(sum(sizes[2:])))]
    return tuple(float(np.float32(v)) for v in row)


def in_motion(program: Program) -> Iterator[tuple[Routine, tuple[float, ...]]]:
    """Calls of the alignment in motion: a climbing turn, and what it waits for."""
    routines = {r.name: r for r in program.moving}
    if not routines:
        return
    gather, fix = routines["align_gather"], routines["align_moving"]
    dt = min(program.discrete.max_step, SLOW_STEP_S)
    north = (19e-6, 5e-6, -41e-6) if fix.arguments[1].size else (0.4,)

    def rounded(*row: float) -> tuple[float, ...]:
        return tuple(float(np.float32(v)) for v in row)

    for force in (-2.0, -9.7):
        yield fix, rounded(10.0, 3.0, 0.0, *north)
        for k in range(CALLS_AT_REST):
            yield gather, rounded(0.3, 0.1, force + 0.01 * k, 0.02, -0.01, 0.05, dt)
        yield gather, rounded(BEYOND if force > -9.0 else 0.0, 0.0, -9.8, 0.0, 0.0, 0.0, dt)
        yield fix, rounded(10.4, 3.5, -0.1, *north)
    for routine in program.moving[2:]:
        yield routine, rounded(8.1, 6.1, 0.0)
        for k in range(CALLS_AT_REST):
            yield gather, rounded(0.1, 0.2, -9.8 + 0.01 * k, 0.01, -0.02, 0.03, dt)
        yield routine, rounded(8.0, 6.0, 0.1)
        yield routine, rounded(1.0, 0.5, 0.0)


def late_steps(program: Program) -> int:
    """Predictions of the delayed horizon: until the ring is full, and on."""
    return program.delayed_memory.rows + STEPS_BEHIND if program.delayed else 0


def late(program: Program, log: Log, first: int) -> Iterator[tuple[Routine, tuple[float, ...]]]:
    """Calls of the delayed horizon from a sample of a log on: stamps that jitter, and what must not be fused.

    Parameters
    ----------
    program : Program
        With a horizon.
    log : Log
    first : int
        The sample.
    """
    discrete, rng = program.discrete, np.random.default_rng(SEED)
    start, step, *updates = program.delayed
    plain = {f"delayed_{r.name}": r for r in program.routines}
    rows = program.delayed_memory.rows
    yield start, ()
    for k in range(first, first + late_steps(program)):
        inputs = _inputs(discrete, program.predict, log, k)
        spoiled = k - first == rows + STEPS_BEHIND // 2
        yield step, (*(v + BEYOND * spoiled for v in inputs[:-1]), inputs[-1])
        if k % PREDICTIONS_PER_UPDATE:
            continue
        for number, routine in enumerate(updates):
            for age in _ages(rows, k - first, number, rng.uniform(0.0, 1.0)):
                at = min(max(k - int(age), 0), log.n - 1)
                z = _inputs(discrete, plain[routine.name], log, at)[: routine.required[0].size]
                yield routine, (*z, float(np.float32(age / discrete.rate)))


def _ages(rows: int, k: int, number: int, jitter: float) -> tuple[float, ...]:
    """Ages in periods of the samples that a sensor sends after the k-th step: the last ones are old, double, swapped."""
    usual = min(rows, 2) * 0.5 * (1.0 + jitter) + 0.25 * rows
    special = (k // PREDICTIONS_PER_UPDATE + number) % SPECIAL
    if special == 0:
        return usual, 3.0 * rows, -1e3
    if special == 1:
        return 0.1 * rows, usual, usual
    return (usual,)


STEPS_BEHIND = 60
"""Predictions of the delayed horizon after its ring is full."""
SPECIAL = 6
"""One of so many times a sample is too old, or of the future, or comes twice, or after a younger one."""
