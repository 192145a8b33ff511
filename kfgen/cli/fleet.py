"""The command on many logs: fleet."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kfgen.cli.app import app
from kfgen.cli.options import Columns, Json, Rate, Report, deliver, hashes, not_over

if TYPE_CHECKING:
    from kfgen.fleet.fleet import Outcome

PATIENCE = 20
"""Seconds in which a scheduler must answer."""


@dataclass(frozen=True)
class Task:
    """One log and what is to be done with it; without a model it is identified."""

    log: str
    model: str = ""
    rate: float | None = None
    columns: str | None = None
    channels: str | None = None


@app.command()
def fleet(
    logs: Annotated[
        list[str],
        typer.Argument(metavar="GLOB...", help="Logs of sensors of one kind, one of each: 'logs/*.csv'."),
    ],
    model: Annotated[
        str | None,
        typer.Option(help="What is believed of every one: then as 'gap', else as 'identify'."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask cluster that sees the same paths.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=0, help="Processes on this machine; 0: one a processor.")] = 0,
    channels: Annotated[str | None, typer.Option(help="Only these, separated by commas.")] = None,
    rate: Rate = None,
    columns: Columns = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="NOISE.toml", help="The typical sensor, with where a new one lies."
        ),
    ] = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Many logs at once: what the sensors have in common, how much they differ, which is not like the others."""
    from kfgen.core.errors import InputError
    from kfgen.effects.noise_model import write_noise
    from kfgen.fleet.fleet import fleet_of
    from kfgen.report.fleet import fleet_answer, typical

    if output and model:
        raise InputError("a typical sensor is identified, and no model is given for that", where="--output")
    paths = _matching(logs)
    for path in paths:
        not_over(output, Path(path))
    if model:
        _check(model)
    tasks = [Task(path, model or "", rate, columns, channels) for path in paths]
    spread = _on_cluster(tasks, scheduler) if scheduler else _here(tasks, jobs)
    made = fleet_of(_counted(spread, len(tasks)))
    answer = fleet_answer(made, model or "", hashes([Path(model)]) if model and Path(model).is_file() else {})
    if output:
        write_noise(typical(made), output)
    deliver(answer, json, report)


def _matching(patterns: Sequence[str]) -> list[str]:
    """The files that match, each once, in order of their names."""
    from glob import glob

    from kfgen.core.errors import InputError

    found: dict[Path, str] = {}
    for pattern in patterns:
        paths = [pattern] if Path(pattern).is_file() else glob(pattern, recursive=True)
        files = sorted(p for p in paths if Path(p).is_file())
        if not files:
            raise InputError(
                "no file matches", where=pattern, remedy="Give a pattern such as 'logs/*.csv', in quotes"
            )
        for path in files:
            found.setdefault(Path(path).resolve(), path)
    return sorted(found.values())


def _check(model: str) -> None:
    """Read the model once, so that what is wrong with it is not said of every log."""
    from kfgen.gap.find_gap import assumed_model

    assumed_model(model)


def work(task: Task) -> Outcome:
    """Do one log; whatever is wrong with it is told and not raised, for the others go on."""
    from kfgen.core.errors import KfgenError
    from kfgen.fleet.fleet import Outcome

    try:
        data, warnings = _gap(task) if task.model else _identify(task)
    except (KfgenError, OSError, MemoryError) as error:
        return Outcome(task.log, error=str(error) or type(error).__name__)
    except Exception as error:  # a defect met in one log must not cost the answers of a night
        return Outcome(task.log, error=f"{type(error).__name__}: {error}. This is a defect of kfgen")
    return Outcome(task.log, str(data["sha256"]), data, "", warnings)


def _identify(task: Task) -> tuple[dict[str, Any], tuple[str, ...]]:
    from kfgen.cli.logs import channels_identified
    from kfgen.log.readers import ColumnMap, read_long
    from kfgen.report.identify import identify_data

    log = read_long(
        Path(task.log), rate=task.rate, columns=ColumnMap.parse(task.columns) if task.columns else None
    )
    found = channels_identified([log], task.channels, None, "allan" if log.axis == "tau" else "ml")
    warnings = [*log.warnings, *(f"{name}: {w}" for name, one in found.items() for w in one.warnings)]
    return identify_data([log], found), tuple(warnings)


def _gap(task: Task) -> tuple[dict[str, Any], tuple[str, ...]]:
    from kfgen.cli.options import read
    from kfgen.gap.find_gap import find_gap

    log = read(Path(task.log), task.rate, task.columns)
    found = find_gap(log, task.model, channels=task.channels)
    return found.to_dict(), found.warnings


def _here(tasks: Sequence[Task], jobs: int) -> Iterator[Outcome]:
    """On this machine, in processes of their own."""
    import os
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from multiprocessing import get_context

    jobs = min(jobs or os.cpu_count() or 1, len(tasks))
    if jobs == 1:
        yield from map(work, tasks)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(work, task): task for task in tasks}
        for future in as_completed(waiting):
            yield _told(waiting[future], future.exception(), future.result)


def _on_cluster(tasks: Sequence[Task], address: str) -> Iterator[Outcome]:
    """On a Dask cluster: its workers need kfgen, and the same paths."""
    import socket
    from dataclasses import replace

    from kfgen.core.errors import InputError
    from kfgen.verify.host import missing

    try:
        from distributed import Client, as_completed
        from distributed.comm import get_address_host_port
    except ImportError:
        raise missing("fleet", "distributed, the library of Dask clusters,") from None
    try:  # a client that finds nobody complains once more at its end
        socket.create_connection(get_address_host_port(address), PATIENCE).close()
        client = Client(address, timeout=PATIENCE, set_as_default=False)
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
            outcome = _told(there[far], future.exception(), future.result)
            yield replace(outcome, log=there[far].log, error=outcome.error.replace(far, there[far].log))


def _absolute(name: str) -> str:
    """A file's whole path, for the cluster works in another folder; what is no file stays."""
    return str(Path(name).absolute()) if name and Path(name).is_file() else name


def _told(task: Task, error: BaseException | None, result: Callable[[], Outcome]) -> Outcome:
    """The outcome, also of a process that died."""
    from kfgen.fleet.fleet import Outcome

    if error is None:
        return result()
    return Outcome(task.log, error=f"its process ended ({type(error).__name__}: {error})")


def _counted(outcomes: Iterator[Outcome], total: int) -> list[Outcome]:
    """All outcomes, with a count on a terminal."""
    done = []
    for outcome in outcomes:
        done.append(outcome)
        if sys.stderr.isatty():
            end = "\n" if len(done) == total else ""
            print(f"\r{len(done)} of {total} logs", end=end, file=sys.stderr, flush=True)
    return done
