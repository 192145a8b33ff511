"""Which effects a record shows: the candidate sets, and a calibrated choice among them.

White noise is in every set; on it stand up to two slow effects (random walk, Gauss-Markov,
flicker, in every combination), quantisation where it helps, at most one deterministic drift
(a ramp, warm-up) and what the drivers in the log explain (`kfgen.identify.fit.drivers`). Each effect that is added must raise twice the log-likelihood by more
than the 95 % quantile of what it gains by chance: 2.7 for one more size (half a chi-square of
one degree, for sizes are not negative [1]_), `GAIN_OF_A_SEARCHED_TIME` for one whose time is searched or whose band is
chosen (tabled from records of white noise and random walk: 6.3 at 1000 s, 7.3 at 2.8 h, 95 % of
them), `GAIN_OF_QUANTISATION` for quantisation (once in two thousand: where it is real, all high frequencies tell of
it), and `GAIN_OF_A_DRIFT` for a deterministic drift, which over one record is hard to tell from a random walk by chance.
The set with the largest gain over its thresholds is chosen.

References
----------
.. [1] S. G. Self and K.-Y. Liang, Asymptotic properties of maximum likelihood estimators and likelihood
   ratio tests under nonstandard conditions, J. Am. Stat. Assoc. 82(398), 1987.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement, product

from kfgen.core.time_budget import search_is_over
from kfgen.effects import Effect, catalogue
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.drivers import Group, driver_groups, follow_their_drivers, promise
from kfgen.identify.fit.fit import Fit, Problem
from kfgen.identify.fit.limits import starts

GAIN_OF_A_SIZE = 2.7
GAIN_OF_A_SEARCHED_TIME = 9.0
GAIN_OF_QUANTISATION = 10.8
GAIN_OF_A_DRIFT = 20.0
GAIN_OF_A_DRIFT_WORTH_FITTING = 3.8
"""What a drift must gain beside noise that was fitted without it, to be fitted with it."""
MAX_SLOW_EFFECTS = 2


@dataclass(frozen=True)
class EffectSet:
    """A fitted set of effects: twice its log-likelihood, or less a misfit, and what its terms cost."""

    fit: Fit
    problem: Problem
    gain: float

    @property
    def score(self) -> float:
        """The gain over the thresholds."""
        return self.gain - sum(threshold(e) for e in self.fit.effects)


Fitter = Callable[[Evidence, Sequence[tuple[Effect, ...]]], EffectSet]
"""Fits a set of effects from several starts, and keeps the best."""


def threshold(effect: Effect) -> float:
    """What an effect must gain to stay."""
    if effect.coefficients():
        return GAIN_OF_A_DRIFT + (GAIN_OF_A_SEARCHED_TIME - GAIN_OF_A_SIZE) * len(effect.searched())
    if not effect.form().order and not effect.form().V:
        return GAIN_OF_QUANTISATION
    shaped = any(p.kind in ("time", "setting") for p in effect.parameters())
    return GAIN_OF_A_SEARCHED_TIME if shaped else GAIN_OF_A_SIZE


def slow_effects(record: Evidence) -> list[str]:
    """Random effects with states, which act at long times."""
    return [e.name for e in _shown(record) if not e.coefficients() and e.form().order]


def fast_effects(record: Evidence) -> list[str]:
    """Random effects without states beside the white noise: quantisation."""
    return [e.name for e in _shown(record) if not e.coefficients() and not e.form().order and not e.form().V]


def drifts(record: Evidence) -> list[str]:
    """Deterministic effects that the record can show by itself, without a driver."""
    return [e.name for e in _shown(record) if e.coefficients() and not e.driver]


def _shown(record: Evidence) -> list[Effect]:
    return [found[0] for cls in catalogue().values() if (found := cls.starts(record.look))]


def choose(record: Evidence, fit: Fitter, *, drifting: bool = True) -> EffectSet:
    """The best set of effects.

    Parameters
    ----------
    record : Evidence
    fit : Fitter
        How a set is fitted.
    drifting : bool
        Whether deterministic drifts are tried.
    """
    slow = [(), *_sets(slow_effects(record))]
    trials = (fit(record, combined(record, ("white_noise", *s))) for s in slow)
    best = max(in_time(trials), key=lambda t: t.score)
    for name in fast_effects(record):
        best = max(
            best, fit(record, [(*best.fit.effects, e) for e in starts(name, record)]), key=lambda t: t.score
        )
    if not drifting:
        return best
    fast = tuple(e.name for e in best.fit.effects[1:] if e.name in fast_effects(record))
    if any(e.form().order for e in best.fit.effects):
        best = _with_drift(record, fit, best, fast)
    return _with_drivers(record, fit, best, fast) if record.driven else best


def in_time(trials: Iterator[EffectSet]) -> Iterator[EffectSet]:
    """The first of the trials, and the others until the time of the search is spent."""
    for trial in trials:
        yield trial
        if search_is_over():
            return


def _with_drift(record: Evidence, fit: Fitter, best: EffectSet, fast: tuple[str, ...]) -> EffectSet:
    """The best set with a drift in place of slow noise, or beside it, where that is better."""
    for name in drifts(record):
        gain, start = max(
            ((promise(record, best.fit.effects, (e,)), e) for e in starts(name, record)), key=lambda g: g[0]
        )
        if gain > GAIN_OF_A_DRIFT_WORTH_FITTING:
            trials = (fit(record, choices) for choices in _beside(record, fast, (start,)))
            best = max([best, *in_time(trials)], key=lambda t: t.score)
    return best


def _beside(record: Evidence, fast: tuple[str, ...], shapes: Group) -> list[list[tuple[Effect, ...]]]:
    """Starts of the fits of deterministic effects beside white noise, fast terms and no or one slow term."""
    alone = [(), *((n,) for n in slow_effects(record))]
    return [[(*c, *shapes) for c in combined(record, ("white_noise", *fast, *s))] for s in alone]


def _with_drivers(record: Evidence, fit: Fitter, best: EffectSet, fast: tuple[str, ...]) -> EffectSet:
    """The best set with what the drivers of the log explain, each group of them beside every slow term."""
    while True:
        found = best
        for group in _promising(record, best):
            others = tuple(e for e in _driven(best) if e.driver != group[0].driver)
            trials = (fit(record, choices) for choices in _beside(record, fast, (*others, *group)))
            found = max(
                [found, *(t for t in in_time(trials) if follow_their_drivers(record, t.fit))],
                key=lambda t: t.score,
            )
        if found is best:
            return best
        best = found


def _driven(chosen: EffectSet) -> Group:
    return tuple(e for e in chosen.fit.effects if e.coefficients() and e.driver)


def _promising(record: Evidence, best: EffectSet) -> list[Group]:
    """Of each driver the group that promises most above its thresholds: more shapes than it has, which are none at first.

    Noise that was fitted without a driver hides its smaller shapes: they are looked for again beside the larger ones.
    """
    there, most = _driven(best), dict[str, tuple[float, Group]]()
    known = promise(record, best.fit.effects, there)
    for group in driver_groups(record):
        driver, names = group[0].driver, {e.name for e in group}
        present = {e.name for e in there if e.driver == driver}
        if not present < names:
            continue
        others = tuple(e for e in there if e.driver != driver)
        new = [e for e in group if e.name not in present]
        worth = promise(record, best.fit.effects, (*others, *group)) - known
        worth -= sum(threshold(e) for e in new[1:])
        if worth > max(GAIN_OF_A_DRIFT_WORTH_FITTING, most.get(driver, (0.0,))[0]):
            most[driver] = worth, group
    return [group for _, group in most.values()]


def _sets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """All sets of up to `MAX_SLOW_EFFECTS` of them; one that may repeat, twice too."""
    known = catalogue()
    return [
        s
        for count in range(1, MAX_SLOW_EFFECTS + 1)
        for s in combinations_with_replacement(names, count)
        if all(s.count(n) == 1 or known[n].repeatable for n in s)
    ]


def combined(record: Evidence, names: Sequence[str]) -> list[tuple[Effect, ...]]:
    """Start values of several effects together, every one with every other, the same effect at different ones.

    Parameters
    ----------
    record : Evidence
        What is identified.
    names : sequence of str
        Effects; one may stand there several times.

    Returns
    -------
    list of tuple of Effect
        Each is a start.
    """
    groups = []
    for name in dict.fromkeys(names):
        shown, count = starts(name, record), list(names).count(name)
        groups.append(list(combinations(shown, count)) if len(shown) >= count else [tuple(shown * count)])
    return [tuple(e for group in choice for e in group) for choice in product(*groups)]
