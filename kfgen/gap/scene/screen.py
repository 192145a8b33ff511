"""The screen of a scene: every addition by how much its direction explains of the residuals, linearly.

It costs a few evaluations of the scene for each addition, all its starts at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.scene.newton import SceneFit, derivative, first_steps
from kfgen.gap.scene.posterior import over_levels
from kfgen.gap.scene.scene import Placed, Scene, ScenePoint

Array = NDArray[np.float64]

MIN_OWN_SHARE = 0.02
"""Share of an addition's direction that must be its own, for it to be distinct from what is fitted anyway."""


@dataclass(frozen=True)
class Screened:
    """An addition as the screen sees it.

    Parameters
    ----------
    gain : float
        Linear gain [nats] of its best start.
    start : Placed
    direction : ndarray, shape (N,)
        Of its parameter that moves the residuals most, without what is fitted anyway.
    claims : ndarray, shape (effects,)
        Share cos^2 of it, without all else, that lies in each effect that is there.
    starts : tuple of Placed
        All of its starts.
    """

    gain: float
    start: Placed
    direction: Array
    claims: Array
    starts: tuple[Placed, ...]


def screen(scene: Scene, base: SceneFit) -> list[Screened]:
    """Every addition by its linear gain beside a fit, the best first.

    Parameters
    ----------
    scene : Scene
    base : SceneFit
        Of the scene with what is there.
    """
    Q, own = basis(base.jacobian), _own(base)
    before = orthogonal_part(over_levels(scene, base.residual, base.levels), Q)
    found = [_screened(scene, base, g, Q, own, before) for g in scene.candidates(base.point.placed)]
    return sorted(found, key=lambda s: -s.gain)


def _own(base: SceneFit) -> list[Array]:
    """Orthonormal directions of each effect, without everything else that is fitted."""
    J = base.jacobian
    columns = [[c for c, (i, _) in enumerate(base.keys) if i == k] for k in range(len(base.point.placed))]
    return [basis(orthogonal_part(J[:, mine], basis(np.delete(J, mine, axis=1)))) for mine in columns]


def _screened(
    scene: Scene, base: SceneFit, starts: Sequence[Placed], Q: Array, own: Sequence[Array], before: Array
) -> Screened:
    """The best start of an addition, by its linear gain over what was left `before`."""
    power = float(before @ before)
    points = [ScenePoint((*base.point.placed, s), base.point.unknowns) for s in starts]
    found = scene.residuals(points)
    every = tuple(starts)
    best = Screened(-np.inf, starts[0], np.zeros_like(before), np.zeros(len(own)), every)
    for j, point in enumerate(points):
        if not np.isfinite(found[:, j]).all():
            continue
        columns = new_columns(scene, base, point, found[:, j])
        A = orthogonal_part(columns, Q)
        size = np.linalg.norm(A, axis=0)
        distinct = size > MIN_OWN_SHARE * np.linalg.norm(columns, axis=0)
        rest = orthogonal_part(over_levels(scene, found[:, j], base.levels), Q)
        if distinct.any():
            B = A[:, distinct] / size[distinct]
            rest = rest - B @ (np.linalg.pinv(B.T @ B, rcond=1e-10, hermitian=True) @ (B.T @ rest))
        gain = 0.5 * (power - float(rest @ rest))
        if gain > best.gain:
            best = Screened(gain, starts[j], A[:, int(np.argmax(size))], _claims(columns, size, own), every)
    return best


def _claims(columns: Array, size: Array, own: Sequence[Array]) -> Array:
    """Shares of columns, of `size` without everything else, that lie in each effect's directions."""
    shared = np.array([np.sum((D.T @ columns) ** 2, axis=0) for D in own]).reshape(len(own), columns.shape[1])
    return np.asarray((shared / np.maximum(shared + size**2, 1e-300)).max(axis=1, initial=0.0))


def orthogonal_part(x: Array, Q: Array) -> Array:
    """Vectors without what lies in the columns of `Q`.

    Parameters
    ----------
    x : ndarray, shape (N, ...)
    Q : ndarray, shape (N, k)
        Orthonormal columns.
    """
    return np.asarray(x - Q @ (Q.T @ x))


def new_columns(scene: Scene, base: SceneFit, point: ScenePoint, residual: Array) -> Array:
    """Derivatives in the parameters of the last effect only, over the levels, shape (N, k).

    Parameters
    ----------
    scene : Scene
    base : SceneFit
        Without the last effect.
    point : ScenePoint
        With it.
    residual : ndarray, shape (N,)
        At that point.
    """
    alone = _Alone(scene, point)
    last = ScenePoint((point.placed[-1],), np.zeros(0))
    J, _ = derivative(alone, last, residual, first_steps(last))
    return over_levels(scene, J, base.levels)


@dataclass(frozen=True)
class _Alone:
    """A scene in which only the last effect of a point moves."""

    scene: Scene
    point: ScenePoint

    channels = property(lambda self: self.scene.channels)
    lengths = property(lambda self: self.scene.lengths)
    dt = property(lambda self: self.scene.dt)
    span = property(lambda self: self.scene.span)
    unknowns = ()

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """Of the whole point with its last effect exchanged."""
        whole = [ScenePoint((*self.point.placed[:-1], p.placed[0]), self.point.unknowns) for p in points]
        return self.scene.residuals(whole)

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """None."""
        return []


def basis(J: Array) -> Array:
    """Orthonormal columns of what is fitted anyway."""
    if not J.shape[1]:
        return J
    scale = np.linalg.norm(J, axis=0)
    U, s, _ = np.linalg.svd(J[:, scale > 0.0] / scale[scale > 0.0], full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s.max(initial=1.0)])
