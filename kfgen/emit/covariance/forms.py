"""What a form of the covariance is: how it is stored, predicted and corrected. To add one, write one class.

`Packed` stores P, `Factored` (in `kfgen.emit.covariance.factored`) its factors U and D.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.covariance.correction import GAIN, corrected, gathered
from kfgen.emit.covariance.packed import Noise, Row, cell, packed_size, place, predict_covariance, total
from kfgen.emit.covariance.state_range import StateRange
from kfgen.emit.ir.ir import (
    Argument,
    Bin,
    Compare,
    Expr,
    For,
    FunctionCall,
    Let,
    Num,
    Ref,
    Routine,
    Scratch,
    StatusFlag,
    Stmt,
    Store,
    When,
    add,
    mul,
    sub,
)

Array = NDArray[np.float64]
MAX_ROLLBACK_STATES = 12
"""States up to which a copy of the covariance costs less than that of a sample of three rows."""
HELD, ANY_HELD = "held", Ref("any_held", 0)
"""One for each state that is considered but not corrected, else zero; and how many there are."""


@dataclass(frozen=True)
class Fusion:
    """A scalar measurement at work.

    Parameters
    ----------
    before : tuple of Stmt
        What the innovation variance needs.
    S : Expr
        It, as an atom.
    apply : tuple of Stmt
        Covariance and correction, once the sample is accepted; ``y`` and ``s = 1 / S`` are there.
    """

    before: tuple[Stmt, ...]
    S: Expr
    apply: tuple[Stmt, ...]


@dataclass(frozen=True)
class CovarianceForm:
    """A form of the covariance of `n` states.

    Parameters
    ----------
    n : int
    Phi, Qd : dict
        Where the transition differs from the identity, and where noise drives.
    names : tuple of str
        Of the states, for comments.
    loops : bool
        Loops in place of repeated columns.
    slow : dict of int to Expr
        States that keep their value under white noise of so much density [SI^2/s], whose noise waits.
    q_interval : float
        Until it has waited so long [s]; it then comes in at once.
    driven : tuple of int
        States with process noise.
    """

    n: int
    Phi: Mapping[int, Sequence[int]]
    names: tuple[str, ...]
    loops: bool = False
    slow: Mapping[int, Expr] = field(default_factory=dict)
    q_interval: float = 0.0
    driven: tuple[int, ...] = ()

    NAME = ""
    TITLE = ""
    ARRAY = ""
    TAKES_EXACT = True
    """Whether it fuses a measurement without noise."""
    HAS_Q_INTERVAL = False
    """Whether noise may wait: it does where each term of it is dear."""

    @property
    def memory(self) -> dict[str, tuple[int, str]]:
        """Further arrays of the filter: size and meaning."""
        return {}

    @property
    def size(self) -> int:
        """Stored numbers."""
        return packed_size(self.n)

    @property
    def order(self) -> tuple[int, ...]:
        """The states in the order of the stored triangle."""
        return tuple(range(self.n))

    def init(self, priors: Sequence[Num]) -> list[Stmt]:
        """The stored numbers for independent states of given standard deviations [SI]."""
        raise NotImplementedError

    def innovation_covariance(
        self, rows: Sequence[Row], R: Sequence[Expr]
    ) -> tuple[list[Stmt], dict[tuple[int, int], Expr]]:
        """``S = H P H' + diag(R)``: statements, and its elements (i, j), i <= j.

        Parameters
        ----------
        rows : sequence of Row
            Non-zeros of the Jacobian's rows.
        R : sequence of Expr
            Variance of the noise of each [SI^2].
        """
        raise NotImplementedError

    @property
    def gates_first(self) -> bool:
        """Whether a sample's covariance is worked out before any of its rows is fused; else a rejected one is taken back."""
        return self.n > MAX_ROLLBACK_STATES

    @property
    def diagonal(self) -> list[Expr]:
        """The stored diagonal."""
        return [cell(i, i, self.ARRAY) for i in range(self.n)]

    def widen(self, least: Sequence[Num]) -> Routine:
        """P becomes diagonal, of given standard deviations [SI]."""
        return Routine(
            "widen",
            "The covariance goes back to the priors: nothing that was known holds.",
            (),
            tuple(self.init(least)),
            internal=True,
        )

    @property
    def inflate(self) -> Routine:
        """``P <- P + c a a'``, in loops."""
        raise NotImplementedError

    def predict(self, Phi: dict[int, Row], Qd: Noise) -> list[Stmt]:
        """Statements of ``P <- Phi P Phi' + Qd``.

        Parameters
        ----------
        Phi : dict of int to Row
            Rows that differ from the identity's.
        Qd : dict of (int, int) to Expr
            Non-zeros of the upper triangle of the process noise.
        """
        raise NotImplementedError

    def fuse(self, row: int, H: Row, R: Expr) -> Fusion:
        """One scalar of Jacobian H and noise variance R.

        Parameters
        ----------
        row : int
            Of the sensor; the first one begins the correction.
        H : dict of int to Expr
            Non-zeros of the Jacobian.
        R : Expr
            Variance of the noise [SI^2].
        """
        raise NotImplementedError

    @property
    def scratch(self) -> tuple[Scratch, ...]:
        """Local arrays of an update."""
        return (Scratch(GAIN, self.n),)

    @property
    def predict_scratch(self) -> tuple[Scratch, ...]:
        """Local arrays of a prediction."""
        return ()

    @property
    def internals(self) -> tuple[Routine, ...]:
        """Routines that `fuse` and `predict` call."""
        raise NotImplementedError

    @cached_property
    def health(self) -> Routine:
        """Smallest normalised pivot of the covariance."""
        raise NotImplementedError

    def matrix(self, values: Sequence[float]) -> list[list[float]]:
        """The covariance, from the stored numbers."""
        raise NotImplementedError

    def stored_range(self, a: StateRange, b: StateRange | None, factor: float) -> tuple[float, float]:
        """Range of a stored element: of one state, or of two of which one follows from the other by `factor` priors."""
        raise NotImplementedError

    def variances(self, stored: Array) -> Array:
        """Variances of the states, shape (m, n), from stored numbers, shape (m, size)."""
        raise NotImplementedError


