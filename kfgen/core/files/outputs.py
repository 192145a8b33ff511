"""What a command writes, against what it reads and against itself, before anything is computed."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from glob import glob
from itertools import combinations
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.core.files.destination import Destination
from kfgen.core.files.whole_file import all_or_none

WRITTEN = ("output", "out", "json", "report", "table")
"""Parameters of commands that say what is written."""
READ_BY_NAME = ("declaration", "model", "manoeuvre", "logs", "log", "noise", "folder", "at_rest", "proof")
"""Parameters that may be the name of a file that is read, or a pattern of names; older versions of typer give texts."""


@dataclass(frozen=True)
class GivenParameter:
    """A parameter of a command with its value.

    Parameters
    ----------
    name : str
        ``json``.
    option : str
        As the user writes it: ``--json``.
    value : object
        A path, a text, a sequence of these, or what is no name of a file.
    """

    name: str
    option: str
    value: object

    def outputs(self, command_has_target: bool) -> list[Output]:
        """What it asks to be written; ``-`` is the terminal, and the output of a target is a folder."""
        if self.name not in WRITTEN or not self.value or str(self.value) == "-":
            return []
        folder = self.name == "out" or (self.name == "output" and command_has_target)
        return [Output(self.option, Path(str(self.value)), folder, self.name == "out")]

    def inputs(self) -> Iterator[Path]:
        """The files and folders that it names."""
        if self.name in WRITTEN:
            return
        for word in self.value if isinstance(self.value, list | tuple) else (self.value,):
            if isinstance(word, Path):
                yield word
            elif isinstance(word, str) and self.name in READ_BY_NAME:
                yield from [Path(word)] if os.path.exists(word) else map(Path, glob(word, recursive=True))


@dataclass(frozen=True)
class Output:
    """What an option asks to be written.

    Parameters
    ----------
    option : str
        ``-o``, ``--json``.
    path : Path
    folder : bool
        Whether it is a folder and all that is in it.
    filled : bool
        Whether a folder that is there is kept and filled, and not replaced.
    """

    option: str
    path: Path
    folder: bool = False
    filled: bool = False

    def check(self) -> None:
        """Prove that it can be written; raises `InputError`."""
        if self.filled and self.path.is_dir():
            Destination.of(self.path / "report.html").check()
        else:
            Destination.of(self.path).check(self.folder)


def check_outputs(outputs: Sequence[Output], inputs: Iterable[Path]) -> None:
    """Prove that every output can be written, and that none takes an input or another output with it.

    Parameters
    ----------
    outputs : sequence of Output
    inputs : iterable of Path
        Files and folders that are read; those that do not exist are skipped.

    Raises
    ------
    InputError
        An output is an input, lies in a folder that is read, is a folder with an input in it, is another output or
        lies in its folder, or cannot be written.
    """
    read = [(source, Destination.of(source)) for source in inputs if os.path.exists(source)]
    for output in outputs:
        place = Destination.of(output.path)
        for source, given in read:
            if _meet(place, output.folder, given, source.is_dir()):
                raise InputError(
                    f"the output {output.option} would overwrite the input {source}",
                    where=str(output.path),
                    remedy=f"Give {output.option} another name",
                )
    for a, b in combinations(outputs, 2):
        if _meet(Destination.of(a.path), a.folder, Destination.of(b.path), b.folder):
            raise InputError(
                f"the outputs {a.option} and {b.option} would overwrite each other",
                where=str(b.path),
                remedy="Give each a name of its own",
            )
    for output in outputs:
        output.check()


def _meet(a: Destination, a_is_folder: bool, b: Destination, b_is_folder: bool) -> bool:
    """Whether two places are one, or one lies in the folder of the other; devices and pipes take any number."""
    if a.stream or b.stream:
        return False
    inside = (a_is_folder and b.path.is_relative_to(a.path)) or (
        b_is_folder and a.path.is_relative_to(b.path)
    )
    return inside or a.identity == b.identity


def outputs_together(given: Sequence[GivenParameter]) -> AbstractContextManager[None]:
    """Check the outputs of a command; those that it writes in the block appear together, or none does.

    Raises
    ------
    InputError
        As `check_outputs`.
    """
    has_target = any(p.name == "target" for p in given)
    outputs = [output for p in given for output in p.outputs(has_target)]
    check_outputs(outputs, [path for p in given for path in p.inputs()])
    return all_or_none(output.path for output in outputs)
