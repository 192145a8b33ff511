"""From a model to a `Log`: a true motion, true sensors, and every effect of every channel.

The sensors are the same ``predict(state)`` expressions that the filter differentiates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.driven.proportional import driver_named
from kfgen.log.log import Channel, Log
from kfgen.manoeuvre.file import manoeuvre as manoeuvre_of
from kfgen.manoeuvre.flight import plant_input, wanted
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.manoeuvre.truth import MotionProfile, along, drawn, numeric, wandered
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.motion import AFTER, AT, BEFORE
from kfgen.model.plant.equations import Equations
from kfgen.model.symbols.blocks import Attitude

Array = NDArray[np.float64]

LONGEST = 10**9
"""Samples of the longest log."""


def simulate(
    discrete: DiscreteModel,
    manoeuvre: str,
    duration: float,
    rng: np.random.Generator,
    drive: Mapping[str, Array] | None = None,
) -> Log:
    """A log of every input and sensor of a model, with the truth as ``ref_`` channels.

    Parameters
    ----------
    discrete : DiscreteModel
        Its `rate` [Hz] is the log's.
    manoeuvre : str
        A library manoeuvre, or the path of a manoeuvre file.
    duration : float
        [s].
    rng : numpy.random.Generator
    drive : mapping of str to ndarray, optional
        Drivers of effects [SI]; a temperature that warms up and swings where left out.

    Raises
    ------
    InputError
        An unknown manoeuvre, or a duration of less than two samples.
    """
    flown = manoeuvre_of(manoeuvre)
    n = round(duration * discrete.rate) if np.isfinite(duration) else 0
    if n > LONGEST:
        raise InputError(f"a duration of {duration:g} s is too long", remedy="Give a shorter --duration")
    if n < 2:
        raise InputError(
            f"a duration of {duration:g} s holds {max(n, 0)} samples", remedy="Give a longer --duration"
        )
    model, t = discrete.model, np.arange(n) / discrete.rate
    if isinstance(model.motion, Equations):
        return _plant_log(discrete, model.motion, flown, t, rng, drive)
    return simulate_motion(discrete, wanted(flown, t), rng, drive, flown.name)


def simulate_motion(
    discrete: DiscreteModel,
    motion: MotionProfile,
    rng: np.random.Generator,
    drive: Mapping[str, Array] | None = None,
    name: str = "own motion",
) -> Log:
    """A log along any motion; parameters as of `simulate`, `name` is said in the log's source."""
    model, t = discrete.model, motion.t
    true = along(model, motion, drawn(model, rng)) | wandered(model, t, rng)
    drive = {d: drive[d] if drive and d in drive else driver_named(d).course(t) for d in model.drivers}
    channels = {d: Channel(v, driver_named(d).unit) for d, v in drive.items()}
    clean = _clean(model, true)
    sampled = model.motion.chosen.get("samples", AFTER)
    clean |= {c: _sampled(clean[c], sampled) for i in model.motion.inputs for c in i.channels}
    for channel, unit in model.channel_units.items():
        values = _measured(clean[channel], model.noise.get(channel, ()), t, rng, drive)
        channels[channel] = Channel(values + _own_noise(discrete, channel, t.size, rng), unit)
    return Log(t, channels | _references(model, true), source=f"simulated {model.name}, {name}")


def _sampled(acting: Array, samples: str) -> Array:
    """The samples of what acts from each time to the next, shape (n,), by what a sample stands for."""
    earlier = np.concatenate([acting[:1], acting[:-1]])
    own = {AFTER: 1.0, AT: 0.5, BEFORE: 0.0}[samples]
    return np.asarray(own * acting + (1.0 - own) * earlier)


def _plant_log(
    discrete: DiscreteModel,
    motion: Equations,
    manoeuvre: Manoeuvre,
    t: Array,
    rng: np.random.Generator,
    drive: Mapping[str, Array] | None,
) -> Log:
    """A log of a model file's plant: its inputs, its measurements, its states as ``ref_`` channels."""
    from kfgen.model.plant.plant import simulate as simulated

    model, user = discrete.model, motion.user
    inputs = {n: plant_input(manoeuvre, n, k, t) for k, n in enumerate(user.inputs)}
    run = simulated(user, t, inputs)
    clean = inputs | {n: h[:, 0] for n, h in run.channels.items()}
    drive = {d: drive[d] if drive and d in drive else driver_named(d).course(t) for d in model.drivers}
    channels = {d: Channel(v, driver_named(d).unit) for d, v in drive.items()}
    for channel, unit in model.channel_units.items():
        values = _measured(clean[channel], model.noise.get(channel, ()), t, rng, drive)
        channels[channel] = Channel(values, unit)
    states = {
        f"ref_{n}": Channel(run.states[:, k, 0], motion.blocks[k].unit) for k, n in enumerate(user.states)
    }
    return Log(t, channels | states, source=f"simulated {model.name}, {manoeuvre.name}")


def _measured(
    clean: Array,
    effects: Sequence[Effect],
    t: Array,
    rng: np.random.Generator,
    drive: Mapping[str, Array],
) -> Array:
    """What a channel shows: noise as effects alter it, added to the truth, all as effects filter it."""
    noise = sum((e.draw(rng).simulate(t, rng, drive) for e in effects), np.zeros(t.size))
    for e in effects:
        noise = noise if e.is_filter else e.apply_to(noise, t, rng, drive)
    values = clean + noise
    for e in effects:
        values = e.apply_to(values, t, rng, drive) if e.is_filter else values
    return np.asarray(values)


def _own_noise(discrete: DiscreteModel, channel: str, n: int, rng: np.random.Generator) -> Array:
    """A sensor's own noise where no effect says otherwise."""
    for sensor in discrete.model.sensors:
        if channel in sensor.channels and discrete.model.white(channel) == (0, 0):
            return sensor.sd * rng.standard_normal(n)
    return np.zeros(n)


def _clean(model: FilterModel, true: Mapping[str, Array]) -> dict[str, Array]:
    """What every channel would read without its effects."""
    channels = [c for i in model.motion.inputs for c in i.channels]
    for c in channels:
        if c not in true:
            raise InputError(
                f"no manoeuvre says what the input '{c}' of {model.name} is",
                remedy="Simulate a model that moves, or gyro-static with a noise file",
            )
    out = {c: true[c] for c in channels}
    n = next(iter(true.values())).size
    for sensor in model.sensors:
        rows = numeric(list(model.clean(sensor)), true)
        out |= {c: np.broadcast_to(row, n) for c, row in zip(sensor.channels, rows)}
    return out


def _references(model: FilterModel, true: Mapping[str, Array]) -> dict[str, Channel]:
    """The true blocks as ``ref_`` channels, the attitude as a quaternion."""
    from scipy.spatial.transform import Rotation

    out: dict[str, Channel] = {}
    for b in model.blocks:
        if isinstance(b, Attitude):
            R = np.stack([true[s.name] for s in b.nominal], axis=1).reshape(-1, 3, 3)
            q = Rotation.from_matrix(R).as_quat(scalar_first=True, canonical=True)
            out |= {f"ref_q_{a}": Channel(q[:, k], "") for k, a in enumerate("wxyz")}
        else:
            out |= {f"ref_{name}": Channel(true[name], b.unit) for name in b.nominal_names}
    return out
