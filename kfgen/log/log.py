"""`Log`: a recording in memory, time and named channels with units; `StoredLog`: one that stays in its file.

A simulated and a measured log are the same type.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kfgen.core.channel_names import acts_on, some_of
from kfgen.core.errors import InputError
from kfgen.core.numbers import moment
from kfgen.core.units import parse_unit, to_si

Array = NDArray[np.float64]

RATE_RELATIVE_TOLERANCE = 0.02
"""Relative difference above which two statements of a sampling rate contradict each other."""


def _frozen(values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class Channel:
    """One recorded quantity.

    Parameters
    ----------
    values : ndarray, shape (n,)
        In the coherent SI unit; NaN where nothing was recorded.
    unit : str
        The unit in which the user gave it, and in which results are shown.
    """

    values: Array
    unit: str

    @staticmethod
    def of(values: ArrayLike, unit: str) -> Channel:
        """A channel from values in the user's unit, which are converted to SI.

        Parameters
        ----------
        values : array_like, shape (n,)
            In `unit`; NaN where nothing was recorded.
        unit : str
            As `kfgen.core.units.parse_unit` reads it.

        Returns
        -------
        Channel

        Raises
        ------
        InputError
            `unit` is no unit.
        """
        return Channel(_frozen(to_si(np.asarray(values, float), unit)), unit)

    @property
    def si(self) -> str:
        """The SI unit of `values`."""
        return parse_unit(self.unit).si


MAX_NAMES_SHOWN = 12
"""Channels that the short text of a log names."""


@dataclass(frozen=True, repr=False)
class Log:
    """Time and named channels.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Time [s], strictly increasing.
    channels : mapping of str to Channel
        By the names of the interface: ``gyro_x``, ``accel_z``, ``temperature``, ``ref_q_w``, ...
    source : str
        Where it came from: a file's name, for messages.
    sha256 : str
        Hash of the file, empty for simulated logs.
    warnings : tuple of str
        What its reader noticed.
    stated : float
        Duration that its header states beside a rate [s]; zero where it states none.
    axis : str
        ``t``, or ``tau`` for a published Allan deviation over averaging times.
    samples : str
        What a sample of an inertial sensor stands for: the interval ``after`` it, the one ``before`` it, or the
        instant (``at``); empty where the log does not say.
    unplaced : mapping of str to str
        Channels none of whose samples is within the time of the log, and what times theirs are.
    held : tuple of str
        Sentences on sensors that are slower than the log, whose held values were left out (`kfgen.log.own_rows`).

    Raises
    ------
    InputError
        Lengths differ, time is not finite or does not increase, or nothing is in it.
    """

    t: Array
    channels: Mapping[str, Channel]
    source: str = "log"
    sha256: str = ""
    warnings: tuple[str, ...] = field(default=())
    axis: str = "t"
    stated: float = 0.0
    samples: str = ""
    unplaced: Mapping[str, str] = field(default_factory=dict)
    held: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", _frozen(self.t))
        object.__setattr__(self, "channels", MappingProxyType(dict(self.channels)))
        if self.t.ndim != 1 or self.t.size == 0:
            raise InputError("there is no sample in it", where=self.source)
        if not self.channels:
            raise InputError("there is no channel in it", where=self.source)
        self._check_time()
        for name, channel in self.channels.items():
            if channel.values.shape != self.t.shape:
                raise InputError(
                    f"channel {name} has {channel.values.size} samples, time has {self.t.size}",
                    where=self.source,
                    remedy="Give every channel one sample for each time",
                )

    def __repr__(self) -> str:
        names = list(self.channels)
        more = f" and {len(names) - MAX_NAMES_SHOWN} more" if len(names) > MAX_NAMES_SHOWN else ""
        axis = f"{self.n} samples, {self.axis} = {moment(self.t[0])} to {moment(self.t[-1])} s"
        return f"{self.source}: {axis}; {', '.join(names[:MAX_NAMES_SHOWN])}{more}"

    def _check_time(self) -> None:
        bad = np.flatnonzero(~np.isfinite(self.t))
        if bad.size:
            raise InputError(
                f"time is not a number at sample {bad[0] + 1}",
                where=self.source,
                remedy="Correct the file, or leave the time out and give --rate",
            )
        back = np.flatnonzero(np.diff(self.t) <= 0.0)
        if back.size:
            k = int(back[0])
            raise InputError(
                f"time does not increase at sample {k + 2}: {self.t[k]:.9g} s is followed by "
                f"{self.t[k + 1]:.9g} s",
                where=self.source,
                remedy="Sort the log, or leave the time out and give --rate",
            )

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.t.size)

    @property
    def dt(self) -> float:
        """Sampling period [s]: the median step of time."""
        if self.n < 2:
            raise InputError("one sample has no sampling period", where=self.source)
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Length of the record [s], the last sample's period included."""
        return float(self.t[-1] - self.t[0]) + self.dt

    def channel(self, name: str) -> Channel:
        """The channel of that name.

        Raises
        ------
        InputError
            The log has no such channel.
        """
        if name not in self.channels:
            raise InputError(
                f"channel '{name}' is missing",
                where=self.source,
                remedy=f"It has {some_of(self.channels)}; map others with --columns",
            )
        return self.channels[name]

    def values(self, name: str) -> Array:
        """The SI values of a channel, shape (n,); raises `InputError` where one is not finite."""
        values = self.channel(name).values
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"channel {name} is not a number at sample {bad[0] + 1} (t = {moment(self.t[bad[0]])} s)"
                f", {bad.size} in all",
                where=self.source,
                remedy="Cut or correct these samples",
            )
        return values

    def unit_at(self, where: str) -> str:
        """The unit of a channel, or of the first whose name begins with that of a sensor; empty where there is none.

        Parameters
        ----------
        where : str
            ``gyro_x``, or ``gyro``.
        """
        return next((c.unit for n, c in self.channels.items() if acts_on(where, n)), "")

    def uniform_dt(self) -> float:
        """The sampling period [s] of an evenly sampled log.

        Raises
        ------
        InputError
            Steps of time differ by more than half a period.
        """
        steps, dt = np.diff(self.t), self.dt
        bad = np.flatnonzero(np.abs(steps - dt) > 0.5 * dt)
        if bad.size:
            raise InputError(
                f"time is uneven: {bad.size} of {steps.size} steps are off by more than half a "
                f"period, the first at t = {moment(self.t[bad[0]])} s ({steps[bad[0]]:.4g} s instead of "
                f"{dt:.4g} s)",
                where=self.source,
                remedy="Cut the log at the gaps, or give the sensor's own rate with --rate HZ where only the stamps are late",
            )
        return float((self.t[-1] - self.t[0]) / steps.size)

    def cut(self, start: int, stop: int) -> Log:
        """A part of the log as a log of its own.

        Parameters
        ----------
        start, stop : int
            First sample, and the one after the last, as in a slice.

        Returns
        -------
        Log
        """
        part = {k: replace(c, values=_frozen(c.values[start:stop])) for k, c in self.channels.items()}
        return replace(self, t=self.t[start:stop], channels=part, stated=0.0)

    def on_disk(self) -> Log:
        """The same log, its channels in a file without a name: the system can drop them from memory and read them again.

        As it is where no such file can be written.
        """
        try:
            with tempfile.TemporaryFile() as file:
                for c in self.channels.values():
                    c.values.tofile(file)
                held = np.asarray(np.memmap(file, np.float64, "r", shape=(len(self.channels), self.n)))
        except OSError:
            return self
        kept = {name: replace(c, values=row) for (name, c), row in zip(self.channels.items(), held)}
        return replace(self, channels=kept)

    def select(self, names: Iterable[str]) -> Log:
        """Only the named channels."""
        return replace(self, channels={name: self.channel(name) for name in names})


