"""The library models, by name, and how options and a noise file meet them.

A model is a motion with some sensors and its own defaults of their options; to add one, add an entry.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from kfgen.core.channel_names import some_of
from kfgen.core.errors import InputError
from kfgen.core.units import parse_quantity, parse_unit
from kfgen.effects import Effect, make
from kfgen.effects.noise_model import NoiseModel, Term, canonical
from kfgen.model.attach import Omission
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import HEADING, FilterFile, is_filter_file, read_filter
from kfgen.model.option import NOTHING, Choice, Names, Option, read_options
from kfgen.model.parts.earth_fixed import FRAMES
from kfgen.model.parts.hemerly import hemerly
from kfgen.model.parts.motion import GYRO, AtRestMotion, MotionModel, Rotating
from kfgen.model.parts.sensors import AtRest, Sensor, sensors
from kfgen.model.parts.usual_noise import BIASES, NONE, with_usual_noise

TURN_ON = {"rad/s": 0.2, "m/s^2": 20.0, "T": 1e-4}
"""How far off a channel at rest may be [SI], by its unit: a gyro's turn-on bias, gravity, the field."""
BEYOND = 1e3
"""The same for other units, in sizes of the channel's noise."""


class Entry:
    """A library model: what it is for, what may be chosen, and how it is built for a noise model."""

    title: str

    def options(self, texts: Mapping[str, str] = NOTHING) -> tuple[Option, ...]:
        """The options that it has once those of `texts` are chosen; raises `InputError`."""
        return ()

    def variants(self) -> list[dict[str, str]]:
        """Choices that change which options there are."""
        return [{}]

    def build(self, name: str, noise: NoiseModel | None, texts: Mapping[str, str]) -> FilterModel:
        """The model; raises `InputError`."""
        raise NotImplementedError


@dataclass(frozen=True)
class Moving(Entry):
    """A motion with sensors.

    Parameters
    ----------
    title : str
    motions : mapping of str to type of Motion
        By navigation frame; the first is the default.
    aiding : tuple of str
        Its own sensors.
    defaults : mapping of str to str
        Where its options differ from what they declare.
    """

    title: str
    motions: Mapping[str, type[MotionModel]]
    aiding: tuple[str, ...]
    defaults: Mapping[str, str] = field(default_factory=dict)

    def _composition(self) -> tuple[Option, ...]:
        """The options that say which motion and which sensors."""
        offered = Names(tuple(n for n in sensors() if n != AtRest.name))
        frames = tuple(self.motions)
        frame = Option("frame", "navigation frame", Choice(frames), frames[0])
        aiding = Option("sensors", "what it is aided by", offered, ",".join(self.aiding))
        return (*((frame,) if len(frames) > 1 else ()), aiding)

    def _parts(self, texts: Mapping[str, str]) -> tuple[type[MotionModel], list[type[Sensor]]]:
        by_name = {o.name: o for o in self._composition()}
        frame = (
            by_name["frame"].read(texts.get("frame", next(iter(self.motions)))) if "frame" in by_name else ""
        )
        names = by_name["sensors"].read(texts.get("sensors", by_name["sensors"].default))
        motion = self.motions[frame] if frame else next(iter(self.motions.values()))
        return motion, [sensors()[n] for n in names]

    def variants(self) -> list[dict[str, str]]:
        """Its frames."""
        return [{"frame": f} for f in self.motions] if len(self.motions) > 1 else [{}]

    def options(self, texts: Mapping[str, str] = NOTHING) -> tuple[Option, ...]:
        """Of its composition, its motion and its sensors, each once."""
        motion, aiding = self._parts(texts)
        declared = [*self._composition(), BIASES, *motion.options, *(o for s in aiding for o in s.options)]
        known = {o.name: o for o in declared}
        return tuple(replace(o, default=self.defaults.get(o.name, o.default)) for o in known.values())

    def build(self, name: str, noise: NoiseModel | None, texts: Mapping[str, str]) -> FilterModel:
        """The motion with the sensors that are chosen."""
        options = self.options(texts)
        chosen = {o.name: o.read(o.default) for o in options} | read_options(options, texts, name)
        motion_type, aiding = self._parts(texts)
        motion = motion_type(chosen)
        used = tuple(s(chosen, motion.axes) for s in aiding)
        terms = with_usual_noise(motion, used, noise, chosen[BIASES.name])
        model = FilterModel(
            name,
            self.title,
            motion,
            used,
            {c: tuple(t.effect for t in ts) for c, ts in terms.items()},
            options=dict(texts),
            uses={c: tuple(t.use for t in ts) for c, ts in terms.items()},
        )
        _check_units(model, noise)
        _check_start(model)
        return model


def _check_start(model: FilterModel) -> None:
    """No state that is exactly known at the start and that nothing ever moves: P would be singular for ever."""
    A, W = model.effect_dynamics
    first = len(model.states) - A.rows
    for k, s in enumerate(model.states[first:]):
        if s.prior == 0.0 and not any(A[k, :]) and not any(W[k, :]):
            raise InputError(
                f"the state {s.name} is exactly known at the start and nothing moves it, so P is singular",
                where=f"{model.name}: {s.title}",
                remedy="Give its effect a standard deviation (sd of a bias), or leave it out",
            )


