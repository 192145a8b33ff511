"""Which effects a record shows: the candidate sets, and a calibrated choice among them.

White noise is in every set; on it stand up to two slow effects (random walk, Gauss-Markov,
flicker, in every combination), quantisation where it helps, and at most one deterministic drift
(a ramp, warm-up, a driver's). Each effect that is added must raise twice the log-likelihood by more
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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement, product

import numpy as np

from kfgen.effects import Effect, catalogue
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.fit import Fit, Problem
from kfgen.identify.fit.limits import starts

GAIN_OF_A_SIZE = 2.7
GAIN_OF_A_SEARCHED_TIME = 9.0
GAIN_OF_QUANTISATION = 10.8
GAIN_OF_A_DRIFT = 20.0
GAIN_OF_A_DRIFT_WORTH_FITTING = 3.8
"""What a drift must gain beside noise that was fitted without it, to be fitted with it."""
MIN_CHANCE_OF_EQUAL_BANDS = 1e-3
"""Chance below which the bands of a driven effect disagree."""
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
    """Deterministic effects that the record can show."""
    return [e.name for e in _shown(record) if e.coefficients()]


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
    base = ("white_noise",)
    slow = [(), *_sets(slow_effects(record))]
    trials = [fit(record, combined(record, (*base, *s))) for s in slow]
    best = max(trials, key=lambda t: t.score)
    for name in fast_effects(record):
        best = max(
            best, fit(record, [(*best.fit.effects, e) for e in starts(name, record)]), key=lambda t: t.score
        )
    if not drifting or all(e.form().order == 0 for e in best.fit.effects):
        return best
    fast = tuple(e.name for e in best.fit.effects[1:] if e.name in fast_effects(record))
    for name in drifts(record):
        gain, start = _promise(record, best.fit.effects, starts(name, record))
        if gain > GAIN_OF_A_DRIFT_WORTH_FITTING:
            alone = [(), *((n,) for n in slow_effects(record))]
            sets = [[(*c, start) for c in combined(record, (*base, *fast, *s))] for s in alone]
            trials = [fit(record, choices) for choices in sets]
            best = max([best, *(t for t in trials if _holds(record, t.fit))], key=lambda t: t.score)
    return best


def _holds(record: Evidence, fit: Fit) -> bool:
    """Whether the last effect of a fit, where it is driven, has the same coefficient in every band.

    A driver's own noise that leaks into a channel, by a compensation for instance, is no drift with it: slow
    and fast then follow the driver by different amounts.
    """
    from scipy.stats import chi2

    effect = fit.effects[-1]
    if not effect.driver:
        return True
    data = record.ordinates((effect,))
    weight = data.gram[:, :, 1] / data.density(fit.effects)[:, None]
    band = np.floor(2.0 * np.log10(data.omega / data.omega[0])).astype(int)
    xy, xx = (np.bincount(band, weight[:, k]) for k in (0, 1))
    some = xx > 0.0
    coefficient = xy.sum() / xx.sum()
    spread = float(np.sum((xy[some] - coefficient * xx[some]) ** 2 / xx[some]))
    return bool(chi2.sf(spread, max(int(some.sum()) - 1, 1)) > MIN_CHANCE_OF_EQUAL_BANDS)


def _promise(record: Evidence, effects: tuple[Effect, ...], shapes: Sequence[Effect]) -> tuple[float, Effect]:
    """What a drift gains at most beside effects that stay as they are, and at which of its shapes."""
    held = tuple(e for e in effects if not e.coefficients())
    known = record.likelihood(held).log_likelihood(held).value
    gains = [2.0 * (record.likelihood((*held, s)).log_likelihood((*held, s)).value - known) for s in shapes]
    best = max(range(len(shapes)), key=gains.__getitem__)
    return gains[best], shapes[best]


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
