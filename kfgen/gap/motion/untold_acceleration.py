"""Accelerometers under an attitude alone: it tells gravity, and not how the body accelerates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kfgen.core.errors import InputError
from kfgen.gap.motion.compared_channel import Compared
from kfgen.gap.motion.scene import MotionScene
from kfgen.gap.motion.truth import Truth
from kfgen.gap.rest.faults import assumed_sd
from kfgen.log.log import Log

SENSOR = "accel"
UNTOLD = "the body accelerates, which an attitude does not tell"
REMEDY = "Log a reference of its force (ref_accel_x, _y, _z), or rest in several poses for 'kfgen calibrate'"
MAX_LEFT_NOISE_SD = 3.0
"""Standard deviations of its noise that a calibration and a lever arm may leave of a body that only turns."""


def without_untold(log: Log, scene: MotionScene) -> MotionScene:
    """The scene without accelerometers, where the body accelerates and an attitude is all that is known of it.

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
    left = tuple(c for c in scene.compared if c.sensor != SENSOR)
    if not left:
        raise InputError(f"accel cannot be compared: {UNTOLD}", where=log.source, remedy=REMEDY)
    said = tuple(p for p in scene.said if p.where not in {c.name for c in own})
    return replace(scene, compared=left, said=said, warnings=(f"accel is not compared: {UNTOLD}. {REMEDY}",))


def _accelerates(c: Compared, truth: Truth) -> bool:
    """Whether gravity with any linear calibration, at any lever arm, leaves more than noise, of whatever size it is."""
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
    white = max(assumed_sd(c.noise, c.step * truth.dt), float(np.std(np.diff(left))) / np.sqrt(2.0))
    return bool(float(np.std(left)) > MAX_LEFT_NOISE_SD * white)
