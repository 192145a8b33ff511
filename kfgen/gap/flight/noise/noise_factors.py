"""Why the noise of a flight looks larger than it was measured: the factor, and the part of each named effect in it.

Who tunes a filter by its innovations multiplies the noise of a data sheet until they fit, and pays with a filter that trusts
its sensors too little for whatever is missing from its model. Here the size that the log asks for without any named
effect is followed to that beside all of them, one effect after the other, the one that gained most first; and what the
inertial samples themselves show above the motion is vibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import acts_on
from kfgen.gap.core.result import BAD_DATA, NO_GAP, NoiseCause, NoiseSplit
from kfgen.gap.flight.noise.tuned import TunedFlight, TunedSize, tuned
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.gap.scene.scene_gap import SceneGap

Array = NDArray[np.float64]

MIN_FACTOR = 1.2
"""Size over the assumed one, above which a noise is split by its causes."""
MIN_PART = 1.05
"""Factor below which the part of a cause is not listed."""
MOTION_HZ = 10.0
"""Above which nothing that a vehicle does moves its inertial sensors, but what shakes it."""
MIN_RATE_OVER_MOTION = 4.0
"""Samples a second over that frequency, below which there is no band above it."""
SPECTRUM_SAMPLES = 1024
"""Of one piece of a spectrum."""
VIBRATION = "vibration"


def with_noise_factors(gap: SceneGap, scene: FlightScene) -> SceneGap:
    """The answer of a flight with the reasons why its noises look larger than assumed.

    Parameters
    ----------
    gap : SceneGap
        Of that flight.
    scene : FlightScene
        As assumed.
    """
    if gap.verdict in (NO_GAP, BAD_DATA):
        return gap
    return replace(gap, noise_factors=noise_factors(scene, gap.assumed.point, gap.fit.point))


def noise_factors(scene: FlightScene, assumed: ScenePoint, updated: ScenePoint) -> tuple[NoiseSplit, ...]:
    """Noises that look larger than assumed where nothing is named, and which named effect makes them so.

    Parameters
    ----------
    scene : FlightScene
        As assumed.
    assumed, updated : ScenePoint
        Where the fits of what is assumed and of the updated model ended.
    """
    placed = updated.placed
    # Nothing is subtracted in the first, one effect more in each of the others.
    steps = [tuned(scene.about(assumed).path)]
    larger = [k for k, s in enumerate(steps[0].sizes) if s.is_shown and s.ci95[0] > MIN_FACTOR]
    if not larger:
        return ()
    for k in range(len(placed)):
        steps.append(tuned(scene.about(ScenePoint(placed[: k + 1], updated.unknowns)).path))
    return tuple(_factor(scene, placed, steps, k) for k in larger)


def _factor(
    scene: FlightScene, placed: Sequence[Placed], steps: Sequence[TunedFlight], at: int
) -> NoiseSplit:
    """Of one noise, its parts as ratios of one size to the next."""
    sizes: list[TunedSize] = [s.sizes[at] for s in steps]
    ratios = [a.times / b.times for a, b in pairwise(sizes)]
    parts = [NoiseCause(p.effect.name, p.where, r) for p, r in zip(placed, ratios) if r >= MIN_PART]
    left = sizes[0].times / float(np.prod([p.factor for p in parts]))
    if (shaken := min(_above_motion(scene, sizes[0]), left)) >= MIN_PART:
        parts.append(NoiseCause(VIBRATION, sizes[0].group.where, shaken))
        left /= shaken
    return NoiseSplit(sizes[0].group.where, sizes[0].times, sizes[0].ci95, tuple(parts), left)


def _above_motion(scene: FlightScene, size: TunedSize) -> float:
    """Density of an input's samples above the motion over the assumed one; one where it cannot be seen."""
    log, rate = scene.path.log, 1.0 / scene.dt
    named = log.discrete.named_noise[1]
    of_input = [n for n in size.group.inputs if n in named]
    if not of_input or rate < MIN_RATE_OVER_MOTION * MOTION_HZ:
        return 1.0
    from scipy.signal import welch

    u = log.u[:, [k for k, c in enumerate(scene.path.equations.channels) if acts_on(of_input[0], c)]]
    f, density = welch(u, rate, nperseg=min(log.t.size, SPECTRUM_SAMPLES), axis=0)
    # Of white noise of the density N^2 the spectrum of one side is 2 N^2.
    return float(np.sqrt(np.mean(density[f > MOTION_HZ]) / 2.0 / float(named[of_input[0]][1])))
