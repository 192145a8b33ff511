"""What an ideal analyst thinks of the records at rest.

He knows the numbers of the sensor, the catalogue, how its parameters were drawn, and how many nats the hidden effect is
worth. For each effect the likelihood of the record over that without an effect is averaged over the laws of the
parameters; all effects are equally likely before.

Where noise switches or has outliers, samples are whitened by the assumed spectrum first; for sensors with a
Gauss-Markov bias that is nearly exact. The temperature is the thermometer's, smoothed by Wiener's filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from itertools import product

import numpy as np
import real
import static
import strength as nats
from case import Array, Case, Request
from effects import EFFECTS, hysteresis
from ideal_laws import DRAWN, Laws
from judgement import Judgement, judgement
from noise import (
    all_pole_spectrum,
    difference_spectrum,
    flicker_spectrum,
    gauss_markov_spectrum,
    middles,
    poles,
    power_law_spectrum,
    taking_turns,
    telegraph,
    walk_spectrum,
)
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.special import i0e, logsumexp
from sensor import SENSORS, THERMOMETER_NOISE, Sensor, climate
from strength import ordinates, penalty

FREQUENCIES, DAMPINGS = 600, 6
"""Of oscillators."""
CERTAIN = 1e4
"""Nats of a grid of values."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A record as the analyst sees it.

    Parameters
    ----------
    sensor : Sensor
        The assumed one.
    y : array, (n,)
        Samples, without the known offset.
    second : array or None
        Of the second axis.
    temperature : array, (n,)
        The smoothed one [degC].
    X : float
        Strength of what is hidden, if anything is [nats].
    laws : Laws
        Of its parameters.
    """

    sensor: Sensor
    y: Array
    second: Array | None
    temperature: Array
    X: float
    laws: Laws = DRAWN

    @property
    def n(self) -> int:
        """Samples."""
        return self.y.size

    @cached_property
    def P(self) -> Array:
        """Assumed variance of each ordinate."""
        return self.sensor.spectrum(self.n)

    @cached_property
    def D(self) -> Array:
        """Ordinates of the record."""
        return np.asarray(dct(self.y, norm="ortho")[1:])

    @cached_property
    def whitened(self) -> Array:
        """The record divided by the roots of its assumed spectrum."""
        return np.asarray(idct(np.concatenate([[0.0], self.D / np.sqrt(self.P)]), norm="ortho"))

    @cached_property
    def weighted(self) -> Array:
        """The record divided by its assumed spectrum: its product with a shape is their inner product."""
        return np.asarray(idct(np.concatenate([[0.0], self.D / self.P]), norm="ortho"))

    def worth(self, ordinary: int = 0, located: int = 0, lines: int = 0) -> float:
        """Expected gain [nats] over the assumed model."""
        return self.X + penalty(self.n, ordinary, located, lines)


def _mean(logs: Array, weights: Array | None = None) -> float:
    """Logarithm of the mean."""
    w = np.full(logs.shape, 1.0 / logs.size) if weights is None else weights / weights.sum()
    return float(logsumexp(logs, b=w))


def _either_sign(q: Array, power: Array) -> Array:
    """Log-likelihood of a known shape of either sign, from its product with the record and its gain."""
    return np.asarray(np.logaddexp(q, -q) - np.log(2.0) - power)


def _shape(r: Seen, shape: Array, worth: float, explained: Array | None = None) -> float:
    """Of a known shape; `explained`: the part of it that makes its size, where that is not all of it."""
    S = dct(shape, norm="ortho")[1:]
    gain = nats.known_gain(shape if explained is None else explained, r.P)
    size = np.sqrt(worth / gain)
    power = 0.5 * size**2 * (S * S / r.P).sum()
    return float(_either_sign(np.asarray(size * (r.D * S / r.P).sum()), np.asarray(power)))


def _random(r: Seen, spectrum: Array, worth: float) -> float:
    """Of a process whose spectrum for size 1 is given."""
    x = spectrum / r.P
    return _whittle(r, 1.0 + _power(x, worth) * x)


def _whittle(r: Seen, ratio: Array) -> float:
    return float(0.5 * (r.D * r.D / r.P * (1.0 - 1.0 / ratio) - np.log(ratio)).sum())


def _elapsed(r: Seen) -> Array:
    return np.arange(r.n) * r.sensor.dt


def rate_ramp(r: Seen) -> float:
    """A ramp of either sign."""
    return _shape(r, _elapsed(r), r.worth(1))


def warm_up(r: Seen) -> float:
    """Over its time constant."""
    taus = r.n * r.sensor.dt * middles(*r.laws.warm_up, 48 * r.laws.finer)
    logs = [_shape(r, np.exp(-_elapsed(r) / tau), r.worth(2)) for tau in taus]
    return _mean(np.array(logs))


def temperature(r: Seen) -> float:
    """Proportional to it."""
    return _shape(r, r.temperature - 25.0, r.worth(1))


def temperature_rate(r: Seen) -> float:
    """Proportional to its slope."""
    return _shape(r, np.gradient(r.temperature, r.sensor.dt), r.worth(1))


def thermal_hysteresis(r: Seen) -> float:
    """Over its width; its size is that of what is not linear."""
    T = np.column_stack([np.ones(r.n), r.temperature])
    logs = []
    for width in r.laws.width:
        shape = hysteresis(r.temperature, width * float(np.ptp(r.temperature))) - 25.0
        rest = shape - T @ np.linalg.lstsq(T, shape, rcond=None)[0]
        logs.append(_shape(r, shape, r.worth(2), rest))
    return _mean(np.array(logs))


def _places(r: Seen) -> NDArray[np.intp]:
    lo, hi = r.laws.place
    return np.arange(int(lo * r.n), int(hi * r.n))


def bias_step(r: Seen) -> float:
    """Over its time."""
    k = _places(r)
    q = np.cumsum(r.weighted[::-1])[::-1][k]
    some = np.linspace(k[0], k[-1], 30 * r.laws.finer + 1).astype(int)
    gains = [nats.known_gain(np.asarray(np.arange(r.n) >= j, float), r.P) for j in some]
    size = np.sqrt(r.worth(1, 1) / np.interp(k, some, gains))
    return _mean(_either_sign(size * q, np.asarray(r.worth(1, 1))))


def sinusoid(r: Seen) -> float:
    """Over frequency (as its logarithm) and phase."""
    m = 8 * r.n
    f = np.fft.rfftfreq(m, r.sensor.dt)
    periods, highest = r.laws.line
    inside = (f >= periods / (r.n * r.sensor.dt)) & (f <= highest / r.sensor.dt)
    Z = np.abs(np.fft.rfft(r.weighted, m))[inside]
    P = np.interp(f[inside], ordinates(r.n, r.sensor.dt), r.P)
    size = np.sqrt(4.0 * r.worth(lines=1) * P / r.n)
    return _mean(np.log(i0e(size * Z)) + size * Z - r.worth(lines=1), 1.0 / f[inside])


def quantisation(r: Seen) -> float:
    """Half of them leave a grid of values, the others its noise alone."""
    if not isinstance(r.sensor, real.Base) and np.unique(np.round(r.y / r.sensor.white, 7)).size < 0.2 * r.n:
        return CERTAIN
    return _random(r, difference_spectrum(r.n) / r.sensor.dt**2, r.worth(1)) - float(np.log(2.0))


def bias_instability(r: Seen) -> float:
    """Flicker noise."""
    return _random(r, flicker_spectrum(r.n), r.worth(1))


def power_law_noise(r: Seen) -> float:
    """Over its slope."""
    slopes = np.concatenate([np.linspace(*between, 9 * r.laws.finer) for between in r.laws.slope])
    return _mean(
        np.array(
            [_random(r, power_law_spectrum(r.n, r.sensor.dt, 1.0, slope), r.worth(2)) for slope in slopes]
        )
    )


def rate_random_walk(r: Seen) -> float:
    """A random walk."""
    return _random(r, walk_spectrum(r.n), r.worth(1))


def gauss_markov(r: Seen) -> float:
    """Over its correlation time."""
    s = r.sensor
    taus = r.laws.taus(s.dt, r.n * s.dt, s.tau if s.sigma else 0.0)
    return _mean(
        np.array([_random(r, gauss_markov_spectrum(r.n, s.dt, 1.0, tau), r.worth(2)) for tau in taus])
    )


def resonance(r: Seen) -> float:
    """Over frequency and damping."""
    kept, logs = _oscillators(r.sensor, r.n, r.worth(3), r.laws)
    return _mean(0.5 * (kept @ np.asarray(r.D * r.D / r.P, np.float32)).astype(float) - logs)


@lru_cache(maxsize=1)
def _oscillators(sensor: Sensor, n: int, worth: float, laws: Laws) -> tuple[NDArray[np.float32], Array]:
    """What each leaves of an ordinate's power, (oscillators, n - 1), and half the sum of the logarithms of its ratio."""
    P = sensor.spectrum(n)
    frequencies = middles(*laws.frequency, FREQUENCIES * laws.finer)
    places = list(product(frequencies, middles(*laws.damping, DAMPINGS)))
    kept = np.empty((len(places), n - 1), np.float32)
    logs = np.empty(len(places))
    for k, (f, damping) in enumerate(places):
        shape = all_pole_spectrum(n, poles(f, damping))
        ratio = 1.0 + _power(shape / shape.mean() / P, worth) * shape / shape.mean() / P
        kept[k], logs[k] = 1.0 - 1.0 / ratio, 0.5 * np.log(ratio).sum()
    return kept, logs


