"""`calibrate`: from a log in which a sensor was turned to its biases, scales, angles and irons, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.calibrate import words
from kfgen.calibrate.coverage import covered_share, missing_turn
from kfgen.calibrate.ellipsoid import MIN_READINGS, ellipsoid
from kfgen.calibrate.fit import Fitted, fitted
from kfgen.calibrate.known_turns import turn_scene
from kfgen.calibrate.parameters import CalibratedNumber, entries_of, placed
from kfgen.calibrate.result import CalibratedSensor, Calibration
from kfgen.calibrate.turns import turns_between_rests
from kfgen.core.channel_names import AXES
from kfgen.core.errors import InputError
from kfgen.core.units import parse_quantity, parse_unit
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.effects.series import noise_of
from kfgen.gap.motion.known_length import MIN_POSES, NormScene, norm_scene
from kfgen.gap.scene.scene import ScenePoint
from kfgen.identify.screening.rests import rests
from kfgen.log.log import Log
from kfgen.log.own_rows import log_of_sensor
from kfgen.log.readers import read_log

Array = NDArray[np.float64]

SENSORS = {"accel": "m/s^2", "mag": "uT", "gyro": "deg/s"}
"""Sensors that are calibrated, and a unit that their channels may have."""
MIN_POSES_OF_FIT = 6
"""Poses from which bias and scale of three axes are known."""
MAX_RELATIVE_HALF_WIDTH = 0.1
"""Of a scale: an interval beyond which the log does not tell it."""
USUAL_ANGLE_RAD = 0.03
"""Standard deviation of the angles between the axes of an accelerometer before anything is known of them [rad]."""
MAX_CONDITION = 1e4
"""Of the derivatives: beyond, numbers cannot be distinguished."""


@dataclass(frozen=True)
class Known:
    """What is known beside the log.

    Parameters
    ----------
    turn, turn_sd : float
        Angle of a turn of a gyro, and its standard deviation [rad].
    field : float
        Strength of the field [T]; zero where it is not known.
    """

    turn: float
    turn_sd: float
    field: float


def calibrate(
    log: Log | str | Path,
    *,
    turn: str = "360 deg",
    turn_sd: str = "0.5 deg",
    field: str | None = None,
    sensors: Sequence[str] | str | None = None,
) -> Calibration:
    """Calibrate the sensors of a log that was made for it.

    An accelerometer rests in poses, and reads gravity in each; a magnetometer is turned through all directions in one
    place; a gyro is turned by a known angle about one axis at a time, with rests between.

    Parameters
    ----------
    log : Log or path
        With the triads ``accel_x..z``, ``mag_x..z`` or ``gyro_x..z``.
    turn, turn_sd : str
        The angle by which a gyro was turned each time, or multiples of it, and its standard deviation.
    field : str, optional
        Strength of the field about a magnetometer; without it one axis measures that.
    sensors : sequence of str, or str with commas, optional
        Of ``accel``, ``mag`` and ``gyro``; all that the log has when left out.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        The log has no such sensor, or none that its motion calibrates: what is missing is said.
    """
    data = read_log(log) if isinstance(log, (str, Path)) else log
    known = Known(
        parse_quantity(turn, "deg", where="--turn"),
        parse_quantity(turn_sd, "deg", where="--turn-sd"),
        parse_quantity(field, "uT", where="--field") if field else 0.0,
    )
    if not (known.turn > 0.0 and known.turn_sd > 0.0 and known.field >= 0.0):
        raise InputError("an angle, its standard deviation and a field are positive", where="--turn, --field")
    asked = [s.strip() for s in sensors.split(",")] if isinstance(sensors, str) else list(sensors or ())
    unknown = [s for s in asked if s not in SENSORS]
    if unknown:
        raise InputError(
            f"'{unknown[0]}' is not calibrated", where="--sensors", remedy=f"Known are {', '.join(SENSORS)}"
        )
    there = [s for s in SENSORS if all(f"{s}_{a}" in data.channels for a in AXES)]
    wanted = asked or there
    if not wanted or not set(wanted) <= set(there):
        missing = next((s for s in wanted if s not in there), "accel")
        raise InputError(
            f"the log has no {missing}_x, {missing}_y and {missing}_z",
            where=data.source,
            remedy="Name its columns with --columns",
        )
    found, refused, held = [], list[str](), list[str]()
    for sensor in wanted:
        own = log_of_sensor(data, [f"{sensor}_{a}" for a in AXES])
        held += own.held
        try:
            found.append(_calibrated(own, sensor, known))
        except InputError as error:
            if sensor in asked or len(wanted) == 1:
                raise
            refused.append(f"{error.what}. {error.remedy}" if error.remedy else error.what)
    refused = list(dict.fromkeys(refused))
    if not found:
        raise InputError("; ".join(refused), where=data.source)
    warnings = (*data.warnings, *held, *refused, *(w for s in found for w in s.warnings))
    return Calibration(tuple(found), ((data.source, data.sha256),), warnings)


def _calibrated(log: Log, sensor: str, known: Known) -> CalibratedSensor:
    """One sensor; errors say which, and where."""
    names = [f"{sensor}_{a}" for a in AXES]
    for name in names:
        if not parse_unit(log.channels[name].unit).same_dimension(parse_unit(SENSORS[sensor])):
            raise InputError(
                f"{name} is in {log.channels[name].unit or 'counts'}, which is no unit of such a sensor",
                where=log.source,
                remedy=f"Give its scale: --columns '{name}=COLUMN [{SENSORS[sensor]}/COUNTS]'",
            )
    noise = _noise_at_rest(log, names)
    if sensor == "gyro":
        return _by_turns(log, noise, known)
    scene = norm_scene(log, noise, sensor)
    if scene is None:
        raise _not_turned(log, sensor)
    return _by_length(log, noise, scene, known.field if sensor == "mag" else scene.length)


def _noise_at_rest(log: Log, names: Sequence[str]) -> NoiseModel:
    """White noise of the channels, from differences that motion does not survive."""
    dt = log.uniform_dt()
    channels = {}
    for name in names:
        N = max(noise_of(log.values(name)), 1e-9 * float(np.ptp(log.values(name)))) * np.sqrt(dt)
        channels[name] = ChannelNoise(log.channels[name].unit, (Term(make("white_noise", N=float(N))),))
    return NoiseModel(channels)


def _not_turned(log: Log, sensor: str) -> InputError:
    """Why the motion of a log does not calibrate a sensor."""
    y = np.array([log.values(f"{sensor}_{a}") for a in AXES]).T
    if sensor == "accel":
        poses = rests(log, sensor)
        y = np.array([y[a:b].mean(axis=0) for a, b in poses]).reshape(-1, 3)
        if len(poses) < MIN_POSES:
            return InputError(
                f"accel rests in {len(poses)} {'pose' if len(poses) == 1 else 'poses'}, which tells nothing of its scales",
                where=log.source,
                remedy=f"Rest it for two seconds in each of {MIN_READINGS} poses or more, on all six sides",
            )
    share = covered_share(y - y.mean(axis=0))
    return InputError(
        words.near_one_plane(sensor, share),
        where=log.source,
        remedy=missing_turn(y).capitalize(),
    )


def _by_length(log: Log, noise: NoiseModel, scene: NormScene, length: float) -> CalibratedSensor:
    """A triad of which what it should read has a constant length."""
    sensor, y = scene.sensor, scene.y
    if sensor == "accel" and len(y) < MIN_POSES_OF_FIT:
        raise InputError(
            f"accel rests in {len(y)} poses, and bias and scale of three axes take {MIN_POSES_OF_FIT}",
            where=log.source,
            remedy="Rest it on all six sides, better in nine poses or more",
        )
    entries = entries_of(sensor, len(y), known_length=length > 0.0)
    start, size = _start(log, sensor, y, entries, length)

    angles = np.array([e.effect == "misalignment" for e in entries] + [False] * (not length))

    def residual(x: Array) -> Array:
        unknowns = np.array([length or x[-1]])
        left = scene_of_length.residuals([ScenePoint(placed(entries, x), unknowns)])[:, 0]
        return np.concatenate([left, x[angles] / USUAL_ANGLE_RAD])

    scene_of_length = NormScene(sensor, scene.unit, scene.t, scene.y, scene.variance)
    scale = np.array(
        [size if e.effect in ("bias", "hard_iron") else 1.0 for e in entries] + [size] * (not length)
    )
    fit = fitted(residual, start, scale, in_blocks=sensor == "mag")
    A, b = scene.reading(placed(entries, fit.values))
    u = np.asarray(np.linalg.solve(A, (y - b).T).T, dtype=np.float64)
    _refuse_open(log, sensor, entries, fit, u, scale)
    before = float(np.std(np.linalg.norm(y, axis=1)))
    return CalibratedSensor(
        sensor,
        log.channels[f"{sensor}_x"].unit,
        entries,
        fit,
        noise,
        readings=len(y),
        coverage=covered_share(u),
        before=before if not length else float(np.sqrt(np.mean((np.linalg.norm(y, axis=1) - length) ** 2))),
        after=float(np.sqrt(np.mean((np.linalg.norm(u, axis=1) - (length or fit.values[-1])) ** 2))),
        length=float(length or fit.values[-1]),
        said=tuple(
            words.open_angle(e.label)
            for e, half in zip(entries, fit.half_widths)
            if e.effect == "misalignment" and half > USUAL_ANGLE_RAD
        ),
    )


def _start(
    log: Log, sensor: str, y: Array, entries: Sequence[CalibratedNumber], length: float
) -> tuple[Array, float]:
    """Where the fit begins: the ellipsoid of the readings, where there are enough; and the size of what is read."""
    if len(y) < MIN_READINGS:
        return np.zeros(len(entries)), length
    try:
        b, U = ellipsoid(y)
    except InputError as error:
        if length:  # gravity is known, and a fit finds its way from no error at all
            return np.zeros(len(entries)), length
        raise InputError(
            f"{error.what} of {sensor}", where=log.source, remedy=missing_turn(y).capitalize()
        ) from None
    size = length or float(U[2, 2])
    A = U / size
    numbers = []
    for e in entries:
        axis = AXES.index(e.where[-1]) if e.where[-2] == "_" else AXES.index(e.parameter[0])
        if e.effect in ("bias", "hard_iron"):
            numbers.append(b[axis])
        else:
            other = AXES.index(e.parameter[1]) if len(e.parameter) == 2 else axis
            numbers.append(A[axis, other] - (axis == other))
    return np.array(numbers + ([] if length else [size])), size


def _refuse_open(
    log: Log, sensor: str, entries: Sequence[CalibratedNumber], fit: Fitted, u: Array, scale: Array
) -> None:
    """Refuse numbers that the readings leave open."""
    wide = fit.half_widths / scale
    worst = int(np.argmax(wide))
    if fit.condition < MAX_CONDITION and wide[worst] < MAX_RELATIVE_HALF_WIDTH:
        return
    name = entries[worst].label if worst < len(entries) else "the strength of the field"
    raise InputError(
        f"{words.covers(sensor, covered_share(u))}, which leaves {name} open",
        where=log.source,
        remedy=missing_turn(u).capitalize(),
    )


def _by_turns(log: Log, noise: NoiseModel, known: Known) -> CalibratedSensor:
    """Scales of a gyro from turns by a known angle."""
    angle, sd = known.turn, known.turn_sd
    turns, skipped = turns_between_rests(log, angle)
    axes = sorted({t.axis for t in turns if t.angle})
    if not axes:
        raise InputError(
            f"gyro has no turn by {np.degrees(angle):.4g} deg about one of its axes between two rests",
            where=log.source,
            remedy="Turn it about one axis at a time, with two seconds of rest before and after, and give the angle "
            "with --turn",
        )
    scene = turn_scene(log, noise, [t for t in turns if t.axis in axes], sd)
    entries = tuple(CalibratedNumber("scale_factor", f"gyro_{AXES[i]}", "coefficient") for i in axes)

    def residual(x: Array) -> Array:
        point = ScenePoint(placed(entries, x[: len(entries)]), x[len(entries) :])
        return scene.residuals([point])[:, 0]

    count = len(entries)
    scale = np.array([1.0] * count + [1e-3] * len(scene.axes))
    fit = fitted(residual, np.zeros(scale.size), scale, in_blocks=False)
    said = [words.not_turned(AXES[i]) for i in range(3) if i not in axes]
    if skipped:
        said.append(words.other_turns(skipped, float(np.degrees(angle))))
    count_of_turns = sum(bool(t.angle) for t in scene.turns)
    if count_of_turns == len(axes):
        said.append(words.EACH_TURNED_ONCE)
    wrong = np.array([abs(v) - a for v, t in zip(scene.integral, scene.turns) if (a := abs(t.angle))])
    left = (fit.residual * scene.deviation)[[bool(t.angle) for t in scene.turns]]
    return CalibratedSensor(
        "gyro",
        log.channels["gyro_x"].unit,
        entries,
        fit,
        noise,
        readings=count_of_turns,
        coverage=len(axes) / 3.0,
        before=float(np.sqrt(np.mean(wrong**2))),
        after=float(np.sqrt(np.mean(left**2))),
        length=angle,
        said=tuple(f"gyro: {w}" for w in said),
    )
