"""Units: read from text as people type them, converted to SI and back, by an exact algebra of dimensions.

A unit is a factor to SI and rational exponents of the base units, read by the
grammar ``factor (("/" | "*" | " ") factor)*`` with ``factor`` a name or a number with
an optional ``^exponent``, ``sqrt(unit)`` or ``(unit)``. So ``deg/s/sqrt(Hz)``,
``deg/s^2/sqrt(Hz)``, ``deg/s^1.5``, ``g/16384`` and ``deg/sqrt(h)`` are all read, and
equal units compare equal. So are the signs that people type: ``m/s2``, ``m/s²``, ``°/s``, ``µT``, ``°/√h``. The
radian is kept as a base unit, so that an angle is not taken for a number.

References
----------
.. [1] BIPM, The International System of Units, 9th ed., 2019.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

from kfgen.core.errors import InputError
from kfgen.core.unit_grammar import Unit, UnitParser, typed
from kfgen.core.unit_names import (
    BASE_UNITS,
    STANDARD_GRAVITY,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "STANDARD_GRAVITY",
    "Unit",
    "derived_unit",
    "display_unit",
    "from_si",
    "parse_quantity",
    "parse_unit",
    "to_si",
]

Real = TypeVar("Real", float, "NDArray[np.float64]")
"""A number, or an array of them."""

MAX_QUANTITY = 1e75
"""Largest size [SI] of a quantity in a file: its fourth power is still a number."""
MAX_UNIT_LETTERS = 500
"""Letters of a unit's text."""


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """Read a unit.

    Parameters
    ----------
    text : str
        For example ``"deg/s/sqrt(Hz)"``; ``""`` and ``"1"`` are the pure number.

    Raises
    ------
    InputError
        The text is no unit of the grammar.
    """
    if not text.strip():
        return Unit("1", 1.0, (Fraction(0),) * len(BASE_UNITS))
    if len(text) > MAX_UNIT_LETTERS:
        raise InputError(
            f"the unit '{text[:20]}...' has {len(text)} letters", remedy="Write units like 'deg/s'"
        )
    parser = UnitParser(text)
    try:
        unit = parser.product()
    except (OverflowError, ZeroDivisionError, RecursionError):
        raise parser.error("is beyond any number") from None
    if not (math.isfinite(unit.factor) and unit.factor > 0.0):
        raise parser.error("is beyond any number")
    if parser.tokens:
        raise parser.error(f"has '{parser.peek()}' left over")
    offset = 273.15 if typed(text) == "degC" else 0.0
    return Unit(text.strip(), unit.factor, unit.exponents, offset)


QUANTITY = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?![\d.])(.*)$"
"""A quantity as text: the number, and what follows it."""


def is_unit(text: str) -> bool:
    """Whether a text is a unit.

    Parameters
    ----------
    text : str
    """
    try:
        parse_unit(text)
    except InputError:
        return False
    return True


def parse_quantity(value: object, si_unit: str, *, where: str = "", offset: bool = True) -> float:
    """Read a value of a file: a number is SI, a string carries its unit.

    Parameters
    ----------
    value : float or str
        ``0.1`` or ``"0.0035 deg/s/sqrt(Hz)"``.
    si_unit : str
        The unit whose dimension is wanted.
    where : str
        File, table and key, for the error message.
    offset : bool
        Whether a temperature in degC is a point of the scale (273.15 is added), not a difference.

    Returns
    -------
    float
        The value in the coherent SI unit.

    Raises
    ------
    InputError
        No number, no unit, a unit of another dimension, or a size whose square is beyond numbers.
    """
    wanted = parse_unit(si_unit)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(f"expected a number or a text with a unit, found {value!r}", where=where)
    if isinstance(value, int | float):
        try:
            number, unit = float(value), parse_unit(wanted.si)
        except OverflowError:
            raise InputError("the number is too large", where=where) from None
    else:
        match = re.match(QUANTITY, value, re.S)
        if match is None:
            raise InputError(
                f"'{value}' does not begin with a number",
                where=where,
                remedy=f"Write it like '0.01 {si_unit}'",
            )
        number, rest = float(match.group(1)), match.group(2).strip()
        try:
            unit = parse_unit(rest) if rest else parse_unit(wanted.si)
        except InputError as error:
            raise InputError(error.what, where=where, remedy=error.remedy) from None
        if not unit.same_dimension(wanted):
            raise InputError(
                f"'{value}' has the dimension of {unit.si}, not of {si_unit}",
                where=where,
                remedy=f"Write it in {si_unit}",
            )
    result = number * unit.factor + (unit.offset if offset else 0.0)
    if not math.isfinite(result):
        raise InputError(f"{value!r} is not finite", where=where)
    if abs(result) > MAX_QUANTITY:
        raise InputError(
            f"{value!r} is {result:g} in SI, beyond anything that is measured",
            where=where,
            remedy="Check the number and its unit",
        )
    return result