def _power(x: Array, worth: float) -> float:
    """The factor of a process, whose variance over the assumed one is x, that is worth so many nats."""
    return nats.scaled(lambda a: nats.random_gain(1.0 + a * a * x), worth, 1e-12, 1e12) ** 2


def low_pass(r: Seen) -> float:
    """Its corner follows from its strength."""
    return _whittle(r, _passed(r.sensor, r.n, r.worth(1)))


@cache
def _passed(sensor: Sensor, n: int, worth: float) -> Array:
    W, P = sensor.passed(n), sensor.spectrum(n)

    def ratio(phi: float) -> Array:
        return np.asarray(1.0 + W * ((1.0 - phi) ** 2 * all_pole_spectrum(n, (1.0, -phi, 0.0)) - 1.0) / P)

    return ratio(nats.scaled(lambda phi: nats.random_gain(ratio(phi)), worth, 1e-3, 0.95))


def noise_change(r: Seen) -> float:
    """Over its time and direction."""
    k = _places(r)
    power = np.cumsum(np.square(r.whitened)[::-1])[::-1][k]
    logs = []
    for up in (-1.0, 1.0):
        some, a = _changes(r.n, r.worth(1, 1), up, r.laws)
        ratio = np.exp(up * np.interp(k, some, a))
        logs.append(0.5 * power * (1.0 - ratio**-2.0) - (r.n - k) * np.log(ratio))
    return _mean(np.concatenate(logs))


