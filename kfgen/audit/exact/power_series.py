"""`Runner`: the operations of a straight-line form on truncated power series in a ring, one order after the other.

An operation knows coefficient k of its result from the coefficients up to k of its operands and from its own earlier
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
        self.inverse = [0]
        self.series: list[Coefficients] = [*given]
        self._steps: list[tuple[Coefficients, Step]] = []
        self._circles: dict[int, _Circle] = {}
        for name, operands, value in writer.operations[len(given) :]:
            out: Coefficients = []
            series = [self.series[p] for p in operands]
            self.series.append(out)
            if name == CONSTANT:
                step = _constant(ring.of(Fraction(value)))
            elif name in ("sin", "cos"):
                circle = self._circles.setdefault(operands[0], _Circle(self, *series))
                step = circle.sine if name == "sin" else circle.cosine
            else:
                step = _OPERATIONS[name](self, out, *series)
            self._steps.append((out, step))

    def step(self, k: int) -> None:
        """Coefficient k of everything; the variables must have theirs."""
        if len(self.inverse) <= k:
            self.inverse.append(self.ring.inverse(k) if k else 0)
        m = self.ring.m
        for out, step in self._steps:
            out.append(step(k) % m)

    def over(self, k: int, value: int) -> int:
        """``value / k``."""
        return value * self.inverse[k]

    def start(self, name: str, u: int) -> int:
        """A function's value at a residue: by its series where that converges, else a generic number.

        Distinct points get independent numbers, which is true of almost every point.
        """
        if u % self.ring.p == 0 and name in _TAYLOR:
            return self._summed(name, u)
        if u == 0:
            return 0  # the others vanish there
        seed = f"{name} {u}".encode()
        return int.from_bytes(_digest(seed, self.ring.digits * 4 + 8), "big") % self.ring.m

    def _summed(self, name: str, u: int) -> int:
        total, ring = 0, self.ring
        for k, c in enumerate(_TAYLOR[name](ring.digits + 2)):
            if c and k < ring.digits:
                total += ring.of(c) * pow(u, k, ring.m)
        return total % ring.m


def _digest(seed: bytes, size: int) -> bytes:
    return hashlib.shake_256(seed).digest(size)


def _factorials(n: int, signs: Sequence[int]) -> list[Fraction]:
    out, f = [], 1
    for k in range(n):
        f *= max(k, 1)
        out.append(Fraction(signs[k % len(signs)], f))
    return out


def _odd(n: int, sign: int) -> list[Fraction]:
    return [Fraction(sign ** ((k - 1) // 2), k) if k % 2 else Fraction(0) for k in range(n)]


_TAYLOR: Mapping[str, Callable[[int], list[Fraction]]] = {
    "sin": lambda n: _factorials(n, (0, 1, 0, -1)),
    "cos": lambda n: _factorials(n, (1, 0, -1, 0)),
    "exp": lambda n: _factorials(n, (1,)),
    "atan": lambda n: _odd(n, -1),
}


def convolved(a: Coefficients, b: Coefficients, k: int, first: int = 0) -> int:
    """``sum_j a_j b_(k-j)`` for j from `first` to k."""
    return sum(map(mul, a[first : k + 1], b[k - first :: -1])) if k >= first else 0


def _slope(a: Coefficients, b: Coefficients, k: int) -> int:
    """``k`` times coefficient k of the integral of ``a' b``."""
    return sum(j * a[j] * b[k - j] for j in range(1, k + 1) if a[j])


def _constant(c: int) -> Step:
    return lambda k: 0 if k else c


def _neg(r: Runner, out: Coefficients, a: Coefficients) -> Step:
    return lambda k: -a[k]


def _add(r: Runner, out: Coefficients, a: Coefficients, b: Coefficients) -> Step:
    return lambda k: a[k] + b[k]


def _sub(r: Runner, out: Coefficients, a: Coefficients, b: Coefficients) -> Step:
    return lambda k: a[k] - b[k]


def _mul(r: Runner, out: Coefficients, a: Coefficients, b: Coefficients) -> Step:
    return lambda k: convolved(a, b, k)


