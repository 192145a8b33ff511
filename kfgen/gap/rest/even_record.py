"""A channel of a log as an even record: holes drawn over, and said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.numbers import moment
from kfgen.core.sampling_period import usual_period
from kfgen.effects import Effect, sampled_spectrum
from kfgen.effects.faults.samples import MIN_STEPS_FOR_REPEATS
from kfgen.effects.series import DetectedFault, RawSamples, periods
from kfgen.gap.core.completion import Completion
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.bad_samples import invalid_samples, words_of
from kfgen.gap.rest.faults import assumed_sd
from kfgen.gap.rest.words import drawn
from kfgen.identify.evidence.record import Record
from kfgen.identify.screening.noise_free import refuse_noise_free
from kfgen.identify.screening.shocks import shocks, shocks_said
from kfgen.log.log import Log
from kfgen.log.own_rows import OwnSamples

Array = NDArray[np.float64]

MAX_RATIO_OF_NOISE = 1e6
"""Of steps between samples over the assumed noise, or its inverse, beyond which nothing is compared."""
MAX_MISSING_SHARE = 0.5
"""Share of the samples that may be missing."""
MIN_MEAN_WINDOW_SAMPLES = 512
"""Samples at least of the mean about which missing ones are drawn."""
STEP_FREQUENCIES = 2048
"""At which the spectrum of steps between neighbours is summed."""
MAX_STEP_ERROR_PERIODS = 0.35
"""Of a period: root mean square of the steps' error beyond which there is no period."""


def regular(
    log: Log, name: str, assumed: Sequence[Effect] = (), drive: Mapping[str, Array] | None = None
) -> tuple[Record, Array, list[str]]:
    """A channel as an even record, its time stamps as they are, and what is to be said.

    Missing samples and those of shocks are drawn from the assumed noise in the size of its steps, about the mean beside them.

    Parameters
    ----------
    assumed : sequence of Effect
        Of the channel.
    drive : mapping, optional
        As of `drivers_of`; the channel itself is none.

    Raises
    ------
    InputError
        Most samples are missing, or time is uneven.
    """
    t, y, drive, said = _own(log, name, {k: v for k, v in (drive or {}).items() if k != name})
    good = np.isfinite(y)
    logged = t[good]
    said += _without_shocks(t, y, good, name)
    calm = t[good]
    faults: tuple[DetectedFault, ...] = ()
    if calm.size > MIN_STEPS_FOR_REPEATS:
        invalid, faults = invalid_samples(RawSamples(calm, y[good], assumed_sd(assumed, usual_period(calm))))
        said += words_of(name, calm, invalid, faults)
        good[good] = ~invalid
    stamps = t[good]
    if y.size < 3:
        raise InputError(
            f"{name} has {y.size} samples, too few to compare", where=log.source, remedy="Give a longer log"
        )
    if stamps.size < 3 or stamps.size < MAX_MISSING_SHARE * y.size:
        what = "are no numbers" if faults == () else "are no numbers, are stuck, or are beyond all others"
        raise InputError(
            f"{y.size - stamps.size} of {y.size} samples of {name} {what}",
            where=log.source,
            remedy="Check the sensor and the column",
        )
    _refuse_noise_free(log, name)
    dt = usual_period(stamps)
    _refuse_far(log, name, y[good], _step_sd(assumed, dt))
    steps = periods(stamps, dt)
    error = float(np.sqrt(np.mean((np.diff(stamps) / dt - steps) ** 2)))
    count = int(steps.sum()) + 1
    if error > MAX_STEP_ERROR_PERIODS or count > stamps.size / MAX_MISSING_SHARE:
        raise InputError(
            f"time is uneven: {count} periods of {dt:.4g} s for {stamps.size} samples, the longest step after "
            f"t = {moment(stamps[int(np.argmax(np.diff(stamps)))])} s",
            where=log.source,
            remedy="Cut the log at its gaps, or give the sensor's own rate with --rate HZ where it samples evenly "
            f"and only the stamps are late (their mean is {1.0 / float(np.diff(stamps).mean()):.4g} Hz)",
        )
    place = np.concatenate([[0.0], np.cumsum(steps)])
    if count == y.size and good.all():
        return Record(t, y, drive, faults=faults), logged, said
    dt = float(np.polyfit(place, stamps, 1)[0])
    even = np.arange(count)
    filled = _drawn_over(np.interp(even, place, y[good]), np.isin(even, place), assumed, dt)
    drive = {k: np.interp(even, place, v[good]) for k, v in drive.items()}
    if count > stamps.size:
        said.append(drawn(count - stamps.size, name))
    return Record(stamps[0] + dt * even, filled, drive, faults=faults), logged, said


