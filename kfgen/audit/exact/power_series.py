"""`Runner`: F and H along a motion are power series of time; these are worked out in a ring, one order after the other.

It does the operations of a straight-line form. An operation knows coefficient k of its result from the coefficients up to k of its operands and from its own earlier
ones (``e' = u' e`` for the exponential, and so on), so solutions of differential equations are written down in order.

References
----------
.. [1] D. E. Knuth, The Art of Computer Programming 2, 3rd ed., 1997, sec. 4.7.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from operator import mul

import sympy as sp

from kfgen.audit.exact.padic import Ring
from kfgen.core.straight_line import CONSTANT, Rewrites, Writer, as_written

Coefficients = list[int]
Step = Callable[[int], int]
"""Coefficient k from those before."""
REWRITES: Rewrites = {
    sp.tan: lambda u: sp.sin(u) / sp.cos(u),
    sp.acos: lambda u: -sp.asin(u),  # but for a constant
    sp.atan2: lambda y, x: sp.atan(y / x),  # but for a constant
    sp.Pow: lambda base, exponent: sp.exp(exponent * sp.log(base), evaluate=False),
    sp.Abs: lambda u: u,
    sp.sign: lambda u: sp.Integer(1),
    sp.Min: lambda a, *_: a,
    sp.Max: lambda a, *_: a,
}
"""Functions by those that have a step of their own; of absolute values and extrema one of their smooth branches."""


def exact_writer(variables: Sequence[sp.Symbol]) -> Writer:
    """A writer of operations that a `Runner` can do: numbers are fractions."""
    return Writer(variables, as_written, REWRITES)


class Runner:
    """Operations on power series in a ring.

    Parameters
    ----------
    writer : Writer
        Of `exact_writer`; operations that it writes later are not run.
    ring : Ring
    given : sequence of list of int
        Coefficients of the variables; lists that others may lengthen while the runner steps.
    """

    def __init__(self, writer: Writer, ring: Ring, given: Sequence[Coefficients]) -> None:
        self.ring = ring
        self.series: list[Coefficients] = [*given]
        self._steps: list[tuple[Coefficients, Step]] = []
        for name, operands, value in writer.operations[len(given) :]:
            out: Coefficients = []
            if name == CONSTANT:
                step = _constant(ring.of(Fraction(value)))
            else:
                step = _OPERATIONS[name](ring, out, *(self.series[p] for p in operands))
            self.series.append(out)
            self._steps.append((out, step))

    def step(self, k: int) -> None:
        """Coefficient k of everything; the variables must have theirs."""
        for out, step in self._steps:
            out.append(step(k) % self.ring.m)


def convolved(a: Coefficients, b: Coefficients, k: int, first: int = 0) -> int:
    """``sum_j a_j b_(k-j)`` for j from `first` to k, or to the last that a has.

    Parameters
    ----------
    a : list of int
        Coefficients.
    b : list of int
        Coefficients, up to order ``k - first`` at least.
    k : int
        The order of the sum.
    first : int
        Zero, or one to leave out ``a_0``.
    """
    return sum(map(mul, a[first : k + 1], b[k - first :: -1])) if k >= first else 0


def _slope(a: Coefficients, b: Coefficients, k: int) -> int:
    """``k`` times coefficient k of the integral of ``a' b``."""
    return sum(j * a[j] * b[k - j] for j in range(1, k + 1) if a[j])


def _start(ring: Ring, name: str, u: int) -> int:
    """A function's value at a residue: by its series about zero where that converges, else a generic number.

    Distinct points get independent numbers, which is true of almost every point.
    """
    if u == 0:
        return int(name in ("cos", "exp"))
    if u % ring.p == 0 and name in _ANALYTIC:
        series: Coefficients = []
        step = _OPERATIONS[name](ring, series, [0, 1, *[0] * ring.digits])
        for k in range(ring.digits):
            series.append(step(k) % ring.m)
        return sum(c * pow(u, k, ring.m) for k, c in enumerate(series)) % ring.m
    size = ring.digits * 4 + 8
    return int.from_bytes(hashlib.shake_256(f"{name} {u}".encode()).digest(size), "big") % ring.m


_ANALYTIC = frozenset(("sin", "cos", "exp", "atan", "asin", "tanh"))
"""At zero."""


def _constant(c: int) -> Step:
    return lambda k: 0 if k else c


