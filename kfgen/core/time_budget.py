"""How long an answer may take: a search whose time is spent ends with the best so far, and that is said.

Time is that of the process or of the clock, whichever passed less: a busy machine takes none of it away, nor do
several threads. Reading a long log takes none of it either: `not_counted`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from kfgen.core.elapsed import limited

SEARCH_SECONDS = 60.0
"""After which nothing more is added [s]."""
FIT_SECONDS = 80.0
"""After which a fit ends with its next step [s]; what is left is for the proof, and for what would not have been seen."""
SHARE_OF_IDENTIFICATION = 0.4
"""Of these: an identification has no proof to follow, and is waited for."""
MIN_SECONDS = 2.0
"""Of a search whose turn comes when all is spent [s]."""
LESS_TO_SEARCH = "give fewer channels or a shorter part of the log"
"""What lets a search come to its end."""
ENDED_EARLY = (
    "the search ended after {seconds:.0f} s of computing with the best so far, and what it did not come to may be "
    f"missing. {LESS_TO_SEARCH.capitalize()} for a complete one"
)

ENDED_BY_USER = (
    "the search is unfinished: it was ended after {seconds:.0f} s of computing by Ctrl-C, with the best so far, and what "
    "it did not come to is missing. Let it run to its end for a complete one"
)


_NOT_COUNTED_S: ContextVar[float] = ContextVar("not_counted_s", default=0.0)
"""Seconds of this process that no budget counts."""


@dataclass
class TimeBudget:
    """The time of one search, from its first line on.

    Parameters
    ----------
    search_s, fit_s : float
        Seconds after which nothing more is added, and after which fits end.
    ended_early : bool
        Whether something was left out for want of time.
    """

    search_s: float = SEARCH_SECONDS
    fit_s: float = FIT_SECONDS
    ended_early: bool = False
    _clock: float = field(default_factory=time.monotonic)
    _process: float = field(default_factory=time.process_time)
    _before: float = field(default_factory=_NOT_COUNTED_S.get)

    @property
    def spent_s(self) -> float:
        """Seconds since it began, less those that are not counted."""
        passed = min(time.monotonic() - self._clock, time.process_time() - self._process)
        return passed - (_NOT_COUNTED_S.get() - self._before)

    def has_spent(self, limit_s: float) -> bool:
        """Whether so many seconds are spent: asked at every step of a fit, so the clock, which is quick, comes first."""
        return time.monotonic() - self._clock >= limit_s and self.spent_s >= limit_s

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be said of it."""
        said = ENDED_BY_USER if _ENDED_BY_USER.is_set() else ENDED_EARLY
        return (said.format(seconds=self.spent_s),) if self.ended_early else ()


_CURRENT: ContextVar[TimeBudget | None] = ContextVar("time_budget", default=None)
_ENDED_BY_USER = threading.Event()


def end_search() -> bool:
    """Let the search that runs end with the best so far; False where none runs, or it was told so before."""
    budget = _CURRENT.get()
    if budget is None or _ENDED_BY_USER.is_set():
        return False
    _ENDED_BY_USER.set()
    budget.ended_early = True
    return True


def is_ended_by_user() -> bool:
    """Whether the last search was told to end with the best so far."""
    return _ENDED_BY_USER.is_set()


def forget_end() -> None:
    """Begin or end a command: of the next search nobody has said yet that it is to end."""
    _ENDED_BY_USER.clear()


@contextmanager
def not_counted() -> Iterator[None]:
    """Time that grows with a log and is no search: one pass over it."""
    clock, process = time.monotonic(), time.process_time()
    try:
        yield
    finally:
        passed = min(time.monotonic() - clock, time.process_time() - process)
        _NOT_COUNTED_S.set(_NOT_COUNTED_S.get() + passed)


@contextmanager
def time_budget(parts: int = 1, share: float = 1.0) -> Iterator[TimeBudget]:
    """A budget for all that is computed inside.

    Parameters
    ----------
    parts : int
        Searches, this one the first of them, that share what is left of the budget outside.
    share : float
        Of `SEARCH_SECONDS` and `FIT_SECONDS`, or of what is left of the budget outside.

    Returns
    -------
    TimeBudget
        Of what is computed inside.
    """
    outer = _CURRENT.get()
    budget = TimeBudget(share * SEARCH_SECONDS, share * FIT_SECONDS)
    if outer is not None:
        left = share * max(outer.search_s - outer.spent_s, min(MIN_SECONDS, outer.search_s)) / parts
        longer = outer.fit_s / outer.search_s if outer.search_s > 0.0 else 1.0
        budget = TimeBudget(left, left * longer)
    else:
        limited(lambda: budget.search_s - budget.spent_s)
    token = _CURRENT.set(budget)
    try:
        yield budget
    finally:
        _CURRENT.reset(token)
        if outer is not None:
            outer.ended_early |= budget.ended_early


def search_is_over() -> bool:
    """Whether the time for adding effects is spent; asked only where more would be looked for."""
    budget = _CURRENT.get()
    return budget is not None and _is_over(budget, budget.search_s)


def fit_is_over() -> bool:
    """Whether the time for fits is spent."""
    budget = _CURRENT.get()
    return budget is not None and _is_over(budget, budget.fit_s)


def _is_over(budget: TimeBudget, limit_s: float) -> bool:
    if not _ENDED_BY_USER.is_set() and not budget.has_spent(limit_s):
        return False
    budget.ended_early = True
    return True
