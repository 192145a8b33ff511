"""At which rows of a log a slower sensor gives a new value, where its last one is held over the rows between them.

A logger that writes a row for every sample of the fastest sensor repeats what a barometer of 25 Hz said last, or draws
a line to what it says next (`kfgen.log.drawn_rows`). Rows are taken for held ones only where new values come by a
clock: samples that repeat at random, and those of a coarse ADC that are equal by chance, come at any row.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.sampling_period import is_slower
from kfgen.log.drawn_rows import ends_of_lines
from kfgen.log.log import Log

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]

MIN_NEW_VALUES = 64
"""In a log, from which their clock is known."""
MIN_ROWS_OF_A_VALUE = 1.1
"""On average: a sensor that is hardly slower than the log is not distinguished from one whose samples repeat."""
MIN_SHARE_EITHER_WAY = 0.1
"""Of the changes, that are up, and that are down."""
MIN_SIZES_OF_CHANGE = 3
"""By how many different amounts values change, at least."""
WINDOW_VALUES = 64
"""Over which their clock is looked at: it need not keep time with the logger's for longer."""
MAX_CLOCK_ERROR_ROWS, MAX_CLOCK_ERROR_SHARE = 0.6, 0.05
"""Standard deviation of the rows at which new values come, about those of an even clock: in rows, or of their distance."""
FAST_PERIOD_ROWS, MAX_CLOCK_ERROR_OF_FAST = 1.5, 0.4
"""Rows of a period, below which the error is to be less: rounding to whole rows makes 0.29, repeats at random one in ten 0.6."""
MAX_OFF_AN_EVEN_CLOCK_ROWS = 2.0
"""Over a whole log, within which the times of new values are those of one even clock."""
SHARE_OF_SINGLE_PERIODS = 0.98
"""Of the rows between changes, that are one or two where a sensor is less than twice as slow as the log."""
FIRST_VALUES = 32
"""From which the clock is known at first."""
MIN_SHARE_BY_THE_CLOCK = 0.9
"""Of the windows that keep time."""


@dataclass(frozen=True)
class OwnSamples:
    """What a channel has of its own in a log.

    Parameters
    ----------
    rows : ndarray of bool, shape (n,)
        Of the log, at which it has a value of its own: all that are numbers where none is held.
    t : ndarray, shape (m,)
        Their times [s]; of a slower sensor those of its clock, which the rows show but for parts of a row.
    held : int
        Rows that repeat a value.
    is_slower : bool
        Whether it has a rate of its own, below that of the log.
    is_drawn : bool
        Whether the rows between are not held ones, but lie on straight lines from value to value.
    """

    rows: Rows
    t: Array
    held: int = 0
    is_slower: bool = False
    is_drawn: bool = False

    @staticmethod
    def of(t: Array, y: Array) -> OwnSamples:
        """The samples of one sensor.

        Parameters
        ----------
        t : ndarray, shape (n,)
            Times of the rows [s].
        y : ndarray, shape (n,) or (n, k)
            Values of one channel, or of several that come together; not a number where there is none.

        Returns
        -------
        OwnSamples
        """
        y = y.reshape(t.size, -1)
        there: Rows = np.asarray(np.isfinite(y).all(axis=1))
        at = np.flatnonzero(there)
        if is_slower(t, there):
            return OwnSamples(there, _evened(t[there], _clock(np.diff(at))[0]), is_slower=True)
        change = np.diff(y[at], axis=0)
        first = np.concatenate([[0], 1 + np.flatnonzero(np.any(change != 0.0, axis=1))])
        ends = ends_of_lines(y[at])
        if ends.size and not all(_is_regular(c) for c in np.diff(y[at][ends], axis=0).T):
            new = np.zeros_like(there)
            new[at[ends]] = True
            return OwnSamples(new, t[new], int(at.size - ends.size), is_slower=True, is_drawn=True)
        few = first.size < MIN_NEW_VALUES or at.size < MIN_ROWS_OF_A_VALUE * first.size
        rows = np.diff(first)  # of the first value some may be before the log begins
        if few or all(_is_regular(c) for c in change.T):
            return OwnSamples(there, t[there])
        period, count = _clock(rows[1:])
        if period < MIN_ROWS_OF_A_VALUE:
            return OwnSamples(there, t[there])
        whole = int(rows[0] / period)
        count = np.concatenate([[max(whole, 1)], count])
        first = np.concatenate([[first[1] - whole * period if whole else 0], first[1:]])
        rows = np.diff(first)
        # Of two new values that are equal the second is not seen, but its clock is.
        nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        ticks = np.repeat(first[:-1], count) + np.rint(nth * np.repeat(rows / count, count))
        new = np.zeros_like(there)
        new[at[np.append(ticks, first[-1]).astype(np.intp)]] = True
        return OwnSamples(new, _evened(t[new], period), int(at.size - new.sum()), is_slower=True)

    @property
    def rows_of_a_value(self) -> float:
        """Of the log, on average."""
        return 1.0 + self.held / self.t.size

    @property
    def said_of_rows(self) -> str:
        """Of rows on lines between values, where all rows are taken."""
        return (
            f"the log draws straight lines from value to value, {self.rows_of_a_value:.3g} rows apart, and a filter takes "
            "each row for a measurement of its own, which is too sure: log the samples as the sensor gives them"
        )

    @property
    def said(self) -> list[str]:
        """A sentence on held rows; none without them."""
        if not self.held:
            return []
        m = self.t.size
        rate = (m - 1) / float(self.t[-1] - self.t[0])
        rows = self.rows_of_a_value
        how = (
            f"draws straight lines from value to value, {rows:.3g} rows apart: the {m} values"
            if self.is_drawn
            else f"holds each value over {rows:.3g} rows on average: the {m} new values"
        )
        return [f"its sensor is slower than the log, which {how} are taken, {rate:.4g} a second"]


