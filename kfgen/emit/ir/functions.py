"""Functions from sums, products, divisions, square roots and rounding: the same bits on every core.

No library's sine is called, for libraries differ in the last bit. Arguments are reduced with the period in
parts [1]_, then power series are summed to double precision.

References
----------
.. [1] W. J. Cody, W. Waite, Software Manual for the Elementary Functions, 1980, ch. 8.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from kfgen.emit.ir.ir import Bin, Expr, Num, Una, add, mul, sub

Let = Callable[[Expr], Expr]
"""Makes a local of a value."""

PI_PARTS = (3.140625, 9.67502593994140625e-4, 1.509957990978376432e-7)
"""Pi as a sum; the first two have few bits, so that whole multiples of them are exact."""
SINE_TERMS = 11
EXPONENT_TERMS = 14
EXPONENT_SQUARINGS = 7
"""The argument is halved so often, and the value squared."""
MAX_EXPONENT = 80.0
"""Arguments of the exponential are held within plus and minus this."""
ARCTANGENT_TERMS = 9
ARCTANGENT_HALVINGS = 3
"""The angle is halved so often before its series is summed."""


def _series(x: Expr, coefficients: list[float], let: Let) -> Expr:
    """A polynomial by Horner's rule."""
    value: Expr = Num(coefficients[-1])
    for c in reversed(coefficients[:-1]):
        value = let(add(Num(c), mul(value, x)))
    return value


def _reduced_sine(r: Expr, let: Let) -> Expr:
    """The sine of an angle within half a turn of zero."""
    s = let(mul(r, r))
    coefficients = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(SINE_TERMS)]
    return let(mul(r, _series(s, coefficients, let)))


def _parity(k: Expr, let: Let) -> Expr:
    """``(-1)^k`` of a whole number."""
    p = let(sub(k, mul(Num(2.0), Una("rint", mul(k, Num(0.5))))))
    return let(sub(Num(1.0), mul(Num(2.0), mul(p, p))))


def _less(x: Expr, k: Expr, let: Let) -> Expr:
    """``x - k pi``."""
    for part in PI_PARTS:
        x = let(Bin("-", x, Bin("*", k, Num(part))))
    return x


def sine(x: Expr, let: Let) -> Expr:
    """``sin x``.

    Parameters
    ----------
    x : Expr
        The argument, an atom.
    let : Let
        Makes a local of a value.
    """
    k = let(Una("rint", mul(x, Num(1.0 / math.pi))))
    return mul(_parity(k, let), _reduced_sine(_less(x, k, let), let))


def cosine(x: Expr, let: Let) -> Expr:
    """``cos x``: the sine about the nearest odd quarter.

    Parameters
    ----------
    x : Expr
        The argument, an atom.
    let : Let
        Makes a local of a value.
    """
    k = let(Una("rint", sub(mul(x, Num(1.0 / math.pi)), Num(0.5))))
    half = let(add(k, Num(0.5)))
    return mul(Una("neg", _parity(k, let)), _reduced_sine(_less(x, half, let), let))


def tangent(x: Expr, let: Let) -> Expr:
    """``tan x``.

    Parameters
    ----------
    x : Expr
        The argument, an atom.
    let : Let
        Makes a local of a value.
    """
    return Bin("/", let(sine(x, let)), let(cosine(x, let)))


def exponential(x: Expr, let: Let) -> Expr:
    """``exp x``, the argument held within +-`MAX_EXPONENT`.

    Parameters
    ----------
    x : Expr
        The argument, an atom.
    let : Let
        Makes a local of a value.
    """
    largest = Num(MAX_EXPONENT)
    above, below = let(Una("abs", let(add(x, largest)))), let(Una("abs", let(sub(x, largest))))
    held = let(mul(sub(above, below), Num(0.5 / 2.0**EXPONENT_SQUARINGS)))
    value = _series(held, [1.0 / math.factorial(k) for k in range(EXPONENT_TERMS)], let)
    for _ in range(EXPONENT_SQUARINGS):
        value = let(mul(value, value))
    return value


def hyperbolic_tangent(x: Expr, let: Let) -> Expr:
    """``tanh x``.

    Parameters
    ----------
    x : Expr
        The argument, an atom.
    let : Let
        Makes a local of a value.
    """
    e = let(exponential(let(mul(Num(-2.0), let(Una("abs", x)))), let))
    return mul(Una("sign", x), Bin("/", sub(Num(1.0), e), add(Num(1.0), e)))


def arctangent(x: Expr, let: Let) -> Expr:
    """``atan x``: the angle is halved until its series is short.

    Parameters
    ----------
    x : Expr
        The argument, an atom.
    let : Let
        Makes a local of a value.
    """
    for _ in range(ARCTANGENT_HALVINGS):
        root = let(Una("sqrt", let(add(Num(1.0), mul(x, x)))))
        x = let(Bin("/", x, add(Num(1.0), root)))
    s = let(mul(x, x))
    coefficients = [(-1.0) ** k / (2 * k + 1) for k in range(ARCTANGENT_TERMS)]
    return mul(Num(2.0**ARCTANGENT_HALVINGS), let(mul(x, _series(s, coefficients, let))))


def arctangent2(y: Expr, x: Expr, let: Let) -> Expr:
    """``atan2(y, x)``: the angle of ``(|x|, y)`` by its half, mirrored where x is negative.

    Parameters
    ----------
    y : Expr
        The argument, an atom.
    x : Expr
        The argument, an atom.
    let : Let
        Makes a local of a value.
    """
    size = let(Una("abs", x))
    length = let(Una("sqrt", let(add(mul(x, x), mul(y, y)))))
    near = let(mul(Num(2.0), arctangent(let(Bin("/", y, let(add(length, size)))), let)))
    side = let(Una("sign", x))
    above = let(Una("sign", let(add(Una("sign", y), Num(0.5)))))
    far = let(mul(let(mul(let(sub(Num(1.0), side)), Num(0.5 * math.pi))), above))
    return add(mul(side, near), far)
