"""What an updated model is worth on a second record of the same sensor, which the tool never sees.

The second record has the same truth, new noise and a new climate. Three models are judged on it by the
mean of their log-likelihood over all such records (so no single draw adds noise): the assumed one, the
updated one with the numbers that the answer gives, and the oracle's, which knows the truth. The score is

    (updated - assumed) / (oracle - assumed),

at most 1, below 0 where the updated model predicts worse than the assumed one.

* Spectra and known signals are compared per ordinate of the cosine transform, as in `strength`, and as
  there each model may retune its level by a common factor. Wrong names count as well: a random walk
  named for flicker has its own spectrum.
* Driven effects follow the true temperature of the new record, in the updated model and in the oracle's.
* The phase of a line on another day is nobody's to know: each model gets the best one.
* Outliers and telegraph, where they are both hidden and named, add what their laws gain over the normal
  law of the same spectrum; telegraph noise is judged on drawn records, the same for both models.
  Named for something else, they count by their spectrum.
* A disturbance that the catalogue does not hold has the spectrum that its law gives on average: the
  oracle is the best that any stationary normal model can do.
* What happened once (a step, a change of the noise) and faults of the data say nothing of a second record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import strength as nats
from case import SI, Array, Case
from effects import hysteresis
from noise import (
    all_pole_spectrum,
    angles,
    difference_spectrum,
    flicker_spectrum,
    gauss_markov_spectrum,
    poles,
    power_law_spectrum,
    telegraph,
    walk_spectrum,
)
from scipy.fft import dct
from sensor import SENSORS, Sensor, climate
from strange_drifts import STRANGE

Term = tuple[str, Mapping[str, float]]
"""An effect and its numbers in SI."""

CLIMATES = 4
"""Drawn temperatures over which driven effects are averaged."""
RECORDS = 12
"""Drawn records of telegraph noise."""
PHASES = np.linspace(-np.pi, np.pi, 721)


@dataclass(frozen=True)
class Model:
    """A sensor's noise and the effects beside it.

    Parameters
    ----------
    n : int
        Samples of a record.
    """

    sensor: Sensor
    n: int
    terms: tuple[Term, ...]

    def of(self, name: str) -> list[Mapping[str, float]]:
        """The numbers of every effect of that name."""
        return [numbers for effect, numbers in self.terms if effect == name]

    @property
    def white(self) -> Array:
        """Variance of each ordinate of the white noise, filtered, outliers in it."""
        W = np.full(self.n - 1, self.sensor.white**2)
        for v in self.of("outliers"):
            W = W + v["share"] * (v["sigma"] / self.si) ** 2
        for v in self.of("low_pass"):
            W = W * _passed(angles(self.n), 2.0 * np.pi * v["corner"] * self.sensor.dt, v.get("order", 1.0))
        return W

    @property
    def si(self) -> float:
        """Factor of the sensor's unit to SI."""
        return SI[self.sensor.unit]

    @property
    def spectrum(self) -> Array:
        """Variance of each ordinate."""
        quiet = replace(self.sensor, white=0.0)
        P = self.white + quiet.spectrum(self.n)
        for name, numbers in self.terms:
            if name in SPECTRA:
                P = P + SPECTRA[name](self.n, self.sensor.dt, numbers) / self.si**2
        return np.asarray(P)

    def signal(self, temperature: Array) -> Array:
        """The known signals under a temperature, without lines."""
        out, t = np.zeros(self.n), np.arange(self.n) * self.sensor.dt
        for name, numbers in self.terms:
            if name in SIGNALS:
                out = out + SIGNALS[name](t, temperature, numbers) / self.si
        return out

    def lines(self) -> list[tuple[float, float]]:
        """Amplitude in the sensor's unit, and frequency [Hz], of each line."""
        return [(abs(v["amplitude"]) / self.si, v["frequency"]) for v in self.of("sinusoid")]


