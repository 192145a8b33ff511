"""`fleet`: many logs of sensors of one kind, identified or compared with a model, and pooled."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from glob import glob
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.effects.noise_model import read_noise
from kfgen.fleet.journal import Journal
from kfgen.fleet.pooling import pooled
from kfgen.fleet.result import FleetResult
from kfgen.fleet.spread import on_cluster, on_this_machine
from kfgen.fleet.worker import LogTask
from kfgen.log.log import Log
from kfgen.log.readers.known import is_log
from kfgen.model.library import build
from kfgen.model.plant.user import FORMAT, read_model


def fleet(
    logs: str | Path | Sequence[str | Path | Log],
    model: str | Path | None = None,
    *,
    jobs: int = 0,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    journal: Journal | None = None,
    **options: object,
) -> FleetResult:
    """What sensors of one kind have in common, how much they differ, and which is not like the others.

    Parameters
    ----------
    logs : path, pattern such as ``logs/*.csv``, or a sequence of these and of logs in memory
        One log of each sensor.
    model : str or path, optional
        What is assumed of every sensor: a file or a library model. They are then compared with it, else identified.
    jobs : int
        Processes on this machine; 0 for one a processor.
    scheduler : str, optional
        Address of a Dask cluster that sees the same paths.
    progress : callable, optional
        Called with the number of logs done and of all, after each.
    journal : Journal, optional
        What is known already, and takes every log that is done; see `kfgen.fleet.journal.Journal`.
    **options
        ``channels``, ``rate`` and ``columns`` of `kfgen.fleet.worker.LogTask`.

    Returns
    -------
    FleetResult

    Raises
    ------
    InputError
        No file matches, the model cannot be read, no scheduler answers, or no log can be used.
    """
    given = [logs] if isinstance(logs, (str, Path)) else logs
    everything: list[str | Log] = [*matching([log for log in given if not isinstance(log, Log)])]
    everything += [log for log in given if isinstance(log, Log)]
    name = str(model or "")
    if name:
        _check(name)
    tasks = [LogTask.of(log, model=name, **options) for log in everything]
    known = [journal.found(t) if journal else None for t in tasks]
    left = [t for t, found in zip(tasks, known) if found is None]
    of_log = {t.log: t for t in left}
    outcomes = [found for found in known if found is not None]
    for outcome in on_cluster(left, scheduler) if scheduler else on_this_machine(left, jobs):
        outcomes.append(outcome)
        if journal:
            journal.add(of_log[outcome.log], outcome)
        if progress:
            progress(len(outcomes), len(tasks))
    sha256 = hashlib.sha256(Path(name).read_bytes()).hexdigest() if name and Path(name).is_file() else ""
    return replace(pooled(outcomes), model=name, model_sha256=sha256)


def matching(patterns: Sequence[str | Path]) -> list[str]:
    """The files that match paths or patterns, each once, in order of their names.

    Raises
    ------
    InputError
        No file matches one of them.
    """
    found: dict[Path, str] = {}
    for pattern in map(str, patterns):
        paths = [pattern] if is_log(Path(pattern)) else glob(pattern, recursive=True)
        files = sorted(p for p in paths if is_log(Path(p)))
        if not files:
            raise InputError(
                "no file matches", where=pattern, remedy="Give a pattern such as 'logs/*.csv', in quotes"
            )
        for path in files:
            found.setdefault(Path(path).resolve(), path)
    return sorted(found.values())


def _check(model: str) -> None:
    """Read the model once, so that what is wrong with it is not said of every log."""
    if not model.endswith(".toml"):
        build(model)
    elif _format(model) == FORMAT:
        read_model(model)
    else:
        read_noise(model)


def _format(path: str) -> object:
    """What a file says that it is; None where it cannot be read, which its reader says."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8")).get("format")
    except (ValueError, RecursionError, OSError):
        return None
