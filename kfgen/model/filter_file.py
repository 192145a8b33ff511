"""Filter files: everything that makes a filter in one TOML file, ``format = "kfgen-filter-1"``.

A library model, its sensors, options, initial values and noise. ``derive``, ``audit``, ``emit``, ``simulate``, ``run`` and ``gap`` take
such a file as MODEL, and ``gap -o`` writes one where the model was a filter. It is what a team keeps under version control.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from kfgen.core.errors import InputError
from kfgen.core.files.toml_document import document_of, text_of
from kfgen.core.files.whole_file import write_text
from kfgen.core.units import parse_quantity, parse_unit
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, entry_text, quoted, read_channel, read_noise

FORMAT = "kfgen-filter-1"
KEYS = ("format", "name", "title", "model", "sensors", "options", "limits", "initial", "noise", "provenance")
SENSOR_UNITS = {"gyro": "rad/s", "accel": "m/s^2", "mag": "uT", "gnss": "m", "baro": "m", "airspeed": "m/s"}
"""Unit of a table that does not say its own, by sensor."""
HEADING = "heading"
"""The initial value that is no stored state: the yaw angle from north."""


@dataclass(frozen=True)
class Initial:
    """What is assumed about a value before the first measurement, and its standard deviation [SI]; zero: as the model says."""

    value: float
    sd: float = 0.0


@dataclass(frozen=True)
class FilterFile:
    """A filter as its file says it.

    Parameters
    ----------
    name, model : str
        Of the filter; the library model that it is.
    sensors : tuple of str
        Instead of the model's own; empty for these.
    options : mapping of str to str
        As ``--set`` takes them.
    limits : mapping of str to str
        What a sensor can physically give, with units.
    initial : mapping of str to Initial
        By the name of a stored state, or ``heading``.
    noise : NoiseModel, optional
    provenance : mapping of str to str
    """

    name: str
    model: str
    sensors: tuple[str, ...] = ()
    options: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, str] = field(default_factory=dict)
    initial: Mapping[str, Initial] = field(default_factory=dict)
    noise: NoiseModel | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def texts(self) -> dict[str, str]:
        """Options with the sensors, as a library model takes them."""
        return dict(self.options) | ({"sensors": ",".join(self.sensors)} if self.sensors else {})

    def with_noise(self, noise: NoiseModel | None) -> FilterFile:
        """The same with the channels of another noise model instead of its own."""
        if noise is None:
            return self
        own = dict(self.noise.channels) if self.noise else {}
        return replace(self, noise=NoiseModel(own | dict(noise.channels), noise.provenance))


def read_filter(path: str | Path) -> FilterFile:
    """Read a filter file; raises `InputError` as `parse_filter`."""
    return parse_filter(text_of(path), str(path))


def parse_filter(text: str, path: str) -> FilterFile:
    """A filter from the text of its file.

    Parameters
    ----------
    text : str
        TOML, of which nothing is executed.
    path : str
        Said in errors; a noise file that it names is looked for beside it.

    Raises
    ------
    InputError
        No TOML, another format, an unknown key, a value that is none, no model.
    """
    document = document_of(text, path, FORMAT, "filter")
    for key in document:
        if key not in KEYS:
            raise InputError(
                f"'{key}' is no part of a filter file", where=path, remedy=f"It has {', '.join(KEYS)}"
            )
    model = _text(document, "model", path)
    sensors = document.get("sensors", [])
    if not isinstance(sensors, list) or not all(isinstance(s, str) for s in sensors):
        raise InputError(
            "sensors is no list of names", where=path, remedy='Write sensors = ["gnss_position", "mag"]'
        )
    options = {k: _option(v, f"{path}: [options] {k}") for k, v in _table(document, "options", path).items()}
    limits = {k: _option(v, f"{path}: [limits] {k}") for k, v in _table(document, "limits", path).items()}
    initial = {
        k: _initial(k, v, f"{path}: [initial] {k}") for k, v in _table(document, "initial", path).items()
    }
    origin = {k: str(v) for k, v in _table(document, "provenance", path).items()}
    name = _text(document, "name", path, model)
    return FilterFile(name, model, tuple(sensors), options, limits, initial, _noise(document, path), origin)


def _text(document: Mapping[str, Any], key: str, path: str, default: str = "") -> str:
    value = document.get(key, default)
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"it has no {key}", where=path, remedy=f'Add a line like {key} = "ins15"')
    return value


def _table(document: Mapping[str, Any], key: str, path: str) -> Mapping[str, Any]:
    table = document.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"'{key}' is no table", where=path, remedy=f"Write [{key}]")
    return table


def _option(value: Any, where: str) -> str:
    """A value as ``--set`` takes it: a truth value, a text, or a list of quantities that share a dimension."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value!r}"
    if isinstance(value, str):
        return value
    if isinstance(value, list) and value and all(isinstance(v, str | int | float) for v in value):
        if all(isinstance(v, str) and re.fullmatch(r"[A-Za-z_]\w*", v) for v in value):
            return ",".join(value)
        unit = re.sub(r"^\s*[-+.\deE]+", "", str(value[0])).strip() or "1"
        numbers = [parse_quantity(v, unit, where=where) / parse_unit(unit).factor for v in value]
        return " ".join([*(f"{n:.15g}" for n in numbers), unit])
    raise InputError(f"{value!r} is no value of an option", where=where, remedy='Write it like "0.1 s"')


