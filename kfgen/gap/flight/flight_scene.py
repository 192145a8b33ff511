"""The flight of a filter over a log, where the log and the filter allow one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kfgen.core.channel_names import acts_on
from kfgen.core.errors import InputError
from kfgen.core.time_budget import not_counted
from kfgen.effects.samples.event import Outliers
from kfgen.effects.series import RawSamples
from kfgen.emit.routines import Program
from kfgen.gap.flight.faults.misread import misread
from kfgen.gap.flight.faults.outlying import without_outliers
from kfgen.gap.flight.faults.stuck_sensor import stuck_sensors
from kfgen.gap.flight.flight_log import flight_log
from kfgen.gap.flight.path import FlownPath, flown
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.rest.faults import clipped_in
from kfgen.gap.scene.addition import relinearised
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, start_of
from kfgen.gap.scene.scene_gap import MAX_FOLLOWED_SIGMAS
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel
from kfgen.run.run import program_over

ATTITUDE_SENSORS = ("accel", "gyro", "mag")
"""Sensors that alone aid no flight: a log of them is one of sensors at rest or in poses."""
MIN_INERTIAL_RATE_HZ = 40.0
"""Rate of inertial sensors below which the motion between samples is lost."""
MAX_UNDOUBTED_SIGMAS = 5.0
"""Root mean square of a channel's innovations, in their standard deviations, up to which its axes and units are not doubted."""
MAX_LEFT_SHARE = 0.4
"""Of it, that a log leaves at most that is put right."""
MISREAD_S = 30.0
"""For which a filter flies over a log that is read otherwise [s]."""
MIN_FLIGHT_S = 15.0
"""Shortest log of a flight [s]."""


def flight_scene(log: Log, model: FilterModel) -> FlightScene | None:
    """The world of a filter in flight; None where the log lacks its inputs or has no aiding sensor of it.

    Parameters
    ----------
    log : Log
        Its references, where it has any, are not looked at.
    model : FilterModel

    Raises
    ------
    InputError
        The log is too short or its inertial sensors are too slow for a filter to follow, the filter diverges, or
        the extra ``kfgen[fast]`` is not installed.
    """
    inputs = [c for i in model.motion.inputs for c in i.channels]
    aiding = [
        s
        for s in model.sensors
        if s.name not in ATTITUDE_SENSORS and all(c in log.channels for c in s.channels)
    ]
    if model.attitude is None or not aiding or not all(c in log.channels for c in inputs):
        return None
    _check(log)
    program = program_over(model, log)
    if program.discrete.memories:
        return None
    flight = _about_constants(flown(flight_log(log, program)))
    path, left_out = without_outliers(flight)
    known = {w for w, effects in model.noise.items() if any(isinstance(e, Outliers) for e in effects)}
    said = tuple(p for p in left_out if not any(acts_on(p.where, w) for w in known))
    scene = FlightScene(path, said=said)
    faults = (*stuck_sensors(flight), *_clipped(log, inputs))
    return replace(scene, spoilt=faults or _misread(scene, log, program))


def _about_constants(path: FlownPath) -> FlownPath:
    """The path about the constants that the whole flight asks for: those of the alignment may be off by its tilt.

    A field that is wrong bends the path, and what effects do about such a path is not what they do in the flight.
    """
    scene = FlightScene(path)
    if not scene.unknowns:
        return path
    there, _ = relinearised(scene, fitted(scene, start_of(scene)))
    return there.path if isinstance(there, FlightScene) else path


def _clipped(log: Log, channels: Sequence[str]) -> tuple[Placed, ...]:
    """Inertial channels whose range is too small for the flight: what they did not read is in no integral of the filter."""
    raw = {c: RawSamples(np.asarray(log.t), log.values(c), 0.0, moves=True) for c in channels}
    return tuple(Placed(f.effect, c) for c, r in raw.items() for f in clipped_in(r)[0])


def _misread(scene: FlightScene, log: Log, program: Program) -> tuple[Placed, ...]:
    """What a log reads wrongly that the filter follows much more closely without it."""
    worst = _worst_channel_sigmas(scene)
    if worst < MAX_UNDOUBTED_SIGMAS:
        return ()
    with not_counted():
        faults, right = misread(_first_part(scene, log), program)
    if not faults:
        return ()
    least = min(worst * MAX_LEFT_SHARE, MAX_FOLLOWED_SIGMAS)
    return faults if _worst_channel_sigmas(FlightScene(flown(flight_log(right, program)))) < least else ()


def _first_part(scene: FlightScene, log: Log) -> Log:
    """The log until some time after its readings are first far from what the filter expects."""
    rows = scene.path.rows
    far = np.abs(rows.z - scene.path.expected()) > MAX_UNDOUBTED_SIGMAS * np.sqrt(rows.R)
    t = float(rows.t[np.argmax(far)]) if far.any() else float(log.t[0])
    return log.cut(0, int(np.searchsorted(log.t, t + MISREAD_S, side="right")))


def _worst_channel_sigmas(scene: FlightScene) -> float:
    """Root mean square of the innovations of the channel that the filter follows least, in their standard deviations.

    Beside what the constants do that the alignment took from its first readings: a field that is a degree off is no fault.
    """
    left, rows = scene.left(start_of(scene)), scene.path.rows
    return max(float(np.sqrt(np.mean(left[rows.of(c)] ** 2))) for c in scene.channels)


def _check(log: Log) -> None:
    """Raise `InputError` where a log cannot say anything of a filter in flight."""
    rate, duration = (log.n - 1) / float(log.t[-1] - log.t[0]), float(log.t[-1] - log.t[0])
    if rate < MIN_INERTIAL_RATE_HZ:
        raise InputError(
            f"the inertial sensors have {rate:.3g} Hz: what the vehicle does between their samples is not in the log",
            where=log.source,
            remedy=f"Log them at {MIN_INERTIAL_RATE_HZ:g} Hz or faster (PX4: SDLOG_PROFILE high rate; ArduPilot: LOG_BITMASK with IMU_RAW)",
        )
    if duration < MIN_FLIGHT_S:
        raise InputError(
            f"the log lasts {duration:.3g} s: a filter has not settled by then",
            where=log.source,
            remedy=f"Give {MIN_FLIGHT_S:g} s or more, from rest on",
        )
