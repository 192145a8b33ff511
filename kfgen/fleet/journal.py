"""`Journal`: what the logs of a fleet said, on disk as soon as each is done; a run that was ended goes on from there.

A line of JSON for each log, under a key of everything that its answer depends on: the bytes of the log and of the
model, the options and the version. A line that was cut off by a kill is skipped.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import kfgen
from kfgen.core.files.destination import Destination
from kfgen.core.numbers import finite
from kfgen.fleet.answer import Estimated, FoundEffect, Frequencies, LogAnswer
from kfgen.fleet.result import Outcome
from kfgen.fleet.worker import LogTask

SUFFIX = ".unfinished"
"""Of a journal beside the output that it is for."""


@dataclass
class Journal:
    """Outcomes that are on disk.

    Parameters
    ----------
    path : Path
    known : dict of str to Outcome
        By their keys.
    """

    path: Path
    known: dict[str, Outcome] = field(default_factory=dict)
    _file: IO[str] | None = None

    @staticmethod
    def beside(*outputs: object) -> Journal | None:
        """The journal of a run that writes these outputs; None where none of them is a file."""
        named = [str(o) for o in outputs if o and str(o) != "-"]
        places = [p for p in map(Destination.of, named) if not p.stream]
        return Journal.read(places[0].path.with_name(places[0].path.name + SUFFIX)) if places else None

    @staticmethod
    def read(path: str | Path) -> Journal:
        """What an earlier run has left, if anything."""
        path, known = Path(path), {}
        for line in path.read_text("utf-8", "replace").splitlines() if path.is_file() else ():
            try:
                entry = json.loads(line)
                known[str(entry["key"])] = outcome_of(entry)
            except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
                continue
        return Journal(path, known)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        """Close it; it is removed when the command delivered its answer, a failed check included."""
        if self._file is not None:
            self._file.close()
        if error is None or hasattr(error, "exit_code"):
            self.path.unlink(missing_ok=True)

    def found(self, task: LogTask) -> Outcome | None:
        """What is known of a task."""
        return self.known.get(key_of(task))

    def add(self, task: LogTask, outcome: Outcome) -> None:
        """Write an outcome down; one that failed is tried again by the next run.

        Parameters
        ----------
        task : LogTask
        outcome : Outcome
        """
        key = key_of(task)
        if outcome.answer is None or not key:
            return
        if self._file is None:
            self._file = self.path.open("a", encoding="utf-8", errors="replace")
            self._file.write("\n")  # after a line that was cut off
        self._file.write(json.dumps({"key": key, **entry_of(outcome)}) + "\n")
        self._file.flush()


def key_of(task: LogTask) -> str:
    """Everything that the answer of a task depends on, as a hash; empty for a log in memory, or one that is gone."""
    if task.samples is not None:
        return ""
    digest = hashlib.sha256(
        json.dumps([kfgen.__version__, task.log, task.model, task.channels, task.rate, task.columns]).encode()
    )
    try:
        for name in (task.log, task.model):
            if name and Path(name).is_file():
                with Path(name).open("rb") as file:
                    digest.update(hashlib.file_digest(file, "sha256").digest())
    except OSError:
        return ""
    return digest.hexdigest()


def entry_of(outcome: Outcome) -> dict[str, Any]:
    """An outcome with an answer as JSON."""
    answer = outcome.answer
    assert answer is not None
    return {
        "log": outcome.log,
        "sha256": outcome.sha256,
        "warnings": list(outcome.warnings),
        "verdict": answer.verdict,
        "units": dict(answer.units),
        "frequencies": {k: [list(f.lines), f.corner] for k, f in answer.frequencies.items()},
        "effects": [
            {
                "channel": e.channel,
                "effect": e.effect,
                "parameters": {
                    n: [p.value, finite(p.lo), finite(p.hi), p.unit] for n, p in e.parameters.items()
                },
            }
            for e in answer.effects
        ],
    }


def outcome_of(entry: Mapping[str, Any]) -> Outcome:
    """The outcome of `entry_of`; raises what Python raises where it is none."""
    effects = [
        FoundEffect(str(e["channel"]), str(e["effect"]), {n: _number(*p) for n, p in e["parameters"].items()})
        for e in entry["effects"]
    ]
    units = {str(k): str(v) for k, v in entry["units"].items()}
    frequencies = {
        str(k): Frequencies(tuple(map(float, lines)), float(corner))
        for k, (lines, corner) in entry.get("frequencies", {}).items()
    }
    answer = LogAnswer(tuple(effects), units, str(entry["verdict"]), frequencies)
    return Outcome(str(entry["log"]), str(entry["sha256"]), answer, "", tuple(map(str, entry["warnings"])))


def _number(value: float, lo: float | None, hi: float | None, unit: str) -> Estimated:
    """A parameter; an end of its interval that is not known is not a number."""
    low, high = (float("nan") if v is None else float(v) for v in (lo, hi))
    return Estimated(float(value), low, high, str(unit))
