"""How far two explanations of a record are apart, and what would tell them apart.

If the first is right, the log-likelihood is expected to stand above that of the second by their divergence, the sum over
the record's ordinates of ``(S_a / S_b - 1 - ln S_a / S_b) / 2`` and of half the square of the difference of what each
expects, whitened by the second [1]_. What is stationary grows with the length of the record.

References
----------
.. [1] S. Kullback and R. A. Leibler, On information and sufficiency, Annals of Mathematical Statistics 22(1), 1951.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfgen.effects import Effect, effect_named
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.evidence import Candidate
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Record

TOLD = 3.0
"""Nats at which two names are told apart: twenty to one."""
ENDLESS = 1000.0
"""Times the length of a record beyond which nobody logs."""


@dataclass(frozen=True)
class Distinguishability:
    """Another name for what was found.

    Parameters
    ----------
    other : str
    cos2 : float
        Squared cosine between the two in this record: one where nothing tells them apart.
    nats : float
        By which this record is expected to tell them apart.
    """

    other: str
    cos2: float
    nats: float

    @property
    def longer(self) -> float:
        """How many times as long a record would tell them apart, if both are stationary."""
        return max(1.0, TOLD / max(self.nats, 1e-9))

    def words(self, named: type[Effect]) -> str:
        """The other name, and what would tell."""
        ways = [f"a record {self.longer:.2g} times as long"] if 1.0 < self.longer < ENDLESS else []
        known = (
            named.separating_experiment or effect_named(self.other).separating_experiment
            if self.other != "retune"
            else ""
        )
        ways += [known] if known else []
        told = f", told apart by {' or '.join(ways)}" if ways else ""
        return f"{self.other} (cos2 {self.cos2:.2f}{told})"


def apart(named: Candidate, other: Candidate, nothing: Candidate) -> Distinguishability:
    """How far what was named is from another candidate, beside none."""
    nats, whole = divergence(named, other), divergence(named, nothing)
    return Distinguishability(other.name, float(np.clip(1.0 - nats / max(whole, 1e-12), 0.0, 1.0)), nats)


def divergence(a: Candidate, b: Candidate) -> float:
    """Nats by which the record is expected to prefer `a`, if it is right."""
    return sum(_between(a, b, record) for record in records_of(a.problem.record))


def _between(a: Candidate, b: Candidate, record: Record) -> float:
    wa, wb = (Whitener.of(c.fit.effects, record.n, record.dt).weight[1:] for c in (a, b))
    ratio = np.maximum(np.divide(wb, wa, out=np.ones_like(wa), where=(wa > 0.0) & (wb > 0.0)), 1e-9) ** 2
    between = record.drift(a.fit.effects) - record.drift(b.fit.effects)
    X = Whitener.of(b.fit.effects, record.n, record.dt).ordinates(between)
    return float(0.5 * np.sum(ratio - 1.0 - np.log(ratio)) + 0.5 * X @ X)
