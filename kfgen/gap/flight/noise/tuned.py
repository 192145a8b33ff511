"""The sizes of a flight's noises by the likelihood of its innovations.

White noise of each input and of each aiding sensor, the vertical of a receiver apart from the horizontal, is of the size with
which the innovations of the whole flight are most likely. What an instrument was measured to have at rest is a prior for the
inputs: a free size of theirs takes up whatever else is missing, until the filter follows its aiding sensors blindly.

References
----------
.. [1] P. de Jong and J. Penzer, Diagnosing shocks in time series, J. Amer. Statist. Assoc. 93(442), 1998.
.. [2] S. J. Koopman, Disturbance smoother for state space models, Biometrika 80(1), 1993 (scores of variances).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.result import NoiseScale
from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
from kfgen.gap.flight.path import FlownPath

Array = NDArray[np.float64]

INPUT_SD_OF_LOG = 0.7
"""Standard deviation of the logarithm of an input's noise in flight over its noise at rest, before the flight."""
SAMPLE_SD_OF_LOG = 1.5
"""The same of a sample of an aiding sensor, whose noise is a guess before the flight."""
MAX_LOG_SIZE = 4.0
"""Of the logarithm of a size."""
ROUNDS = 3
"""Of sizes about a path and a path with these sizes."""
SETTLED_LOG_CHANGE = 0.02
"""Change of the logarithm of every size at which path and sizes agree."""
SCORE_STEP = 0.02
"""Change of a logarithm by which scores are differentiated."""


@dataclass(frozen=True)
class NoiseGroup:
    """Noises of one size.

    Parameters
    ----------
    inputs : tuple of str
        Of the inputs.
    channels : tuple of str
        Of the aiding sensors.
    """

    inputs: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """What has this size, in words."""
        return ", ".join((*self.inputs, *self.channels))

    @property
    def sd_of_log(self) -> float:
        """Standard deviation of the logarithm of the size before the flight."""
        return INPUT_SD_OF_LOG if self.inputs else SAMPLE_SD_OF_LOG


@dataclass(frozen=True)
class TunedSize:
    """A size that was estimated.

    Parameters
    ----------
    group : NoiseGroup
    times : float
        Standard deviation over the assumed one.
    ci95 : (float, float)
        Its interval.
    own_share : float
        Share of what is known of its logarithm that the flight says and not the prior.
    """

    group: NoiseGroup
    times: float
    ci95: tuple[float, float]
    own_share: float

    @property
    def is_shown(self) -> bool:
        """Whether the flight says more of it than what was known before."""
        return self.own_share > 0.5


@dataclass(frozen=True)
class TunedFlight:
    """A flight whose noises have the size that its innovations ask for.

    Parameters
    ----------
    path : FlownPath
        Smoothed with them.
    sizes : tuple of TunedSize
    """

    path: FlownPath
    sizes: tuple[TunedSize, ...]


def shown_scales(sizes: Sequence[TunedSize]) -> tuple[NoiseScale, ...]:
    """The sizes that a flight shows, of each input and channel.

    Parameters
    ----------
    sizes : sequence of TunedSize
    """
    return tuple(
        NoiseScale(c, s.times, s.ci95, white=True)
        for s in sizes
        if s.is_shown
        for c in (*s.group.inputs, *s.group.channels)
    )


def groups_of(path: FlownPath) -> tuple[NoiseGroup, ...]:
    """The noises of a flight that have one size each.

    Parameters
    ----------
    path : FlownPath
    """
    out = [NoiseGroup(inputs=(name,)) for name in path.equations.input_noise]
    for a in path.log.aiding:
        level = tuple(c for c in a.sensor.channels if not c.endswith("_D"))
        down = tuple(c for c in a.sensor.channels if c.endswith("_D"))
        out += [NoiseGroup(channels=c) for c in (level, down) if c]
    return tuple(out)


def tuned(path: FlownPath, inputs: Collection[str] = ()) -> TunedFlight:
    """A flight with the sizes of its noises that are most likely.

    Parameters
    ----------
    path : FlownPath
        Smoothed, with what is known of its effects subtracted.
    inputs : collection of str
        Whose noise alone is looked at; all noises where there is none.
    """
    groups = tuple(g for g in groups_of(path) if not inputs or set(g.inputs) & set(inputs))
    x = _logs(path.sizes, groups)
    for _ in range(ROUNDS):
        likelihood = _SizeLikelihood(path, groups)
        y = likelihood.maximum(x)
        path = replace(path, sizes=_sizes(groups, y, path.sizes)).smoothed()
        settled = bool(np.abs(y - x).max(initial=0.0) < SETTLED_LOG_CHANGE)
        x = y
        if settled:
            break
    return TunedFlight(path, _with_intervals(_SizeLikelihood(path, groups), x))


