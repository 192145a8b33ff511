"""What the channels of a sensor show: the truth, and every effect of the channel and of its sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import acts_on
from kfgen.effects import Effect
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.inertial_error import InertialError
from kfgen.effects.inertial.lag import Lag
from kfgen.effects.plant.sensor import SensorChange
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.sensors import Sensor
from kfgen.simulate.faults import faulty
from kfgen.simulate.scene import Part, TrueScene

Array = NDArray[np.float64]

ARM, SHARED, WHITE = "lever_arm", "cross_axis_noise", "white_noise"


def channel_effects(placed: Mapping[str, Sequence[Effect]], part: Part) -> list[tuple[Effect, ...]]:
    """The effects of each channel of a part, its own and those of its sensor.

    Parameters
    ----------
    placed : mapping of str to sequence of Effect
        By channel or sensor.
    part : Input or Sensor
    """
    return [tuple(e for where, es in placed.items() if acts_on(where, c) for e in es) for c in part.channels]


def shown(scene: TrueScene, part: Part, rng: np.random.Generator) -> dict[str, Array]:
    """The samples of a part's channels, shape (n,) each, no number between them [SI]."""
    effects = channel_effects(scene.effects, part)
    rows, t = scene.rows(part), scene.times(part)
    y = moved(scene, part, effects)
    drive = {d: v[rows] for d, v in scene.drive.items()}
    noises = _noises(scene.discrete, part, effects, t, drive, rng)
    values = [with_noise(y[:, k], noises[k], es, t, rng, drive) for k, es in enumerate(effects)]
    out = {}
    for c, found in zip(part.channels, faulty(values, effects, t, rng)):
        out[c] = np.full(scene.t.size, np.nan)
        out[c][rows] = found
    return out


def moved(scene: TrueScene, part: Part, effects: Sequence[Sequence[Effect]]) -> Array:
    """The truth with what motion makes of it: lags, then errors, shape (samples, channels)."""
    y = scene.clean(part)
    here = isinstance(part, Sensor) and part.shows in ("p", "v")
    inertial = [[e for e in es if isinstance(e, InertialError)] for es in effects]
    for k, es in enumerate(inertial):
        arm = _arm(effects[k]) if here else None
        lags = [e for e in es if isinstance(e, Lag)]
        if arm is not None and isinstance(part, Sensor):
            y[:, k] = scene.sensed(part, scene.t[scene.rows(part)], arm)[:, k]
        if lags:
            y[:, k] = scene.passed(part, y[:, k], k, lags, arm)
    errors = [[e for e in es if not isinstance(e, Lag) and not (here and e.name == ARM)] for es in inertial]
    if any(errors):
        signals = scene.signals(part, y)
        added = [sum((e.output(signals, k) for e in es), np.zeros(len(y))) for k, es in enumerate(errors)]
        y = y + np.column_stack(added)
    t = scene.times(part)
    for k, changes in enumerate([[e for e in es if isinstance(e, SensorChange)] for es in effects]):
        for change in changes:
            y[:, k] = change.shown(t, y[:, k, None])[:, 0]
    return y


def moved_alone(
    clean: Array, effects: Sequence[Effect], t: Array, warmth: Array | None, axis: int = 0
) -> Array:
    """The same of one channel that is known at its samples only, shape (n,)."""
    y = clean
    errors = [e for e in effects if isinstance(e, InertialError)]
    for e in errors:
        y = e.passed(y, float(t[1] - t[0])) if isinstance(e, Lag) else y
    values = np.zeros((t.size, 3))
    values[:, axis] = y
    signals = Signals(t, values, warmth=warmth)
    return np.asarray(
        y + sum((e.output(signals, axis) for e in errors if not isinstance(e, Lag)), np.zeros(t.size))
    )


def _arm(effects: Sequence[Effect]) -> Array | None:
    """The lever arm that effects say, shape (3,) [m]."""
    found: list[Any] = [e for e in effects if e.name == ARM]
    return np.sum([[e.x, e.y, e.z] for e in found], axis=0, dtype=np.float64) if found else None


def with_noise(
    clean: Array,
    noise: Array,
    effects: Sequence[Effect],
    t: Array,
    rng: np.random.Generator,
    drive: Mapping[str, Array],
) -> Array:
    """What a channel shows: noise as effects alter it, added to the truth, all as effects filter it."""
    for e in effects:
        noise = noise if e.is_filter else e.apply_to(noise, t, rng, drive)
    values = clean + noise
    for e in effects:
        values = e.apply_to(values, t, rng, drive) if e.is_filter else values
    return np.asarray(values)


def _noises(
    discrete: DiscreteModel,
    part: Part,
    effects: Sequence[Sequence[Effect]],
    t: Array,
    drive: Mapping[str, Array],
    rng: np.random.Generator,
) -> list[Array]:
    """What the effects of each channel add, white noise that two channels share in it, shape (samples,) each."""
    white: list[Array] = []
    rest: list[Array] = []
    dt = float(t[1] - t[0]) if t.size > 1 else 1.0 / discrete.rate
    for channel, es in zip(part.channels, effects):
        drawn = [e.in_record(dt, t.size * dt).draw(rng) for e in es]
        parts = [(e.name == WHITE, e.simulate(t, rng, drive)) for e in drawn]
        own = isinstance(part, Sensor) and discrete.model.white(channel) == (0, 0)
        mine = part.sd * rng.standard_normal(t.size) if own else np.zeros(t.size)  # type: ignore[union-attr]
        white.append(sum((y for is_white, y in parts if is_white), mine))
        rest.append(sum((y for is_white, y in parts if not is_white), np.zeros(t.size)))
    _share(white, effects)
    return [w + r for w, r in zip(white, rest)]


def _share(white: list[Array], effects: Sequence[Sequence[Effect]]) -> None:
    """Correlate the white noise of the first two channels that say so; each keeps its size."""
    said: list[tuple[int, Any]] = [(k, e) for k, es in enumerate(effects) for e in es if e.name == SHARED]
    if len(said) < 2:
        return
    (a, first), (b, _) = said[:2]
    rho, size = float(first.rho), float(np.sqrt(np.mean(white[a] ** 2)))
    if size > 0.0:
        ratio = float(np.sqrt(np.mean(white[b] ** 2))) / size
        white[b] = rho * ratio * white[a] + np.sqrt(1.0 - rho**2) * white[b]
