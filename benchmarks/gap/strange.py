"""Disturbances that the catalogue does not hold and that swing, each with numbers that stay and a course that is drawn anew."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from noise import Array, smooth_wander
from scipy.fft import dct
from scipy.integrate import solve_ivp
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, lfilter, sosfilt

Numbers = Mapping[str, float]
DRAWN = 24
"""Courses over which the spectrum of a disturbance is averaged."""
SMOOTH = 9
"""Neighbouring ordinates that are averaged too, where the spectrum is not steep."""


@dataclass(frozen=True)
class Strange:
    """A disturbance.

    Parameters
    ----------
    numbers : callable of (generator, n, dt)
        What belongs to the sensor and stays from one record to the next.
    course : callable of (generator, n, dt, numbers)
        A record of it, shape (n,), of no particular size.
    lasting : bool
        Whether a second record has the same spectrum.
    smooth : int
        Ordinates over which its spectrum may be averaged.
    """

    numbers: Callable[[np.random.Generator, int, float], Numbers]
    course: Callable[[np.random.Generator, int, float, Numbers], Array]
    lasting: bool = True
    smooth: int = SMOOTH

    def spectrum(self, n: int, dt: float, numbers: Numbers) -> Array:
        """Mean variance of each ordinate over drawn courses, at unit size."""
        rng = np.random.default_rng(0)
        draws = [dct(self.course(rng, n, dt, numbers), norm="ortho")[1:] for _ in range(DRAWN)]
        return np.asarray(uniform_filter1d(np.mean(np.square(draws), axis=0), self.smooth, mode="nearest"))


def _sweep(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"start": rng.uniform(0.01, 0.03) / dt}


def _chirp(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A tone that sweeps over a decade while its amplitude wanders."""
    u, duration = np.arange(n) / n, n * dt
    phase = 2.0 * np.pi * v["start"] * duration * (10.0**u - 1.0) / np.log(10.0)
    amplitude = 1.0 + smooth_wander(rng, n, dt, 0.5, 0.05 * duration)
    return np.asarray(amplitude * np.sin(phase))


def _thermostat(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"period": n * dt / rng.uniform(25.0, 60.0)}