def sizes_of_part(path: FlownPath, stop: int) -> NoiseSizes:
    """The sizes that are most likely by the readings before a time.

    Parameters
    ----------
    path : FlownPath
        Smoothed, with sizes from which the search begins.
    stop : int
        First step of the path whose readings are not looked at.
    """
    groups = groups_of(path)
    found = _SizeLikelihood(path, groups, stop).maximum(_logs(path.sizes, groups))
    return _sizes(groups, found, path.sizes)


@dataclass(frozen=True)
class _SizeLikelihood:
    """The likelihood of sizes about a path, by all readings or by those before a step."""

    path: FlownPath
    groups: Sequence[NoiseGroup]
    stop: int | None = None

    @cached_property
    def _rows(self) -> list[NDArray[np.intp]]:
        rows = self.path.rows
        seen = rows.t.size if self.stop is None else int(np.searchsorted(rows.at, self.stop))
        found = [np.concatenate([rows.of(c) for c in g.channels]) for g in self.groups if g.channels]
        return [r[r < seen] for r in found]

    def __call__(self, x: Array) -> tuple[float, Array]:
        """Log posterior [nats] of logarithms of sizes, shape (groups,), and its gradient."""
        sizes = _sizes(self.groups, x, self.path.sizes)
        linear = replace(self.path, sizes=sizes).linear.until(self.stop)
        of_rows, of_parts = linear.scores(sizes.of_inputs)
        by_name = dict(zip(sizes.of_inputs, of_parts.tolist()))
        of_inputs = [sum(by_name[i] for i in g.inputs) for g in self.groups if g.inputs]
        prior = np.array([g.sd_of_log for g in self.groups])
        slope = np.array([*of_inputs, *(of_rows[r].sum() for r in self._rows)]) - x / prior**2
        value = linear.log_likelihood - 0.5 * float(np.sum((x / prior) ** 2))
        return value, slope

    def maximum(self, x: Array) -> Array:
        """The logarithms of the most likely sizes, shape (groups,), from a start."""
        from scipy.optimize import minimize

        def loss(y: Array) -> tuple[float, Array]:
            value, slope = self(y)
            return (-value, -slope) if np.isfinite(value) else (1e300, np.zeros_like(y))

        limits = [(-MAX_LOG_SIZE, MAX_LOG_SIZE)] * x.size
        return np.asarray(minimize(loss, x, jac=True, method="L-BFGS-B", bounds=limits).x)

    def information(self, x: Array) -> Array:
        """Minus the second derivatives there, shape (groups, groups)."""
        steps = SCORE_STEP * np.eye(x.size)
        H = np.array([(self(x - s)[1] - self(x + s)[1]) / (2.0 * SCORE_STEP) for s in steps])
        return np.asarray(0.5 * (H + H.T))


def _with_intervals(likelihood: _SizeLikelihood, x: Array) -> tuple[TunedSize, ...]:
    H = likelihood.information(x)
    values, vectors = np.linalg.eigh(H)
    variances = np.diag((vectors / np.maximum(values, 1e-9)) @ vectors.T)
    out = []
    for g, v, var in zip(likelihood.groups, x.tolist(), variances.tolist()):
        sd = min(float(np.sqrt(var)), g.sd_of_log)
        lo, hi = float(np.exp(v - 1.96 * sd)), float(np.exp(v + 1.96 * sd))
        out.append(TunedSize(g, float(np.exp(v)), (lo, hi), 1.0 - (sd / g.sd_of_log) ** 2))
    return tuple(out)


def _sizes(groups: Sequence[NoiseGroup], x: Array, others: NoiseSizes) -> NoiseSizes:
    inputs, channels = dict(others.inputs), dict(others.channels)
    for g, v in zip(groups, np.exp(x).tolist()):
        inputs.update(dict.fromkeys(g.inputs, v))
        channels.update(dict.fromkeys(g.channels, v))
    return replace(others, inputs=inputs, channels=channels)


def _logs(sizes: NoiseSizes, groups: Sequence[NoiseGroup]) -> Array:
    known: Mapping[str, float] = {**sizes.inputs, **sizes.channels}
    return np.log([known.get((*g.inputs, *g.channels)[0], 1.0) for g in groups])
