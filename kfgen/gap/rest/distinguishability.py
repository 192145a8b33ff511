"""How far two explanations of a record are apart, and what would distinguish them.

If the first is right, the log-likelihood is expected to stand above that of the second by their divergence, the sum over
the record's ordinates of ``(S_a / S_b - 1 - ln S_a / S_b) / 2`` and of half the square of the difference of what each
expects, whitened by the second [1]_. What is stationary grows with the length of the record.

References
----------
.. [1] S. Kullback and R. A. Leibler, On information and sufficiency, Annals of Mathematical Statistics 22(1), 1951.
"""

from __future__ import annotations

import numpy as np

from kfgen.gap.core.search import Distinguishability
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.evidence import Candidate
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Record


def distinguishability(named: Candidate, other: Candidate, nothing: Candidate) -> Distinguishability:
    """How far what was named is from another candidate.

    Parameters
    ----------
    named, other : Candidate
        Fitted to the same record.
    nothing : Candidate
        The model with neither.
    """
    nats, whole = divergence(named, other), divergence(named, nothing)
    cos2 = float(np.clip(1.0 - nats / max(whole, 1e-12), 0.0, 1.0))
    return Distinguishability(other.name, "", cos2, nats)


def divergence(a: Candidate, b: Candidate) -> float:
    """Nats by which the record is expected to prefer `a`, if it is right.

    Parameters
    ----------
    a, b : Candidate
        Fitted to the same record.
    """
    return sum(_between(a, b, record) for record in records_of(a.problem.record))


def _between(a: Candidate, b: Candidate, record: Record) -> float:
    wa, wb = (Whitener.on(record, c.fit.effects).weight[1:] for c in (a, b))
    ratio = np.maximum(np.divide(wb, wa, out=np.ones_like(wa), where=(wa > 0.0) & (wb > 0.0)), 1e-9) ** 2
    between = record.drift(a.fit.effects) - record.drift(b.fit.effects)
    X = Whitener.on(record, b.fit.effects).ordinates(between)
    return float(0.5 * np.sum(ratio - 1.0 - np.log(ratio)) + 0.5 * X @ X)
