"""Unobservable directions as sentences that a navigator would say, with names and units."""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.attach import StateInfo
from kfgen.model.filter import FilterModel

NAVIGATION_AXIS = {"x": "N", "y": "E", "z": "D"}
"""Where a manoeuvre starts level and north, body axes are called by the navigation axes along which they lie."""
AXIS_WORDS = {"N": "north", "E": "east", "D": "down", "x": "x", "y": "y", "z": "z"}
SPOKEN_UNITS = {
    "rad": (1e-3, "mrad"),
    "rad/s": (1e-3, "mrad/s"),
    "m/s^2": (1e-3, "mm/s^2"),
    "T": (1e-6, "uT"),
    "s": (1e-3, "ms"),
    "1": (1e-2, "%"),
}
"""In what a state is said: [SI], unit."""


def level(manoeuvre: Manoeuvre) -> bool:
    """Whether it starts with body axes along north, east and down."""
    return not any(manoeuvre.attitude[1:])


def called(model: FilterModel, state: StateInfo, manoeuvre: Manoeuvre) -> str:
    """The name of a state: biases of body axes by navigation axes, where these are the same.

    Parameters
    ----------
    model : FilterModel
    state : StateInfo
    manoeuvre : Manoeuvre
        Whose start says where body axes lie.
    """
    stem, _, axis = state.name.rpartition("_")
    biases = {i.bias for i in model.motion.inputs}
    navigated = model.attitude and stem in biases and axis in NAVIGATION_AXIS and level(manoeuvre)
    return f"{stem}_{NAVIGATION_AXIS[axis]}" if navigated else state.name


def words(model: FilterModel, name: str, state: StateInfo, manoeuvre: Manoeuvre) -> str:
    """A state in words.

    Parameters
    ----------
    model : FilterModel
    name : str
        As `called` says.
    state : StateInfo
    manoeuvre : Manoeuvre
        Whose start says where body axes lie.
    """
    stem, _, axis = name.rpartition("_")
    attitude = model.attitude
    if attitude is not None and stem == attitude.convention.letter:
        along = (
            NAVIGATION_AXIS.get(axis, axis) if attitude.convention.side.body and level(manoeuvre) else axis
        )
        return "heading" if along == "D" else f"{AXIS_WORDS.get(along, along)} tilt"
    where = AXIS_WORDS.get(axis, axis)
    nouns = {
        "bg": f"{where} gyro bias",
        "ba": f"{where} accelerometer bias",
        "p": f"{where} position",
        "v": f"{where} velocity",
    }
    return nouns.get(stem, _once(state.title))


def _once(title: str) -> str:
    """A title whose last word stands there once: a state of one component is called by its block."""
    head, _, last = title.rpartition(" ")
    return head if head.endswith(f" {last}") else title


def amount(value: float, unit: str) -> str:
    """A number with a unit of its size.

    Parameters
    ----------
    value : float
        [SI]
    unit : str
        Its SI unit.
    """
    scale, shown = SPOKEN_UNITS.get(unit, (1.0, unit))
    return f"{value / scale:.4g} {shown}"


def listed(parts: Sequence[str]) -> str:
    """Texts with commas and an 'and'."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


Part = tuple[str, StateInfo, float]
"""Words, state, amount [SI]."""


def sentence(parts: Sequence[Part], gauge: str = "") -> str:
    """An unobservable direction: what its first state changes in the measurements, the others take back.

    Parameters
    ----------
    parts : sequence of (str, StateInfo, float)
        Of each of its states: its noun, the state, its amount [SI].
    gauge : str
        Of a freedom that no measurement of the kind can remove: what moves.
    """
    if gauge:
        return f"{gauge} is unobservable: it changes no measurement"
    (noun, state, value), *others = parts
    if not others:
        return f"{noun if noun == _once(state.title) else noun[0].upper() + noun[1:]} is unobservable: no measurement depends on it"
    size = SPOKEN_UNITS.get(state.unit, (1.0, state.unit))[0]
    head = f"{amount(value * size, state.unit)} of {noun}"
    tail = [f"{amount(v * size, s.unit)} of {n}" for n, s, v in others]
    return f"{head} is hidden by {listed(tail)}"
