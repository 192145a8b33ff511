"""The comparison: one scenario on the reference and on each core, every word."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from kfgen.core.errors import InputError
from kfgen.emit.folder import Emitted
from kfgen.emit.routines import Program
from kfgen.emit.scenario import REFUSED, scenario
from kfgen.emit.targets.c import header
from kfgen.verify.core import Core, CoreVerdict, Words
from kfgen.verify.emulated import CHIPS, Emulated
from kfgen.verify.host import LANGUAGES, Host
from kfgen.verify.python import MODULES, deviations_off
from kfgen.verify.replay import Replay, simulated


def cores() -> dict[str, str]:
    """The cores by name, with what they are."""
    hosts = {k: language.title for k, language in LANGUAGES.items()}
    return {**hosts, **{k: f"emulated {c.title}" for k, c in CHIPS.items()}}


def _maker(name: str, contract: bool) -> Callable[[Program, Path, Path], Core]:
    if name in LANGUAGES:
        return lambda program, source, scratch: Host(program, source, scratch, LANGUAGES[name], contract)
    if name in CHIPS:
        return lambda program, source, scratch: Emulated(CHIPS[name], program, source, scratch, contract)
    raise InputError(f"there is no core '{name}'", where="--core", remedy=f"Known are {', '.join(cores())}")


def verify(
    emitted: Emitted, names: Sequence[str], contract: bool = False, played: Replay | None = None
) -> list[CoreVerdict]:
    """Make the same calls on each core with the emitted files, and compare with the reference.

    Parameters
    ----------
    played : Replay, optional
        The calls, as `kfgen.verify.replay.replay` has them from a log; a simulated scenario where left out.
    contract : bool
        Compile with fused products and sums; then words may differ by `CONTRACTED` of a deviation.

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
    makers = [(name, _maker(name, contract)) for name in names]
    if emitted.target in MODULES:
        if set(names) - {"host"}:
            raise InputError(
                "a Python module runs on the host only", where="--core", remedy="Leave --core out"
            )
        return [MODULES[emitted.target](program, emitted.folder, played or simulated(program))]
    played = played or simulated(program)
    verdicts = []
    for name, make in makers:
        with tempfile.TemporaryDirectory(prefix="kfgen-verify-") as scratch:
            core = make(program, emitted.folder, Path(scratch))
            compare = _compare_contracted if contract else _compare
            verdicts.append(compare(name, core, played, program))
    return verdicts


def costs(program: Program, names: Sequence[str]) -> tuple[str, ...]:
    """What each routine of the emitted C costs on emulated cores, in words.

    Raises
    ------
    InputError
        A core that is unknown, or does not count.
    """
    said = []
    for name in names:
        if name not in CHIPS:
            raise InputError(
                f"the core '{name}' counts nothing", where="--core", remedy=f"Known are {', '.join(CHIPS)}"
            )
        with tempfile.TemporaryDirectory(prefix="kfgen-costs-") as scratch:
            folder = Path(scratch)
            (folder / f"{program.name}.h").write_text(header(program), encoding="utf-8")
            core = Emulated(CHIPS[name], program, folder, folder)
            core.call("init", ())
            most = COUNTED_CALLS + (program.settling + len(REFUSED)) * len(program.routines)
            for call in scenario(program, most):
                core.call(call.routine, call.inputs)
            cost = core.cost()
        said += [
            f"{CHIPS[name].title}, {routine}: {count} instructions, {cost.stacks[routine]} bytes of stack, "
            f"{cost.texts[routine]} of code"
            for routine, count in cost.instructions.items()
        ]
    return tuple(said)


COUNTED_CALLS = 25
"""Calls of which each routine has its share."""

CONTRACTED = 1e-3
"""With fused products and sums: share of a deviation by which a word may differ."""


def _begin(core: Core, played: Replay) -> None:
    core.call("init", ())
    for array, values in played.start.items():
        core.put(array, values)


def _compare_contracted(name: str, core: Core, played: Replay, program: Program) -> CoreVerdict:
    """Words on either side as state and covariance, against the reference's own deviations."""
    _begin(core, played)
    words = differing = 0
    for call in played.calls:
        core.call(call.routine, call.inputs)
        found, wanted = core.words().view(program.type), call.words
        off = deviations_off(program, found, wanted)
        words += off.size
        differing += int((~(off <= CONTRACTED)).sum())
    return CoreVerdict(name, words, differing, 0, len(played.calls), core.cost(), CONTRACTED)


def _compare(name: str, core: Core, played: Replay, program: Program) -> CoreVerdict:
    _begin(core, played)
    words = differing = ulp = 0
    for call in played.calls:
        core.call(call.routine, call.inputs)
        found, wanted = core.words(), call.words.view(f"u{call.words.dtype.itemsize}")
        wrong = found != wanted
        words += found.size
        if wrong.any():
            differing += int(wrong.sum())
            ulp = max(ulp, int(np.abs(_ordered(found[wrong]) - _ordered(wanted[wrong])).max()))
    return CoreVerdict(name, words, differing, ulp, len(played.calls), core.cost())


def _ordered(words: Words) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Bit patterns of floats as integers in the order of the numbers."""
    size = words.dtype.itemsize
    signed = words.view(f"i{size}").astype(np.int64)
    return np.where(signed < 0, -(signed & (2 ** (8 * size - 1) - 1)), signed)
