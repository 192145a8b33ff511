"""What a record of a sensor at rest is said to have, in words: warnings of sampling, cleaning and fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby

from kfgen.core.channel_names import AXES, sensor_and_axis
from kfgen.core.numbers import few_digits, how_many, moment
from kfgen.core.time_budget import LESS_TO_SEARCH

MAX_TIMES_SAID = 5
"""Events of which the times are said."""
MAX_RECORD_HOURS = 1000.0
"""Length of a record beyond which nobody logs [h]."""
COUNTS_AS_NOISE = "the sensors moved ({how}), and this motion counts as noise here: log them at rest"
"""What is said where noise is looked for in a log of sensors that moved."""
IN_LONGEST_REST = "the sensors moved ({how}): {done} is their longest rest, {start} to {stop} s, for what they read in motion is no noise"
"""The same where they rest for long enough."""
MAY_BE_A_RAMP = "a ramp explains the end of the curve as well as the random walk that was fitted"
"""What is said of an Allan curve whose end rises as a ramp does."""


def record_length(hours: float) -> str:
    """The length of a record in the unit in which one would ask for it; empty beyond `MAX_RECORD_HOURS`.

    Parameters
    ----------
    hours : float
        [h].
    """
    if not hours <= MAX_RECORD_HOURS:
        return ""
    for seconds, unit in ((1.0, "s"), (60.0, "min")):
        if 3600.0 * hours < 100.0 * seconds:
            return f"{math.ceil(3600.0 * hours / seconds):d} {unit}"
    return f"{few_digits(hours)} h"


def measured_by(hours: float) -> str:
    """Which record would measure half of an upper limit to a fifth [h]."""
    long = record_length(hours)
    log = f"a {long} log" if long else f"no log of {MAX_RECORD_HOURS:g} h"
    return f"{log} would measure half of this limit to ±20 %"


def no_limit(ended_early: bool) -> str:
    """Why a parameter has no upper limit: the search ended before, or the record does not close it."""
    why = (
        f"the search ended before; {LESS_TO_SEARCH}"
        if ended_early
        else "this record sets none; a longer one may"
    )
    return f"without an upper limit: {why}"


def of_channels(said: Mapping[str, Sequence[str]]) -> list[str]:
    """What is said of channels, each sentence once, led by all channels of which it is true.

    Parameters
    ----------
    said : mapping of str to sequence of str
        Sentences by channel.

    Returns
    -------
    list of str
        In the order in which the sentences come first.
    """
    channels: dict[str, list[str]] = {}
    for name, sentences in said.items():
        for sentence in sentences:
            channels.setdefault(sentence, []).append(name)
    return [f"{_together(names)}: {sentence}" for sentence, names in channels.items()]


def _together(channels: Sequence[str]) -> str:
    """Channels for a message: a sensor of which all axes are there, one after another, by its name."""
    names = []
    for sensor, axes in groupby(channels, lambda c: sensor_and_axis(c)[0]):
        some = list(axes)
        names += [sensor] if len(some) == len(AXES) else some
    return ", ".join(names)


def missing_all_along(share: float, rate: float) -> str:
    """Of a log that lost a share of its samples at a rate [Hz]."""
    return (
        f"{few_digits(100.0 * share)} % of the samples are missing, all along the log, at a rate of {rate:.4g} Hz; "
        "the fit takes them as missing"
    )


def not_numbers(lost: int, runs: int, longest: int, at_s: float) -> str:
    """Of samples that are not numbers, in so many runs, the longest one of so many samples at a time [s]."""
    are = "is" if lost == 1 else "are"
    return (
        f"{how_many(lost, 'sample')} {are} not a number, in {how_many(runs, 'run')}, the longest of {longest} at "
        f"t = {moment(at_s)} s; the fit takes them as missing"
    )


def gaps(count: int, lost: int, longest_s: float, at_s: float) -> str:
    """Of times at which nothing was logged."""
    return (
        f"{how_many(count, 'gap')}, {how_many(lost, 'sample')} missing in all, the longest gap "
        f"{longest_s:.4g} s at t = {moment(at_s)} s; the fit takes them as missing"
    )


def is_of_gaps(sentence: str) -> bool:
    """Whether a sentence is that of `gaps`."""
    return "missing in all" in sentence


def jitter(share: float) -> str:
    """Of time stamps whose steps differ from a period by a share (root mean square)."""
    return f"the time stamps jitter by {few_digits(100 * share)} % of a period (root mean square)"


def uneven_time(period_s: float) -> str:
    """Of samples at uneven times, each of which stands for a period."""
    return f"time is uneven: white noise is counted as if each sample stood for {period_s:.4g} s"


def noise_changes(times: float) -> str:
    """Of a record whose stretches differ in their noise by a factor."""
    return (
        "the noise is not the same all along: its standard deviation between stretches goes by a factor of "
        f"{times:.3g}; N is an average"
    )


def logs_differ(times: float) -> str:
    """Of logs whose noises differ by a factor."""
    return f"the logs differ in their noise by a factor of {times:.3g}; one is fitted to all"


def curve_rises(below_s: float) -> str:
    """Of a published curve that does not fall below a time."""
    return f"the curve does not fall as noise does below {below_s:.3g} s, left out of the fit"


def allan_curve(points: int, shortest_s: float, longest_s: float) -> str:
    """Of a published curve: how much of what it is."""
    return f"Allan deviation at {points} averaging times, {shortest_s:.3g} to {longest_s:.4g} s, without its samples"


def stuck(longest_s: float, start_s: float, others: int) -> str:
    """Of samples that repeat one value."""
    more = f", and {how_many(others, 'other time')}" if others else ""
    return (
        f"one value is repeated for {longest_s:.4g} s from t = {moment(start_s)} s on{more}: the sensor slept or was "
        "stuck, or the logger held it. Cut the log there"
    )


def low_pass(above_hz: float) -> str:
    """Of an internal low-pass."""
    return f"an internal low-pass takes power away above {above_hz:.3g} Hz, left out of the fit"


def drift(titles: Sequence[str], longest_s: float) -> str:
    """Of effects that the record is too short to tell what they are."""
    return (
        f"there is a slow drift, fitted as {' and '.join(titles)}; {longest_s:.0f} s are too short to tell "
        "what it is: a random walk, a Gauss-Markov bias, warm-up or temperature"
    )


def spectrum_differs(times: float) -> str:
    """Of a spectrum that the terms do not explain: intervals are so many times as wide."""
    return (
        f"the spectrum differs from that of the terms beyond chance: intervals are up to {few_digits(times)} times as wide as "
        "they would be if it did not"
    )


def outlier_share(share: float) -> str:
    """Of outliers that were left out."""
    return f"{few_digits(100 * share)} % of the samples are outliers, left out"


def outliers(share: float, times_s: Sequence[float]) -> str:
    """Of single outliers, with the times [s] of the first ones."""
    times = ", ".join(f"{moment(t)} s" for t in times_s[:MAX_TIMES_SAID])
    return f"{outlier_share(share)} of the fit: at t = {times}{_more(len(times_s))}"


def outlier_law(share: float, lo: float, hi: float) -> str:
    """Of outliers that have a size of their own: their share with its interval."""
    return (
        f"{few_digits(100 * share)} % of the samples are outliers ({few_digits(100 * lo)} to {few_digits(100 * hi)} %): they have a size "
        "of their own, and N is that of the noise without them. Look for glitches of the bus or of the supply"
    )


HEAVY_TAILS = (
    "more samples are far from their neighbours than normal noise has, and too many of them for outliers: N is that of all."
    " Look at the samples: bursts, a coarse ADC grid, or a threshold inside the sensor"
)


def shocks(begun_and_length_s: Sequence[tuple[float, float]]) -> str:
    """Of shocks, with beginning and length [s] of the first ones."""
    n = len(begun_and_length_s)
    times = ", ".join(f"at t = {moment(t)} s for {d:.3g} s" for t, d in begun_and_length_s[:MAX_TIMES_SAID])
    return f"{'a shock is' if n == 1 else f'{n} shocks are'} left out of the fit: {times}{_more(n)}"


def coarse_grid(step_in_sd: float) -> str:
    """Of an ADC grid wider than the noise."""
    return f"neighbouring values are {few_digits(step_in_sd)} standard deviations apart: too coarse for sizes to be trusted"


def clipped(share: float) -> str:
    """Of samples at the ends of the range."""
    return f"{few_digits(100 * share)} % of the samples stand at the largest or smallest value: clipped, sizes are too small"


def _more(n: int) -> str:
    return f" and {n - MAX_TIMES_SAID} more" if n > MAX_TIMES_SAID else ""
