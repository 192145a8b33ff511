"""`PageJobs`: commands that the page asked for, one at a time, each in a process of its own that can be stopped."""

from __future__ import annotations

import asyncio
import os
import re
import shlex
import shutil
import sys
from asyncio.subprocess import DEVNULL, PIPE
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from kfgen.core.terminal import printable
from kfgen.local_page.buttons import ButtonCommand
from kfgen.local_page.work_folder import WorkFolder

MOST_TEXT = 200_000
"""Letters of an answer that the page shows; all of it is in its files."""
READ_BLOCK_BYTES = 4096
END_TIMEOUT_S = 3.0
"""Seconds after which a command that does not end is killed."""
_LINE = re.compile(r"[\r\n]+(?:\x1b\[K)?")


@dataclass
class PageJob:
    """A command that runs, waits, or ran.

    Parameters
    ----------
    command : ButtonCommand
    place : Path
        The folder in which it runs.
    state : str
        ``waiting``, ``running``, ``done``, ``failed`` or ``stopped``.
    progress : str
        How long it has, and will.
    answer, said : str
        Standard output, and warnings and errors.
    files : list of str
        Keys of what it wrote.
    """

    command: ButtonCommand
    place: Path
    state: str = "waiting"
    progress: str = ""
    answer: str = ""
    said: str = ""
    files: list[str] = field(default_factory=list)
    task: asyncio.Task[None] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As the page shows it."""
        shown = ("state", "progress", "answer", "said", "files")
        typed = printable(shlex.join(["kfgen", *self.command.words]))
        return {"id": self.place.name, "command": typed, **{k: getattr(self, k) for k in shown}}


@dataclass
class PageJobs:
    """The jobs of a page.

    Parameters
    ----------
    folder : WorkFolder
    jobs : dict of str to PageJob
        By the names of their folders.
    """

    folder: WorkFolder
    jobs: dict[str, PageJob] = field(default_factory=dict)
    _turn: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(1))

    def start(self, command: ButtonCommand) -> PageJob:
        """Run a command when its turn comes."""
        job = PageJob(command, self.folder.next())
        self.jobs[job.place.name] = job
        job.task = asyncio.get_running_loop().create_task(self._run(job))
        return job

    async def stop(self, job: PageJob) -> None:
        """End a command; what it had not finished is not written."""
        if job.task is not None and not job.task.done():
            job.task.cancel()
            with suppress(asyncio.CancelledError):
                await job.task

    async def stop_all(self) -> None:
        """End every command."""
        for job in list(self.jobs.values()):
            await self.stop(job)

    async def _run(self, job: PageJob) -> None:
        try:
            async with self._turn:
                job.state = "running"
                status = await _process(job)
                await asyncio.to_thread(self._keep, job)
            job.state = "done" if status == 0 or job.files else "failed"
        except asyncio.CancelledError:
            job.state = "stopped"
            raise
        except OSError as error:
            job.state, job.said = "failed", f"{job.said}\nthe command cannot run: {error.strerror}"
        finally:
            job.progress = ""

    def _keep(self, job: PageJob) -> None:
        """Make what was written known to the page; a folder as an archive."""
        for name in job.command.writes:
            path = job.place / name
            if path.is_dir():
                path = Path(shutil.make_archive(str(path), "zip", path.parent, path.name))
            if path.is_file():
                job.files.append(self.folder.add(path).key)


async def _process(job: PageJob) -> int:
    """Run the command to its end; when cancelled, end it."""
    words = [sys.executable, "-P", "-m", "kfgen", *job.command.words]
    env = {**os.environ, "KFGEN_PROGRESS": "1"}
    process = await asyncio.create_subprocess_exec(
        *words, cwd=job.place, env=env, stdin=DEVNULL, stdout=PIPE, stderr=PIPE
    )
    try:
        await asyncio.gather(_hear_answer(job, process.stdout), _hear_progress(job, process.stderr))
        return await process.wait()
    finally:
        if process.returncode is None:
            with suppress(ProcessLookupError):
                process.terminate()
            try:
                await asyncio.wait_for(process.wait(), END_TIMEOUT_S)
            except TimeoutError:
                process.kill()
                await process.wait()


async def _hear_answer(job: PageJob, stream: asyncio.StreamReader | None) -> None:
    while stream is not None and (part := await stream.read(READ_BLOCK_BYTES)):
        if len(job.answer) < MOST_TEXT:
            job.answer += part.decode("utf-8", "replace")


async def _hear_progress(job: PageJob, stream: asyncio.StreamReader | None) -> None:
    """Lines that end are warnings and errors; the one that is written again and again is the progress."""
    left = ""
    while stream is not None and (part := await stream.read(READ_BLOCK_BYTES)):
        left += part.decode("utf-8", "replace")
        *whole, left = left.split("\n")
        for line in whole:
            words = _LINE.split(line)[-1].removeprefix("\x1b[K").strip()
            if words and len(job.said) < MOST_TEXT:
                job.said += words + "\n"
        job.progress = _LINE.split(left)[-1].removeprefix("\x1b[K").partition(": ")[2]
