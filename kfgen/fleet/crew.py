"""`Crew`: processes that each do one log at a time; one that dies names its log, which is tried once more."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

from kfgen.fleet.result import Outcome
from kfgen.fleet.worker import LogTask, work

MAX_TRIALS = 2
"""Times that a log is begun whose process dies."""
END_TIMEOUT_S = 2.0
"""Seconds after which a process that does not end is killed."""


@dataclass
class Member:
    """A process with what it does.

    Parameters
    ----------
    process : multiprocessing process
    pipe : Connection
        Takes a `LogTask`, gives its `Outcome`.
    task : LogTask or None
        What it does now.
    """

    process: SpawnProcess
    pipe: Connection
    task: LogTask | None = None

    @staticmethod
    def start() -> Member:
        """A new process that waits for a task."""
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        return Member(process, ours)

    def end(self) -> None:
        """End the process, whatever it does."""
        self.pipe.close()
        self.process.terminate()
        self.process.join(END_TIMEOUT_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


@dataclass
class Crew:
    """Processes, the tasks that wait for them, and how often each was begun."""

    waiting: deque[LogTask]
    members: list[Member] = field(default_factory=list)
    begun: dict[int, int] = field(default_factory=dict)

    def outcomes(self, jobs: int) -> Iterator[Outcome]:
        """Outcomes as they come; when the caller stops, by an error or by Ctrl-C, every process ends.

        Parameters
        ----------
        jobs : int
            Processes.
        """
        try:
            self.members = [Member.start() for _ in range(min(jobs, len(self.waiting)))]
            for member in self.members:
                self._next(member)
            while busy := {m.pipe: m for m in self.members if m.task is not None}:
                for pipe in wait(list(busy)):
                    yield from self._heard(busy[pipe])  # type: ignore[index]
        finally:
            for member in self.members:
                member.end()

    def _heard(self, member: Member) -> Iterator[Outcome]:
        """What a process says; one that is dead is replaced, and its log tried once more."""
        task = member.task
        assert task is not None
        try:
            outcome: Outcome = member.pipe.recv()
        except (EOFError, OSError):
            member.end()
            fresh = Member.start()
            self.members[self.members.index(member)] = fresh
            if self.begun[id(task)] < MAX_TRIALS:
                self.waiting.append(task)
            else:
                yield Outcome(task.log, error=_death(member.process.exitcode))
            self._next(fresh)
            return
        self._next(member)
        yield outcome

    def _next(self, member: Member) -> None:
        """Give a process the next task, if there is one."""
        member.task = self.waiting.popleft() if self.waiting else None
        if member.task is not None:
            self.begun[id(member.task)] = self.begun.get(id(member.task), 0) + 1
            with suppress(OSError):  # of a process that is dead, which is heard next
                member.pipe.send(member.task)


def crew_of(tasks: Sequence[LogTask]) -> Crew:
    """A crew for these tasks, each a value of its own."""
    return Crew(deque(replace(t) for t in tasks))


def serve(pipe: Connection) -> None:
    """Do the tasks that come through a pipe until it is closed, or until the process that sends them is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that sends them
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            pipe.send(work(pipe.recv()))
        except (EOFError, OSError):
            return


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _death(exitcode: int | None) -> str:
    """How a process ended, in words."""
    number = -(exitcode or 0)
    name = signal.Signals(number).name if number in {int(s) for s in signal.Signals} else f"status {exitcode}"
    why = ", mostly for want of memory" if name == "SIGKILL" else ""
    return (
        f"the process that read it died {MAX_TRIALS} times ({name}{why}). Cut the log, or give fewer --jobs"
    )
