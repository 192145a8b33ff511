"""The gain of a sensor over frequency as a record at rest shows it: its own low-pass, of any shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects.effect import AddsNothingAtRest, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, NotModelled

Array = NDArray[np.float64]

GAINS = 16
"""Frequencies at which a response is described."""


@dataclass(frozen=True)
class SensorResponse(AddsNothingAtRest):
    """The gain over frequency: one up to `start`, then its logarithm goes in straight lines from gain to gain.

    Beyond the last frequency the last gain holds. `measured_over` is the length of the records in which the gains were
    measured, zero where they are known.
    """

    start: Any = parameter("Hz", "setting")
    frequency_1: Any = parameter("Hz", "setting")
    gain_1: Any = parameter("", "setting")
    frequency_2: Any = parameter("Hz", "setting")
    gain_2: Any = parameter("", "setting")
    frequency_3: Any = parameter("Hz", "setting")
    gain_3: Any = parameter("", "setting")
    frequency_4: Any = parameter("Hz", "setting")
    gain_4: Any = parameter("", "setting")
    frequency_5: Any = parameter("Hz", "setting")
    gain_5: Any = parameter("", "setting")
    frequency_6: Any = parameter("Hz", "setting")
    gain_6: Any = parameter("", "setting")
    frequency_7: Any = parameter("Hz", "setting")
    gain_7: Any = parameter("", "setting")
    frequency_8: Any = parameter("Hz", "setting")
    gain_8: Any = parameter("", "setting")
    frequency_9: Any = parameter("Hz", "setting")
    gain_9: Any = parameter("", "setting")
    frequency_10: Any = parameter("Hz", "setting")
    gain_10: Any = parameter("", "setting")
    frequency_11: Any = parameter("Hz", "setting")
    gain_11: Any = parameter("", "setting")
    frequency_12: Any = parameter("Hz", "setting")
    gain_12: Any = parameter("", "setting")
    frequency_13: Any = parameter("Hz", "setting")
    gain_13: Any = parameter("", "setting")
    frequency_14: Any = parameter("Hz", "setting")
    gain_14: Any = parameter("", "setting")
    frequency_15: Any = parameter("Hz", "setting")
    gain_15: Any = parameter("", "setting")
    frequency_16: Any = parameter("Hz", "setting")
    gain_16: Any = parameter("", "setting")
    measured_over: Any = parameter("s", "setting", default=0.0)

    name: ClassVar[str] = "sensor_response"
    title: ClassVar[str] = "gain of the sensor over frequency"
    separating_experiment: ClassVar[str] = "a higher sampling rate"
    sentence_template: ClassVar[str] = (
        "passes everything up to {start}, and {gain_16} of an amplitude at {frequency_16}"
    )
    is_filter: ClassVar[bool] = True
    is_measured: ClassVar[bool] = True

    @classmethod
    def through(
        cls, start: float, frequencies: Sequence[float], gains: Sequence[float], measured_over: float = 0.0
    ) -> SensorResponse:
        """Through gains at frequencies.

        Parameters
        ----------
        start : float
            Up to it the gain is one [Hz].
        frequencies : sequence of float
            Rising, `GAINS` of them [Hz].
        gains : sequence of float
            Ratios of amplitudes there.
        measured_over : float
            Length of the records in which they were measured [s].

        Returns
        -------
        SensorResponse
        """
        numbers = [float(x) for pair in zip(frequencies, gains, strict=True) for x in pair]
        return cls(*(start, *numbers, measured_over))

    @property
    def knots(self) -> tuple[float, ...]:
        """`start` and the frequencies of the gains [Hz]."""
        return (float(self.start), *(float(getattr(self, f"frequency_{k}")) for k in range(1, GAINS + 1)))

    @property
    def gains(self) -> tuple[float, ...]:
        """In order of frequency."""
        return tuple(float(getattr(self, f"gain_{k}")) for k in range(1, GAINS + 1))

    @classmethod
    def read(cls, entry: Mapping[str, Any], unit: str, where: str) -> Self:
        """From a file's entry, see `Effect.read`.

        Raises
        ------
        InputError
            Also where a gain is not positive, or the frequencies do not rise.
        """
        read = super().read(entry, unit, where)
        if read.knots[0] < 0.0 or min(np.diff(read.knots)) <= 0.0:
            raise InputError(
                "the frequencies do not rise",
                where=where,
                remedy="Give start, then frequency_1 and so on above it",
            )
        if min(read.gains) <= 0.0:
            raise InputError(
                "a gain is not positive", where=where, remedy="Give gains as ratios of amplitudes"
            )
        return read

    def variance_of_measured(self, f: Array, duration: float) -> Array:
        """The ratio of the lengths beyond the start: gains are known as well as their own records show power."""
        known = float(self.measured_over)
        return np.where(f > self.start, duration / known, 0.0) if known else np.zeros(f.size)

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Left out: the noise of a filter is white."""
        return NotModelled(
            "a filter takes its samples for independent, and above "
            f"{float(self.start):.3g} Hz they carry less noise than that; its covariance is on the safe side",
            f"Run the filter at no more than {2.0 * float(self.start):.3g} Hz if that is to be exact",
        )

    def response(self, omega: Array, dt: float) -> Array:
        """Square of the gain."""
        f = omega / (2.0 * np.pi * dt)
        return np.asarray(np.exp(2.0 * np.interp(f, self.knots, [0.0, *np.log(self.gains)])))

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """The samples with these gains and without delay, of which a record at rest tells nothing."""
        from scipy.fft import dct, idct

        dt = float(t[-1] - t[0]) / (t.size - 1)
        gain = np.sqrt(self.response(np.pi * np.arange(t.size) / t.size, dt))
        return np.asarray(idct(dct(y) * gain))
