"""The self-test that goes with an emitted Python module: recorded calls, and what each number must then be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.scenario import RecordedCall, scenario, split
from kfgen.emit.targets.templates import render
from kfgen.emit.watch.supervisor import ARRAY as SUPERVISOR

Array = NDArray[np.float64]
Expected = Sequence[tuple[float, float]]
"""Numbers, and how far each may be off."""

SELFTEST_CALLS = 100
"""Calls in the self-test that goes with emitted code."""
TOLERANCE_SIGMAS = 1e-6
"""Standard deviations (or products of two) by which an arithmetic of its own may be off."""
FILE = "selftest.py"


def deviations(program: Program, sd: Array) -> Array:
    """The standard deviation of each stored component; of a quaternion's, half the attitude's smallest.

    Parameters
    ----------
    program : Program
    sd : ndarray, shape (n,)
        Standard deviations of the error states [SI].
    """
    names = [s.name for s in program.discrete.model.states]
    attitude = program.discrete.model.attitude
    least = min((sd[names.index(n)] for n in attitude.error_names), default=1.0) / 2.0 if attitude else 1.0
    return np.array([sd[names.index(n)] if n in names else least for n in program.discrete.nominal_names])


def exactly(calls: Sequence[RecordedCall]) -> Expected:
    """The values after the last call, to the last bit."""
    return [(float(v), 0.0) for v in calls[-1].words]


def nearly(program: Program, calls: Sequence[RecordedCall]) -> Expected:
    """State, upper triangle of the covariance and supervisor in double precision after the calls.

    Parameters
    ----------
    program : Program
    calls : sequence of RecordedCall
        From ``init`` on.
    """
    machine = Machine(program, np.float64)
    machine.call("init")
    for call in calls:
        machine.call(call.routine, split(machine.routines[call.routine], call.inputs))
    P, upper = machine.covariance(), np.triu_indices(program.n)
    sd = np.sqrt(np.diag(P))
    counts = machine.arrays[SUPERVISOR]
    values = [*machine.arrays["x"], *P[upper], *counts]
    scales = [*deviations(program, sd), *np.outer(sd, sd)[upper], *np.ones(counts.size)]
    return [(float(v), TOLERANCE_SIGMAS * float(s)) for v, s in zip(values, scales)]


def recorded(program: Program) -> tuple[RecordedCall, ...]:
    """The calls of a self-test."""
    return scenario(program, SELFTEST_CALLS)


def selftest(
    program: Program, klass: str, calls: Sequence[RecordedCall], expected: Expected, found: str
) -> str:
    """The text of the self-test.

    Parameters
    ----------
    program : Program
    klass : str
        The emitted class.
    calls : sequence of Call
    expected : sequence of (float, float)
    found : str
        Python for the same numbers of a filter ``kf``.
    """
    return render(
        "python/selftest.py.j2",
        name=program.name,
        model=program.discrete.model,
        version=kfgen.__version__,
        hash=program.discrete.hash[:16],
        klass=klass,
        routines=program.routines[1:],
        calls=calls,
        expected=expected,
        found=found,
    )
