"""Writes docs/schemas: JSON schemas of the noise, model, filter and manoeuvre files, from what the code declares.

Editors complete and check TOML by them (``#:schema`` of Taplo). Usage: python tools/schemas.py [FOLDER]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from kfgen.core.units import QUANTITY
from kfgen.effects import OF_CHANNELS, Effect, catalogue
from kfgen.effects.effect import Parameter
from kfgen.effects.filter_role import KNOWN, STATE
from kfgen.effects.noise_model import FORMAT as NOISE
from kfgen.effects.noise_model import SAMPLED, WHITE
from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import PlantEffect
from kfgen.manoeuvre.file import FORMAT as MANOEUVRE
from kfgen.manoeuvre.file import SEGMENT_KEYS
from kfgen.manoeuvre.file import TOP_KEYS as MANOEUVRE_KEYS
from kfgen.model.filter_file import FORMAT as FILTER
from kfgen.model.filter_file import KEYS as FILTER_KEYS
from kfgen.model.library import LIBRARY, declared_options
from kfgen.model.option import Names
from kfgen.model.parts.sensors import sensors
from kfgen.model.plant.file import MEASUREMENT_KEYS, PARAMETER_KEYS, STATE_KEYS
from kfgen.model.plant.file import TOP_KEYS as MODEL_KEYS
from kfgen.model.plant.user import FORMAT as MODEL

Schema = dict[str, Any]

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "schemas"
NAME = "^[A-Za-z_][A-Za-z0-9_]*$"
TEXT: Schema = {"type": "string"}
TEXTS: Schema = {"type": "object", "additionalProperties": True}
QUANTITY_REF: Schema = {"$ref": "#/definitions/quantity"}
QUANTITY_SCHEMA: Schema = {
    "description": 'A number in SI, or a text with a unit: "0.01 deg/s"',
    "oneOf": [{"type": "number"}, {"type": "string", "pattern": f"^{QUANTITY}"}],
}
FORMULA: Schema = {"description": "An expression; everything in it is SI", "type": ["string", "number"]}
UNIT: Schema = {"description": "deg/s, m/s^2, uT ...", "type": "string", "minLength": 1}
JOINT: Schema = {
    "description": "Covariance of the logarithms of the parameters that 'of' names, as 0.N",
    "type": "object",
    "properties": {
        "of": {"type": "array", "items": TEXT},
        "log": {"type": "array", "items": {"type": "array", "items": {"type": "number"}}},
    },
    "required": ["of", "log"],
    "additionalProperties": False,
}


def table(of: Mapping[str, Schema], required: Iterable[str] = (), declared: Iterable[str] = ()) -> Schema:
    """A table with these keys and no other; `declared` are those of the code, which must be the same."""
    wanted = set(declared)
    if wanted and wanted != set(of):
        raise SystemExit(f"the code declares {sorted(wanted)}, the schema has {sorted(of)}")
    found: Schema = {"type": "object", "properties": dict(of), "additionalProperties": False}
    return found | ({"required": list(required)} if required else {})


def named(of: Schema, description: str = "") -> Schema:
    """A table whose keys are free names."""
    return {
        "type": "object",
        "description": description,
        "patternProperties": {NAME: of},
        "additionalProperties": False,
    }


def parameter(p: Parameter) -> Schema:
    """One parameter of an effect."""
    unit = p.unit or "1"
    of = f"[{unit}], U being the unit of the channel" if "U" in unit else f"[{unit}]"
    return QUANTITY_REF | {"title": f"{p.name} {of}"}


def entry(cls: type[Effect], name: Schema) -> Schema:
    """What a file says of an effect: its name, its parameters or other names of these, intervals, its use."""
    own = {p.name: parameter(p) for p in cls.parameters()}
    others = {m.name: m for m in cls.meanings if m.name not in own}
    properties = {"effect": name, **own}
    properties |= {
        m.name: QUANTITY_REF | {"title": f"{m.title}; gives {m.parameter}"} for m in others.values()
    }
    interval = {"type": "array", "items": QUANTITY_REF, "minItems": 2, "maxItems": 2}
    properties |= {f"{n}_ci95": interval for n in own}
    properties["as"] = {"enum": [KNOWN, STATE], "description": "In a filter: corrected, or estimated"}
    fields = cls.__dataclass_fields__
    needed = [n for n in own if fields[n].default is fields[n].default_factory]
    ways = [[n, *(m.name for m in others.values() if m.parameter == n)] for n in needed]
    found = table(properties, ["effect", *(w[0] for w in ways if len(w) == 1)])
    either = [{"anyOf": [{"required": [n]} for n in w]} for w in ways if len(w) > 1]
    return {"title": cls.title, **found} | ({"allOf": either} if either else {})


def effect_entries(plant: bool) -> list[Schema]:
    """An entry for every effect that acts on a channel, or inside a plant."""
    # Effects of the package alone, in an order that does not hang on what was imported first.
    known = {n: c for n, c in sorted(catalogue().items()) if c.__module__.startswith("kfgen.")}
    inside = {n for n, c in known.items() if issubclass(c, PlantEffect) and not issubclass(c, SensorChange)}
    chosen = {n: c for n, c in known.items() if (n in inside) == plant}
    found = [entry(c, {"const": n}) for n, c in chosen.items()]
    if not plant:
        found.append(entry(known[SAMPLED], {"const": WHITE}))
        for prefix, made in OF_CHANNELS.items():
            found.append(entry(made("x"), {"type": "string", "pattern": f"^{prefix}{NAME[1:]}"}))
    return found


def definitions(plant: bool = False) -> Schema:
    """What the formats share."""
    found: Schema = {
        "quantity": QUANTITY_SCHEMA,
        "effects": {"type": "array", "items": {"oneOf": effect_entries(plant=False)}},
    }
    if plant:
        found["plant_effects"] = {"type": "array", "items": {"oneOf": effect_entries(plant=True)}}
    return found


EFFECTS: Schema = {"$ref": "#/definitions/effects"}
CHANNEL = table({"unit": UNIT, "effects": EFFECTS, "covariance": JOINT}, ["unit"])


def document(format: str, title: str, body: Schema, shared: Schema) -> Schema:
    """A whole schema."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": f"{title} of kfgen, {format}",
        **body,
        "definitions": shared,
    }


