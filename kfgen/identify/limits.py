"""What a record cannot show: upper limits of effects, and the log that would show them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kfgen.effects import Effect, effect_named
from kfgen.errors import InputError
from kfgen.identify.bounds import seconds_for
from kfgen.identify.fit import Fit, Problem, maximise
from kfgen.identify.interval import upper95
from kfgen.identify.record import Evidence


@dataclass(frozen=True)
class Limit:
    """What the record cannot show: a parameter below `upper95` [SI].

    `hours` of log would give it to 20 % if it were half of that, the middle of what is left open.
    """

    effect: Effect
    parameter: str
    upper95: float
    hours: float


def starts(name: str, record: Evidence) -> list[Effect]:
    """Where fits of an effect to a record should start.

    Raises
    ------
    InputError
        A record at rest cannot show the effect, or the log lacks its driver.
    """
    cls = effect_named(name)
    found = cls.starts(record.look)
    if not found:
        missing = f"needs the channel '{cls.driver}'" if cls.driver else "cannot be seen on a record at rest"
        raise InputError(f"{name} {missing}", remedy="Leave it out, or give a log that has it")
    return list(found)


def limit(problem: Problem, best: Fit, name: str) -> Limit:
    """The upper limit of an effect beside the others, at its worst correlation time.

    The others are fitted anew for every size that is tried, so that an unresolved drift may turn out
    to be all of the effect asked for.
    """
    return _worst(
        problem, best, name, lambda trial, fit, size: upper95(trial, fit, (len(trial.effects) - 1, size))
    )


def _worst(problem: Problem, best: Fit, name: str, upper: Callable[[Problem, Fit, str], float]) -> Limit:
    others = tuple(e for e in best.effects if e.name != name)
    record, index = problem.record, len(others)
    shown = starts(name, record)
    size = shown[0].searched()[0].name
    worst: Limit | None = None
    for start in _slowest_apart(shown):
        fixed = frozenset((index, p.name) for p in start.searched()[1:])
        trial = Problem(record, (*others, start), fixed=fixed)
        small = replace(start, **{size: 1e-3 * float(getattr(start, size))})
        fits = [maximise(t) for t in (trial, trial.starting((*others, small)))]
        fit = max(fits, key=lambda f: f.value)
        top = upper(trial, fit, size)
        if worst is None or top > worst.upper95:
            worst = Limit(replace(fit.effects[index], **{size: top}), size, top, 0.0)
    if worst is None:
        raise InputError(f"{name} cannot be limited by this record")
    half = replace(worst.effect, **{size: 0.5 * worst.upper95})
    hours = seconds_for((*others, half), record.dt, (index, size)) / 3600.0 if np.isfinite(top) else np.inf
    return replace(worst, hours=max(float(hours), record.duration / 3600.0))


def _slowest_apart(shown: Sequence[Effect]) -> Sequence[Effect]:
    """All starts but the fastest, at which white noise hides a term of any size."""
    return shown[1:] or shown
