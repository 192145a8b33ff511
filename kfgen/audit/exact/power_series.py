"""`Runner`: the operations of a graph on truncated power series in a ring, one order after the other.

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

from kfgen.audit.exact.graph import Graph
from kfgen.audit.exact.padic import Ring

Coefficients = list[int]
Step = Callable[[int], int]
"""Coefficient k from those before."""


class Runner:
    """A graph on power series in a ring.

    Parameters
    ----------
    graph : Graph
    ring : Ring
    given : sequence of list of int
        Coefficients of the variables; lists that others may lengthen while the runner steps.
    """

    def __init__(self, graph: Graph, ring: Ring, given: Sequence[Coefficients]) -> None:
        self.ring = ring
        self.inverse = [0]
        self.series: list[Coefficients] = [*given]
        self._steps: list[tuple[Coefficients, Step]] = []
        for name, operands in graph.operations[graph.variables :]:
            out: Coefficients = []
            series = [self.series[o] if isinstance(o, int) else o for o in operands]
            self.series.append(out)
            self._steps.append((out, _OPERATIONS[name](self, out, *series)))

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


def _constant(r: Runner, out: Coefficients, value: Fraction) -> Step:
    c = r.ring.of(value)
    return lambda k: 0 if k else c


def _add(r: Runner, out: Coefficients, a: Coefficients, b: Coefficients) -> Step:
    return lambda k: a[k] + b[k]


def _mul(r: Runner, out: Coefficients, a: Coefficients, b: Coefficients) -> Step:
    return lambda k: convolved(a, b, k)


def _inv(r: Runner, out: Coefficients, a: Coefficients) -> Step:
    first: list[int] = []

    def step(k: int) -> int:
        if not k:
            first.append(r.ring.inverse(a[0]))
            return first[0]
        return -first[0] * convolved(a, out, k, 1)

    return step


def _sqrt(r: Runner, out: Coefficients, a: Coefficients) -> Step:
    def step(k: int) -> int:
        if not k:
            return r.ring.sqrt(a[0])
        inner = sum(out[j] * out[k - j] for j in range(1, k))
        return (a[k] - inner) * r.ring.inverse(2 * out[0])

    return step


def _sin(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    cosine: Coefficients = []

    def step(k: int) -> int:
        if not k:
            s, c = _circle(r, u[0])
            cosine.append(c)
            return s
        value = r.over(k, _slope(u, cosine, k)) % r.ring.m
        cosine.append(r.over(k, -_slope(u, out, k)) % r.ring.m)
        return value

    return step


def _circle(r: Runner, u: int) -> tuple[int, int]:
    """Sine and cosine of a residue: exact where their series converge, else a generic point of the circle."""
    if u % r.ring.p == 0:
        return r.start("sin", u), r.start("cos", u)
    h = r.start("half", u)
    below = r.ring.inverse(1 + h * h)
    return 2 * h * below % r.ring.m, (1 - h * h) * below % r.ring.m


def _cos(r: Runner, out: Coefficients, u: Coefficients, sine: Coefficients) -> Step:
    def step(k: int) -> int:
        return r.over(k, -_slope(u, sine, k)) if k else _circle(r, u[0])[1]

    return step


def _exp(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    return lambda k: r.over(k, _slope(u, out, k)) if k else r.start("exp", u[0])


def _log(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    def step(k: int) -> int:
        if not k:
            return r.start("log", u[0]) if u[0] != 1 else 0
        inner = sum(j * out[j] * u[k - j] for j in range(1, k))
        return (u[k] - r.over(k, inner)) * r.ring.inverse(u[0])

    return step


def _quotient(
    r: Runner, out: Coefficients, u: Coefficients, name: str, below: Callable[[int, Coefficients], int]
) -> Step:
    """``y' = u' / w`` where `below` appends coefficient k of w."""
    w: Coefficients = []

    def step(k: int) -> int:
        w.append(below(k, w) % r.ring.m)
        if not k:
            return r.start(name, u[0])
        inner = sum(j * out[j] * w[k - j] for j in range(1, k))
        return (u[k] - r.over(k, inner)) * r.ring.inverse(w[0])

    return step


def _atan(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    return _quotient(r, out, u, "atan", lambda k, _: convolved(u, u, k) + (k == 0))


def _asin(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    def root(k: int, w: Coefficients) -> int:
        a = (k == 0) - convolved(u, u, k)
        if not k:
            return r.ring.sqrt(a)
        return (a - sum(w[j] * w[k - j] for j in range(1, k))) * r.ring.inverse(2 * w[0])

    return _quotient(r, out, u, "asin", root)


def _tanh(r: Runner, out: Coefficients, u: Coefficients) -> Step:
    def step(k: int) -> int:
        if not k:
            return r.start("tanh", u[0]) if u[0] else 0
        flat = [(j == 0) - convolved(out, out, j) for j in range(k)]
        return r.over(k, sum(j * u[j] * flat[k - j] for j in range(1, k + 1)))

    return step


_OPERATIONS: Mapping[str, Callable[..., Step]] = {
    "constant": _constant,
    "add": _add,
    "mul": _mul,
    "inv": _inv,
    "sqrt": _sqrt,
    "sin": _sin,
    "cos": _cos,
    "exp": _exp,
    "log": _log,
    "atan": _atan,
    "asin": _asin,
    "tanh": _tanh,
}
