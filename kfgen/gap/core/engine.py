"""Finding the gap of a scene: screen every addition, fit the promising ones, compare, add, again.

The currency is that of `kfgen.gap.rest.evidence`: marginal likelihood by Laplace's method with the same
priors. What is promising says the screen, see `kfgen.gap.core.screen`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.inertial.inertial_error import free
from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import InputChange
from kfgen.effects.series import DECADES, OF_A_COEFFICIENT
from kfgen.gap.core.newton import SceneFit, coordinates, fitted, is_signed, keys_of, log_posterior
from kfgen.gap.core.scene import Integrating, Placed, Scene, ScenePoint
from kfgen.gap.core.screen import LOST, Screened, basis, freed, new_columns, screen
from kfgen.gap.rest.evidence import ABOVE, BETWEEN

Array = NDArray[np.float64]

PROMISING = 8
"""Additions that are fitted, the best of the screen."""
MOST = 10
"""Effects in one scene."""
BETTER = 1.0
"""Nats by which another name must be better to take a place."""
DETECTABLE = 8.0
"""Nats that an effect must be worth on average to be named."""
SURE = 20.0
"""Nats of an effect that nothing else resembles, with which it is not put to the test again."""
RESEMBLING = 0.2
"""Share cos^2 of a direction from which on another addition might be what an effect is."""
BLIND = 1e-6
"""Share of the information on an unknown that must be left."""


@dataclass(frozen=True)
class FittedAddition:
    """A fitted addition and its evidence over the scene without it [nats]."""

    placed: Placed
    fit: SceneFit
    gain: float
    direction: Array

    @property
    def label(self) -> tuple[str, str]:
        """Effect and place."""
        return self.placed.effect.name, self.placed.where


@dataclass(frozen=True)
class Added:
    """An addition that was kept, and the shares of all that competed for its place."""

    trial: FittedAddition
    shares: Mapping[tuple[str, str], float]
    alike: Mapping[tuple[str, str], float]


@dataclass(frozen=True)
class Explained:
    """A scene explained: the fit as it is believed, the additions, the fit with them."""

    believed: SceneFit
    added: tuple[Added, ...]
    fit: SceneFit


def explained(scene: Scene) -> Explained:
    """Add what has evidence, take out what a later addition makes superfluous, until nothing changes."""
    start = ScenePoint((), np.array([u.start for u in scene.unknowns]))
    believed = fitted(scene, start)
    added, fit, others = _grown(scene, [], believed)
    for _ in range(3):
        if len(added) < 2:
            break
        before = [a.trial.label for a in added]
        added, fit = _reconsidered(scene, added, fit, others)
        if [a.trial.label for a in added] == before:
            break
        added, fit, others = _grown(scene, added, fit)
    return Explained(believed, tuple(added), fit)


def _grown(
    scene: Scene, added: Sequence[Added], fit: SceneFit
) -> tuple[list[Added], SceneFit, Sequence[Screened]]:
    """More additions, the fit with all of them, and what was not added."""
    out, others = list(added), screen(scene, fit)
    while len(out) < MOST:
        trials = ranked(scene, fit, others)
        if not trials or trials[0].gain < ABOVE:
            break
        fit = trials[0].fit
        out = with_values([*out, _chosen(trials[0], trials)], fit)
        others = screen(scene, fit)
    return out, fit, others


def with_values(added: Sequence[Added], fit: SceneFit) -> list[Added]:
    """The additions with the values that they have in a fit of all of them."""
    pairs = zip(added, fit.point.placed)
    return [replace(a, trial=replace(a.trial, placed=p)) for a, p in pairs]


def _reconsidered(
    scene: Scene, added: Sequence[Added], fit: SceneFit, others: Sequence[Screened]
) -> tuple[list[Added], SceneFit]:
    """Each addition that is in doubt against others in its place, and against nothing."""
    doubtful = [_doubtful(added, fit, others, i) for i in range(len(added))]
    out, index = list(added), 0
    while index < len(out):
        if not doubtful[index]:
            index += 1
            continue
        rest = out[:index] + out[index + 1 :]
        placed = tuple(p for i, p in enumerate(fit.point.placed) if i != index)
        without = fitted(scene, ScenePoint(placed, fit.point.unknowns))
        same = _last(fit, index)
        known = replace(out[index].trial, placed=same.point.placed[-1], fit=same)
        trials = ranked(scene, without, screen(scene, without), known)
        if not trials or trials[0].gain < ABOVE:
            out, fit = with_values(rest, without), without
            doubtful.pop(index)
            continue
        own = next((t for t in trials if t.fit is same), None)
        keep = own if own is not None and trials[0].gain - own.gain < BETTER else trials[0]
        out, fit = with_values([*rest, _chosen(keep, trials)], keep.fit), keep.fit
        out, fit = [*out[:index], out[-1], *out[index:-1]], _last(fit, index, back=True)
        index += 1
    return out, fit


def _doubtful(added: Sequence[Added], fit: SceneFit, others: Sequence[Screened], index: int) -> bool:
    """Whether an effect may be something else, or nothing beside those that were added since."""
    if any(o.claims[index] > RESEMBLING for o in others):
        return True
    J = fit.jacobian
    mine = [c for c, (i, _) in enumerate(fit.keys) if i == index]
    unknowns = J[:, len(fit.keys) :]
    left = np.sum(freed(J[:, mine], basis(unknowns)) ** 2, axis=0)
    alone = np.sum(freed(J[:, mine], basis(np.delete(J, mine, axis=1))) ** 2, axis=0)
    kept = float((alone / np.maximum(left, 1e-300)).min(initial=1.0))
    return added[index].trial.gain * kept < SURE


def _last(fit: SceneFit, index: int, *, back: bool = False) -> SceneFit:
    """A fit with the effect at `index` put last; or the last one put there."""
    n = len(fit.point.placed)
    order = [*range(index), *range(index + 1, n), index]
    if back:
        order = [*range(index), n - 1, *range(index, n - 1)]
    place = {old: new for new, old in enumerate(order)}
    k = len(fit.keys)
    columns = sorted(range(k), key=lambda i: (place[fit.keys[i][0]], i))
    every = np.array([*columns, *range(k, fit.steps.size)], dtype=np.intp)
    return replace(
        fit,
        point=ScenePoint(tuple(fit.point.placed[i] for i in order), fit.point.unknowns),
        information=fit.information[np.ix_(every, every)],
        keys=tuple((place[fit.keys[i][0]], fit.keys[i][1]) for i in columns),
        steps=fit.steps[every],
        jacobian=fit.jacobian[:, every],
    )


def _chosen(best: FittedAddition, trials: Sequence[FittedAddition]) -> Added:
    gains = np.array([0.0, *(t.gain for t in trials)])
    weights = np.exp(gains - gains.max())
    weights /= weights.sum()
    shares: dict[tuple[str, str], float] = {("none", ""): float(weights[0])}
    for t, w in zip(trials, weights[1:].tolist()):
        shares[t.label] = shares.get(t.label, 0.0) + w
    alike: dict[tuple[str, str], float] = {}
    for t in (t for t in trials if t is not best):
        alike[t.label] = max(alike.get(t.label, 0.0), _cos2(best.direction, t.direction))
    return Added(best, shares, alike)


def _cos2(a: Array, b: Array) -> float:
    power = float((a @ a) * (b @ b))
    return float((a @ b) ** 2) / power if power > 0.0 else 0.0


def ranked(
    scene: Scene, base: SceneFit, others: Sequence[Screened], known: FittedAddition | None = None
) -> list[FittedAddition]:
    """The most promising additions, fitted, by evidence.

    Parameters
    ----------
    others : sequence of Screened
        Beside `base`, the best first.
    known : Trial, optional
        An addition that is fitted already: half as many others are held against it.
    """
    if known is not None:
        others = [o for o in others if not _alike(o.start, known.placed)]
    if not others and known is None:
        return []
    every = [o.start for o in others] + ([known.placed] if known is not None else [])
    reference = evidence(scene, base)
    trials = []
    if known is not None:
        gain = evidence(scene, known.fit) - reference - _cost(known.placed, every)
        trials.append(replace(known, gain=gain))
    for o in others[: PROMISING if known is None else PROMISING // 2]:
        if o.gain < 1.0:
            continue
        fit = _itself(scene, fitted(scene, ScenePoint((*base.point.placed, o.start), base.point.unknowns)))
        if _blind(base, fit) or _too_slow(scene, fit.point.placed[-1]):
            continue
        value = evidence(scene, fit) - reference - _cost(o.start, every)
        trials.append(FittedAddition(fit.point.placed[-1], fit, value, o.direction))
    return sorted(trials, key=lambda t: -t.gain)


def _cost(placed: Placed, every: Sequence[Placed]) -> float:
    """Nats that an addition costs: every effect at every place is as likely, and nothing; so are the ways to write one.

    Else a matrix would be likelier the more of its entries and rows are tried, and what its classes say is rare.
    """
    labels = [(p.effect.name, p.where) for p in every]
    ways = labels.count((placed.effect.name, placed.where))
    return (
        float(np.log((len(set(labels)) + 1) * max(ways, 1)))
        + placed.effect.prior_penalty_nats
        + placed.prior_penalty_nats
    )


def _alike(a: Placed, b: Placed) -> bool:
    """Whether two additions are the same but for their values: of a span, another span."""
    spans = [float(getattr(x.effect, "duration", 0.0)) > 0.0 for x in (a, b)]
    names = [{p.name for p in free(x.effect)} for x in (a, b)]
    same = type(a.effect) is type(b.effect) and a.where == b.where
    return same and spans[0] == spans[1] and names[0] == names[1]


def _too_slow(scene: Scene, placed: Placed) -> bool:
    """Whether a corner lies below the lowest frequency of the log, or what is late is later than the log is long.

    Then nothing passes, and that is another effect.
    """
    longest = scene.span[1] - scene.span[0]
    found = {p.name: p.kind for p in free(placed.effect)}
    if any(
        kind == "frequency" and float(getattr(placed.effect, n)) < 1.0 / longest for n, kind in found.items()
    ):
        return True
    plant = isinstance(placed.effect, InputChange | SensorChange)
    return plant and max(float(getattr(placed.effect, n, 0.0)) for n in ("lag", "late")) > longest


def _blind(base: SceneFit, fit: SceneFit) -> bool:
    """Whether the data no longer say what they said of the unknowns: there the simulation has diverged."""
    count = base.point.unknowns.size
    if not np.isfinite(fit.information).all():
        return True
    before, after = (np.diag(f.information)[f.information.shape[0] - count :] for f in (base, fit))
    return bool((after < BLIND * before).any())


def limits(scene: Scene, fit: SceneFit) -> list[tuple[Placed, str, float]]:
    """For each addition that is not there, the size of its first parameter that would be worth `DETECTABLE` nats.

    Of several with the same first parameter (an entry of a matrix, its row), that of the first.
    """
    Q = basis(fit.jacobian)
    out: dict[tuple[str, str, str], tuple[Placed, str, float]] = {}
    for starts in scene.candidates(fit.point.placed):
        if starts[0].effect.shrinks_with_size:
            continue  # the larger its parameter, the less it does
        effect, name = starts[0].effect, keys_of((starts[0],))[0][1]
        if (what := (effect.name, starts[0].where, name)) in out:
            continue  # alone it was looked at already: a row of a matrix begins with its first entry
        point = ScenePoint((*fit.point.placed, starts[0]), fit.point.unknowns)
        residual = scene.residuals([point])[:, 0]
        if not np.isfinite(residual).all():
            continue
        column = new_columns(scene, fit, point, residual)[:, 0]
        own = float(np.linalg.norm(freed(column, Q)))
        scale = 1.0 if is_signed(effect, name) else float(getattr(effect, name))
        if own > LOST * float(np.linalg.norm(column)):
            out[what] = starts[0], name, scale * float(np.sqrt(2.0 * DETECTABLE)) / own
    return list(out.values())


def evidence(scene: Scene, fit: SceneFit) -> float:
    """Log of the marginal likelihood of a fit, up to a constant of the scene [nats]."""
    value = log_posterior(scene, fit.residual, fit.point.unknowns)
    value -= scene.spread(fit.point) if isinstance(scene, Integrating) else 0.0
    H = fit.information
    size = H.shape[0]
    if not size:
        return value
    widths = np.ones(size)
    x = coordinates(fit.point)
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    k = len(keys_of(fit.point.placed))
    for i, (at, name) in enumerate(keys_of(fit.point.placed)):
        effect = fit.point.placed[at].effect
        if is_signed(effect, name):
            widths[i] = OF_A_COEFFICIENT * max(abs(float(x[i])), float(deviations[i]), 1e-300)
        else:
            kind = {p.name: p.kind for p in effect.parameters()}[name]
            span = max((scene.span[1] - scene.span[0]) / scene.dt, 10.0)
            widths[i] = float(np.log(span)) if kind in ("time", "frequency") else DECADES
            if kind == "time" and effect.name in BETWEEN:
                widths[i] = _width_of(scene, effect.name)
    value -= float(np.log(widths[:k]).sum()) + _searched(scene, fit.point.placed)
    # At the edge of its prior, into which the likelihood falls, a time has about one e-fold of it.
    value -= sum(float(np.log(_width_of(scene, p.effect.name))) for p in fit.point.placed if p.held)
    # What the data do not bound is bounded by its prior.
    floor = np.where(np.arange(size) < k, 2.0 * np.pi / widths**2, np.maximum(1e-12 * np.diag(H), 1e-300))
    scaled = H / np.sqrt(floor)[:, None] / np.sqrt(floor)
    values = np.maximum(np.linalg.eigvalsh(0.5 * (scaled + scaled.T)), 1.0)
    value += 0.5 * size * float(np.log(2.0 * np.pi)) - 0.5 * float(np.log(values).sum())
    return float(value - 0.5 * np.log(floor).sum())


def _box(scene: Scene, name: str) -> tuple[float, float]:
    """The shortest and the longest time [s] with which an effect is itself."""
    longest, shortest = BETWEEN[name]
    return shortest * scene.dt, longest * (scene.span[1] - scene.span[0])


def _width_of(scene: Scene, name: str) -> float:
    """Width of the prior of its logarithm."""
    lo, hi = _box(scene, name)
    return max(float(np.log(hi / lo)), 1.0)


def _itself(scene: Scene, fit: SceneFit) -> SceneFit:
    """A fit whose last effect keeps to times with which it is itself: one beyond is held at the nearest."""
    last = fit.point.placed[-1]
    if last.effect.name not in BETWEEN or last.held:
        return fit
    lo, hi = _box(scene, last.effect.name)
    times = {p.name: float(getattr(last.effect, p.name)) for p in free(last.effect) if p.kind == "time"}
    if not any(t > hi or t < lo for t in times.values()):
        return fit
    nearest = {n: min(max(t, lo), hi) for n, t in times.items()}
    held = replace(last, effect=replace(last.effect, **nearest), held=tuple(times))
    return fitted(scene, ScenePoint((*fit.point.placed[:-1], held), fit.point.unknowns))


def _searched(scene: Scene, placed: Sequence[Placed]) -> float:
    """What spans cost that were found by looking at every pair of edges, and how wide these are [nats]."""
    found = [float(getattr(p.effect, name, 0.0)) > 0.0 for p in placed for name in ("duration", "edge")]
    samples = max((scene.span[1] - scene.span[0]) / scene.dt, 2.0)
    return float(np.log(samples)) * (2.0 * sum(found[::2]) + sum(found[1::2]))
