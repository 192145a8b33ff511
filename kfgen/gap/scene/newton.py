"""Fitting a scene: damped Gauss-Newton steps in the effects' parameters and the world's unknowns.

Signed parameters are fitted as they are, positive ones in their logarithm.

References
----------
.. [1] D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, SIAM J. 11(2), 1963.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from kfgen.core.time_budget import fit_is_over
from kfgen.gap.scene.posterior import levels_of, log_posterior, over_levels, pulls, weights
from kfgen.gap.scene.scene import (
    Key,
    Scene,
    ScenePoint,
    coordinates,
    has_several_maxima,
    in_logarithms,
    keys_of,
    moved,
)

Array = NDArray[np.float64]

MAX_NEWTON_STEPS = 15
CLIMBS_KEPT = ((4, 2), (2, 3), (0, 100))
"""Steps after which no more than so many of the fits from several starts go on."""
SAME_PLACE_SD = 0.3
"""Norm of the difference of the residuals of two fits, in standard deviations, below which they are at the same place."""
DAMPING_FACTORS = (1.0, 1e2, 1e4, 1e6)
"""By which the damping of a step is tried larger."""
GAIN_TOLERANCE_NATS = 3e-3
"""Gain [nats] below which the maximum is reached."""
GAIN_TOLERANCE_SHARE = 1e-5
"""Or this share of what the fit gained in all."""
TRIAL_TOLERANCE_TIMES = 10.0
"""By how much coarser the maximum of a trial is, which is fitted again where it is chosen."""
DIFFERENCE_STEP_SD = 0.1
"""Change of the residuals [standard deviations] by which they are differentiated."""
MAX_RELATIVE_STEP = 1e12
"""Largest relative change where nothing shows it."""
MAX_LOG_STEP = 1.0
"""Longest step in a logarithm."""
MAX_LINEAR_LOG_STEP = 0.1
"""Step in a logarithm from which on it is no longer one in the number itself."""
MIN_INFORMATION_SHARE = 1e-12
"""Information along a direction, over that of single coordinates, below which there is none."""


@dataclass(frozen=True)
class SceneFit:
    """A scene at its best point.

    Parameters
    ----------
    point : Point
    residual : ndarray, shape (N,)
    levels : ndarray, shape (channels,)
        Standard deviation of each channel's noise, in assumed ones.
    value : float
        Log-likelihood plus log prior.
    information : ndarray, shape (p, p)
        Of parameters and unknowns, in that order.
    keys : tuple of Key
        The parameters: index of the effect, name.
    steps : ndarray, shape (p,)
        By which residuals are differentiated.
    jacobian : ndarray, shape (N, p)
        Of the residuals over their levels.
    """

    point: ScenePoint
    residual: Array
    levels: Array
    value: float
    information: Array
    keys: tuple[Key, ...]
    steps: Array
    jacobian: Array

    @property
    def covariance(self) -> Array:
        """Of parameters and unknowns; very wide along what the data say nothing of."""
        scale = np.sqrt(np.maximum(np.diag(self.information), 1e-200))
        values, vectors = np.linalg.eigh(self.information / np.outer(scale, scale))
        inverse = (vectors / np.maximum(values, MIN_INFORMATION_SHARE)) @ vectors.T
        return np.asarray(inverse / np.outer(scale, scale))


def derivative(scene: Scene, point: ScenePoint, residual: Array, steps: Array) -> tuple[Array, Array]:
    """Jacobian of the residuals, shape (N, p), and steps that make it visible, shape (p,).

    Parameters
    ----------
    scene : Scene
    point : ScenePoint
    residual : ndarray, shape (N,)
        There.
    steps : ndarray, shape (k + q,)
        Differences of the coordinates from which it begins.
    """
    if not steps.size:
        return np.zeros((residual.size, 0)), steps
    (found,) = _derivatives(scene, [point], [steps])
    return found


def _derivatives(
    scene: Scene, points: Sequence[ScenePoint], steps: Sequence[Array]
) -> list[tuple[Array, Array]]:
    """The same of several points of the same effects."""
    steps, change = [h.copy() for h in steps], [np.empty((0, 0))] * len(points)
    asked = {j: np.arange(h.size) for j, h in enumerate(steps)}
    for is_last in (False, False, True):
        for j, moves in zip(asked, _changes(scene, points, steps, asked)):
            if change[j].size:
                change[j][:, asked[j]] = moves
            else:
                change[j] = moves
        better = {j: _better_steps(points[j], steps[j], change[j]) for j in asked if not is_last}
        asked = {j: np.flatnonzero(h != steps[j]) for j, h in better.items() if (h != steps[j]).any()}
        for j in asked:
            steps[j] = better[j]
        if not asked:
            break
    return [(np.asarray(c / h), h) for c, h in zip(change, steps)]


def _changes(
    scene: Scene,
    points: Sequence[ScenePoint],
    steps: Sequence[Array],
    asked: Mapping[int, NDArray[np.intp]],
) -> list[Array]:
    """How far residuals move when coordinates move by their steps, of the points that are asked for, each of shape (N, k)."""
    every: list[ScenePoint] = []
    for j, which in asked.items():
        x = coordinates(points[j])
        # The point itself once more: a simulation is as fine as all its columns ask for.
        every += [points[j], *(moved(points[j], x + steps[j] * e) for e in np.eye(x.size)[which])]
    ends = np.cumsum([1 + which.size for which in asked.values()])[:-1]
    return [R[:, 1:] - R[:, :1] for R in np.split(scene.residuals(every), ends, axis=1)]


def _better_steps(point: ScenePoint, steps: Array, change: Array) -> Array:
    """Steps that move the residuals visibly and not far; the same where these do."""
    size = np.linalg.norm(change, axis=0)
    good = (size > 0.01 * DIFFERENCE_STEP_SD) & (size < 100.0 * DIFFERENCE_STEP_SD)
    if good.all():
        return steps
    better = steps * np.clip(DIFFERENCE_STEP_SD / np.maximum(size, 1e-12), 1e-8, 1e8)
    better = np.minimum(better, MAX_RELATIVE_STEP * np.maximum(np.abs(coordinates(point)), 1.0))
    logs = in_logarithms(point)
    better[: logs.size][logs] = np.minimum(better[: logs.size][logs], 0.05)
    return np.where(good, steps, better)


def first_steps(point: ScenePoint) -> Array:
    """Steps to begin with, shape (p,)."""
    x = coordinates(point)
    return np.asarray(1e-5 * np.maximum(np.abs(x), 1e-3))


@dataclass(frozen=True)
class _Climb:
    """A fit on its way: where it is, the steps of its derivatives, these at the point before, what the last step gained.

    Its tolerance is `coarse` times that of others, and it ends where it cannot come to `least`.
    """

    point: ScenePoint
    residual: Array
    value: float
    begun: float
    steps: Array
    damping: float = 1e-6
    gain: float = np.inf
    jacobian: Array = field(default_factory=lambda: np.zeros((0, 0)))
    coarse: float = 1.0
    least: float = -np.inf

    @property
    def ends(self) -> bool:
        """Whether its last step gained as good as nothing."""
        tolerance = max(GAIN_TOLERANCE_NATS, GAIN_TOLERANCE_SHARE * (self.value - self.begun))
        return self.gain < self.coarse * tolerance


def fitted(scene: Scene, start: ScenePoint, steps: Array | None = None) -> SceneFit:
    """The scene at its best point, from a start.

    Parameters
    ----------
    scene : Scene
    start : ScenePoint
        Where the fit begins.
    steps : ndarray, shape (k + q,), optional
        Differences by which coordinates are varied.
    """
    begun = _begun(scene, start, scene.residuals([start])[:, 0], steps)
    return _end(scene, _climbed(scene, [begun]))


def fitted_from(
    scene: Scene, starts: Sequence[ScenePoint], near: SceneFit, least: float | None = None
) -> SceneFit:
    """The same from several starts: from the likeliest; where a fit may end at another maximum, from all of them at once.

    Parameters
    ----------
    scene : Scene
    starts : sequence of ScenePoint
        With the same effects at the same places.
    near : SceneFit
        With an effect more or fewer: what both have is varied by the same differences.
    least : float, optional
        Of a trial, whose maximum may be coarse: the log-posterior that it must come to, else it ends.
    """
    found = scene.residuals(starts).T
    climbs = [_begun(scene, s, residual, _steps_of(near, s)) for s, residual in zip(starts, found)]
    if least is not None:
        climbs = [replace(c, least=least, coarse=TRIAL_TOLERANCE_TIMES) for c in climbs]
    return _end(scene, _climbed(scene, climbs if has_several_maxima(scene) else [max(climbs, key=_likely)]))


def _steps_of(near: SceneFit, start: ScenePoint) -> Array:
    """The steps of a fit for the coordinates that a point has as well, shape (p,)."""
    own = near.point.placed
    known = {(own[i].effect.name, own[i].where, n): h for (i, n), h in zip(near.keys, near.steps.tolist())}
    steps, keys = first_steps(start), keys_of(start.placed)
    for c, (i, n) in enumerate(keys):
        steps[c] = known.get((start.placed[i].effect.name, start.placed[i].where, n), steps[c])
    steps[len(keys) :] = near.steps[len(near.keys) :]
    return steps


def _begun(scene: Scene, start: ScenePoint, residual: Array, steps: Array | None = None) -> _Climb:
    """A fit before its first step."""
    value = log_posterior(scene, residual, start.unknowns)
    return _Climb(start, residual, value, value, first_steps(start) if steps is None else steps)


def _climbed(scene: Scene, climbs: Sequence[_Climb]) -> _Climb:
    """The best of some fits, after all their steps."""
    for done in range(MAX_NEWTON_STEPS):
        climbs = _promising(climbs, done)
        there = [c for c in climbs if c.ends]
        climbs = [*there, *_advanced(scene, [c for c in climbs if not c.ends])]
        if all(c.ends for c in climbs) or fit_is_over():
            break
    return max(climbs, key=_likely)


def _likely(climb: _Climb) -> float:
    return climb.value if np.isfinite(climb.value) else -np.inf


def _promising(climbs: Sequence[_Climb], done: int) -> list[_Climb]:
    """Those that are high enough after so many steps to be the highest at the end, each place once.

    What cannot come high enough ends where it is.
    """
    best = sorted(climbs, key=_likely, reverse=True)[: next(k for n, k in CLIMBS_KEPT if done >= n)]
    out: list[_Climb] = []
    for c in best:
        left = c.gain * (MAX_NEWTON_STEPS - done) if done >= CLIMBS_KEPT[1][0] else np.inf
        same = any(float(np.linalg.norm(c.residual - o.residual)) < SAME_PLACE_SD for o in out)
        if not out or (not same and (done < CLIMBS_KEPT[0][0] or c.value + left > out[0].value)):
            out.append(c if c.value + left >= c.least else replace(c, gain=0.0))
    return out


def _advanced(scene: Scene, climbs: Sequence[_Climb]) -> list[_Climb]:
    """Each after one step more, its derivatives at the point before."""
    if not climbs:
        return []
    if not climbs[0].steps.size:
        return [replace(c, gain=0.0, jacobian=np.zeros((c.residual.size, 0))) for c in climbs]
    climbs = [
        replace(c, jacobian=over_levels(scene, J, levels_of(scene, c.residual)), steps=steps)
        for c, (J, steps) in zip(
            climbs, _derivatives(scene, [c.point for c in climbs], [c.steps for c in climbs])
        )
    ]
    tried = [_tried(c.point, *_slope(scene, c), c.damping) for c in climbs]
    every = [[p for points in of_one for p in points] for of_one in tried]
    found = np.split(scene.residuals([*chain(*every)]), np.cumsum([*map(len, every)])[:-1], axis=1)
    return [_stepped(scene, c, points, left) for c, points, left in zip(climbs, tried, found)]


def _end(scene: Scene, climb: _Climb) -> SceneFit:
    """What was reached, with the derivatives there."""
    point, residual, J, steps = climb.point, climb.residual, climb.jacobian, climb.steps
    levels = levels_of(scene, residual)
    # Where the last step gained next to nothing the derivatives are those of the point, or of one that is as good.
    if climb.gain > climb.coarse * GAIN_TOLERANCE_NATS:
        J, steps = derivative(scene, point, residual, steps)
        J = over_levels(scene, J, levels)
    keys = keys_of(point.placed)
    return SceneFit(point, residual, levels, climb.value, _information(scene, J, len(keys)), keys, steps, J)


def _information(scene: Scene, J: Array, k: int) -> Array:
    H = J.T @ J
    H[np.arange(k, H.shape[0]), np.arange(k, H.shape[0])] += weights(scene) ** 2
    return np.asarray(H)


def _slope(scene: Scene, climb: _Climb) -> tuple[Array, Array]:
    """Gradient, shape (p,), and information, shape (p, p), of the sum of squares at a point."""
    J, k = climb.jacobian, len(keys_of(climb.point.placed))
    g = J.T @ over_levels(scene, climb.residual, levels_of(scene, climb.residual))
    g[k:] += pulls(scene, climb.point.unknowns) * weights(scene)
    return g, _information(scene, J, k)


def _tried(point: ScenePoint, g: Array, H: Array, damping: float) -> list[list[ScenePoint]]:
    """Where a step may lead, with each of several dampings, the smallest first."""
    x, logs = coordinates(point), in_logarithms(point)
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    K = H / np.outer(scale, scale)
    tried = []
    for factor in DAMPING_FACTORS:
        damped = K + damping * factor * np.eye(x.size)
        d = np.linalg.lstsq(damped, -g / scale, rcond=1e-13)[0] / scale
        tried.append([moved(point, x + step) for step in _ways(d, logs)])
    return tried


def _stepped(scene: Scene, climb: _Climb, by_damping: Sequence[Sequence[ScenePoint]], found: Array) -> _Climb:
    """After the step that raises the posterior most; where none does, at the same place, its next one damped."""
    tried = [p for points in by_damping for p in points]
    values = [log_posterior(scene, found[:, j], p.unknowns) for j, p in enumerate(tried)]
    best = int(np.argmax(values))
    if not values[best] > climb.value:
        return replace(climb, gain=0.0, damping=min(climb.damping * 1e3, 1.0))
    least = best < len(by_damping[0])
    return replace(
        climb,
        point=tried[best],
        residual=found[:, best],
        value=values[best],
        gain=values[best] - climb.value,
        damping=max(climb.damping * (1e-1 if least else 1e1), 1e-9),
    )


def _ways(d: Array, logs: NDArray[np.bool_]) -> list[Array]:
    """A step, shape (p,), of whose first coordinates some are logarithms: in these, and in the numbers themselves.

    The first is shortened where it is long, everything by the same share. In the second a number grows or shrinks as
    a step of its own would have it, and all else goes its whole way: from a time that is far too short or long only
    this way goes on, for the unknowns that make up for it go in proportion to the time and not to its logarithm.
    """
    along = d[: logs.size][logs]
    largest = float(np.abs(along).max(initial=0.0))
    shortened = d * min(1.0, MAX_LOG_STEP / max(largest, 1e-300))
    if largest <= MAX_LINEAR_LOG_STEP:
        return [shortened]
    straight = d.copy()
    straight[: logs.size][logs] = np.log1p(np.maximum(along, np.expm1(-2.0 * MAX_LOG_STEP)))
    return [shortened, straight]
