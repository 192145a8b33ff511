"""Fitting a scene: damped Gauss-Newton steps in the effects' parameters and the world's unknowns.

Signed parameters are fitted as they are, positive ones in their logarithm. Each channel's noise may be
louder or quieter than assumed: its level has a log-normal prior of `NOISE_LEVEL_SD_OF_LOG` and is profiled out, so that a
noise of the wrong size is no evidence for anything else.

References
----------
.. [1] D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, SIAM J. 11(2), 1963.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.time_budget import fit_is_over
from kfgen.effects import Effect
from kfgen.effects.inertial.inertial_error import free
from kfgen.gap.scene.scene import HasOwnNoiseLevels, Placed, Scene, ScenePoint

Array = NDArray[np.float64]

NOISE_LEVEL_SD_OF_LOG = 0.1
"""Standard deviation of the logarithm of a channel's noise level."""
MAX_NEWTON_STEPS = 15
MAX_LEVEL_STEPS = 30
LEVEL_TOLERANCE = 1e-14
"""Step of the logarithm of a noise level at which it is found."""
GAIN_TOLERANCE_NATS = 3e-3
"""Gain [nats] below which the maximum is reached."""
GAIN_TOLERANCE_SHARE = 1e-5
"""Or this share of what the fit gained in all."""
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

Key = tuple[int, str]


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


def keys_of(placed: Sequence[Placed]) -> tuple[Key, ...]:
    """The parameters that are fitted."""
    return tuple((i, p.name) for i, x in enumerate(placed) for p in free(x.effect) if p.name not in x.held)


def is_signed(effect: Effect, name: str) -> bool:
    """Whether a parameter is fitted as it is, and not in its logarithm.

    Parameters
    ----------
    effect : Effect
    name : str
        Of its parameter.
    """
    return {p.name: p.kind for p in effect.parameters()}[name] == "signed"


def coordinates(point: ScenePoint) -> Array:
    """Parameters and unknowns as they are fitted, shape (p,)."""
    x = []
    for i, name in keys_of(point.placed):
        value = float(getattr(point.placed[i].effect, name))
        x.append(value if is_signed(point.placed[i].effect, name) else float(np.log(max(value, 1e-300))))
    return np.concatenate([np.array(x), point.unknowns])


def moved(point: ScenePoint, x: Array) -> ScenePoint:
    """The point at these coordinates.

    Parameters
    ----------
    point : ScenePoint
    x : ndarray, shape (k + q,)
        Coordinates of the effects' parameters, then the unknowns [SI].
    """
    placed, keys = list(point.placed), keys_of(point.placed)
    for (i, name), v in zip(keys, x.tolist()):
        value = v if is_signed(placed[i].effect, name) else float(np.exp(min(v, 690.0)))
        placed[i] = replace(placed[i], effect=replace(placed[i].effect, **{name: value}))
    return ScenePoint(tuple(placed), np.asarray(x[len(keys) :]))


def level_sd_of_log(scene: Scene) -> float:
    """Standard deviation of the logarithm of a channel's noise level, before the log."""
    return scene.noise_level_sd_of_log if isinstance(scene, HasOwnNoiseLevels) else NOISE_LEVEL_SD_OF_LOG


def levels_of(scene: Scene, residual: Array) -> Array:
    """The most likely level of each channel's noise, shape (channels,).

    Parameters
    ----------
    scene : Scene
    residual : ndarray, shape (N,)
        In standard deviations of the assumed noise.
    """
    out, sd = [], level_sd_of_log(scene)
    for part, n in zip(np.split(residual, np.cumsum(scene.lengths)[:-1]), scene.lengths):
        power, s = float(part @ part), 1.0
        for _ in range(MAX_LEVEL_STEPS):  # Newton's in ln s of n ln s + power / 2 s^2 + (ln s)^2 / 2 sd^2
            slope = n - power / s**2 + math.log(s) / sd**2
            step = -slope / (2.0 * power / s**2 + 1.0 / sd**2)
            s *= math.exp(min(max(step, -1.0), 1.0))
            if abs(step) < LEVEL_TOLERANCE:
                break
        out.append(s)
    return np.array(out)


def log_posterior(scene: Scene, residual: Array, unknowns: Array) -> float:
    """Log-likelihood with the levels at their best, plus the log prior of the unknowns [nats].

    Parameters
    ----------
    scene : Scene
    residual : ndarray, shape (N,)
        In standard deviations of the assumed noise.
    unknowns : ndarray, shape (q,)
        [SI].
    """
    levels, sd = levels_of(scene, residual), level_sd_of_log(scene)
    value = 0.0
    parts = np.split(residual, np.cumsum(scene.lengths)[:-1])
    for part, n, s in zip(parts, scene.lengths, levels.tolist()):
        value -= n * float(np.log(s)) + 0.5 * float(part @ part) / s**2 + 0.5 * (np.log(s) / sd) ** 2
    return value - 0.5 * float(np.sum(_pulls(scene, unknowns) ** 2))


def _pulls(scene: Scene, unknowns: Array) -> Array:
    """How far unknowns are from what is assumed about them, in standard deviations."""
    values = np.array([u.value for u in scene.unknowns])
    return np.asarray((unknowns - values) * _weights(scene))


