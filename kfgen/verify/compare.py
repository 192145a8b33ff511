"""The comparison: one scenario on the reference and on each core, every word."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import kfgen
from kfgen.core.elapsed import counted
from kfgen.core.errors import InputError
from kfgen.core.result import Result, ShortTable
from kfgen.emit.folder import EmittedFilter, read_folder
from kfgen.emit.geodetic.origin import Border
from kfgen.emit.routines import Program
from kfgen.emit.scenario import REFUSED, at_rest, scenario
from kfgen.emit.targets.c import TARGET, header, horizon_bytes, memory_bytes
from kfgen.log.readers import LogOrPath, log_of
from kfgen.model.option import NOTHING
from kfgen.verify.border import border_module, border_replay, together
from kfgen.verify.core import Core, CoreVerdict, Words
from kfgen.verify.emulated import CHIPS, Emulated
from kfgen.verify.host import LANGUAGES, Host
from kfgen.verify.load import calls_a_second, instructions_a_second, load_sentence
from kfgen.verify.python import MODULES, deviations_off
from kfgen.verify.replay import Replay, simulated
from kfgen.verify.rounding import OnLog, over_log


def cores() -> dict[str, str]:
    """The cores by name, with what they are."""
    hosts = {k: language.title for k, language in LANGUAGES.items()}
    return {**hosts, **{k: f"emulated {c.title}" for k, c in CHIPS.items()}}


CoreMaker = Callable[[Program | Border, Path, Path], Core]
"""What makes a core, for a program, the folder of its header and one for scratch files."""


def maker_of(name: str, contract: bool) -> CoreMaker:
    """What makes a core of that name, for a program, the folder of its header and one for scratch files.

    Parameters
    ----------
    name : str
        See `cores`.
    contract : bool
        Fused products and sums.

    Raises
    ------
    InputError
        There is no such core.
    """
    if name in LANGUAGES:
        return lambda program, source, scratch: Host(program, source, scratch, LANGUAGES[name], contract)
    if name in CHIPS:
        return lambda program, source, scratch: Emulated(CHIPS[name], program, source, scratch, contract)
    raise InputError(f"there is no core '{name}'", where="--core", remedy=f"Known are {', '.join(cores())}")


@dataclass(frozen=True, repr=False)
class Verification(Result):
    """Emitted code beside its reference, a verdict for each core.

    Parameters
    ----------
    model_hash : str
        SHA-256 of the filter's equations and numbers.
    verdicts : tuple of CoreVerdict
    on_log : OnLog, optional
        What a log adds, where the calls are those of a log.
    ram_bytes, horizon_bytes : int
        What a filter in C takes, and what of it the delayed horizon takes.
    calls : dict of str to float
        How often each routine is called in a second of the whole filter.
    """

    model_hash: str
    verdicts: tuple[CoreVerdict, ...]
    on_log: OnLog | None = None
    ram_bytes: int = 0
    horizon_bytes: int = 0
    calls: dict[str, float] = field(default_factory=dict)

    def __iter__(self) -> Iterator[CoreVerdict]:
        return iter(self.verdicts)

    def __getitem__(self, k: int) -> CoreVerdict:
        return self.verdicts[k]

    @property
    def ok(self) -> bool:
        """Whether nothing differs."""
        return not any(v.differing for v in self.verdicts)

    def summary(self) -> list[str]:
        """What was compared, and what differs."""
        wrong = [v for v in self.verdicts if v.differing]
        if wrong:
            return [
                f"{v.differing} of {v.words} values differ on {v.core} (by up to {v.max_ulp} ulp)"
                for v in wrong
            ]
        exact = [v for v in self.verdicts if not v.tolerance]
        said = [
            f"{v.core} agrees with the reference within {v.tolerance:g} standard deviations: "
            f"all {v.words} values"
            for v in self.verdicts
            if v.tolerance
        ]
        if exact:
            where, words = " and ".join(v.core for v in exact), sum(v.words for v in exact)
            said.insert(0, f"Bit-exact on {where}: all {words} values equal the reference")
        own = f", {self.horizon_bytes} of them for the delayed horizon" if self.horizon_bytes else ""
        said += [s for v in self.verdicts if (s := load_sentence(v, self.calls))]
        return [*said, *([f"a filter takes {self.ram_bytes} bytes of RAM{own}"] if self.ram_bytes else [])]

    def short_table(self) -> ShortTable:
        """A row for each core."""
        return VERDICT_HEAD, [v.row for v in self.verdicts]

    def to_dict(self) -> dict[str, Any]:
        """The counts of each core, and what a log adds."""
        data: dict[str, Any] = {
            "format": "kfgen-verify-1",
            "kfgen": kfgen.__version__,
            "model_hash": self.model_hash,
            "cores": {v.core: v.to_dict() for v in self.verdicts},
        }
        if self.ram_bytes:
            data |= {"ram_bytes": self.ram_bytes, "horizon_ram_bytes": self.horizon_bytes}
        loads = {v.core: instructions_a_second(v, self.calls) for v in self.verdicts}
        if counted := {core: load for core, load in loads.items() if load is not None}:
            data |= {"calls_a_second": self.calls, "instructions_a_second": counted}
        return data if self.on_log is None else data | {"log": self.on_log.to_dict()}


VERDICT_HEAD = ("core", "values", "differing", "instructions", "stack [B]", "code [B]")


def verify(
    folder: str | Path | EmittedFilter,
    cores: Sequence[str] = ("host",),
    log: LogOrPath | None = None,
    contract: bool = False,
    *,
    played: Replay | None = None,
    sensor_rates: Mapping[str, float] = NOTHING,
) -> Verification:
    """Make the same calls on each core with the emitted files, and compare with the reference.

    Parameters
    ----------
    folder : path-like or EmittedFilter
        As `kfgen.emit` wrote it, or gave it.
    cores : sequence of str
        Names of cores, see `kfgen.list_all`; a Python module runs on the host only.
    log : Log or path-like, optional
        Make the calls of this log; a simulated scenario where left out.
    contract : bool
        Compile with fused products and sums; then values may differ by `CONTRACTED` standard deviations.
    played : Replay, optional
        The calls themselves, as `kfgen.verify.replay.replay` has them.
    sensor_rates : mapping of str to float
        Of sensors by name [Hz], for the instructions of a second; where one is left out, the usual one of such sensors.

    Returns
    -------
    Verification

    Raises
    ------
    InputError
        No emitted filter, an unknown core, or a log that lacks an input or every sensor of the filter.
    CheckFailed
        The header does not compile.
    MissingExtra
        The emulator is not installed.
    """
    emitted = folder if isinstance(folder, EmittedFilter) else read_folder(folder)
    calls, on_log = calls_a_second(emitted.program, sensor_rates), None
    if log is not None:
        played, on_log = over_log(emitted.program, log_of(log))
    verdicts = tuple(_verdicts(emitted, cores, contract, played))
    program = emitted.program
    sizes = (memory_bytes(program), horizon_bytes(program)) if emitted.target == TARGET else (0, 0)
    return Verification(emitted.model_hash, verdicts, on_log, *sizes, calls)


def _verdicts(
    emitted: EmittedFilter, names: Sequence[str], contract: bool, played: Replay | None
) -> list[CoreVerdict]:
    program = emitted.program
    makers = [(name, maker_of(name, contract)) for name in names]
    if emitted.target in MODULES:
        if set(names) - {"host"}:
            raise InputError(
                "a Python module runs on the host only", where="--core", remedy="Leave --core out"
            )
        verdict = MODULES[emitted.target](program, emitted.folder, played or simulated(program))
        border = None if played else program.border
        own = border and border_module(border, emitted.folder, emitted.target)
        return [together(verdict, own) if own else verdict]
    alone = played is not None or contract
    played = played or simulated(program)
    verdicts = []
    for name, make in counted(makers, "cores", alike=False):
        with tempfile.TemporaryDirectory(prefix="kfgen-verify-") as scratch:
            core = make(program, emitted.folder, Path(scratch))
            compare = _compare_contracted if contract else _compare
            verdict = compare(name, core, played, program)
        border = None if alone else program.border
        verdicts.append(together(verdict, _border(name, make, border, emitted.folder)) if border else verdict)
    return verdicts


def _border(name: str, make: CoreMaker, border: Border, folder: Path) -> CoreVerdict:
    """The border on a core, bit by bit."""
    with tempfile.TemporaryDirectory(prefix="kfgen-verify-") as scratch:
        core = make(border, folder, Path(scratch))
        return _compare(name, core, border_replay(border))


def costs(program: Program, names: Sequence[str]) -> tuple[str, ...]:
    """What each routine of the emitted C costs on emulated cores, in words.

    Parameters
    ----------
    program : Program
        A filter in C.
    names : sequence of str
        Emulated cores, ``m4f`` for example.

    Returns
    -------
    tuple of str
        A line for each core and routine.

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
            for call in scenario(program, None if program.delayed else most):
                core.call(call.routine, call.inputs)
            for routine in program.align:
                for inputs in at_rest(program, routine):
                    core.call(routine.name, inputs)
            cost = core.cost()
        said += [
            f"{CHIPS[name].title}, {called}: {count} instructions, {cost.stacks[called]} bytes of stack, "
            f"{cost.texts[called]} of code"
            for called, count in cost.instructions.items()
        ]
    return tuple(said)


COUNTED_CALLS = 25
"""Calls of which each routine has its share."""

CONTRACTED = 1e-3
"""With fused products and sums: standard deviations by which a value may differ."""


def _begin(core: Core, played: Replay) -> None:
    core.call("init", ())
    for array, values in played.start.items():
        core.put(array, values)


def _compare_contracted(name: str, core: Core, played: Replay, program: Program) -> CoreVerdict:
    """Words on either side as state and covariance, against the reference's own standard deviations."""
    _begin(core, played)
    words = differing = 0
    for call in played.calls:
        core.call(call.routine, call.inputs)
        found, wanted = core.words().view(program.type), call.words
        off = deviations_off(program, found, wanted)
        words += off.size
        differing += int((~(off <= CONTRACTED)).sum())
    return CoreVerdict(name, words, differing, 0, len(played.calls), core.cost(), CONTRACTED)


def _compare(name: str, core: Core, played: Replay, program: Program | None = None) -> CoreVerdict:
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