HEALTH = Ref("health", 0)


def smaller(value: Expr) -> list[Stmt]:
    """The health becomes a value where that is smaller; one that is not positive is flagged."""
    worse = When(Compare("<", value, HEALTH), (Store(HEALTH, value),))
    return [worse, When(Compare(">", value, Num(0.0)), (), (StatusFlag("NOT_POSITIVE"),))]


class Packed(CovarianceForm):
    """The covariance itself, its upper triangle by rows."""

    NAME = "p"
    TITLE = "covariance, upper triangle by rows"
    ARRAY = "P"

    def init(self, priors: Sequence[Num]) -> list[Stmt]:
        """Variances on the diagonal."""
        zero = For("i", 0, self.n, (For("j", "i", self.n, (Store(cell("i", "j"), Num(0.0)),)),))
        return [zero, *(Store(cell(i, i), mul(sd, sd)) for i, sd in enumerate(priors))]

    def innovation_covariance(
        self, rows: Sequence[Row], R: Sequence[Expr]
    ) -> tuple[list[Stmt], dict[tuple[int, int], Expr]]:
        """``b = P H'`` where later rows need it, then ``H b``."""
        body: list[Stmt] = []
        S: dict[tuple[int, int], Expr] = {}
        for i, H in enumerate(rows):
            b: dict[int, Expr] = {}
            for k in sorted({k for later in rows[i:] for k in later}):
                b[k] = Ref(f"Ph_{i}_{k}")
                body.append(Let(f"Ph_{i}_{k}", total([mul(h, cell(k, j)) for j, h in H.items()])))
            for j in range(i, len(rows)):
                terms = [mul(h, b[k]) for k, h in rows[j].items()]
                S[i, j] = Ref(f"S_{i}_{j}")
                body.append(Let(f"S_{i}_{j}", total([*terms, R[i]] if i == j else terms)))
        return body, S

    @property
    def inflate(self) -> Routine:
        """Element by element."""
        value = add(cell("i", "j"), mul(mul(Ref("c"), Ref(GAIN, "i")), Ref(GAIN, "j")))
        body = (For("i", 0, self.n, (For("j", "i", self.n, (Store(cell("i", "j"), value),)),)),)
        return Routine("inflate", INFLATE_TEXT, inflate_arguments(self.n), body, internal=True)

    def predict(self, Phi: dict[int, Row], Qd: Noise) -> list[Stmt]:
        """By congruence in place."""
        return predict_covariance(self.n, Phi, Qd, self.names, self.loops)

    def fuse(self, row: int, H: Row, R: Expr) -> Fusion:
        """``b = P H'``, ``S = H b + R``, ``K = b / S``, ``P <- P - K b'``; for held states see `_held`."""
        tag = str(row)
        before: list[Stmt] = []
        b: list[Expr] = []
        for k in range(self.n):
            before.append(Let(f"b_{tag}_{k}", total([mul(h, cell(k, j)) for j, h in H.items()])))
            b.append(Ref(f"b_{tag}_{k}"))
        S = Ref(f"S_{tag}")
        before.append(Let(S.name, total([*(mul(h, b[j]) for j, h in H.items()), R])))
        y, s = Ref(f"y_{tag}"), Ref(f"s_{tag}")
        handed: list[Stmt] = [Store(Ref(GAIN, k), b[k]) for k in range(self.n)]
        held = FunctionCall("fuse_held", (Ref(GAIN), S, s))
        if self.loops:
            which = When(
                Compare(">", ANY_HELD, Num(0.0)), (held,), (FunctionCall("fuse_all", (Ref(GAIN), s)),)
            )
            return Fusion(tuple(before), S, (*handed, which, *corrected(row, self.n, y, self.loops)))
        plain: list[Stmt] = []
        for k in range(self.n):
            gain = Ref(f"K_{tag}_{k}")
            plain += [Let(gain.name, mul(b[k], s)), gathered(row, Ref("dx", k), mul(gain, y))]
            plain += [Store(cell(k, l), sub(cell(k, l), mul(gain, b[l]))) for l in range(k, self.n)]
        which = When(
            Compare(">", ANY_HELD, Num(0.0)), (*handed, held, *corrected(row, self.n, y, False)), tuple(plain)
        )
        return Fusion(tuple(before), S, (which,))

    @property
    def internals(self) -> tuple[Routine, ...]:
        """The update in loops, for any gain and for the optimal one."""
        return (self._held, self.inflate, *((self._all,) if self.loops else ()))

    @property
    def _held(self) -> Routine:
        """``P <- P - K b' - c K'`` with ``c = b - S K``: right for any gain, here zero for held states."""
        n, b, K, c = self.n, GAIN, "K_", "c_"
        S, s, P = Ref("S"), Ref("s"), cell("i", "j")
        gain = mul(mul(Ref(b, "i"), s), sub(Num(1.0), Ref(HELD, "i")))
        left: tuple[Stmt, ...] = (
            Store(Ref(K, "i"), gain),
            Store(Ref(c, "i"), sub(Ref(b, "i"), mul(S, Ref(K, "i")))),
        )
        value = sub(sub(P, mul(Ref(K, "i"), Ref(b, "j"))), mul(Ref(c, "i"), Ref(K, "j")))
        row = (For("j", "i", n, (Store(P, value),)), Store(Ref(b, "i"), Ref(K, "i")))
        return Routine(
            "fuse_held",
            "One scalar with a gain K that is zero for held states: P - K b' - c K', c = b - S K; b becomes K.",
            (
                Argument(b, n, "P H', then the gain"),
                Argument("S", 0, "variance of the innovation"),
                Argument("s", 0, "one over it"),
            ),
            (For("i", 0, n, left), For("i", 0, n, row)),
            (Scratch(K, n), Scratch(c, n)),
            internal=True,
        )

    @property
    def _all(self) -> Routine:
        n, P, b = self.n, cell("i", "j"), GAIN
        rows: tuple[Stmt, ...] = (
            Let("K_", mul(Ref(b, "i"), Ref("s"))),
            For("j", "i", n, (Store(P, sub(P, mul(Ref("K_"), Ref(b, "j")))),)),
            Store(Ref(b, "i"), Ref("K_")),
        )
        return Routine(
            "fuse_all",
            "One scalar with the optimal gain K = b / S: P - K b'; b becomes K.",
            (Argument(b, n, "P H', then the gain"), Argument("s", 0, "one over its variance")),
            (For("i", 0, n, rows),),
            internal=True,
        )

    @cached_property
    def health(self) -> Routine:
        """By the pivots of P = U D U', each over its variance."""
        n, W = self.n, "W_"
        pivot = cell("j", "j", W)
        eliminate = For(
            "m",
            0,
            "i",
            (Store(cell("m", "i", W), sub(cell("m", "i", W), mul(Ref("u_"), cell("m", "j", W)))),),
        )
        on_diagonal = Store(cell("i", "i", W), sub(cell("i", "i", W), mul(Ref("u_"), cell("i", "j", W))))
        column = (Let("u_", mul(cell("i", "j", W), Ref("over_"))), eliminate, on_diagonal)
        healthy: tuple[Stmt, ...] = (
            Let("over_", Bin("/", Num(1.0), pivot)),
            For("i", 0, "j", column),
        )
        body: tuple[Stmt, ...] = (
            Store(HEALTH, Num(1.0)),
            For("i", 0, n, (For("j", "i", n, (Store(cell("i", "j", W), cell("i", "j")),)),)),
            For(
                "j",
                0,
                n,
                (
                    Let("ratio_", Bin("/", pivot, cell("j", "j"))),
                    *smaller(Ref("ratio_")),
                    When(Compare(">", pivot, Num(0.0)), healthy),
                ),
                down=True,
            ),
        )
        return Routine("check", HEALTH_TEXT, (), body, (Scratch(W, packed_size(n)),))

    def variances(self, stored: Array) -> Array:
        """As they are stored."""
        return stored[:, [place(self.n, i, i) for i in range(self.n)]]

    def stored_range(self, a: StateRange, b: StateRange | None, factor: float) -> tuple[float, float]:
        """Products of standard deviations."""
        return (a.least**2, a.most**2) if b is None else (-a.most * b.most, a.most * b.most)

    def matrix(self, values: Sequence[float]) -> list[list[float]]:
        """As it is stored."""
        pairs = [[(min(i, j), max(i, j)) for j in range(self.n)] for i in range(self.n)]
        return [[float(values[place(self.n, *p)]) for p in row] for row in pairs]


INFLATE_TEXT = "The covariance grows along one direction: P + c a a' with a in the array of the gain."


def inflate_arguments(n: int) -> tuple[Argument, ...]:
    """Of the routine that widens the covariance of `n` states along a direction."""
    return Argument(GAIN, n, "direction a"), Argument("c", 0, "its variance")


HEALTH_TEXT = (
    "Covariance health: the smallest pivot over its variance goes to kf->health; above zero is healthy."
)
