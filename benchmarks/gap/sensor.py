"""`Sensor`: an assumed static sensor; `Recording`: one record of it that effects are added to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from case import SI, Array, noise_file
from noise import gauss_markov, gauss_markov_spectrum, smooth_wander

THERMOMETER_NOISE = 0.05
"""Standard deviation of a sample of the thermometer [degC]."""


@dataclass(frozen=True)
class Sensor:
    """A sensor at rest: a constant, white noise, sometimes a Gauss-Markov bias.

    Parameters
    ----------
    rate : float
        [Hz]
    white : float
        Standard deviation of a sample, in `unit`.
    sigma, tau : float
        Gauss-Markov bias, in `unit` and seconds; 0: none.
    """

    name: str
    channel: str
    unit: str
    rate: float
    n: int
    white: float
    sigma: float = 0.0
    tau: float = 0.0
    offset: float = 0.0

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return 1.0 / self.rate

    @property
    def numbers(self) -> dict[str, float]:
        """What is assumed, in `unit`."""
        out = {"N": self.white * self.dt**0.5}
        return out | {"sigma": self.sigma, "tau": self.tau} if self.sigma else out

    def spectrum(self, n: int) -> Array:
        """Assumed variance of each ordinate of n samples."""
        P: Array = np.full(n - 1, self.white**2)
        if self.sigma:
            P = np.asarray(P + gauss_markov_spectrum(n, self.dt, self.sigma, self.tau))
        return P

    def passed(self, n: int) -> Array:
        """The part of it that goes through a low-pass of the sensor: its white noise."""
        return np.full(n - 1, self.white**2)


SENSORS = (
    Sensor("B1", "gyro_z", "deg/s", 10.0, 16384, 1.0, offset=0.7),
    Sensor("B2", "gyro_z", "deg/s", 10.0, 16384, 1.0, 0.25, 20.0, offset=-0.4),
    Sensor("mems", "gyro_x", "deg/s", 100.0, 30000, 0.05, offset=0.31),
    Sensor("accel", "accel_z", "m/s^2", 50.0, 20000, 0.01, 0.0025, 15.0, offset=9.8),
)
"""N of ``mems`` is 0.005 deg/s/sqrt(Hz), that of ``accel`` 0.0014 m/s^2/sqrt(Hz)."""


@dataclass
class Recording:
    """A record being made.

    Parameters
    ----------
    white : array
        White noise, which effects on the noise change in place.
    added : array
        Everything else that is added, in the sensor's unit.
    rounded : float
        Step of the integrated output, in the sensor's unit times seconds; 0: not rounded.
    temperature, warmth : array
        The true temperature [degC], and what the thermometer says.
    """

    sensor: Sensor
    rng: np.random.Generator
    n: int
    white: Array
    added: Array
    temperature: Array
    warmth: Array
    companions: dict[str, tuple[Array, str]] = field(default_factory=dict)
    rounded: float = 0.0

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return self.sensor.dt

    @property
    def elapsed(self) -> Array:
        """Seconds since the first sample."""
        return np.arange(self.n) * self.dt

    @property
    def duration(self) -> float:
        """[s]"""
        return self.n * self.dt

    @property
    def si(self) -> float:
        """Factor of the sensor's unit to SI."""
        return SI[self.sensor.unit]

    @property
    def spectrum(self) -> Array:
        """Assumed variance of each ordinate."""
        return self.sensor.spectrum(self.n)

    def values(self) -> Array:
        """The channel as logged, in the sensor's unit."""
        y: Array = np.asarray(self.sensor.offset + self.white + self.added, float)
        if not self.rounded:
            return y
        angle = np.cumsum(y) * self.dt + self.rounded * self.rng.random()
        steps = np.round(np.concatenate([[angle[0] - y[0] * self.dt], angle]) / self.rounded)
        return np.asarray(np.diff(steps) * self.rounded / self.dt)

    def channels(self, thermometer: bool = True) -> dict[str, tuple[Array, str]]:
        """All channels of the log, with decoys."""
        out = {self.sensor.channel: (self.values(), self.sensor.unit), **self.companions}
        if thermometer:
            out["temperature"] = (self.warmth, "degC")
        return out | decoys(self.rng, self.n, self.dt)

    def model(self) -> str:
        """The noise file."""
        wanted: Mapping[str, tuple[str, Mapping[str, float]]] = {
            self.sensor.channel: (self.sensor.unit, self.sensor.numbers),
            **{name: (unit, self.sensor.numbers) for name, (_, unit) in self.companions.items()},
        }
        return noise_file(wanted)


def record(sensor: Sensor, rng: np.random.Generator, n: int = 0) -> Recording:
    """A record in which nothing is hidden."""
    n = n or sensor.n
    added = gauss_markov(rng, n, sensor.dt, sensor.sigma, sensor.tau) if sensor.sigma else np.zeros(n)
    temperature = climate(rng, n, sensor.dt)
    warmth = temperature + THERMOMETER_NOISE * rng.standard_normal(n)
    return Recording(sensor, rng, n, sensor.white * rng.standard_normal(n), added, temperature, warmth)


def climate(rng: np.random.Generator, n: int, dt: float) -> Array:
    """A temperature [degC]: warm-up of the board, the room's cycle, a slow wander."""
    t, T = np.arange(n) * dt, n * dt
    warm = rng.uniform(2.0, 8.0) * (1.0 - np.exp(-t / (T * rng.uniform(0.08, 0.3))))
    cycle = rng.uniform(1.0, 3.0) * np.sin(2.0 * np.pi * (t / (T * rng.uniform(0.4, 1.2)) + rng.random()))
    return np.asarray(22.0 + warm + cycle + smooth_wander(rng, n, dt, 0.3, 0.05 * T))


def decoys(rng: np.random.Generator, n: int, dt: float) -> dict[str, tuple[Array, str]]:
    """Channels that have nothing to do with the sensor."""
    T = n * dt
    supply = (
        5.0
        + smooth_wander(rng, n, dt, 0.02, 0.03 * T)
        - 0.05 * (np.arange(n) * dt > T * rng.uniform(0.2, 0.8))
    )
    humidity = 40.0 + smooth_wander(rng, n, dt, 2.0, 0.1 * T) + 0.1 * rng.standard_normal(n)
    return {
        "supply": (supply + 0.002 * rng.standard_normal(n), "V"),
        "humidity": (humidity, "%"),
    }
