"""The thresholds of every world of the gap, each once.

Evidence is a difference of logarithms of marginal likelihoods, in nats: 3 nats are twenty to one.
"""

from __future__ import annotations

from dataclasses import dataclass

MIN_EVIDENCE_NATS = 3.0
"""Evidence above which one more effect is named."""
MIN_FIRST_EVIDENCE_NATS = 1.0
"""Evidence above which a first effect is named; choosing it is paid for already. At rest, of 200 records without a gap
one reached 1.43 nats, one 0.11, all others less than zero; in motion and in plants the best of 53 was 1.8 below zero."""
TIE_NATS = 1.0
"""Evidence by which another name must be better to take the place of the one that stands."""
MAX_PROBABILITY_BESIDE_MISFIT = 0.9
"""Of an effect in a model that still leaves more than noise: its likelihood is not the truth then."""
MAX_PROBABILITY_OF_STAND_IN = 0.2
"""Of an effect whose course is none of its kind: in 899 records of effects of the catalogue 9 of 13 such names were right, in
299 of what it does not hold none of 227; where one record of twenty is of the latter a fifth of them is right."""
DETECTION_LIMIT_NATS = 8.0
"""Expected gain of log-likelihood of an effect that is named at its detection limit."""
CONFUSION_SET_MIN_PROBABILITY = 0.14
"""Probability above which another name belongs to what cannot be distinguished: about one in seven. Of 263 sets of records and
recordings at rest 258 hold the truth, with 1.32 names in the mean; with all above 10 % the same 258, and 1.42."""
NOTHING_MIN_PROBABILITY = 0.05
"""Probability that nothing is missing, above which it is said beside a name."""
NEARLY_ALIKE_MIN_COS2 = 0.95
"""Squared cosine above which an effect that is ruled out is still said to look alike."""
MAX_ITERATIONS = 3
"""Times that the whole list of effects is gone through again."""


@dataclass(frozen=True)
class SearchLimits:
    """When a search names an effect, and when it ends.

    Parameters
    ----------
    max_effects : int
        Beyond, what is missing is no list of effects.
    min_first_evidence_nats : float
        Evidence above which the first effect is named [nats].
    min_evidence_nats : float
        Evidence above which one more is named, and below which one is removed again [nats].
    tie_nats : float
        Evidence by which another name must be better to take a place [nats].
    max_iterations : int
        Times that the whole list is gone through again.
    first_counts_rivals : bool
        Whether a first effect is named where all that might be it are likelier together than nothing.
    """

    max_effects: int
    min_first_evidence_nats: float = MIN_FIRST_EVIDENCE_NATS
    min_evidence_nats: float = MIN_EVIDENCE_NATS
    tie_nats: float = TIE_NATS
    max_iterations: int = MAX_ITERATIONS
    first_counts_rivals: bool = False
