"""The emitted Python modules against the reference.

The numpy module prints the reference's own routines: every bit counts. filterpy's matrices round in another order than the reference's scalars, so the comparison has a
tolerance: `TOLERANCE_SIGMAS` standard deviations of a state, or products of two for a covariance.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import CheckFailed, InputError
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.scenario import split
from kfgen.emit.targets.filterpy import class_name
from kfgen.emit.targets.loaded import imported
from kfgen.emit.targets.selftest import TOLERANCE_SIGMAS, deviations
from kfgen.emit.watch.supervisor import ARRAY as SUPERVISOR
from kfgen.verify.core import CoreVerdict, InstructionCount
from kfgen.verify.replay import Replay

Array = NDArray[np.float64]


def _module(program: Program, folder: Path) -> ModuleType:
    """The emitted module, imported.

    Raises
    ------
    CheckFailed
        The module cannot be imported.
    """
    path = folder / f"{program.name}.py"
    if not path.is_file():
        raise CheckFailed("the module is missing", where=str(path))
    try:
        return imported(path)
    except (ImportError, SyntaxError) as error:
        raise CheckFailed(f"the module cannot be imported: {error}", where=str(path)) from None


def compare_filterpy(program: Program, folder: Path, played: Replay) -> CoreVerdict:
    """Make calls on a filterpy module and count what is off by more than `TOLERANCE_SIGMAS`.

    Parameters
    ----------
    program : Program
    folder : Path
        Of the emitted module.
    played : Replay
        The calls.

    Raises
    ------
    InputError
        The calls are those of a log: `kfgen run` makes them, on this very module.
    """
    if played.start:
        raise InputError(
            "no log is played through a filterpy module",
            where="--log",
            remedy="kfgen run MODEL LOG runs it over the log",
        )
    kf = getattr(_module(program, folder), class_name(program))()
    machine, n = Machine(program, np.float64), program.n
    machine.call("init")
    routines = {r.name: r for r in program.entries}
    upper = np.triu_indices(n)
    words = differing = calls = 0
    for call in played.calls:
        routine = routines[call.routine]
        values = split(routine, call.inputs)
        wanted = machine.call(call.routine, values)
        found = getattr(kf, call.routine)(
            **{a.name: np.asarray(v) if a.size else v for a, v in zip(routine.arguments, values)}
        )
        P = machine.covariance()
        sd = np.sqrt(np.diag(P))
        off_P = np.abs(kf.P - P)[upper] / np.outer(sd, sd)[upper]
        off_x = np.abs(np.array(kf.nominal) - machine.arrays["x"]) / deviations(program, sd)
        counts = np.abs(np.array(kf.supervisor) - machine.arrays[SUPERVISOR])
        differing += (
            int((counts > TOLERANCE_SIGMAS).sum())
            + int((off_P > TOLERANCE_SIGMAS).sum())
            + int((off_x > TOLERANCE_SIGMAS).sum())
            + (found.name != wanted)
        )
        words += off_P.size + off_x.size + counts.size + 1
        calls += 1
    return CoreVerdict("filterpy", words, differing, 0, calls, InstructionCount(), TOLERANCE_SIGMAS)


def compare_numpy(program: Program, folder: Path, played: Replay) -> CoreVerdict:
    """Make calls on a numpy module and count the values that differ in any bit.

    Parameters
    ----------
    program : Program
    folder : Path
        Of the emitted module.
    played : Replay
        The calls, and the values after each.
    """
    kf = getattr(_module(program, folder), class_name(program))()
    for array, start in played.start.items():
        getattr(kf, array)[:] = start
    routines = {r.name: r for r in program.entries}
    words = differing = 0
    for call in played.calls:
        routine = routines[call.routine]
        values = split(routine, call.inputs)
        getattr(kf, call.routine)(
            **{a.name: np.asarray(v) if a.size else v for a, v in zip(routine.arguments, values)}
        )
        bits = f"u{call.words.dtype.itemsize}"
        found = np.concatenate([getattr(kf, array) for array in program.compared])
        words += found.size
        differing += int((found.view(bits) != call.words.view(bits)).sum())
    return CoreVerdict("numpy", words, differing, 0, len(played.calls), InstructionCount())


def deviations_off(program: Program, found: NDArray[Any], wanted: NDArray[Any]) -> Array:
    """How far values are off, in standard deviations: of stored components, then of the covariance's upper triangle.

    Parameters
    ----------
    program : Program
    found : ndarray
        State and stored covariance, one after the other.
    wanted : ndarray
        The same of the reference.
    """
    form, nx = program.covariance, len(program.discrete.nominal_names)
    P, Q = (np.array(form.matrix(w[nx:].tolist())) for w in (wanted, found))
    sd = np.sqrt(np.diag(P))
    upper = np.triu_indices(program.n)
    off_P = np.abs(Q - P)[upper] / np.outer(sd, sd)[upper]
    off_x = np.abs(found[:nx].astype(float) - wanted[:nx]) / deviations(program, sd)
    return np.concatenate([off_x, off_P])


MODULES: dict[str, Callable[[Program, Path, Replay], CoreVerdict]] = {
    "filterpy": compare_filterpy,
    "numpy": compare_numpy,
}
"""How the module of a Python target is compared."""