@dataclass(frozen=True)
class StoredChannel:
    """A channel that stays in its file.

    Parameters
    ----------
    pieces : callable
        An iterable of pieces of the values as they are stored.
    n : int
        Values.
    unit : str
        The unit in which they are stored.
    """

    pieces: Callable[[], Iterable[Array]]
    n: int
    unit: str

    @property
    def si(self) -> str:
        """The SI unit of what `chunks` gives."""
        return parse_unit(self.unit).si

    def chunks(self) -> Iterator[Array]:
        """The values [SI], piece by piece."""
        for piece in self.pieces():
            yield to_si(np.asarray(piece, dtype=np.float64), self.unit)


@dataclass(frozen=True)
class StoredLog:
    """A log too long for memory: evenly sampled channels that stay in their file.

    Parameters
    ----------
    dt : float
        Sampling period [s].
    channels : mapping of str to StoredChannel
    source, sha256, warnings, axis
        As in `Log`.
    """

    dt: float
    channels: Mapping[str, StoredChannel]
    source: str
    sha256: str
    warnings: tuple[str, ...] = ()
    axis: str = "t"

    def channel(self, name: str) -> StoredChannel:
        """The channel of that name; raises `InputError` where there is none."""
        if name not in self.channels:
            raise InputError(
                f"channel '{name}' is missing", where=self.source, remedy=f"It has {some_of(self.channels)}"
            )
        return self.channels[name]
