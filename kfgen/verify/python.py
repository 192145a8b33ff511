"""The emitted filterpy module against the double precision reference.

filterpy's matrices round in another order than the reference's scalars, so the comparison has a
tolerance: `TOLERANCE` of a state's own deviation, or of the product of two for a covariance.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.covariance import packed
from kfgen.emit.filterpy import class_name
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.scenario import scenario, split
from kfgen.errors import CheckFailed
from kfgen.verify.core import Cost, Verdict

Array = NDArray[np.float64]

TOLERANCE = 1e-6


def compare_module(program: Program, folder: Path) -> Verdict:
    """Run the scenario through the module in a folder and count what is off.

    Raises
    ------
    CheckFailed
        The module cannot be imported.
    """
    path = folder / f"{program.name}.py"
    spec = importlib.util.spec_from_file_location(f"kfgen_verified_{program.name}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise CheckFailed("the module is missing", where=str(path))
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (ImportError, SyntaxError) as error:
        raise CheckFailed(f"the module cannot be imported: {error}", where=str(path)) from None
    kf = getattr(module, class_name(program))()
    machine, n = Machine(program, np.float64), program.n
    machine.call("init")
    routines = {r.name: r for r in program.routines}
    upper = [(i, j) for i in range(n) for j in range(i, n)]
    words = differing = calls = 0
    for call in scenario(program):
        routine = routines[call.routine]
        values = split(routine, call.inputs)
        if machine.call(call.routine, values) != "OK":
            continue  # the module has no gate and no guard of its step
        getattr(kf, call.routine)(
            **{a.name: np.asarray(v) if a.size else v for a, v in zip(routine.arguments, values)}
        )
        P = np.array([machine.arrays["P"][packed(n, i, j).index] for i, j in upper])
        sd = np.sqrt(np.array([machine.arrays["P"][packed(n, i, i).index] for i in range(n)]))
        off_P = np.abs(np.array([kf.P[i, j] for i, j in upper]) - P) / np.array(
            [sd[i] * sd[j] for i, j in upper]
        )
        off_x = np.abs(np.array(kf.nominal) - machine.arrays["x"]) / _deviations(program, sd)
        differing += int((off_P > TOLERANCE).sum()) + int((off_x > TOLERANCE).sum())
        words += off_P.size + off_x.size
        calls += 1
    return Verdict("filterpy", words, differing, 0, calls, Cost(), TOLERANCE)


def _deviations(program: Program, sd: Array) -> Array:
    """The deviation of each stored component; of a quaternion's, half the attitude's smallest."""
    names = [s.name for s in program.discrete.model.states]
    attitude = program.discrete.model.attitude
    least = min((sd[names.index(n)] for n in attitude.error_names), default=1.0) / 2.0 if attitude else 1.0
    return np.array([sd[names.index(n)] if n in names else least for n in program.discrete.nominal_names])
