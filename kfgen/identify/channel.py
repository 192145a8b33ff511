"""Identification of one channel: checked, cleaned, its lines taken out, then a method's estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kfgen.errors import InputError
from kfgen.identify.bounds import relative_bound
from kfgen.identify.clean import roll_off, without_outliers
from kfgen.identify.fit import Fit, Key, Record
from kfgen.identify.likelihood import METHODS, Limit
from kfgen.identify.lines import PeriodicLine, find_lines

MINIMUM = 64
"""Samples that a fit needs."""
BLOCKS = 1_000_000
"""A longer record is averaged to about this many blocks first."""


@dataclass(frozen=True)
class Identified:
    """The answer for one channel.

    Parameters
    ----------
    fit, unresolved, intervals, limits
        The method's estimate, see `kfgen.identify.likelihood.Estimate`.
    bounds : dict
        Cramér-Rao bound of each parameter, as a relative deviation.
    record : Record
        What was fitted: without outliers, with the bands that were left out.
    warnings : tuple of str
    lines : tuple of PeriodicLine
    """

    fit: Fit
    unresolved: frozenset[int]
    intervals: dict[Key, tuple[float, float]]
    limits: tuple[Limit, ...]
    bounds: dict[Key, float]
    record: Record
    warnings: tuple[str, ...] = ()
    lines: tuple[PeriodicLine, ...] = ()


def identify(record: Record, wanted: Sequence[str] | None = None, method: str = "ml") -> Identified:
    """Identify one channel.

    Parameters
    ----------
    record : Record
        The samples; ``block`` and ``skip`` are chosen here.
    wanted : sequence of str, optional
        Exactly these effects instead of a choice along the ladder.
    method : str
        A key of `METHODS`.

    Raises
    ------
    InputError
        An unknown method, too few samples, or a channel that never changes.
    """
    if method not in METHODS:
        raise InputError(
            f"there is no method '{method}'", where="--method", remedy=f"Known are {', '.join(METHODS)}"
        )
    _check(record)
    record, share = without_outliers(replace(record, block=max(1, record.y.size // BLOCKS)))
    cut = roll_off(record)
    if cut is not None:
        record = replace(record, skip=((cut, float("inf")),))
    found = METHODS[method](record, wanted)
    lines = find_lines(record, found.fit.effects) if cut is None else []
    if lines:
        record = replace(record, skip=record.skip + tuple(line.band for line in lines))
        found = METHODS[method](record, wanted)
    bounds = relative_bound(found.fit.effects, record.dt, record.y.size)
    warnings = [_drift_warning(found.fit, found.unresolved, record)] if found.unresolved else []
    warnings += [f"{100 * share:.2g} % of the samples are outliers, left out"] if share else []
    warnings += (
        [f"an internal low-pass takes power away above {cut:.3g} Hz, left out of the fit"] if cut else []
    )
    return Identified(
        found.fit,
        found.unresolved,
        found.intervals,
        found.limits,
        bounds,
        record,
        tuple(warnings),
        tuple(lines),
    )


def _check(record: Record) -> None:
    n, largest = record.y.size, float(np.abs(record.y).max(initial=0.0))
    if n < MINIMUM:
        raise InputError(f"{n} samples are too few for a fit", remedy=f"Log at least {MINIMUM}")
    if not np.ptp(record.y) > 0.0:
        raise InputError("the channel never changes", remedy="Check the sensor and the column")
    if not np.isfinite(n * largest * largest):
        raise InputError("the values are too large to be squared", remedy="Check the unit and the column")


def _drift_warning(best: Fit, unresolved: frozenset[int], record: Record) -> str:
    names = " and ".join(best.effects[i].title for i in sorted(unresolved))
    return (
        f"there is a slow drift, fitted as {names}; {record.duration:.0f} s are too short to tell "
        "what it is: a random walk, a Gauss-Markov bias, warm-up or temperature"
    )