def _heater(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A thermostat: a duty cycle that drifts, seen through one pole."""
    wander = 0.15 * smooth_wander(rng, n, dt, 1.0, 0.1 * n * dt)
    phase = np.cumsum(1.0 + wander) * dt / v["period"] + rng.random()
    phi = np.exp(-dt / (0.1 * v["period"]))
    on = (np.mod(phase, 1.0) < 0.25).astype(float)
    return np.asarray(lfilter([1.0 - phi], [1.0, -phi], on))


def _rest(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"breath": n * dt / rng.uniform(60.0, 150.0)}


def _breathing(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """Somebody breathes: in over 40 % of a breath, out over the rest; every breath is as long and as deep as it is."""
    count = int(3 * n * dt / v["breath"])
    ends = np.cumsum(v["breath"] * np.exp(0.15 * rng.standard_normal(count)))
    depth = np.exp(0.2 * rng.standard_normal(count))
    t = np.arange(n) * dt + ends[0] * rng.random()
    k = np.searchsorted(ends, t)
    start = np.concatenate([[0.0], ends])[k]
    u = (t - start) / (ends[k] - start)
    turned = np.where(u < 0.4, u / 0.4, 1.0 + (u - 0.4) / 0.6)
    return np.asarray(depth[k] * 0.5 * (1.0 - np.cos(np.pi * turned)))


def _rung(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {
        "frequency": float(np.exp(rng.uniform(np.log(0.01), np.log(0.1)))) / dt,
        "count": rng.uniform(10.0, 40.0),
    }


def _knocks(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """Knocks at any time that ring down over three cycles, some harder than others."""
    at = rng.random(n) < v["count"] / n
    hit = at * rng.choice([-1.0, 1.0], n) * np.exp(0.5 * rng.standard_normal(n))
    w, fade = 2.0 * np.pi * v["frequency"] * dt, np.exp(-v["frequency"] * dt / 3.0)
    return np.asarray(lfilter([0.0, fade * np.sin(w)], [1.0, -2.0 * fade * np.cos(w), fade**2], hit))


def _turns(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"unit": n * dt / rng.uniform(60.0, 150.0)}


def _lorenz(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """The first coordinate of the Lorenz system, some hundred turns."""

    def slope(_: float, s: Array) -> list[float]:
        x, y, z = s
        return [10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z]

    span, start = n * dt / v["unit"], [1.0 + rng.random(), 1.0, 20.0]
    at = 10.0 + span * np.arange(n) / n
    solved = solve_ivp(slope, (0.0, span + 10.0), start, t_eval=at, rtol=1e-7)
    return np.asarray(solved.y[0])


def _loads(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"stay": n * dt / rng.uniform(10.0, 30.0), "frequency": rng.uniform(800.0, 2400.0) / (n * dt)}


def _ripple(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A supply's line, of a load that switches on and off."""
    on = (np.cumsum(rng.random(n) < dt / v["stay"]) + rng.integers(2)) % 2
    phase = 2.0 * np.pi * (min(v["frequency"], 0.35 / dt) * dt * np.arange(n) + rng.random())
    return np.asarray(on * np.sin(phase))


def _pace(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"frequency": rng.uniform(100.0, 300.0) / (n * dt)}


def _fan(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A fan whose speed wanders by a twentieth, and its second harmonic."""
    pace = 1.0 + 0.05 * smooth_wander(rng, n, dt, 1.0, 0.03 * n * dt)
    phase = 2.0 * np.pi * np.cumsum(pace) * dt * v["frequency"]
    return np.asarray(np.sin(phase) + 0.3 * np.sin(2.0 * phase + 1.0))


def _charge(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"charge": n * dt / rng.uniform(25.0, 60.0)}


def _sawtooth(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """It charges evenly, and is let go at a height that is drawn anew."""
    heights = np.exp(0.3 * rng.standard_normal(int(3.0 * n * dt / v["charge"])))
    ends = np.cumsum(heights * v["charge"])
    t = np.arange(n) * dt
    starts = np.concatenate([[0.0], ends])[np.searchsorted(ends, t)]
    return np.asarray((t - starts) / v["charge"])


def _duffing(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A shaken beam between two magnets (Duffing's equation with two wells)."""

    def slope(t: float, s: Array) -> list[float]:
        return [s[1], s[0] - s[0] ** 3 - 0.3 * s[1] + 0.5 * np.cos(1.2 * t)]

    span, start = 2.0 * n * dt / v["unit"], [rng.random(), 0.0]
    at = 50.0 + span * np.arange(n) / n
    solved = solve_ivp(slope, (0.0, span + 50.0), start, t_eval=at, rtol=1e-7)
    return np.asarray(solved.y[0])


def _band(rng: np.random.Generator, n: int, dt: float) -> Numbers:
    return {"frequency": float(np.exp(rng.uniform(np.log(0.01), np.log(0.15)))) / dt}


def _rumble(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A machine hall: noise of an octave, with steep edges."""
    sections = butter(4, np.array([v["frequency"], 2.0 * v["frequency"]]) * dt, "band", fs=1.0, output="sos")
    return np.asarray(sosfilt(sections, rng.standard_normal(2 * n))[n:])


def _traffic(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A floor that rings with a damping of 0.05 while something passes: ten to forty times, some heavier than others."""
    shape = np.hanning(max(int(n / 100), 4))
    passes = np.convolve(
        (rng.random(n) < v["count"] / n) * np.exp(0.7 * rng.standard_normal(n)), shape, "same"
    )
    a = np.exp((-0.05 + 1j) * 2.0 * np.pi * v["frequency"] * dt)
    pushed = passes * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    return np.asarray(lfilter([1.0], [1.0, -a], pushed).real)


SWINGS: Mapping[str, Strange] = {
    "chirp": Strange(_sweep, _chirp, lasting=False),
    "heater_pulses": Strange(_thermostat, _heater),
    "breathing": Strange(_rest, _breathing),
    "knocks": Strange(_rung, _knocks),
    "lorenz": Strange(_turns, _lorenz),
    "ripple": Strange(_loads, _ripple, smooth=1),
    "fan": Strange(_pace, _fan),
    "sawtooth": Strange(_charge, _sawtooth),
    "duffing": Strange(_turns, _duffing),
    "rumble": Strange(_band, _rumble),
    "traffic": Strange(_rung, _traffic),
}
