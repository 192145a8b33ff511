"""From a log with references to the scene of its motion; none where nothing moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from kfgen.effects.faults.reference import OtherMotion
from kfgen.effects.inertial.inertial_error import InertialError
from kfgen.effects.noise_model import NoiseModel
from kfgen.gap.core.drivers import recorded
from kfgen.gap.motion.compared_channel import compared_of, sound_samples
from kfgen.gap.motion.likeness import MAX_UNEXPLAINED_SHARE
from kfgen.gap.motion.references.attitude_convention import misread
from kfgen.gap.motion.references.reference import heard, references
from kfgen.gap.motion.references.rounded_reference import rounded
from kfgen.gap.motion.scene import MotionScene
from kfgen.gap.motion.truth import held, truth_of
from kfgen.gap.motion.untold_acceleration import without_untold
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log


def motion_scene(log: Log, noise: NoiseModel) -> MotionScene | None:
    """The motion world of a log; none where there is no reference or nothing moves.

    Raises
    ------
    InputError
        Time is uneven, a reference has no numbers, a channel's unit does not meet its noise's, or the reference tells
        nothing of the channels.
    """
    if not any(name.startswith("ref_") for name in log.channels):
        return None
    log = log.cut(*held(log))
    log.uniform_dt()
    checked = heard(log)
    log = checked.log.cut(*held(checked.log))
    truth = truth_of(log, checked.bandwidth)
    if truth is None:
        return None
    compared = tuple(c for name in noise.channels if (c := compared_of(log, noise, truth, name)) is not None)
    if not compared:
        return None
    good = truth.good & np.isfinite([log.channels[c.name].values for c in compared]).all(axis=0)
    drive = recorded(log)
    truth = replace(truth, warmth=drive.get("temperature"))
    own = tuple(
        Placed(e, c.name)
        for c in compared
        for e in c.noise
        if isinstance(e, InertialError) or e.coefficients()
    )
    sound = [sound_samples(c, truth) for c in compared]
    compared = tuple(c for c, _, _ in sound)
    said = (*checked.said, *(p for _, ps, _ in sound for p in ps))
    spoilt = (*(p for _, _, ps in sound for p in ps), *rounded(log, compared))
    scene = without_untold(log, MotionScene(truth, compared, good, drive, own, said, spoilt))
    if not any(scene.moving(c) for c in scene.compared):
        return None
    return replace(scene, spoilt=spoilt or _unlike(scene, log, checked.bandwidth))


def _unlike(scene: MotionScene, log: Log, bandwidth: Mapping[str, float]) -> tuple[Placed, ...]:
    """References that have nothing to do with what was read; an attitude says nothing of all forces."""
    given = references(log)
    found: list[Placed] = []
    for sensor in dict.fromkeys(c.sensor for c in scene.compared):
        turned = sensor == "gyro" and sensor not in given
        if sensor not in given and not turned:
            continue
        known = scene.truth.bandwidth.get(sensor, np.inf)
        like = scene.likeness(sensor, scene.truth.read[sensor], known)
        if turned and like.error > MAX_UNEXPLAINED_SHARE:
            wrong = misread(log, bandwidth, like, partial(scene.likeness, sensor))
            found += [Placed(e, sensor) for e in wrong]
        if not like.alike and not found:
            found.append(Placed(OtherMotion(like.correlation), sensor))
    return tuple(found)
