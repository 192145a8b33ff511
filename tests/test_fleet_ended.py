"""Proves that a fleet that is ended loses nothing: a process that dies is named and its log tried once more, Ctrl-C and
SIGTERM end every process at once, and the next run goes on from what is on disk.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from kfgen.fleet import spread
from kfgen.fleet.crew import crew_of
from kfgen.fleet.fleet import fleet
from kfgen.fleet.journal import Journal, entry_of, key_of, outcome_of
from kfgen.fleet.result import Outcome
from kfgen.fleet.worker import LogTask, work

Cli = Callable[..., Result]


def write(path: Path, seed: int, n: int = 1500) -> Path:
    y = 0.05 * np.random.default_rng(seed).standard_normal(n)
    rows = np.column_stack([np.arange(n) / 100.0, y])
    np.savetxt(path, rows, delimiter=",", header="t [s],gyro_x [deg/s]", comments="", fmt="%.9g")
    return path


class Deadly(LogTask):
    """A task that kills the process that takes it."""

    def __reduce__(self) -> tuple[object, ...]:
        return signal.raise_signal, (signal.SIGKILL,)


def task_unless_new(mark: str, log: str) -> LogTask:
    if not Path(mark).exists():
        Path(mark).touch()
        os._exit(3)
    return LogTask(log)


class DeadlyOnce(LogTask):
    """A task that kills the first process that takes it."""

    def __reduce__(self) -> tuple[object, ...]:
        return task_unless_new, (f"{self.log}.mark", self.log)


@pytest.mark.long
def test_a_dead_process_costs_its_own_log_only_and_names_it(tmp_path: Path) -> None:
    logs = [str(write(tmp_path / f"{k}.csv", k)) for k in range(3)]
    tasks = [LogTask(logs[0]), Deadly("deadly.csv"), DeadlyOnce(logs[1]), LogTask(logs[2])]
    outcomes = {o.log: o for o in crew_of(tasks).outcomes(2)}
    assert set(outcomes) == {*logs, "deadly.csv"}
    assert all(outcomes[log].answer for log in logs)
    assert outcomes["deadly.csv"].error.startswith("the process that read it died 2 times (SIGKILL")
    assert Path(f"{logs[1]}.mark").exists()


def test_the_processes_end_when_the_caller_stops(tmp_path: Path) -> None:
    crew = crew_of([LogTask(str(write(tmp_path / f"{k}.csv", k))) for k in range(4)])
    outcomes = crew.outcomes(2)
    next(outcomes)
    members = list(crew.members)
    outcomes.close()
    assert [m.process.is_alive() for m in members] == [False, False]


def test_an_outcome_comes_back_from_the_journal(tmp_path: Path) -> None:
    task = LogTask(str(write(tmp_path / "a.csv", 1)))
    outcome = work(task)
    assert outcome.answer
    again = outcome_of(json.loads(json.dumps(entry_of(outcome))))
    assert str(again) == str(outcome)  # not a number is not equal to itself


@pytest.mark.long
def test_a_run_goes_on_from_the_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(4):
        write(tmp_path / f"{k}.csv", k)
    plain = fleet(tmp_path / "*.csv", jobs=1).to_dict()
    done: list[str] = []

    def worked(task: LogTask) -> Outcome:
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(task.log)
        return work(task)

    monkeypatch.setattr(spread, "work", worked)
    path = tmp_path / "f.unfinished"
    with pytest.raises(KeyboardInterrupt), Journal.read(path) as journal:
        fleet(tmp_path / "*.csv", jobs=1, journal=journal)
    assert len(done) == 2
    with path.open("a") as file:
        file.write('{"key": "cut off')
    write(tmp_path / "0.csv", 99)  # changed since: done anew
    done = []
    with Journal.read(path) as journal:
        monkeypatch.setattr(spread, "work", lambda task: done.append(Path(task.log).name) or work(task))
        found = fleet(tmp_path / "*.csv", jobs=1, journal=journal).to_dict()
    assert done == ["0.csv", "2.csv", "3.csv"]
    assert found["logs"][0]["sha256"] == hashlib.sha256((tmp_path / "0.csv").read_bytes()).hexdigest()
    assert found["logs"][1:] == plain["logs"][1:]
    assert not path.exists()


@pytest.mark.parametrize(
    "line", ["", "{", "[]", "null", '{"key": 1}', '{"key": "k", "effects": 3}', "[" * 9000]
)
def test_a_garbled_journal_is_skipped(line: str, tmp_path: Path) -> None:
    (tmp_path / "j").write_text(line + "\n", encoding="utf-8")
    assert Journal.read(tmp_path / "j").known == {}


def test_the_key_is_of_everything_that_matters(tmp_path: Path) -> None:
    log = str(write(tmp_path / "a.csv", 1))
    keys = [key_of(LogTask(log, **how)) for how in ({}, {"rate": 2.0}, {"channels": "a"}, {"model": "ahrs6"})]
    write(tmp_path / "a.csv", 2)
    assert len({*keys, key_of(LogTask(log))}) == 5


def test_a_failed_check_leaves_no_journal(kfgen: Cli, tmp_path: Path) -> None:
    write(tmp_path / "a.csv", 1)
    (tmp_path / "b.csv").write_text("rubbish\n")
    done = kfgen("fleet", tmp_path / "*.csv", "--jobs", 1, "--json", tmp_path / "f.json")
    assert done.exit_code == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "b.csv", "f.json"]


def children(pid: int) -> list[int]:
    """The processes that a process has started."""
    found = []
    for p in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = p.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z":
            found.append(int(p.parent.name))
    return found


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")
@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.long),
        pytest.param(signal.SIGKILL, marks=pytest.mark.long),
    ],
)
def test_a_signal_ends_a_fleet_at_once_and_nothing_is_lost(number: signal.Signals, tmp_path: Path) -> None:
    for k in range(60):
        write(tmp_path / f"{k}.csv", k)
    journal = tmp_path / "f.json.unfinished"
    words = ["fleet", str(tmp_path / "*.csv"), "--jobs", "2", "--json", str(tmp_path / "f.json")]
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "  # in a shell's background too
    run = subprocess.Popen(
        [sys.executable, "-c", f"{heard}from kfgen.cli import main; main()", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while not (journal.is_file() and '"key"' in journal.read_text("utf-8")) and time.monotonic() < deadline:
        time.sleep(0.05)
    workers = children(run.pid)
    assert len(workers) >= 2
    run.send_signal(number)
    said = run.communicate(timeout=20)[1]
    assert run.returncode == {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}[number]
    assert "Traceback" not in said
    while any(Path(f"/proc/{w}").exists() for w in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert [w for w in workers if Path(f"/proc/{w}").exists()] == []
    assert not (tmp_path / "f.json").exists()
    assert 1 <= len(Journal.read(journal).known) < 60
