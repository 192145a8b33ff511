"""The attitude at the start of a log: what points up and north in its first second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects.filter_role import ReadingError
from kfgen.effects.inertial.felt import Felt
from kfgen.emit.routines import Program
from kfgen.log.log import Log
from kfgen.manoeuvre.truth import level_at
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import HEADING
from kfgen.model.known_delays import shifts
from kfgen.model.parts.motion import Input
from kfgen.model.parts.sensors import Sensor
from kfgen.run.driver_course import driver_course
from kfgen.run.own_times import SAME_TIME_PERIODS

Array = NDArray[np.float64]

ALIGNMENT_S = 1.0
"""Seconds at rest from which the first attitude is taken."""
SUBSTITUTIONS = 5
"""Of the errors of a reading into itself; a tenth of it is wrong by 1e-5 then."""


def align_attitude(program: Program, log: Log, x: dict[str, float], k: dict[str, float]) -> None:
    """Attitude from the first second, and what a sensor knows of its own constants then, into states and constants.

    Parameters
    ----------
    program : Program
    log : Log
    x, k : dict of str to float
        Stored states and constants by name [SI], which are changed.

    Raises
    ------
    InputError
        A sensor that says what points up or north has no sample then.
    """
    from scipy.spatial.transform import Rotation

    model = program.discrete.model
    declared: list[Input | Sensor] = [*model.motion.inputs, *model.sensors]
    parts = [p for p in declared if all(c in log.channels for c in p.channels)]
    up = next((p for p in parts if p.at_rest == "up"), None)
    if up is None:
        return
    up_b = _first_mean(log, up, program)
    up_b = up_b / np.linalg.norm(up_b)
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up_b[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    for s in model.sensors:
        if s.at_rest == "north" and s in parts:
            ahead = _first_mean(log, s, program)
            calibrated = s.calibrated(tuple(ahead), tuple(up_b))
            k |= {name: calibrated[name] for name in calibrated.keys() & k.keys()}
            x |= {name: calibrated[name] for name in calibrated.keys() & x.keys()}
    north = ahead - (ahead @ up_b) * up_b
    north /= np.linalg.norm(north)
    R_lb = _turned(np.vstack([north, np.cross(-up_b, north), -up_b]), model)
    values = {c.name: c.value for c in model.constants} | dict(
        zip(program.discrete.nominal_names, program.discrete.start)
    )
    q = Rotation.from_matrix(level_at(model, values).T @ R_lb).as_quat(scalar_first=True)
    x |= {f"q_{a}": float(v) for a, v in zip("wxyz", q)}


def constants_at_rest(sensors: Sequence[Sensor]) -> tuple[str, ...]:
    """The constants that an alignment takes from the first samples of these sensors: the log knows them no better.

    Parameters
    ----------
    sensors : sequence of Sensor

    Returns
    -------
    tuple of str
    """
    # Any readings do: which constants they tell does not depend on them.
    upright = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    shown = {n for s in sensors if s.at_rest == "north" for n in s.calibrated(*upright)}
    return tuple(c.name for s in sensors for c in s.constants if c.name in shown)


def _first_mean(log: Log, part: Input | Sensor, program: Program) -> Array:
    """The mean of a triad over the alignment, late samples by their own times, without the errors that the filter knows of it; raises `InputError` where it says nothing."""
    model = program.discrete.model
    since = log.t - log.t[0] - shifts(model).get(part.name, 0.0)
    first = (since >= -SAME_TIME_PERIODS * log.dt) & (since <= ALIGNMENT_S)
    values = np.column_stack([log.channel(c).values[first] for c in part.channels])
    good = values[np.isfinite(values).all(axis=1)]
    if not good.size or not np.linalg.norm(good.mean(axis=0)) > 0.0:
        raise InputError(
            f"{part.name} has no usable sample in the first {ALIGNMENT_S:g} s, so there is no first attitude",
            where=log.source,
            remedy="Cut the log to where the sensor works and is at rest",
        )
    follows = [_at_start(model.effects_on(c), log, first, program) for c in part.channels]
    return _undone(good.mean(axis=0) - np.array(follows), part, model)


def _at_start(effects: sp.Expr, log: Log, first: NDArray[np.bool_], program: Program) -> float:
    """What effects add to a channel over the alignment: states and constants as they begin, drivers as they are recorded."""
    model = program.discrete.model
    own = dict(zip(program.discrete.nominal_names, program.discrete.start)) | {
        c.name: float(c.value) for c in model.constants
    }
    driven = {m.name: m.channel for m in program.discrete.memories} | {d: d for d in model.drivers}
    names = {str(s) for s in effects.free_symbols}
    own |= {n: float(driver_course(log, d)[first].mean()) for n, d in driven.items() if n in names}
    return float(effects.subs({s: own[str(s)] for s in effects.free_symbols}))


def _undone(read: Array, part: Input | Sensor, model: FilterModel) -> Array:
    """A reading of a triad at rest, shape (3,), without the errors that depend on it alone, by substitution."""
    errors: list[Any] = [
        e.effect for e in model.errors if isinstance(e.role, ReadingError) and e.acts_on(part.channels[0])
    ]
    value = np.array(read, dtype=np.float64)
    for _ in range(SUBSTITUTIONS if len(value) == 3 else 0):
        felt = Felt(tuple(value))
        mine = [e for e in errors if not e.needs and not e.filter_drivers]
        value = read - np.array([sum((float(e.error(felt, k)) for e in mine), 0.0) for k in range(3)])
    return value


def _turned(R_lb: Array, model: FilterModel) -> Array:
    """The attitude at the start, body to north-east-down, with the heading that the filter file says."""
    if HEADING not in model.initial:
        return R_lb
    turn = model.initial[HEADING].value - float(np.arctan2(R_lb[1, 0], R_lb[0, 0]))
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_lb
