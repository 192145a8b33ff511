"""What an ideal analyst thinks of the records of a moving sensor.

He knows the motion, the vibration, the catalogue, how axes, signs and directions were drawn, and how many nats the hidden
effect is worth; so its size follows. Of constants and of the local field he knows nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
from case import OBVIOUS, SI, Array, Request
from judgement import Judgement, Names
from motion import (
    AXES,
    NOISE,
    POWERS,
    RICH_ONLY,
    SIZES,
    UNIT,
    Plan,
    Run,
    alike,
    late,
    make,
    regressor,
    run_of,
    size_of,
    unexplained,
)
from scipy.special import logsumexp
from strength import penalty

LATE = ("time_delay", "bandwidth")
REGRESSORS = (
    "scale_factor",
    "scale_asymmetry",
    "nonlinearity",
    "misalignment",
    "g_sensitivity",
    "vibration_rectification",
    "scale_temperature",
    "g_squared",
)
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
    found = {"gyro": _gyro, "accel": _accel, "mag": _mag}[kind](run, r, X)
    logs: dict[Names, list[float]] = {}
    whole = 0.0
    for names, before, log in found:
        whole += before
        logs.setdefault(names, []).append(log + float(np.log(before)))
    truth = frozenset(n for h in case.hidden for n in (h.effect, *h.also))
    return Judgement(request, truth, {k: float(logsumexp(v)) - float(np.log(whole)) for k, v in logs.items()})


Found = Iterator[tuple[Names, float, float]]
"""Names that are right, how often it is hidden, and the likelihood over that without an effect [nats]."""


def _gyro(run: Run, r: Array, X: float) -> Found:
    poor = run.table.name == "poor"
    for name in (*REGRESSORS, *LATE):
        if poor and name in RICH_ONLY:
            continue
        plans = [late(run, name)] if name in LATE else list(_regressors(run, name))
        often = 2.0 if name in RICH_ONLY else 1.0  # the others are hidden in one axis of motion as often
        for plan in plans:
            size = size_of(run, plan, name, X)
            d = unexplained("gyro", run, plan.change(size) - plan.change(0.0))
            names = frozenset({name, *alike(run, plan, name, size)})
            yield names, often / len(plans), float((r * d).sum() - 0.5 * (d * d).sum())


def _regressors(run: Run, name: str) -> Iterator[Plan]:
    powers = POWERS if name == "nonlinearity" else POWERS[:1]
    for i, j, power, sign in product(run.axes, range(3), powers, (-1.0, 1.0)):
        if i != j:
            yield regressor(run, name, i, j, power, sign)


def _accel(run: Run, r: Array, X: float) -> Found:
    turn = run.table.rates.at(run.table.t, 1)
    arms = [np.cross(turn, e) + np.cross(run.rates, np.cross(run.rates, e)) for e in np.eye(3)]
    columns = np.column_stack([unexplained("accel", run, a).ravel() for a in arms])
    yield frozenset({"lever_arm"}), 1.0, _any_direction(columns, r, _sizes(run, "lever_arm", X, 3))


def _mag(run: Run, r: Array, X: float) -> Found:
    ones = [np.broadcast_to(e, r.shape) for e in np.eye(3)]
    columns = np.column_stack([unexplained("mag", run, a).ravel() for a in ones])
    yield frozenset({"hard_iron"}), 1.0, _any_direction(columns, r, _sizes(run, "hard_iron", X, 3))
    size = _sizes(run, "soft_iron", X, 6)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        both = np.zeros_like(r)
        both[:, i], both[:, j] = run.field[:, j], run.field[:, i]
        d = unexplained("mag", run, both)
        power = np.asarray((d * d).sum())
        a = float(size(power))
        yield frozenset({"soft_iron"}), 1.0 / 3.0, float(a * (r * d).sum() - 0.5 * a * a * power)
    yield (
        frozenset({"magnetic_disturbance"}),
        1.0,
        _disturbance(run, r, _sizes(run, "magnetic_disturbance", X, 3, 2)),
    )


Sizes = Callable[[Array], Array]
"""Power that an effect of size 1 adds, in variances of a sample, to its size."""


def _sizes(run: Run, name: str, X: float, ordinary: int, located: int = 0) -> Sizes:
    if X >= OBVIOUS:
        return lambda power: np.full(np.shape(power), SIZES[name])
    worth = X + penalty(run.table.t.size, ordinary, located)
    return lambda power: np.sqrt(2.0 * worth / power)


def _disturbance(run: Run, r: Array, sizes: Sizes) -> float:
    """Over its span and direction: in the navigation frame what the field leaves of it is alike in all directions."""
    t, n = run.table.t, r.shape[0]
    T = float(t[-1])
    sums = np.vstack([np.zeros(3), np.cumsum(run.attitude.apply(r), axis=0)])
    middles = (np.arange(PLACES) + 0.5) / PLACES
    t0, lasting = T * (0.15 + 0.4 * middles), T * (0.1 + 0.2 * middles)
    first = np.searchsorted(t, t0)[:, None]
    after = np.searchsorted(t, t0[:, None] + lasting)
    count = after - first
    sigma = NOISE["mag"] * SI[UNIT["mag"]]
    power = (count - count**2 / n) / sigma**2
    size = sizes(power)
    kappa = size * np.linalg.norm(sums[after] - sums[first], axis=2) / sigma
    mean = kappa + np.log(
        -np.expm1(-2.0 * kappa) / (2.0 * kappa)
    )  # of exp(kappa cos) over the sphere, its logarithm
    return float(logsumexp(mean - 0.5 * size**2 * power) - np.log(mean.size))


def _any_direction(columns: Array, r: Array, sizes: Sizes) -> float:
    """Of three signals combined in a random direction."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * k / DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * k
    v = np.column_stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])
    power = np.einsum("ki,ij,kj->k", v, columns.T @ columns, v)
    a = sizes(power)
    logs = a * (v @ (columns.T @ r.ravel())) - 0.5 * a * a * power
    return float(logsumexp(logs) - np.log(DIRECTIONS))
