"""The comparison: one scenario on the reference and on each core, every word."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from kfgen.emit.folder import Emitted
from kfgen.emit.routines import Program
from kfgen.emit.scenario import Call, scenario
from kfgen.errors import InputError
from kfgen.verify.core import Core, Verdict, Words
from kfgen.verify.emulated import CHIPS, Emulated
from kfgen.verify.host import Host
from kfgen.verify.python import compare_module


def cores() -> dict[str, str]:
    """The cores by name, with what they are."""
    return {"host": "this machine's C compiler", **{k: f"emulated {c.title}" for k, c in CHIPS.items()}}


def _maker(name: str) -> Callable[[Program, Path, Path], Core]:
    if name == "host":
        return Host
    if name in CHIPS:
        return lambda program, source, scratch: Emulated(CHIPS[name], program, source, scratch)
    raise InputError(f"there is no core '{name}'", where="--core", remedy=f"Known are {', '.join(cores())}")


def verify(emitted: Emitted, names: Sequence[str]) -> list[Verdict]:
    """Run the scenario on each core with the emitted files, and compare with the reference.

    Raises
    ------
    InputError
        An unknown core.
    CheckFailed
        The header does not compile.
    MissingExtra
        The emulator is not installed.
    """
    program = emitted.program
    makers = [(name, _maker(name)) for name in names]
    if emitted.target == "filterpy":
        if set(names) - {"host"}:
            raise InputError(
                "a Python module runs on the host only", where="--core", remedy="Leave --core out"
            )
        return [compare_module(program, emitted.folder)]
    calls = scenario(program)
    verdicts = []
    for name, make in makers:
        with tempfile.TemporaryDirectory(prefix="kfgen-verify-") as scratch:
            verdicts.append(_compare(name, make(program, emitted.folder, Path(scratch)), calls))
    return verdicts


def _compare(name: str, core: Core, calls: Sequence[Call]) -> Verdict:
    core.call("init", ())
    words = differing = ulp = 0
    for call in calls:
        core.call(call.routine, call.inputs)
        found, wanted = core.words(), call.words.view(np.uint32)
        wrong = found != wanted
        words += found.size
        if wrong.any():
            differing += int(wrong.sum())
            ulp = max(ulp, int(np.abs(_ordered(found[wrong]) - _ordered(wanted[wrong])).max()))
    return Verdict(name, words, differing, ulp, len(calls), core.cost())


def _ordered(words: Words) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Bit patterns of floats as integers in the order of the numbers."""
    signed = words.view(np.int32).astype(np.int64)
    return np.where(signed < 0, -(signed & 0x7FFFFFFF), signed)
