"""From times and samples as they were logged to evidence: even, with gaps, or of uneven time.

Nothing is corrected in silence. Missing samples, gaps and jitter are said; a sampling rate that changes is
refused, for the noise of a sample changes with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.numbers import how_many, moment
from kfgen.core.sampling_period import GAP_IN_PERIODS, STRETCHES, channel_period, single_period
from kfgen.effects.series import adc_step
from kfgen.identify import words
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.kalman import Exact
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.screening.noise_free import refuse_noise_free
from kfgen.log.own_rows import OwnSamples

Array = NDArray[np.float64]

JITTER_SAID_IN_PERIODS = 0.05
"""Of a period: root mean square of the steps' error that is said."""
UNEVEN_IN_PERIODS = 0.2
"""Of a period: beyond, times are taken as they are."""
MAX_GAP_SHARE_OF_STEPS = 0.1
"""Share of the steps beyond which long ones are no gaps."""
MIN_RATIO_OF_CHANGED_RATE = 1.1
"""Ratio of the sampling periods of two stretches that is no chance."""
MAX_MISSING_SHARE = 0.9
"""Share of samples that may be missing."""
MAX_UNEVEN_SAMPLES = 10_000
"""Samples at uneven times that are fitted."""
MAX_DIFFERENCE_OF_PERIODS = 0.005
"""Relative, of the sampling periods of pieces that are fitted together."""
MIN_PIECE_SAMPLES = 512
"""Samples of a piece that has a spectrum of its own."""


def evidence(
    t: Array, y: Array, drive: Mapping[str, Array] | None = None
) -> tuple[Evidence, tuple[str, ...]]:
    """A channel as evidence, with what was found out about its sampling.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Increasing times [s] and samples [SI], not a number where one is missing.
    drive : mapping of str to ndarray, shape (n,)
        Recorded drivers.

    Raises
    ------
    InputError
        Too few samples, most of them missing, no noise at all, or a rate that changes.
    """
    own = OwnSamples.of(t, y)
    limit = _gap_limit(t)
    said = own.said or ([] if own.is_slower else _missing(t, own.rows))
    said += _gaps(t, limit)
    logged, t, y = t, own.t, y[own.rows]
    drive = {k: _filled(v)[own.rows] for k, v in (drive or {}).items()}
    if t.size < 3:
        raise InputError(
            f"{how_many(t.size, 'sample')} {'is' if t.size == 1 else 'are'} too few for a fit",
            remedy="Log more",
        )
    refuse_noise_free(y)
    steps = np.diff(t)
    dt, of_channel = channel_period(logged, steps)
    single = single_period(np.diff(logged))
    if single and float(np.mean(np.diff(logged) > GAP_IN_PERIODS * single)) > MAX_GAP_SHARE_OF_STEPS:
        share = 1.0 - logged.size / (1.0 + (logged[-1] - logged[0]) / single)
        dt, of_channel = single, False
        said = [w for w in said if not words.is_of_gaps(w)] + [words.missing_all_along(share, 1.0 / single)]
    near = steps[steps < GAP_IN_PERIODS * dt]
    _check_rate(*((t, steps) if of_channel else (logged, np.diff(logged))))
    error = float(np.sqrt(np.mean((near / near.mean() - 1.0) ** 2))) if near.size else 1.0
    if error > JITTER_SAID_IN_PERIODS:
        said.append(words.jitter(error))
    gaps = np.flatnonzero(steps >= limit * dt)
    if not gaps.size and error <= UNEVEN_IN_PERIODS:
        return Record(t, y, drive), tuple(said)
    pieces = _pieces(t, y, drive, gaps) if error <= UNEVEN_IN_PERIODS else []
    view: Evidence = JointRecord(tuple(pieces)) if pieces else drawn(t, y, drive, dt)
    period = float((near if error <= UNEVEN_IN_PERIODS else steps).mean())
    if error > UNEVEN_IN_PERIODS:
        if t.size > MAX_UNEVEN_SAMPLES:
            raise InputError(
                f"{t.size} samples at uneven times are too many for the exact likelihood",
                remedy=f"Give the sensor's own rate with --rate HZ, if it samples evenly and only the stamps are "
                f"late (its mean is {1.0 / float(steps.mean()):.4g} Hz); or cut the log to {MAX_UNEVEN_SAMPLES} samples",
            )
        said = [w for w in said if not words.is_of_gaps(w)]  # random times have no gaps
        said.append(words.uneven_time(period))
    return Exact(t, y, drive, period, view, drawn=not pieces), tuple(said)


