"""Periodic effects and filters: spectral line (`Sinusoid`), resonance, and internal low-pass.

References
----------
.. [1] P. M. Djuric, A model selection rule for sinusoids in white Gaussian noise, IEEE Trans. Signal
   Processing 44(7), 1996.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import AddsNothingAtRest, LinearProcess, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, NotModelled
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.series import OF_A_COEFFICIENT, Detection, WhiteSeries, log_mean

Array = NDArray[np.float64]

MIN_LINE_PERIODS = 2.5
"""Periods of the slowest line that fit into the record: a slower one is a drift."""
MIN_RESONANCE_WIDTH_BINS = 3.0
"""Width of a resonance in bins (inverse lengths of the record) below which it is a spectral line."""
MAX_RESONANCE_DAMPING = 0.25
"""Damping ratio from which on a peak rises to less than twice the level below it: a hump, as slow noise has."""
PERIODOGRAM_OVERSAMPLING = 4
"""Frequencies of the padded periodogram for each frequency of the record."""
TRIAL_DAMPING_RATIOS = (0.005, 0.02, 0.06, 0.2)
"""Damping ratios at which a resonance is looked for."""
MAX_BAND_END_RISE_SIGMAS = 2.0
"""Standard deviations by which the power at the upper end of the band may exceed the middle's in a low-pass."""


@dataclass(frozen=True)
class Sinusoid(LinearProcess):
    """A spectral line (tone): ``amplitude sin(2 pi frequency t + phase)``, from a fan, the mains, a vibration."""

    amplitude: Any = parameter("U", "solved")
    frequency: Any = parameter("Hz", "place")
    phase: Any = parameter("rad", "solved", 0.0)

    name: ClassVar[str] = "sinusoid"
    title: ClassVar[str] = "periodic line"
    separating_experiment: ClassVar[str] = "a longer record, in which a line stays narrow"
    sentence_template: ClassVar[str] = "carries a line of {amplitude} at {frequency}"
    repeatable: ClassVar[bool] = True

    @property
    def lowest_hz(self) -> float:
        """Its frequency [Hz]."""
        return float(self.frequency)

    @classmethod
    @cache
    def coefficients(cls) -> tuple[str, ...]:
        """Of the sine and of the cosine."""
        return ("in_phase", "quadrature")

    @property
    def values(self) -> tuple[float, ...]:
        """Its coefficients."""
        return (
            float(self.amplitude) * float(np.cos(float(self.phase))),
            float(self.amplitude) * float(np.sin(float(self.phase))),
        )

    def solved(self, values: Sequence[float]) -> Self:
        """Amplitude and phase from the coefficients."""
        a, b = values
        return replace(self, amplitude=float(np.hypot(a, b)), phase=float(np.arctan2(b, a)))

    def spread(self, covariance: Array) -> dict[str, float]:
        """Of amplitude and phase, to first order; the frequency, fitted too, doubles that of the phase at the start."""
        a, b = self.values
        size = max(float(np.hypot(a, b)), 1e-300)
        along, across = np.array([a, b]) / size, np.array([-b, a]) / size**2
        return {
            "amplitude": max(float(along @ covariance @ along), 0.0) ** 0.5,
            "phase": 2.0 * max(float(across @ covariance @ across), 0.0) ** 0.5,
        }

    def log_prior(self, covariance: Array) -> float:
        """The amplitude log-uniform over four decades, the phase uniform."""
        size2 = max(float(self.amplitude) ** 2, 0.5 * float(np.trace(covariance)))
        return -float(np.log(np.pi * size2 * OF_A_COEFFICIENT))

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """An undamped oscillator, ``x1' = w x2``, ``x2' = -w x1``."""
        w = 2.0 * np.pi * self.frequency
        a, b = self.values
        return LinearSystem(
            A=((0, w), (-w, 0)),
            W=((0, 0), (0, 0)),
            C=(1, 0),
            x0=(b, a),
            states=(State("line_sin"), State("line_cos")),
        )

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """The line, shape (n,)."""
        phase = 2.0 * np.pi * float(self.frequency) * np.asarray(t) + float(self.phase)
        return np.asarray(float(self.amplitude) * np.sin(phase))

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """The highest of the finely spaced periodogram of the white series."""
        from scipy.fft import next_fast_len, rfft

        size = next_fast_len(PERIODOGRAM_OVERSAMPLING * series.n, real=True)
        Z = rfft(series.z, size)
        f = np.arange(Z.size) / (size * series.dt)
        keep = (f > MIN_LINE_PERIODS / (series.n * series.dt)) & (
            f < 0.5 / series.dt * (1.0 - 2.0 / series.n)
        )
        gain, f = np.abs(Z[keep]) ** 2 / series.n, f[keep]
        w = gain - np.log(np.maximum(2.0 * gain, 1.0) * 0.5 * OF_A_COEFFICIENT)
        # Half of the prior is uniform in frequency, half in its logarithm.
        w = w + np.log(0.5 + 0.5 * f.size / (f * np.sum(1.0 / f)))
        k = int(np.argmax(w))
        at = f[k]
        if 0 < k < f.size - 1:  # the top of a parabola through three points
            a, b, c = gain[k - 1], gain[k], gain[k + 1]
            at = at + 0.5 * (a - c) / min(a - 2.0 * b + c, -1e-12) * (f[1] - f[0])
        weight = float(np.interp(2.0 * np.pi * at * series.dt, series.omega, series.weight))
        if weight <= 0.0:  # the noise's band ends below it
            return []
        amplitude = 2.0 * float(np.sqrt(gain[k] / series.n)) / weight
        # The frequency's standard deviation follows from the curvature of the likelihood [1]_.
        sd = float(np.sqrt(1.5 / max(gain[k], 0.5))) / (np.pi * series.n * series.dt)
        return [
            Detection(
                cls(amplitude, float(at)),
                log_mean(w) - float(w[k]),
                ci95={"frequency": (float(at) - 1.96 * sd, float(at) + 1.96 * sd)},
            )
        ]


