"""What a record cannot show: upper limits of effects, and the log that would show them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kfgen.core.errors import InputError
from kfgen.core.time_budget import fit_is_over
from kfgen.effects import Effect, effect_named
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.bounds import seconds_for
from kfgen.identify.fit.fit import Problem, maximise
from kfgen.identify.fit.interval import upper95


@dataclass(frozen=True)
class Limit:
    """What the record cannot show: a parameter below `upper95` [SI], infinite where no limit is known.

    `hours` of log would give it to 20 % if it were half of that, the middle of what is left open.
    `ended_early` says that there was no time to look for the limit.
    """

    effect: Effect
    parameter: str
    upper95: float
    hours: float
    ended_early: bool = False

    @property
    def is_known(self) -> bool:
        """Whether there is an upper limit."""
        return bool(np.isfinite(self.upper95))


def starts(name: str, record: Evidence) -> list[Effect]:
    """Where fits of an effect to a record should start.

    Parameters
    ----------
    name : str
        An effect of the catalogue.
    record : Evidence
        What is identified.

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


def limit(record: Evidence, others: tuple[Effect, ...], name: str) -> Limit:
    """The upper limit of an effect beside others, at its worst correlation time.

    The others are fitted anew for every size that is tried, so that an unresolved drift may turn out
    to be all of the effect asked for. The hours are at least those of the record, which did not show it.

    Parameters
    ----------
    record : Evidence
        What is identified.
    others : tuple of Effect
        Fitted, without the one that is asked for.
    name : str
        The effect that is asked for.
    """
    index, shown = len(others), starts(name, record)
    size = shown[0].searched()[0].name
    # At the fastest start of several, white noise hides a term of any size.
    found = [_limit_at(record, others, start, size) for start in shown[1:] or shown]
    worst, top, ended_early = max(found, key=lambda f: f[1])
    half = replace(worst, **{size: 0.5 * top})
    seconds = float("inf")
    if np.isfinite(top):
        seconds = seconds_for((*others, half), record.dt, (index, size), skip=record.skip)
    hours = max(seconds, record.duration) / 3600.0
    return Limit(replace(worst, **{size: top}), size, top, hours, ended_early)


def _limit_at(
    record: Evidence, others: tuple[Effect, ...], start: Effect, size: str
) -> tuple[Effect, float, bool]:
    """An effect with its times held, fitted beside the others, its size's limit, and whether time was short for it."""
    key = (len(others), size)
    fixed = frozenset((len(others), p.name) for p in start.searched()[1:])
    small = replace(start, **{size: 1e-3 * float(getattr(start, size))})
    trials = [Problem(record, (*others, e), fixed=fixed) for e in (start, small)]
    fits = [maximise(t) for t in trials]
    best = max(range(2), key=lambda i: fits[i].value)
    top = upper95(trials[best], fits[best], key)
    return fits[best].effects[-1], top, not np.isfinite(top) and fit_is_over()
