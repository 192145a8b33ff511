"""What is wrong with the columns of a plant's log, before anything is fitted to them.

First the samples of each channel by themselves: stuck, held, clipped. Then the columns against one another: where
the assumed model follows them nowhere, but does so once one of them is given the opposite sign, taken in another unit or moved
in time, that column is wrong, and no effect is missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.faults.axes import SignError
from kfgen.effects.faults.samples import (
    MIN_STEPS_FOR_REPEATS,
    UNIT_FACTORS,
    Clipping,
    CoarseQuantisation,
    RepeatedSamples,
    Stuck,
    TooEarly,
    UnitError,
    runs,
)
from kfgen.gap.plant.input_logged_late import logged_late
from kfgen.gap.plant.noise.noisy_scene import NoisyPlantScene
from kfgen.gap.plant.pieces import lateness
from kfgen.gap.plant.recorded_channel import effects_assumed_of
from kfgen.gap.plant.scene import PlantScene
from kfgen.gap.plant.shooting import MAX_DISTANCE_SD, MIN_FIRST_WINDOW_SAMPLES, Shooting
from kfgen.gap.rest.faults import assumed_sd, spotted_moving
from kfgen.gap.scene.scene import Placed
from kfgen.identify.screening.stuck import by_chance, stuck_spans
from kfgen.log.log import Channel, Log
from kfgen.log.own_rows import with_own_samples
from kfgen.model.plant.user import UserModel

Array = NDArray[np.float64]

MIN_ASTRAY_SHARE = 0.6
"""Share of a channel's standard deviation that is left where a model does not follow it at all."""
MAX_FOLLOWED_SHARE = 0.3
"""Share that is left where it does."""
MAX_TIE_RATIO = 1.5
"""Times what the best corrected column leaves within which another one explains the record as well."""
NEGLIGIBLE_SHARE = 0.02
"""Share that is as good as nothing."""
MAX_NOISE_VARIANCES = 2.0
"""Variances of a channel's noise that may be its own."""
MAX_CLIPPED_SHARE = 0.5
"""Share of a channel's samples beyond which the rest says too little."""
CLIPPING_MARGIN_SAMPLES = 2
"""Samples beside clipped ones that are not compared: which of them were clipped was a matter of noise."""
MIN_REPEATED_SHARE = 0.02
"""Share of samples that repeat the one before, beyond chance, from which on they are none."""
MIN_CHANCE_RATIO = 10.0
"""Times the share that chance allows, which is known by its order only."""
MIN_STUCK_FRACTION_OF_RECORD = 0.05
"""Of the record: how long an input stands that may be stuck."""
MIN_STUCK_RATIO = 8.0
"""Times how long it usually stands."""
MIN_LATE_SAMPLES, MAX_LATE_SHARE = 3, 0.5
"""Samples by which channels are late without doubt; share of a record of which nothing would be left."""


def plant_scene(model: UserModel, log: Log) -> PlantScene:
    """The scene of a model and a log whose columns were looked at; raises as `PlantScene.of`.

    Parameters
    ----------
    model : UserModel
    log : Log
    """
    log = with_own_samples(log, [[n] for n in model.measurements])
    bare = PlantScene.bare(model, log)
    sound, said, spoilt = _sound(model, log)
    either: list[Placed] = []
    if not spoilt:
        bare = PlantScene.bare(model, sound) if said else bare
        found = _miswired(bare)
        spoilt, either = found[:1], found[1:]
    if spoilt:
        return replace(bare, spoilt=tuple(spoilt), either=tuple(either))
    scene = replace(PlantScene.of(model, _answering(bare, sound)), said=tuple(said), seen_late=bare.late)
    return replace(NoisyPlantScene.of_scene(scene), spoilt=tuple(logged_late(scene)))


def _answering(scene: PlantScene, log: Log) -> Log:
    """A log without what answers to inputs from before it, where the channels are late: nobody knows those."""
    late = round(scene.late / scene.dt)
    if not MIN_LATE_SAMPLES <= late <= MAX_LATE_SHARE * log.n:
        return log
    channels = dict(log.channels)
    for name in scene.recorded:
        values = np.array(channels[name].values)
        values[: late + 1] = np.nan
        channels[name] = Channel(values, channels[name].unit)
    return replace(log, channels=channels)


