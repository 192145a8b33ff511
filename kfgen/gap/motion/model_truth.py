"""What every sensor of a filter's model should have read along the motion that a log's references say.

The same continuous truth as in `kfgen.simulate`: inertial samples are means over the interval that they stand for, other
sensors are predicted by the model, each at its own rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.units import parse_unit
from kfgen.effects import Effect, make
from kfgen.effects.faults.samples import Fault
from kfgen.effects.inertial.errors import LeverArm
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.inertial_error import AXES
from kfgen.effects.inertial.vibration import vibration_power
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.scene import Placed
from kfgen.gap.motion.recorded_motion import recorded_motion, recorded_states
from kfgen.gap.motion.truth import Truth
from kfgen.gap.rest.even_record import recorded
from kfgen.log.log import Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.sensors import Sensor
from kfgen.simulate.channels import channel_effects
from kfgen.simulate.rates import at_every_sample
from kfgen.simulate.scene import Part, TrueScene

Array = NDArray[np.float64]

UNSURE_AT_THE_END_SAMPLES = 2


@dataclass(frozen=True)
class ModelTruth:
    """The truth of a log by a filter's model.

    Parameters
    ----------
    truth : Truth
    noise : NoiseModel
        Of every sensor, in the log's units.
    own : tuple of Placed
        The errors of readings that the model has.
    """

    truth: Truth
    noise: NoiseModel
    own: tuple[Placed, ...]


def model_truth(log: Log, model: FilterModel) -> ModelTruth | None:
    """The truth of a log; None where its references do not say all that moves, or not finely enough.

    Parameters
    ----------
    log : Log
        Of even time.
    model : FilterModel
    """
    motion = recorded_motion(log, model)
    if motion is None:
        return None
    discrete = DiscreteModel.at_rate(model, 1.0 / log.dt)
    states = recorded_states(log, model)
    constants = {n: float(v[0]) for n, v in states.items()}
    moving = {n for b in model.noise_driven_blocks[0] for n in b.nominal_names}
    wander = {n: v for n, v in states.items() if n in moving}
    drive = recorded(log)
    rates = at_every_sample(discrete)
    scene = TrueScene(discrete, motion, constants, wander, rates, drive, samples_are=log.samples)
    parts: tuple[Part, ...] = (*model.motion.inputs, *model.sensors)
    known = [p for p in parts if any(c in log.channels for c in p.channels)]
    if not known:
        return None
    own = [
        Placed(e, w)
        for w, es in scene.effects.items()
        for e in es
        if not isinstance(e, Fault) and not _is_antenna(model, w, e)
    ]
    return ModelTruth(_truth(log, scene, known), _noise(log, discrete, known), tuple(own))


def _is_antenna(model: FilterModel, where: str, effect: Effect) -> bool:
    """Whether an effect is the place of an antenna: the truth is there already."""
    parts = [
        s for s in model.sensors if s.shows in ("p", "v") and set(s.channels) & set(model.channels_of(where))
    ]
    return isinstance(effect, LeverArm) and bool(parts)


def _read(scene: TrueScene, part: Part) -> Array:
    """What a part should read, shape (n, channels), at its antenna where it has one."""
    effects = [e for es in channel_effects(scene.effects, part)[:1] for e in es]
    arms = [np.array([e.x, e.y, e.z], dtype=np.float64) for e in effects if isinstance(e, LeverArm)]
    if isinstance(part, Sensor) and part.shows in ("p", "v") and arms:
        return scene.sensed(part, scene.t, np.sum(arms, axis=0))
    return scene.clean(part)


def _sensor(part: Part) -> str:
    """The beginning that the names of a part's channels share; of one channel its name."""
    if len(part.channels) == 1:
        return part.channels[0]
    return part.channels[0].rpartition("_")[0]


def _truth(log: Log, scene: TrueScene, parts: Sequence[Part]) -> Truth:
    read: dict[str, Array] = {}
    axes: dict[str, tuple[int, ...]] = {}
    places: dict[str, tuple[str, int]] = {}
    felt: list[Signals] = []
    for part in parts:
        y, sensor = _read(scene, part), _sensor(part)
        felt.append(scene.signals(part, y))
        at = [AXES.index(c[-1]) if c[-1] in AXES and "_" in c else k for k, c in enumerate(part.channels)]
        read.setdefault(sensor, np.zeros((log.n, 3)))
        read[sensor][:, at] = y
        axes[sensor] = (*axes.get(sensor, ()), *at)
        places |= {c: (sensor, k) for c, k in zip(part.channels, at)}
    first = felt[0]
    known = np.ones(log.n, dtype=bool)
    known[-UNSURE_AT_THE_END_SAMPLES:] = False  # what a sample's interval holds there is extrapolated
    warmth = scene.drive.get("temperature")
    return Truth(
        np.asarray(log.t), read, axes, known,
        omega_b=first.omega_b, f_b=first.f_b, power=_power(log, first), warmth=warmth, R_bn=first.R_bn,
        places=places, words=("the references and the model say what every sensor should have read",),
    )  # fmt: skip


def _power(log: Log, felt: Signals) -> Array | None:
    """Of the vibration that the accelerometers show, else of the true one."""
    names = [f"accel_{a}" for a in AXES]
    if all(n in log.channels and np.isfinite(log.channels[n].values).all() for n in names):
        return vibration_power(np.column_stack([log.channels[n].values for n in names]), log.dt)
    return felt.power


def _noise(log: Log, discrete: DiscreteModel, parts: Sequence[Part]) -> NoiseModel:
    """The noise of every channel: its effects, white noise of its sensor's size where it has none of its own."""
    model, out = discrete.model, {}
    for part in parts:
        for c in (c for c in part.channels if c in log.channels):
            effects = list(model.noise.get(c, ()))
            white = model.white(c) != (0, 0) or part in model.motion.inputs
            if not white or model.is_sampled(c):
                sd = float(np.sqrt(discrete.sample_variance(part, c)))  # type: ignore[arg-type]
                effects = [
                    *(e for e in effects if e.name not in ("white_noise", "sample_noise")),
                    make("sample_noise", sd=sd),
                ]
            terms = tuple(Term(e) for e in effects if e.name != "bias")
            unit = parse_unit(log.channels[c].unit).si
            out[c] = ChannelNoise(unit, terms)
    return NoiseModel(out)
