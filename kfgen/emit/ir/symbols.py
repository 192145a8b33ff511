"""What the expressions of a filter stand on: where symbols live, and which parts of them are atoms.

The entries of the rotation matrix and the inputs corrected by what their effects show are atoms: they are worked
out once, and no expression that goes into the covariance is written out beyond them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import sympy as sp

from kfgen.emit.ir.ir import Expr, Let, Ref, Stmt
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.settings import input_density, walk_density
from kfgen.emit.targets.names import argument
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.constant import Constant
from kfgen.model.register import DT
from kfgen.model.symbols.expanded import LONGEST, products
from kfgen.model.symbols.rotation import matrix_of

Rows = dict[int, dict[int, sp.Expr]]
MAX_PRODUCTS_FOR_IDENTITY = 128
"""Products of an entry, multiplied out, beyond which no identity is looked for."""


def lowering(discrete: DiscreteModel, constants: Sequence[Constant], prefix: str = "") -> Lowering:
    """A lowering that knows state, constants, inputs, drivers and step.

    Parameters
    ----------
    discrete : DiscreteModel
    constants : sequence of Constant
        In the order of the filter's array ``k``.
    prefix : str
        Begins every local name.
    """
    places: dict[str, Expr] = {name: Ref("x", i) for i, name in enumerate(discrete.nominal_names)}
    places |= {c.name: Ref("k", i) for i, c in enumerate(constants)}
    places |= {
        c: Ref(argument(i.name)) if i.scalar else Ref(argument(i.name), k)
        for i in discrete.model.motion.inputs
        for k, c in enumerate(i.channels)
    }
    places |= {d: Ref(argument(d)) for d in discrete.model.drivers}
    places |= {s.name: input_density(discrete, name) for name, (s, _) in discrete.named_noise[1].items()}
    places |= {s.name: walk_density(discrete, name) for name, (s, _) in discrete.named_walks.items()}
    return Lowering(places | {str(DT): Ref("dt")}, prefix)


class Atoms:
    """The atoms of a filter's expressions.

    Parameters
    ----------
    discrete : DiscreteModel
    """

    def __init__(self, discrete: DiscreteModel) -> None:
        self.model = discrete.model
        self.inputs: dict[sp.Symbol, sp.Expr] = {}
        self.corrected: dict[sp.Symbol, sp.Expr] = {}
        self.shown: set[sp.Symbol] = set()
        for channel in (c for i in self.model.motion.inputs for c in i.channels):
            symbol, value = sp.Symbol(channel, real=True), self.model.corrected_input(channel, False)
            if value != symbol:
                atom = sp.Symbol(f"{channel}_hat", real=True)
                self.inputs[atom] = value
                self.corrected[symbol] = atom + symbol - value
                self.shown |= value.free_symbols - {symbol}

    def of_corrected_inputs(self, e: sp.Expr) -> sp.Expr:
        """An expression of the corrected inputs in place of the raw ones."""
        return e.xreplace(self.corrected) if self.corrected and e.free_symbols & self.corrected.keys() else e

    def entry(self, e: sp.Expr) -> sp.Expr:
        """An entry of Phi or Qd of the corrected inputs; in factors where it came multiplied out."""
        entry = self.of_corrected_inputs(e)
        if entry is e or not entry.free_symbols & self.shown:
            return entry
        if products(entry) <= LONGEST:
            return sp.factor_terms(sp.expand(entry))
        short = self._in_parts(entry)
        return short if short.count_ops() < e.count_ops() else e

    def _in_parts(self, e: sp.Expr) -> sp.Expr:
        """An expression whose parts are multiplied out as far as they are short."""
        if not e.free_symbols & self.shown:
            return e
        if products(e) <= LONGEST:
            return sp.factor_terms(sp.expand(e))
        return e.func(*map(self._in_parts, e.args))

    def orthonormal(self, e: sp.Expr) -> sp.Expr:
        """An entry with ``R R' = I`` used up, where that makes it shorter."""
        attitude = self.model.attitude
        if (
            attitude is None
            or not e.free_symbols & set(attitude.nominal)
            or products(e) > MAX_PRODUCTS_FOR_IDENTITY
        ):
            return e
        last = list(attitude.nominal[:, 2])
        old = sp.Add.make_args(sp.expand(e))
        new = sp.expand(sp.Add(*(self._without_last(t, last) for t in old)))
        if len(sp.Add.make_args(new)) >= len(old):
            return e  # to find common factors takes longest, and has never made up for more terms
        short = sp.factor_terms(new)
        return short if short.count_ops() < e.count_ops() else e

    def _without_last(self, term: sp.Expr, last: list[sp.Symbol]) -> sp.Expr:
        """A term in which ``R_i2 R_j2`` gives way to the products of the other columns."""
        R = self.model.attitude.nominal if self.model.attitude else sp.zeros(3, 3)
        powers = term.as_powers_dict()
        found = [i for i, symbol in enumerate(last) for _ in range(int(powers.get(symbol, 0)))]
        if len(found) < 2:
            return term
        i, j = found[:2]
        other = int(i == j) - R[i, 0] * R[j, 0] - R[i, 1] * R[j, 1]
        return term / (last[i] * last[j]) * other

    def make(self, lower: Lowering, used: Sequence[sp.Expr]) -> list[Stmt]:
        """The atoms that `used` needs, as locals.

        Parameters
        ----------
        lower : Lowering
            Gets to know the atoms.
        used : sequence of sympy expression
            What stands on them.
        """
        symbols = set().union(*(e.free_symbols for e in used)) if used else set()
        wanted = [(s, e) for s, e in self.inputs.items() if s in symbols]
        attitude = self.model.attitude
        if attitude is not None:
            entries = zip(attitude.nominal, matrix_of(attitude.quaternion))
            wanted += [(s, e) for s, e in entries if s in symbols]
        values, body = lower.many([e for _, e in wanted])
        for (symbol, _), value in zip(wanted, values):
            body.append(Let(symbol.name, value))
            lower.places[symbol.name] = Ref(symbol.name)
        return body


def transition(
    discrete: DiscreteModel, atoms: Atoms, waiting: Collection[sp.Symbol] = ()
) -> tuple[Rows, dict[tuple[int, int], sp.Expr]]:
    """Rows of Phi that differ from the identity's, and the upper non-zeros of Qd.

    Parameters
    ----------
    discrete : DiscreteModel
    atoms : Atoms
    waiting : collection of Symbol
        Densities of noise that comes in later, all of it at once: it is left out.
    """
    none = dict.fromkeys(waiting, sp.Integer(0))
    Phi, Qd, n = discrete.Phi, discrete.named_noise[0], discrete.Phi.rows
    rows = {i: {j: Phi[i, j] for j in range(n) if Phi[i, j] != 0} for i in range(n)}
    moving = {i: row for i, row in rows.items() if row != {i: 1}}
    upper = {(i, j): Qd[i, j].xreplace(none) for i in range(n) for j in range(i, n)}
    noise = {key: q for key, q in upper.items() if q != 0}
    short = {key: atoms.orthonormal(atoms.entry(q)) for key, q in noise.items()}
    return (
        {i: {j: atoms.entry(e) for j, e in row.items()} for i, row in moving.items()},
        {key: q for key, q in short.items() if q != 0},
    )
