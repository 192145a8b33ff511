"""What repeats without being a sine: a heater that switches, the ripple of a supply (`PeriodicWave`).

One trapezoid a period stands for all of them: a rectangle of a duty, smoothed over the width of its flanks. Without
flanks it switches; with flanks of half a period and a duty of one half it is a triangle.

References
----------
.. [1] J. F. Kaiser and others, in: A. V. Oppenheim and A. S. Willsky, Signals and Systems, 1983, sec. 4.2: the
   Fourier series of a periodic rectangle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import LinearProcess, parameter
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.process.periodic import MIN_LINE_PERIODS, Sinusoid
from kfgen.effects.series import Detection, WhiteSeries, coefficient_worth, log_mean

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS_OF_ALLAN_VARIANCE = 4000
"""Whose sum it is."""
HARMONICS_OF_FORM = 3
"""Oscillators that stand for it in a filter."""
MAX_HARMONIC = 40
"""Harmonic that is looked at."""
MIN_GAIN_NATS = 12.0
"""Of the strongest line, below which no wave is looked for."""
MIN_GAIN_OVER_A_SINE_NATS = -2.0
"""Below which a wave does not compete with its line: one that is nearly a sine still may be a wave."""
MAX_ORDER_OF_STRONGEST = 24
"""Of the harmonic that the strongest line may be: all have one size where a wave is up for a single sample."""
MIN_POWER_BESIDE = 4.0
"""Of the other harmonics above that of noise, without which no shape is tried [nats]."""
STRETCHES = 64
"""Of the record, whose harmonics are summed for all nearby frequencies."""
TRIAL_DUTIES = np.concatenate([[0.01, 0.02], np.linspace(0.05, 0.5, 10)])
TRIAL_FLANKS = (0.0, 0.1, 0.2, 0.35, 0.5)
TRIAL_CENTRES = 256
"""Of a period."""
MAX_SAMPLES_TURNED = 3e7
"""Samples times harmonics times orders of the first search."""
MAX_SAMPLES_REFINED = 2e7
"""Samples times trials of the refined search."""
EDGE = 1e-6
"""Least duty and flank, as a share of the period."""


@dataclass(frozen=True)
class PeriodicWave(LinearProcess):
    """A level that goes up by `size` every `period`, first at `start`, for a share `duty` of it, with flanks of a share `flank`.

    Its mean is zero. `start` is the middle of a rise.
    """

    size: Any = parameter("U", "signed")
    period: Any = parameter("s", "place")
    duty: Any = parameter("", "place", 0.5)
    flank: Any = parameter("", "place", 0.0)
    start: Any = parameter("s", "place", 0.0)

    name: ClassVar[str] = "periodic_wave"
    title: ClassVar[str] = "periodic wave"
    separating_experiment: ClassVar[str] = "a record of what switches, the heater or the supply, beside it"
    sentence_template: ClassVar[str] = (
        "goes up and down by {size} every {period}, up for a share of {duty} of it, each flank a share of {flank}, "
        "a first rise at {start}"
    )
    repeatable: ClassVar[bool] = True
    prior_penalty_nats: ClassVar[float] = 2.0

    @property
    def lowest_hz(self) -> float:
        """That of its first harmonic [Hz]."""
        return 1.0 / float(self.period)

    @property
    def _shares(self) -> tuple[float, float]:
        """Duty and flank as shares of a period that are possible."""
        duty = min(max(float(self.duty) % 1.0, EDGE), 1.0 - EDGE)
        return duty, min(max(float(self.flank), EDGE), duty, 1.0 - duty)

    @property
    def _centre(self) -> float:
        """Middle of an upper part [s]."""
        return float(self.start) + 0.5 * self._shares[0] * float(self.period)

    def harmonics(self, count: int) -> Array:
        """Amplitudes [U] of its first cosines about the middle of its upper part, shape (count,) [1]_."""
        duty, flank = self._shares
        return np.asarray(float(self.size) * amplitudes(np.arange(1.0, count + 1.0), duty, flank))

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """The wave, shape (n,)."""
        duty, flank = self._shares
        phase = (np.asarray(t, dtype=np.float64) - float(self.start)) / float(self.period) - 0.5 * duty
        away = np.abs(phase - np.round(phase))
        up = np.clip((0.5 * (duty + flank) - away) / flank, 0.0, 1.0)
        return np.asarray(float(self.size) * (up - duty))

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """Its first harmonics as undamped oscillators, beginning at zero time."""
        count = HARMONICS_OF_FORM
        w, centre = (
            2.0 * np.pi / float(self.period),
            float(self.start) + 0.5 * self._shares[0] * float(self.period),
        )
        A = np.zeros((2 * count, 2 * count))
        x0, states = [], []
        for k, a in enumerate(self.harmonics(count).tolist()):
            A[2 * k, 2 * k + 1], A[2 * k + 1, 2 * k] = (k + 1) * w, -(k + 1) * w
            x0 += [a * np.cos((k + 1) * w * centre), a * np.sin((k + 1) * w * centre)]
            states += [State(f"wave_{k + 1}_cos"), State(f"wave_{k + 1}_sin")]
        zero = tuple((0,) * 2 * count for _ in range(2 * count))
        return LinearSystem(
            A=tuple(map(tuple, A.tolist())),
            W=zero,
            C=(1, 0) * count,
            x0=tuple(map(float, x0)),
            states=tuple(states),
        )

    def allan_variance(self, tau: Array) -> Array:
        """Half the squared difference of its averages over the first two intervals `tau` [U^2], shape (m,), by its harmonics."""
        tau = np.asarray(tau, dtype=np.float64)
        k = np.arange(1.0, HARMONICS_OF_ALLAN_VARIANCE + 1.0)
        w = 2.0 * np.pi * k / float(self.period)

        def integral(t: Array) -> Array:
            return np.asarray(np.sin(np.outer(t - self._centre, w)) @ (self.harmonics(k.size) / w))

        twice = integral(2.0 * tau) - 2.0 * integral(tau) + integral(0.0 * tau)
        return np.asarray(0.5 * (twice / tau) ** 2)

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Where the strongest line is one of its harmonics, if these say more than the line."""
        if not (line := Sinusoid.detect(series)):
            return []
        found = line[0].effect
        assert isinstance(found, Sinusoid)
        f = float(found.frequency)
        weight = float(np.interp(2.0 * np.pi * f * series.dt, series.omega, series.weight))
        gain = 0.25 * series.n * (float(found.amplitude) * weight) ** 2
        if gain < MIN_GAIN_NATS:
            return []
        most = int(np.clip(MAX_SAMPLES_TURNED / (MAX_HARMONIC * series.n), 3, MAX_ORDER_OF_STRONGEST))
        parts = range(1, most + 1)
        tried = [t for part in parts if (t := _about(series, f / part, part)) is not None]
        best = max(tried, key=lambda t: t[0], default=None)
        if best is None or 0.5 * best[0] ** 2 < gain + MIN_GAIN_OVER_A_SINE_NATS:
            return []
        return [_refined(series, best[1], best[2])]


