"""The first flight of a filter over a log: the extended Kalman filter, whose path is smoothed afterwards."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.tape import Tape
from kfgen.gap.flight.flight_log import FlightLog
from kfgen.gap.flight.heading import headings, start_covariance
from kfgen.gap.flight.rows import rows_of
from kfgen.model.filter_equations import FilterEquations

Array = NDArray[np.float64]

OUTLIER_LIMIT_SIGMAS = 5.0
"""Standard deviations of an innovation beyond which the first flight counts it as if it lay there."""


def first_flight(log: FlightLog, eq: FilterEquations) -> tuple[FlightLog, Array]:
    """The log with the start that fits best, and the filter's stored state after each sample, shape (n, stored).

    Parameters
    ----------
    log : FlightLog
    eq : FilterEquations
        Of the same model.

    Raises
    ------
    InputError
        The filter diverges, or the extra ``kfgen[fast]`` is not installed.
    """
    best, X, score = _likeliest(log, eq)
    if not np.isfinite(score):
        raise InputError(
            f"the filter {log.discrete.model.name} diverges over the log",
            remedy="Check the units and axes of its inputs, or start it at rest",
        )
    return best, X


def flight_score(log: FlightLog, eq: FilterEquations, least: float = -np.inf) -> float:
    """Log-likelihood of the first flight, its outliers limited [nats]; minus infinity where the filter diverges.

    Parameters
    ----------
    log, eq
        As of `first_flight`.
    least : float
        Where it is less than this, minus infinity: such a flight is not flown to its end.
    """
    return _likeliest(log, eq, least)[2]


def _likeliest(log: FlightLog, eq: FilterEquations, least: float = -np.inf) -> tuple[FlightLog, Array, float]:
    """The start that fits best, the stored states and their log-likelihood."""
    try:
        from kfgen.gap.flight.closed_loop import fly
    except ImportError:
        raise InputError(
            "the gap of a filter over a flight needs numba", remedy='Install it: pip install "kfgen[fast]"'
        ) from None
    best = (log, np.empty(0), -np.inf)
    for start in headings(log, eq):
        X, score = _flown(fly, start, eq, max(least, best[2]))
        if score > best[2]:
            best = (start, X, score)
    return best


def _flown(
    fly: Callable[..., None], log: FlightLog, eq: FilterEquations, least: float
) -> tuple[Array, float]:
    """The stored states and their log-likelihood [nats]; minus infinity where it diverges."""
    model = log.discrete.model
    F, Q = eq.transition, eq.process_noise
    step, read, inject = eq.prediction, eq.readings([a.sensor for a in log.aiding]), eq.inject
    known = np.column_stack([log.u, *(log.drive[d] for d in model.drivers)])
    fixed = np.array([*log.constants.values(), log.dt])
    rows = rows_of(log)
    P = start_covariance(log, eq)
    score = np.zeros(1)
    X = np.empty((log.t.size, len(eq.names)))
    fly(
        *_parts(step),
        F.rows, F.columns, Q.rows, Q.columns,
        *_parts(read.tape), read.rows, read.columns,
        *_parts(inject),
        np.array(eq.quaternions, dtype=np.int64),
        np.ascontiguousarray(known), np.ascontiguousarray(log.start, dtype=np.float64), P, fixed,
        rows.at, rows.index, np.ascontiguousarray(rows.z), np.ascontiguousarray(rows.R), OUTLIER_LIMIT_SIGMAS, least, X,
        score,
    )  # fmt: skip
    good = np.isfinite(X).all() and np.isfinite(score[0])
    return X, float(score[0]) if good else -np.inf


def _parts(tape: Tape) -> tuple[NDArray[np.int64], int, Array, NDArray[np.int64]]:
    """Operations, the register of the first result, constants, outputs."""
    return tape.operations, tape.variables + tape.constants.size, tape.constants, tape.outputs
