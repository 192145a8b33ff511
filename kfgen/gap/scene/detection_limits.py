"""The size at which each effect that was not found in a scene would have been."""

from __future__ import annotations

import numpy as np

from kfgen.gap.core.thresholds import DETECTION_LIMIT_NATS
from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.scene import Placed, Scene, ScenePoint, is_signed, keys_of
from kfgen.gap.scene.screen import MIN_OWN_SHARE, basis, new_columns, orthogonal_part


def limits(scene: Scene, fit: SceneFit) -> list[tuple[Placed, str, float]]:
    """For each addition that is not there, the size of its parameters that would be worth `DETECTION_LIMIT_NATS` nats.

    Of each number with a sign by itself, else of the first; infinite where what is fitted anyway does all that it does. Of
    several with the same parameter (an entry of a matrix, its row), that of the first.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        With all effects that are there.

    Returns
    -------
    list of (Placed, parameter, value)
        Values in SI.
    """
    Q = basis(fit.jacobian)
    out: dict[tuple[str, str, str], tuple[Placed, str, float]] = {}
    for starts in scene.candidates(fit.point.placed):
        if starts[0].effect.shrinks_with_size:
            continue  # the larger its parameter, the less it does
        effect, where = starts[0].effect, starts[0].where
        names = [name for _, name in keys_of((starts[0],))]
        wanted = [
            (i, n)
            for i, n in enumerate(names)
            if (i == 0 or is_signed(effect, n)) and (effect.name, where, n) not in out
        ]
        if not wanted:
            continue  # alone it was looked at already: a row of a matrix has the entries
        point = ScenePoint((*fit.point.placed, starts[0]), fit.point.unknowns)
        residual = scene.residuals([point])[:, 0]
        if not np.isfinite(residual).all():
            continue
        columns = new_columns(scene, fit, point, residual)
        for i, name in wanted:
            own = float(np.linalg.norm(orthogonal_part(columns[:, i : i + 1], Q)))
            scale = 1.0 if is_signed(effect, name) else float(getattr(effect, name))
            is_own = own > MIN_OWN_SHARE * float(np.linalg.norm(columns[:, i]))
            size = scale * float(np.sqrt(2.0 * DETECTION_LIMIT_NATS)) / own if is_own else np.inf
            out[effect.name, where, name] = starts[0], name, size
    return list(out.values())
