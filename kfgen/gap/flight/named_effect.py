"""Effects at their places as a user names them: ``time_delay@gnss_v``, ``time_delay@gnss_p=0.1 s``, ``hard_iron@mag:x=3 uT``."""

from __future__ import annotations

from kfgen.core.channel_names import AXES, acts_on
from kfgen.core.errors import InputError
from kfgen.effects import Effect, catalogue, effect_named
from kfgen.effects.driven.history import Lagged
from kfgen.effects.driven.proportional import DRIVERS, DriverProportional
from kfgen.effects.effect import AddsNothingAtRest
from kfgen.effects.inertial.inertial_error import InertialError, free
from kfgen.effects.inertial.lag import Lag
from kfgen.gap.scene.scene import Placed
from kfgen.model.filter import FilterModel

FORM = "EFFECT@PLACE, EFFECT@PLACE=SIZE or EFFECT@PLACE:NAME=SIZE, 'time_delay@gnss_v=0.1 s' for example"


def placed_effect(text: str, model: FilterModel, where: str) -> Placed:
    """An effect at its place, of typical size where none is said.

    Parameters
    ----------
    text : str
        ``EFFECT@PLACE``, names as in noise files and findings; ``=SIZE`` sets all its numbers, ``:NAME=SIZE`` one of them.
    model : FilterModel
        Whose channels and sensors are places.
    where : str
        For messages.

    Raises
    ------
    InputError
        It is written otherwise, there is no such effect, place or number, nobody knows its course beforehand, or it has
        no typical size.
    """
    name, at, rest = text.strip().partition("@")
    head, *others = rest.split(":")
    place, _, size = (part.strip() for part in head.partition("="))
    if not (name and at and place):
        raise InputError(f"'{text}' names no effect at a place", where=where, remedy=f"Write {FORM}")
    cls = _class_named(name.strip(), where)
    channels = model.channels_of(place)
    if not channels:
        raise InputError(
            f"{model.name} has no channel or sensor '{place}'",
            where=where,
            remedy=f"It has {', '.join(model.channel_units)}",
        )
    _check_place(cls, place, where)
    unit, entries = model.channel_units[channels[0]], dict(_pair(o, text, where) for o in others)
    if not entries:
        size = size or _typical(cls, place, where)
        entries = dict.fromkeys(_numbers(cls, channels), size)
    found = Placed(cls.read(entries, unit, where), place)
    if not any(getattr(found.effect, p.name) for p in free(found.effect)):
        raise InputError(f"{text} has the size zero", where=where, remedy="Give it a size")
    return found


def _class_named(name: str, where: str) -> type[Effect]:
    """The effect of a name; where only a part of it was written, those that have it are said."""
    near = [n for n in catalogue() if name in n]
    if near and name not in near:
        raise InputError(
            f"there is no effect '{name}'", where=where, remedy=f"Did you mean {', '.join(near)}?"
        )
    return effect_named(name, where=where)


def _check_place(cls: type[Effect], place: str, where: str) -> None:
    """Raise `InputError` where an effect has no course along a manoeuvre, or is none of a place's sensor."""
    if issubclass(cls, InertialError):
        if not issubclass(cls, Lag) and not any(acts_on(s, place) for s in cls.sensors):
            raise InputError(
                f"{cls.name} is no effect of {place}",
                where=where,
                remedy=f"It is one of {', '.join(cls.sensors)}",
            )
    elif not cls.coefficients() or issubclass(cls, AddsNothingAtRest):
        raise InputError(
            f"no course of {cls.name} can be expected along a manoeuvre: it is random, a fault, or an effect of a plant",
            where=where,
            remedy="Name an effect that follows from the motion: a delay, a scale factor, a lever arm, iron",
        )
    elif issubclass(cls, DriverProportional | Lagged) and cls.driver not in DRIVERS:
        raise InputError(
            f"no course of {cls.driver or 'the driver of ' + cls.name} can be expected along a manoeuvre",
            where=where,
            remedy=f"Known are those of {', '.join(DRIVERS)}",
        )


def _pair(text: str, whole: str, where: str) -> tuple[str, str]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise InputError(
            f"'{text}' of '{whole}' is no number of an effect", where=where, remedy=f"Write {FORM}"
        )
    return name, value


def typical_size(cls: type[Effect], place: str) -> str:
    """The usual size of an effect at a place; empty where none is known.

    Parameters
    ----------
    cls : type of Effect
    place : str
    """
    found = next((s for begins, s in cls.typical.items() if begins and acts_on(begins, place)), None)
    return found or cls.typical.get("", "")


def _typical(cls: type[Effect], place: str, where: str) -> str:
    """The usual size of an effect at a place, which must be known."""
    size = typical_size(cls, place)
    if not size:
        raise InputError(
            f"{cls.name} has no typical size at {place}",
            where=where,
            remedy=f"Give one: {cls.name}@{place}=SIZE",
        )
    return size


def _numbers(cls: type[Effect], channels: tuple[str, ...]) -> list[str]:
    """The numbers of an effect that act on channels: of a matrix the rows, of a vector the axes, of these channels."""
    names = [p.name for p in cls.estimated() if p.kind not in ("solved", "place")]
    axes = {c.rpartition("_")[2] for c in channels}
    if not axes <= set(AXES):
        return names
    return [n for n in names if not set(n) <= set(AXES) or n[0] in axes or cls.name == "g_squared"]
