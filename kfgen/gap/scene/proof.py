"""What speaks against an addition to a scene in spite of its evidence: what it says of itself, and data that its fit did not see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.inertial.inertial_error import free
from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import InputChange
from kfgen.gap.core.unseen import MAX_UNSEEN_LOSS_NATS, LinearFit, parts_of, tail_of, unseen_gain
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.words import loses_unseen
from kfgen.gap.scene.evidence import parameter_width
from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.posterior import over_levels
from kfgen.gap.scene.scene import Placed, Reaching, ReadingByReading, Scene, coordinates, is_signed

Array = NDArray[np.float64]

MIN_PART_SAMPLES = 16
"""Samples of a channel from which on its parts are predicted from one another."""
SAYS_NOTHING = "the record says nothing of its {name}"
MIN_OWN_INFORMATION_SHARE = 1e-10
"""Share of the information on a number that must be its own, for the record to say anything of it."""


def series(scene: Scene, X: Array) -> Array:
    """Residuals of all channels, shape (N, ...), in time.

    Parameters
    ----------
    scene : Scene
    X : ndarray, shape (N, ...)
        Residuals of all channels, one after the other.
    """
    if isinstance(scene, ReadingByReading):
        return X  # one for each pose
    return np.concatenate([Whitener.back(x) for x in np.split(X, np.cumsum(scene.lengths)[:-1])])


def unreached(scene: Scene, fit: SceneFit) -> str:
    """Why an effect of a fit says nothing that the record can show, or that physics forbids; empty where all do.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
    for index, placed in enumerate(fit.point.placed):
        why = placed.effect.forbidden()
        why = why or (scene.unreached(placed) if isinstance(scene, Reaching) else "")
        why = why or _too_slow(scene, placed) or _undetermined(scene, fit, index)
        if why:
            return why
    return ""


def _too_slow(scene: Scene, placed: Placed) -> str:
    """Whether a corner lies below the lowest frequency of the log, or what is late is later than the log is long.

    Then nothing passes, and that is another effect.
    """
    longest = scene.span[1] - scene.span[0]
    corners = [p.name for p in free(placed.effect) if p.kind == "frequency"]
    if any(float(getattr(placed.effect, n)) < 1.0 / longest for n in corners):
        return "its corner lies below the lowest frequency of the log"
    plant = isinstance(placed.effect, InputChange | SensorChange)
    if plant and max(float(getattr(placed.effect, n, 0.0)) for n in ("lag", "late")) > longest:
        return "it is later than the log is long"
    return ""


def _undetermined(scene: Scene, fit: SceneFit, index: int) -> str:
    """The number of an effect of which the record says nothing beside its prior and the other numbers."""
    H = np.diag(fit.information)
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    for column, (at, name) in enumerate(fit.keys):
        own = 1.0 / max(float(H[column]) * sd[column] ** 2, 1e-300)
        blind = not np.isfinite(sd[column]) or not H[column] > 0.0 or own < MIN_OWN_INFORMATION_SHARE
        if at == index and blind:
            return SAYS_NOTHING.format(name=name)
    return too_wide(scene, fit, index, sd)


def too_wide(scene: Scene, fit: SceneFit, index: int, deviation: Array, max_ratio: float = np.inf) -> str:
    """The positive number of an effect whose 95 % interval is as wide as its prior, or wider; empty where none is.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    index : int
        Of the effect.
    deviation : ndarray, shape (p,)
        Standard deviations of the coordinates.
    max_ratio : float
        Upper over lower end that is too wide, however wide the prior is.
    """
    for (at, name), sd in zip(fit.keys, deviation.tolist()):
        effect = fit.point.placed[at].effect
        if at != index or is_signed(effect, name):
            continue
        if 2.0 * 1.96 * sd > min(parameter_width(scene, effect, name), float(np.log(max_ratio))):
            return SAYS_NOTHING.format(name=name)
    return ""


def unproven(scene: Scene, base: SceneFit, fit: SceneFit, max_loss_nats: float = MAX_UNSEEN_LOSS_NATS) -> str:
    """What the last effect of a fit loses on data that its fit did not see, part by part or on the last ones; empty if nothing.

    Parameters
    ----------
    scene : Scene
    base, fit : SceneFit
        Without and with it.
    max_loss_nats : float
        That may be chance.
    """
    if min(scene.lengths) < MIN_PART_SAMPLES or not np.isfinite(coordinates(fit.point)).all():
        return ""
    before, after = (_linear(scene, f, fit.levels) for f in (base, fit))
    for parts in (parts_of(scene.lengths), [tail_of(scene.lengths)]):
        gain = unseen_gain(before, after, parts)
        if gain < -max_loss_nats:
            return loses_unseen(-gain)
    return ""


def _linear(scene: Scene, fit: SceneFit, levels: Array) -> LinearFit:
    """A fit in time, over the levels of noise that are given."""
    own = fit.jacobian * np.repeat(fit.levels / levels, scene.lengths)[:, None]
    priors = fit.information - fit.jacobian.T @ fit.jacobian
    away = fit.point.unknowns - np.array([u.value for u in scene.unknowns])
    residual = over_levels(scene, fit.residual, levels)
    gradient = own.T @ residual
    gradient[len(fit.keys) :] += np.diag(priors)[len(fit.keys) :] * away
    return LinearFit(series(scene, residual), series(scene, own), np.asarray(priors + own.T @ own), gradient)
