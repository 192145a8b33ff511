"""The gain of a sensor above the frequency from which on its internal low-pass takes power away.

The terms are fitted below that frequency. Above it the power of the record over that of the terms is the square of the
gain, whose logarithm goes in straight lines from knot to knot: the spectral likelihood is concave in its values, and
Newton's steps climb to its top. Knots are set one after another where they raise it most, as long as they pay [1]_.

References
----------
.. [1] J. H. Friedman, Multivariate adaptive regression splines, Annals of Statistics 19(1), 1991.
.. [2] H. Akaike, A new look at the statistical model identification, IEEE Trans. Automatic Control 19(6), 1974.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.process.sensor_response import GAINS, SensorResponse
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import residual_ratio

Array = NDArray[np.float64]

MIN_ORDINATES = 30.0
"""Spectral ordinates beyond the frequency, below which nothing is described."""
BINS_PER_DECADE_OF_RESPONSE = 400
"""Of the spectrum, so that a zero of a filter is seen."""
POSSIBLE_KNOTS = 64
"""Equally spaced frequencies at which a knot may stand."""
NATS_OF_A_KNOT = 2.0
"""Gain of log-likelihood that a knot must bring: what its two numbers cost the prediction of another record [2]_."""
MAX_NEWTON_STEPS = 60
MAX_STEP_NATS = 1.0
"""Change of the logarithm of a power in one step."""
SMALL_STEP_NATS = 1e-6
RIDGE = 1e-9
"""Of the ordinates: the least that is known of the gain at a knot without any about it."""


def response_beyond(
    cut_hz: float, records: Sequence[Record], effects: Sequence[Effect]
) -> SensorResponse | None:
    """The gain beyond a frequency, None where too little of the spectrum lies there.

    Parameters
    ----------
    cut_hz : float
        Up to it the gain is one [Hz].
    records : sequence of Record
        Of one sensor at one rate, without averages.
    effects : sequence of Effect
        Fitted below `cut_hz`, with their values [SI].

    Returns
    -------
    SensorResponse or None
    """
    seen = _Excess(*np.concatenate([_excess(cut_hz, r, effects) for r in records], axis=1))
    if seen.count.sum() < MIN_ORDINATES:
        return None
    end = 0.5 / records[0].dt
    possible = np.linspace(cut_hz, end, POSSIBLE_KNOTS + 1)[1:-1].tolist()
    best = seen.line((cut_hz, end), np.zeros(1))
    while len(best.knots) <= GAINS:
        more = [seen.line(*best.with_knot(at)) for at in possible if at not in best.knots]
        better = max(more, key=lambda line: line.likelihood)
        if better.likelihood < best.likelihood + NATS_OF_A_KNOT:
            break
        best = better
    return best.response(sum(r.duration for r in records))


@dataclass(frozen=True)
class _Line:
    """The logarithm of a power ratio at knots, zero at the first, and the likelihood that it has."""

    knots: tuple[float, ...]
    log_power: Array
    likelihood: float

    def with_knot(self, at: float) -> tuple[tuple[float, ...], Array]:
        """The knots with one more, and the values there on the same line."""
        knots = tuple(sorted((*self.knots, at)))
        return knots, np.interp(knots[1:], self.knots, [0.0, *self.log_power])

    def response(self, measured_over: float) -> SensorResponse:
        """As an effect measured over so long [s], the widest gaps filled with knots on the line."""
        knots, values = self.knots, self.log_power
        while len(knots) <= GAINS:
            line, widest = replace(self, knots=knots, log_power=values), int(np.argmax(np.diff(knots)))
            knots, values = line.with_knot(0.5 * (knots[widest] + knots[widest + 1]))
        return SensorResponse.through(knots[0], knots[1:], np.exp(0.5 * values).tolist(), measured_over)


@dataclass(frozen=True)
class _Excess:
    """Frequency [Hz], power over that of the terms, and number of ordinates of bins."""

    f: Array
    ratio: Array
    count: Array

    def line(self, knots: tuple[float, ...], start: Array) -> _Line:
        """The likeliest line with these knots, from a start."""
        B = np.array([np.interp(self.f, knots, row) for row in np.eye(len(knots))[1:]]).T
        x, ridge = np.array(start), RIDGE * self.count.sum() * np.eye(len(start))
        for _ in range(MAX_NEWTON_STEPS):
            power = self.count * self.ratio * np.exp(-(B @ x))
            step = np.linalg.solve(B.T @ (B * power[:, None]) + ridge, B.T @ (power - self.count))
            x = x + np.clip(step, -MAX_STEP_NATS, MAX_STEP_NATS)
            if np.abs(step).max() < SMALL_STEP_NATS:
                break
        log_mean = B @ x
        return _Line(knots, x, -0.5 * float(self.count @ (log_mean + self.ratio * np.exp(-log_mean))))


def _excess(cut_hz: float, record: Record, effects: Sequence[Effect]) -> Array:
    """Frequency [Hz], power over that of the effects and ordinates of each bin beyond, shape (3, m)."""
    whole = tuple(band for band in record.skip if band[1] < np.inf)
    data = replace(record, skip=whole, per_decade=BINS_PER_DECADE_OF_RESPONSE).ordinates(effects)
    theta = data.log_likelihood(effects).coefficients
    beyond = data.frequency > cut_hz
    return np.stack([data.frequency, residual_ratio(data, effects, theta), data.count])[:, beyond]