@cache
def _changes(n: int, worth: float, up: float, laws: Laws) -> tuple[Array, Array]:
    """Sizes of a change at some samples."""

    def size(k: int) -> float:
        late = np.arange(n) >= k
        return nats.scaled(
            lambda a: nats.random_gain(np.where(late, np.exp(2.0 * up * a), 1.0)), worth, 1e-4, 3.0
        )

    lo, hi = laws.place
    some = np.linspace(lo * n, hi * n, 20 * laws.finer + 1).astype(int)
    return some, np.array([size(int(k)) for k in some])


def outliers(r: Seen) -> float:
    """Over their size."""
    p = r.worth(2)
    logs = []
    for size in np.linspace(*r.laws.outlier, 24 * r.laws.finer):
        e = _share(r.n, p, float(size))
        quiet, loud = -0.5 * r.whitened**2, -0.5 * r.whitened**2 / (1.0 + size**2)
        mixed = np.logaddexp(np.log1p(-e) + quiet, np.log(e) + loud - 0.5 * np.log1p(size**2))
        logs.append(float((mixed - quiet).sum()))
    return _mean(np.array(logs))


@cache
def _share(n: int, worth: float, size: float) -> float:
    return nats.scaled(lambda e: nats.mixture_gain(n, e, size), worth, 1e-6, 0.2)


