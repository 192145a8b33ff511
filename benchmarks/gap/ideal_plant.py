"""What an ideal analyst thinks of the records of a plant.

He knows the plant, its input, the catalogue, how signs and numbers were drawn, and how many nats the hidden effect is
worth; so its size follows, and each hypothesis is one course of the plant. Where the plant starts he knows as well as the
model file says.
"""

from __future__ import annotations

import numpy as np
from case import Array, Request
from judgement import Judgement, Names
from plant import MACHINES, ON_POSITION, SIGNED, SIZES, START, Run, make, run_of
from scipy.special import logsumexp


def judged(request: Request, X: float) -> Judgement:
    """One record, as if what is hidden in it were worth X nats."""
    run, case = run_of(request), make(request)
    m = run.m
    y = case.channels[m.channel][0] * m.factor
    away = y - run.plain + run.J @ (np.asarray(run.start) / START) * (m.factor * m.noise)
    quiet = -0.5 * run.weighed(away)
    before = {name: _before(run, name) for name in SIZES if _before(run, name)}
    logs: dict[Names, list[float]] = {}
    for name, prior in before.items():
        kinds = _kinds(run, name)
        for sign, number in kinds:
            d = _departure(run, X, name, sign, number)
            log = -0.5 * run.weighed(away - d) - quiet + float(np.log(prior / len(kinds)))
            logs.setdefault(frozenset({name, *run.also(name, number)}), []).append(log)
    whole = float(np.log(sum(before.values())))
    truth = frozenset(n for h in case.hidden for n in (h.effect, *h.also))
    return Judgement(request, truth, {k: float(logsumexp(v)) - whole for k, v in logs.items()})


def _departure(run: Run, strength: float, name: str, sign: float, number: str) -> Array:
    size = run.size(strength, name, sign, number)
    return run.measured(run.change(name, size, sign, number)) - run.plain


def _kinds(run: Run, name: str) -> list[tuple[float, str]]:
    """Signs and numbers."""
    numbers = list(run.m.parameters) if name == "parameter_error" else [""]
    return [(sign, number) for sign in ((-1.0, 1.0) if name in SIGNED else (1.0,)) for number in numbers]


def _before(run: Run, name: str) -> float:
    """How often an effect is hidden in this plant: springs of plants without a position are hidden in the next one."""
    if name not in ON_POSITION:
        return 1.0
    if run.m.position < 0:
        return 0.0
    return 1.0 + (MACHINES[run.which - 1].position < 0)
