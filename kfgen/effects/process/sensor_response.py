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

GAINS = 8
"""Gains that describe a response."""


def hats(f: Array, start: float, end: float) -> Array:
    """How much of each gain's logarithm is that of the response at frequencies, shape (m, `GAINS`).

    Parameters
    ----------
    f : ndarray, shape (m,)
        Frequency [Hz].
    start, end : float
        Where the gain is still one, and where the last gain stands [Hz].

    Returns
    -------
    ndarray, shape (m, GAINS)
        Between two gains the shares of both sum to one.
    """
    knots = np.linspace(start, end, GAINS + 1)
    return np.array([np.interp(f, knots, row) for row in np.eye(GAINS + 1)[1:]]).T


@dataclass(frozen=True)
class SensorResponse(AddsNothingAtRest):
    """The gain over frequency: one up to `start`, then its logarithm goes in straight lines from gain to gain up to `end`.

    The gains stand at equal steps of frequency. Beyond `end` the last one holds.
    """

    start: Any = parameter("Hz", "setting")
    end: Any = parameter("Hz", "setting")
    gain_1: Any = parameter("", "setting")
    gain_2: Any = parameter("", "setting")
    gain_3: Any = parameter("", "setting")
    gain_4: Any = parameter("", "setting")
    gain_5: Any = parameter("", "setting")
    gain_6: Any = parameter("", "setting")
    gain_7: Any = parameter("", "setting")
    gain_8: Any = parameter("", "setting")

    name: ClassVar[str] = "sensor_response"
    title: ClassVar[str] = "gain of the sensor over frequency"
    separating_experiment: ClassVar[str] = "a higher sampling rate"
    sentence_template: ClassVar[str] = (
        "passes everything up to {start}, and {gain_8} of an amplitude at {end}"
    )
    is_filter: ClassVar[bool] = True

    @classmethod
    def through(cls, start: float, end: float, gains: Sequence[float]) -> SensorResponse:
        """Of gains at equal steps of frequency.

        Parameters
        ----------
        start : float
            Up to it the gain is one [Hz].
        end : float
            Where the last gain stands [Hz].
        gains : sequence of float
            Ratios of amplitudes, `GAINS` of them.

        Returns
        -------
        SensorResponse
        """
        return cls(start, end, *(float(g) for g in gains))

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
            Also where a gain is not positive, or `end` is not above `start`.
        """
        read = super().read(entry, unit, where)
        if not 0.0 <= float(read.start) < float(read.end):
            raise InputError(
                f"end = {entry['end']!r} is not above start = {entry['start']!r}",
                where=where,
                remedy="Give the frequencies up to which the gain is one, and at which gain_8 holds",
            )
        if min(read.gains) <= 0.0:
            raise InputError(
                "a gain is not positive", where=where, remedy="Give gains as ratios of amplitudes"
            )
        return read

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
        return np.exp(2.0 * hats(f, float(self.start), float(self.end)) @ np.log(self.gains))

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """The samples with these gains and without delay, of which a record at rest tells nothing."""
        from scipy.fft import dct, idct

        dt = float(t[-1] - t[0]) / (t.size - 1)
        gain = np.sqrt(self.response(np.pi * np.arange(t.size) / t.size, dt))
        return np.asarray(idct(dct(y) * gain))