def _sound(model: UserModel, log: Log) -> tuple[Log, list[Placed], list[Placed]]:
    """The log without stuck and clipped samples, the faults that were left out, and those that spoil a channel."""
    channels = dict(log.channels)
    said: list[Placed] = []
    spoilt: list[Placed] = []
    for name in (n for n in model.measurements if n in log.channels):
        values = np.array(log.channels[name].values)
        effects = effects_assumed_of(model.measurements[name], log, name)
        faults, bad = _of_samples(np.asarray(log.t), values, effects)
        (spoilt if bad else said).extend(Placed(e, name) for e in faults)
        if faults and not bad:
            channels[name] = Channel(values, log.channels[name].unit)
    return replace(log, channels=channels), said, spoilt


def _of_samples(t: Array, values: Array, effects: list[Effect]) -> tuple[list[Effect], bool]:
    """The faults of a channel's samples, shape (n,), and whether they spoil it; those at fault become no numbers."""
    at = np.flatnonzero(np.isfinite(values))
    if at.size < MIN_STEPS_FOR_REPEATS:
        return [], False
    y, assumed = values[at], assumed_sd(effects, float(np.median(np.diff(t))))
    faults: list[Effect] = []
    there = np.ones(at.size, dtype=bool)
    for a, b in stuck_spans(y, assumed):
        faults.append(Stuck(float(t[at[a]] - t[0]), float(t[at[b - 1]] - t[at[a]])))
        there[a + 1 : b] = False
    bad = bool(np.mean(~there) > MAX_CLIPPED_SHARE)
    if there.sum() >= MIN_STEPS_FOR_REPEATS and not bad:
        dt = float(np.median(np.diff(t)))
        for fault in spotted_moving(t[at[there]], y[there], effects, dt):
            if isinstance(fault.effect, CoarseQuantisation | RepeatedSamples):
                continue  # steps that a plant runs through are noise, which the tests see; what repeats is seen below
            faults.append(fault.effect)
            bad |= fault.spoils
            if isinstance(fault.effect, Clipping):
                there &= ~_near(y, float(fault.effect.limit), assumed)
    again = np.concatenate([[False], y[1:] == y[:-1]]) & there
    share = float(again.sum() / max(there.sum(), 1))
    if share > max(MIN_REPEATED_SHARE, MIN_CHANCE_RATIO * by_chance(y, assumed)):
        faults.append(RepeatedSamples(share))  # the first of each run is a sample
        there &= ~again
    values[at[~there]] = np.nan
    return faults, bad or bool(there.sum() < MIN_STEPS_FOR_REPEATS)


def _near(y: Array, limit: float, noise: float) -> NDArray[np.bool_]:
    """The samples at a limit of a clipped channel and those beside them, shape (n,)."""
    side = np.sign(limit - float(np.median(y)))
    out = side * y >= side * limit - 3.0 * noise
    return np.asarray(np.convolve(out, np.ones(2 * CLIPPING_MARGIN_SAMPLES + 1), "same") > 0.5)


@dataclass(frozen=True)
class _Corrected:
    """A column as it may have been meant: what was wrong with it, what is fitted without that, and up to which sample."""

    fault: Placed
    shooting: Shooting
    stop: int


def _miswired(scene: PlantScene) -> list[Placed]:
    """The columns with which nothing can be followed: the best explanation, then others as good."""
    shooting, n = scene.shooting, scene.log.n
    if n < MIN_STEPS_FOR_REPEATS or not shooting.inputs or not shooting.states:
        return []
    own, x0 = _left(shooting, 0, n)
    stuck = _stuck_inputs(shooting) if own > MAX_FOLLOWED_SHARE else []
    if stuck or own < MIN_ASTRAY_SHARE:
        return stuck
    tried = [(_left(m.shooting, 0, m.stop)[0], m.fault) for m in (*_turned(shooting), *_moved(shooting, x0))]
    best = min((left for left, _ in tried), default=np.inf)
    if best > MAX_FOLLOWED_SHARE * min(own, 1.0):
        return []
    good = [(left, f) for left, f in tried if left < MAX_TIE_RATIO * max(best, NEGLIGIBLE_SHARE)]
    return [f for _, f in sorted(good, key=lambda a: a[0])]


