"""The library models, by name, and how a noise file meets them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from kfgen.effects import Effect, make
from kfgen.errors import InputError
from kfgen.model.autopilot import Airspeed, FieldVector, StrapdownInWind
from kfgen.model.filter import FilterModel
from kfgen.model.motion import Motion, Rest, Rotating, Strapdown
from kfgen.model.sensors import AtRest, GnssPosition, GnssVelocity, GravityDirection, MagneticField
from kfgen.noise import NoiseModel, canonical
from kfgen.units import parse_unit

TURN_ON = {"rad/s": 0.2, "m/s^2": 20.0, "T": 1e-4}
"""How far off a channel at rest may be [SI], by its unit: a gyro's turn-on bias, gravity, the field."""
BEYOND = 1e3
"""The same for other units, in sizes of the channel's noise."""


@dataclass(frozen=True)
class Entry:
    """A library model: what it is for, and how it is built for a noise model."""

    title: str
    build: Callable[[str, str, NoiseModel | None], FilterModel]


def _with_inputs(motion: Motion, noise: NoiseModel | None) -> dict[str, tuple[Effect, ...]]:
    """White noise and a constant bias on every input, the noise file's effects where it has them."""
    effects: dict[str, tuple[Effect, ...]] = {}
    for triad in motion.inputs:
        for channel in triad.channels:
            known = noise.channels[channel].effects if noise and channel in noise.channels else ()
            effects[channel] = (
                *(known or (make("white_noise", N=triad.N),)),
                make("bias", sd=triad.bias_prior),
            )
    return effects


def _moving(motion: Motion, *sensors: type) -> Callable[[str, str, NoiseModel | None], FilterModel]:
    def build(name: str, title: str, noise: NoiseModel | None) -> FilterModel:
        model = FilterModel(name, title, motion, tuple(s() for s in sensors), _with_inputs(motion, noise))
        for channel, found in (noise.channels if noise else {}).items():
            if channel in model.channel_units and channel not in model.noise:
                model = replace(model, noise={**model.noise, channel: found.effects})
        _check_units(model, noise)
        return model

    return build


def _check_units(model: FilterModel, noise: NoiseModel | None) -> None:
    for channel, unit in model.channel_units.items():
        if noise and channel in noise.channels:
            given = noise.channels[channel].unit
            if not parse_unit(given).same_dimension(parse_unit(unit)):
                raise InputError(
                    f"channel {channel} is in {given} in the noise file, {model.name} needs {unit}"
                )


def _one_axis(name: str, title: str, noise: NoiseModel | None) -> FilterModel:
    """One channel at rest: the first gyro channel of the noise file, or its first channel."""
    if noise is None:
        effects: tuple[Effect, ...] = (
            make("white_noise", N=1.5e-4),
            make("gauss_markov", sigma=3e-5, tau=300.0),
        )
        channel, unit = "gyro_x", "rad/s"
    else:
        channel = next((c for c in noise.channels if c.startswith("gyro")), next(iter(noise.channels)))
        effects = noise.channels[channel].effects
        unit = noise.channels[channel].unit
    si = parse_unit(unit).si
    bias = make("bias", sd=_turn_on(si, effects))
    return FilterModel(
        name, title, Rest(), (AtRest(channel, si),), {channel: (*effects, bias)}, {channel: unit}
    )


def _turn_on(unit: str, effects: tuple[Effect, ...]) -> float:
    """Deviation of the unknown constant of a channel before the first sample [SI]."""
    sizes = [abs(float(getattr(e, p.name))) for e in effects for p in e.estimated() if p.kind == "size"]
    return TURN_ON.get(unit, BEYOND * max(sizes, default=1.0))


LIBRARY: dict[str, Entry] = {
    "gyro-static": Entry("one sensor axis at rest: the sum of its identified effects", _one_axis),
    "ahrs6": Entry(
        "attitude and gyro bias from gyros, gravity and magnetic field",
        _moving(Rotating(), GravityDirection, MagneticField),
    ),
    "ins15": Entry(
        "position, velocity, attitude, accelerometer and gyro bias, with GNSS",
        _moving(Strapdown(), GnssPosition, GnssVelocity),
    ),
    "ins23": Entry(
        "the states of a small autopilot: ins15 with the magnetic field of Earth and body, and wind",
        _moving(StrapdownInWind(), GnssPosition, GnssVelocity, FieldVector, Airspeed),
    ),
}


def build(name: str, noise: NoiseModel | None = None) -> FilterModel:
    """A library model, or a model file, with the effects of a noise model attached.

    Parameters
    ----------
    name : str
        A key of `LIBRARY`, or the path of a model file (``.toml``).
    noise : NoiseModel, optional
        Without it, typical MEMS figures.

    Raises
    ------
    InputError
        No such model, or a channel of another dimension.
    """
    if name.endswith(".toml"):
        from kfgen.model.equations import filter_model
        from kfgen.model.user import read_model

        return filter_model(read_model(name), canonical(noise) if noise else None)
    if name not in LIBRARY:
        raise InputError(
            f"there is no model '{name}'", remedy=f"Known are {', '.join(LIBRARY)}, or a model file (.toml)"
        )
    entry = LIBRARY[name]
    return entry.build(name, entry.title, canonical(noise) if noise else None)