def random_telegraph(r: Seen) -> float:
    """Over its dwell; it is not hidden beside a Gauss-Markov bias."""
    if r.sensor.sigma:
        return -np.inf
    size, stay = _levels(r.n, r.worth(2), r.laws)
    return _mean(_two_levels(r.whitened[:, None], size, stay))


@cache
def _levels(n: int, worth: float, laws: Laws) -> tuple[Array, Array]:
    """Sizes and probabilities to stay over the law of the dwell; drawn records as for the hidden ones."""
    rng = np.random.default_rng(41)
    dwell = n * middles(*laws.dwell, 10 * laws.finer)
    stay = 0.5 + 0.5 * np.exp(-2.0 / dwell)
    w = rng.standard_normal((4, n, 1))
    level = np.array([[telegraph(rng, n, 1.0, d) for d in dwell] for _ in w]).transpose(0, 2, 1)

    def gain(size: Array) -> Array:
        return np.mean([_two_levels(a + size * b, size, stay) for a, b in zip(w, level)], axis=0)

    return _at(gain, worth, np.full(dwell.size, 0.03), np.full(dwell.size, 3.0)), stay


def _at(gain: Callable[[Array], Array], wanted: float, lo: Array, hi: Array) -> Array:
    """Sizes of a gain, all at once by bisection in logarithm."""
    lo, hi = np.log(lo), np.log(hi)
    for _ in range(12):
        middle = 0.5 * (lo + hi)
        more = gain(np.exp(middle)) > wanted
        lo, hi = np.where(more, lo, middle), np.where(more, middle, hi)
    return np.asarray(np.exp(0.5 * (lo + hi)))


def _two_levels(y: Array, size: Array, stay: Array) -> Array:
    """As `nats.telegraph_gain`, for several sizes at once: y is (n, 1) or (n, sizes)."""
    y = y - y.mean(axis=0)
    odds = np.exp(np.clip(size * y, -50.0, 50.0))
    p, total, leave = np.full(size.shape, 0.5), np.zeros(size.shape), 1.0 - stay
    for o in odds:
        p = stay * p + leave * (1.0 - p)
        mixed = p * o + 1.0 - p
        total += np.log(mixed)
        p = p * o / mixed
    return np.asarray(total - 0.5 * (size * y).sum(axis=0) - y.shape[0] * size * size / 8.0)


def intermittent_noise(r: Seen) -> float:
    """Over the share and the length of bursts."""
    ratio, share_, lasting = _bursts(r.n, r.worth(3), r.laws)
    return _mean(_burst_gains(r.whitened[:, None], ratio, share_, 1.0 / lasting))


@cache
def _bursts(n: int, worth: float, laws: Laws) -> tuple[Array, Array, Array]:
    """Ratios over the laws of share and length."""
    rng = np.random.default_rng(43)
    many = 6 * laws.finer
    lo, hi = laws.share
    share_ = np.repeat(lo + (hi - lo) * (np.arange(many) + 0.5) / many, many)
    lasting = np.tile(n * middles(*laws.lasting, many), many)
    away = lasting * (1.0 - share_) / share_
    w = rng.standard_normal((4, n, 1))
    loud = np.array([[taking_turns(rng, n, 1.0, a, b) for a, b in zip(away, lasting)] for _ in w]).transpose(
        0, 2, 1
    )

    def gain(a: Array) -> Array:
        return np.mean(
            [
                _burst_gains(x * np.where(on > 0.0, 1.0 + a, 1.0), 1.0 + a, share_, 1.0 / lasting)
                for x, on in zip(w, loud)
            ],
            axis=0,
        )

    return 1.0 + _at(gain, worth, np.full(many**2, 0.02), np.full(many**2, 10.0)), share_, lasting


