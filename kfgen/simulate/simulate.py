"""From a model to a `Log`: a true motion in continuous time, true sensors at their own rates, and every effect of every channel.

The sensors are the same ``predict(state)`` expressions that the filter differentiates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.driven.proportional import DRIVERS, driver_named
from kfgen.effects.faults.reference import ReferenceFault
from kfgen.log.log import Channel, Log
from kfgen.manoeuvre.file import manoeuvre as manoeuvre_of
from kfgen.manoeuvre.flight import ManoeuvreMotion, plant_input
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.manoeuvre.motion import Motion
from kfgen.manoeuvre.random_truth import drawn, noise_driven
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.reading import axes_of
from kfgen.model.plant.equations import Equations
from kfgen.model.symbols.blocks import Attitude
from kfgen.simulate.channels import moved_alone, shown, with_noise
from kfgen.simulate.faults import RATE, faulty, stamped
from kfgen.simulate.rates import sensor_rates
from kfgen.simulate.scene import ACCELS, Part, TrueScene
from kfgen.simulate.vibration import Vibration

Array = NDArray[np.float64]

VIBRATION = "vibration"
"""The driver of rectification: what shakes the accelerometers."""
WARMTH = "temperature"
"""The driver that effects of a warm sensor follow."""
MAX_SAMPLES = 10**8
"""Of the longest log [1]."""


def simulate(  # noqa: PLR0913 - what a user may choose
    discrete: DiscreteModel,
    manoeuvre: str,
    duration: float,
    rng: np.random.Generator,
    drive: Mapping[str, Array] | None = None,
    *,
    rates: Mapping[str, float] | None = None,
    decoys: Sequence[str] = (),
    vibration: float = 0.0,
) -> Log:
    """A log of every input and sensor of a model, with the truth as ``ref_`` channels.

    Parameters
    ----------
    discrete : DiscreteModel
        Its `rate` [Hz] is the log's and that of the inputs.
    manoeuvre : str
        A library manoeuvre, or the path of a manoeuvre file.
    duration : float
        [s].
    rng : numpy.random.Generator
    drive : mapping of str to ndarray, optional
        Drivers of effects [SI]; a temperature that warms up and swings where left out.
    rates : mapping of str to float, optional
        Of sensors, by name or by the beginning of their channels [Hz]; between its samples a channel has no number.
    decoys : sequence of str
        Drivers that are logged though nothing depends on them.
    vibration : float
        Standard deviation of an acceleration that comes and goes on every axis [m/s^2].

    Raises
    ------
    InputError
        An unknown manoeuvre, sensor or driver, a rate above the log's, or a duration of less than two samples.
    """
    _refuse_faults_of_references(discrete.model)
    flown = manoeuvre_of(manoeuvre)
    n = round(duration * discrete.rate) if np.isfinite(duration) else 0
    if n > MAX_SAMPLES:
        raise InputError(f"a duration of {duration:g} s is too long", remedy="Give a shorter --duration")
    if n < 2:
        raise InputError(
            f"a duration of {duration:g} s holds {max(n, 0)} samples", remedy="Give a longer --duration"
        )
    t = np.arange(n) / discrete.rate
    if isinstance(discrete.model.motion, Equations):
        driven = drivers_over(discrete.model, t, drive, decoys)
        return _plant_log(discrete, discrete.model.motion, flown, t, rng, driven)
    shaken = _shaken(discrete, vibration, n / discrete.rate, rng)
    moves = "v" in {b.name for b in discrete.model.blocks}
    motion = ManoeuvreMotion(flown, t, n / discrete.rate, shaken if moves else None)
    return simulate_motion(
        discrete, motion, rng, drive, flown.name, rates=rates, decoys=decoys, shaken=None if moves else shaken
    )


def simulate_motion(  # noqa: PLR0913 - what a user may choose
    discrete: DiscreteModel,
    motion: Motion,
    rng: np.random.Generator,
    drive: Mapping[str, Array] | None = None,
    name: str = "own motion",
    *,
    rates: Mapping[str, float] | None = None,
    decoys: Sequence[str] = (),
    shaken: Vibration | None = None,
) -> Log:
    """A log along any motion.

    Parameters
    ----------
    discrete, rng, drive, rates, decoys
        As of `simulate`.
    motion : Motion
        Its times are the log's.
    name : str
        Said in the log's source.
    shaken : Vibration, optional
        That the accelerometers of a model without a velocity show.
    """
    model, t = discrete.model, motion.t
    found = sensor_rates(discrete, rates)
    constants = drawn(model, rng)
    driven = drivers_over(model, t, drive, decoys)
    scene = TrueScene(discrete, motion, constants, noise_driven(model, t, rng), found, driven, shaken)
    if VIBRATION in driven and VIBRATION not in (drive or {}) and scene.vibration is not None:
        driven[VIBRATION] = scene.vibration
    channels = {d: Channel(v, driver_named(d).unit) for d, v in driven.items()}
    parts: tuple[Part, ...] = (*model.motion.inputs, *model.sensors)
    for part in parts:
        channels |= {c: Channel(v, part.unit) for c, v in shown(scene, part, rng).items()}
    channels |= references(model, scene.instants, scene)
    inputs = [c for i in model.motion.inputs for c in i.channels]
    said = scene.samples if inputs else ""
    return _stamped(
        Log(t, channels, source=f"simulated {model.name}, {name}", samples=said), model, inputs, rng
    )


def _refuse_faults_of_references(model: FilterModel) -> None:
    for where, effects in model.noise.items():
        for e in effects:
            if isinstance(e, ReferenceFault):
                raise InputError(
                    f"{e.name} of {where} is a fault of a reference, and the reference of a simulation is its truth",
                    remedy=f"Take {e.name} out of the noise of {where}",
                )


def _shaken(
    discrete: DiscreteModel, amplitude: float, duration: float, rng: np.random.Generator
) -> Vibration | None:
    """The vibration that is asked for."""
    if amplitude == 0.0:
        return None
    if not 0.0 < amplitude < np.inf:
        raise InputError(
            f"a vibration of {amplitude:g} m/s^2 is none",
            where="--vibration",
            remedy="Give a positive acceleration",
        )
    if not any(c.startswith(("accel_", "gyro_")) for c in discrete.model.channel_units):
        raise InputError(
            f"{discrete.model.name} has neither accelerometers nor gyros to shake",
            where="--vibration",
            remedy=f"Simulate a model with {ACCELS[0]}, or leave it out",
        )
    return Vibration.drawn(amplitude, discrete.rate, duration, rng)


def drivers_over(
    model: FilterModel, t: Array, given: Mapping[str, Array] | None, decoys: Sequence[str]
) -> dict[str, Array]:
    """Every driver of the model and every decoy over time [SI]."""
    for name in decoys:
        if name not in DRIVERS:
            raise InputError(
                f"there is no driver '{name}'", where="--decoy", remedy=f"Known are {', '.join(DRIVERS)}"
            )
    every = [e for es in model.noise.values() for e in es]
    felt = [WARMTH for e in every if "warmth" in getattr(e, "needs", ())]
    felt += [e.driver for e in every if e.driver]
    names = dict.fromkeys([*model.drivers, *felt, *(given or {}), *decoys])
    return {d: given[d] if given and d in given else driver_named(d).course(t) for d in names}


def _stamped(log: Log, model: FilterModel, inputs: Sequence[str], rng: np.random.Generator) -> Log:
    """With the time stamps that the log says, without the rows that an input has lost.

    Where its times are wrong in rate, its header says how long it lasted.
    """
    effects = [e for es in model.noise.values() for e in es]
    there = np.ones(log.n, dtype=bool)
    for c in inputs:
        there &= np.isfinite(log.channels[c].values)
    t = stamped(log.t, effects, rng)[there]
    channels = {n: Channel(c.values[there], c.unit) for n, c in log.channels.items()}
    stated = log.n * log.dt if any(e.name == RATE for e in effects) else 0.0
    return Log(t, channels, source=log.source, stated=stated, samples=log.samples)


def _plant_log(
    discrete: DiscreteModel,
    motion: Equations,
    manoeuvre: Manoeuvre,
    t: Array,
    rng: np.random.Generator,
    driven: Mapping[str, Array],
) -> Log:
    """A log of a model file's plant: its inputs, its measurements, its states as ``ref_`` channels."""
    from kfgen.model.plant.drawn_process_noise import with_drawn_process_noise
    from kfgen.model.plant.plant import simulate as simulated

    model, user = discrete.model, motion.user
    inputs = {n: plant_input(manoeuvre, n, k, t) for k, n in enumerate(user.inputs)}
    noisy, noises = with_drawn_process_noise(user, t, rng)
    run = simulated(noisy, t, inputs | noises)
    clean = inputs | {n: h[:, 0] for n, h in run.channels.items()}
    channels = {d: Channel(v, driver_named(d).unit) for d, v in driven.items()}
    for channel, unit in model.channel_units.items():
        effects: Sequence[Effect] = model.noise.get(channel, ())
        true = moved_alone(clean[channel], effects, t, driven.get(WARMTH), *axes_of((channel,)))
        noise: Any = sum((e.draw(rng).simulate(t, rng, driven) for e in effects), np.zeros(t.size))
        values = with_noise(true, noise, effects, t, rng, driven)
        channels[channel] = Channel(faulty([values], [effects], t, rng)[0], unit)
    states = {
        f"ref_{n}": Channel(run.states[:, k, 0], motion.blocks[k].unit) for k, n in enumerate(user.states)
    }
    log = Log(t, channels | states, source=f"simulated {model.name}, {manoeuvre.name}")
    return _stamped(log, model, list(user.inputs), rng)


def references(model: FilterModel, true: Mapping[str, Array], scene: TrueScene) -> dict[str, Channel]:
    """The true blocks as ``ref_`` channels, the attitude as a quaternion."""
    out: dict[str, Channel] = {}
    for b in model.blocks:
        if isinstance(b, Attitude):
            q = scene.path.q[scene.path.places(scene.t)]
            q = np.where(q[:, :1] < 0.0, -q, q)
            out |= {f"ref_q_{a}": Channel(q[:, k], "") for k, a in enumerate("wxyz")}
        else:
            out |= {f"ref_{name}": Channel(true[name], b.unit) for name in b.nominal_names}
    return out