def _check_units(model: FilterModel, noise: NoiseModel | None) -> None:
    if noise and not any(model.channels_of(c) for c in noise.channels):
        raise InputError(
            f"the noise file has no channel of {model.name}",
            where="--noise",
            remedy=f"It has {some_of(noise.channels)}, the model {', '.join(model.channel_units)}",
        )
    for place, given in ((p, n.unit) for p, n in (noise.channels if noise else {}).items()):
        units = [model.channel_units[c] for c in model.channels_of(place)]
        if units and not all(u == units[0] for u in units):
            continue  # a sensor of several quantities: its effects have units of their own
        for unit in units[:1]:
            if not parse_unit(given).same_dimension(parse_unit(unit)):
                raise InputError(
                    f"channel {place} is in {given} in the noise file, {model.name} needs {unit}"
                )


@dataclass(frozen=True)
class Resting(Entry):
    """Channels at rest, each the sum of its effects.

    Parameters
    ----------
    title : str
    usual : mapping of str to (unit, effects)
        The channels without a noise file; with one, those that it has.
    every : bool
        All channels of the noise file, or the first gyro channel (the first channel where there is none).
    """

    title: str
    usual: Mapping[str, tuple[str, tuple[Effect, ...]]]
    every: bool

    def build(self, name: str, noise: NoiseModel | None, texts: Mapping[str, str]) -> FilterModel:
        """The channels' effects and nothing else."""
        read_options((), texts, name)
        usual = {c: (u, tuple(map(Term, es))) for c, (u, es) in self.usual.items()}
        found = {c: (n.unit, n.terms) for c, n in noise.channels.items()} if noise else usual
        if not self.every:
            first = next((c for c in found if c.startswith(GYRO.name)), next(iter(found)))
            found = {first: found[first]}
        si = {c: parse_unit(unit).si for c, (unit, _) in found.items()}
        rest = [AtRest(c, u, f"rest_{c}") if self.every else AtRest(c, u) for c, u in si.items()]
        effects = {c: tuple(t.effect for t in ts) for c, (_, ts) in found.items()}
        return FilterModel(
            name,
            self.title,
            AtRestMotion(),
            tuple(rest),
            {c: (*es, make("bias", sd=_turn_on(si[c], es))) for c, es in effects.items()},
            {c: unit for c, (unit, _) in found.items()},
            uses={c: tuple(t.use for t in ts) for c, (_, ts) in found.items()},
        )


@dataclass(frozen=True)
class Fixed(Entry):
    """A model without options, built by a function of its name, title and noise."""

    title: str
    made: Callable[[str, str, NoiseModel | None], FilterModel]

    def build(self, name: str, noise: NoiseModel | None, texts: Mapping[str, str]) -> FilterModel:
        """As the function builds it."""
        read_options((), texts, name)
        return self.made(name, self.title, noise)


def _turn_on(unit: str, effects: tuple[Effect, ...]) -> float:
    """Standard deviation of the unknown constant of a channel before the first sample [SI]."""
    sizes = [abs(float(getattr(e, name))) for e in effects for name in e.sizes()]
    return TURN_ON.get(unit, BEYOND * max(sizes, default=1.0))


GNSS = ("gnss_position", "gnss_velocity")
INTRINSICS = {"scale_factors": "true", "misalignment": "triangular", "g_sensitivity": "diagonal"}

GYROS = {
    f"gyro_{a}": ("rad/s", (make("white_noise", N=1.5e-4), make("gauss_markov", sigma=3e-5, tau=300.0)))
    for a in "xyz"
}
ACCELS = {
    f"accel_{a}": ("m/s^2", (make("white_noise", N=2e-3), make("gauss_markov", sigma=5e-4, tau=300.0)))
    for a in "xyz"
}

MOVED = {
    # What is unknown about the acceleration turns with the attitude, so that no heading is read into it.
    "attitude_error": "right-invariant",
    "acceleration": "bounded",
    # A calibrated gyro: 0.2 % and 0.1 deg are usual in the data sheets of calibrated modules.
    "scale_factors": "true",
    "misalignment": "full",
    "intrinsics_sd": "0.002",
    # Integrating gyros send the mean of the interval that ends with the sample.
    "samples": "before",
    # What a calibration of the magnetometer leaves: about its noise, half a microtesla.
    "hard_iron": "true",
    "hard_iron_sd": "0.5 uT",
    # A room bends the field by 1 to 2 uT, and who moves about meets another of its places twice a second.
    "field_left_out": "1 uT/sqrt(Hz)",
    "mag_delay": "state",
}