def _burst_gains(y: Array, ratio: Array, share_: Array, leave: Array) -> Array:
    """As `nats.burst_gain`, for several at once, over quiet noise of known level."""
    enter = leave * share_ / (1.0 - share_)
    odds = np.exp(np.minimum(0.5 * y * y * (1.0 - ratio**-2.0), 500.0)) / ratio
    p, total = share_ + np.zeros(ratio.shape), np.zeros(ratio.shape)
    for o in odds:
        mixed = p * o + 1.0 - p
        total += np.log(mixed)
        p = p * o / mixed
        p = p * (1.0 - leave) + (1.0 - p) * enter
    return np.asarray(total)


def cross_axis_noise(r: Seen) -> float:
    """Of either sign; a log with one axis cannot have it."""
    if r.second is None:
        return -np.inf
    own = replace(r, y=r.second, second=None)
    a, b = r.whitened, own.whitened
    rho = np.sqrt(1.0 - np.exp(-2.0 * r.worth(1) / r.n)) * np.array([-1.0, 1.0])
    left = 1.0 - rho**2
    cross, power = float(a @ b), float(a @ a + b @ b)
    return _mean(rho * cross / left - 0.5 * power * rho**2 / left - 0.5 * r.n * np.log(left))


JUDGES: Mapping[str, Callable[[Seen], float]] = {name: globals()[name] for name in EFFECTS}


@cache
def _climates(n: int, dt: float) -> Array:
    """Mean power of each ordinate of a temperature's departure from its mean."""
    rng = np.random.default_rng(47)
    drawn = [np.square(dct(climate(rng, n, dt), norm="ortho")[1:]) for _ in range(40)]
    return np.asarray(np.mean(drawn, axis=0))


def smoothed(thermometer: Array, dt: float) -> Array:
    """The temperature [degC] that Wiener's filter makes of the thermometer."""
    n = thermometer.size
    D, S = dct(thermometer, norm="ortho"), _climates(n, dt)
    D[1:] *= S / (S + THERMOMETER_NOISE**2)
    return np.asarray(idct(D, norm="ortho"))


@dataclass(frozen=True)
class World:
    """Where the records come from.

    Parameters
    ----------
    sensor : callable
        The assumed sensor of a case.
    """

    make: Callable[[Request, int], Case]
    sensor: Callable[[str], Sensor]


def _recorded(name: str) -> Sensor:
    bases = (real.base_of(k) for k in range(len(real.pieces())))
    return next(b for b in bases if b is not None and b.name == name)


WORLDS = {
    "static": World(static.make, lambda name: next(s for s in SENSORS if s.name == name)),
    "real": World(lambda request, _: real.make(request), _recorded),
}


def case_of(request: Request) -> Case:
    """The record of a request, of a length that the sensor has."""
    samples = SENSORS[request.index % len(SENSORS)].n if request.kind == "null" else 0
    return WORLDS[request.world].make(request, samples)


def seen(case: Case, X: float, laws: Laws = DRAWN) -> Seen:
    """What the analyst sees of a record."""
    world = WORLDS[case.request.world]
    sensor = world.sensor(case.variant)
    others = [k for k in case.channels if k[:-1] == sensor.channel[:-1] and k != sensor.channel]
    y, second = (case.channels[k][0] if k else None for k in (sensor.channel, others[0] if others else ""))
    assert y is not None
    return Seen(
        sensor, y - sensor.offset, second, smoothed(case.channels["temperature"][0], sensor.dt), X, laws
    )


def judged(request: Request, X: float, laws: Laws = DRAWN) -> Judgement:
    """One record, as if what is hidden in it were worth X nats; each effect that the log can have is equally likely."""
    case = case_of(request)
    r = seen(case, X, laws)
    assumed = r.sensor.text if isinstance(r.sensor, real.Base) else ""
    each = {name: judge(r) for name, judge in JUDGES.items() if f'"{name}"' not in assumed}
    return judgement(
        request, case, ((frozenset({name}), 1.0, v) for name, v in each.items() if np.isfinite(v))
    )
