"""Models that the known answers of observability need, from the public classes alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import sympy as sp

from kfgen.audit.exact.chain import NullSpace, along
from kfgen.audit.exact.plan import Plan
from kfgen.core.expression import read_expression
from kfgen.effects import make
from kfgen.manoeuvre.manoeuvre import EXPRESSION_NAMES, Manoeuvre, Segment
from kfgen.model.filter import FilterModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import ACCEL, GRAVITY, GYRO, NED, MotionModel, Rotating, Strapdown
from kfgen.model.parts.sensors import (
    FIELD,
    GnssPosition,
    GnssVelocity,
    GravityDirection,
    MagneticField,
    Sensor,
)
from kfgen.model.plant.equations import filter_model
from kfgen.model.plant.file import parse_model
from kfgen.model.symbols.blocks import Attitude, Vector

G = Fraction("9.80665")
OMEGA = Fraction("7.292115e-5")
W_N, W_D = OMEGA * Fraction(3, 5), -OMEGA * Fraction(4, 5)
"""Earth rate at the latitude of sine 0.8."""
BODY = ("x", "y", "z")
EARTH = (
    Constant("W_N", "rad/s", float(W_N), "Earth rate, north"),
    Constant("W_D", "rad/s", float(W_D), "Earth rate, down"),
)


def earth_rate() -> sp.Matrix:
    return sp.Matrix([EARTH[0].symbol, 0, EARTH[1].symbol])


class EarthStrapdown(Strapdown):
    """Strapdown navigation on a turning Earth, whose rate the gyros show."""

    constants = (GRAVITY, *EARTH)

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        return {**super().rates(x, u), "phi": u["gyro"] - x["phi"].T * earth_rate()}


class CoriolisStrapdown(EarthStrapdown):
    """The same with the Coriolis force."""

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        plain = super().rates(x, u)
        return {**plain, "v": plain["v"] - 2 * earth_rate().cross(x["v"])}


class ScaledStrapdown(Strapdown):
    """Strapdown navigation whose gyros and accelerometers have unknown scale factors."""

    def __init__(self) -> None:
        super().__init__()
        scales = (
            Vector("sg", BODY, "1", "gyro scale", 1e-2),
            Vector("sa", BODY, "1", "accelerometer scale", 1e-2),
        )
        self.blocks = (*self.blocks, *scales)

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        one = sp.eye(3)
        true = {
            "gyro": (one + sp.diag(*x["sg"])) * u["gyro"],
            "accel": (one + sp.diag(*x["sa"])) * u["accel"],
        }
        return {**super().rates(x, true), "sg": sp.zeros(3, 1), "sa": sp.zeros(3, 1)}


class Misaligned(MotionModel):
    """Attitude and velocity from triads with a full matrix of scale and misalignment errors of the accelerometers."""

    blocks = (
        Vector("p", NED, "m", "position", 10.0),
        Vector("v", NED, "m/s", "velocity", 1.0),
        Attitude(),
        Vector("m", tuple("012345678"), "1", "accelerometer matrix", 1e-2),
    )
    inputs = (ACCEL, GYRO)
    constants = (GRAVITY,)

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        M = sp.eye(3) + x["m"].reshape(3, 3)
        return {
            "p": x["v"],
            "v": x["phi"] * M * u["accel"] + sp.Matrix([0, 0, GRAVITY.symbol]),
            "phi": u["gyro"],
            "m": sp.zeros(9, 1),
        }


@dataclass(frozen=True)
class With(MotionModel):
    """A motion with one more block of constants."""

    base: MotionModel
    block: Vector

    @property
    def blocks(self) -> Any:  # type: ignore[override]
        return (*self.base.blocks, self.block)

    @property
    def inputs(self) -> Any:  # type: ignore[override]
        return self.base.inputs

    @property
    def constants(self) -> Any:  # type: ignore[override]
        return self.base.constants

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        return {**self.base.rates(x, u), self.block.name: sp.zeros(len(self.block.axes), 1)}


class Shows(Sensor):
    """A sensor of one expression."""

    def __init__(self, name: str, needs: Sequence[str], size: int, predict: Any, constants: Any = ()) -> None:
        self.name = name
        self.title = name
        self.channels = tuple(f"{name}_{k}" for k in range(size))
        self.needs = tuple(needs)
        self.constants = constants
        self.sd = 0.1
        self._predict = predict

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        return self._predict(x)


def field() -> sp.Matrix:
    return sp.Matrix([FIELD[0].symbol, 0, FIELD[1].symbol])


LEVER = Vector("l", BODY, "m", "lever arm", 1.0)
IRON = Vector("h", BODY, "T", "hard iron", 1e-5)
DELAY = Vector("td", ("",), "s", "time delay", 0.1)
FEATURE = Vector("f1", NED, "m", "feature", 10.0, (30.0, 5.0, 3.0))
NAV_FIELD = Vector("mn", NED, "T", "field in the navigation frame", 1e-5, (2e-5, 0.0, 4e-5))

antenna = Shows("antenna", ("p", "phi", "l"), 3, lambda x: x["p"] + x["phi"] * x["l"])
iron = Shows("mag", ("phi", "h"), 3, lambda x: x["phi"].T * field() + x["h"], FIELD)
late = Shows("late", ("p", "v", "td"), 3, lambda x: x["p"] - x["v"] * x["td"][0])
heading = Shows("heading", ("phi",), 1, lambda x: sp.Matrix([x["phi"][1, 0] / x["phi"][0, 0]]))
own_field = Shows("mag", ("phi", "mn"), 3, lambda x: x["phi"].T * x["mn"])
both_fields = Shows("mag", ("phi", "mn", "h"), 3, lambda x: x["phi"].T * x["mn"] + x["h"])


def _bearing(x: Mapping[str, sp.Matrix]) -> sp.Matrix:
    s = x["phi"].T * (x["f1"] - x["p"])
    return sp.Matrix([s[1] / s[0], s[2] / s[0]])


camera = Shows("camera", ("p", "phi", "f1"), 2, _bearing)


def model(motion: MotionModel, *sensors: Sensor) -> FilterModel:
    """White noise and a constant bias on every input."""
    noise = {
        c: (make("white_noise", N=i.N), make("bias", sd=i.bias_prior))
        for i in motion.inputs
        for c in i.channels
    }
    return FilterModel("test", "a test", motion, sensors, noise)


def ins(motion: MotionModel | None = None, *more: Sensor) -> FilterModel:
    return model(motion or Strapdown(), GnssPosition(), GnssVelocity(), *more)


def ahrs(*sensors: Sensor) -> FilterModel:
    return model(Rotating(), *sensors)


def plant(text: str) -> FilterModel:
    return filter_model(parse_model('format = "kfgen-model-1"\n' + text, "plant.toml"))


def part(
    duration: str = "T", rate: Any = (0, 0, 0), a: Any = (0, 0, 0), body: Any = (0, 0, 0), **inputs: str
) -> Segment:
    def read(row: Any) -> Any:
        return tuple(read_expression(str(e), EXPRESSION_NAMES) for e in row)

    return Segment(
        read((duration,))[0], read(rate), read(a), read(body), {n: read((e,))[0] for n, e in inputs.items()}
    )


def flown(*segments: Segment, **start: Any) -> Manoeuvre:
    return Manoeuvre("test", "a test", segments, **start)


def hidden(m: FilterModel, manoeuvre: Manoeuvre) -> NullSpace:
    (h,) = along(Plan(m, m.sensors), [manoeuvre])
    return h


def holds(m: FilterModel, h: NullSpace, **direction: Any) -> bool:
    """Whether a direction, given by state, is hidden."""
    assert set(direction) <= {s.name for s in m.states}
    vector = [h.ring.of(Fraction(direction.get(s.name, 0))) for s in m.states]
    return h.contains(vector, h.ring)


gravity, magnetic = GravityDirection(), MagneticField()
__all__ = [n for n in dir() if not n.startswith("_") and n not in ("Path",)]
