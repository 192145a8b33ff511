"""The error of a whole state: truth from estimate and error, its rate, and the correction.

A convention composes the truth ``X = c(X_hat, e)``. By the chain rule anything that depends on the state varies by
``df = df/dX dc/de e`` (`ErrorState.variation`), so only equations of the estimate are ever differentiated. From
``dX/dt = f(X)`` follows ``de/dt = (dc/de)^-1 (f(c) - dc/dX_hat f(X_hat))`` to first order, whose inverse is
triangular: plain vectors first, then the attitude, then the vectors that it carries.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import sympy as sp

from kfgen.model.symbols.blocks import Attitude, Block, Vector
from kfgen.model.symbols.convention import Convention, Phi
from kfgen.model.symbols.expanded import expanded
from kfgen.model.symbols.rotation import skew, turned

Views = dict[str, sp.Matrix]
Turning = Callable[[Mapping[str, sp.Matrix], sp.Matrix], sp.Matrix]
"""How much a small change of position turns the navigation frame, at a state."""
Variation = dict[sp.Symbol, dict[int, sp.Expr]]
"""How each symbol varies: coefficient by the number of the error or the noise."""


def slopes(vector: sp.Matrix, variation: Variation, columns: int) -> sp.Matrix:
    """How expressions vary, shape (rows, columns); jumps of a sign have no slope.

    Parameters
    ----------
    vector : Matrix, shape (rows, 1)
    variation : mapping
    columns : int
    """
    out = sp.zeros(vector.rows, columns)
    for i, e in enumerate(vector):
        for s in sorted(e.free_symbols & variation.keys(), key=str):
            slope = e.diff(s).replace(sp.DiracDelta, lambda *_: sp.Integer(0))
            for j, c in variation[s].items():
                out[i, j] += slope * c
    return out


class ErrorState:
    """The blocks of a state with their convention.

    Parameters
    ----------
    blocks : sequence of Block
    turning : callable
        As of `Motion.turning`.
    """

    def __init__(self, blocks: Sequence[Block], turning: Turning) -> None:
        self.blocks = tuple(blocks)
        self.attitude = next((b for b in blocks if isinstance(b, Attitude)), None)
        self.convention: type[Convention] = self.attitude.convention if self.attitude else Phi
        self.estimate: Views = {b.name: b.value for b in blocks}
        self.symbols = tuple(s for b in blocks for s in b.error)
        own = self.attitude.error if self.attitude else sp.zeros(3, 1)
        errors = {b.name: b.error for b in blocks}
        turn = turning(self.estimate, errors["p"]) if "p" in errors else sp.zeros(3, 1)
        self.angle = self.convention.angle(own, turn)
        self.carrier = self.convention.carrier(own, turn)

    def _carried(self, b: Block) -> bool:
        return b.name in self.convention.carried and self.attitude is not None

    def _composed(self, rotated: Callable[[sp.Matrix, sp.Matrix], sp.Matrix], b: Vector) -> sp.Matrix:
        return (rotated(self.carrier, b.nominal) if self._carried(b) else b.nominal) + b.error

    @property
    def truth(self) -> Views:
        """What a motion or a sensor sees of the truth, to first order in the error."""
        return {
            b.name: self.convention.side.truth(self.angle, b.nominal)
            if isinstance(b, Attitude)
            else self._composed(lambda theta, v: v + theta.cross(v), b)
            for b in self.blocks
        }

    @property
    def corrected(self) -> list[sp.Expr]:
        """The stored state with the error put in, in order; quaternions not normalised."""
        out: list[sp.Expr] = []
        for b in self.blocks:
            if isinstance(b, Attitude):
                error = self.convention.quaternion(self.angle)
                out.extend(self.convention.side.corrected(error, b.quaternion))
            else:
                out.extend(self._composed(turned, b))
        return out

    @property
    def variation(self) -> Variation:
        """How the symbols of the estimate vary with the error: ``dc/de`` at zero."""
        places = {s: j for j, s in enumerate(self.symbols)}
        out: Variation = {}
        for b in self.blocks:
            for nominal, e in zip(b.nominal, self.truth[b.name]):
                out[nominal] = {places[s]: e.diff(s) for s in e.free_symbols & places.keys()}
        return out

    def _linear(self, vector: sp.Matrix) -> sp.Matrix:
        """Coefficients of what is linear in the error, shape (3, errors)."""
        return vector.jacobian(sp.Matrix(self.symbols))

    def _in_time(self, M: sp.Matrix, rates: Views, found: sp.Matrix) -> sp.Matrix:
        """``d(M e)/dt``, with the rates of the estimate and those of the error found so far."""
        known = {
            s: {0: rate}
            for b in self.blocks
            if isinstance(b, Vector)
            for s, rate in zip(b.nominal, rates[b.name])
        }
        out = M * found
        for j in range(M.cols):
            out[:, j] += slopes(M[:, j], known, 1)
        return out

    def rates(self, variations: Views, rates: Views) -> sp.Matrix:
        """``de/dt`` to first order, shape (errors, columns of the variations).

        Parameters
        ----------
        variations : mapping of str to Matrix
            How the blocks' rates vary (rows) with errors and noises (columns).
        rates : mapping of str to Matrix
            Rates of the estimate; body rate of the attitude.
        """
        columns = next(iter(variations.values())).cols if variations else 0
        errors = len(self.symbols)
        first = {b.name: sum(len(o.error) for o in self.blocks[:k]) for k, b in enumerate(self.blocks)}
        found = sp.zeros(errors, columns)

        def settle(b: Block, rows: sp.Matrix) -> None:
            found[first[b.name] : first[b.name] + rows.rows, :] = expanded(rows)

        def wide(M: sp.Matrix) -> sp.Matrix:
            return M.row_join(sp.zeros(M.rows, columns - M.cols))

        for b in self.blocks:
            if isinstance(b, Vector) and not self._carried(b):
                settle(b, variations[b.name])
        if self.attitude is not None:
            a = self.attitude
            turns = self.convention.side.rate(
                wide(self._linear(self.angle)), a.nominal, variations[a.name], rates[a.name]
            )
            rest = self._linear(self.angle - a.error)
            settle(
                a,
                turns if rest.is_zero_matrix else turns - self._in_time(wide(rest)[:, :errors], rates, found),
            )
        for b in self.blocks:
            if isinstance(b, Vector) and self._carried(b):
                K = self._linear(self.carrier)
                turning = skew(rates[b.name]) * wide(K) + skew(b.nominal) * self._in_time(K, rates, found)
                settle(b, variations[b.name] + turning)
        return found