def of_format(format: str) -> Schema:
    """The key that every file begins with."""
    return {"const": format}


def noise() -> Schema:
    """Effects by channel."""
    body = {
        "type": "object",
        "properties": {"format": of_format(NOISE), "provenance": TEXTS},
        "patternProperties": {NAME.replace("^", "^(?!(?:format|provenance)$)"): CHANNEL},
        "additionalProperties": False,
        "required": ["format"],
        "minProperties": 2,
    }
    return document(NOISE, "Noise file", body, definitions())


def model() -> Schema:
    """A plant: states, inputs, dynamics, measurements."""
    value = {"oneOf": [QUANTITY_REF, table(dict.fromkeys(PARAMETER_KEYS, QUANTITY_REF), ["value"])]}
    of_state = {"unit": UNIT, "initial": QUANTITY_REF, "sd": QUANTITY_REF}
    state = {
        "oneOf": [
            UNIT,
            table(of_state, ["unit"], STATE_KEYS) | {"dependencies": {"sd": ["initial"]}},
        ]
    }
    measurement = table(
        {"unit": UNIT, "expression": FORMULA, "effects": EFFECTS, "covariance": JOINT},
        ["unit", "expression"],
        MEASUREMENT_KEYS,
    )
    keys = {
        "format": of_format(MODEL),
        "name": TEXT | {"minLength": 1},
        "title": TEXT,
        "provenance": TEXTS,
        "parameters": named(value, "Constants; with sd they have a prior"),
        "states": named(state, "The unit of each, or a table with its initial value"),
        "inputs": named(UNIT, "The unit of each; the log's channel of that name"),
        "dynamics": named(FORMULA, "The time derivative of each state"),
        "measurements": named(measurement, "By the name of the log's channel"),
        "dynamics_effects": named({"$ref": "#/definitions/plant_effects"}, "By state or input"),
    }
    return document(MODEL, "Model file", table(keys, ["format", "name"], MODEL_KEYS), definitions(plant=True))


def filter_file() -> Schema:
    """A library model with its sensors, options, limits, initial values and noise."""
    one = {"oneOf": [{"type": "boolean"}, {"type": "number"}, TEXT]}
    value = {
        "oneOf": [*one["oneOf"], {"type": "array", "items": {"type": ["string", "number"]}, "minItems": 1}]
    }
    words: dict[str, set[str]] = {}
    for _, o in declared_options():
        values = "" if isinstance(o.kind, Names) else f": {o.kind.words}"  # names of sensors are listed above
        words.setdefault(o.name, set()).add(o.title + values)
    start = {"oneOf": [QUANTITY_REF, table({"value": QUANTITY_REF, "sd": QUANTITY_REF}, ["value"])]}
    channel = CHANNEL | {"required": []}
    keys = {
        "format": of_format(FILTER),
        "name": TEXT | {"minLength": 1},
        "title": TEXT,
        "model": {"enum": list(LIBRARY), "description": "A library model, see kfgen list"},
        "sensors": {"type": "array", "items": {"enum": sorted(sensors())}},
        "options": table(
            {n: {"description": "; or ".join(sorted(words[n])), **value} for n in sorted(words)}
        ),
        "limits": named(QUANTITY_REF, "What a sensor can physically give"),
        "initial": named(start, "By the name of a stored state, or heading"),
        "noise": {"oneOf": [TEXT, named(channel, "As in a noise file")]},
        "provenance": TEXTS,
    }
    return document(FILTER, "Filter file", table(keys, ["format", "model"], FILTER_KEYS), definitions())


def manoeuvre() -> Schema:
    """Segments of body rate and acceleration."""
    formula = {
        "description": "A number, a quantity, or an expression of t, T, g, pi",
        "type": ["number", "string"],
    }
    triple = {"type": "array", "items": formula, "minItems": 3, "maxItems": 3}
    fixed = triple | {"items": QUANTITY_REF}
    of_segment = dict.fromkeys(SEGMENT_KEYS, triple)
    of_segment |= {"duration": formula, "start": formula, "inputs": named(formula, "By the input of a plant")}
    keys = {
        "format": of_format(MANOEUVRE),
        "name": TEXT,
        "title": TEXT,
        "velocity": fixed | {"description": "At the start, north, east, down [m/s]"},
        "attitude": fixed | {"description": "At the start: roll, pitch, yaw [rad]"},
        "segment": {"type": "array", "items": table(of_segment, ["duration"])},
    }
    return document(
        MANOEUVRE, "Manoeuvre file", table(keys, ["format"], MANOEUVRE_KEYS), {"quantity": QUANTITY_SCHEMA}
    )


SCHEMAS = {"noise": noise, "model": model, "filter": filter_file, "manoeuvre": manoeuvre}


def texts() -> dict[str, str]:
    """The schemas as they are written, by file name."""
    return {
        f"{name}.schema.json": json.dumps(made(), indent=1, ensure_ascii=False) + "\n"
        for name, made in SCHEMAS.items()
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="tools/schemas.py", description="Writes the JSON schemas of the files."
    )
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER, help="docs/schemas when left out")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts().items():
        (folder / name).write_text(text, encoding="utf-8")
