"""One flight: make it, let kfgen look at it, score what it says."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flight import RANDOM, SHAKEN, Effect, fly, random_course

SIZE_ROUNDS = 6
"""Flights by which the size of a random error is found."""
SIZE_TOLERANCE = 0.1
"""Relative error of its gain with which that ends."""
UNITS = {
    "accel": "m/s^2",
    "gyro": "rad/s",
    "gnss_p": "m",
    "gnss_v": "m/s",
    "mag": "T",
    "baro": "m",
    "temperature": "K",
    "current": "A",
    "throttle": "",
    "vibration": "m/s^2",
}


@dataclass(frozen=True)
class Case:
    """What is flown."""

    vehicle: str
    seed: int
    duration_s: float
    strength: float = 0.0
    effect: str = ""
    where: str = ""
    parameters: tuple[str, ...] = ()
    unlisted: str = ""
    fixed: tuple[tuple[str, float], ...] = ()
    beside: tuple[Case, ...] = ()
    """Other effects of the same flight."""

    @property
    def label(self) -> str:
        """Effect and place, as they are said."""
        return f"{self.effect} {self.where}"


@dataclass(frozen=True)
class Score:
    """What was said of a case."""

    case: Case
    verdict: str
    first: str = ""
    probability: float = 0.0
    in_set: bool = False
    set_size: int = 0
    covered: tuple[bool, ...] = ()
    findings: tuple[str, ...] = ()
    seconds: float = 0.0
    values: dict[str, float] = field(default_factory=dict)

    @property
    def is_exact(self) -> bool:
        """Whether what is said is what is hidden, no more and no less."""
        return sorted(self.findings) == sorted(c.label for c in (self.case, *self.case.beside))


def log_of(case: Case, effects: list[Effect]) -> Any:
    """A case's flight as kfgen's log."""
    from kfgen.log.log import Channel, Log

    t, channels, _ = fly(case.vehicle, case.duration_s, effects, case.seed, unlisted=case.unlisted)
    unit = {n: next(u for k, u in UNITS.items() if n.startswith(k)) for n in channels}
    return Log(t, {n: Channel.of(v, unit[n]) for n, v in channels.items()}, source="flight")


def _model() -> Any:
    from kfgen.model.build import build

    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    return build("ins15", options={"left_out": "false", "biases": "constant"}, sensors=sensors)


def _sized(case: Case) -> Effect:
    """The effect in a random direction of its parameters, as large as its strength asks for."""
    from kfgen.effects import make
    from kfgen.gap.flight.flight_scene import flight_scene
    from kfgen.gap.scene.scene import Placed, ScenePoint
    from kfgen.gap.scene.screen import basis, orthogonal_part

    scene = flight_scene(log_of(case, []), _model())
    if case.effect == SHAKEN:
        return _of_gain(case, float(np.log(2.0) / np.std(scene.path.log.drive["vibration"])))
    if case.effect in RANDOM:
        return _sized_course(case, scene)
    start = np.array([u.value for u in scene.unknowns])
    small = {"delay": 1e-2, "rate": 1e-4}
    columns = []
    for name in case.parameters:
        step = small.get(name, 1e-3)
        placed = Placed(make(case.effect, **{name: step}, **dict(case.fixed)), case.where)
        found = scene.residuals([ScenePoint((), start), ScenePoint((placed,), start)])
        columns.append((found[:, 0] - found[:, 1]) / step)
    J = orthogonal_part(np.column_stack(columns), basis(scene.of_constants))
    direction = np.random.default_rng([case.seed, 7]).standard_normal(len(columns))
    direction /= np.linalg.norm(J, axis=0)
    size = np.sqrt(2.0 * case.strength) / np.linalg.norm(J @ direction)
    return Effect(
        case.effect, case.where, dict(zip(case.parameters, (size * direction).tolist())) | dict(case.fixed)
    )


def _sized_course(case: Case, scene: Any) -> Effect:
    """A random error as large as it must be for the filter that has it to gain its strength in log-likelihood."""
    from kfgen.gap.scene.screen import basis, orthogonal_part

    unit = Effect(case.effect, case.where, {case.parameters[0]: 1.0, **dict(case.fixed)})
    path = scene.path
    course = random_course(unit, path.log.t.size, case.seed)
    du, dz = np.zeros((*path.log.u.shape, 1)), np.zeros((path.rows.t.size, 1))
    if case.where in path.equations.channels:
        du[:, path.equations.channels.index(case.where), 0] = course
    else:
        at = path.rows.of(case.where)
        dz[at, 0] = course[path.rows.at[at]]
    V = orthogonal_part(scene.ordinates(path.linear.columns(du, dz)), basis(scene.of_constants))
    size = float(np.sqrt(2.0 * case.strength) / np.linalg.norm(V))  # a course that somebody knew
    return _of_gain(case, size)


def _of_gain(case: Case, size: float) -> Effect:
    """The effect as large as it must be for the filter that has it to gain its strength, from a size nearby."""
    tried: list[tuple[float, float]] = []
    for _ in range(SIZE_ROUNDS):
        gain = max(_gain_of(case, size), 0.1)
        if abs(np.log(gain / case.strength)) < SIZE_TOLERANCE:
            break
        tried = sorted([*tried, (np.log(gain), np.log(size))])[-SIZE_ROUNDS:]
        size = float(np.exp(_size_at(np.log(case.strength), tried)))
    return Effect(case.effect, case.where, {case.parameters[0]: size, **dict(case.fixed)})


def _size_at(gain: float, tried: list[tuple[float, float]]) -> float:
    """Logarithm of the size for a logarithm of a gain: between what was tried, or by a gain that grows with the square."""
    gains, sizes = np.array(tried).T
    if gains[0] < gain < gains[-1]:
        return float(np.interp(gain, gains, sizes))
    k = int(np.argmin(np.abs(gains - gain)))
    return float(sizes[k] + 0.5 * np.clip(gain - gains[k], -2.0, 2.0))


def _gain_of(case: Case, size: float) -> float:
    """What the filter with the random error gains on its flight over the filter without it [nats]."""
    from kfgen.effects import make
    from kfgen.gap.flight.flight_scene import flight_scene
    from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
    from kfgen.gap.flight.random.random_error import random_error_of
    from kfgen.gap.scene.newton import fitted
    from kfgen.gap.scene.scene import Placed, start_of

    values = {case.parameters[0]: size, **dict(case.fixed)}
    scene = flight_scene(log_of(case, [Effect(case.effect, case.where, values)]), _model())
    assert scene is not None
    # About the field that the flight shows: else a random error takes up the error of the one that was aligned.
    path = scene.about(fitted(scene, start_of(scene)).point).path
    linear = path.linear
    if case.effect == SHAKEN:
        shake = path.log.drive["vibration"]
        courses = {case.where: np.exp(size * (shake - np.mean(shake)))}
        return float(path.log_likelihood_with(NoiseSizes(courses=courses)) - linear.log_likelihood)
    error = random_error_of(Placed(make(case.effect, **values), case.where), scene.path.log.dt)
    return float(linear.with_random_error(error).filtered().log_likelihood - linear.log_likelihood)


def run(case: Case) -> Score:
    """Fly, ask, score."""
    from kfgen.core.errors import KfgenError
    from kfgen.gap.find_gap import find_gap

    warnings.simplefilter("ignore")
    effects = [_sized(c) for c in (case, *case.beside)] if case.effect else []
    log = log_of(case, effects)
    begun = time.perf_counter()
    try:
        found = find_gap(log, _model())
    except KfgenError as error:
        return Score(case, f"error: {error}", seconds=time.perf_counter() - begun)
    seconds = time.perf_counter() - begun
    findings = tuple(f"{f.name} {f.where}" for f in found.findings)
    values = dict(effects[0].values) if effects else {}
    if not found.findings:
        return Score(case, found.verdict, seconds=seconds, values=values)
    top = found.findings[0]
    printed = {(top.name, top.where), *((e, w) for e, w, p in top.alternatives if p > 0.05)}
    meant = {(case.effect, case.where)}
    covered = ()
    if (top.name, top.where) in meant:
        pairs = [(values[n], top.ci95[n]) for n in case.parameters if n in top.ci95]
        covered = tuple(bool(lo <= v <= hi) for v, (lo, hi) in pairs)
    return Score(
        case, found.verdict, findings[0], top.probability, bool(meant & printed), len(printed), covered, findings,
        seconds, values,
    )  # fmt: skip
