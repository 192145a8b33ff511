"""Biases proportional to something that is recorded beside the sensor.

`Driver` says what a recorded driver is; each proportional effect is one class with its unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import Effect, Look, parameter
from kfgen.effects.filter_role import DrivenOutput, FilterPlace, FilterRole
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.series import Detection, WhiteSeries

Array = NDArray[np.float64]
T = TypeVar("T", bound=Effect)


@dataclass(frozen=True)
class Driver:
    """A recorded quantity that drives effects.

    Parameters
    ----------
    unit : str
        SI unit.
    level, rise, swing : float
        A course that people meet, for simulations: it starts at `level`, settles by `rise`, and swings.
    effect : str
        The effect of the catalogue that is proportional to it; without one it acts as ``coupling:NAME``.
    read_by : str
        The sensor whose own reading it is: beside that sensor's channels it drives nothing, for it has their noise.
    drives : str
        The sensor of a vehicle that it is known to drive, a motor's current a magnetometer; empty where it may drive any.
    shakes : tuple of str
        The sensors whose noise it is known to raise.
    """

    unit: str
    level: float
    rise: float
    swing: float
    effect: str = ""
    read_by: str = ""
    drives: str = ""
    shakes: tuple[str, ...] = ()

    def course(self, t: Array) -> Array:
        """A course over times `t` [s], shape (n,)."""
        T = float(t[-1] - t[0]) or 1.0
        settled = self.rise * (1.0 - np.exp(-6.0 * t / T))
        return np.asarray(self.level + settled + self.swing * np.sin(4.5 * np.pi * t / T))


DRIVERS: Mapping[str, Driver] = {
    "temperature": Driver("K", 293.15, 12.0, 4.0, "temperature"),
    "voltage": Driver("V", 5.0, -0.2, 0.05, "supply_voltage"),
    "current": Driver("A", 1.0, 0.5, 0.5, "supply_current", drives="mag"),
    "pressure": Driver("Pa", 101325.0, -300.0, 100.0, "air_pressure", read_by="baro"),
    "humidity": Driver("", 0.4, 0.1, 0.05, "humidity"),
    "throttle": Driver("", 0.3, 0.3, 0.2, drives="baro"),
    "vibration": Driver("m/s^2", 0.5, 1.0, 0.5, shakes=("accel", "gyro")),
    "clipping": Driver("1/s", 2.0, 2.0, 1.0, drives="accel", shakes=("accel",)),
}
"""By the name of its channel."""


def driver_named(channel: str) -> Driver:
    """What is known of a driver; of any other channel nothing."""
    return DRIVERS.get(channel, Driver("", 1.0, 0.5, 0.2))


@dataclass(frozen=True)
class DriverProportional(Effect):
    """A bias proportional to a driver, about a stated reference of it."""

    coefficient: Any = parameter("U", "signed")
    reference: float = parameter("", "setting", 0.0)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "title" not in vars(cls):
            cls.title = f"bias proportional to {cls.driver or 'another channel'}"
            cls.sentence_template = f"follows the {cls.driver or 'other channel'} by {{coefficient}}"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """About the driver's mean, where it is recorded and changes."""
        return [cls(0.0, look.drive[cls.driver])] if cls.driver in look.drive else []

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``y = coefficient (driver - reference)``, the coefficient a constant state."""
        away = drive[self.driver] - self.reference if drive else 0.0
        unit = self.parameters()[0].unit
        return LinearSystem(
            A=((0,),),
            W=((0,),),
            C=(away,),
            x0=(self.coefficient,),
            states=(State(self.name.replace(":", "_"), unit),),
        )

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The coefficient, known or a state, times the driver about its reference."""
        return DrivenOutput(lambda driver, _: driver - self.reference, self.driver)


@dataclass(frozen=True)
class Temperature(DriverProportional):
    """A bias proportional to the temperature, about a stated reference temperature."""

    coefficient: Any = parameter("U/K", "signed")
    reference: float = parameter("K", "setting", 298.15)

    name: ClassVar[str] = "temperature"
    separating_experiment: ClassVar[str] = "a temperature that rises and falls"
    driver: ClassVar[str] = "temperature"


