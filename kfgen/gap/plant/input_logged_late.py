"""Whether an input was logged after its effect: a time advance, which no effect of a plant can have, against all that can be.

An input that is moved forward by more than its advance acts late by the rest, which is fitted as a delay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.faults.samples import TooEarly
from kfgen.effects.plant.terms import InputDelay
from kfgen.gap.core.thresholds import DETECTION_LIMIT_NATS
from kfgen.gap.plant.noise.noisy_scene import NoisyPlantScene
from kfgen.gap.plant.scene import PlantScene
from kfgen.gap.plant.shooting import Shooting
from kfgen.gap.scene.addition import ranked
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, start_of
from kfgen.gap.scene.screen import screen
from kfgen.log.log import Channel

Array = NDArray[np.float64]

MAX_ADVANCE_FRACTION_OF_RECORD = 0.1
"""Of the record: the longest time advance."""
MAX_CHANCE_SD = 4.0
"""Standard deviations of a sum of squares that are chance."""
MIN_EXPLAINED_SHARE = 0.9
"""Share of what is beyond the noise that a time advance must explain, if it is not all."""


def logged_late(scene: PlantScene) -> list[Placed]:
    """The input that was logged too late, if moving it explains the record and better than any effect; else nothing."""
    shooting = scene.shooting
    if not shooting.states:
        return []
    x0 = shooting.fit(_guess(shooting), 0, shooting.t.size)
    if not np.isfinite(x0).all():
        return []
    found = [
        (n, k) for n in scene.inputs if n not in scene.constant_inputs and (k := _samples(shooting, x0, n))
    ]
    trials = [t for n, k in found if (t := _tried(scene, n, k)) is not None]
    return [max(trials, key=lambda t: t.gain).fault] if trials else []


@dataclass(frozen=True)
class _Advance:
    fault: Placed
    gain: float


def _guess(shooting: Shooting) -> Array:
    return np.concatenate([shooting.guess(0, 24), shooting.trusted])


def _samples(shooting: Shooting, x0: Array, name: str) -> int:
    """Samples by which the record fits best when an input is moved forward; zero where one sample does not help."""
    n = shooting.t.size
    longest = int(MAX_ADVANCE_FRACTION_OF_RECORD * n)

    def cost(k: int) -> float:
        moved = replace(shooting, inputs=_forward(shooting.inputs, name, k))
        x = moved.fit(x0, 0, n - longest)
        return float(moved.cost(x[:, None], 0, n - longest)[0])

    costs = {k: cost(k) for k in (0, 1)}
    if not costs[1] < costs[0] - 2.0 * DETECTION_LIMIT_NATS:
        return 0
    k = 1
    while 2 * k <= longest and costs.setdefault(2 * k, cost(2 * k)) < costs[k]:
        k *= 2
    step = k // 2
    while step:
        for near in (k - step, k + step):
            costs.setdefault(near, cost(near) if near <= longest else np.inf)
        k = min((k - step, k, k + step), key=lambda i: costs[i])
        step //= 2
    return k


def _forward(inputs: Mapping[str, Array], name: str, k: int) -> dict[str, Array]:
    """The inputs, one of them moved forward by samples; what is not known of its end is as its last sample."""
    u = np.asarray(inputs[name])
    return {**inputs, name: np.concatenate([u[k:], np.full(k, u[-1])])}


def _tried(scene: PlantScene, name: str, k: int) -> _Advance | None:
    """An advance of about so many samples against every effect and process noise over the same samples."""
    ahead = k + 1
    here, moved = (_in_one(scene, name, ahead, by) for by in (0, ahead))
    base = fitted(here, start_of(here))
    rest = Placed(InputDelay(scene.dt), name)
    fit = fitted(moved, replace(start_of(moved), placed=(rest,)))
    gain, count = fit.value - base.value, fit.residual.size
    beyond, left = (float(np.sum(f.residual**2)) - count for f in (base, fit))
    advance = ahead * scene.dt - float(fit.point.placed[0].effect.late)  # type: ignore[attr-defined]
    if (
        left > max(MAX_CHANCE_SD * np.sqrt(2.0 * count), (1.0 - MIN_EXPLAINED_SHARE) * beyond)
        or advance <= 0.0
    ):
        return None
    others = ranked(here, base, screen(here, base))
    noises = NoisyPlantScene.of_scene(here).likely_random_errors(base.point)
    best = max(
        (*(t.fit.value - base.value for t in others), *(w.evidence - w.occam for w in noises)), default=0.0
    )
    return _Advance(Placed(TooEarly(advance), name), gain) if gain > best + DETECTION_LIMIT_NATS else None


def _in_one(scene: PlantScene, name: str, lost: int, by: int) -> PlantScene:
    """The scene in one segment, an input moved forward by samples, nothing compared in the last ones `lost`."""
    inputs = _forward(scene.inputs, name, by)
    channels = dict(scene.log.channels)
    for n in scene.recorded:
        values = np.array(channels[n].values)
        values[-lost:] = np.nan
        channels[n] = Channel(values, channels[n].unit)
    channels[name] = Channel(inputs[name], channels[name].unit)
    bare = PlantScene.bare(scene.model, replace(scene.log, channels=channels))
    shooting = bare.shooting
    x0 = shooting.fit(_guess(shooting), 0, shooting.t.size)
    begun = dict(zip(shooting.free, x0[shooting.states :].tolist()))
    return replace(
        bare, initial=x0[None, : shooting.states], begun=begun, hidden=shooting.hidden(x0[: shooting.states])
    )
