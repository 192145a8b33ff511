"""Static records with something that the catalogue does not hold, nearly holds, or holds as a fault of the data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import strength as nats
from case import Array, Hidden
from scipy.fft import dct
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter
from sensor import Recording
from strange_drifts import STRANGE

DANIELL = 21
"""Ordinates over which the spectrum of a disturbance is averaged to say what it is worth."""


def _disturb(r: Recording, X: float, name: str) -> Hidden:
    """Adds an unknown disturbance whose averaged spectrum is worth X nats."""
    strange = STRANGE[name]
    numbers = strange.numbers(r.rng, r.n, r.dt)
    shape = strange.course(r.rng, r.n, r.dt, numbers)
    S = np.square(dct(shape, norm="ortho")[1:])
    x = np.maximum(uniform_filter1d(S, DANIELL, mode="nearest"), 0.0) / r.spectrum
    size = nats.scaled(lambda a: nats.random_gain(1.0 + a * a * x), X, 1e-9, 1e9)
    r.added = r.added + size * shape
    return Hidden(name, r.sensor.channel, {"size": size * r.si, **numbers}, X)


UNKNOWN: Mapping[str, Callable[[Recording, float], Hidden]] = {
    name: partial(_disturb, name=name) for name in STRANGE
}


def _near(r: Recording, shape: Array, X: float, name: str, also: tuple[str, ...]) -> Hidden:
    size = float(np.sqrt(X / nats.known_gain(shape, r.spectrum)))
    r.added = r.added + size * shape
    return Hidden(name, r.sensor.channel, {"size": size * r.si}, X, also=also)


def thermal_lag(r: Recording, X: float) -> Hidden:
    """A bias that follows the temperature through two poles."""
    phi = np.exp(-r.dt / (0.03 * r.duration))
    b, a = np.array([(1.0 - phi) ** 2]), np.array([1.0, -2.0 * phi, phi * phi])
    away = r.temperature - r.temperature[0]
    also = ("temperature", "temperature_rate", "thermal_hysteresis", "unknown")
    return _near(r, np.asarray(lfilter(b, a, away)), X, "thermal_lag", also)


def drifting_line(r: Recording, X: float) -> Hidden:
    """A line whose phase walks by a few radians over the record."""
    walk = np.cumsum(r.rng.standard_normal(r.n)) * 3.0 / np.sqrt(r.n)
    f = r.rng.uniform(0.02, 0.2) / r.dt
    shape = np.sin(2.0 * np.pi * f * r.elapsed + walk)
    return _near(r, shape, X, "drifting_line", ("sinusoid", "resonance", "unknown"))


def soft_step(r: Recording, X: float) -> Hidden:
    """A step that takes a fiftieth of the record (half a minute)."""
    t0, wide = r.duration * r.rng.uniform(0.25, 0.75), r.duration / 50.0
    shape = np.clip((r.elapsed - t0) / wide, 0.0, 1.0)
    return _near(r, shape, X, "soft_step", ("bias_step", "unknown"))


NEAR: Mapping[str, Callable[[Recording, float], Hidden]] = {
    "thermal_lag": thermal_lag,
    "drifting_line": drifting_line,
    "soft_step": soft_step,
}

Logged = tuple[Any, Any, dict[str, float], Any]
"""Time stamps, values, true parameters in SI, and which samples of the other channels stay."""


def repeated(r: Recording, t: Array, y: Array) -> Logged:
    """Some samples are those before them."""
    share = r.rng.uniform(0.02, 0.2)
    new = r.rng.random(r.n) >= share
    new[0] = True
    return t, y[np.maximum.accumulate(np.where(new, np.arange(r.n), 0))], {"share": share}, np.arange(r.n)


def dropped(r: Recording, t: Array, y: Array) -> Logged:
    """Some samples are missing; the time stamps are true."""
    share = r.rng.uniform(0.01, 0.05)
    kept = np.flatnonzero(r.rng.random(r.n) >= share)
    return t[kept], y[kept], {"share": share}, kept


def clipped(r: Recording, t: Array, y: Array) -> Logged:
    """The channel saturates at two and a half standard deviations above its mean."""
    limit = y.mean() + r.rng.uniform(1.8, 2.5) * r.sensor.white
    return t, np.minimum(y, limit), {"limit": limit * r.si}, np.arange(r.n)


def stuck(r: Recording, t: Array, y: Array) -> Logged:
    """A converter of fine step, one bit of which is always set."""
    step = r.sensor.white / 16.0
    count = np.round(y / step).astype(np.int64) | 8
    return t, count * step, {}, np.arange(r.n)


def wrong_unit(r: Recording, t: Array, y: Array) -> Logged:
    """Degrees where radians are assumed, or the other way round; g for m/s^2."""
    factor = (
        1.0 / 9.80665 if r.sensor.unit == "m/s^2" else 57.29577951308232 ** float(r.rng.choice([-1.0, 1.0]))
    )
    return t, y * factor, {"factor": factor}, np.arange(r.n)


def coarse(r: Recording, t: Array, y: Array) -> Logged:
    """A converter whose step is about the noise."""
    step = r.rng.uniform(1.0, 2.0) * r.sensor.white
    return t, np.round(y / step) * step, {}, np.arange(r.n)


def jitter(r: Recording, t: Array, y: Array) -> Logged:
    """Time stamps off by 8 % of the sample time, standard deviation."""
    off = np.clip(0.08 * r.rng.standard_normal(r.n), -0.24, 0.24)
    return t + off * r.dt, y, {}, np.arange(r.n)


INTEGRITY: Mapping[str, Callable[[Recording, Array, Array], Logged]] = {
    "repeated_samples": repeated,
    "dropped_samples": dropped,
    "clipping": clipped,
    "stuck_bit": stuck,
    "unit_error": wrong_unit,
    "coarse_quantisation": coarse,
    "timestamp_jitter": jitter,
}
