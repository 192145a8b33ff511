"""`NoiseModel`: the effects of each channel, and the file that carries them.

The file is TOML, ``format = "kfgen-noise-1"``: a table per channel with its unit and a
list of effects whose values are texts with units. A parameter may be given by another explicit
name that its effect declares (``q`` or ``B_ieee`` for ``sigma``); it is always written by its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from kfgen.core.channel_names import some_of
from kfgen.core.errors import InputError
from kfgen.core.files.toml_document import document_of, text_of
from kfgen.core.files.whole_file import write_text
from kfgen.core.units import derived_unit, from_si, parse_quantity, parse_unit
from kfgen.effects import Effect, effect_named
from kfgen.effects.driven.proportional import is_plain
from kfgen.effects.filter_role import KNOWN, STATE, Use

FORMAT = "kfgen-noise-1"


WHITE, SAMPLED = "white_noise", "sample_noise"
"""White noise in a file; the effect that it is where ``sd`` gives its size."""
SMALL_INTERVAL = 0.1
"""Half the 95 % interval over the value up to which a filter takes a parameter for known, where the file does not say."""


@dataclass(frozen=True)
class Term:
    """An effect with the 95 % intervals [SI] of its parameters, where they are known.

    Parameters
    ----------
    effect : Effect
        With its values [SI].
    ci95 : mapping of str to (float, float)
        By parameter.
    chosen : str
        ``known`` or ``state``: what the file says of it in a filter; empty where it does not say.
    """

    effect: Effect
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    chosen: str = ""

    @property
    def use(self) -> Use:
        """How a filter takes it: as the file says, else known where every interval is small against its value."""
        sd = {n: (hi - lo) / 3.92 for n, (lo, hi) in self.ci95.items() if lo < hi}
        if self.chosen:
            return Use(self.chosen == KNOWN, sd)
        wide = [n for n, s in sd.items() if 1.96 * s > SMALL_INTERVAL * abs(float(getattr(self.effect, n)))]
        signed = set(self.effect.coefficients())
        return Use(not signed & set(wide), sd)


@dataclass(frozen=True)
class ParameterCovariance:
    """How well the sizes and times of a channel's effects are known together.

    Parameters
    ----------
    parameters : tuple of (int, str)
        Index of the effect, name of its parameter.
    matrix : tuple of rows, (k, k)
        Covariance of their logarithms: the diagonal holds squared relative standard deviations.
    """

    parameters: tuple[tuple[int, str], ...]
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class ChannelNoise:
    """The effects of one channel; `unit` is the user's unit, in which the file is written."""

    unit: str
    terms: tuple[Term, ...]
    covariance: ParameterCovariance | None = None

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects alone."""
        return tuple(term.effect for term in self.terms)

    def in_record(self, dt: float, duration: float) -> ChannelNoise:
        """The same noise in a record: a band that nobody stated is as wide as it shows, noise of a sample has a density [s]."""
        terms = tuple(replace(t, effect=t.effect.in_record(dt, duration)) for t in self.terms)
        return replace(self, terms=terms)


@dataclass(frozen=True)
class NoiseModel:
    """Effects by channel, and where they come from.

    Parameters
    ----------
    channels : mapping of str to ChannelNoise
    provenance : mapping of str to str
        For example the log's name and SHA-256, the method.
    """

    channels: Mapping[str, ChannelNoise]
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", MappingProxyType(dict(self.channels)))

    def channel(self, name: str) -> ChannelNoise:
        """The noise of a channel; raises `InputError` when the model has none of that name."""
        if name not in self.channels:
            raise InputError(
                f"the noise file has no channel '{name}'", remedy=f"It has {some_of(self.channels)}"
            )
        return self.channels[name]

    def in_record(self, dt: float, duration: float) -> NoiseModel:
        """Every channel's noise in a record of this sampling period and length [s]."""
        return replace(self, channels={k: c.in_record(dt, duration) for k, c in self.channels.items()})


def read_noise(path: str | Path) -> NoiseModel:
    """Read a noise file.

    Raises
    ------
    InputError
        No such file, no TOML, another format, an unknown effect, parameter or unit.
    """
    return parse_noise(text_of(path), str(path))


def parse_noise(text: str, path: str) -> NoiseModel:
    """A noise model from the text of its file; `path` is said in errors, as in `read_noise`."""
    document = document_of(text, path, FORMAT, "noise")
    origin = document.get("provenance", {})
    if not isinstance(origin, dict):
        raise InputError("provenance is no table", where=path)
    provenance = {k: str(v) for k, v in origin.items()}
    channels = {
        name: read_channel(name, table, f"{path}: [{name}]")
        for name, table in document.items()
        if isinstance(table, dict) and name != "provenance"
    }
    if not channels:
        raise InputError("there is no channel in it", where=path)
    return NoiseModel(channels, provenance)


def canonical(noise: NoiseModel) -> NoiseModel:
    """The model as its file says it: numbers with the digits that are written, so that hashes agree."""
    return parse_noise(noise_text(noise), "noise")


def _check_name(name: str, where: str) -> None:
    if not is_plain(name) or name in ("format", "provenance"):
        raise InputError(
            f"'{name}' cannot be a channel of a noise file",
            where=where,
            remedy="A channel's name is made of letters, digits and underscores; rename it with --columns",
        )


