"""The longest rest of a log whose sensors moved and that has no reference: what they read in motion is no noise."""

from __future__ import annotations

from kfgen.core.channel_names import AXES
from kfgen.core.errors import InputError
from kfgen.core.numbers import moment
from kfgen.gap.motion.known_length import poses
from kfgen.identify.screening.motion import motion_in
from kfgen.identify.words import COUNTS_AS_NOISE
from kfgen.log.log import Log

MIN_REST_S = 10.0
"""Shortest rest that is compared with a model of the noise [s]."""


def longest_rest(log: Log, how: str) -> tuple[Log, str]:
    """The longest rest as a log of its own, and what is to be said of it; all of a log without three axes, warned of.

    Parameters
    ----------
    log : Log
    how : str
        In words, how its sensors moved.

    Raises
    ------
    InputError
        Gyro or accelerometer do not rest for `MIN_REST_S`, or their samples are uneven or have holes.
    """
    sensor = next((s for s in ("gyro", "accel") if all(f"{s}_{a}" in log.channels for a in AXES)), "")
    if not sensor:
        return log, COUNTS_AS_NOISE.format(how=how)
    try:
        rests = poses(log, sensor)
    except InputError as error:
        raise InputError(
            f"the sensors moved ({how}), and where they rest is not known: {error.what}",
            where=log.source,
            remedy="Cut the log to a time at rest, or log a reference beside them",
        ) from None
    rests = [(a, b) for a, b in rests if log.t[b - 1] - log.t[a] >= MIN_REST_S]
    part = log.cut(*max(rests, key=lambda rest: rest[1] - rest[0])) if rests else None
    if part is None or motion_in(part, list(log.channels)):
        raise InputError(
            f"the sensors moved ({how}), without a rest of {MIN_REST_S:g} s and without a reference, "
            "and what they read in motion is no noise",
            where=log.source,
            remedy="Log a reference beside them (ref_q_w to ref_q_z, ref_gyro_x, ...), compare a filter in flight "
            "(--model ins15), or log them at rest",
        )
    return part, (
        f"the sensors moved ({how}): compared is their longest rest, {moment(float(part.t[0]))} to "
        f"{moment(float(part.t[-1]))} s, for what they read in motion is no noise"
    )
