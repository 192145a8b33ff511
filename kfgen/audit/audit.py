"""The answer of an audit: rank, hidden directions with names and units, sentences."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from kfgen.audit.null import null_directions
from kfgen.audit.numeric import Numeric, numeric
from kfgen.model.attach import StateInfo
from kfgen.model.filter import FilterModel

NAVIGATION = {"x": "N", "y": "E", "z": "D"}
"""At the operating point body axes lie along navigation axes, and are called by them."""
WORDS = {"N": "north", "E": "east", "D": "down", "x": "x", "y": "y", "z": "z"}
NATURAL = {
    "rad": (1e-3, "mrad"),
    "rad/s": (1e-3, "mrad/s"),
    "m/s^2": (1e-3, "mm/s^2"),
    "m": (1.0, "m"),
    "m/s": (1.0, "m/s"),
}


@dataclass(frozen=True)
class Direction:
    """A hidden direction.

    Parameters
    ----------
    vector : dict of str to float
        State (body axes called by the navigation axes that they lie along) to amount [SI].
    units : dict of str to str
    sentence : str
    """

    vector: dict[str, float]
    units: dict[str, str]
    sentence: str


@dataclass(frozen=True)
class Audit:
    """What one operating point hides; `numeric` is what floating point says of it."""

    model: str
    manoeuvre: str
    states: int
    directions: tuple[Direction, ...]
    numeric: Numeric

    @property
    def nullity(self) -> int:
        """Number of hidden directions."""
        return len(self.directions)

    @property
    def rank(self) -> int:
        """Number of visible combinations."""
        return self.states - self.nullity


def audit(model: FilterModel) -> Audit:
    """Audit a model at rest."""
    values = {c.symbol: sp.Float(c.value) for c in model.constants}
    directions = tuple(_direction(model, v.subs(values)) for v in null_directions(model))
    return Audit(model.name, "static", len(model.states), directions, numeric(model))


def _direction(model: FilterModel, v: sp.Matrix) -> Direction:
    parts = [(s, float(e)) for s, e in zip(model.states, v) if e != 0]
    names = {s.name: called(model, s) for s, _ in parts}
    return Direction(
        {names[s.name]: value for s, value in parts},
        {names[s.name]: s.unit for s, _ in parts},
        _sentence([(names[s.name], s, value) for s, value in parts]),
    )


def called(model: FilterModel, state: StateInfo) -> str:
    """The name of a state at the operating point: biases of body axes by navigation axes."""
    stem, _, axis = state.name.rpartition("_")
    biases = {i.bias for i in model.motion.inputs}
    return (
        f"{stem}_{NAVIGATION[axis]}"
        if model.attitude and stem in biases and axis in NAVIGATION
        else state.name
    )


def words(name: str, state: StateInfo) -> str:
    """A state in words."""
    stem, _, axis = name.rpartition("_")
    where = WORDS.get(axis, axis)
    nouns = {
        "phi": f"{where} tilt" if axis != "D" else "heading",
        "bg": f"{where} gyro bias",
        "ba": f"{where} accelerometer bias",
        "p": f"{where} position",
        "v": f"{where} velocity",
    }
    return nouns.get(stem, state.title)


def amount(value: float, unit: str) -> str:
    """A number with a unit of its size."""
    scale, shown = NATURAL.get(unit, (1.0, unit))
    return f"{value / scale:.4g} {shown}"


def _sentence(parts: list[tuple[str, StateInfo, float]]) -> str:
    (name, state, value), *others = parts
    size = NATURAL.get(state.unit, (1.0, state.unit))[0]
    head = f"{amount(value * size, state.unit)} of {words(name, state)}"
    if not others:
        noun = words(name, state)
        known = noun == state.title
        return f"{noun if known else noun[0].upper() + noun[1:]} changes no measurement"
    tail = " with ".join(f"{amount(v * size, s.unit)} of {words(n, s)}" for n, s, v in others)
    return f"{head} is hidden by {tail}"