def _left(shooting: Shooting, a: int, b: int) -> tuple[float, Array]:
    """The largest share of a channel's standard deviation that a model leaves over samples a to b; and what was fitted.

    Only where it starts is fitted: parameters keep their assumed values.
    """
    plant = shooting.plant
    assumed = replace(
        plant.model, parameters={n: replace(p, sd=0.0) for n, p in plant.model.parameters.items()}
    )
    shooting = replace(shooting, plant=type(plant)(assumed, plant.kinds))
    x0 = shooting.fit(shooting.guess(a, MIN_FIRST_WINDOW_SAMPLES), a, b)
    shares = []
    for (name, (at, values)), part in zip(shooting.data.items(), shooting.left(x0[:, None], a, b)[:, :, 0]):
        inside = values[(at >= a) & (at < b)]
        if inside.size < 2:
            continue
        if np.abs(part).max() >= MAX_DISTANCE_SD:  # held there: it may be any more
            return np.inf, x0
        beyond = max(float(np.sum(part**2)) / inside.size - MAX_NOISE_VARIANCES, 0.0)
        shares.append(float(np.sqrt(beyond)) / shooting.weights[name] / max(float(np.std(inside)), 1e-300))
    return max(shares, default=0.0), x0


def _turned(shooting: Shooting) -> Iterator[_Corrected]:
    """Every column with the opposite sign or in another unit."""
    wrong: list[tuple[Effect, float]] = [(SignError(), -1.0)]
    wrong += [(UnitError(f), f) for _, k in UNIT_FACTORS for f in (k, 1.0 / k)]
    for effect, factor in wrong:
        for name, (at, values) in shooting.data.items():
            data = {**shooting.data, name: (at, values / factor)}
            yield _Corrected(Placed(effect, name), replace(shooting, data=data), shooting.t.size)
        for name, u in shooting.inputs.items():
            inputs = {**shooting.inputs, name: u / factor}
            yield _Corrected(Placed(effect, name), replace(shooting, inputs=inputs), shooting.t.size)


def _moved(shooting: Shooting, x0: Array) -> Iterator[_Corrected]:
    """Inputs whose log is late, by as much as the channels say."""
    late = lateness(shooting.data, shooting.simulated(np.concatenate([x0, shooting.trusted])))
    if late >= 0:
        return
    dt = float(np.median(np.diff(shooting.t)))
    for name, u in shooting.inputs.items():
        inputs = {**shooting.inputs, name: np.concatenate([u[-late:], np.full(-late, u[-1])])}
        fault = Placed(TooEarly(-late * dt), name)
        yield _Corrected(fault, replace(shooting, inputs=inputs), shooting.t.size + late)


def _stuck_inputs(shooting: Shooting) -> list[Placed]:
    """Inputs that stand unusually long, while the model follows the plant before or after but not then."""
    n, found = shooting.t.size, []
    for name, u in shooting.inputs.items():
        first, length = runs(u)
        k = int(np.argmax(length))
        a, b = int(first[k]), int(first[k] + length[k])
        others = np.delete(length, k)
        if (
            b - a < MIN_STUCK_FRACTION_OF_RECORD * n
            or not others.size
            or b - a < MIN_STUCK_RATIO * float(np.median(others))
        ):
            continue
        outside = max(((0, a), (b, n)), key=lambda s: s[1] - s[0])
        if outside[1] - outside[0] < MIN_STEPS_FOR_REPEATS or b - a < MIN_STEPS_FOR_REPEATS:
            continue
        if _left(shooting, *outside)[0] < MAX_FOLLOWED_SHARE and _left(shooting, a, b)[0] > MIN_ASTRAY_SHARE:
            t = shooting.t
            found.append(Placed(Stuck(float(t[a] - t[0]), float(t[b - 1] - t[a])), name))
    return found
