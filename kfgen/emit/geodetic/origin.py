"""The routines of the border: an origin, a fix as metres from it, and metres as a place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from kfgen.core.wgs84 import EARTH_RATE
from kfgen.emit.guards import every, within
from kfgen.emit.ir.ir import (
    All,
    Argument,
    Bin,
    Compare,
    Expr,
    FunctionCall,
    Let,
    Num,
    Ref,
    Routine,
    StatusFlag,
    Stmt,
    Store,
    Una,
    When,
    add,
    mul,
    neg,
    sub,
)
from kfgen.emit.ir.lower import Lowering
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.earth import radii
from kfgen.model.parts.motion import Strapdown

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

ORIGIN, LOCAL, MOVED, PLACE = "origin", "local", "moved", "place"
OF_ORIGIN = {
    "STARTED": "1 once there is one",
    "LATITUDE": "geodetic [rad]",
    "LONGITUDE": "[rad]",
    "HEIGHT": "above the ellipsoid [m]",
    "R_N": "metres of a radian of latitude",
    "R_E": "metres of a radian of longitude",
    "W_N": "Earth rate, north component [rad/s]",
    "W_D": "Earth rate, down component [rad/s]",
}
KNOWN = ("latitude", "height", "r_N", "r_E", "W_N", "W_D")
"""Constants of a filter that say where its origin is."""
MAX_LATITUDE = math.radians(89.0)
MAX_HEIGHT_M = 1e5
EARTH_ROUND_M, MAX_SCALE, MAX_OF_PLACE = 4e7, 1e2, 1e7
"""By which an origin moves at most, what a scale of it is at most, and a constant of a place [SI]."""
SETTINGS = (
    Constant("MAX_DISTANCE", "m", 1e4, "a filter that is farther from the origin moves it to itself"),
    Constant("MAX_FIX_DISTANCE", "m", 1e6, "a fix that is farther from the origin is not taken"),
)
SET_TEXT = "The origin of the local axes: latitude and longitude [rad], height above the ellipsoid [m]."
FIX_TEXT = (
    "A fix as metres north, east and down of the origin, in `local`. ORIGIN_SET with the first one; RECENTRED where the "
    "filter, which is at p, was too far off: `moved` then says by what; TOO_FAR: the fix is not to be used."
)
PLACE_TEXT = (
    "Latitude and longitude [rad] and height [m] of metres north, east and down of the origin, in `place`."
)


def bordered(program: Program) -> bool:
    """Whether a filter has a place: a local level frame, in which its own position alone depends on north and east."""
    model = program.discrete.model
    if not isinstance(model.motion, Strapdown):
        return False
    names = [s.name for s in model.states]
    own = [names.index(n) for n in ("p_N", "p_E")]
    others = [s for s in model.sensors if s.shows != "p"]
    return not any(
        program.discrete.H(s)[i, k] != 0 for s in others for i in range(len(s.channels)) for k in own
    )


@dataclass(frozen=True)
class Border:
    """The border of a filter: a program of its own in double precision, that every target prints and every core proves.

    Parameters
    ----------
    program : Program
        For which `bordered` holds.
    """

    program: Program
    real: str = "double"
    n: int = 1
    varied: tuple[str, ...] = ()
    helpers: tuple[Routine, ...] = ()

    @property
    def name(self) -> str:
        """Of its structure, its header and its functions' beginning."""
        return f"{self.program.name}_geodetic"

    @property
    def type(self) -> type[np.floating[Any]]:
        """Numpy's type of its numbers."""
        return np.float64

    @property
    def settings(self) -> tuple[Constant, ...]:
        """Distances."""
        return SETTINGS

    @property
    def arrays(self) -> dict[str, tuple[int, str]]:
        """Its memory: size and meaning."""
        return {
            ORIGIN: (len(OF_ORIGIN), ", ".join(f"{n.lower()} {t}" for n, t in OF_ORIGIN.items())),
            LOCAL: (3, "the last fix: north, east, down of the origin [m]"),
            PLACE: (3, "the last place: latitude, longitude [rad], height [m]"),
            MOVED: (
                5,
                "1 where the origin has moved with the last fix; north and east of the old one [m], and scales",
            ),
        }

    @property
    def compared(self) -> tuple[str, ...]:
        """All of it."""
        return tuple(self.arrays)

    @property
    def word_count(self) -> int:
        """Numbers of it."""
        return sum(size for size, _ in self.arrays.values())

    @cached_property
    def routines(self) -> tuple[Routine, ...]:
        """An origin, a fix, a place."""
        return (self._init(), self._set_origin(), self._fix(), self._to_place())

    @property
    def entries(self) -> tuple[Routine, ...]:
        """All."""
        return self.routines

    @property
    def known(self) -> tuple[tuple[int, str], ...]:
        """The filter's constants that say where its origin is: place among them, and name."""
        names = [c.name for c in self.program.constants]
        return tuple((names.index(n), n) for n in KNOWN if n in names)

    @property
    def words(self) -> dict[str, Any]:
        """What the templates of every language know of it."""
        names = self.program.discrete.nominal_names
        return {
            "border": self,
            "position": [names.index(n) for n in ("p_N", "p_E", "p_D")],
            "known": [list(OF_ORIGIN).index(n.upper()) for _, n in self.known],
        }

    @staticmethod
    def at(name: str) -> Ref:
        """A number of the origin."""
        return Ref(ORIGIN, list(OF_ORIGIN).index(name))

    def _setting(self, name: str) -> Num:
        return Num(next(s.value for s in SETTINGS if s.name == name), name)

    @staticmethod
    def _coordinates() -> tuple[Argument, ...]:
        return (
            Argument("latitude", 0, "geodetic latitude [rad]"),
            Argument("longitude", 0, "longitude [rad]"),
            Argument("height", 0, "height above the ellipsoid [m]"),
        )

    def _possible(self) -> list[Compare]:
        limits = (Num(MAX_LATITUDE), Num(2.0 * math.pi), Num(MAX_HEIGHT_M))
        return [c for a, limit in zip(self._coordinates(), limits) for c in within(a, limit)]

    def _init(self) -> Routine:
        body = [Store(Ref(a, i), Num(0.0)) for a, (size, _) in self.arrays.items() for i in range(size)]
        return Routine("init", "No origin yet.", (), tuple(body))

    def _set_origin(self) -> Routine:
        L, h = sp.Symbol("latitude", real=True), sp.Symbol("height", real=True)
        r_N, r_E = radii(sp.sin(L))
        # A frame that stays level on its way counts in metres of the ellipsoid, a flat one in those of its height.
        above = 0 if self.program.discrete.model.motion.chosen["transport_rate"] else h
        found = [r_N + above, (r_E + above) * sp.cos(L), EARTH_RATE * sp.cos(L), -EARTH_RATE * sp.sin(L)]
        lower = Lowering({n: Ref(n) for n in ("latitude", "height")})
        values, body = lower.many(found)
        stores = [Store(self.at(n), Ref(n.lower())) for n in ("LATITUDE", "LONGITUDE", "HEIGHT")]
        stores += [Store(self.at(n), v) for n, v in zip(("R_N", "R_E", "W_N", "W_D"), values)]
        stores.append(Store(self.at("STARTED"), Num(1.0)))
        allowed = When(every(self._possible()), (*body, *stores), (StatusFlag("BAD_INPUT"),))
        return Routine("set_origin", SET_TEXT, self._coordinates(), (allowed,))

    def _fix(self) -> Routine:
        p = Argument("p", 3, "position of the filter: north, east, down of the origin [m]")
        given = tuple(Ref(a.name) for a in self._coordinates())
        first: list[Stmt] = [
            FunctionCall("set_origin", given, True),
            StatusFlag("ORIGIN_SET"),
            *self._said((Num(0.0), Num(0.0)), (Num(1.0), Num(1.0))),
        ]
        most, farthest = self._setting("MAX_DISTANCE"), self._setting("MAX_FIX_DISTANCE")
        off = self._squared(Ref("p", 0), Ref("p", 1))
        far = When(Compare(">", off, mul(most, most)), tuple(self._recentred()))
        started = Compare(">", self.at("STARTED"), Num(0.0))
        local = self._local()
        size = self._squared(Ref("north"), Ref("east"))
        stores = tuple(Store(Ref(LOCAL, i), Ref(n)) for i, n in enumerate(("north", "east", "down")))
        near = When(Compare("<=", size, mul(farthest, farthest)), stores, (StatusFlag("TOO_FAR"),))
        body: list[Stmt] = [When(started, (far,), tuple(first)), *local, near]
        allowed = When(every(self._possible()), tuple(body), (StatusFlag("BAD_INPUT"),))
        still = Store(Ref(MOVED, 0), Num(0.0))
        return Routine("fix", FIX_TEXT, (*self._coordinates(), p), (still, allowed))

    @staticmethod
    def _squared(a: Expr, b: Expr) -> Expr:
        return add(mul(a, a), mul(b, b))

    @staticmethod
    def _wrapped(angle: Expr) -> Expr:
        turn = 2.0 * math.pi
        return sub(angle, mul(Num(turn), Una("rint", mul(angle, Num(1.0 / turn)))))

    def _local(self) -> list[Stmt]:
        east = Ref("turned")
        return [
            Let("turned", sub(Ref("longitude"), self.at("LONGITUDE"))),
            Let("north", mul(sub(Ref("latitude"), self.at("LATITUDE")), self.at("R_N"))),
            Let("east", mul(self._wrapped(east), self.at("R_E"))),
            Let("down", sub(self.at("HEIGHT"), Ref("height"))),
        ]

    def _recentred(self) -> list[Stmt]:
        """The origin at the filter's own position; heights stay as they are."""
        return [
            Let("before_N", self.at("R_N")),
            Let("before_E", self.at("R_E")),
            Let("there", add(self.at("LATITUDE"), Bin("/", Ref("p", 0), Ref("before_N")))),
            Let("along", add(self.at("LONGITUDE"), Bin("/", Ref("p", 1), Ref("before_E")))),
            When(every(within(Argument("there", 0, ""), Num(MAX_LATITUDE))), tuple(self._moved())),
        ]

    def _moved(self) -> list[Stmt]:
        return [
            FunctionCall("set_origin", (Ref("there"), self._wrapped(Ref("along")), self.at("HEIGHT")), True),
            Let("scale_N", Bin("/", self.at("R_N"), Ref("before_N"))),
            Let("scale_E", Bin("/", self.at("R_E"), Ref("before_E"))),
            StatusFlag("RECENTRED"),
            *self._said((Ref("p", 0), Ref("p", 1)), (Ref("scale_N"), Ref("scale_E"))),
        ]

    @staticmethod
    def _said(offset: Sequence[Expr], scale: Sequence[Expr]) -> list[Stmt]:
        values = (Num(1.0), *offset, *scale)
        return [Store(Ref(MOVED, i), v) for i, v in enumerate(values)]

    def _to_place(self) -> Routine:
        p = Argument("p", 3, "metres north, east, down of the origin")
        values = (
            add(self.at("LATITUDE"), Bin("/", Ref("p", 0), self.at("R_N"))),
            self._wrapped(Ref("longitude_of")),
            add(self.at("HEIGHT"), neg(Ref("p", 2))),
        )
        along = Let("longitude_of", add(self.at("LONGITUDE"), Bin("/", Ref("p", 1), self.at("R_E"))))
        stores = tuple(Store(Ref(PLACE, i), v) for i, v in enumerate(values))
        started = All((Compare(">", self.at("STARTED"), Num(0.0)),))
        return Routine(
            "to_place", PLACE_TEXT, (p,), (When(started, (along, *stores), (StatusFlag("BAD_INPUT"),)),)
        )