def _initial(name: str, entry: Any, where: str) -> Initial:
    table = entry if isinstance(entry, dict) else {"value": entry}
    if "value" not in table or set(table) - {"value", "sd"}:
        raise InputError("it has no value", where=where, remedy='Write { value = "30 deg", sd = "5 deg" }')
    unit = re.sub(r"^\s*[-+]?[.\d]+([eE][-+]?\d+)?", "", str(table["value"])).strip() or "1"
    value = parse_quantity(table["value"], "rad" if name == HEADING else unit, where=where)
    sd = parse_quantity(
        table.get("sd", 0.0), "rad" if name == HEADING else unit, where=f"{where} sd", offset=False
    )
    if sd < 0.0:
        raise InputError(
            f"sd = {table['sd']!r} is not positive", where=where, remedy="Give a positive standard deviation"
        )
    return Initial(value, sd)


def _noise(document: Mapping[str, Any], path: str) -> NoiseModel | None:
    entry = document.get("noise", {})
    if isinstance(entry, str):
        return read_noise(Path(path).parent / entry)
    if not isinstance(entry, dict):
        raise InputError(
            "noise is neither a table nor the name of a file", where=path, remedy='Write noise = "noise.toml"'
        )
    channels: dict[str, ChannelNoise] = {}
    for name, table in entry.items():
        where = f"{path}: [noise.{name}]"
        if not isinstance(table, dict):
            raise InputError("it is no table", where=where, remedy="Write its unit and its effects")
        channels[name] = read_channel(
            name, {"unit": SENSOR_UNITS.get(name.partition("_")[0], "1")} | table, where
        )
    return NoiseModel(channels) if channels else None


def filter_text(file: FilterFile) -> str:
    """A filter file as text; it reads back as the same filter."""
    lines = [f'format = "{FORMAT}"', f"name = {quoted(file.name)}", f"model = {quoted(file.model)}"]
    if file.sensors:
        lines.append(f"sensors = [{', '.join(map(quoted, file.sensors))}]")
    tables: dict[str, Mapping[str, str]] = {
        "provenance": file.provenance,
        "options": file.options,
        "limits": file.limits,
    }
    for name, table in tables.items():
        if table:
            lines += ["", f"[{name}]", *(f"{k} = {quoted(v)}" for k, v in table.items())]
    if file.initial:
        lines += ["", "[initial]"]
        lines += [f"{k} = {{ value = {i.value:.12g}, sd = {i.sd:.12g} }}" for k, i in file.initial.items()]
    for name, noise in (file.noise.channels if file.noise else {}).items():
        lines += ["", f"[noise.{name}]", f"unit = {quoted(noise.unit)}", "effects = ["]
        lines += [f"  {{ {entry_text(term, noise.unit)} }}," for term in noise.terms] + ["]"]
    return "\n".join(lines) + "\n"


def write_filter(file: FilterFile, path: str | Path) -> None:
    """Write a filter file, whole or not at all.

    Parameters
    ----------
    file : FilterFile
    path : str or Path
    """
    write_text(path, filter_text(file))


def is_filter_file(path: str | Path) -> bool:
    """Whether a file begins as a filter file does."""
    file = Path(path)
    if file.suffix != ".toml" or not file.is_file():
        return False
    return (
        re.search(rf'(?m)^\s*format\s*=\s*"{FORMAT}"', file.read_text(encoding="utf-8", errors="replace"))
        is not None
    )
