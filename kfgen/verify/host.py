"""The host: the machine's own C compiler, the filter as a shared library."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kfgen.emit.covariance import packed_size
from kfgen.emit.routines import Program
from kfgen.errors import CheckFailed, MissingExtra
from kfgen.verify.core import Cost, Words, width, write_harness

FLAGS = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wfloat-equal",
    "-Werror",
)


def compiler() -> list[str]:
    """The C compiler of this machine: ``CC``, else ``cc``, else zig from the package index.

    Raises
    ------
    MissingExtra
        There is none.
    """
    named = os.environ.get("CC") or "cc"
    if shutil.which(named):
        return [named]
    from kfgen.verify.zig import command

    return command()


def run(command: Sequence[str], what: str) -> None:
    """Run a compiler; raises `CheckFailed` with its words when it refuses."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CheckFailed(f"{what} does not compile: {done.stderr.strip()[:2000]}")


class Host:
    """The filter as a shared library of this process."""

    def __init__(self, program: Program, source: Path, scratch: Path) -> None:
        harness = write_harness(program, scratch, bare=False)
        library = scratch / "filter.so"
        run(
            [*compiler(), *FLAGS, "-shared", "-fPIC", f"-I{source}", str(harness), "-o", str(library), "-lm"],
            f"{program.name}.h on the host",
        )
        self._library = ctypes.CDLL(str(library))
        self._inputs = (ctypes.c_float * width(program)).in_dll(self._library, "in")
        count = len(program.discrete.nominal_names) + packed_size(program.n)
        self._words = (ctypes.c_uint32 * count).in_dll(self._library, "kf")

    def call(self, routine: str, inputs: Sequence[float]) -> None:
        """Run one routine on the filter."""
        self._inputs[: len(inputs)] = list(inputs)
        getattr(self._library, f"call_{routine}")()

    def words(self) -> Words:
        """State and covariance as bit patterns."""
        return np.array(self._words, dtype=np.uint32)

    def cost(self) -> Cost:
        """A host is not counted."""
        return Cost()


def missing(extra: str, what: str) -> MissingExtra:
    """The error for an optional library that is not installed."""
    return MissingExtra(f"{what} is not installed", remedy=f"Install it with: pip install 'kfgen[{extra}]'")