def to_si(value: Real, unit: str) -> Real:
    """Convert from `unit` to SI.

    Parameters
    ----------
    value : float or ndarray
        A number, or numbers of any shape, in `unit`.
    unit : str
        As `parse_unit` reads it.

    Returns
    -------
    float or ndarray
        The same in the coherent SI unit; degC becomes K.

    Raises
    ------
    InputError
        `unit` is no unit.
    """
    parsed = parse_unit(unit)
    return value * parsed.factor + parsed.offset


def from_si(value: Real, unit: str) -> Real:
    """Convert from SI to `unit`: the inverse of `to_si`.

    Parameters
    ----------
    value : float or ndarray
        A number, or numbers of any shape, in the coherent SI unit.
    unit : str
        As `parse_unit` reads it.

    Returns
    -------
    float or ndarray
        The same in `unit`.

    Raises
    ------
    InputError
        `unit` is no unit.
    """
    parsed = parse_unit(unit)
    return (value - parsed.offset) / parsed.factor


def derived_unit(template: str, unit: str) -> str:
    """The unit of a parameter of an effect, from the unit of the channel on which the effect acts.

    Parameters
    ----------
    template : str
        The parameter's unit, in which ``U`` stands for the unit of the channel: ``"U/sqrt(Hz)"``.
    unit : str
        The unit of the channel. A temperature counts as a difference: degC is K.

    Returns
    -------
    str
        A unit that `parse_unit` reads; empty for a pure number.

    Examples
    --------
    >>> derived_unit("U/sqrt(Hz)", "deg/s")
    'deg/s/sqrt(Hz)'
    """
    unit = typed(unit)
    unit = "K" if unit == "degC" else unit  # a size of an effect is a difference
    if unit.strip() in ("", "1"):  # 1/U and U/s are no unit and 1/s
        text = re.sub(r"/\(U\)(\^[0-9.]+)?", "", re.sub(r"\bU\*", "", template))
        text = re.sub(r"(?<!sqrt)\(([^()*/]+)\)", r"\1", re.sub(r"\bU\b", "1", text))
        return "" if text == "1" else text
    plain = re.fullmatch(r"[A-Za-z%]+(/[A-Za-z]+(\^[0-9.]+)?)*", unit) is not None
    text = unit if plain else f"({unit.strip() or 1})"
    text = re.sub(r"\(\(([^()]*)\)\)", r"(\1)", re.sub(r"\bU\b", text, template))
    if "U*" in template and parse_unit(text).factor == 1.0:
        return parse_unit(text).si  # rad instead of rad/s*s
    text = re.sub(r"(?<!sqrt)\(([A-Za-z%]+)\)", r"\1", text)
    return text[1:-1] if re.fullmatch(r"\([^()]*\)", text) else text


_DISPLAYED_UNITS = {"rad/s": "deg/s", "m/s^2": "mg", "T": "uT", "K": "K", "rad": "deg"}


def display_unit(unit: str) -> str:
    """The unit in which a person reads a channel: his own, or the usual one for raw counts."""
    if re.search(r"\d", re.sub(r"\^[0-9.]+", "", unit)) or unit in ("rad/s", "g", "T"):
        return _DISPLAYED_UNITS.get(parse_unit(unit).si, parse_unit(unit).si)
    return unit
