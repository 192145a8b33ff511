"""`Manoeuvre`: what a body does, as body rate and acceleration in segments, each an expression of time.

An expression knows ``t``, the time since its segment began [s], ``T``, the length of the whole manoeuvre
[s], ``g``, the standard gravity [m/s^2], and ``pi``. The same expressions give arrays of numbers to the simulation
and power series to the audit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.expression import Expression, symbol
from kfgen.core.tape import tape
from kfgen.core.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

TIME, LENGTH = symbol("t"), symbol("T")
CONSTANTS: Mapping[sp.Symbol, sp.Expr] = {
    symbol("g"): sp.Rational(repr(STANDARD_GRAVITY)),
    symbol("pi"): sp.Rational(repr(float(np.pi))),
}
EXPRESSION_NAMES = ("t", "T", "g", "pi")
"""What an expression may use."""
DEFAULT_LENGTH_S = 60.0
"""Length of a manoeuvre that does not say its own [s]."""

Triple = tuple[Expression, Expression, Expression]
ZERO_TRIPLE: Triple = (Expression("0", sp.Integer(0)),) * 3


MAX_VALUE = 1e12
"""Of a rate, an acceleration or an input [SI]: nothing that moves has more."""


@dataclass(frozen=True)
class Segment:
    """A piece of a manoeuvre.

    Parameters
    ----------
    duration : Expression
        [s], of ``T``.
    rate : tuple of 3 Expression
        Body rate against the navigation frame, in body axes [rad/s].
    acceleration, body_acceleration : tuple of 3 Expression
        Rate of the velocity [m/s^2]: parts in navigation axes and in body axes, which add.
    inputs : mapping of str to Expression
        Inputs of a plant by name [SI].
    """

    duration: Expression
    rate: Triple = ZERO_TRIPLE
    acceleration: Triple = ZERO_TRIPLE
    body_acceleration: Triple = ZERO_TRIPLE
    inputs: Mapping[str, Expression] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "inputs", MappingProxyType(dict(self.inputs)))

    def formulas(self, length: float) -> tuple[sp.Expr, ...]:
        """Rate, acceleration, body acceleration (9 in all) in ``t``, for a manoeuvre of that length [s]."""
        triples = (*self.rate, *self.acceleration, *self.body_acceleration)
        return tuple(of_time(e, length) for e in triples)

    def lasts(self, length: float) -> float:
        """The duration [s]."""
        return float(of_time(self.duration, length))


def of_time(e: Expression, length: float) -> sp.Expr:
    """An expression of a manoeuvre in ``t`` alone, exact: its numbers are the fractions that they are written as.

    Parameters
    ----------
    e : Expression
        Of ``t``, ``T``, ``g`` and ``pi``.
    length : float
        Length ``T`` of the manoeuvre [s].

    Returns
    -------
    sympy expression
    """
    exact = {f: sp.Rational(repr(float(f))) for f in e.value.atoms(sp.Float)}
    return e.value.xreplace(exact).xreplace({**CONSTANTS, LENGTH: sp.Rational(repr(float(length)))})


@dataclass(frozen=True)
class Manoeuvre:
    """What a body does, from a start.

    Parameters
    ----------
    name, title : str
    segments : tuple of Segment
    velocity : tuple of 3 float
        At the start, in navigation axes [m/s].
    attitude : tuple of 4 float
        ``q_nb`` at the start, scalar first, of any length.
    usual : float
        Its length where its segments do not say their own [s].
    path : str
        The file's name, for error messages; empty for a library manoeuvre.

    Raises
    ------
    InputError
        There is no segment, or one lasts no time.
    """

    name: str
    title: str
    segments: tuple[Segment, ...]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    attitude: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    usual: float = DEFAULT_LENGTH_S
    path: str = ""

    def __post_init__(self) -> None:
        if not self.segments:
            raise InputError(
                "the manoeuvre has no segment", where=self.path or self.name, remedy="Add a table [[segment]]"
            )
        for k, segment in enumerate(self.segments, 1):
            seconds = segment.lasts(DEFAULT_LENGTH_S)
            if not (np.isfinite(seconds) and seconds > 0.0):
                raise InputError(
                    f"it lasts {seconds:g} s",
                    where=f"{self.path or self.name}: segment {k}",
                    remedy="Give it a positive duration",
                )

    @cached_property
    def length(self) -> float:
        """The length that it has by itself, or the usual one [s]."""
        if any(LENGTH in s.duration.value.free_symbols for s in self.segments):
            return self.usual
        return sum(s.lasts(DEFAULT_LENGTH_S) for s in self.segments)

    def starts(self, length: float) -> Array:
        """When the segments begin [s], and when the last ends, shape (segments + 1,)."""
        return np.concatenate([[0.0], np.cumsum([s.lasts(length) for s in self.segments])])

    def values(
        self, t: Array, length: float | None = None, start: float | None = None
    ) -> tuple[Array, Array, Array]:
        """Body rate, acceleration and body acceleration at times (n,), each (n, 3).

        After the last segment the body keeps its attitude and its velocity.

        Parameters
        ----------
        t : ndarray, shape (n,)
            [s].
        length : float, optional
            Of the manoeuvre [s], unless its segments say their own; that of the times where left out.
        start : float, optional
            When it begins [s]; the first of the times where left out.

        Returns
        -------
        rate, acceleration, body_acceleration : ndarray, shape (n, 3)
            In body axes [rad/s], navigation axes [m/s^2] and body axes [m/s^2].
        """
        length = length or (float(t[-1] - t[0]) if t.size > 1 else DEFAULT_LENGTH_S)
        since = t - (t[0] if start is None else start)
        rows = self._sampled(since, length, lambda s: s.formulas(length), 9)
        return rows[:, :3], rows[:, 3:6], rows[:, 6:]

    def input(self, name: str, t: Array) -> Array | None:
        """An input of a plant along the manoeuvre.

        Parameters
        ----------
        name : str
            The input.
        t : ndarray, shape (n,)
            Times [s]; the manoeuvre begins at the first.

        Returns
        -------
        ndarray, shape (n,), or None
            The input [SI]; None where no segment names it.

        Raises
        ------
        InputError
            A value that is not finite.
        """
        if not any(name in s.inputs for s in self.segments):
            return None
        length = float(t[-1] - t[0]) if t.size > 1 else DEFAULT_LENGTH_S
        zero = Expression("0", sp.Integer(0))
        return self._sampled(t - t[0], length, lambda s: (of_time(s.inputs.get(name, zero), length),), 1)[
            :, 0
        ]

    def _sampled(
        self, since: Array, length: float, formulas: Callable[[Segment], Sequence[sp.Expr]], count: int
    ) -> Array:
        out = np.zeros((since.size, count))
        edges = self.starts(length)
        edges[-1] += 1e-9 * max(edges[-1], 1.0) if edges[-1] >= length * (1 - 1e-12) else 0.0
        for k, segment in enumerate(self.segments):
            on = (since >= edges[k]) & (since < edges[k + 1])
            if on.any():
                with np.errstate(all="ignore"):
                    columns = tape(list(formulas(segment)), [TIME]).values([since[on] - edges[k]])
                for j, column in enumerate(columns):
                    out[on, j] = column
        bad = ~(np.abs(out) <= MAX_VALUE).all(axis=1)
        if bad.any():
            what = "value below 1e12" if np.isfinite(out).all() else "finite value"
            raise InputError(
                f"an expression has no {what} {float(since[bad][0]):g} s after the start",
                where=self.path or self.name,
                remedy="Look for a division by zero, a root of a negative number or a wrong unit",
            )
        return out


INPUT_FORMULA_ORDER = (3, 4, 5, 0, 1, 2)
"""Which of a manoeuvre's formulas drives a plant's first, second, ... input where no segment names it."""
