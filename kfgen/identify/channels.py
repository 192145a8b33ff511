"""Which channels of a log are identified, and which of them drive the others.

A sensor channel is recognised by its name (``gyro_x``, ``baro_height``); where a log has none of these, every channel
counts that is no reference, no driver, and no time or counter.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import some_of
from kfgen.core.errors import InputError
from kfgen.core.units import parse_unit
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.identify.evidence.smoothed import course_without_noise
from kfgen.log.log import Log, StoredLog

Array = NDArray[np.float64]

SENSOR_NAME = re.compile(r"(gyro|accel|mag|flow)_\w+|baro_height|airspeed|range|heading")
"""Names of sensor channels."""
TIME_NAME = re.compile(
    r"(time|timestamp|index|counter|sequence)(_\w+)?|t|count|seq|frame|sample", re.IGNORECASE
)
"""Names of columns that hold times or counters, beside those that are recognised by their unit or their values."""
OTHER_NAME = ("ref_", "movement", "input", "throttle", "vibration", *DRIVERS)
"""Beginnings of names of references, of commands and of drivers."""
COMPUTED_FROM = {"baro_height": "pressure"}
"""Channels that an instrument computes from what a driver's name stands for: that is its own reading, and no driver."""
BAND_ENDS = ("_lo", "_hi")
"""Ends of names that hold the band of a published Allan curve."""
MIN_COUNTER_VALUES = 8
"""Different values from which on a column that never falls is a counter, and no sensor on two or three levels."""


def default_channels(log: Log | StoredLog) -> tuple[list[str], list[str]]:
    """The channels that are identified where none are asked for.

    Parameters
    ----------
    log : Log or StoredLog
        The first of the logs that are identified together.

    Returns
    -------
    names : list of str
        In the order of the log.
    warnings : list of str
        What was left out though it may be a sensor, and how to ask for it.

    Raises
    ------
    InputError
        There is nothing to identify.
    """
    curve = log.axis == "tau"
    free = [c for c in log.channels if not c.startswith(OTHER_NAME) and not (curve and c.endswith(BAND_ENDS))]
    named = [c for c in free if SENSOR_NAME.fullmatch(c)]
    counters = [] if curve else [c for c in free if not SENSOR_NAME.fullmatch(c) and _is_time(log, c)]
    skipped = set(counters)
    free = [c for c in free if c not in skipped]
    names = named or free
    if not names:
        raise InputError(
            f"there is nothing to identify among {some_of(log.channels)}",
            where=log.source,
            remedy="Name channels with --channels",
        )
    said = [f"{some_of(counters)}: a time or a counter, not identified"] if counters else []
    asked = set(names)
    rest = [c for c in free if c not in asked]
    if rest:
        said.append(
            f"{some_of(rest)}: not identified beside the sensor channels; ask for "
            f"{'it' if len(rest) == 1 else 'them'} with --channels {','.join(rest)}"
        )
    return names, said


def _is_time(log: Log | StoredLog, name: str) -> bool:
    """Whether a channel holds times or counts, by its name, its unit or its values."""
    in_seconds = parse_unit(log.channels[name].unit).same_dimension(parse_unit("s"))
    return in_seconds or bool(TIME_NAME.fullmatch(name)) or _is_counter(_first_values(log, name))


def _first_values(log: Log | StoredLog, name: str) -> Array:
    """The values [SI] of a channel; of one that stays in its file the first piece."""
    if isinstance(log, Log):
        return log.channels[name].values
    return next(log.channels[name].chunks(), np.zeros(0))


def _is_counter(values: Array) -> bool:
    """Whether values never fall, or never rise, over several levels: a time or a counter, for noise does both."""
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    if not ((steps >= 0.0).all() or (steps <= 0.0).all()):
        return False
    return int(np.count_nonzero(steps)) >= MIN_COUNTER_VALUES


def recorded_drivers(log: Log, but: str = "") -> Mapping[str, Array]:
    """The courses of the drivers that a log has, without their own noise: a noisy regressor explains less than what drives.

    Parameters
    ----------
    log : Log
    but : str
        The channel that is identified, which does not drive itself, nor does what it is computed from.

    Returns
    -------
    mapping of str to ndarray, shape (n,)
        Values [SI] by the names of `kfgen.effects.driven.proportional.DRIVERS`.
    """
    skipped = (but, COMPUTED_FROM.get(but))
    found = [n for n in DRIVERS if n in log.channels and n not in skipped]
    names = dict(zip(found, found))
    warm = [n for n in log.channels if n != but and not n.startswith("ref_") and _is_temperature(log, n)]
    if "temperature" not in log.channels and warm:  # under another name: temp, imu_temp
        names["temperature"] = warm[0]
    there = {k: n for k, n in names.items() if np.isfinite(log.channels[n].values).any()}
    return {k: course_without_noise(log, n) for k, n in there.items()}


def _is_temperature(log: Log, name: str) -> bool:
    """Whether a channel holds temperatures, by its unit."""
    return parse_unit(log.channels[name].unit).same_dimension(parse_unit("K"))


def checked(names: Sequence[str] | str | None) -> list[str] | None:
    """Names as a list, from a list or from a text in which commas separate them; None where there are none."""
    if isinstance(names, str):
        names = [part.strip() for part in names.split(",")]
    return [name for name in names if name] or None if names else None
