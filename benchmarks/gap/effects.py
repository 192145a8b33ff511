"""Static effects: each is added to a `Recording` in the size that is worth a number of nats.

Each function takes the recording and the strength wanted, changes the recording, and returns what
it hid. Parameters are in SI. Where a name leaves room, this is what is meant:

* ``low_pass``: the white noise through ``y_k = phi y_(k-1) + (1 - phi) w_k``, ``phi = exp(-2 pi corner dt)``
* ``quantisation``: the integrated output is rounded; ``Q`` is the step over sqrt(12). In every other case
  the rounding error is that of a dithered counter: uniform, without a grid of values
* ``outliers``: `share` of the samples have normal noise of standard deviation `sigma` added to the usual one
* ``noise_change``: `ratio` of standard deviations, after to before
* ``intermittent_noise``: white noise, `ratio` times as loud in a `share` of the time, for `lasting` on average
* ``random_telegraph``: two levels `size` apart, mean time of stay `dwell`
* ``thermal_hysteresis``: ``coefficient * h`` with the hysteresis ``h = clip(h, T - width, T + width)``; its
  strength is that of the part which is not linear in T
* ``resonance``: white noise through an all-pole oscillator
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import strength as nats
from case import Array, Hidden
from noise import (
    all_pole_spectrum,
    difference_spectrum,
    flicker_spectrum,
    gauss_markov,
    gauss_markov_spectrum,
    poles,
    power,
    power_law_spectrum,
    taking_turns,
    telegraph,
    walk_spectrum,
)
from scipy.signal import lfilter
from sensor import Recording

SLOPES = ((0.35, 0.75), (1.25, 1.75))
"""Of power-law noise."""

Maker = Callable[[Recording, float], Hidden]


def _hidden(r: Recording, name: str, values: Mapping[str, float], gain: float, penalty: float) -> Hidden:
    return Hidden(name, r.sensor.channel, values, gain, penalty)


def _known(r: Recording, shape: Array, X: float, penalty: float) -> float:
    """Adds a known shape in the size that is worth X; its size."""
    size = float(np.sqrt((X + penalty) / nats.known_gain(shape, r.spectrum)))
    r.added = r.added + size * shape
    return size


def _random(r: Recording, x: Array, X: float, penalty: float) -> float:
    """The size of a process, whose variance over the assumed one is x for size 1, that is worth X."""
    return nats.scaled(lambda a: nats.random_gain(1.0 + a * a * x), X + penalty, 1e-12, 1e12)


def _sign(r: Recording) -> float:
    return float(r.rng.choice([-1.0, 1.0]))


def rate_ramp(r: Recording, X: float) -> Hidden:
    """Linear in time."""
    p, sign = nats.penalty(r.n, 1), _sign(r)
    size = _known(r, sign * r.elapsed, X, p)
    return _hidden(r, "rate_ramp", {"R": sign * size * r.si}, X + p, p)


def sinusoid(r: Recording, X: float) -> Hidden:
    """A line, anywhere from ten periods in the record to 0.4 of the rate."""
    p = nats.penalty(r.n, lines=1)
    f = float(np.exp(r.rng.uniform(np.log(10.0 / r.duration), np.log(0.4 / r.dt))))
    phase = float(r.rng.uniform(-np.pi, np.pi))
    size = _known(r, np.sin(2.0 * np.pi * f * r.elapsed + phase), X, p)
    return _hidden(r, "sinusoid", {"amplitude": size * r.si, "frequency": f}, X + p, p)


def bias_step(r: Recording, X: float) -> Hidden:
    """A jump between a fifth and four fifths of the record."""
    p, sign = nats.penalty(r.n, 1, 1), _sign(r)
    k = int(r.n * r.rng.uniform(0.2, 0.8))
    size = _known(r, np.asarray(sign * (np.arange(r.n) >= k), float), X, p)
    return _hidden(r, "bias_step", {"size": sign * size * r.si, "time": k * r.dt}, X + p, p)


def warm_up(r: Recording, X: float) -> Hidden:
    """An exponential of its own time constant, not that of the thermometer."""
    p, sign = nats.penalty(r.n, 2), _sign(r)
    tau = r.duration * float(np.exp(r.rng.uniform(np.log(0.02), np.log(0.2))))
    size = _known(r, sign * np.exp(-r.elapsed / tau), X, p)
    return _hidden(r, "warm_up", {"size": sign * size * r.si, "tau": tau}, X + p, p)


def temperature(r: Recording, X: float) -> Hidden:
    """Proportional to the true temperature."""
    p, sign = nats.penalty(r.n, 1), _sign(r)
    size = _known(r, sign * (r.temperature - 25.0), X, p)
    return _hidden(r, "temperature", {"coefficient": sign * size * r.si}, X + p, p)


def temperature_rate(r: Recording, X: float) -> Hidden:
    """Proportional to the slope of the true temperature."""
    p, sign = nats.penalty(r.n, 1), _sign(r)
    size = _known(r, sign * np.gradient(r.temperature, r.dt), X, p)
    return _hidden(r, "temperature_rate", {"coefficient": sign * size * r.si}, X + p, p)


def hysteresis(temperature: Array, width: float) -> Array:
    """``h = clip(h, T - width, T + width)``, from ``h = T`` at the start."""
    h, values = float(temperature[0]), []
    for low, high in zip((temperature - width).tolist(), (temperature + width).tolist()):
        h = min(max(h, low), high)
        values.append(h)
    return np.asarray(values)


def thermal_hysteresis(r: Recording, X: float) -> Hidden:
    """Hysteresis of a fifth of the range of temperature."""
    p, sign = nats.penalty(r.n, 2), _sign(r)
    width = 0.2 * float(np.ptp(r.temperature))
    shape = hysteresis(r.temperature, width) - 25.0
    T = np.column_stack([np.ones(r.n), r.temperature])
    rest = shape - T @ np.linalg.lstsq(T, shape, rcond=None)[0]
    size = float(np.sqrt((X + p) / nats.known_gain(rest, r.spectrum)))
    r.added = r.added + sign * size * shape
    return _hidden(r, "thermal_hysteresis", {"coefficient": sign * size * r.si, "width": width}, X + p, p)


def quantisation(r: Recording, X: float) -> Hidden:
    """The integrated output in steps."""
    p = nats.penalty(r.n, 1)
    Q = _random(r, difference_spectrum(r.n) / r.dt**2 / r.spectrum, X, p)
    if r.rng.random() < 0.5:
        r.rounded = Q * float(np.sqrt(12.0))
    else:
        r.added = r.added + np.diff(Q * np.sqrt(12.0) * (r.rng.random(r.n + 1) - 0.5)) / r.dt
    return _hidden(r, "quantisation", {"Q": Q * r.si}, X + p, p)


def bias_instability(r: Recording, X: float) -> Hidden:
    """Flicker, ``B^2 / (2 pi f)`` two-sided."""
    p = nats.penalty(r.n, 1)
    B = _random(r, flicker_spectrum(r.n) / r.spectrum, X, p)
    r.added = r.added + B / np.sqrt(2.0 * np.pi) * power(r.rng, r.n, 1.0)
    return _hidden(r, "bias_instability", {"B": B * r.si}, X + p, p)


def power_law_noise(r: Recording, X: float) -> Hidden:
    """Noise of spectrum ``B^2 w^-slope``, flatter or steeper than flicker."""
    p, slope = nats.penalty(r.n, 2), float(r.rng.uniform(*r.rng.choice(SLOPES)))
    B = _random(r, power_law_spectrum(r.n, r.dt, 1.0, slope) / r.spectrum, X, p)
    unit = np.sqrt(1.0 / r.dt) * (2.0 * np.pi / r.dt) ** (-0.5 * slope)
    r.added = r.added + B * unit * power(r.rng, r.n, slope)
    return _hidden(r, "power_law_noise", {"B": B * r.si, "slope": slope}, X + p, p)


def gauss_markov_bias(r: Recording, X: float) -> Hidden:
    """A (second) Gauss-Markov bias; beside an assumed one, a tenth or less of its time constant."""
    p = nats.penalty(r.n, 2)
    longest = r.sensor.tau / 10.0 if r.sensor.sigma else r.duration / 25.0
    tau = float(np.exp(r.rng.uniform(np.log(5.0 * r.dt), np.log(longest))))
    sigma = _random(r, gauss_markov_spectrum(r.n, r.dt, 1.0, tau) / r.spectrum, X, p)
    r.added = r.added + gauss_markov(r.rng, r.n, r.dt, sigma, tau)
    return _hidden(r, "gauss_markov", {"sigma": sigma * r.si, "tau": tau}, X + p, p)


def rate_random_walk(r: Recording, X: float) -> Hidden:
    """A random walk from zero."""
    p = nats.penalty(r.n, 1)
    step = _random(r, walk_spectrum(r.n) / r.spectrum, X, p)
    r.added = r.added + step * np.cumsum(r.rng.standard_normal(r.n))
    return _hidden(r, "rate_random_walk", {"K": step / np.sqrt(r.dt) * r.si}, X + p, p)


def resonance(r: Recording, X: float) -> Hidden:
    """An oscillator driven by white noise."""
    p = nats.penalty(r.n, 3)
    f = float(np.exp(r.rng.uniform(np.log(0.02), np.log(0.3))))
    damping = float(np.exp(r.rng.uniform(np.log(0.01), np.log(0.08))))
    a = poles(f, damping)
    shape = all_pole_spectrum(r.n, a)
    rms = _random(r, shape / shape.mean() / r.spectrum, X, p)
    start = int(10.0 / (damping * f))
    drawn = lfilter([rms / np.sqrt(shape.mean())], a, r.rng.standard_normal(r.n + start))[start:]
    r.added = r.added + drawn
    return _hidden(r, "resonance", {"frequency": f / r.dt, "damping": damping, "rms": rms * r.si}, X + p, p)


def low_pass(r: Recording, X: float) -> Hidden:
    """One pole on the white noise, of unit gain at low frequency."""
    p, base = nats.penalty(r.n, 1), r.spectrum
    W = r.sensor.passed(r.n)

    def gain(phi: float) -> float:
        passed = (1.0 - phi) ** 2 * all_pole_spectrum(r.n, (1.0, -phi, 0.0))
        return nats.random_gain(1.0 + W * (passed - 1.0) / base)

    phi = nats.scaled(gain, X + p, 1e-3, 0.95)
    r.white = np.asarray(lfilter([1.0 - phi], [1.0, -phi], r.white))
    return _hidden(r, "low_pass", {"corner": -np.log(phi) / (2.0 * np.pi * r.dt)}, X + p, p)


def noise_change(r: Recording, X: float) -> Hidden:
    """White noise that is louder or quieter from a moment on."""
    p = nats.penalty(r.n, 1, 1)
    k, up = int(r.n * r.rng.uniform(0.2, 0.8)), float(r.rng.choice([-1.0, 1.0]))
    late = np.arange(r.n) >= k
    a = nats.scaled(lambda a: nats.random_gain(np.where(late, np.exp(2.0 * up * a), 1.0)), X + p, 1e-4, 3.0)
    ratio = float(np.exp(up * a))
    r.white = np.where(late, ratio, 1.0) * r.white
    return _hidden(r, "noise_change", {"ratio": ratio, "time": k * r.dt}, X + p, p)


def outliers(r: Recording, X: float) -> Hidden:
    """Rare samples of much larger noise."""
    p = nats.penalty(r.n, 2)
    size = float(r.rng.uniform(2.5, 6.0))
    share = nats.scaled(lambda e: nats.mixture_gain(r.n, e, size), X + p, 1e-6, 0.2)
    hit = r.rng.choice(r.n, max(1, round(share * r.n)), replace=False)
    r.white[hit] += size * r.sensor.white * r.rng.standard_normal(hit.size)
    return _hidden(r, "outliers", {"share": share, "sigma": size * r.sensor.white * r.si}, X + p, p)


def random_telegraph(r: Recording, X: float) -> Hidden:
    """Two levels; measured against the white noise alone."""
    p = nats.penalty(r.n, 2)
    dwell = r.duration * float(np.exp(r.rng.uniform(np.log(0.005), np.log(0.03))))
    stay = 0.5 + 0.5 * float(np.exp(-2.0 * r.dt / dwell))
    drawn = [(r.rng.standard_normal(r.n), telegraph(r.rng, r.n, r.dt, dwell)) for _ in range(3)]

    def gain(size: float) -> float:
        return float(np.mean([nats.telegraph_gain(w + size * level, size, stay) for w, level in drawn]))

    size = nats.scaled(gain, X + p, 0.03, 3.0) * r.sensor.white
    r.added = r.added + size * telegraph(r.rng, r.n, r.dt, dwell)
    return _hidden(r, "random_telegraph", {"size": size * r.si, "dwell": dwell}, X + p, p)


def intermittent_noise(r: Recording, X: float) -> Hidden:
    """Bursts of louder noise."""
    p, share = nats.penalty(r.n, 3), float(r.rng.uniform(0.05, 0.4))
    lasting = r.duration * float(np.exp(r.rng.uniform(np.log(0.003), np.log(0.03))))
    away = lasting * (1.0 - share) / share
    drawn = [(r.rng.standard_normal(r.n), taking_turns(r.rng, r.n, r.dt, away, lasting)) for _ in range(3)]

    def gain(a: float) -> float:
        records = (w * np.where(loud, 1.0 + a, 1.0) for w, loud in drawn)
        return float(np.mean([nats.burst_gain(y, 1.0 + a, share, r.dt / lasting) for y in records]))

    ratio = 1.0 + nats.scaled(gain, X + p, 0.02, 10.0)
    r.white = np.where(taking_turns(r.rng, r.n, r.dt, away, lasting), ratio, 1.0) * r.white
    values = {"ratio": ratio, "share": share, "lasting": lasting}
    return _hidden(r, "intermittent_noise", values, X + p, p)


def cross_axis_noise(r: Recording, X: float) -> Hidden:
    """A second axis whose white noise is correlated with the first."""
    p, sign = nats.penalty(r.n, 1), _sign(r)
    rho = sign * float(np.sqrt(1.0 - np.exp(-2.0 * (X + p) / r.n)))
    own = r.sensor.white * r.rng.standard_normal(r.n)
    y = rho * r.white + np.sqrt(1.0 - rho**2) * own - 0.2 * r.sensor.white
    if r.sensor.sigma:
        y = y + gauss_markov(r.rng, r.n, r.dt, r.sensor.sigma, r.sensor.tau)
    second = r.sensor.channel[:-1] + ("y" if r.sensor.channel.endswith("x") else "x")
    r.companions[second] = (y, r.sensor.unit)
    return _hidden(r, "cross_axis_noise", {"rho": rho}, X + p, p)


EFFECTS: Mapping[str, Maker] = {
    "quantisation": quantisation,
    "bias_instability": bias_instability,
    "power_law_noise": power_law_noise,
    "gauss_markov": gauss_markov_bias,
    "rate_random_walk": rate_random_walk,
    "rate_ramp": rate_ramp,
    "sinusoid": sinusoid,
    "resonance": resonance,
    "low_pass": low_pass,
    "bias_step": bias_step,
    "warm_up": warm_up,
    "temperature": temperature,
    "temperature_rate": temperature_rate,
    "thermal_hysteresis": thermal_hysteresis,
    "noise_change": noise_change,
    "outliers": outliers,
    "random_telegraph": random_telegraph,
    "intermittent_noise": intermittent_noise,
    "cross_axis_noise": cross_axis_noise,
}

FAMILIES = (
    ("quantisation", "low_pass"),
    ("bias_instability", "power_law_noise", "gauss_markov", "rate_random_walk", "rate_ramp", "warm_up"),
    ("sinusoid", "resonance"),
    ("bias_step", "random_telegraph"),
    ("temperature", "temperature_rate"),
    ("outliers", "noise_change", "intermittent_noise"),
)
"""Stacks take at most one effect of each."""
ORDER = ("low_pass", "noise_change", "intermittent_noise", "outliers")
"""Effects that change the noise come first in a stack, in this order."""
