"""What faults of a rig do to samples, by the name of the effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect

Array = NDArray[np.float64]
Samples = Callable[[Any, Array, Array, np.random.Generator], Array]

CONVERTER_STEPS_IN_NOISE = 0.25
"""Step of a converter of which only a stuck bit is known, in standard deviations of its samples' differences."""
MAX_JITTER_PERIODS = 0.45
"""Most by which a time stamp may be off, in periods, so that time increases."""


def _repeated(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    fresh = rng.uniform(size=y.size) >= float(effect.share)
    fresh[0] = True
    return y[np.maximum.accumulate(np.where(fresh, np.arange(y.size), 0))]


def _stuck(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    on = (t >= effect.time) & (t < effect.time + effect.lasting)
    before = y[max(int(np.argmax(on)) - 1, 0)]
    return np.where(on, before, y)


def _dropped(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    return np.where(rng.uniform(size=y.size) < float(effect.share), np.nan, y)


def _clipped(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    limit = abs(float(effect.limit))
    return np.clip(y, -limit, limit)


def _coarse(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    step = float(effect.step)
    return np.round(y / step) * step if step > 0.0 else y


def _bit(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    values = np.unique(y)
    step = float(np.diff(values).min()) if 1 < values.size < y.size // 2 else 0.0
    step = step or CONVERTER_STEPS_IN_NOISE * float(np.std(np.diff(y)))
    if step == 0.0:
        return y
    codes = np.round(y / step).astype(np.int64)
    return np.asarray((codes & ~(1 << int(effect.bit))) * step, dtype=np.float64)


def _dead(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    return np.where(np.abs(y) < float(effect.width), 0.0, y)


def _early(effect: Any, y: Array, t: Array, rng: np.random.Generator) -> Array:
    return np.interp(t - float(effect.shift), t, y)


OF_SAMPLES: Mapping[str, Samples] = {
    "too_early": _early,
    "sign_error": lambda effect, y, t, rng: -y,
    "unit_error": lambda effect, y, t, rng: y * float(effect.factor),
    "dead_zone": _dead,
    "clipping": _clipped,
    "coarse_quantisation": _coarse,
    "stuck_bit": _bit,
    "repeated_samples": _repeated,
    "stuck": _stuck,
    "dropped_samples": _dropped,
}
"""In the order in which they act."""
SWAP, JITTER, RATE = "axis_swap", "timestamp_jitter", "sample_rate_error"


def faulty(
    values: Sequence[Array], effects: Sequence[Sequence[Effect]], t: Array, rng: np.random.Generator
) -> list[Array]:
    """The samples of a sensor's channels with their faults.

    Parameters
    ----------
    values : sequence of ndarray, shape (n,)
        One a channel [SI].
    effects : sequence of sequence of Effect
        Of each channel.
    t : ndarray, shape (n,)
        Even times [s].
    rng : numpy.random.Generator
    """
    swapped = [k for k, es in enumerate(effects) if any(e.name == SWAP for e in es)]
    to = swapped[1:] + swapped[:1] if len(swapped) > 1 else [(k + 1) % len(values) for k in swapped]
    out = list(values)
    for k, other in zip(swapped, to):
        out[k] = values[other]
    for k, es in enumerate(effects):
        for name, act in OF_SAMPLES.items():
            for e in es:
                out[k] = act(e, out[k], t, rng) if e.name == name else out[k]
    return out


def stamped(t: Array, effects: Sequence[Effect], rng: np.random.Generator) -> Array:
    """What the time stamps of a log say, shape (n,), of true even times (n,) [s]."""
    dt = float(t[1] - t[0])
    for e in effects:
        found: Any = e
        if e.name == JITTER:
            away = float(found.sigma) * rng.standard_normal(t.size)
            t = t + np.clip(away, -MAX_JITTER_PERIODS * dt, MAX_JITTER_PERIODS * dt)
        elif e.name == RATE:
            t = t * float(found.factor)
    return t
