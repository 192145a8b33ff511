"""What a log holds of the drivers of effects: their courses without their own noise, and which of them show nothing."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import catalogue
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.identify.evidence.smoothed import course_without_noise
from kfgen.log.course import is_silent, longest_silence_s
from kfgen.log.log import Log

Array = NDArray[np.float64]

NOT_LOOKED_FOR = "no effect of it is looked for"
"""Of a driver whose course nobody knows."""


def drivers_of(log: Log) -> tuple[dict[str, Array], list[str]]:
    """All channels but references as what may drive others, and what is to be said of drivers that show nothing."""
    known = {cls.driver for cls in catalogue().values()} | set(DRIVERS)
    drive, said = _courses(log, (n for n in log.channels if not n.startswith("ref_")))
    for name in [n for n, v in drive.items() if np.ptp(v) == 0.0]:
        del drive[name]
        said[name] = f"channel {name} never changes: no effect of it can be seen"
    return drive, [words for name, words in said.items() if name in known]


def recorded(log: Log) -> dict[str, Array]:
    """The courses of the known drivers that a log holds, those that never change among them."""
    return _courses(log, (n for n in log.channels if n in DRIVERS))[0]


def silent(log: Log) -> list[str]:
    """What is to be said of known drivers whose course a log does not hold."""
    return list(_courses(log, (n for n in log.channels if n in DRIVERS))[1].values())


def _courses(log: Log, names: Iterable[str]) -> tuple[dict[str, Array], dict[str, str]]:
    """Smoothed courses over all times, and of channels without one why, in words."""
    drive: dict[str, Array] = {}
    said: dict[str, str] = {}
    for name in names:
        if not np.isfinite(log.channel(name).values).any():
            said[name] = f"channel {name} holds no number: {NOT_LOOKED_FOR}"
        elif is_silent(log, name):
            silence = f"has no sample for {longest_silence_s(log, name):.4g} s"
            said[name] = f"channel {name} {silence}: {NOT_LOOKED_FOR}"
        else:
            drive[name] = course_without_noise(log, name)
    return drive, said
