"""The motion world of a filter: its sensors against what its model says that they should have read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kfgen.effects.noise_model import NoiseModel
from kfgen.gap.core.drivers import recorded
from kfgen.gap.motion.compared_channel import compared_of, sound_samples
from kfgen.gap.motion.model_truth import model_truth
from kfgen.gap.motion.scene import MotionScene
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel


def filter_scene(
    log: Log, model: FilterModel, names: Sequence[str] | None = None
) -> tuple[MotionScene, NoiseModel] | None:
    """The scene of a log and a filter, and the noise that it assumes.

    Parameters
    ----------
    log : Log
        With the model's states as references.
    model : FilterModel
    names : sequence of str, optional
        The channels to compare; all where left out.

    Returns
    -------
    (MotionScene, NoiseModel) or None
        None where the references do not say all that moves, or not finely enough, or nothing moves.

    Raises
    ------
    InputError
        A channel's unit does not meet its sensor's.
    """
    if "ref_q_w" not in log.channels or not np.allclose(np.diff(log.t), log.dt, rtol=1e-3):
        return None
    found = model_truth(log, model)
    if found is None:
        return None
    truth, noise = found.truth, found.noise.in_record(log.dt, log.duration)
    pairs = [(name, compared_of(log, noise, truth, name)) for name in names or noise.channels]
    free = {
        c for w, es in model.noise.items() if any(e.name == "bias" for e in es) for c in model.channels_of(w)
    }
    seen = [replace(c, biased=c.biased or c.name in free) for _, c in pairs if c is not None]
    sound = [sound_samples(c, truth) for c in seen]
    compared = tuple(c for c, _, _ in sound)
    said = tuple(p for _, ps, _ in sound for p in ps)
    spoilt = tuple(p for _, _, ps in sound for p in ps)
    scene = MotionScene(truth, compared, truth.good, recorded(log), found.own, said, spoilt)
    return (scene, noise) if any(scene.moving(c) for c in compared) else None