def _own(log: Log, name: str, drive: Mapping[str, Array]) -> tuple[Array, Array, dict[str, Array], list[str]]:
    """Times, values and drivers at the rows at which a channel has a sample, if its sensor is slower than the log."""
    y = log.channel(name).values
    own = OwnSamples.of(log.t, y)
    if not own.is_slower:
        return log.t, y, dict(drive), []
    said = [f"{name}: {words}" for words in own.said]
    return own.t, y[own.rows], {k: v[own.rows] for k, v in drive.items()}, said


def _without_shocks(t: Array, y: Array, good: NDArray[np.bool_], name: str) -> list[str]:
    """Mark the samples of shocks as no good ones, and say when they were."""
    at = np.flatnonzero(good)
    spans = shocks(y[at])
    for first, end in spans:
        good[at[first:end]] = False
    return [f"{name}: {words}" for words in shocks_said(t[at], spans)]


def _refuse_noise_free(log: Log, name: str) -> None:
    try:
        refuse_noise_free(log.channel(name).values)
    except InputError as error:
        raise InputError(error.what, where=f"{log.source}: channel {name}", remedy=error.remedy) from None


def _step_sd(assumed: Sequence[Effect], dt: float) -> float:
    """Standard deviation of a step between neighbours, of all of the noise: its white part alone may be hidden [SI]."""
    random = [e for e in assumed if not e.coefficients()]
    if not random:
        return 0.0
    omega = np.pi * (np.arange(STEP_FREQUENCIES) + 0.5) / STEP_FREQUENCIES
    S = sampled_spectrum(random, omega, dt, 1, STEP_FREQUENCIES)
    return float(np.sqrt(np.mean(4.0 * np.sin(0.5 * omega) ** 2 * S)))


def _refuse_far(log: Log, name: str, y: Array, assumed: float) -> None:
    """Refuse samples whose noise is so far from what is assumed that no effect explains it."""
    steps = np.abs(np.diff(y))
    noise = float(np.median(steps[steps > 0.0])) if steps.any() else 0.0
    ratio = noise / assumed if assumed > 0.0 else 1.0
    if noise > 0.0 and not 1.0 / MAX_RATIO_OF_NOISE < ratio < MAX_RATIO_OF_NOISE:
        raise InputError(
            f"the noise of {name} is {ratio:.2g} times what the model says: they are not of one sensor",
            where=log.source,
            remedy="Check the unit of the column and the noise file, or identify the log first",
        )


def _drawn_over(y: Array, known: NDArray[np.bool_], assumed: Sequence[Effect], dt: float) -> Array:
    """The series with the unknown samples as the noise makes them likely, shape (n,); always the same.

    The noise has the size that the steps between known neighbours show: what is drawn is no mixture of two sizes then,
    which would look like outliers.
    """
    from scipy.ndimage import uniform_filter1d

    random = [e for e in assumed if not e.coefficients()]
    if not random:
        return y
    hole = int(np.diff(np.flatnonzero(np.concatenate([[True], known, [True]]))).max())
    window = min(max(MIN_MEAN_WINDOW_SAMPLES, 2 * hole), y.size)
    count = uniform_filter1d(known.astype(np.float64), window)
    mean = uniform_filter1d(np.where(known, y, 0.0), window) / np.maximum(count, 1.0 / window)
    white = Whitener.of(random, y.size, dt, constant=True)
    amplitude = np.divide(1.0, white.weight, out=np.zeros(y.size), where=white.weight > 0.0)
    noise = Whitener.back(np.random.default_rng(0).standard_normal(y.size) * amplitude)
    beside = known[1:] & known[:-1]
    if beside.any() and noise.any():
        noise *= np.sqrt(np.mean(np.diff(y)[beside] ** 2) / np.mean(np.diff(noise) ** 2))
    away = np.where(known, y - mean - noise, 0.0)
    return np.where(known, y, mean + noise + Completion.of(white, known).completed(away))
