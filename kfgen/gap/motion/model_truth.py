"""What every sensor of a filter's model should have read along the motion that a log's references say.

The same continuous truth as in `kfgen.simulate`: inertial samples are means over the interval that they stand for, other
sensors are predicted by the model, each at its own rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.core.units import parse_unit
from kfgen.effects import make
from kfgen.effects.faults.samples import Fault
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.vibration import vibration_power
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.drivers import recorded
from kfgen.gap.motion.recorded_motion import recorded_motion, recorded_states
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log
from kfgen.manoeuvre.rotations import as_matrix
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.reading import speed_squared
from kfgen.model.parts.sensors import Sensor
from kfgen.simulate.rates import at_every_sample
from kfgen.simulate.scene import Part, TrueScene

Array = NDArray[np.float64]

UNSURE_AT_THE_END_SAMPLES = 2
ANTENNA_ORDERS = {"p": 0, "v": 1}
"""Derivative of the antenna's place that a sensor measures, by the block that it shows."""


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
    own = [Placed(e, w) for w, es in scene.effects.items() for e in es if not isinstance(e, Fault)]
    return ModelTruth(_truth(log, scene, known), _noise(log, discrete, known), tuple(own))


def sensor_of(part: Part) -> str:
    """The beginning that the names of a part's channels share; of one channel its name."""
    if len(part.channels) == 1:
        return part.channels[0]
    return part.channels[0].rpartition("_")[0]


@dataclass(frozen=True)
class ShouldRead:
    """What the sensors of a filter should have read, as `Truth` takes it; see there for each field."""

    read: Mapping[str, Array]
    axes: Mapping[str, tuple[int, ...]]
    places: Mapping[str, tuple[str, int]]
    antennas: Mapping[str, tuple[int, Array]]


def should_read(parts: Sequence[tuple[Part, Array]], R_bn: Array) -> ShouldRead:
    """Channels as axes of sensors.

    Parameters
    ----------
    parts : sequence of (Input or Sensor, ndarray of shape (n, channels))
        With what each should have read [SI].
    R_bn : ndarray, shape (n, 3, 3)
        The model's navigation axes to body axes.
    """
    read: dict[str, Array] = {}
    axes: dict[str, tuple[int, ...]] = {}
    places: dict[str, tuple[str, int]] = {}
    antennas: dict[str, tuple[int, Array]] = {}
    for part, y in parts:
        sensor = sensor_of(part)
        at = [AXES.index(c[-1]) if c[-1] in AXES and "_" in c else k for k, c in enumerate(part.channels)]
        read.setdefault(sensor, np.zeros((y.shape[0], 3)))[:, at] = y
        axes[sensor] = (*axes.get(sensor, ()), *at)
        places |= {c: (sensor, k) for c, k in zip(part.channels, at)}
        if isinstance(part, Sensor) and part.shows in ANTENNA_ORDERS:
            antennas[sensor] = (ANTENNA_ORDERS[part.shows], R_bn)
    return ShouldRead(read, axes, places, antennas)


def _truth(log: Log, scene: TrueScene, parts: Sequence[Part]) -> Truth:
    R_bn = np.swapaxes(as_matrix(scene.path.q[scene.path.places(scene.t)]), 1, 2)
    pairs = [(part, scene.clean(part)) for part in parts]
    should, first = should_read(pairs, R_bn), scene.signals(*pairs[0])
    known = np.ones(log.n, dtype=bool)
    known[-UNSURE_AT_THE_END_SAMPLES:] = False  # what a sample's interval holds there is extrapolated
    warmth = scene.drive.get("temperature")
    return Truth(
        np.asarray(log.t), should.read, should.axes, known,
        omega_b=first.omega_b, f_b=first.f_b, power=_power(log, first), warmth=warmth, R_bn=first.R_bn,
        places=should.places, antennas=should.antennas, speed_squared=speed_squared(scene.model, scene.instants),
        words=("the references and the model say what every sensor should have read",),
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
