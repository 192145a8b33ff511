"""What a model's sensors should read along a motion: a log without any noise, its biases as the model starts them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kfgen.effects.driven.proportional import driver_named
from kfgen.log.log import Channel, Log
from kfgen.manoeuvre.motion import Motion
from kfgen.model.discretise import DiscreteModel
from kfgen.simulate.channels import channel_effects, moved
from kfgen.simulate.rates import sensor_rates
from kfgen.simulate.scene import Part, TrueScene
from kfgen.simulate.simulate import drivers_over, references


def expected_log(discrete: DiscreteModel, motion: Motion, name: str, decoys: Sequence[str] = ()) -> Log:
    """The log that is to be expected of a motion.

    Parameters
    ----------
    discrete : DiscreteModel
        Of a model that moves; its `rate` [Hz] is the log's and that of the inputs.
    motion : Motion
        Its times are the log's.
    name : str
        Said in the log's source.
    decoys : sequence of str
        Drivers that are logged though the model depends on none of them.

    Raises
    ------
    InputError
        No such driver.
    """
    model, t = discrete.model, motion.t
    still = {
        n: np.full(t.size, x) for b in model.noise_driven_blocks[0] for n, x in zip(b.nominal_names, b.start)
    }
    driven = drivers_over(model, t, None, decoys)
    scene = TrueScene(discrete, motion, {}, still, sensor_rates(discrete), driven)
    channels = {d: Channel(v, driver_named(d).unit) for d, v in driven.items()}
    parts: tuple[Part, ...] = (*model.motion.inputs, *model.sensors)
    for part in parts:
        values = moved(scene, part, channel_effects(scene.effects, part))
        for k, c in enumerate(part.channels):
            course = np.full(t.size, np.nan)
            course[scene.rows(part)] = values[:, k]
            channels[c] = Channel(course, part.unit)
    channels |= references(model, scene.instants, scene)
    return Log(t, channels, source=f"expected of {model.name}, {name}", samples=scene.samples)