def recentre(program: Program) -> Routine:
    """The filter after its origin has moved: positions less an offset, times a scale, and constants of the place."""
    known = Border(program).known
    offset = Argument("offset", 2, "north and east of the old origin [m]")
    scale = Argument("scale", 2, "of north and east")
    names = [n for _, n in known]
    at = Argument("at", len(names), f"constants of the new origin: {', '.join(names)}")
    stored = program.discrete.nominal_names
    moved = [[Ref("x", stored.index(n))] for n in ("p_N", "p_E")]
    scaled: list[list[Ref]] = [[], []]
    body: list[Stmt] = []
    if program.horizon:
        memory = program.delayed_memory
        for axis, name in enumerate(("p_N", "p_E")):
            place = memory.names.index(name)
            moved[axis] += [Ref("present", place)]
            scaled[axis] += [memory.correction(place), memory.correction(place, True)]
        body += memory.moved()
    for axis in range(2):
        off, by = Ref("offset", axis), Ref("scale", axis)
        body += [Store(r, mul(sub(r, off), by)) for r in moved[axis]]
        body += [Store(r, mul(r, by)) for r in scaled[axis]]
    body += [Store(Ref("k", k), Ref("at", i)) for i, (k, _) in enumerate(known)]
    arguments = (offset, scale, *((at,) if names else ()))
    looked = [
        c
        for a, most in zip(arguments, (EARTH_ROUND_M, MAX_SCALE, MAX_OF_PLACE))
        for c in within(a, Num(most))
    ]
    return Routine(
        "recentre",
        "The filter after its origin has moved, as `moved` of the border says.",
        arguments,
        (When(every(looked), tuple(body), (StatusFlag("BAD_INPUT"),)),),
    )