def amplitudes(k: Array, duty: float, flank: float) -> Array:
    """Of the cosines of a smoothed rectangle of unit size [1]_, shape (m,).

    Parameters
    ----------
    k : ndarray, shape (m,)
        Harmonics.
    duty, flank : float
        Shares of a period.

    Returns
    -------
    ndarray, shape (m,)
    """
    return np.asarray(2.0 * duty * np.sinc(k * duty) * np.sinc(k * flank))


def _about(series: WhiteSeries, f: float, order: int) -> tuple[float, PeriodicWave, float] | None:
    """The best wave of about `f` [Hz], its harmonic `order` a known line, by its harmonics.

    With it come its size in standard deviations, and what a wave of its period is worth on average over all shapes and
    starts [nats].
    """
    length = series.n * series.dt
    count = min(int(0.49 / (f * series.dt)), MAX_HARMONIC)
    if count < max(order, 2) or f * length < MIN_LINE_PERIODS:
        return None
    k = np.arange(1.0, count + 1.0)
    sums, middle = _harmonic_sums(series, f, count)

    def transform(df: float) -> Complex:
        return np.asarray(np.sum(sums * np.exp(-2j * np.pi * df * np.outer(middle, k)), axis=0))

    nearby = np.linspace(-0.5, 0.5, 21) / (order * length)
    power = np.array([np.abs(transform(df)) ** 2 for df in nearby.tolist()]) / series.n
    power[:, order - 1] = 0.0
    if order > 1 and (np.cumsum(power, axis=1) - k).max() < MIN_POWER_BESIDE:
        return None
    weight = np.interp(2.0 * np.pi * f * k * series.dt, series.omega, series.weight)
    shapes, share = _shapes()
    template = np.array([amplitudes(k, d, w) for d, w in shapes]) * weight
    best, at, average = (-np.inf, 0, 0), 0.0, -np.inf
    for span, steps, upto in ((0.5, 21, min(max(3, order), count)), (0.06, 13, count)):
        around = at
        for df in around + np.linspace(-span, span, steps) / (order * length):
            D = transform(df)
            score = _scores(template[:, :upto], D[:upto], series.n)
            top = int(np.argmax(np.abs(score)))
            if abs(score.flat[top]) > best[0] or (df == around and upto == count):
                average = log_mean(coefficient_worth(score) + np.log(share * share.size)[:, None])
                best, at = (abs(float(score.flat[top])), *divmod(top, TRIAL_CENTRES)), float(df)
    duty, flank = shapes[best[1]]
    period = 1.0 / (f + at)
    start = series.t[0] + (best[2] / TRIAL_CENTRES - 0.5 * duty) * period
    return best[0], PeriodicWave(1.0, period, duty, flank, float(start)), average


@cache
def _shapes() -> tuple[list[tuple[float, float]], Array]:
    """Duties and flanks that are tried, and the share of all shapes for which each stands, shape (m,)."""
    duties, flanks = TRIAL_DUTIES, np.array(TRIAL_FLANKS)
    shapes = [(d, w) for d in duties.tolist() for w in flanks.tolist() if w <= d]
    of_duty, of_flank = (dict(zip(x.tolist(), np.gradient(x))) for x in (duties, flanks))
    share = np.array([of_duty[d] * of_flank[w] for d, w in shapes])
    return shapes, share / share.sum()


