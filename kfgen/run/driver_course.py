"""The course of a driver as a filter over a log takes it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.inertial.vibration import vibration_power
from kfgen.log.course import course
from kfgen.log.log import Log

Array = NDArray[np.float64]


def driver_course(log: Log, name: str) -> Array:
    """A driver over all times of a log, between its own samples; of the vibration what accelerometers show, where not recorded.

    Parameters
    ----------
    log : Log
    name : str

    Returns
    -------
    ndarray, shape (n,)
        [SI]

    Raises
    ------
    InputError
        As `kfgen.log.course.course`.
    """
    accels = [f"accel_{a}" for a in "xyz"]
    if name == "vibration" and name not in log.channels and all(a in log.channels for a in accels):
        power = vibration_power(np.column_stack([log.values(a) for a in accels]), log.dt)
        return np.asarray(np.sqrt(power.sum(axis=1)))
    return course(log, name)
