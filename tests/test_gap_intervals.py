"""Proves that intervals hold beside a drift that is too weak to be named.

White noise of one unit with a random walk of a quarter of it over the record, in plain numpy, and a temperature that rises and
falls. Of 60 intervals at 95 % fewer than 50 hold the truth once in a thousand times (binomial law); seeds are fixed.
"""

from __future__ import annotations

import numpy as np

from kfgen.effects import make
from kfgen.gap.rest.evidence import assumed
from kfgen.gap.rest.intervals import closed_intervals
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.interval import intervals95

N, DT, SEEDS = 4096, 0.1, 60
T = np.arange(N) * DT
KELVIN = 293.0 + 4.0 * np.sin(2.0 * np.pi * T / 300.0 + 0.5)
SIZE = 0.02


def held(walk: float) -> tuple[int, int]:
    """Of 60 records with a walk of that size over the record, by the likelihood alone and as `gap` says it."""
    plain = wider = 0
    for seed in range(SEEDS):
        rng = np.random.default_rng([171_131, seed])
        slow = np.cumsum(rng.standard_normal(N)) * walk / np.sqrt(N)
        y = rng.standard_normal(N) + slow + SIZE * (KELVIN - KELVIN.mean())
        white = make("white_noise", N=np.sqrt(DT))
        warm = make("temperature", coefficient=0.0)
        found = assumed(Record(T, y, {"temperature": KELVIN}), (white, warm), {})
        for count, ci in enumerate((intervals95, closed_intervals)):
            lo, hi = ci(found.problem, found.fit)[1, "coefficient"]
            plain, wider = plain + (count == 0 and lo < SIZE < hi), wider + (count == 1 and lo < SIZE < hi)
    return plain, wider


def test_a_drift_that_nobody_names_is_in_the_interval() -> None:
    plain, wider = held(0.25)
    assert plain < 50
    assert wider >= 50


def test_intervals_without_a_drift_are_no_wider_than_needed() -> None:
    plain, wider = held(0.0)
    assert plain >= 50
    assert plain <= wider <= plain + 5
