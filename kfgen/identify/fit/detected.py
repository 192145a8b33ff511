"""Effects that no start value finds, such as a tone or a resonance: looked for in the whitened record, then fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect, effect_named, sampled_spectrum
from kfgen.effects.series import Detection, WhiteSeries
from kfgen.identify.evidence.peaks import grid_with_peaks
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.fit.choice import EffectSet, Fitter

Array = NDArray[np.float64]

DENSITY_GRID_POINTS = 512
"""Frequencies at which a density is computed; between them it is interpolated."""
SIZE_FACTORS = (1.0, 0.3, 0.1)
"""Of the size at which an effect was seen: where fits of it start."""
LOG_LEVEL_DEVIATION = 1.0
"""Standard deviation of what is known beforehand of the logarithm of the noise's level."""
_LEAVE_OUT = "Leave it out, or give a log that has it"


@dataclass(frozen=True)
class DetectedFit:
    """A set of effects, the last of which was looked for, and the 95 % intervals [SI] that only the search knows."""

    found: EffectSet
    ci95: Mapping[str, tuple[float, float]]


def is_started(name: str, record: Evidence) -> bool:
    """Whether fits of an effect have start values on a record; else it is looked for.

    Parameters
    ----------
    name : str
        An effect of the catalogue.
    record : Evidence
    """
    return bool(effect_named(name).starts(record.look))


def with_detected(record: Evidence, known: tuple[Effect, ...], name: str, fit: Fitter) -> DetectedFit:
    """A set of fitted effects with one more, which is looked for in what they leave.

    Parameters
    ----------
    record : Evidence
        One evenly sampled record in memory.
    known : tuple of Effect
        With their fitted values; white noise among them.
    name : str
        The effect that is added.
    fit : callable
        Fits a set of effects from several starts.

    Raises
    ------
    InputError
        The effect does not show in this record, or can be looked for in samples only.
    """
    cls = effect_named(name)
    if cls.driver:
        raise InputError(f"{name} needs the channel '{cls.driver}'", remedy=_LEAVE_OUT)
    if not isinstance(record, Record):
        raise InputError(
            f"{name} is looked for in one evenly sampled log in memory",
            where="--effects",
            remedy="Leave it out, or give such a log",
        )
    seen = [d for d in cls.detect(white_series(record, known)) if d.evidence is None]
    if not seen:
        raise InputError(f"{name} cannot be seen on a record at rest", remedy=_LEAVE_OUT)
    fits = [(fit(record, [(*known, e) for e in _starts(d)]), d) for d in seen]
    found, detection = max(fits, key=lambda f: f[0].gain)
    return DetectedFit(found, detection.ci95)


def _starts(detection: Detection) -> list[Effect]:
    """The effect as it was seen, and smaller."""
    effect, sizes = detection.effect, detection.effect.sizes()
    factors = SIZE_FACTORS if sizes else (1.0,)
    return [replace(effect, **{s: k * float(getattr(effect, s)) for s in sizes}) for k in factors]


def white_series(record: Record, effects: Sequence[Effect]) -> WhiteSeries:
    """A record over the square root of the density that effects give it.

    Parameters
    ----------
    record : Record
    effects : sequence of Effect
        Fitted; what deterministic ones explain is removed.
    """
    from scipy.fft import dct

    n, dt = record.n, record.dt
    omega = np.asarray(np.arange(1, n) * (np.pi / n), dtype=np.float64)
    coarse = np.asarray(np.geomspace(omega[0], omega[-1], DENSITY_GRID_POINTS), dtype=np.float64)
    grid = grid_with_peaks(coarse, effects, dt)

    def density(some: Sequence[Effect]) -> Array:
        S = np.maximum(sampled_spectrum(some, grid, dt), np.finfo(float).tiny)
        return np.asarray(np.exp(np.interp(np.log(omega), np.log(grid), np.log(S))))

    S = density(effects)
    fast = density([e for e in effects if not e.form().order])
    weight = np.concatenate([[0.0], 1.0 / np.sqrt(S)])
    shapes = [x for e in effects if e.coefficients() for x in record.regressors(e)]
    columns = [dct(x, type=2, norm="ortho") * weight for x in shapes]
    return WhiteSeries(
        record.elapsed,
        np.asarray(record.y - record.drift(effects), dtype=np.float64),
        dt,
        weight,
        np.concatenate([[1.0], 1.0 - fast / S]),
        np.linalg.qr(np.array(columns).T)[0] if columns else np.zeros((n, 0)),
        (0.0, LOG_LEVEL_DEVIATION),
        record.drive,
        tuple(e.form() for e in effects if e.form().order and not e.coefficients()),
        (0.0, LOG_LEVEL_DEVIATION),
    )