LIBRARY: dict[str, Entry] = {
    "gyro-static": Resting("one sensor axis at rest: the sum of its identified effects", GYROS, every=False),
    "imu-static": Resting(
        "every axis of a sensor at rest, each the sum of its effects", GYROS | ACCELS, every=True
    ),
    "ahrs6": Moving(
        "attitude and gyro bias from gyros, gravity and magnetic field", {"ned": Rotating}, ("accel", "mag")
    ),
    "ahrs25": Moving(
        "as ahrs6, of a moving body: its acceleration, imperfect gyros, delay and hard iron of the magnetometer",
        {"ned": Rotating},
        ("accel", "mag"),
        MOVED,
    ),
    "ins9": Moving(
        "position, velocity and attitude, sensors without bias, with GNSS", FRAMES, GNSS, {"biases": NONE}
    ),
    "ins15": Moving("position, velocity, attitude, accelerometer and gyro bias, with GNSS", FRAMES, GNSS),
    "ins21": Moving(
        "as ins15, with scale factors of gyros and accelerometers", FRAMES, GNSS, {"scale_factors": "true"}
    ),
    "ins23": Moving(
        "the states of a small autopilot: as ins15, with the magnetic field of Earth and body, and wind",
        FRAMES,
        (*GNSS, "mag", "airspeed"),
        {"field": "vector", "hard_iron": "true"},
    ),
    "ins33": Moving("as ins21, with misalignments and g-sensitivity of the gyros", FRAMES, GNSS, INTRINSICS),
    "hemerly-ekf": Fixed("one sensor axis at rest: N known, B, K and beta as states (Hemerly 2017)", hemerly),
}


def build(name: str, noise: NoiseModel | None = None, options: Mapping[str, str] = NOTHING) -> FilterModel:
    """A library model, or a model file, with the effects of a noise model attached.

    Parameters
    ----------
    name : str
        A key of `LIBRARY`, or the path of a filter file or a model file (``.toml``).
    noise : NoiseModel, optional
        Without it, typical MEMS figures.
    options : mapping of str to str, optional
        Choices as ``--set`` takes them.

    Raises
    ------
    InputError
        No such model or option, a value that an option does not take, or a channel of another dimension.
    """
    if is_filter_file(name):
        return build_filter(read_filter(name).with_noise(noise), options)
    if name.endswith(".toml"):
        from kfgen.model.plant.equations import filter_model
        from kfgen.model.plant.user import read_model

        read_options((), options, "a model file")
        return filter_model(read_model(name), canonical(noise) if noise else None)
    if name not in LIBRARY:
        raise InputError(
            f"there is no model '{name}'",
            remedy=f"Known are {', '.join(LIBRARY)}, or a filter file or model file (.toml)",
        )
    return LIBRARY[name].build(name, canonical(noise) if noise else None, options)


def build_filter(file: FilterFile, options: Mapping[str, str] = NOTHING) -> FilterModel:
    """The filter of a filter file.

    Parameters
    ----------
    file : FilterFile
    options : mapping of str to str, optional
        Choices instead of the file's, as ``--set`` takes them.

    Raises
    ------
    InputError
        As `build`; or an initial value of something that the filter does not store.
    """
    if file.model not in LIBRARY:
        raise InputError(
            f"there is no model '{file.model}'", where=file.name, remedy=f"Known are {', '.join(LIBRARY)}"
        )
    noise = canonical(file.noise) if file.noise else None
    built = LIBRARY[file.model].build(file.model, noise, file.texts | dict(options))
    units = {s.name: s.unit for s in built.sensors} | {i.name: i.unit for i in built.motion.inputs}
    unchecked = tuple(
        Omission(
            name,
            f"the limit of {limit}",
            f"{file.model} has no input and no sensor of that name",
            f"Give limits of {', '.join(units)}",
        )
        for name, limit in file.limits.items()
        if name not in units
    )
    limits = {
        name: abs(parse_quantity(limit, units[name], where=f"{file.name}: [limits] {name}"))
        for name, limit in file.limits.items()
        if name in units
    }
    stored = {n for b in built.blocks for n in b.nominal_names} | {HEADING}
    for name in file.initial:
        if name not in stored:
            raise InputError(
                f"{file.name} stores no '{name}'",
                where="[initial]",
                remedy=f"It stores {', '.join(sorted(stored))}",
            )
    return replace(built, name=file.name, initial=file.initial, unchecked=unchecked, limits=limits)


def declared_options() -> list[tuple[str, Option]]:
    """Every option of every model and sensor, with whose it is."""
    declared = [(n, o) for n, e in LIBRARY.items() for texts in e.variants() for o in e.options(texts)]
    return declared + [(n, o) for n, s in sensors().items() for o in s.options]


def option_rows() -> list[tuple[str, str]]:
    """Every option of every model and sensor with its meaning, its values, its default, and whose it is."""
    owners: dict[tuple[str, str, str], dict[str, list[str]]] = {}
    for owner, o in declared_options():
        by_default = owners.setdefault((o.name, o.title, o.kind.words), {})
        others = by_default.setdefault(o.default, [])
        if owner not in others:
            others.append(owner)
    rows = []
    for (name, title, words), by_default in owners.items():
        of = "; ".join(f"default {d} ({', '.join(who)})" for d, who in by_default.items())
        rows.append((name, f"{title}: {words}; {of}"))
    return rows
