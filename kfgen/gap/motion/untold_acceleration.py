"""Accelerometers under an attitude alone: it tells gravity, and not how the body accelerates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.gap.motion.compared_channel import Compared
from kfgen.gap.motion.known_length import poses
from kfgen.gap.motion.scene import MotionScene
from kfgen.gap.motion.truth import Truth
from kfgen.gap.rest.faults import assumed_sd
from kfgen.log.log import Log

Array = NDArray[np.float64]
SENSOR = "accel"
UNTOLD = "the body accelerates, which an attitude does not tell"
REMEDY = "Log a reference of its force (ref_accel_x, _y, _z)"
MAX_LEFT_NOISE_SD = 3.0
"""Standard deviations of its noise that a calibration and a lever arm may leave of a body that only turns."""

MAX_REST_NOISE_SD = 2.0
"""And may show where it rests."""


def at_rest_where_untold(log: Log, scene: MotionScene) -> MotionScene:
    """The scene with accelerometers at rest only, where the body accelerates and an attitude is all that is known.

    In one pose alone they show a bias, which is no gap: then they are not compared.

    Parameters
    ----------
    log : Log
    scene : MotionScene
        Of that log.

    Raises
    ------
    InputError
        Nothing is left that could be compared.
    """
    own = [c for c in scene.compared if c.sensor == SENSOR]
    truth = scene.truth
    if not own or f"ref_{SENSOR}_x" in log.channels or truth.R_bn is None or truth.omega_b is None:
        return scene
    if not any(_accelerates(c, truth) for c in own):
        return scene
    rest = _rest(log, own, truth.dt)
    still = {c.name: replace(c, there=c.there & rest) for c in own}
    resting = replace(scene, compared=tuple(still.get(c.name, c) for c in scene.compared))
    shown = {n for n, c in still.items() if resting.moving(c)}
    compared = tuple(c for c in resting.compared if c.name in shown or c.name not in still)
    if not compared:
        raise InputError(f"accel cannot be compared: {UNTOLD}", where=log.source, remedy=REMEDY)
    how = (
        f"is compared at rest only, {100.0 * float(rest.mean()):.0f} % of the log"
        if shown
        else "is not compared"
    )
    said = tuple(p for p in scene.said if p.where not in still or p.where in shown)
    return replace(resting, compared=compared, said=said, warnings=(f"accel {how}: {UNTOLD}. {REMEDY}",))


def _accelerates(c: Compared, truth: Truth) -> bool:
    """Whether gravity with any linear calibration, at any lever arm, leaves more than noise."""
    assert truth.omega_b is not None
    w, W = truth.omega_b, np.zeros((truth.t.size, 3))
    turn = np.gradient(w, truth.dt, axis=0)
    for k, e in enumerate(np.eye(3)):
        W[:, k] = (np.cross(turn, e) + np.cross(w, np.cross(w, e)))[:, c.axis]
    J = np.column_stack([np.ones(truth.t.size), truth.read[SENSOR], W])
    good = truth.good & c.there
    if good.sum() <= J.shape[1]:
        return False
    left = c.y[good] - J[good] @ np.linalg.lstsq(J[good], c.y[good], rcond=None)[0]
    return float(np.std(left)) > MAX_LEFT_NOISE_SD * assumed_sd(c.noise, c.step * truth.dt)


def _rest(log: Log, own: Sequence[Compared], dt: float) -> NDArray[np.bool_]:
    """Where they rest: in poses in which they show no more than their noise, shape (n,)."""
    out = np.zeros(log.n, dtype=bool)
    try:
        found = poses(log, SENSOR)
    except InputError:  # holes: nobody knows where it rests
        return out
    for start, stop in found:
        out[start:stop] = all(
            float(np.std(c.y[start:stop])) < MAX_REST_NOISE_SD * assumed_sd(c.noise, c.step * dt) for c in own
        )
    return out
