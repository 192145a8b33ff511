"""The grammar of units: recursive descent over a unit's text, with exponents as fractions."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction

from kfgen.core.errors import InputError
from kfgen.core.unit_names import BASE_UNITS, PREFIX_FACTORS, SI_NAMES, TYPED_SIGNS, UNIT_NAMES

MAX_EXPONENT = 1000
"""Of a part of a unit; also of its denominator."""
MAX_EXPONENT_DIGITS = 12
"""Digits in which an exponent is written."""
_TOKEN = re.compile(r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)|([A-Za-z%]+)|([/*^()]))")
_NEGATIVE = re.compile(r"-\d+")

_ROOT = re.compile("\N{SQUARE ROOT}([A-Za-z]+)")


@dataclass(frozen=True)
class Unit:
    """A unit: ``SI value = factor * value + offset``.

    Parameters
    ----------
    text : str
        As written by the user.
    factor : float
        Factor to SI.
    exponents : tuple of Fraction, length 7
        Exponents of `BASE_UNITS`.
    offset : float
        Added after scaling; only ``degC`` alone has one.
    """

    text: str
    factor: float
    exponents: tuple[Fraction, ...]
    offset: float = 0.0

    def same_dimension(self, other: Unit) -> bool:
        """Whether the two units measure the same kind of quantity."""
        return self.exponents == other.exponents

    @property
    def si(self) -> str:
        """The coherent SI unit of the same dimension, as text."""
        up: list[str] = []
        down: list[str] = []
        for base, exponent in zip(BASE_UNITS, self.exponents, strict=True):
            if exponent:
                power = abs(exponent)
                term = base if power == 1 else f"{base}^{_number(power)}"
                (up if exponent > 0 else down).append(term)
        if not up and down == ["s"]:
            return "Hz"
        text = "/".join(["*".join(up) or "1", *down])
        return SI_NAMES.get(text, text)


def _number(value: Fraction) -> str:
    return str(value.numerator) if value.denominator == 1 else f"{float(value):g}"


def typed(text: str) -> str:
    """A unit's text in the letters of the grammar."""
    for sign, plain in TYPED_SIGNS:
        text = text.replace(sign, plain)
    return _ROOT.sub(r"sqrt(\1)", text).strip()


class UnitParser:
    """Recursive descent over one unit text."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens: list[str] = []
        position, stripped = 0, typed(text)
        while position < len(stripped):
            last = self.peek_last()
            negative = _NEGATIVE.match(stripped, position) if last == "^" or last.isalpha() else None
            match = negative or _TOKEN.match(stripped, position)
            if match is None:
                raise self.error(f"cannot be read at '{stripped[position:]}'")
            if last.isalpha() and (negative or (match.group(1) and position == match.start(1))):
                self.tokens.append("^")  # m/s2 is m/s^2, as many write it
            self.tokens.append(match.group(0).strip())
            position = match.end()

    def error(self, what: str) -> InputError:
        """The error for this text."""
        return InputError(
            f"the unit '{self.text}' {what}",
            remedy="Write units like 'deg/s', 'm/s^2', 'mg/sqrt(Hz)', 'deg/sqrt(h)' or 'g/16384'",
        )

    def peek_last(self) -> str:
        """The last token that was read, empty at the beginning."""
        return self.tokens[-1] if self.tokens else ""

    def peek(self) -> str:
        """The next token, empty at the end."""
        return self.tokens[0] if self.tokens else ""

    def take(self, expected: str = "") -> str:
        """Consume a token."""
        if not self.tokens or (expected and self.tokens[0] != expected):
            raise self.error(f"misses a '{expected}'" if expected else "ends too early")
        return self.tokens.pop(0)

    def product(self) -> Unit:
        """Factors with signs between them."""
        result = self.power()
        while self.tokens and self.peek() != ")":
            sign = 1
            if self.peek() in ("/", "*"):
                sign = -1 if self.take() == "/" else 1
            result = _multiply(result, self.power(), sign)
        return result

    def power(self) -> Unit:
        """An atom with its exponent."""
        unit = self.atom()
        if self.peek() == "^":
            self.take()
            unit = _raise(unit, self.exponent())
        return unit

    def exponent(self) -> Fraction:
        """A number, or a fraction in brackets."""
        bracket = self.peek() == "("
        if bracket:
            self.take("(")
        token = self.take()
        try:
            value = _exponent(token)
            if bracket and self.peek() == "/":
                self.take("/")
                value /= _exponent(self.take())
        except (ValueError, ZeroDivisionError):
            raise self.error(f"has the exponent '{token}', which is no number") from None
        if bracket:
            self.take(")")
        return value

    def atom(self) -> Unit:
        """A bracket, a root, a number or a name."""
        token = self.take()
        if token == "(":
            unit = self.product()
            self.take(")")
            return unit
        if token == "sqrt":
            self.take("(")
            unit = self.product()
            self.take(")")
            return _raise(unit, Fraction(1, 2))
        if token[0].isdigit() or token[0] == ".":
            value = float(token)
            if not (math.isfinite(value) and value > 0.0):
                raise self.error(f"has the factor {token}, which is not positive")
            return Unit(token, value, (Fraction(0),) * len(BASE_UNITS))
        return self.name(token)

    def name(self, token: str) -> Unit:
        """A unit with or without a prefix."""
        for split in (0, 1):
            prefix, root = token[:split], token[split:]
            if root in UNIT_NAMES and prefix in PREFIX_FACTORS and (not prefix or UNIT_NAMES[root][2]):
                factor, powers, _ = UNIT_NAMES[root]
                exponents = tuple(Fraction(powers.get(base, 0)) for base in BASE_UNITS)
                return Unit(token, PREFIX_FACTORS[prefix] * factor, exponents)
        raise self.error(f"has the unknown part '{token}'")


def _exponent(token: str) -> Fraction:
    """An exponent; one of a hundred million digits would take as many to be raised."""
    value = float(token)
    if not abs(value) <= MAX_EXPONENT or "e" in token.lower() or len(token) > MAX_EXPONENT_DIGITS:
        raise ValueError
    return Fraction(token)


def _multiply(a: Unit, b: Unit, sign: int) -> Unit:
    exponents = tuple(x + sign * y for x, y in zip(a.exponents, b.exponents, strict=True))
    return Unit("", a.factor * b.factor**sign, exponents)


def _raise(unit: Unit, power: Fraction) -> Unit:
    exponents = tuple(x * power for x in unit.exponents)
    if any(abs(x) > MAX_EXPONENT or x.denominator > MAX_EXPONENT for x in exponents):
        raise OverflowError
    return Unit("", unit.factor ** float(power), exponents)
