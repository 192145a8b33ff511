"""What the motion of a flight does not excite: effects that it cannot show, and the manoeuvre of the library that would."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.effects.inertial.errors import ScaleAsymmetry
from kfgen.gap.core.result import DetectionLimit
from kfgen.gap.core.thresholds import DETECTION_LIMIT_NATS
from kfgen.gap.flight.distinguish import ExpectedResiduals, after_memory
from kfgen.gap.flight.expected_flight import ExpectedFlights
from kfgen.gap.flight.named_effect import typical_size
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.motion.candidates import offers
from kfgen.gap.scene.scene import Placed
from kfgen.gap.scene.scene_gap import SceneGap, UnitOf
from kfgen.gap.scene.screen import orthogonal_part
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.filter import FilterModel

Array = NDArray[np.float64]

MAX_USUAL_SIZES = 5.0
"""Times its usual size, from which on an effect would be seen: no vehicle has one so large."""
EXPECTED_RATE_HZ = 50.0
"""Of the inertial sensors along the manoeuvres that are tried."""
PARKED_SPEED_M_S = 0.5
"""Speed of a smoothed path up to which noise and vibration make it ..."""
PARKED_MEAN_M_S = 0.1
"""... and its mean over the log, which they do not."""
PARKED_RATE_RAD_S = 0.01
"""By which the means of a body at rest differ, bias and noise aside ..."""
PARKED_FORCE_M_S2 = 0.3
"""... and those of its specific force."""
PARKED_BIAS_RAD_S = 0.05
"""Largest mean rate that may be a bias: above it a body turns steadily."""
MEANS_S = 0.5
"""Of inertial samples, whose noise and vibration are averaged [s]."""
PARKED_SIGMAS = 5.0
"""Standard deviations of such a mean by which noise alone does not move it."""
PARKED_SHARE = 0.99
"""Of the time, in which a parked vehicle is at rest."""


def with_excitation(gap: SceneGap, scene: FlightScene, model: FilterModel, unit_of: UnitOf) -> SceneGap:
    """The answer of a flight with what its motion does not excite, and with the manoeuvres that would.

    Parameters
    ----------
    gap : SceneGap
        Of that flight.
    scene : FlightScene
        As assumed.
    model : FilterModel
    unit_of : callable
        The unit of an effect at its place.
    """
    parked = is_parked(scene)
    if not gap.limits:
        return replace(gap, parked=parked)
    every = (
        *gap.limits,
        *(DetectionLimit(p.effect, p.where, n, np.inf, unit_of(p)) for p, n in _unshown(scene)),
    )
    usual = {k: p for k, m in enumerate(every) if (p := _usual(m, model)) is not None}
    weak = [k for k, m in enumerate(every) if not _is_excited(m, usual.get(k))]
    tried = [k for k in weak if k in usual]
    aiding = {a.sensor.name for a in scene.path.log.aiding}
    names = dict(zip(tried, exciting([usual[k] for k in tried], aided_by(model, aiding))))
    limits = [
        replace(m, is_excited=False, manoeuvre=names.get(k, "")) if k in weak else m
        for k, m in enumerate(every)
    ]
    return replace(gap, limits=tuple(limits), parked=parked)


def aided_by(model: FilterModel, aiding: Collection[str]) -> FilterModel:
    """The filter with some of its sensors only; the noise of the others leaves with them.

    Parameters
    ----------
    model : FilterModel
    aiding : collection of str
        Names of the sensors that stay.

    Returns
    -------
    FilterModel
    """
    absent = {c for s in model.sensors if s.name not in aiding for c in s.channels}
    noise = {w: e for w, e in model.noise.items() if set(model.channels_of(w)) - absent}
    return replace(model, sensors=tuple(s for s in model.sensors if s.name in aiding), noise=noise)


def is_parked(scene: FlightScene) -> bool:
    """Whether the vehicle never moves: no speed along the path, and inertial means that are as at rest.

    Parameters
    ----------
    scene : FlightScene
    """
    path = scene.path
    at = [k for k, n in enumerate(path.equations.names) if n.startswith("v_")]
    v = path.x[:, at]
    is_slow = np.quantile(np.linalg.norm(v, axis=1), PARKED_SHARE) <= PARKED_SPEED_M_S
    if not at or not is_slow or np.linalg.norm(v.mean(axis=0)) > PARKED_MEAN_M_S:
        return False
    log = path.log
    turn = np.median(log.u[:, log.triads["gyro"]], axis=0) if "gyro" in log.triads else np.zeros(3)
    if np.linalg.norm(turn) > PARKED_BIAS_RAD_S:
        return False
    for sensor, least in (("gyro", PARKED_RATE_RAD_S), ("accel", PARKED_FORCE_M_S2)):
        if sensor in log.triads and not _is_still(log.u[:, log.triads[sensor]], log.dt, least):
            return False
    return True


def _is_still(u: Array, dt: float, least: float) -> bool:
    """Whether the means of a triad, shape (n, 3), stay where they are but for noise."""
    n = max(1, round(MEANS_S / dt))
    means = u[: len(u) // n * n].reshape(-1, n, u.shape[1]).mean(axis=1)
    noise = np.std(np.diff(u, axis=0), axis=0) / np.sqrt(2.0 * n)
    away = np.abs(means - np.median(means, axis=0))
    return bool((np.quantile(away, PARKED_SHARE, axis=0) < np.maximum(least, PARKED_SIGMAS * noise)).all())


def _unshown(scene: FlightScene) -> list[tuple[Placed, str]]:
    """Effects that are no candidates, for the motion has only one of their sides: asymmetries of what never changes sign."""
    found = [
        p for starts in offers(scene.bench, ()) for p in starts[:1] if isinstance(p.effect, ScaleAsymmetry)
    ]
    shown = {
        p.where for starts in scene.candidates(()) for p in starts if isinstance(p.effect, ScaleAsymmetry)
    }
    return [(p, "coefficient") for p in found if p.where not in shown]


def _usual(limit: DetectionLimit, model: FilterModel) -> Placed | None:
    """The effect with the number of a limit at its usual size, the others zero; none where nobody says how large it is."""
    cls: type[Effect] = type(limit.effect)
    size = typical_size(cls, limit.where)
    channels = model.channels_of(limit.where)
    if not size or not channels or (cls.driver and cls.driver not in DRIVERS):
        return None
    unit = model.channel_units[channels[0]]
    return Placed(cls.read({limit.parameter: size}, unit, limit.where), limit.where)


def _is_excited(limit: DetectionLimit, usual: Placed | None) -> bool:
    """Whether a motion shows an effect of a size that a vehicle may have."""
    if usual is None or not np.isfinite(limit.value):
        return bool(np.isfinite(limit.value))
    return abs(limit.value) <= MAX_USUAL_SIZES * abs(float(getattr(usual.effect, limit.parameter)))


def exciting(wanted: Sequence[Placed], model: FilterModel) -> list[str]:
    """The shortest manoeuvre of the library that shows each effect of its size; empty where none does by itself.

    Parameters
    ----------
    wanted : sequence of Placed
    model : FilterModel
        With the sensors that are there.

    Notes
    -----
    It shows an effect of which `DETECTION_LIMIT_NATS` are expected: half the square of what it does to the innovations
    and the constants of the alignment cannot.
    """
    names = [""] * len(wanted)
    if not wanted:
        return names
    drivers = tuple(dict.fromkeys(p.effect.driver for p in wanted if p.effect.driver))
    try:
        flights = ExpectedFlights(model, EXPECTED_RATE_HZ, drivers)
    except InputError:  # a filter that no manoeuvre moves
        return names
    for m in sorted(LIBRARY.values(), key=lambda m: m.length):
        left = [k for k, name in enumerate(names) if not name]
        if not left:
            break
        placed = [wanted[k] for k in left]
        seen = ExpectedResiduals(after_memory(flights.scene(m), placed), placed[0])
        nats = 0.5 * np.sum(orthogonal_part(seen.responses(placed), seen.nuisance) ** 2, axis=0)
        for k, n in zip(left, nats.tolist()):
            names[k] = m.name if n >= DETECTION_LIMIT_NATS else ""
    return names
