"""The host: the machine's own C compiler, the filter as a shared library."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kfgen.core.errors import CheckFailed, MissingExtra
from kfgen.emit.geodetic.origin import Border
from kfgen.emit.routines import Program
from kfgen.verify.core import DRIVEN, InstructionCount, Words, place_of, width, write_harness

WARNINGS = (
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wfloat-equal",
    "-Werror",
)
FLAGS = ("-O2", "-fno-math-errno", *WARNINGS)


@dataclass(frozen=True)
class Language:
    """How the header is compiled on this machine."""

    title: str
    variable: str
    names: tuple[str, ...]
    flags: tuple[str, ...]
    zig: str


LANGUAGES = {
    "host": Language("this machine's C compiler", "CC", ("cc",), ("-std=c99", "-xc"), "cc"),
    "hostcpp": Language(
        "this machine's C++ compiler",
        "CXX",
        ("c++", "g++"),
        ("-std=c++11", "-xc++", "-Wold-style-cast"),
        "c++",
    ),
}


def compiler(language: Language = LANGUAGES["host"]) -> list[str]:
    """The compiler of this machine: as its variable says, else by its usual names, else zig's.

    Raises
    ------
    MissingExtra
        There is none.
    """
    for named in (os.environ.get(language.variable), *language.names):
        if named and shutil.which(named):
            return [named]
    from kfgen.verify.zig import command

    return command(language.zig)


def run(command: Sequence[str], what: str) -> None:
    """Run a compiler; raises `CheckFailed` with its message when it refuses.

    Parameters
    ----------
    command : sequence of str
        The compiler and its arguments.
    what : str
        What is compiled, for the message.
    """
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CheckFailed(f"{what} does not compile: {done.stderr.strip()[:2000]}")


TYPES: dict[str, tuple[type[Any], type[Any]]] = {
    "float": (ctypes.c_float, ctypes.c_uint32),
    "double": (ctypes.c_double, ctypes.c_uint64),
}
"""A number of a program and its bits, as ctypes has them."""


def contraction(contract: bool) -> str:
    """The compiler's word on products that are added without rounding in between."""
    return "-ffp-contract=fast" if contract else "-ffp-contract=off"


class Host:
    """The filter as a shared library of this process."""

    def __init__(
        self,
        program: Program | Border,
        source: Path,
        scratch: Path,
        language: Language = LANGUAGES["host"],
        contract: bool = False,
    ) -> None:
        harness = write_harness(program, scratch, bare=False)
        library = scratch / "filter.so"
        flags = [*language.flags, *FLAGS, contraction(contract), "-shared", "-fPIC", f"-I{source}"]
        run(
            [*compiler(language), *flags, str(harness), "-o", str(library), "-lm"],
            f"{program.name}.h on the host",
        )
        self._library = ctypes.CDLL(str(library))
        number, word = TYPES[program.real]
        self._inputs = (number * width(program)).in_dll(self._library, "in")
        self._words = (word * program.word_count).in_dll(self._library, DRIVEN)
        memory = sum(size for size, _ in program.arrays.values())
        self._memory = (number * memory).in_dll(self._library, DRIVEN)
        self._status = ctypes.c_int.in_dll(self._library, "last_status")
        self._program, self._type = program, np.dtype(word)

    def call(self, routine: str, inputs: Sequence[float]) -> None:
        """Run one routine on the filter."""
        self._inputs[: len(inputs)] = list(inputs)
        getattr(self._library, f"call_{routine}")()

    def put(self, array: str, values: Sequence[float]) -> None:
        """Write the first numbers of one of the filter's arrays."""
        at = place_of(self._program, array)
        self._memory[at : at + len(values)] = list(values)

    def status(self) -> int:
        """Number of the status that the last call returned."""
        return self._status.value

    def words(self) -> Words:
        """State and covariance as bit patterns."""
        return np.array(self._words, dtype=self._type)

    def cost(self) -> InstructionCount:
        """A host is not counted."""
        return InstructionCount()


def missing(extra: str, what: str) -> MissingExtra:
    """The error for an optional library that is not installed.

    Parameters
    ----------
    extra : str
        Of kfgen.
    what : str
        The library.
    """
    return MissingExtra(f"{what} is not installed", remedy=f"Install it with: pip install 'kfgen[{extra}]'")
