"""The longest rest of a log whose sensors moved and that has no reference: what they read in motion is no noise."""

from __future__ import annotations

from kfgen.core.channel_names import AXES
from kfgen.core.errors import InputError
from kfgen.identify.screening.rests import MIN_REST_S, at_rest_only, longest_rest
from kfgen.identify.words import COUNTS_AS_NOISE
from kfgen.log.log import Log


def rest_of(log: Log, how: str) -> tuple[Log, str]:
    """The longest rest as a log of its own, and what is to be said of it; all of a log without three axes, warned of.

    Parameters
    ----------
    log : Log
    how : str
        In words, how its sensors moved.

    Raises
    ------
    InputError
        Gyro or accelerometer do not rest for `MIN_REST_S`, or have samples that are no numbers.
    """
    if not any(all(f"{s}_{a}" in log.channels for a in AXES) for s in ("gyro", "accel")):
        return log, COUNTS_AS_NOISE.format(how=how)
    part = longest_rest(log)
    if part is None:
        raise InputError(
            f"the sensors moved ({how}), without a rest of {MIN_REST_S:g} s and without a reference, "
            "and what they read in motion is no noise",
            where=log.source,
            remedy="Log a reference beside them (ref_q_w to ref_q_z, ref_gyro_x, ...), compare a filter in flight "
            "(--model ins15), or log them at rest",
        )
    return part, at_rest_only(part, how, "compared")
