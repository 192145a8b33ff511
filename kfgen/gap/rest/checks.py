"""Checks of every addition: data that no fit saw bear it out, it nests the assumed model, and it is found again.

The last simulates a record from the updated model, with the log's own time and drivers, and looks for the
gap between that and what was assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.gap.core.holdout import Gap, held_out_gap
from kfgen.gap.core.result import Checks
from kfgen.gap.core.search import Refused, grown
from kfgen.gap.rest.evidence import RETUNE
from kfgen.gap.rest.explanation import ChannelExplanation, search_limits
from kfgen.gap.rest.words import loses_unseen
from kfgen.identify.evidence.joint import JointRecord, records_of
from kfgen.identify.evidence.record import Evidence, Record

Array = NDArray[np.float64]

SEED = 1
"""Of the simulated record."""
MAX_SIMULATED_SAMPLES = 200_000
"""Length of a log beyond which no record is simulated; means of samples are not simulated either."""


def checks_of(
    search: ChannelExplanation, effects: Sequence[Effect], ci95: Sequence[tuple[str, float, float]]
) -> Checks:
    """The checks of a finished search.

    Parameters
    ----------
    search : ChannelExplanation
    effects : sequence of Effect
        Of the updated model, fitted.
    ci95 : sequence of (effect, lo, hi)
        95 % intervals of the sizes of what was added.
    """
    seen: dict[str, bool] = {}
    for name, lo, hi in ci95:
        seen[name] = seen.get(name, False) or lo > 0.0 or hi < 0.0
    again = None
    records = records_of(search.record)
    if search.record.n <= MAX_SIMULATED_SAMPLES and all(r.averaged == 1 for r in records):
        simulated = replace(search, record=_simulated_again(search, effects), chosen=(), known=())
        found = grown(simulated, search_limits())
        again = tuple(c.name for c in found.chosen if c.name != RETUNE)
    named = tuple(c.name for c in search.chosen if c.name != RETUNE)
    return Checks(_nested(search, effects), seen, again, named)


def without_losses(
    search: ChannelExplanation, raw: Record, written: Sequence[Effect]
) -> tuple[ChannelExplanation, Gap]:
    """Without noise that vanished, and the effects, the last one first, with which the held-out mismatch surely grows.

    Each was held against data that its fit did not see, but for what changes samples and for what time did not suffice.

    Parameters
    ----------
    search : ChannelExplanation
        Finished.
    raw : Record
        Less what assumed shapes give it.
    written : sequence of Effect
        The assumed random effects.
    """
    search = search.without_vanished()
    base = search.base
    clean = cast(Record, base.problem.record)
    gap = held_out_gap(raw, clean, written, replace(base.problem, effects=base.fit.effects))
    added = [k for k, c in enumerate(search.chosen) if c.name != RETUNE]
    if not added or not gap.surely_grows:
        return search, gap
    last = added[-1]
    why = loses_unseen(gap.lost_nats)
    less = search.less(last).refusing([Refused(*search.chosen[last].label, search.chosen[last].gain, why)])
    return without_losses(less, raw, written)


def _nested(search: ChannelExplanation, effects: Sequence[Effect]) -> float:
    """Change of the likelihood when what was added is there with a size of nothing."""
    k = len(search.effects)
    known = list(effects[:k])
    base = search.record.likelihood(known).log_likelihood(known, np.zeros(0)).value
    worst = 0.0
    for effect in effects[k:]:
        none = effect.shape if effect.coefficients() else _without_size(effect)
        if none is None:
            continue
        both = [*known, none]
        zeros = np.zeros(len(none.coefficients()))
        data = search.record.likelihood(both)
        alone = base if none.coefficients() else data.log_likelihood(known, zeros).value  # in the same bins
        worst = max(worst, abs(data.log_likelihood(both, zeros).value - alone))
    return worst


def _without_size(effect: Effect) -> Effect | None:
    sizes = effect.sizes()
    return replace(effect, **dict.fromkeys(sizes, 0.0)) if sizes and not effect.is_filter else None


def _simulated_again(search: ChannelExplanation, effects: Sequence[Effect]) -> Evidence:
    """What the search was made on, simulated from a model."""
    parts = [
        replace(r, y=simulated(r, effects, search.altering, SEED + k))
        for k, r in enumerate(records_of(search.record))
    ]
    return parts[0] if len(parts) == 1 else JointRecord(tuple(parts))


def simulated(
    record: Record, effects: Sequence[Effect], altering: Sequence[Effect], seed: int = SEED
) -> Array:
    """A record of the model on the same times and drivers, shape (n,).

    Parameters
    ----------
    record : Record
        Of which times and drivers are taken.
    effects : sequence of Effect
    altering : sequence of Effect
        Those that change samples.
    seed : int
    """
    rng = np.random.default_rng(seed)
    t = record.elapsed
    y = sum((e.simulate(t, rng, record.drive) for e in effects), np.zeros(record.n))
    for e in [*altering, *(e for e in effects if e.is_filter)]:
        y = e.apply_to(y + (e.simulate(t, rng) if e.changes_samples else 0.0), t, rng, record.drive)
    return np.asarray(y)
