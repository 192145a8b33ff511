"""Noise of inertial sensors that a flight asks for: of another size than assumed, or one that follows what shakes them.

Who flies with the noise of the bench finds it too small in the air, and too large on the ground once it is tuned in the
air. Where the log says how hard the sensors were shaken, or how many of their samples were clipped, their noise follows
that, with one number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import acts_on
from kfgen.effects.driven.noise_level import NOISE_LEVEL, NoiseLevel, leveled
from kfgen.effects.driven.proportional import driver_named
from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
from kfgen.gap.flight.noise.tuned import INPUT_SD_OF_LOG
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

MIN_LEVEL_NATS = 5.0
"""Posterior gain of another size of a noise, from which it is not as assumed."""
MIN_SLOPE_NATS = 7.0
"""Gain of a noise that follows a driver over one of a single size, from which it is said."""
PROMISING_SHARE = 0.5
"""Of these, as far as slope and curvature at the size before foretell the gain, from which a fit is worth its time."""
MIN_RATIO = 1.3
"""Of the noise in the nine tenths between the driver's extremes, the largest over the smallest."""
FIRST_STEP = 0.2
"""In the logarithm of the noise, of a standard deviation of the driver."""
FIT_STEPS = 60
"""Evaluations of the likelihood of a level and a slope."""


def with_inertial_noise(path: FlownPath) -> tuple[FlownPath, tuple[str, ...], tuple[Placed, ...]]:
    """The path by inertial samples with the noise that it asks for, whose is not as assumed, and what it follows.

    Parameters
    ----------
    path : FlownPath
        Smoothed.

    Returns
    -------
    FlownPath, tuple of str, tuple of Placed
        The path itself where all is as assumed; names of inputs; what their noise follows.
    """
    start, others, followed = path, list[str](), list[Placed]()
    for name in path.equations.input_noise:
        level = _level(path, name)
        sized = path if level is None else replace(path, sizes=_sized(path.sizes, name, level))
        best = max((f for d in _drivers(sized, name) if (f := _slope(d)) is not None), default=None)
        if best is not None:
            sizes = best.noise.sizes(best.level, best.slope)
            sized = replace(path, sizes=sizes)
            followed.append(Placed(best.noise.effect(best.slope), name))
        if sized is not path:
            path = sized
            others.append(name)
    return (start if path is start else path.smoothed()), tuple(others), tuple(followed)


def _sized(sizes: NoiseSizes, name: str, level: float) -> NoiseSizes:
    """With the noise of an input of another size, by the logarithm of the factor."""
    return replace(sizes, inputs={**sizes.inputs, name: float(np.exp(level)) * sizes.inputs.get(name, 1.0)})


def _level(path: FlownPath, name: str) -> float | None:
    """Logarithm of the most likely size of a noise over that of the path; None where the path's does as well."""
    from scipy.optimize import minimize_scalar

    def value(x: float) -> float:
        prior = -0.5 * (x / INPUT_SD_OF_LOG) ** 2
        return path.log_likelihood_with(_sized(path.sizes, name, x)) + prior

    here = path.linear.log_likelihood
    if not _is_promising(value, here, MIN_LEVEL_NATS):
        return None
    best = minimize_scalar(lambda x: -value(x), bracket=(0.0, FIRST_STEP), tol=0.01)
    return float(best.x) if -best.fun - here > MIN_LEVEL_NATS else None


def _is_promising(value: Callable[[float], float], middle: float, wanted: float) -> bool:
    """Whether a number away from zero, at which a likelihood has a known value, may gain so many nats."""
    up, down = value(FIRST_STEP), value(-FIRST_STEP)
    slope, bend = (up - down) / (2.0 * FIRST_STEP), (2.0 * middle - up - down) / FIRST_STEP**2
    wanted *= PROMISING_SHARE
    return max(up, down) - middle > wanted or slope**2 > 2.0 * wanted * bend


@dataclass(frozen=True)
class _DrivenNoise:
    """The noise of an input by a driver, in the sizes of a path."""

    path: FlownPath
    name: str
    driver: str

    @cached_property
    def away(self) -> Array:
        """The driver from its mean, in standard deviations, shape (n,)."""
        values = np.asarray(self.path.log.drive[self.driver])
        return np.asarray((values - values.mean()) / values.std())

    def effect(self, slope: float) -> NoiseLevel:
        """The effect of the catalogue, by the slope of the logarithm for a standard deviation."""
        values = np.asarray(self.path.log.drive[self.driver])
        return leveled(self.driver)(slope / float(values.std()), float(values.mean()))

    def ratio(self, slope: float) -> float:
        """The largest noise over the smallest, the driver's extremes left out."""
        lo, hi = np.quantile(self.away, [0.05, 0.95])
        return float(np.exp(abs(slope) * (hi - lo)))

    def sizes(self, level: float, slope: float) -> NoiseSizes:
        """By logarithms of a level and of what a standard deviation of the driver adds."""
        sizes = _sized(self.path.sizes, self.name, level)
        return replace(sizes, courses={**sizes.courses, self.name: np.exp(slope * self.away)})

    def __call__(self, level: float, slope: float) -> float:
        """The log-likelihood [nats]."""
        return self.path.log_likelihood_with(self.sizes(level, slope))


@dataclass(frozen=True, order=True)
class _Slope:
    """What fits best: its gain over a single size [nats], the logarithms of its level and slope."""

    gain: float
    level: float = field(compare=False)
    slope: float = field(compare=False)
    noise: _DrivenNoise = field(compare=False)


def _drivers(path: FlownPath, name: str) -> Iterator[_DrivenNoise]:
    """What may shake an input, of what the log has and the filter does not know yet."""
    model = path.log.discrete.model
    known = {e.name for c in model.noise for e in model.noise[c] if acts_on(name, c)}
    for driver, values in path.log.drive.items():
        shakes = any(acts_on(s, name) or acts_on(name, s) for s in driver_named(driver).shakes)
        is_known = NOISE_LEVEL + driver in known or name in path.sizes.courses
        if shakes and np.ptp(values) > 0.0 and not is_known:
            yield _DrivenNoise(path, name, driver)


def _slope(noise: _DrivenNoise) -> _Slope | None:
    """The most likely level and slope; None where a single size, that of the path, does as well."""
    from scipy.optimize import minimize

    single = noise.path.linear.log_likelihood
    if not _is_promising(lambda x: noise(0.0, x), single, MIN_SLOPE_NATS):
        return None
    sign = 1.0 if noise(0.0, FIRST_STEP) > noise(0.0, -FIRST_STEP) else -1.0
    simplex = np.array([[0.0, 0.0], [-FIRST_STEP, 0.0], [0.0, sign * FIRST_STEP]])
    limits = {"maxfev": FIT_STEPS, "initial_simplex": simplex, "xatol": 0.01, "fatol": 0.01}
    best = minimize(lambda x: -noise(*x.tolist()), np.zeros(2), method="Nelder-Mead", options=limits)
    level, slope = best.x.tolist()
    gain = float(-best.fun) - single
    return (
        _Slope(gain, level, slope, noise)
        if gain > MIN_SLOPE_NATS and noise.ratio(slope) > MIN_RATIO
        else None
    )