def _over(r: Runner, out: Coefficients, above: Step, b: Coefficients) -> Step:
    """``above / b``."""
    first: list[int] = []

    def step(k: int) -> int:
        if not k:
            first.append(r.ring.inverse(b[0]))
        return first[0] * (above(k) - convolved(b, out, k, 1))

    return step


def _div(r: Runner, out: Coefficients, a: Coefficients, b: Coefficients) -> Step:
    return _over(r, out, a.__getitem__, b)


def _inv(r: Runner, out: Coefficients, b: Coefficients) -> Step:
    return _over(r, out, _constant(1), b)


def _sqrt(r: Runner, out: Coefficients, a: Coefficients) -> Step:
    def step(k: int) -> int:
        if not k:
            return r.ring.sqrt(a[0])
        inner = sum(out[j] * out[k - j] for j in range(1, k))
        return (a[k] - inner) * r.ring.inverse(2 * out[0])

    return step


class _Circle:
    """Sine and cosine of one series, each the other's derivative."""

    def __init__(self, r: Runner, u: Coefficients) -> None:
        self.r, self.u = r, u
        self.s: Coefficients = []
        self.c: Coefficients = []

    def sine(self, k: int) -> int:
        """Coefficient k of ``sin u``."""
        self._extend(k)
        return self.s[k]

    def cosine(self, k: int) -> int:
        """Coefficient k of ``cos u``."""
        self._extend(k)
        return self.c[k]

    def _extend(self, k: int) -> None:
        if len(self.s) > k:
            return
        r, m = self.r, self.r.ring.m
        s, c = (
            (r.over(k, _slope(self.u, self.c, k)), r.over(k, -_slope(self.u, self.s, k)))
            if k
            else _start_of_circle(r, self.u[0])
        )
        self.s.append(s % m)
        self.c.append(c % m)


def _start_of_circle(r: Runner, u: int) -> tuple[int, int]:
    """Sine and cosine of a residue: exact where their series converge, else a generic point of the circle."""
    if u % r.ring.p == 0:
        return r.start("sin", u), r.start("cos", u)
    h = r.start("half", u)
    below = r.ring.inverse(1 + h * h)
    return 2 * h * below % r.ring.m, (1 - h * h) * below % r.ring.m


def _exp(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    """``y' = u' y``."""
    return lambda k: r.over(k, _slope(u, out, k)) if k else r.start("exp", u[0])


def _tanh(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    """``y' = u' (1 - y^2)``."""
    w: Coefficients = []

    def step(k: int) -> int:
        if not k:
            return r.start("tanh", u[0])
        w.append((k == 1) - convolved(out, out, k - 1))
        return r.over(k, _slope(u, w, k))

    return step


def _quotient(r: Runner, out: Coefficients, u: Coefficients, start: Step, w: Step) -> Step:
    """``y' = u' / w`` from a start, given the coefficients of w in order."""
    below: Coefficients = []

    def step(k: int) -> int:
        below.append(w(k) % r.ring.m)
        if not k:
            return start(u[0])
        inner = sum(j * out[j] * below[k - j] for j in range(1, k))
        return (u[k] - r.over(k, inner)) * r.ring.inverse(below[0])

    return step


def _log(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    return _quotient(r, out, u, lambda a: r.start("log", a) if a != 1 else 0, u.__getitem__)


def _atan(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    return _quotient(r, out, u, lambda a: r.start("atan", a), lambda k: (k == 0) + convolved(u, u, k))


def _asin(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    square: Coefficients = []
    w: Coefficients = []
    root = _sqrt(r, w, square)

    def below(k: int) -> int:
        square.append((k == 0) - convolved(u, u, k))
        w.append(root(k) % r.ring.m)
        return w[k]

    return _quotient(r, out, u, lambda a: r.start("asin", a), below)


_OPERATIONS: Mapping[str, Callable[..., Step]] = {
    "neg": _neg,
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "inv": _inv,
    "sqrt": _sqrt,
    "exp": _exp,
    "log": _log,
    "atan": _atan,
    "asin": _asin,
    "tanh": _tanh,
}
