"""`work`: one log of a fleet, identified or compared with a model, whatever is wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from kfgen.core.errors import KfgenError
from kfgen.fleet.answer import LogAnswer, answer_of_gap, answer_of_identification
from kfgen.fleet.result import Outcome
from kfgen.identify.identify_log import identify
from kfgen.log.log import Log
from kfgen.log.readers import ColumnMap, read_long


@dataclass(frozen=True)
class LogTask:
    """One log and what is to be done with it; it can be sent to another process.

    Parameters
    ----------
    log : str
        Path of the log, or the source of `samples`.
    model : str
        With what it is compared: a file or a library model; empty where it is identified.
    channels : str or None
        Only these, separated by commas.
    rate : float or None
        Sampling rate [Hz] that replaces the log's own time.
    columns : str or None
        Foreign columns as channels, see `kfgen.log.readers.ColumnMap`.
    samples : mapping, optional
        The fields of a `Log` that is in memory.
    """

    log: str
    model: str = ""
    channels: str | None = None
    rate: float | None = None
    columns: str | None = None
    samples: Mapping[str, Any] | None = None

    @staticmethod
    def of(log: str | Path | Log, **options: Any) -> LogTask:
        """The task of a log; `options` are the other fields."""
        if isinstance(log, Log):
            samples = {f.name: getattr(log, f.name) for f in fields(Log)}
            samples["channels"] = dict(log.channels)
            return LogTask(log.source, samples=samples, **options)
        return LogTask(str(log), **options)

    def read(self, reader: Callable[..., Any]) -> Any:
        """The log, by a reader such as `read_long`."""
        if self.samples is not None:
            return Log(**self.samples)
        columns = ColumnMap.parse(self.columns) if self.columns else None
        return reader(Path(self.log), rate=self.rate, columns=columns)


def work(task: LogTask) -> Outcome:
    """Do one log; whatever is wrong with it is said and not raised, for the others go on."""
    try:
        sha256, answer, warnings = _compared(task) if task.model else _identified(task)
    except (KfgenError, OSError, MemoryError) as error:
        return Outcome(task.log, error=str(error) or type(error).__name__)
    except Exception as error:  # a defect met in one log must not cost the answers of a night
        return Outcome(task.log, error=f"{type(error).__name__}: {error}. This is a defect of kfgen")
    return Outcome(task.log, sha256, answer, "", warnings)


def _identified(task: LogTask) -> tuple[str, LogAnswer, tuple[str, ...]]:
    found = identify(task.read(read_long), channels=task.channels)
    return found.logs[0][1], answer_of_identification(found), found.warnings


def _compared(task: LogTask) -> tuple[str, LogAnswer, tuple[str, ...]]:
    from kfgen.gap.find_gap import find_gap

    log = task.read(read_long)
    found = find_gap(log, task.model, channels=task.channels)
    return log.sha256, answer_of_gap(found.to_dict()), found.warnings