def _over(ring: Ring, out: Coefficients, above: Step, b: Coefficients) -> Step:
    """``above / b``."""
    first: list[int] = []

    def step(k: int) -> int:
        if not k:
            first.append(ring.inverse(b[0]))
        return first[0] * (above(k) - convolved(b, out, k, 1))

    return step


def _sqrt(ring: Ring, out: Coefficients, a: Coefficients) -> Step:
    """``y y = a``."""
    return lambda k: (a[k] - convolved(out, out, k, 1)) * ring.inverse(2 * out[0]) if k else ring.sqrt(a[0])


def _on_circle(ring: Ring, u: Coefficients, which: int) -> Step:
    """Sine (0) or cosine (1), each the other's derivative."""
    s: Coefficients = []
    c: Coefficients = []

    def step(k: int) -> int:
        over = ring.inverse(k) if k else 0
        pair = (_slope(u, c, k) * over, -_slope(u, s, k) * over) if k else _start_on_circle(ring, u[0])
        for series, value in zip((s, c), pair):
            series.append(value % ring.m)
        return (s, c)[which][k]

    return step


def _start_on_circle(ring: Ring, u: int) -> tuple[int, int]:
    """Sine and cosine of a residue: exact where their series converge, else a generic point of the circle."""
    if u == 0:
        return 0, 1
    if u % ring.p == 0:
        return _start(ring, "sin", u), _start(ring, "cos", u)
    h = _start(ring, "half", u)
    below = ring.inverse(1 + h * h)
    return 2 * h * below % ring.m, (1 - h * h) * below % ring.m


def _exp(ring: Ring, out: Coefficients, u: Coefficients) -> Step:
    """``y' = u' y``."""
    return lambda k: _slope(u, out, k) * ring.inverse(k) if k else _start(ring, "exp", u[0])


def _tanh(ring: Ring, out: Coefficients, u: Coefficients) -> Step:
    """``y' = u' (1 - y^2)``."""
    w: Coefficients = []

    def step(k: int) -> int:
        if not k:
            return _start(ring, "tanh", u[0])
        w.append((k == 1) - convolved(out, out, k - 1))
        return _slope(u, w, k) * ring.inverse(k)

    return step


def _quotient(ring: Ring, out: Coefficients, u: Coefficients, start: Step, w: Step) -> Step:
    """``y' = u' / w`` from a start, given the coefficients of w in order."""
    below: Coefficients = []

    def step(k: int) -> int:
        below.append(w(k) % ring.m)
        if not k:
            return start(u[0])
        inner = sum(j * out[j] * below[k - j] for j in range(1, k))
        return (u[k] - inner * ring.inverse(k)) * ring.inverse(below[0])

    return step


def _log(ring: Ring, out: Coefficients, u: Coefficients) -> Step:
    return _quotient(ring, out, u, lambda a: _start(ring, "log", a) if a != 1 else 0, u.__getitem__)


def _atan(ring: Ring, out: Coefficients, u: Coefficients) -> Step:
    return _quotient(ring, out, u, lambda a: _start(ring, "atan", a), lambda k: (k == 0) + convolved(u, u, k))


def _asin(ring: Ring, out: Coefficients, u: Coefficients) -> Step:
    square: Coefficients = []
    w: Coefficients = []
    root = _sqrt(ring, w, square)

    def below(k: int) -> int:
        square.append((k == 0) - convolved(u, u, k))
        w.append(root(k) % ring.m)
        return w[k]

    return _quotient(ring, out, u, lambda a: _start(ring, "asin", a), below)


_OPERATIONS: Mapping[str, Callable[..., Step]] = {
    "neg": lambda ring, out, a: lambda k: -a[k],
    "add": lambda ring, out, a, b: lambda k: a[k] + b[k],
    "sub": lambda ring, out, a, b: lambda k: a[k] - b[k],
    "mul": lambda ring, out, a, b: lambda k: convolved(a, b, k),
    "div": lambda ring, out, a, b: _over(ring, out, a.__getitem__, b),
    "inv": lambda ring, out, b: _over(ring, out, _constant(1), b),
    "sqrt": _sqrt,
    "sin": lambda ring, out, u: _on_circle(ring, u, 0),
    "cos": lambda ring, out, u: _on_circle(ring, u, 1),
    "exp": _exp,
    "log": _log,
    "atan": _atan,
    "asin": _asin,
    "tanh": _tanh,
}
"""By name: the ring, the coefficients of the result that are known, those of the operands; gives the step."""