@dataclass(frozen=True)
class Resonance(LinearProcess):
    """Noise through a damped oscillator: a peak of finite width at `frequency`, `rms` in the output."""

    frequency: Any = parameter("Hz", "frequency")
    damping: Any = parameter("", "ratio")
    rms: Any = parameter("U")

    name: ClassVar[str] = "resonance"
    title: ClassVar[str] = "resonance"
    separating_experiment: ClassVar[str] = "a longer record, in which a resonance keeps its width"
    sentence_template: ClassVar[str] = "resonates at {frequency} with a damping of {damping} and {rms} rms"
    repeatable: ClassVar[bool] = True

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``x1' = x2``, ``x2' = -w^2 x1 - 2 zeta w x2 + n`` of density ``4 zeta w^3 rms^2``."""
        w = 2.0 * np.pi * self.frequency
        return LinearSystem(
            A=((0, 1), (-(w**2), -2 * self.damping * w)),
            W=((0, 0), (0, 4 * self.damping * w**3 * self.rms**2)),
            C=(1, 0),
            x0=(0, 0),
            states=(State("resonance"), State("resonance_rate", "U/s")),
        )

    def is_itself(self, duration: float) -> bool:
        """Whether its peak is wide enough to be distinguished from a line, and a peak."""
        width_bins = 2.0 * float(self.damping) * float(self.frequency) * duration
        return width_bins > MIN_RESONANCE_WIDTH_BINS and float(self.damping) < MAX_RESONANCE_DAMPING

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """For each of a few widths the band whose power stands out most."""
        power = np.concatenate([[0.0], np.cumsum(series.X**2)])
        n, found = series.n, []
        for damping in TRIAL_DAMPING_RATIOS:
            centre = np.exp(np.arange(np.log(12.0 / damping**0.5), np.log(0.97 * n), damping))
            lo = np.clip((centre * (1.0 - damping)).astype(np.int64), 1, n)
            hi = np.clip((centre * (1.0 + damping)).astype(np.int64) + 1, 1, n)
            m = hi - lo
            if not m.size:
                continue
            r = np.maximum((power[hi] - power[lo]) / np.maximum(m, 1), 1e-6)
            seen = series.weight[np.minimum(centre.astype(int), n - 1)] > 0.0
            gain = np.where(seen & (r > 1.0) & (m > 2), 0.5 * m * (r - 1.0 - np.log(r)), 0.0)
            k = int(np.argmax(gain))
            if gain[k] > 4.0:
                f = float(centre[k]) / (2.0 * n * series.dt)
                S = 1.0 / float(series.weight[int(centre[k])]) ** 2
                rms = np.sqrt((float(r[k]) - 1.0) * S * series.dt * damping * 2.0 * np.pi * f)
                found.append((float(gain[k]), Detection(cls(f, damping, float(rms)))))
        found.sort(key=lambda g: -g[0])
        return [s for _, s in found[:3]]


@dataclass(frozen=True)
class LowPass(AddsNothingAtRest):
    """An internal low-pass of the sensor: it filters everything that the channel carries."""

    corner: Any = parameter("Hz", "corner")
    order: int = parameter("", "setting", 1)

    name: ClassVar[str] = "low_pass"
    title: ClassVar[str] = "internal low-pass"
    separating_experiment: ClassVar[str] = "a higher sampling rate"
    sentence_template: ClassVar[str] = "is low-passed inside at {corner}"
    is_filter: ClassVar[bool] = True

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Left out: the noise of a filter is white."""
        return NotModelled(
            "a filter takes its samples for independent, and a low-pass correlates neighbours",
            f"Run the filter at no more than twice the corner, {2.0 * float(self.corner):.4g} Hz, or name the lag of the sensor",
        )

    def response(self, omega: Array, dt: float) -> Array:
        """One pole, or a Butterworth filter of second order, at the sampling rate."""
        wc = 2.0 * np.pi * float(self.corner) * dt
        if round(float(self.order)) == 1:
            a = np.exp(-wc)
            return np.asarray((1.0 - a) ** 2 / (1.0 - 2.0 * a * np.cos(omega) + a * a))
        ratio = np.tan(0.5 * np.minimum(omega, np.pi - 1e-9)) / np.tan(0.5 * min(wc, np.pi - 1e-3))
        return np.asarray(1.0 / (1.0 + ratio**4))

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """The samples through the same filter."""
        from scipy.signal import butter, lfilter

        dt = float(t[-1] - t[0]) / (t.size - 1)
        if round(float(self.order)) == 1:
            a = float(np.exp(-2.0 * np.pi * float(self.corner) * dt))
            b, c = [1.0 - a], [1.0, -a]
        else:
            b, c = butter(2, min(2.0 * float(self.corner) * dt, 0.999))
        return np.asarray(y[0] + lfilter(b, c, y - y[0]))

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """From corners over the upper two decades of the band and above it, of either order."""
        nyquist, tenth = 0.5 / series.dt, max(series.n // 10, 1)
        upper, middle = (float(np.mean(series.X[at:][:tenth] ** 2)) for at in (-tenth, series.n // 2))
        if upper > middle * (1.0 + MAX_BAND_END_RISE_SIGMAS * float(np.sqrt(4.0 / tenth))):
            return []  # it rises: nothing falls off
        corners = [(1, a) for a in (0.05, 0.2, 0.6, 1.2)] + [(2, a) for a in (0.05, 0.2, 0.4, 0.6, 0.8, 0.92)]
        return [Detection(cls(share * nyquist, order)) for order, share in corners]
