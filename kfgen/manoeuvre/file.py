"""Reads manoeuvre files: TOML, ``format = "kfgen-manoeuvre-1"``, one table ``[[segment]]`` after the other.

A value is a number [SI], a text with a unit (``"10 deg/s"``) or an expression of ``t`` and ``T`` (``"0.2*sin(t)"``),
read by the grammar of model files: nothing is executed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import sympy as sp

from kfgen.core.errors import InputError
from kfgen.core.expression import Expression, read_expression
from kfgen.core.files.toml_document import document_of, text_of
from kfgen.core.units import parse_quantity, parse_unit
from kfgen.manoeuvre.library import LIBRARY
from kfgen.manoeuvre.manoeuvre import (
    DEFAULT_LENGTH_S,
    EXPRESSION_NAMES,
    TIME,
    Manoeuvre,
    Segment,
    Triple,
    of_time,
)

FORMAT = "kfgen-manoeuvre-1"
SEGMENT_KEYS = ("duration", "start", "rate", "acceleration", "body_acceleration", "inputs")
TOP_KEYS = ("format", "name", "title", "velocity", "attitude", "segment")


def manoeuvre(name: str) -> Manoeuvre:
    """A library manoeuvre by its name, or the one of a file (``.toml``).

    Raises
    ------
    InputError
        No such manoeuvre; a file as in `parse_manoeuvre`.
    """
    if not name.endswith(".toml"):
        if name in LIBRARY:
            return LIBRARY[name]
        raise InputError(
            f"there is no manoeuvre '{name}'",
            where="--manoeuvre",
            remedy=f"Known are {', '.join(LIBRARY)}, or a manoeuvre file (.toml)",
        )
    return parse_manoeuvre(text_of(name), name)


def parse_manoeuvre(text: str, path: str) -> Manoeuvre:
    """A manoeuvre from the text of its file.

    Parameters
    ----------
    text : str
        The whole file.
    path : str
        The file's name, for error messages.

    Returns
    -------
    Manoeuvre

    Raises
    ------
    InputError
        No TOML, another format, an unknown key, segments that overlap or leave a gap, a duration that is not
        positive, a value that is no expression or not finite.
    """
    document = document_of(text, path, FORMAT, "manoeuvre")
    _keys(document, TOP_KEYS, path)
    tables = document.get("segment", [])
    if not isinstance(tables, list) or not all(isinstance(s, dict) for s in tables):
        raise InputError("'segment' is no list of tables", where=path, remedy="Write [[segment]]")
    segments: list[Segment] = []
    for k, table in enumerate(tables, 1):
        where = f"{path}: segment {k}"
        segments.append(_segment(table, where))
        _follows(table, segments, where)
    name = document.get("name", Path(path).stem)
    title = document.get("title", name)
    if not isinstance(name, str) or not isinstance(title, str):
        raise InputError("its name is no text", where=path)
    velocity = _numbers(document.get("velocity", [0, 0, 0]), "m/s", f"{path}: velocity")
    angles = _numbers(document.get("attitude", [0, 0, 0]), "rad", f"{path}: attitude")
    return Manoeuvre(name, title, tuple(segments), velocity, quaternion(*angles), path=path)


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """``q_nb`` of roll, pitch and yaw: body axes to navigation axes, turned about z, then y, then x.

    Parameters
    ----------
    roll, pitch, yaw : float
        Euler angles [rad].

    Returns
    -------
    tuple of 4 float
        Scalar first, of unit norm up to rounding.
    """
    (cr, sr), (cp, sq), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sq * sy,
        sr * cp * cy - cr * sq * sy,
        cr * sq * cy + sr * cp * sy,
        cr * cp * sy - sr * sq * cy,
    )


def _keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            raise InputError(
                f"'{key}' is no part of a manoeuvre", where=where, remedy=f"Known are {', '.join(known)}"
            )


def _segment(table: Mapping[str, Any], where: str) -> Segment:
    _keys(table, SEGMENT_KEYS, where)
    if "duration" not in table:
        raise InputError("it has no duration", where=where, remedy='Write duration = "20 s"')
    duration = value(table["duration"], "s", f"{where} duration")
    if TIME in duration.value.free_symbols:
        raise InputError("a duration cannot depend on t", where=f"{where} duration", remedy="Write it in T")
    seconds = float(of_time(duration, DEFAULT_LENGTH_S))
    if not (math.isfinite(seconds) and seconds > 0.0):
        raise InputError(
            f"a duration of {seconds:g} s is none", where=f"{where} duration", remedy="Give a positive one"
        )
    inputs = table.get("inputs", {})
    if not isinstance(inputs, dict):
        raise InputError("'inputs' is no table", where=where, remedy='Write inputs = { u = "sin(t)" }')
    return Segment(
        duration,
        _triple(table, "rate", "rad/s", where),
        _triple(table, "acceleration", "m/s^2", where),
        _triple(table, "body_acceleration", "m/s^2", where),
        {n: value(v, "", f"{where} inputs {n}") for n, v in inputs.items()},
    )


def _follows(table: Mapping[str, Any], segments: list[Segment], where: str) -> None:
    """A start, where one is given, must be the end of the segments before."""
    if "start" not in table:
        return
    given = value(table["start"], "s", f"{where} start")
    if TIME in given.value.free_symbols:
        raise InputError("a start cannot depend on t", where=f"{where} start", remedy="Write it in T")
    start = float(of_time(given, DEFAULT_LENGTH_S))
    before = sum(s.lasts(DEFAULT_LENGTH_S) for s in segments[:-1])
    if abs(start - before) > 1e-9 * max(1.0, before):
        what = "overlaps the segment before" if start < before else "leaves a gap to the segment before"
        raise InputError(
            f"it starts at {start:g} s and {what}, which ends at {before:g} s",
            where=where,
            remedy="Leave start out, or correct the durations",
        )


def _triple(table: Mapping[str, Any], key: str, unit: str, where: str) -> Triple:
    entries = table.get(key, [0, 0, 0])
    if not isinstance(entries, list) or len(entries) != 3:
        raise InputError(
            f"'{key}' is no list of three", where=where, remedy=f'Write {key} = ["0", "0", "1 {unit}"]'
        )
    x, y, z = (value(e, unit, f"{where} {key} {axis}") for e, axis in zip(entries, ("1", "2", "3")))
    return x, y, z


def _numbers(entries: Any, unit: str, where: str) -> tuple[float, float, float]:
    if not isinstance(entries, list) or len(entries) != 3:
        raise InputError("it is no list of three", where=where)
    x, y, z = (parse_quantity(e, unit, where=where) for e in entries)
    return x, y, z


def value(entry: Any, unit: str, where: str) -> Expression:
    """A value of a file: a number [SI], a text with a unit, or an expression.

    Parameters
    ----------
    entry : float or str
        As the file has it.
    unit : str
        The unit whose dimension is wanted; empty where the value is an expression in SI.
    where : str
        File, segment and key, for error messages.

    Returns
    -------
    Expression
        In SI.

    Raises
    ------
    InputError
        It is none of these, or not finite.
    """
    if isinstance(entry, bool) or not isinstance(entry, int | float | str):
        raise InputError(f"expected a number or a text, found {entry!r}", where=where)
    text = str(entry)
    if not isinstance(entry, str) and not math.isfinite(entry):
        raise InputError(f"{text} is not finite", where=where)
    try:
        return read_expression(text, EXPRESSION_NAMES, where)
    except InputError as formula:
        if not unit:
            raise
        try:
            number = parse_quantity(entry, parse_unit(unit).si, where=where)
        except InputError as quantity:
            raise (quantity if text.strip()[:1].isdigit() else formula) from None
        return Expression(text, sp.Float(repr(number), 17))