def _missing(t: Array, there: NDArray[np.bool_]) -> list[str]:
    """A sentence on samples that are not numbers."""
    lost = np.flatnonzero(~there)
    if not lost.size:
        return []
    if lost.size > MAX_MISSING_SHARE * there.size:
        raise InputError(
            f"{lost.size} of {there.size} samples are not a number", remedy="Check the sensor and the column"
        )
    runs = np.split(lost, np.flatnonzero(np.diff(lost) > 1) + 1)
    longest = max(runs, key=len)
    return [words.not_numbers(lost.size, len(runs), longest.size, float(t[longest[0]]))]


def _filled(v: Array) -> Array:
    good = np.isfinite(v)
    at = np.arange(v.size, dtype=float)
    return v if good.all() else np.interp(at, at[good], v[good]) if good.any() else np.zeros(v.size)


def _gap_limit(t: Array) -> float:
    """Periods beyond which a step of time is a gap and no jitter."""
    steps = np.diff(t)
    if not steps.size:
        return GAP_IN_PERIODS
    dt = float(np.median(steps))
    jitter = float(np.median(np.abs(steps - dt))) / 0.6745 / dt
    return max(GAP_IN_PERIODS, 1.0 + 6.0 * jitter)


def _gaps(t: Array, limit: float) -> list[str]:
    """A sentence on times at which nothing was logged."""
    steps = np.diff(t)
    dt = float(np.median(steps)) if steps.size else 0.0
    gaps = np.flatnonzero(steps >= limit * dt)
    # Random times have long steps everywhere: that is no gap.
    if not gaps.size or gaps.size > MAX_GAP_SHARE_OF_STEPS * steps.size:
        return []
    longest = int(gaps[np.argmax(steps[gaps])])
    lost = float(np.sum(steps[gaps] / dt - 1.0))
    return [words.gaps(gaps.size, round(lost), float(steps[longest]), float(t[longest]))]


def _check_rate(t: Array, steps: Array) -> None:
    """A rate that changes for good is refused."""
    if steps.size < 10 * STRETCHES:
        return
    parts = [float(np.median(part)) for part in np.array_split(steps, STRETCHES)]
    if max(parts) < MIN_RATIO_OF_CHANGED_RATE * min(parts) or single_period(steps):
        return
    # Random steps differ as well; a change of rate has stretches that agree with their neighbours.
    calm = [
        float(np.std(part[part < GAP_IN_PERIODS * m]) / m)
        for part, m in zip(np.array_split(steps, STRETCHES), parts)
    ]
    if np.median(calm) > UNEVEN_IN_PERIODS:
        return
    first = next(
        i for i, m in enumerate(parts) if abs(m / parts[0] - 1.0) > 0.5 * (MIN_RATIO_OF_CHANGED_RATE - 1.0)
    )
    near = int(first * steps.size / STRETCHES)
    at = next(
        (
            k
            for k in range(max(near - steps.size // STRETCHES, 0), steps.size)
            if abs(steps[k] / parts[first] - 1.0) < 0.02
        ),
        near,
    )
    raise InputError(
        f"the sampling rate changes from {1 / parts[0]:.4g} Hz to {1 / parts[first]:.4g} Hz at about t = {moment(t[at])} s",
        remedy="Cut the log there and identify the parts one by one; where the sensor's rate did not change, give it "
        "with --rate HZ",
    )


def _pieces(t: Array, y: Array, drive: Mapping[str, Array], gaps: NDArray[np.int64]) -> list[Record]:
    """The stretches between gaps that are long enough, if they are most of the record."""
    edges = [0, *(gaps + 1).tolist(), t.size]
    long = [(a, b) for a, b in pairwise(edges) if b - a >= MIN_PIECE_SAMPLES]
    if sum(b - a for a, b in long) < 0.7 * t.size:
        return []
    whole = Record(t, y, drive)
    pieces = [whole.cut(a, b) for a, b in long]
    usual = float(np.median([p.dt for p in pieces]))  # stamps in whole milliseconds have another median step
    return [p for p in pieces if abs(p.dt / usual - 1.0) < MAX_DIFFERENCE_OF_PERIODS]


def drawn(t: Array, y: Array, drive: Mapping[str, Array], dt: float) -> Record:
    """The record drawn onto an even grid by straight lines.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Increasing times [s] and samples [SI].
    drive : mapping of str to ndarray, shape (n,)
        Recorded drivers.
    dt : float
        Step of the grid [s].
    """
    grid = t[0] + dt * np.arange(max(int((t[-1] - t[0]) / dt) + 1, 3))
    drawn_drive = {k: np.interp(grid, t, v) for k, v in drive.items()}
    return Record(grid, np.interp(grid, t, y), drawn_drive, logged_step=adc_step(y))