def _weights(scene: Scene) -> Array:
    return np.array([0.0 if not np.isfinite(u.sd) else 1.0 / u.sd for u in scene.unknowns])


def over_levels(scene: Scene, x: Array, levels: Array) -> Array:
    """Residuals, shape (N, ...), over the levels of their channels.

    Parameters
    ----------
    scene : Scene
    x : ndarray, shape (N, ...)
        Residuals or their derivatives.
    levels : ndarray, shape (channels,)
        Noise levels over the assumed ones.
    """
    each = np.repeat(levels, scene.lengths)
    return np.asarray(x / each.reshape(-1, *(1,) * (x.ndim - 1)))


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
    x = coordinates(point)
    if not x.size:
        return np.zeros((residual.size, 0)), steps

    def changed(steps: Array) -> Array:
        # The point itself once more: a simulation is as fine as all its columns ask for.
        shifted = [moved(point, x + h * e) for h, e in zip(steps, np.eye(x.size))]
        found = scene.residuals([point, *shifted])
        return np.asarray(found[:, 1:] - found[:, :1])

    for _ in range(2):
        change = changed(steps)
        size = np.linalg.norm(change, axis=0)
        good = (size > 0.01 * DIFFERENCE_STEP_SD) & (size < 100.0 * DIFFERENCE_STEP_SD)
        if good.all():
            break
        better = steps * np.clip(DIFFERENCE_STEP_SD / np.maximum(size, 1e-12), 1e-8, 1e8)
        better = np.minimum(better, MAX_RELATIVE_STEP * np.maximum(np.abs(x), 1.0))
        logs = np.array([not is_signed(point.placed[i].effect, n) for i, n in keys_of(point.placed)], bool)
        better[: logs.size][logs] = np.minimum(better[: logs.size][logs], 0.05)
        steps = np.where(good, steps, better)
    else:
        change = changed(steps)
    return np.asarray(change / steps), steps


def first_steps(point: ScenePoint) -> Array:
    """Steps to begin with, shape (p,)."""
    x = coordinates(point)
    return np.asarray(1e-5 * np.maximum(np.abs(x), 1e-3))


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
    point = start
    steps = first_steps(start) if steps is None else steps
    residual = scene.residuals([point])[:, 0]
    value = log_posterior(scene, residual, point.unknowns)
    damping, keys, begun = 1e-6, keys_of(point.placed), value
    k, gain = len(keys), 0.0
    for _ in range(MAX_NEWTON_STEPS):
        levels = levels_of(scene, residual)
        J, steps = derivative(scene, point, residual, steps)
        J = over_levels(scene, J, levels)
        if not J.shape[1]:
            break
        g = J.T @ over_levels(scene, residual, levels)
        g[k:] += _pulls(scene, point.unknowns) * _weights(scene)
        H = _information(scene, J, k)
        gain, point, residual, value, damping = _stepped(scene, (point, residual, value), g, H, damping)
        if gain < max(GAIN_TOLERANCE_NATS, GAIN_TOLERANCE_SHARE * (value - begun)) or fit_is_over():
            break
    levels = levels_of(scene, residual)
    if gain > GAIN_TOLERANCE_NATS:  # else the derivatives are those of the point, or of one as good
        J, steps = derivative(scene, point, residual, steps)
        J = over_levels(scene, J, levels)
    return SceneFit(point, residual, levels, value, _information(scene, J, k), keys, steps, J)


def best_start(scene: Scene, starts: Sequence[ScenePoint]) -> ScenePoint:
    """The likeliest of several points of the same effects at which a fit may begin; the first where none is likelier."""
    found = scene.residuals(starts)
    values = [log_posterior(scene, found[:, j], p.unknowns) for j, p in enumerate(starts)]
    return starts[int(np.argmax(np.nan_to_num(values, nan=-np.inf)))]


def _information(scene: Scene, J: Array, k: int) -> Array:
    H = J.T @ J
    H[np.arange(k, H.shape[0]), np.arange(k, H.shape[0])] += _weights(scene) ** 2
    return np.asarray(H)


def _stepped(
    scene: Scene, at: tuple[ScenePoint, Array, float], g: Array, H: Array, damping: float
) -> tuple[float, ScenePoint, Array, float, float]:
    """One step that raises the posterior, with several dampings tried at once."""
    point, residual, value = at
    x, keys = coordinates(point), keys_of(point.placed)
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    K = H / np.outer(scale, scale)
    logs = np.array([not is_signed(point.placed[i].effect, n) for i, n in keys], bool)
    tried: list[ScenePoint] = []
    least = 0
    for factor in (1.0, 1e2, 1e4, 1e6):
        d = np.linalg.lstsq(K + damping * factor * np.eye(x.size), -g / scale, rcond=1e-13)[0] / scale
        tried += [moved(point, x + step) for step in _ways(d, logs)]
        least = least or len(tried)
    found = scene.residuals(tried)
    values = [log_posterior(scene, found[:, j], p.unknowns) for j, p in enumerate(tried)]
    best = int(np.argmax(values))
    if not values[best] > value:
        return 0.0, point, residual, value, min(damping * 1e3, 1.0)
    return (
        values[best] - value,
        tried[best],
        found[:, best],
        values[best],
        max(damping * (1e-1 if best < least else 1e1), 1e-9),
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
