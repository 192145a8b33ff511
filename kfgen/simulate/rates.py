"""At which rows of a log a sensor has a sample."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import acts_on
from kfgen.core.errors import InputError
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.sensors import Sensor

IMU = "imu"
"""Name of the inputs among rates."""
DEFAULT_RATE_HZ = 100.0
"""Of a simulated log and its inputs."""


def sensor_rates(discrete: DiscreteModel, asked: Mapping[str, float] | None = None) -> dict[str, float]:
    """Rate of every sensor by name [Hz]: what is asked for, else its usual one, at most that of the log.

    Parameters
    ----------
    discrete : DiscreteModel
        Its `rate` is the log's.
    asked : mapping of str to float, optional
        By the name of a sensor or the beginning of its channels (``gnss``, ``baro``) [Hz].

    Raises
    ------
    InputError
        No such sensor, or a rate that is not positive or higher than the log's.
    """
    sensors = discrete.model.sensors
    out = {s.name: min(s.usual_rate or discrete.rate, discrete.rate) for s in sensors}
    for name, rate in (asked or {}).items():
        meant = [s for s in sensors if _is_meant(s, name)]
        if not meant:
            known = ", ".join(s.name for s in sensors)
            raise InputError(
                f"{discrete.model.name} has no sensor '{name}'",
                where="--rate",
                remedy=f"It has {known}" if known else "It has none",
            )
        if not 0.0 < rate <= discrete.rate * (1.0 + 1e-9):
            raise InputError(
                f"a rate of {rate:g} Hz of {name} is not between zero and the {discrete.rate:g} Hz of the log",
                where="--rate",
                remedy="Give a slower one, or a faster --rate of the log",
            )
        out |= {s.name: float(rate) for s in meant}
    return out


def at_every_sample(discrete: DiscreteModel) -> dict[str, float]:
    """Every sensor as fast as the log."""
    return {s.name: discrete.rate for s in discrete.model.sensors}


def _is_meant(sensor: Sensor, name: str) -> bool:
    return name == sensor.name or any(acts_on(name, c) for c in sensor.channels)


def rows_of(n: int, log_rate: float, rate: float) -> NDArray[np.intp]:
    """The rows of a log of `n` rows at which a sensor of a rate [Hz] has a sample; the first is one."""
    count = np.floor(np.arange(n) * (rate / log_rate) + 1e-9)
    return np.flatnonzero(np.diff(count, prepend=-1.0) > 0.0)


def read_rates(texts: Iterable[str], usual: float = DEFAULT_RATE_HZ) -> tuple[float, dict[str, float]]:
    """``200``, ``gnss=5``: the rate of the log, and those of sensors by name [Hz]; raises `InputError`."""
    own, others = usual, dict[str, float]()
    for text in texts:
        name, equals, value = text.rpartition("=")
        try:
            rate = float(value)
        except ValueError:
            rate = math.nan
        if math.isnan(rate) or (equals and not name.strip()):
            raise InputError(
                f"'{text}' is no rate", where="--rate", remedy="Write --rate 200, or --rate gnss=5"
            )
        if name.strip() in ("", IMU):
            own = rate
        else:
            others[name.strip()] = rate
    return own, others
