"""The text of a model file: read into a `UserModel`, and written from one."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kfgen.core.errors import InputError
from kfgen.core.expression import FUNCTIONS, Expression, read_expression
from kfgen.core.files.toml_document import document_of
from kfgen.core.files.whole_file import write_text
from kfgen.core.units import from_si, parse_quantity, parse_unit
from kfgen.effects.noise_model import ChannelNoise, entry_text, quoted, read_channel, read_term
from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import PlantEffect
from kfgen.model.plant.user import FORMAT, Acting, Measurement, ModelParameter, StateStart, UserModel

TABLES = ("parameters", "states", "inputs", "dynamics", "measurements", "dynamics_effects")
TOP_KEYS = ("format", "name", "title", "provenance", *TABLES)
PARAMETER_KEYS = ("value", "sd")
STATE_KEYS = ("unit", "initial", "sd")
MEASUREMENT_KEYS = ("unit", "expression", "effects", "covariance")
RESERVED = frozenset({*FUNCTIONS, "t", "dt"})

_NUMBER = re.compile(r"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\d.])")


def parse_model(text: str, path: str) -> UserModel:
    """A model from the text of its file; `path` is said in errors, as in `read_model`."""
    document = document_of(text, path, FORMAT, "model")
    name = document.get("name")
    if not isinstance(name, str) or not name.strip():
        raise InputError("it has no name", where=path, remedy='Add a line like name = "pendulum"')
    tables = _tables(document, path)
    parameters = {n: _number(v, f"{path}: [parameters] {n}") for n, v in tables["parameters"].items()}
    states = {n: _state(v, f"{path}: [states] {n}") for n, v in tables["states"].items()}
    inputs = {n: _unit(v, f"{path}: [inputs] {n}") for n, v in tables["inputs"].items()}
    known = _names(path, states=states, parameters=parameters, inputs=inputs)
    dynamics = {n: _formula(v, known, f"{path}: [dynamics] {n}") for n, v in tables["dynamics"].items()}
    measurements = {
        n: _measurement(n, v, known, f"{path}: [measurements.{n}]") for n, v in tables["measurements"].items()
    }
    plain = UserModel(name, parameters, states, inputs, dynamics, measurements, (), path)
    effects = tuple(_acting(plain, tables["dynamics_effects"], path))
    return UserModel(name, parameters, states, inputs, dynamics, measurements, effects, path)


def _tables(document: Mapping[str, Any], path: str) -> dict[str, Mapping[str, Any]]:
    for key, value in document.items():
        if key in TOP_KEYS and key not in TABLES:
            continue
        if key not in TABLES:
            raise InputError(
                f"'{key}' is no part of a model file", where=path, remedy=f"It has {', '.join(TABLES)}"
            )
        if not isinstance(value, dict):
            raise InputError(f"'{key}' is no table", where=path)
    return {key: document.get(key, {}) for key in TABLES}


def _names(path: str, **kinds: Mapping[str, Any]) -> tuple[str, ...]:
    seen: dict[str, str] = {}
    for kind, names in kinds.items():
        for name in names:
            where = f"{path}: [{kind}] {name}"
            if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
                raise InputError(
                    f"'{name}' is no name", where=where, remedy="Use letters, digits and underscores"
                )
            if name in RESERVED or name.startswith("__"):
                raise InputError(f"the name '{name}' is taken", where=where, remedy="Choose another")
            if name in seen:
                raise InputError(f"'{name}' stands under [{seen[name]}] too", where=where)
            seen[name] = kind
    return tuple(seen)


def _unit(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"expected a unit, found {value!r}", where=where, remedy='Write it like "rad/s"')
    try:
        parse_unit(value)
    except InputError as error:
        raise InputError(error.what, where=where, remedy=error.remedy) from None
    return value


def _keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            raise InputError(
                f"'{key}' is not known here", where=where, remedy=f"Known are {', '.join(known)}"
            )


def _own_unit(value: Any) -> str:
    """The unit that a text with a number carries; of a number alone, none."""
    match = _NUMBER.match(value) if isinstance(value, str) else None
    return str(value)[match.end() :].strip() if match else ""


def _number(entry: Any, where: str) -> ModelParameter:
    table = entry if isinstance(entry, dict) else {"value": entry}
    _keys(table, PARAMETER_KEYS, where)
    if "value" not in table:
        raise InputError("it has no value", where=where, remedy='Write value = "19.6 1/s^2"')
    unit = _unit(_own_unit(table["value"]), where)
    value = parse_quantity(table["value"], unit or "1", where=where)
    return ModelParameter(unit, value, _deviation(table.get("sd", 0.0), unit or "1", where, zero=True))


def _state(entry: Any, where: str) -> StateStart:
    if not isinstance(entry, dict):
        return StateStart(_unit(entry, where))
    _keys(entry, STATE_KEYS, where)
    unit = _unit(entry.get("unit"), f"{where} unit")
    if "initial" not in entry:
        if "sd" in entry:
            raise InputError("it has an sd, but no initial value", where=where)
        return StateStart(unit)
    initial = parse_quantity(entry["initial"], unit, where=f"{where} initial")
    sd = _deviation(entry["sd"], unit, where) if "sd" in entry else math.inf
    return StateStart(unit, initial, sd)


def _deviation(value: Any, unit: str, where: str, *, zero: bool = False) -> float:
    sd = parse_quantity(value, unit, where=f"{where} sd", offset=False)
    if sd < 0.0 or (sd == 0.0 and not zero):
        raise InputError(f"sd = {value!r} is not positive", where=where)
    return sd


def _formula(value: Any, names: tuple[str, ...], where: str) -> Expression:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError(
            f"expected an expression, found {value!r}", where=where, remedy='Write it like "-k*x"'
        )
    return read_expression(str(value), names, where)


def _measurement(name: str, table: Any, names: tuple[str, ...], where: str) -> Measurement:
    if not isinstance(table, dict):
        raise InputError("it is no table", where=where)
    _keys(table, MEASUREMENT_KEYS, where)
    if "expression" not in table:
        raise InputError("it has no expression", where=where, remedy='Add a line like expression = "theta"')
    noise = read_channel(name, table, where)
    for effect in noise.effects:
        if isinstance(effect, PlantEffect) and not isinstance(effect, SensorChange):
            raise InputError(
                f"{effect.name} does not act on a measurement",
                where=where,
                remedy="It belongs under [dynamics_effects]",
            )
    return Measurement(_formula(table["expression"], names, f"{where} expression"), noise)


def _acting(model: UserModel, table: Mapping[str, Any], path: str) -> list[Acting]:
    """The effects inside the equations."""
    found = []
    for name, entries in table.items():
        where = f"{path}: [dynamics_effects] {name}"
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise InputError("it is no list of effects", where=where)
        if name not in model.states and name not in model.inputs:
            raise InputError(
                f"'{name}' is neither a state nor an input",
                where=where,
                remedy=f"Known are {', '.join((*model.states, *model.inputs)) or 'none'}",
            )
        state = name in model.states
        unit = parse_unit(f"({parse_unit(model.states[name].unit).si})/s").si if state else model.inputs[name]
        found += [Acting(name, read_term(entry, unit, where)) for entry in entries]
    return found


def model_text(model: UserModel) -> str:
    """The model file as text; it reads back as the same model."""
    lines = [f'format = "{FORMAT}"', f"name = {quoted(model.name)}"]
    lines += _table("parameters", {n: _number_text(p) for n, p in model.parameters.items()})
    lines += _table("states", {n: _state_text(s) for n, s in model.states.items()})
    lines += _table("inputs", {n: quoted(u) for n, u in model.inputs.items()})
    lines += _table("dynamics", {n: quoted(e.text) for n, e in model.dynamics.items()})
    for name, m in model.measurements.items():
        lines += ["", f"[measurements.{name}]", f"unit = {quoted(m.unit)}"]
        lines += [f"expression = {quoted(m.expression.text)}", *_effects_text(m.noise)]
    acting: dict[str, list[str]] = {}
    for a in model.dynamics_effects:
        assert isinstance(a.effect, PlantEffect)
        acting.setdefault(a.where, []).append(f"{{ {entry_text(a.term, model.unit_at(a.where, a.effect))} }}")
    lines += _table("dynamics_effects", {n: f"[ {', '.join(e)} ]" for n, e in acting.items()})
    return "\n".join(lines) + "\n"


def write_model(model: UserModel, path: str | Path) -> None:
    """Write a model file, whole or not at all."""
    write_text(path, model_text(model))


def _table(name: str, entries: Mapping[str, str]) -> list[str]:
    return ["", f"[{name}]", *(f"{k} = {v}" for k, v in entries.items())] if entries else []


def _effects_text(noise: ChannelNoise) -> list[str]:
    """The effects of a measurement as in a noise file."""
    if not noise.terms:
        return []
    return ["effects = [", *(f"  {{ {entry_text(t, noise.unit)} }}," for t in noise.terms), "]"]


def _text(value: float, unit: str, *, difference: bool = False) -> str:
    shown = value / parse_unit(unit).factor if difference else from_si(value, unit)
    return quoted(f"{shown:.15g} {unit}".strip())


def _number_text(p: ModelParameter) -> str:
    value = _text(p.value, p.unit)
    return f"{{ value = {value}, sd = {_text(p.sd, p.unit, difference=True)} }}" if p.sd else value


def _state_text(s: StateStart) -> str:
    if s.initial == 0.0 and math.isinf(s.sd):
        return quoted(s.unit)
    sd = "" if math.isinf(s.sd) else f", sd = {_text(s.sd, s.unit, difference=True)}"
    return f"{{ unit = {quoted(s.unit)}, initial = {_text(s.initial, s.unit)}{sd} }}"
