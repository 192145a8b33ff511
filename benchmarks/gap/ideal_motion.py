"""What an ideal analyst thinks of the records of a moving sensor.

He knows the motion, the vibration, the catalogue, how axes, signs and directions were drawn, and how many nats the hidden
effect is worth; so its size follows. Of constants and of the local field he knows nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np
from case import OBVIOUS, SI, Array, Request
from judgement import Found, Judgement, judgement
from motion import (
    AXES,
    BEGINS,
    LASTS,
    LATE,
    NOISE,
    POWERS,
    REGRESSORS,
    RICH_ONLY,
    SIZES,
    UNIT,
    Plan,
    Run,
    alike,
    disturbance,
    hard_iron,
    late,
    lever,
    make,
    regressor,
    run_of,
    size_of,
    soft_iron,
    unexplained,
)
from scipy.special import logsumexp

DIRECTIONS = 40_000
PLACES = 400
"""Times at which a disturbance may begin or end."""


def judged(request: Request, X: float) -> Judgement:
    """One record, as if what is hidden in it were worth X nats."""
    run, case = run_of(request), make(request)
    kind = case.variant.rpartition("-")[2]
    assumed = {"gyro": run.rates, "accel": run.force, "mag": run.field}[kind]
    y = np.column_stack([case.channels[f"{kind}_{a}"][0] for a in AXES]) * SI[UNIT[kind]]
    r = unexplained(kind, run, y - assumed)
    return judgement(request, case, {"gyro": _gyro, "accel": _accel, "mag": _mag}[kind](run, r, X))


def _gyro(run: Run, r: Array, X: float) -> Found:
    poor = run.table.name == "poor"
    for name in (*REGRESSORS, *LATE):
        if poor and name in RICH_ONLY:
            continue
        plans = [late(run, name)] if name in LATE else list(_regressors(run, name))
        often = 2.0 if name in RICH_ONLY else 1.0  # of the others half the cases turn about one axis
        for plan in plans:
            size = size_of(run, plan, name, X)
            names = frozenset({name, *alike(run, plan, name, size)})
            yield names, often / len(plans), _log(r, size * _unit(run, plan, size))


def _regressors(run: Run, name: str) -> Iterator[Plan]:
    powers = POWERS if name == "nonlinearity" else POWERS[:1]
    for i, j, power, sign in product(run.axes, range(3), powers, (-1.0, 1.0)):
        if i != j:
            yield regressor(run, name, i, j, power, sign)


def _unit(run: Run, plan: Plan, size: float = 1.0) -> Array:
    """What a plan of this size adds and nothing else explains, a size, in standard deviations."""
    return unexplained(plan.kind, run, plan.change(size) - plan.change(0.0)) / size


def _log(r: Array, d: Array) -> float:
    """Likelihood of a known signal over that of none [nats]."""
    return float((r * d).sum() - 0.5 * (d * d).sum())


def _accel(run: Run, r: Array, X: float) -> Found:
    plans = [lever(run, e) for e in np.eye(3)]
    yield frozenset({"lever_arm"}), 1.0, _any_direction(run, plans, r, _sizes(run, plans[0], "lever_arm", X))


def _mag(run: Run, r: Array, X: float) -> Found:
    plans = [hard_iron(run, e) for e in np.eye(3)]
    yield frozenset({"hard_iron"}), 1.0, _any_direction(run, plans, r, _sizes(run, plans[0], "hard_iron", X))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        plan = soft_iron(run, i, j)
        d = _unit(run, plan)
        size = _sizes(run, plan, "soft_iron", X)(np.asarray((d * d).sum()))
        yield frozenset({"soft_iron"}), 1.0 / 3.0, _log(r, size * d)
    plan = disturbance(run, np.eye(3)[0], 0.0, 1.0)
    sizes = _sizes(run, plan, "magnetic_disturbance", X)
    yield frozenset({"magnetic_disturbance"}), 1.0, _any_span(run, r, sizes)


Sizes = Callable[[Array], Array]
"""Power that an effect of size 1 adds, in variances of a sample, to its size."""


def _sizes(run: Run, plan: Plan, name: str, X: float) -> Sizes:
    if X >= OBVIOUS:
        return lambda power: np.full(np.shape(power), SIZES[name])
    worth = X + plan.penalty(run)
    return lambda power: np.sqrt(2.0 * worth / power)


def _any_span(run: Run, r: Array, sizes: Sizes) -> float:
    """Of a source in the room: in the navigation frame what the field leaves of it is alike in all directions."""
    t, n = run.table.t, r.shape[0]
    T = float(t[-1])
    sums = np.vstack([np.zeros(3), np.cumsum(run.attitude.apply(r), axis=0)])
    middles = (np.arange(PLACES) + 0.5) / PLACES
    t0, lasting = (T * (lo + (hi - lo) * middles) for lo, hi in (BEGINS, LASTS))
    first = np.searchsorted(t, t0)[:, None]
    after = np.searchsorted(t, t0[:, None] + lasting)
    count = after - first
    sigma = NOISE["mag"] * SI[UNIT["mag"]]
    power = (count - count**2 / n) / sigma**2
    size = sizes(power)
    kappa = size * np.linalg.norm(sums[after] - sums[first], axis=2) / sigma
    # the mean of exp(kappa cos) over the sphere is sinh(kappa) / kappa
    mean = kappa + np.log(-np.expm1(-2.0 * kappa) / (2.0 * kappa))
    return float(logsumexp(mean - 0.5 * size**2 * power) - np.log(mean.size))


def _any_direction(run: Run, plans: Sequence[Plan], r: Array, sizes: Sizes) -> float:
    """Of the plans of three axes, combined in a random direction."""
    columns = np.column_stack([_unit(run, plan).ravel() for plan in plans])
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * k / DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * k
    v = np.column_stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])
    power = np.einsum("ki,ij,kj->k", v, columns.T @ columns, v)
    a = sizes(power)
    logs = a * (v @ (columns.T @ r.ravel())) - 0.5 * a * a * power
    return float(logsumexp(logs) - np.log(DIRECTIONS))
