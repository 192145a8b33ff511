"""`Expression`: a formula of a model or manoeuvre file, read into sympy by a small grammar without eval.

``sum = product (("+" | "-") product)*``, ``product = signed (("*" | "/") signed)*``,
``signed = ("+" | "-") signed | power``, ``power = atom ("**" signed)?``,
``atom = number | name | function "(" sum ("," sum)* ")" | "(" sum ")"``.
The reader builds symbols and operations itself: nothing of a file is ever executed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import sympy as sp

from kfgen.core.errors import InputError

MAX_FORMULA_CHARACTERS = 2000
"""Characters of a formula."""
MAX_NESTING_LEVELS = 60
"""Brackets, signs and powers inside each other."""
MAX_EXPONENT = 20
"""The largest exponent that is a number."""
MAX_INTEGER_DIGITS = 15
"""Digits up to which a whole number stays one."""

_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<sign>\*\*|[-+*/(),])"
)

# name: (in symbols, in numbers, arguments at least, at most)
_FUNCTIONS: dict[str, tuple[Callable[..., Any], Callable[..., float], int, int]] = {
    "sin": (sp.sin, math.sin, 1, 1),
    "cos": (sp.cos, math.cos, 1, 1),
    "tan": (sp.tan, math.tan, 1, 1),
    "asin": (sp.asin, math.asin, 1, 1),
    "acos": (sp.acos, math.acos, 1, 1),
    "atan": (sp.atan, math.atan, 1, 1),
    "atan2": (lambda y, x: sp.atan2(y, x, evaluate=False), math.atan2, 2, 2),
    "exp": (sp.exp, math.exp, 1, 1),
    "log": (sp.log, math.log, 1, 1),
    "sqrt": (sp.sqrt, math.sqrt, 1, 1),
    "abs": (sp.Abs, abs, 1, 1),
    "sign": (sp.sign, lambda x: float((x > 0) - (x < 0)), 1, 1),
    "min": (lambda *a: sp.Min(*a, evaluate=False), min, 2, 8),
    "max": (lambda *a: sp.Max(*a, evaluate=False), max, 2, 8),
    "tanh": (sp.tanh, math.tanh, 1, 1),
}

FUNCTIONS = tuple(_FUNCTIONS)
"""Names of the functions that a formula may use."""


@dataclass(frozen=True)
class Expression:
    """A formula: as written, and in symbols.

    Parameters
    ----------
    text : str
    value : sympy expression
        In real symbols of the names that it uses; everything in it is SI.
    """

    text: str
    value: sp.Expr

    @property
    def names(self) -> frozenset[str]:
        """The names on which the value depends."""
        return frozenset(s.name for s in self.value.free_symbols)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    column: int


def symbol(name: str) -> sp.Symbol:
    """The symbol of a name of a model."""
    return sp.Symbol(name, real=True)


def read_expression(text: str, names: Iterable[str], where: str = "") -> Expression:
    """Read a formula.

    Parameters
    ----------
    text : str
        For example ``"-g_over_l*sin(theta) + 25.0*u"``.
    names : iterable of str
        The names that it may use.
    where : str
        File, table and key, for error messages.

    Returns
    -------
    Expression

    Raises
    ------
    InputError
        It is no formula of the grammar, uses an unknown name or function, or is too long, too deep
        or beyond any number; the column is said.
    """
    reader = _Reader(text, {n: symbol(n) for n in names}, where)
    value = reader.whole()
    return Expression(text.strip(), value)


class _Reader:
    """Recursive descent over one formula."""

    def __init__(self, text: str, names: dict[str, sp.Symbol], where: str) -> None:
        self.names = names
        self.where = where
        self.depth = 0
        self.at = 0
        if len(text) > MAX_FORMULA_CHARACTERS:
            raise InputError(
                f"the formula has {len(text)} characters, more than {MAX_FORMULA_CHARACTERS}",
                where=where,
                remedy="Split it into states or parameters",
            )
        self.tokens = self._tokens(text)

    def _tokens(self, text: str) -> list[_Token]:
        tokens, position = [], 0
        while position < len(text):
            if text[position].isspace():
                position += 1
                continue
            match = _TOKEN.match(text, position)
            if match is None:
                remedy = "Powers are written **" if text[position] == "^" else ""
                raise self._error(f"'{text[position]}' is no part of a formula", position + 1, remedy)
            tokens.append(_Token(str(match.lastgroup), match.group(), position + 1))
            position = match.end()
        return [*tokens, _Token("end", "", len(text) + 1)]

    def _error(self, what: str, column: int, remedy: str = "") -> InputError:
        where = f"{self.where}, column {column}" if self.where else f"column {column}"
        return InputError(what, where=where, remedy=remedy)

    def _expected(self, wanted: str) -> InputError:
        token = self.peek
        found = f"'{token.text}'" if token.text else "the end"
        return self._error(f"expected {wanted}, found {found}", token.column)

    @property
    def peek(self) -> _Token:
        """The next token."""
        return self.tokens[self.at]

    def take(self, *texts: str) -> _Token | None:
        """Consume the next token if it is one of these signs."""
        token = self.peek
        if token.kind == "sign" and token.text in texts:
            self.at += 1
            return token
        return None

    def whole(self) -> sp.Expr:
        """The formula, to its end."""
        value = self.sum()
        if self.peek.kind != "end":
            raise self._expected("an operator or the end")
        return self._checked(value)

    def sum(self) -> sp.Expr:
        """Terms with signs between them."""
        value = self.product()
        while token := self.take("+", "-"):
            other = self.product()
            value = value + other if token.text == "+" else value - other
        return value

    def product(self) -> sp.Expr:
        """Factors with ``*`` and ``/`` between them."""
        value = self.signed()
        while token := self.take("*", "/"):
            other = self.signed()
            if token.text == "/" and other.is_zero:
                raise self._error("a division by zero", token.column)
            value = value * other if token.text == "*" else value / other
        return value

    def signed(self) -> sp.Expr:
        """A power with signs before it."""
        self.depth += 1
        if self.depth > MAX_NESTING_LEVELS:
            raise self._error(
                f"it is nested deeper than {MAX_NESTING_LEVELS}", self.peek.column, "Simplify it"
            )
        if token := self.take("+", "-"):
            value = self.signed()
            value = -value if token.text == "-" else value
        else:
            value = self.power()
        self.depth -= 1
        return value

    def power(self) -> sp.Expr:
        """An atom with its exponent."""
        base = self.atom()
        token = self.take("**")
        if token is None:
            return base
        exponent = self.signed()
        if not exponent.is_number:
            return base**exponent
        e = float(exponent)
        if abs(e) > MAX_EXPONENT:
            raise self._error(f"an exponent of {e:g} is beyond {MAX_EXPONENT}", token.column)
        if base.is_number:
            return self._folded(lambda x: x**e, [base], token)
        return base ** (sp.Rational(round(2 * e), 2) if (2 * e).is_integer() else exponent)

    def atom(self) -> sp.Expr:
        """A number, a name, a function's value or a bracket."""
        token = self.peek
        if self.take("("):
            value = self.sum()
            self._close()
            return value
        if token.kind == "number":
            self.at += 1
            return self._number(token)
        if token.kind == "name":
            self.at += 1
            return self._named(token)
        raise self._expected("a number, a name or '('")

    def _close(self) -> None:
        if not self.take(")"):
            raise self._expected("')'")

    def _number(self, token: _Token) -> sp.Expr:
        if token.text.isdigit() and len(token.text) <= MAX_INTEGER_DIGITS:
            return sp.Integer(int(token.text))
        value = float(token.text)
        if not math.isfinite(value):
            raise self._error(f"'{token.text}' is beyond any number", token.column)
        return sp.Float(value)

    def _named(self, token: _Token) -> sp.Expr:
        name = token.text
        if name in self.names:
            return self.names[name]
        if name not in _FUNCTIONS:
            known = ", ".join(self.names) or "no names"
            raise self._error(
                f"'{name}' is not known", token.column, f"Known are {known}; functions {', '.join(FUNCTIONS)}"
            )
        if not self.take("("):
            raise self._expected(f"'(' after {name}")
        arguments = [self.sum()]
        while self.take(","):
            arguments.append(self.sum())
        self._close()
        symbolic, numeric, least, most = _FUNCTIONS[name]
        if not least <= len(arguments) <= most:
            wanted = f"{least}" if least == most else f"{least} to {most}"
            raise self._error(f"{name} takes {wanted} arguments, not {len(arguments)}", token.column)
        if all(a.is_number for a in arguments):
            return self._folded(numeric, arguments, token)
        return symbolic(*arguments)

    def _folded(self, function: Callable[..., Any], arguments: list[sp.Expr], token: _Token) -> sp.Expr:
        """A function of numbers, computed as a double."""
        try:
            value = function(*(float(a) for a in arguments))
            good = isinstance(value, float | int) and math.isfinite(value)
        except (ValueError, OverflowError, ZeroDivisionError):
            good = False
        if not good:
            raise self._error("its value is no number", token.column)
        whole = float(value).is_integer() and abs(value) < 10**MAX_INTEGER_DIGITS
        return sp.Integer(round(value)) if whole else sp.Float(value)

    def _checked(self, value: sp.Expr) -> sp.Expr:
        """The formula, if all its numbers and powers are within reason."""
        if value.has(sp.zoo, sp.nan, sp.oo, -sp.oo, sp.I):
            raise InputError("its value is no real number", where=self.where)
        for number in value.atoms(sp.Number):
            try:
                finite = math.isfinite(float(number))
            except OverflowError:
                finite = False
            if not finite:
                raise InputError("a number in it is beyond any", where=self.where)
        for power in value.atoms(sp.Pow):
            if power.exp.is_number and abs(float(power.exp)) > MAX_EXPONENT:
                raise InputError(
                    f"an exponent of {float(power.exp):g} is beyond {MAX_EXPONENT}", where=self.where
                )
        return value
