"""Tasks spread over processes of this machine, or over a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.fleet.crew import crew_of
from kfgen.fleet.result import Outcome
from kfgen.fleet.worker import LogTask, work
from kfgen.verify.host import missing

SCHEDULER_TIMEOUT_S = 20
"""Seconds in which a scheduler must answer."""


def on_this_machine(tasks: Sequence[LogTask], jobs: int) -> Iterator[Outcome]:
    """Outcomes as they come, from processes of their own.

    Parameters
    ----------
    tasks : sequence of LogTask
    jobs : int
        Processes; 0 for one a processor, 1 for none but this one.
    """
    jobs = min(jobs or os.cpu_count() or 1, len(tasks))
    if jobs <= 1:
        yield from map(work, tasks)
        return
    yield from crew_of(tasks).outcomes(jobs)


def on_cluster(tasks: Sequence[LogTask], address: str) -> Iterator[Outcome]:
    """Outcomes as they come, from a Dask cluster: its workers need kfgen, and the same paths.

    Parameters
    ----------
    tasks : sequence of LogTask
    address : str
        Of the scheduler, ``tcp://host:8786``.

    Raises
    ------
    MissingExtra
        The library of Dask clusters is not installed.
    InputError
        No scheduler answers.
    """
    import socket

    try:
        from distributed import Client, as_completed
        from distributed.comm import get_address_host_port
    except ImportError:
        raise missing("fleet", "distributed, the library of Dask clusters,") from None
    try:  # a client that finds nobody complains once more at its end
        socket.create_connection(get_address_host_port(address), SCHEDULER_TIMEOUT_S).close()
        client = Client(address, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no scheduler answers: {error}", where=address, remedy="Give one as tcp://host:8786"
        ) from None
    with client:
        there = {_absolute(t.log): t for t in tasks}
        waiting = {
            client.submit(work, replace(t, log=log, model=_absolute(t.model)), pure=False): log
            for log, t in there.items()
        }
        for future in as_completed(list(waiting), loop=client.loop):
            far = waiting[future]
            outcome = _outcome(there[far], future.exception(), future.result)
            yield replace(outcome, log=there[far].log, error=outcome.error.replace(far, there[far].log))


def _absolute(name: str) -> str:
    """A file's whole path, for the cluster works in another folder; what is no file stays."""
    return str(Path(name).absolute()) if name and Path(name).is_file() else name


def _outcome(task: LogTask, error: BaseException | None, result: Callable[[], Outcome]) -> Outcome:
    """The outcome, also of a process that died."""
    if error is None:
        return result()
    return Outcome(task.log, error=f"its process ended ({type(error).__name__}: {error})")
