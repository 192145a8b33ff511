"""The supervisor of a filter: how old each sensor's last accepted sample is, how many were rejected, what was reset.

A sensor whose samples are rejected for `RESET_AFTER` or `RESET_COUNT` times in a row is right and the filter wrong, or
the other way round; either way the estimate has to follow. Each further rejected sample with innovation y then widens
P along ``a = Pi h'``, with Pi the prior variances, until the innovation's variance is at least ``y^2``:
``P <- P + (y / h a)^2 a a'``. The next sample passes the gate and moves what the sensor sees. A second reset of the
same sensor within `ESCALATE_WITHIN` says that what is wrong is not what it sees: then P first goes back to the priors,
as it does after predictions were missed for `RESYNC_AFTER`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce

from kfgen.emit.covariance.joint import NIS
from kfgen.emit.ir.ir import (
    All,
    Bin,
    Compare,
    Expr,
    FunctionCall,
    Num,
    Ref,
    Routine,
    StatusFlag,
    Stmt,
    Store,
    When,
    add,
    mul,
    sub,
)
from kfgen.emit.targets.names import identifier
from kfgen.model.parts.constant import Constant

ARRAY = "supervisor"
DUE = Ref("due", 0)
"""Scratch of an update: 1 where a rejected sample widens P."""
LONG_AGO = 1e6
"""Since the last reset, before the first one [s]."""
UNTURNED = "JUMP_Q_W"
"""Of a quaternion that has not turned: one, its other components zero."""
OF_SENSOR = {
    "AGE": "since its last accepted sample [s]",
    "REJECTED": "samples rejected in a row",
    "REJECTED_FROM": "age at which they began to be rejected [s]",
    "MEAN_NIS": "mean squared innovation of its accepted samples",
    "RESET": "1 where it widened its states at the last reset",
}
OF_FILTER = {
    "MISSED": "predictions missed since the last one [s]",
    "SINCE_RESET": "since states were last widened [s]",
    "RESETS": "how often states were widened",
}


@dataclass(frozen=True)
class Supervisor:
    """The supervisor's memory and what it does.

    Parameters
    ----------
    rows : dict of str to int
        Of each sensor, by its name.
    triads : tuple of str
        Inputs of three noisy channels, as arguments: one that does not change is stuck.
    settings : dict of str to Constant
        Of the filter.
    others : tuple of (str, str)
        Places of alignment, rest and the like, with their meaning.
    """

    rows: dict[str, int]
    triads: tuple[str, ...]
    settings: dict[str, Constant]
    others: tuple[tuple[str, str], ...] = ()

    @property
    def sensors(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self.rows)

    @cached_property
    def places(self) -> tuple[tuple[str, str], ...]:
        """Name and meaning of each of its numbers, in order."""
        own = [
            (f"{q}_{identifier(s).upper()}", f"{s}: {text}")
            for s in self.sensors
            for q, text in OF_SENSOR.items()
        ]
        stuck = [
            (f"{name}_{identifier(t).upper()}{axis}", f"{t}: {text}")
            for t in self.triads
            for name, axis, text in (
                ("STUCK", "", "since its last change [s]"),
                *(("LAST", f"_{axis}", "last sample") for axis in "XYZ"),
            )
        ]
        return (*own, *OF_FILTER.items(), *stuck, *self.others)

    @property
    def start(self) -> tuple[float, ...]:
        """Its numbers before the first call."""
        others = {UNTURNED: 1.0}
        return tuple(LONG_AGO if n.startswith("SINCE") else others.get(n, 0.0) for n, _ in self.places)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: k for k, (name, _) in enumerate(self.places)}

    def number(self, place: str) -> Ref:
        """A number of it, by the name of its place."""
        return Ref(ARRAY, self._numbers[place])

    def at(self, quantity: str, sensor: str = "") -> Ref:
        """A number of it: of the filter, or of a sensor."""
        return self.number(f"{quantity}_{identifier(sensor).upper()}" if sensor else quantity)

    def _setting(self, name: str) -> Num:
        return Num(self.settings[name].value, name)

    def elapsed(self) -> list[Stmt]:
        """A step goes by."""
        clocks = [Ref(ARRAY, k) for k, (n, _) in enumerate(self.places) if n.startswith(("AGE", "SINCE"))]
        return [Store(c, add(c, Ref("dt"))) for c in clocks]

    def changed(self) -> list[Stmt]:
        """Whether each triad of inputs has changed since the last step."""
        body: list[Stmt] = []
        for triad in self.triads:
            stuck, last = self.at("STUCK", triad), [self.at("LAST", f"{triad}_{a}") for a in "XYZ"]
            now = [Ref(triad, i) for i in range(3)]
            same = All(tuple(Compare(op, a, b) for a, b in zip(now, last) for op in ("<=", ">=")))
            kept = tuple(Store(b, a) for a, b in zip(now, last))
            body.append(When(same, (Store(stuck, add(stuck, Ref("dt"))),), (Store(stuck, Num(0.0)), *kept)))
        return body

    def missed(self) -> list[Stmt]:
        """A step goes by without a prediction."""
        missed = self.at("MISSED")
        return [Store(missed, add(missed, Ref("dt")))]

    def resynchronise(self) -> list[Stmt]:
        """Before a prediction: where too many were missed, nothing that was known holds."""
        missed = self.at("MISSED")
        long = When(Compare(">=", missed, self._setting("RESYNC_AFTER")), tuple(self.widen()))
        return [When(Compare(">", missed, Num(0.0)), (long, Store(missed, Num(0.0))))]

    def widen(self) -> list[Stmt]:
        """All states back to their priors."""
        return [
            FunctionCall("widen", ()),
            Store(self.at("SINCE_RESET"), Num(0.0)),
            self._count("RESETS"),
        ]

    def _count(self, quantity: str, sensor: str = "") -> Stmt:
        return Store(self.at(quantity, sensor), add(self.at(quantity, sensor), Num(1.0)))

    def accepted(self, sensor: str, gate: Expr) -> list[Stmt]:
        """A sample of a sensor was fused; where the innovations of many are too large in the mean, P is too small.

        Parameters
        ----------
        sensor : str
            Its name.
        gate : Expr
            Largest squared innovation of a sample.
        """
        mean, weight = self.at("MEAN_NIS", sensor), self._setting("NIS_WEIGHT")
        most = mul(mul(gate, self._setting("NIS_SHARE")), Num(float(self.rows[sensor])))
        begin_again = tuple(Store(self.at("MEAN_NIS", s), Num(0.0)) for s in self.rows)
        return [
            Store(self.at("AGE", sensor), Num(0.0)),
            Store(self.at("REJECTED", sensor), Num(0.0)),
            Store(mean, add(mean, mul(weight, sub(NIS, mean)))),
            When(Compare(">", mean, most), (*self.widen(), *begin_again)),
        ]

    def rejected(self, sensor: str) -> list[Stmt]:
        """A sample of a sensor was beyond the gate; `DUE` becomes 1 where that has gone on for too long."""
        rejected, begun = self.at("REJECTED", sensor), self.at("REJECTED_FROM", sensor)
        age, now = self.at("AGE", sensor), (Store(DUE, Num(1.0)),)
        return [
            When(Compare("<=", rejected, Num(0.0)), (Store(begun, age),)),
            self._count("REJECTED", sensor),
            When(Compare(">=", sub(age, begun), self._setting("RESET_AFTER")), now),
            When(Compare(">=", rejected, self._setting("RESET_COUNT")), now),
        ]

    def reset(self, sensor: str) -> list[Stmt]:
        """What comes before the states of a sensor are widened."""
        since, own = self.at("SINCE_RESET"), self.at("RESET", sensor)
        forget = tuple(Store(self.at("RESET", s), Num(0.0)) for s in self.sensors)
        return [
            When(Compare(">", since, self._setting("ESCALATE_WITHIN")), forget),
            When(Compare(">", own, Num(0.0)), tuple(self.widen())),
            Store(own, Num(1.0)),
            Store(since, Num(0.0)),
            self._count("RESETS"),
        ]

    @property
    def condition(self) -> Routine:
        """What the filter is worth now."""
        degraded = (StatusFlag("DEGRADED"),)
        settle, count = self._setting("SETTLE_TIME"), self._setting("DEGRADED_COUNT")
        body: list[Stmt] = [
            When(Compare(">", self.at("MISSED"), Num(0.0)), degraded),
            When(Compare("<", self.at("SINCE_RESET"), settle), degraded),
        ]
        for s in self.sensors:
            body.append(When(Compare(">=", self.at("REJECTED", s), count), degraded))
        for t in self.triads:
            body.append(When(Compare(">=", self.at("STUCK", t), self._setting("STUCK_TIME")), degraded))
        if "SINCE_LIMITED" in self._numbers:
            body.append(When(Compare("<", self.number("SINCE_LIMITED"), settle), degraded))
        if "ALIGNING" in self._numbers:
            body.append(When(Compare(">", self.number("ALIGNING"), Num(0.0)), (StatusFlag("ALIGNING"),)))
        lost: tuple[Stmt, ...] = (StatusFlag("LOST"),)
        for s in self.sensors:
            lost = (When(Compare(">", self.at("AGE", s), self._setting("LOST_AFTER")), lost),)
        return Routine("supervise", SUPERVISE_TEXT, (), (*body, *lost))


SUPERVISE_TEXT = (
    "Condition of the filter: OK, DEGRADED (samples rejected, predictions missed, or just reset) or LOST "
    "(no sample accepted for long)."
)


def widened(y: Expr, h: dict[int, Expr], prior: dict[int, Expr]) -> tuple[dict[int, Expr], Expr, Expr]:
    """Direction a along which a row widens P, its projection ``h a``, and the innovation y over it, squared.

    Parameters
    ----------
    y : Expr
        Innovation.
    h : dict of int to Expr
        Non-zeros of the row of the Jacobian, by state.
    prior : dict of int to Expr
        Prior standard deviation of those states.
    """
    a = {j: mul(mul(prior[j], prior[j]), c) for j, c in h.items()}
    projection = reduce(add, (mul(c, a[j]) for j, c in h.items()))
    ratio = Bin("/", y, projection)
    return a, projection, Bin("*", ratio, ratio)
