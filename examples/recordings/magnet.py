"""A magnetometer that moves, against an optical attitude; for a minute a magnet sits on its board, or none does.

Recordings: D. Laidig et al., BROAD, Data 6(7):72, 2021 (CC BY 4.0). The dataset's own fit of the undisturbed field
over the minute has (-2.9, -0.5, 26.8) uT of trial 33 and (0.1, -0.2, -6.1) uT of trial 36.
"""

from pathlib import Path

import numpy as np
from common import AXES, DATA, Case, identified, main, of_scene, thinned

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.log.readers import read_log

EVERY = 8
QUIET = DATA / "dynamic" / "broad_01_undisturbed_slow_rotation_A.npz"


def undisturbed() -> NoiseModel:
    """Noise of a magnetometer that moves in a real room: what trial 1 leaves after its delay."""
    log = thinned(read_log(QUIET), EVERY)
    first = {f"mag_{a}": ChannelNoise("uT", (Term(make("white_noise", N=1e-7)),)) for a in AXES}
    scene = motion_scene(log, NoiseModel(first))
    assert scene is not None
    start = np.array([u.start for u in scene.unknowns])
    left = scene.left(ScenePoint((Placed(make("time_delay", delay=0.015), "mag"),), start))
    names = [c.name for c in scene.compared]
    return NoiseModel({n: identified("uT", scene.truth.t, np.asarray(x)) for n, x in zip(names, left)})


def magnet(file: Path) -> Case:
    """The field in space and a constant bias are fitted beside; an effect of a minute has a span."""
    log = thinned(read_log(file), EVERY)
    _, said, answer = of_scene(log, motion_scene(log, undisturbed()))
    return said, answer


if __name__ == "__main__":
    files = {
        "magnet-33": "33_disturbed_attached_magnet_2cm",
        "magnet-36": "36_disturbed_attached_magnet_5cm",
        "no-magnet-01": "01_undisturbed_slow_rotation_A",
        "no-magnet-06": "06_undisturbed_fast_rotation_A",
    }
    main(str(__doc__), {k: (f"dynamic/broad_{f}.npz", magnet) for k, f in files.items()})