def read_channel(name: str, table: Mapping[str, Any], where: str) -> ChannelNoise:
    """The noise of a channel from its table (unit, effects, covariance); raises `InputError`."""
    _check_name(name, where)
    unit = table.get("unit")
    if not isinstance(unit, str):
        raise InputError("the unit is missing", where=where, remedy='Add a line like unit = "deg/s"')
    try:
        parse_unit(unit)
    except InputError as error:
        raise InputError(error.what, where=where, remedy=error.remedy) from None
    entries = table.get("effects", [])
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise InputError("effects is no list of tables", where=where)
    terms = tuple(read_term(entry, unit, where) for entry in entries)
    return ChannelNoise(unit, terms, _joint(table.get("covariance"), terms, where))


def _joint(entry: Any, terms: tuple[Term, ...], where: str) -> ParameterCovariance | None:
    """The covariance of a channel's parameters, checked."""
    if entry is None:
        return None
    wrong = InputError(
        "its covariance is no symmetric matrix of the parameters that it names",
        where=where,
        remedy='Write covariance = { of = ["0.N"], log = [[1e-6]] }, or leave it out',
    )
    if not isinstance(entry, dict) or not isinstance(entry.get("of"), list):
        raise wrong
    known = {f"{i}.{p.name}": (i, p.name) for i, t in enumerate(terms) for p in t.effect.estimated()}
    names, rows = entry["of"], entry.get("log")
    if not all(isinstance(n, str) and n in known for n in names) or len(set(names)) < len(names):
        raise wrong
    try:
        matrix = np.array(rows, dtype=np.float64).reshape(len(names), len(names))
    except (TypeError, ValueError):
        raise wrong from None
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T) or (np.diag(matrix) < 0.0).any():
        raise wrong
    return ParameterCovariance(tuple(known[n] for n in names), tuple(map(tuple, matrix.tolist())))


def read_term(entry: Mapping[str, Any], unit: str, where: str) -> Term:
    """An effect from its entry, for a channel in `unit`; raises `InputError`."""
    if not isinstance(entry.get("effect"), str):
        raise InputError("an entry does not name its effect", where=where)
    cls = effect_named(
        SAMPLED if entry["effect"] == WHITE and "sd" in entry else entry["effect"], where=where
    )
    effect = cls.read(entry, unit, f"{where} {cls.name}")
    ci95 = {}
    for p in cls.parameters():
        pair = entry.get(f"{p.name}_ci95")
        if isinstance(pair, list) and len(pair) == 2:
            lo, hi = (
                parse_quantity(v, derived_unit(p.unit, unit), where=where, offset="U" not in p.unit)
                for v in pair
            )
            ci95[p.name] = (lo, hi)
    chosen = entry.get("as", "")
    if chosen not in ("", KNOWN, STATE):
        raise InputError(
            f"as = {chosen!r} says nothing of {cls.name}",
            where=where,
            remedy=f'Write as = "{KNOWN}" (corrected by its value) or as = "{STATE}" (estimated)',
        )
    return Term(effect, ci95, chosen)


def noise_text(noise: NoiseModel) -> str:
    """The noise file as text."""
    lines = [f'format = "{FORMAT}"']
    if noise.provenance:
        lines += ["", "[provenance]"] + [f"{quoted(k)} = {quoted(v)}" for k, v in noise.provenance.items()]
    for name, channel in noise.channels.items():
        _check_name(name, "noise")
        lines += ["", f"[{name}]", f"unit = {quoted(channel.unit)}", "effects = ["]
        lines += [f"  {{ {entry_text(term, channel.unit)} }}," for term in channel.terms] + ["]"]
        if channel.covariance is not None:
            names = ", ".join(f'"{i}.{p}"' for i, p in channel.covariance.parameters)
            rows = ", ".join(f"[{', '.join(f'{v:.6g}' for v in row)}]" for row in channel.covariance.matrix)
            lines.append(f"covariance = {{ of = [{names}], log = [{rows}] }}")
    return "\n".join(lines) + "\n"


def write_noise(noise: NoiseModel, path: str | Path) -> None:
    """Write a noise file, whole or not at all."""
    write_text(path, noise_text(noise))


def entry_text(term: Term, unit: str) -> str:
    """The inside of an effect's inline table."""
    parts = [f"effect = {quoted(WHITE if term.effect.name == SAMPLED else term.effect.name)}"]
    for p in term.effect.parameters():
        text = derived_unit(p.unit, unit)
        parts.append(f"{p.name} = {valued(getattr(term.effect, p.name), text)}")
        if p.name in term.ci95:
            lo, hi = (valued(v, text) for v in term.ci95[p.name])
            parts.append(f"{p.name}_ci95 = [{lo}, {hi}]")
    if term.chosen:
        parts.append(f"as = {quoted(term.chosen)}")
    return ", ".join(parts)


def valued(value: float, unit: str) -> str:
    """An SI number as a quoted text in `unit`."""
    return quoted(f"{from_si(float(value), unit):.9g} {unit}".rstrip())


def quoted(text: str) -> str:
    """A text as TOML writes it."""
    text = text.encode("utf-8", "replace").decode("utf-8")  # lone surrogates of unusual file names
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
