"""The size at which each effect that was not found in a scene would have been."""

from __future__ import annotations

import numpy as np

from kfgen.gap.core.thresholds import DETECTION_LIMIT_NATS
from kfgen.gap.scene.newton import SceneFit, is_signed, keys_of
from kfgen.gap.scene.scene import Placed, Scene, ScenePoint
from kfgen.gap.scene.screen import MIN_OWN_SHARE, basis, new_columns, orthogonal_part


def limits(scene: Scene, fit: SceneFit) -> list[tuple[Placed, str, float]]:
    """For each addition that is not there, the size of its first parameter that would be worth `DETECTION_LIMIT_NATS` nats.

    Of several with the same first parameter (an entry of a matrix, its row), that of the first.

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
        effect, name = starts[0].effect, keys_of((starts[0],))[0][1]
        if (what := (effect.name, starts[0].where, name)) in out:
            continue  # alone it was looked at already: a row of a matrix begins with its first entry
        point = ScenePoint((*fit.point.placed, starts[0]), fit.point.unknowns)
        residual = scene.residuals([point])[:, 0]
        if not np.isfinite(residual).all():
            continue
        column = new_columns(scene, fit, point, residual)[:, 0]
        own = float(np.linalg.norm(orthogonal_part(column, Q)))
        scale = 1.0 if is_signed(effect, name) else float(getattr(effect, name))
        if own > MIN_OWN_SHARE * float(np.linalg.norm(column)):
            out[what] = starts[0], name, scale * float(np.sqrt(2.0 * DETECTION_LIMIT_NATS)) / own
    return list(out.values())