@dataclass(frozen=True)
class TemperatureSquared(DriverProportional):
    """A bias proportional to the square of the temperature, about a stated reference temperature."""

    coefficient: Any = parameter("U/K^2", "signed")
    reference: float = parameter("K", "setting", 298.15)

    name: ClassVar[str] = "temperature_squared"
    title: ClassVar[str] = "bias proportional to the square of the temperature"
    sentence_template: ClassVar[str] = "follows the square of the temperature by {coefficient}"
    prior_penalty_nats: ClassVar[float] = (
        6.0  # a curve about the mean comes with a slope: alone it is most likely another drift
    )
    separating_experiment: ClassVar[str] = "a temperature that passes a wide range"
    driver: ClassVar[str] = "temperature"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """Only where it is looked for."""
        return []

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """About the mean of a thermometer that moves."""
        warm = series.drive.get(cls.driver)
        return [Detection(cls(0.0, float(np.mean(warm))))] if warm is not None and np.ptp(warm) > 0.0 else []

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``y = coefficient (T - reference)^2``, the coefficient a constant state."""
        linear = super().form(drive)
        return replace(linear, C=(linear.C[0] ** 2,))

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The coefficient times the square."""
        return DrivenOutput(lambda driver, _: (driver - self.reference) ** 2, self.driver)


@dataclass(frozen=True)
class SupplyVoltage(DriverProportional):
    """A bias proportional to the supply voltage."""

    coefficient: Any = parameter("U/V", "signed")
    reference: float = parameter("V", "setting", 0.0)

    name: ClassVar[str] = "supply_voltage"
    separating_experiment: ClassVar[str] = "a supply that is turned up and down at constant temperature"
    driver: ClassVar[str] = "voltage"


@dataclass(frozen=True)
class SupplyCurrent(DriverProportional):
    """A bias proportional to a current nearby: of a motor beside a magnetometer, of a heater."""

    coefficient: Any = parameter("U/A", "signed")
    reference: float = parameter("A", "setting", 0.0)

    name: ClassVar[str] = "supply_current"
    separating_experiment: ClassVar[str] = "the current switched on and off while nothing else changes"
    driver: ClassVar[str] = "current"


@dataclass(frozen=True)
class AirPressure(DriverProportional):
    """A bias proportional to the pressure of the air."""

    coefficient: Any = parameter("U/Pa", "signed")
    reference: float = parameter("Pa", "setting", 0.0)

    name: ClassVar[str] = "air_pressure"
    separating_experiment: ClassVar[str] = "a pressure chamber at constant temperature"
    driver: ClassVar[str] = "pressure"


@dataclass(frozen=True)
class Humidity(DriverProportional):
    """A bias proportional to the humidity of the air, a share of one."""

    coefficient: Any = parameter("U", "signed")
    reference: float = parameter("", "setting", 0.0)

    name: ClassVar[str] = "humidity"
    separating_experiment: ClassVar[str] = "a climate chamber at constant temperature"
    driver: ClassVar[str] = "humidity"


COUPLING = "coupling:"
"""Before the name of a channel: the effect of that channel."""
SENSED = ("gyro", "accel", "mag", "ref_")
"""How channels begin that are driven themselves, or what should have been read."""


@dataclass(frozen=True)
class Coupling(DriverProportional):
    """A bias proportional to any other recorded channel, ``coupling:NAME``; per SI unit of that channel."""

    name: ClassVar[str] = "coupling"
    prior_penalty_nats: ClassVar[float] = 1.0
    separating_experiment: ClassVar[str] = "that channel moved by itself, all else kept"

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Each recorded channel that drives no other effect, that of highest regression first."""
        names = [n for n in series.drive if not driver_named(n).effect and is_channel(n)]
        ranked = sorted(names, key=lambda n: -abs(series.regression(series.drive[n])[0]))
        chance = -float(np.log(max(len(names), 1)))
        return [Detection(coupled(n)(0.0, float(np.mean(series.drive[n]))), chance) for n in ranked[:1]]


def is_plain(name: str) -> bool:
    """Whether a channel's name may stand in a model, and so in emitted code: letters, digits and underscores."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) is not None


def is_channel(name: str) -> bool:
    """Whether a channel may drive a bias: its name is plain, and it is no axis of a sensor and no reference."""
    return is_plain(name) and not name.startswith(SENSED)


@cache
def coupled(channel: str) -> type[Coupling]:
    """The effect of a channel whose name is plain."""
    return of_channel(Coupling, channel)


def of_channel(general: type[T], channel: str) -> type[T]:
    """A general effect, ``NAME:CHANNEL``, of one channel whose name is plain."""
    words = {
        "name": f"{general.name}:{channel}",
        "driver": channel,
        "title": f"{general.title.replace('another channel', channel)}, per SI unit of it",
        "sentence_template": general.sentence_template.replace("other channel", channel),
        "__doc__": f"{general.__doc__} Here: {channel}.",
    }
    made: Any = type(f"{general.__name__}OfChannel", (general,), words)
    own: type[T] = dataclass(frozen=True)(made)
    return own
