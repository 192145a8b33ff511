"""The evidence of a fitted scene: its marginal likelihood by Laplace's method.

Priors are those of `kfgen.gap.rest.evidence`: sizes and times log-uniform, coefficients log-uniform in their size, of
either sign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kfgen.effects import Effect
from kfgen.effects.series import DECADES, OF_A_COEFFICIENT
from kfgen.gap.rest.evidence import TIME_LIMITS
from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.posterior import log_posterior
from kfgen.gap.scene.scene import HasWidths, Integrating, Placed, Scene, coordinates, is_signed, keys_of
from kfgen.gap.scene.tempered_scene import TemperedScene


def evidence(scene: Scene, fit: SceneFit) -> float:
    """Log of the marginal likelihood of a fit, up to a constant of the scene [nats].

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
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
            widths[i] = parameter_width(scene, effect, name)
    value -= float(np.log(widths[:k]).sum()) + _searched(scene, fit.point.placed)
    # At the edge of its prior, into which the likelihood falls, a time has about one e-fold of it.
    value -= sum(float(np.log(_width_of(scene, p.effect.name))) for p in fit.point.placed if p.held)
    # What the data do not bound is bounded by its prior.
    floor = np.where(np.arange(size) < k, 2.0 * np.pi / widths**2, np.maximum(1e-12 * np.diag(H), 1e-300))
    scaled = H / np.sqrt(floor)[:, None] / np.sqrt(floor)
    values = np.maximum(np.linalg.eigvalsh(0.5 * (scaled + scaled.T)), 1.0)
    value += 0.5 * size * float(np.log(2.0 * np.pi)) - 0.5 * float(np.log(values).sum())
    return float(value - 0.5 * np.log(floor).sum())


def evidence_over_widths(scene: Scene, fit: SceneFit) -> float:
    """Evidence of a fit as a density of the readings, comparable among worlds of other noise, up to a constant of the log [nats].

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
    world = scene.scene if isinstance(scene, TemperedScene) else scene
    widths = float(world.log_widths.sum()) if isinstance(world, HasWidths) else 0.0
    return evidence(scene, fit) - widths


def parameter_width(scene: Scene, effect: Effect, name: str) -> float:
    """Width of the prior of the logarithm of a parameter.

    Parameters
    ----------
    scene : Scene
    effect : Effect
    name : str
        Of its parameter.
    """
    kind = {p.name: p.kind for p in effect.parameters()}[name]
    if kind == "time" and effect.name in TIME_LIMITS:
        return _width_of(scene, effect.name)
    span = max((scene.span[1] - scene.span[0]) / scene.dt, 10.0)
    return float(np.log(span)) if kind in ("time", "frequency") else DECADES


def time_limits(scene: Scene, name: str) -> tuple[float, float]:
    """The shortest and the longest time [s] with which an effect is itself.

    Parameters
    ----------
    scene : Scene
    name : str
        Of the effect.
    """
    longest, shortest = TIME_LIMITS[name]
    return shortest * scene.dt, longest * (scene.span[1] - scene.span[0])


def _width_of(scene: Scene, name: str) -> float:
    """Width of the prior of its logarithm."""
    lo, hi = time_limits(scene, name)
    return max(float(np.log(hi / lo)), 1.0)


def _searched(scene: Scene, placed: Sequence[Placed]) -> float:
    """What spans cost that were found by looking at every pair of edges, and how wide these are [nats]."""
    found = [float(getattr(p.effect, name, 0.0)) > 0.0 for p in placed for name in ("duration", "edge")]
    samples = max((scene.span[1] - scene.span[0]) / scene.dt, 2.0)
    return float(np.log(samples)) * (2.0 * sum(found[::2]) + sum(found[1::2]))