def _passed(omega: Array, corner: float, order: float) -> Array:
    """Power that a low-pass leaves: one pole, or a Butterworth filter of second order."""
    if round(order) == 1:
        a = float(np.exp(-corner))
        return np.asarray((1.0 - a) ** 2 / (1.0 - 2.0 * a * np.cos(omega) + a * a))
    return np.asarray(1.0 / (1.0 + (np.tan(0.5 * omega) / np.tan(0.5 * min(corner, 3.14))) ** 4))


def _resonance(n: int, dt: float, v: Mapping[str, float]) -> Array:
    shape = all_pole_spectrum(n, poles(v["frequency"] * dt, v["damping"]))
    return np.asarray(v["rms"] ** 2 * shape / shape.mean())


def _strange(name: str, n: int, dt: float, v: Mapping[str, float]) -> Array:
    return np.asarray(v["size"] ** 2 * _unit_spectrum(name, n, dt, tuple(v.items())))


@lru_cache(maxsize=2)
def _unit_spectrum(name: str, n: int, dt: float, v: tuple[tuple[str, float], ...]) -> Array:
    """Drawn once a case: some take seconds."""
    return STRANGE[name].spectrum(n, dt, dict(v))


SPECTRA: Mapping[str, Callable[[int, float, Mapping[str, float]], Array]] = {
    "quantisation": lambda n, dt, v: v["Q"] ** 2 * difference_spectrum(n) / dt**2,
    "bias_instability": lambda n, dt, v: v["B"] ** 2 * flicker_spectrum(n),
    "power_law_noise": lambda n, dt, v: power_law_spectrum(n, dt, v["B"], v["slope"]),
    "gauss_markov": lambda n, dt, v: gauss_markov_spectrum(n, dt, v["sigma"], v["tau"]),
    "rate_random_walk": lambda n, dt, v: v["K"] ** 2 * dt * walk_spectrum(n),
    "resonance": _resonance,
    "random_telegraph": lambda n, dt, v: gauss_markov_spectrum(n, dt, 0.5 * v["size"], 0.5 * v["dwell"]),
    **{name: partial(_strange, name) for name, s in STRANGE.items() if s.lasting},
}
SIGNALS: Mapping[str, Callable[[Array, Array, Mapping[str, float]], Array]] = {
    "rate_ramp": lambda t, T, v: v["R"] * t,
    "warm_up": lambda t, T, v: v["size"] * np.exp(-t / v["tau"]),
    "temperature": lambda t, T, v: v["coefficient"] * (T - 25.0),
    "temperature_rate": lambda t, T, v: v["coefficient"] * np.gradient(T, t[1] - t[0]),
    "thermal_hysteresis": lambda t, T, v: v["coefficient"] * hysteresis(T, v["width"]),
}
LASTING = (*SPECTRA, *SIGNALS, "sinusoid", "low_pass", "outliers")
"""Effects that say something of a second record."""


def reached(
    case: Case, steps: Sequence[Mapping[str, object]], base: Mapping[str, float]
) -> tuple[float, float]:
    """Nats that the updated model and the oracle's gain over the assumed one on a second record.

    Parameters
    ----------
    case : Case
        At rest, with one hidden effect.
    steps : sequence of mapping
        What the answer added: ``effect``, ``channel``, ``parameters`` with values in SI.
    base : mapping
        Assumed numbers that the updated model has changed: ``N``, ``sigma``, ``tau`` in the sensor's unit;
        ``order`` of a low-pass.

    Returns
    -------
    tuple of float
        nan where the effect says nothing of another record.
    """
    hidden = case.hidden[0]
    if hidden.effect not in LASTING:
        return np.nan, np.nan
    sensor = next(s for s in SENSORS if s.name == case.variant)
    assumed = Model(sensor, case.t.size, ())
    oracle = replace(assumed, terms=((hidden.effect, hidden.parameters),))
    named = replace(assumed, sensor=_anew(sensor, base), terms=_terms(steps, hidden.channel, base))
    seed = np.random.default_rng([case.request.seed, 2]).integers(2**32)
    worth = [_likelihood(oracle, m, np.random.default_rng(seed)) for m in (assumed, named, oracle)]
    return worth[1] - worth[0], worth[2] - worth[0]