def with_own_samples(log: Log, sensors: Iterable[Sequence[str]], *, by_filter: bool = False) -> Log:
    """A log in which channels have a value where their sensor gave one, and no number in the rows between.

    These hold the last value, or lie on a line to the next one. Its `held` says of which channels.

    Parameters
    ----------
    log : Log
    sensors : iterable of sequence of str
        The channels of each, whose values come together; those that the log lacks are left alone.
    by_filter : bool
        Whether a filter takes the rows: those on lines are measurements to it, and stay as they are.

    Returns
    -------
    Log
    """
    channels, said = dict(log.channels), []
    for names in sensors:
        there = [n for n in names if n in channels]
        own = OwnSamples.of(log.t, np.array([channels[n].values for n in there]).T) if there else None
        if own is None or not own.held:
            continue
        if own.is_drawn and by_filter:
            said += [f"{', '.join(there)}: {own.said_of_rows}"]
            continue
        for n in there:
            channels[n] = replace(channels[n], values=np.where(own.rows, channels[n].values, np.nan))
        said += [f"{', '.join(there)}: {words}" for words in own.said]
    return replace(log, channels=channels, held=(*log.held, *said)) if said else log


def log_of_sensor(log: Log, names: Sequence[str]) -> Log:
    """The channels of one sensor that is slower than a log at the rows at which it has values; other logs as they are.

    Parameters
    ----------
    log : Log
    names : sequence of str
        Channels whose values come together.

    Returns
    -------
    Log
    """
    own = OwnSamples.of(log.t, np.array([log.channel(n).values for n in names]).T)
    if not own.is_slower:
        return log
    channels = {n: replace(log.channel(n), values=log.channel(n).values[own.rows]) for n in names}
    said = tuple(f"{', '.join(names)}: {words}" for words in own.said)
    return replace(log, t=own.t, channels=channels, held=(*log.held, *said))


def _evened(t: Array, period: float) -> Array:
    """Times [s] of an even clock through those of rows, where these are nowhere further from it than a row or two."""
    if period < MIN_ROWS_OF_A_VALUE:
        return t
    k = np.arange(t.size)
    even = np.polyval(np.polyfit(k[1:], t[1:], 1), k)
    row = float(even[1] - even[0]) / period
    off = np.abs(t - even)[1:].max(initial=0.0)
    return np.asarray(even) if off < MAX_OFF_AN_EVEN_CLOCK_ROWS * row else t


def _is_regular(change: Array) -> bool:
    """Whether values themselves come by a rule: a ramp on a grid changes by a clock, too, and so does a square wave."""
    up, down = int(np.sum(change > 0.0)), int(np.sum(change < 0.0))
    sizes = np.unique(np.abs(change[change != 0.0])).size
    return min(up, down) < MIN_SHARE_EITHER_WAY * (up + down) or sizes < MIN_SIZES_OF_CHANGE


def _clock(rows: NDArray[np.intp]) -> tuple[float, NDArray[np.intp]]:
    """The period of an even clock in rows, from those between changes of the value, and how many periods each is.

    Zero where they keep no time. Of more than one period is what holds new values that equal the one before.
    """
    least = float(np.quantile(rows, 0.05))
    one = rows[rows <= least + 1.0]  # the whole rows below and above one period
    at = np.concatenate([[0.0], np.cumsum(rows)])
    period, start = float(one.mean()), 0.0
    known = min(FIRST_VALUES, rows.size)
    ticks = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(rows[:known] / period), 1.0))])
    if least <= 1.0 and one.size >= SHARE_OF_SINGLE_PERIODS * rows.size:
        # One row and two are one period each.
        every = np.where(rows <= least + 1.0, 1.0, np.rint(rows / period))
        ticks, known = np.concatenate([[0.0], np.cumsum(every)]), 2 * at.size
    while True:  # the clock of twice as many values is known from that of the first ones
        period, start = np.polyfit(ticks, at[: ticks.size], 1).tolist()
        if ticks.size == at.size and known > at.size:
            break
        known *= 2
        ticks = np.rint((at[:known] - start) / max(period, 1.0))
    count = np.diff(ticks)
    size = min(WINDOW_VALUES, rows.size)
    starts = range(0, rows.size - size + 1, size)
    off = np.array([_clock_error(rows[a : a + size], count[a : a + size]) for a in starts])
    rows_off = MAX_CLOCK_ERROR_OF_FAST if period < FAST_PERIOD_ROWS else MAX_CLOCK_ERROR_ROWS
    limit = max(rows_off, MAX_CLOCK_ERROR_SHARE * period)
    keeps_time = bool(np.mean(off < limit) >= MIN_SHARE_BY_THE_CLOCK and count.min() > 0)
    return (period if keeps_time else 0.0), count.astype(np.intp)


def _clock_error(rows: NDArray[np.intp], count: Array) -> float:
    """Standard deviation of rows about a straight line in the number of clock periods."""
    x = np.concatenate([[0.0], np.cumsum(count)])
    y = np.concatenate([[0.0], np.cumsum(rows)])
    return float(np.std(y - np.polyval(np.polyfit(x, y, 1), x)))