def _harmonic_sums(series: WhiteSeries, f: float, count: int) -> tuple[Complex, Array]:
    """Of stretches of the white series, ``sum z exp(-2 pi i k f t)``, shape (stretches, count); their middles [s]."""
    size = series.n // STRETCHES
    t = np.arange(size * STRETCHES) * series.dt
    z = series.z[: t.size]
    turn = np.exp(-2j * np.pi * f * t)
    each, out = z.astype(np.complex128), np.empty((STRETCHES, count), dtype=np.complex128)
    for k in range(count):
        each = each * turn
        out[:, k] = each.reshape(STRETCHES, size).sum(axis=1)
    return out, t.reshape(STRETCHES, size).mean(axis=1)


def _scores(template: Array, D: Complex, n: int) -> Array:
    """Sizes in standard deviations by shape and centre, shape (m, `TRIAL_CENTRES`)."""
    turned = (D[:, None] * _turns(D.size)).real
    norm = np.sqrt(0.5 * n * np.sum(template**2, axis=1))
    return np.asarray(template @ turned / np.maximum(norm, 1e-300)[:, None])


@cache
def _turns(count: int) -> Complex:
    """Of harmonics, from the first on, by the centres that are tried, shape (count, `TRIAL_CENTRES`)."""
    k = np.arange(1, count + 1)
    return np.asarray(np.exp(2j * np.pi * np.outer(k, np.arange(TRIAL_CENTRES) / TRIAL_CENTRES)))


def _refined(series: WhiteSeries, wave: PeriodicWave, average: float) -> Detection:
    """The wave that fits the samples best near another one, with what its place costs and its intervals.

    Near one with sharp edges the likelihood has as many tops as there are samples beside an edge: of its own width, which
    is that of one top, and of the average over shapes and starts, the larger is nearer to the integral.
    """
    from scipy.optimize import minimize

    length, period = series.n * series.dt, float(wave.period)
    # A change of one moves the last rise by a period, the first one by a period, and both shares by one.
    middle = float(wave.start) + period * round((0.5 * length - float(wave.start)) / period)

    def at(x: Array) -> PeriodicWave:
        T = period * (1.0 + float(x[0]) * period / length)
        duty = min(max(float(wave.duty) + float(x[2]), EDGE), 1.0 - EDGE)
        flank = min(max(abs(float(wave.flank) + float(x[3])), EDGE), duty, 1.0 - duty)
        first = middle + float(x[1]) * period
        return PeriodicWave(1.0, T, duty, flank, first - T * np.floor((first - series.t[0]) / T))

    def worth(x: Array) -> float:
        return float(coefficient_worth(np.array(series.regression(at(x).mean(series.t))[0])))

    trials = int(np.clip(MAX_SAMPLES_REFINED / series.n, 20, 400))
    simplex = np.vstack([np.zeros(4), np.diag([0.05, 0.02, 0.04, 0.05])])
    how = {"initial_simplex": simplex, "maxfev": trials, "xatol": 1e-7, "fatol": 1e-3}
    best = np.asarray(minimize(lambda x: -worth(x), np.zeros(4), method="Nelder-Mead", options=how).x)
    widths = _widths(worth, best)
    found = at(best)
    f, top = 1.0 / float(found.period), 0.5 / series.dt
    lowest = MIN_LINE_PERIODS / length
    of_frequency = widths[0] / length * (0.5 / (top - lowest) + 0.5 / (f * np.log(top / lowest)))
    of_others = np.minimum(widths[1:] * np.array([1.0, 2.0, 2.0]), 1.0)
    located = float(np.log(min(of_frequency, 1.0))) + max(
        float(np.log(of_others).sum()), average - worth(best)
    )
    u = series.regression(found.mean(series.t))
    size = u[0] / max(float(np.linalg.norm(u[1])), 1e-300)
    half = 1.96 / np.sqrt(2.0 * np.pi) * widths * np.array([found.period**2 / length, found.period, 1.0, 1.0])
    values = {"period": found.period, "start": found.start, "duty": found.duty, "flank": found.flank}
    ci95 = {name: (float(v - h), float(v + h)) for (name, v), h in zip(values.items(), half.tolist())}
    effect = PeriodicWave(float(size), found.period, found.duty, found.flank, found.start)
    return Detection(effect, located, ci95=ci95)


def _widths(worth: Callable[[Array], float], best: Array) -> Array:
    """Widths of the likelihood about its maximum, each by itself, shape (4,): ``sqrt(2 pi)`` standard deviations."""
    top, widths = worth(best), []
    for i in range(best.size):
        step = 1e-5
        for _ in range(9):
            away = [worth(best + sign * step * np.eye(best.size)[i]) for sign in (-1.0, 1.0)]
            lost = top - 0.5 * (away[0] + away[1])
            if lost > 0.5:
                break
            step *= 4.0
        widths.append(step * float(np.sqrt(np.pi / max(lost, 1e-3))))
    return np.array(widths)