def _terms(
    steps: Sequence[Mapping[str, object]], channel: str, base: Mapping[str, float]
) -> tuple[Term, ...]:
    out = []
    for s in steps:
        given = s.get("parameters")
        if s["effect"] in LASTING and s.get("channel", channel) == channel and isinstance(given, Mapping):
            numbers = {k: float(v["value"]) for k, v in given.items()}
            out.append((str(s["effect"]), numbers | {"order": base.get("order", 1.0)}))
    return tuple(out)


def _anew(sensor: Sensor, base: Mapping[str, float]) -> Sensor:
    """The assumed sensor with numbers that the tool has changed."""
    return replace(
        sensor,
        white=base["N"] / sensor.dt**0.5 if "N" in base else sensor.white,
        sigma=base.get("sigma", sensor.sigma),
        tau=base.get("tau", sensor.tau),
    )


def _likelihood(true: Model, model: Model, rng: np.random.Generator) -> float:
    """Mean log-likelihood [nats] of a model over records of the truth, up to a constant."""
    t, dt = np.arange(true.n) * true.sensor.dt, true.sensor.dt
    assumed, P = model.spectrum, true.spectrum
    total = []
    for _ in range(CLIMATES):
        temperature, phase = climate(rng, true.n, dt), rng.uniform(-np.pi, np.pi)
        left = true.signal(temperature) - model.signal(temperature)
        for size, f in true.lines():
            left = left + size * np.sin(2.0 * np.pi * f * t + phase)
        for size, f in model.lines():
            left = left - _best_line(left, size, 2.0 * np.pi * f * t, assumed)
        total.append(nats.expected(P, left, assumed))
    return float(np.mean(total)) + _outlying(true, model) + _switching(true, model, rng)


def _best_line(left: Array, size: float, angle: Array, P: Array) -> Array:
    """The line of given size and frequency, in the phase that explains most."""
    pair = np.stack([np.sin(angle), np.cos(angle)])
    B, D = dct(pair, norm="ortho", axis=1)[:, 1:], dct(left, norm="ortho")[1:]
    toward, G = (B / P) @ D, (B / P) @ B.T
    way = np.stack([np.cos(PHASES), np.sin(PHASES)])
    gain = size * toward @ way - 0.5 * size**2 * np.einsum("ik,ij,jk->k", way, G, way)
    return np.asarray(size * way[:, int(gain.argmax())] @ pair)


def _outlying(true: Model, model: Model) -> float:
    """Nats of the mixture over the normal law of its variance, where outliers are hidden and named."""
    there, said = true.of("outliers"), model.of("outliers")
    if not there or not said:
        return 0.0
    unit = true.sensor.white * true.si
    pair = [(v["share"], v["sigma"] / unit) for v in (there[0], said[0])]
    return nats.mixture_gain(true.n, *pair[1], true=pair[0], white=model.sensor.white / true.sensor.white)


def _switching(true: Model, model: Model, rng: np.random.Generator) -> float:
    """Nats of two levels over the normal law of their spectrum, where telegraph noise is hidden and named."""
    there, said = true.of("random_telegraph"), model.of("random_telegraph")
    if not there or not said:
        return 0.0
    dt, unit = true.sensor.dt, true.sensor.white * true.si
    white = np.full(true.n - 1, true.sensor.white**2)
    second = SPECTRA["random_telegraph"](true.n, dt, said[0]) / true.si**2
    nothing, P = np.zeros(true.n), true.spectrum
    spectral = nats.expected(P, nothing, white + second) - nats.expected(P, nothing, white)
    stay = 0.5 + 0.5 * float(np.exp(-2.0 * dt / said[0]["dwell"]))
    drawn = []
    for _ in range(RECORDS):
        level = telegraph(rng, true.n, dt, there[0]["dwell"])
        y = rng.standard_normal(true.n) + there[0]["size"] / unit * level
        drawn.append(nats.telegraph_gain(y, abs(said[0]["size"]) / unit, stay))
    return float(np.mean(drawn)) - spectral
