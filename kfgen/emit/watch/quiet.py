"""Samples of a body at rest, gathered in a row: what alignment and the detector of rest take for rest.

A sample is one at rest where its rate is below `ALIGN_MAX_RATE`, its specific force within `ALIGN_MAX_SHAKE` of the
mean of those that were gathered, and as long as gravity within `ALIGN_MAX_FORCE`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from kfgen.core.units import STANDARD_GRAVITY
from kfgen.emit.guards import sum_of_squares
from kfgen.emit.ir.ir import All, Bin, Compare, Expr, Num, Ref, Stmt, Store, When, add, mul, sub
from kfgen.emit.targets.names import argument
from kfgen.model.parts.motion import GRAVITY

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

WHY = "why"
"""Scratch: the number of the reason why a sample is not one at rest."""
FORCE, RATE = "FORCE", "RATE"
REASONS = ("NONE", "TURNING", "SHAKEN", "NOT_GRAVITY", "NO_HORIZONTAL_FIELD", "TOO_SLOW", "TOO_FAST")
"""Why alignment began again, or a body is not at rest, in order of number."""


class Quiet:
    """What is gathered, among the supervisor's numbers.

    Parameters
    ----------
    program : Program
    prefix : str
        Of its places: ``ALIGN`` or ``REST``.
    samples : mapping of str to str
        Inputs or sensors by the sum that they go into.
    force, rate : str
        Those that show specific force and angular rate.
    """

    def __init__(
        self, program: Program, prefix: str, samples: Mapping[str, str], force: str, rate: str
    ) -> None:
        self.program = program
        self.prefix, self.samples, self.force, self.rate = prefix, samples, force, rate
        self.gravity: Expr = program.lowering("a").places.get(GRAVITY.name, Num(STANDARD_GRAVITY))

    def at(self, name: str) -> Ref:
        """One of its numbers, by its name without the prefix."""
        return self.program.supervisor.number(f"{self.prefix}_{name}")

    def sums(self, vector: str) -> list[Ref]:
        """Those of a vector."""
        return [self.at(f"{vector}_{a}") for a in "XYZ"]

    @staticmethod
    def sample(name: str) -> list[Expr]:
        """The numbers of a triad that is given."""
        return [Ref(argument(name), i) for i in range(3)]

    def disturbed(self) -> list[Stmt]:
        """`WHY` becomes the reason why a sample is not one at rest; it stays where it is one."""
        setting = self.program.setting
        f, w = self.sample(self.force), self.sample(self.rate)
        count = self.at("COUNT")
        off = [Bin("-", mul(a, count), s) for a, s in zip(f, self.sums(FORCE))]
        shaken = Compare(">", sum_of_squares(off), squared(mul(setting("ALIGN_MAX_SHAKE"), count)))
        rate = Compare(">", sum_of_squares(w), squared(setting("ALIGN_MAX_RATE")))
        low, high = (op(self.gravity, setting("ALIGN_MAX_FORCE")) for op in (sub, add))
        size = sum_of_squares(f)
        right = All((Compare(">=", size, squared(low)), Compare("<=", size, squared(high))))
        return [
            When(rate, (because("TURNING"),)),
            When(shaken, (because("SHAKEN"),)),
            When(right, (), (because("NOT_GRAVITY"),)),
        ]

    def emptied(self) -> list[Stmt]:
        """All begins again."""
        numbers = [r for s in self.samples for r in self.sums(s)]
        return [Store(r, Num(0.0)) for r in (self.at("GATHERED"), self.at("COUNT"), *numbers)]

    def gathered(self) -> list[Stmt]:
        """A sample at rest comes to those before it."""
        body: list[Stmt] = []
        for vector, name in self.samples.items():
            body += [Store(s, add(s, v)) for s, v in zip(self.sums(vector), self.sample(name))]
        for name, value in (("COUNT", Num(1.0)), ("GATHERED", Ref("dt"))):
            body.append(Store(self.at(name), add(self.at(name), value)))
        return body

    def halved(self) -> list[Stmt]:
        """What was gathered counts half: the mean forgets, and sums stay small."""
        numbers = [self.at("GATHERED"), self.at("COUNT"), *(r for s in self.samples for r in self.sums(s))]
        return [Store(r, mul(Num(0.5), r)) for r in numbers]

    @property
    def enough(self) -> Compare:
        """Enough were quiet in a row."""
        return Compare(">=", self.at("GATHERED"), self.program.setting("ALIGN_TIME"))


def squared(e: Expr) -> Expr:
    """``e e``."""
    return mul(e, e)


def because(reason: str) -> Stmt:
    """`WHY` becomes one of `REASONS`."""
    return Store(Ref(WHY, 0), Num(float(REASONS.index(reason))))
