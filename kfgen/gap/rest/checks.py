"""Three checks of every addition: it nests the believed model, the log shows it, and it is found again.

The last simulates a record from the mended model, with the log's own time and drivers, and looks for the
gap between that and what was believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.gap.rest.search import RETUNE, Search, grown
from kfgen.identify.evidence.joint import JointRecord, records_of
from kfgen.identify.evidence.record import Evidence, Record

Array = NDArray[np.float64]

SEED = 1
LONG = 200_000
"""Samples beyond which no record is simulated."""
SAME = 1e-6
"""Nats by which a model without the addition's size may differ from the believed one."""


@dataclass(frozen=True)
class Checks:
    """What the checks gave.

    Parameters
    ----------
    nested : float
        Largest change of log-likelihood when an addition's size is taken to zero [nats].
    seen : dict of str to bool
        Whether the interval of each addition's size leaves zero out.
    again : tuple of str, optional
        What was found in a record simulated from the mended model; None where none was simulated.
    named : tuple of str
        What the mended model adds.
    """

    nested: float
    seen: dict[str, bool]
    again: tuple[str, ...] | None
    named: tuple[str, ...] = ()

    @property
    def words(self) -> list[str]:
        """Sentences."""
        out = [
            "without its size each addition gives back the believed likelihood"
            if self.nested < SAME
            else f"without its size an addition changes the likelihood by {self.nested:.2g} nats"
        ]
        hidden = [n for n, ok in self.seen.items() if not ok]
        out.append(
            f"this log does not bound the size of {', '.join(hidden)} away from zero"
            if hidden
            else "the interval of every addition's size leaves zero out: this log shows it"
        )
        if self.again is None:
            out.append("no record was simulated from the mended model: the log is long")
        else:
            found = ", ".join(self.again) or "nothing"
            said = f"in a record simulated from the mended model the same search finds {found}"
            same = sorted(self.again) == sorted(self.named)
            out.append(said if same else f"{said}, not {', '.join(self.named)}: take the names with care")
        return out


def checks_of(
    search: Search, effects: Sequence[Effect], ci95: Sequence[tuple[str, str, float, float]]
) -> Checks:
    """The checks of a finished search.

    Parameters
    ----------
    effects : sequence of Effect
        Of the mended model, fitted.
    ci95 : sequence of (effect, parameter, lo, hi)
        Intervals of what was added.
    """
    seen: dict[str, bool] = {}
    for name, _, lo, hi in ci95:
        seen[name] = seen.get(name, False) or lo > 0.0 or hi < 0.0
    again = None
    if search.record.n <= LONG:
        found = grown(replace(search, record=_simulated_again(search, effects), chosen=(), known=()))
        again = tuple(c.name for c in found.chosen if c.name != RETUNE)
    named = tuple(c.name for c in search.chosen if c.name != RETUNE)
    return Checks(_nested(search, effects), seen, again, named)


def _nested(search: Search, effects: Sequence[Effect]) -> float:
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
        value = search.record.likelihood(both).log_likelihood(both, zeros).value
        worst = max(worst, abs(value - base))
    return worst


def _without_size(effect: Effect) -> Effect | None:
    sizes = effect.sizes()
    return replace(effect, **dict.fromkeys(sizes, 0.0)) if sizes and not effect.is_filter else None


def _simulated_again(search: Search, effects: Sequence[Effect]) -> Evidence:
    """What the search was made on, simulated from a model."""
    parts = [
        replace(r, y=simulated(r, effects, search.altering, SEED + k))
        for k, r in enumerate(records_of(search.record))
    ]
    return parts[0] if len(parts) == 1 else JointRecord(tuple(parts))


def simulated(
    record: Record, effects: Sequence[Effect], altering: Sequence[Effect], seed: int = SEED
) -> Array:
    """A record of the model on the same times and drivers, shape (n,)."""
    rng = np.random.default_rng(seed)
    t = record.elapsed
    y = sum((e.simulate(t, rng, record.drive) for e in effects), np.zeros(record.n))
    for e in [*altering, *(e for e in effects if e.is_filter)]:
        y = e.apply_to(y + (e.simulate(t, rng) if e.changes_samples else 0.0), t, rng, record.drive)
    return np.asarray(y)
