"""The verb `contents`: what is inside a log, with rates, gaps and facts of its clocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import kfgen
from kfgen.core.errors import InputError
from kfgen.core.numbers import finite, how_many, moment
from kfgen.core.result import Result, ShortTable
from kfgen.core.units import from_si
from kfgen.log.log import Channel, Log
from kfgen.log.readers import Columns, map_of, read_table, recording_of
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.streams import LogChoice
from kfgen.log.readers.tables.table import assemble

TOPIC_HEAD = ("topic", "messages", "rate [Hz]", "gaps", "longest [s]", "jitter [ms]", "from [s]", "to [s]")
CHANNEL_HEAD = ("channel", "unit", "samples", "rate [Hz]", "gaps", "longest [s]", "mean", "sd", "min", "max")


@dataclass(frozen=True, repr=False)
class Contents(Result):
    """What is inside a log.

    Parameters
    ----------
    source : str
    sha256 : str
        Hash of the file.
    log : Log, optional
        As every verb reads it; None where it cannot be read as it is.
    problem : str
        Why it cannot; empty where it can.
    topics : mapping of str to Clock
        Topics or messages of a flight log.
    """

    source: str
    sha256: str
    log: Log | None
    problem: str
    topics: Mapping[str, Clock]

    @property
    def clocks(self) -> dict[str, Clock]:
        """The clock of each channel: of the samples that it has."""
        if self.log is None:
            return {}
        t, channels = self.log.t, self.log.channels
        return {name: Clock.of(t[np.isfinite(c.values)]) for name, c in channels.items()}

    def summary(self) -> list[str]:
        """How much there is."""
        topics = [how_many(len(self.topics), "topic")] if self.topics else []
        if self.log is None:
            return [", ".join([self.source, *topics]), *self.problem.splitlines()][:5]
        log = self.log
        rate = f" at {1.0 / log.dt:.4g} Hz" if log.n > 1 else ""
        said = f"{log.n} rows{rate}, t = {moment(log.t[0])} to {moment(log.t[-1])} s"
        samples = [f"an inertial sample stands {_STANDS[log.samples]}"] if log.samples else []
        return ["; ".join([self.source, *topics, f"{len(log.channels)} channels", said, *samples])]

    def short_table(self) -> ShortTable:
        """Each channel, or each topic where no channel is known."""
        return (CHANNEL_HEAD, self.channel_rows()) if self.log else (TOPIC_HEAD, self.topic_rows())

    def topic_rows(self) -> list[list[str]]:
        """A row for each topic, by `TOPIC_HEAD`."""
        rows = []
        for name, c in self.topics.items():
            facts = [
                _text(c.rate),
                str(c.gaps),
                _text(c.longest),
                _text(1e3 * c.jitter),
                moment(c.start),
                moment(c.end),
            ]
            rows.append([name, str(c.n), *(facts if np.isfinite(c.start) else [""] * len(facts))])
        return rows

    def channel_rows(self) -> list[list[str]]:
        """A row for each channel, by `CHANNEL_HEAD`, in the units of the log."""
        rows = []
        for name, clock in self.clocks.items():
            assert self.log is not None
            channel = self.log.channels[name]
            facts = [str(clock.n), _text(clock.rate), str(clock.gaps), _text(clock.longest)]
            rows.append([name, channel.unit, *facts, *map(_text, _sizes(channel))])
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Topics and channels with rates and gaps; means and standard deviations in the unit beside them."""
        data: dict[str, Any] = {"format": "kfgen-contents-1", "kfgen": kfgen.__version__}
        data |= {"source": self.source, "sha256": self.sha256, "problem": self.problem}
        data["topics"] = {name: _facts(clock) for name, clock in self.topics.items()}
        data["channels"] = {}
        for name, clock in self.clocks.items():
            assert self.log is not None
            channel = self.log.channels[name]
            sizes = dict(zip(("mean", "sd", "min", "max"), map(finite, _sizes(channel)), strict=True))
            data["channels"][name] = {"unit": channel.unit, **_facts(clock), **sizes}
        if self.log is not None:
            data |= {"samples": self.log.samples, "warnings": list(self.log.warnings)}
        return data


_STANDS = {
    "before": "for the interval before its time",
    "after": "for the interval after its time",
    "at": "for its time",
}


def contents(
    path: str | Path,
    *,
    rate: float | None = None,
    columns: Columns | None = None,
    topic: str = "",
    instance: int | None = None,
) -> Contents:
    """What is inside a log: topics, channels, rates, gaps.

    Parameters
    ----------
    path : path-like
        The file.
    rate : float, optional
        Sampling rate [Hz]; replaces the file's own time.
    columns : ColumnMap or str, optional
        Which column is which channel, and its unit.
    topic : str
        Topic or message of a flight log from which channels are read wherever it has them.
    instance : int, optional
        Which of several inertial sensors of a flight log.

    Returns
    -------
    Contents

    Raises
    ------
    InputError
        The file is missing, or of an unknown format, or broken, and it has no topics that could be listed.
    MissingExtra
        The library that reads the format is not installed.
    """
    choice = LogChoice(topic, instance)
    try:
        table, sha256 = read_table(Path(path), rate, choice)
        log = assemble(table, map_of(columns), rate, sha256)
    except InputError as error:
        found = recording_of(Path(path), choice)
        if found is None or not found.topics:
            raise
        return Contents(str(path), "", None, str(error), found.topics)
    return Contents(str(path), sha256, log, "", table.topics)


def _text(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else ""


def _sizes(channel: Channel) -> tuple[float, float, float, float]:
    """Mean, standard deviation, least and largest value in the unit of the channel; not numbers where there is none."""
    values = np.asarray(from_si(channel.values, channel.unit))
    values = values[np.isfinite(values)]
    if not values.size:
        return (float("nan"),) * 4
    return float(values.mean()), float(values.std()), float(values.min()), float(values.max())


def _facts(clock: Clock) -> dict[str, Any]:
    return {
        "samples": clock.n,
        "rate_hz": finite(clock.rate),
        "start_s": finite(clock.start),
        "end_s": finite(clock.end),
        "jitter_s": finite(clock.jitter),
        "gaps": clock.gaps,
        "longest_step_s": finite(clock.longest),
        "longest_step_at_s": finite(clock.longest_at),
        "repeated_stamps": clock.repeated,
        "stamps_back": clock.back,
    }
