"""What an ideal analyst thinks of the records of a plant.

He knows the plant, its input, the catalogue, how signs and numbers were drawn, and how many nats the hidden effect is
worth; so its size follows, and each hypothesis is one course of the plant. Where the plant starts he knows as well as the
model file says.
"""

from __future__ import annotations

import numpy as np
from case import Array, Case, Request
from judgement import Found, Judgement, judgement
from plant import MACHINES, ON_POSITION, SIGNED, SIZES, START, Run, make, run_of


def judged(request: Request, X: float) -> Judgement:
    """One record, as if what is hidden in it were worth X nats."""
    case = make(request)
    return judgement(request, case, _found(run_of(request), case, X))


def _found(run: Run, case: Case, X: float) -> Found:
    m = run.m
    y = case.channels[m.channel][0] * m.factor
    away = y - run.plain + run.J @ (np.asarray(run.start) / START) * (m.factor * m.noise)
    quiet = run.weighed(away)
    for name in SIZES:
        kinds = _kinds(run, name)
        for sign, number in kinds:
            left = away - _departure(run, X, name, sign, number)
            names = frozenset({name, *run.also(name, number)})
            yield names, _before(run, name) / len(kinds), 0.5 * (quiet - run.weighed(left))


def _departure(run: Run, strength: float, name: str, sign: float, number: str) -> Array:
    size = run.size(strength, name, sign, number)
    return run.measured(run.change(name, size, sign, number)) - run.plain


def _kinds(run: Run, name: str) -> list[tuple[float, str]]:
    """Signs and numbers; none of an effect that this plant cannot have."""
    if not _before(run, name):
        return []
    numbers = list(run.m.parameters) if name == "parameter_error" else [""]
    return [(sign, number) for sign in ((-1.0, 1.0) if name in SIGNED else (1.0,)) for number in numbers]


def _before(run: Run, name: str) -> float:
    """How often an effect is hidden in this plant: springs of plants without a position are hidden in the next one."""
    if name not in ON_POSITION:
        return 1.0
    if run.m.position < 0:
        return 0.0
    return 1.0 + (MACHINES[run.which - 1].position < 0)
