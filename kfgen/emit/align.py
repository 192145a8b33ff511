"""Alignment: the first attitude from what points up and, where there is such a sensor, north, at rest.

Samples are gathered until they have been quiet for `ALIGN_TIME`; one that turns, shakes or is not of gravity's length
throws away what was gathered, and the reason is kept. The means then give two directions in body axes, down and a
horizontal one, whose counterparts in navigation axes are known [1]_; with them

    R_nb = n_n n_b' + e_n e_b' + d_n d_b',   e = d x m / |d x m|,   n = e x d

at any attitude. Without a magnetometer the second direction is the body's forward axis (its down axis where that one
is within 26 degrees of the vertical), at the heading that the caller gives. The covariance goes back to the priors,
its attitude to the tilt's and the heading's variance, in whatever axes the error is written.

References
----------
.. [1] H. D. Black, A passive system for determining the attitude of a satellite, AIAA Journal 2(7), 1964.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot

import sympy as sp

from kfgen.core.units import STANDARD_GRAVITY
from kfgen.model.filter import FilterModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import ACCEL, GYRO, Input
from kfgen.model.parts.sensors import Sensor
from kfgen.model.symbols.expanded import part_without

PLACES = {
    "ALIGNING": "1 from the first call of align until the attitude is known",
    "ALIGN_REASON": "why what was gathered was thrown away last, a kf_reason_t",
    "ALIGN_GATHERED": "gathered so far [s]",
    "ALIGN_COUNT": "samples gathered",
}
SUMS = {"FORCE": "specific force", "RATE": "angular rate", "FIELD": "magnetic field"}
ALIGN_TIME_S = 1.0
MAX_NOSE = 0.9
"""Share of the vertical in the body's forward axis from which the down axis stands for it."""
LEAST_HORIZONTAL = 0.1
"""Share of a field that must be horizontal: 6 degrees off the vertical."""
ALIGN_TEXT = (
    "A sample at rest: the attitude is known once enough of them were quiet in a row (OK), until then ALIGNING. The "
    "covariance then is at the priors, and other states stay as they are."
)
HEADING = "heading"
"""The argument of a filter that nothing shows north."""
SPREAD, TILTED, AHEAD = "spread", "tilted", "ahead"
"""Scratch: variances of the heading beyond the tilt's, and of the tilt; the horizontal body direction."""


@dataclass(frozen=True)
class Alignment:
    """What points up and north in a model, and its first attitude.

    Parameters
    ----------
    model : FilterModel
    """

    model: FilterModel

    @property
    def possible(self) -> bool:
        """Whether there is an attitude, a gyro, and what points up."""
        gyro = any(i.name == GYRO.name for i in self.model.motion.inputs)
        return self.model.attitude is not None and gyro and self.up is not None

    @cached_property
    def up(self) -> Input | Sensor | None:
        """What points up at rest."""
        parts: list[Input | Sensor] = [*self.model.motion.inputs, *self.model.sensors]
        return next((p for p in parts if p.at_rest == "up"), None)

    @cached_property
    def north(self) -> Sensor | None:
        """What shows a direction that is not the vertical; None where the caller gives the heading."""
        return next((s for s in self.model.sensors if s.at_rest == "north"), None)

    @property
    def sums(self) -> tuple[str, ...]:
        """The vectors that are gathered."""
        return tuple(SUMS)[: 3 if self.north else 2] if self.possible else ()

    @property
    def places(self) -> list[tuple[str, str]]:
        """Name and meaning of each of its numbers, in order."""
        if not self.possible:
            return []
        vectors = [(f"ALIGN_{s}_{a}", f"sum of the {SUMS[s]}, {a.lower()}") for s in self.sums for a in "XYZ"]
        return [*((n, f"alignment: {text}") for n, text in (*PLACES.items(), *vectors))]

    @cached_property
    def _views(self) -> dict[str, sp.Matrix]:
        blocks = {b.name: b.value for b in self.model.blocks}
        level = self.model.motion.offers({b.name: b.value for b in self.model.motion.blocks}, {})["level"]
        return blocks | {"phi": sp.eye(3), "level": level}

    @property
    def level(self) -> sp.Matrix:
        """Navigation axes to north-east-down at the start."""
        return self._views["level"]

    @property
    def field(self) -> sp.Matrix:
        """The magnetic field in navigation axes as the model has it: its declination is in it."""
        assert self.north is not None
        return self.north.predict(self._views)

    @property
    def offset(self) -> list[sp.Expr]:
        """What the filter knows that the body adds to the field, as far as states and constants alone say it [T]."""
        assert self.north is not None
        assert self.model.attitude is not None
        clean = self.model.clean(self.north)
        own = [e - c for e, c in zip(self.model.expected(self.north), clean)]
        known = {n for b in self.model.blocks for n in b.nominal_names} - set(
            self.model.attitude.nominal_names
        )
        known |= {s.name for s in self.model.states} | {c.name for c in self.model.constants}
        return [part_without(e, {s for s in e.free_symbols if s.name not in known}) for e in own]

    @property
    def shown_at_rest(self) -> dict[str, tuple[int, float]]:
        """Constants and states that the field shows at rest: navigation axis and sign of each."""
        assert self.north is not None
        if not self.north.calibrated((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
            return {}
        field = list(self.field)
        symbols = {s for e in field for s in e.free_symbols}
        return {
            s.name: (i, float(e / s))
            for s in sorted(symbols, key=lambda s: s.name)
            for i, e in enumerate(field)
            if e in (s, -s)
        }

    @property
    def tilt(self) -> float:
        """Standard deviation of the tilt after alignment [rad]: an accelerometer's bias is not distinguished from it."""
        return hypot(ACCEL.bias_prior, getattr(self.up, "left_out", 0.0)) / STANDARD_GRAVITY

    def constants(self) -> list[Constant]:
        """Its settings."""
        if not self.possible:
            return []
        return [
            Constant("ALIGN_TIME", "s", ALIGN_TIME_S, "time at rest from which the first attitude is taken"),
            Constant("ALIGN_MAX_RATE", "rad/s", 0.1, "an angular rate beyond it is no rest"),
            Constant("ALIGN_MAX_SHAKE", "m/s^2", 0.5, "a specific force so far from the mean is no rest"),
            Constant(
                "ALIGN_MAX_FORCE", "m/s^2", 1.0, "a specific force so much off gravity's length is no rest"
            ),
            Constant("ALIGN_TILT", "rad", self.tilt, "standard deviation of the tilt after alignment"),
            Constant(
                "ALIGN_HEADING", "rad", self._heading(self.tilt), "standard deviation of the heading after it"
            ),
        ]

    def _heading(self, tilt: float) -> float:
        """As it was given, else by the tilt times that of the field, what bends it, and what the body adds."""
        assert self.model.attitude is not None
        if self.north is None:
            names = [s.name for s in self.model.states]
            return self.model.states[names.index(self.model.attitude.error_names[2])].prior
        start = {c.name: c.value for c in self.model.constants}
        for b in self.model.blocks:
            start |= dict(zip(b.nominal_names, b.start))
        field = self.level * self.field
        known = field.subs({s: start[s.name] for s in field.free_symbols})
        horizontal, down = hypot(float(known[0]), float(known[1])), float(known[2])
        iron = self.north.bias_prior if self.north.biases else 0.0
        bent = hypot(self.north.left_out / ALIGN_TIME_S**0.5, self.north.sd, iron)
        return min(hypot(tilt * down, bent) / horizontal, 1.0) if horizontal else 1.0
