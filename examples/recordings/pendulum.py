"""A pendulum on a motor, swung up and held: dry friction of its joint, against a model without friction.

Recording: DFKI Robotics Innovation Center, torque_limited_simple_pendulum (BSD-3-Clause). Mass and length are those that
its authors publish, 0.6755 kg and 0.5 m; their own model has dry friction.
"""

from pathlib import Path

import numpy as np
from common import Case, main, of_log

from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model

MODEL = """
format = "kfgen-model-1"
name = "pendulum"
[parameters]
J = { value = "0.169 kg m^2", sd = "0.02 kg m^2" }
mgl = { value = "3.313 N m", sd = "0.3 N m" }
[states]
q = "rad"
w = "rad/s"
[inputs]
torque = "N m"
[dynamics]
q = "w"
w = "(torque - mgl*sin(q))/J"
[measurements.angle]
unit = "rad"
expression = "q"
effects = [ { effect = "white_noise", N = "5e-5 rad/sqrt(Hz)" } ]
[measurements.speed]
unit = "rad/s"
expression = "w"
effects = [ { effect = "white_noise", N = "0.0025 rad/s/sqrt(Hz)" } ]
"""


def swing_up(file: Path) -> Case:
    """The gap of one swing-up."""
    with np.load(file) as archive:
        t, angle, speed, torque = archive["ddp"].T
    channels = {
        "angle": Channel.of(angle, "rad"),
        "speed": Channel.of(speed, "rad/s"),
        "torque": Channel.of(torque, "N m"),
    }
    return of_log(Log(t - t[0], channels, source=file.name), parse_model(MODEL, "pendulum.toml"))


if __name__ == "__main__":
    main(str(__doc__), {"swing_up": ("systems/dfki_simple_pendulum.npz", swing_up)})
