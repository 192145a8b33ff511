"""A channel of a sensor that moves: what is compared of it, and what is wrong with its samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import parse_unit
from kfgen.effects import Effect
from kfgen.effects.faults.samples import Clipping, RepeatedSamples
from kfgen.effects.noise_model import NoiseModel
from kfgen.effects.series import DetectedFault
from kfgen.gap.motion.references.reference import frozen
from kfgen.gap.motion.truth import Truth
from kfgen.gap.rest.faults import assumed_sd, spotted_moving
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log

Array = NDArray[np.float64]

SLOWER_ROWS = 2.0
"""Rows from one sample to the next from which on a sensor is slower than the log."""
NEAR_A_LIMIT = 0.02
"""Relative distance of a truth from the limit of a clipped channel within which it is not compared: a choice of
samples by what was read would be one of their noise."""


@dataclass(frozen=True)
class Compared:
    """A channel against its truth.

    Parameters
    ----------
    name, sensor, unit : str
    axis : int
    y : ndarray, shape (n,)
        What was read [SI], zero where nothing was.
    noise : tuple of Effect
    keep : int
        Ordinates that are compared, from the lowest frequency on.
    there : ndarray of bool, shape (n,)
        Where it was read, and not clipped.
    rows : ndarray of int, shape (m,), optional
        Where it has samples, of a sensor slower than the log.
    biased : bool
        Whether a constant of its own is no gap.
    """

    name: str
    sensor: str
    unit: str
    axis: int
    y: Array
    noise: tuple[Effect, ...]
    keep: int
    there: NDArray[np.bool_]
    rows: NDArray[np.intp] | None = None
    biased: bool = True

    @property
    def at(self) -> NDArray[np.intp] | slice:
        """The rows of the log at which it is compared."""
        return slice(None) if self.rows is None else self.rows

    def size(self, n: int) -> int:
        """How many these are, of a log of `n` rows."""
        return n if self.rows is None else self.rows.size

    @property
    def step(self) -> float:
        """The distance between them, in rows."""
        if self.rows is None:
            return 1.0
        return float(self.rows[-1] - self.rows[0]) / (self.rows.size - 1)


def compared_of(log: Log, noise: NoiseModel, truth: Truth, name: str) -> Compared | None:
    """A channel of a log against its truth; none where it is not in the log, or has no truth.

    Parameters
    ----------
    log : Log
    noise : ChannelNoise
        Assumed of the channel.
    truth : Truth
        What should have been read.
    name : str
        Of the channel.

    Raises
    ------
    InputError
        Its unit does not meet that of its noise.
    """
    sensor, axis = truth.place(name)
    if name not in log.channels or axis not in truth.axes.get(sensor, ()):
        return None
    channel, assumed = log.channels[name], noise.channel(name)
    if not parse_unit(channel.unit).same_dimension(parse_unit(assumed.unit)):
        raise InputError(
            f"{name} is in {channel.unit}, its noise in {assumed.unit}",
            where=log.source,
            remedy="Give the unit with --columns",
        )
    there = np.isfinite(channel.values)
    rows = sample_rows(there)
    keep = log.n if rows is None else rows.size
    if sensor in truth.bandwidth:
        keep = min(keep, int(2.0 * log.n * truth.dt * truth.bandwidth[sensor]))
    y = np.where(there, channel.values, 0.0)
    return Compared(name, sensor, channel.unit, axis, y, assumed.effects, keep, there, rows, sensor != "mag")


def sample_rows(there: NDArray[np.bool_]) -> NDArray[np.intp] | None:
    """The rows of a log at which a slower sensor has its samples; None for one as fast as the log.

    Parameters
    ----------
    there : ndarray of bool, shape (n,)
        Where it has a number.
    """
    at = np.flatnonzero(there)
    if at.size < 2 or float(np.median(np.diff(at))) < SLOWER_ROWS:
        return None
    return at


def _frozen(c: Compared, should: Array, truth: Truth) -> NDArray[np.bool_]:
    """Where a channel repeats itself while its truth moves, shape (n,)."""
    out = np.zeros(c.y.size, dtype=bool)
    out[c.at] = frozen(c.y[c.at], should[c.at], assumed_sd(c.noise, c.step * truth.dt))
    return out


def sound_samples(c: Compared, truth: Truth) -> tuple[Compared, list[Placed], list[Placed]]:
    """A channel without its clipped and frozen samples, its faults that can be left out, and those that spoil it.

    Parameters
    ----------
    c : Compared
    truth : Truth
    """
    there, known, faults = c.there.copy(), c.sensor in truth.read, []
    should = truth.read[c.sensor][:, c.axis] if known else c.y
    if known:
        between = (c.y < c.y[there].max()) & (c.y > c.y[there].min())  # else it is clipped
        stuck = there & between & _frozen(c, should, truth)
        if stuck.any():
            share = float(stuck.mean())
            faults.append(DetectedFault(RepeatedSamples(share), float(stuck.sum()), spoils=share > 0.5))
            there &= ~stuck
    faults += spotted_moving(truth.t[there], c.y[there], c.noise, c.step * truth.dt)
    for limit in (float(f.effect.limit) for f in faults if isinstance(f.effect, Clipping)):
        side = np.sign(limit - float(np.median(c.y[there])))
        there &= side * c.y < side * limit
        if known:
            there &= side * should < side * limit - NEAR_A_LIMIT * abs(limit)
    said, spoilt = ([Placed(f.effect, c.name) for f in faults if f.spoils is bad] for bad in (False, True))
    return replace(c, there=there), said, spoilt


def known_beside(known: NDArray[np.bool_], reach: int) -> tuple[Array, NDArray[np.intp]]:
    """Shares of known samples about each one, and which samples have enough of them.

    Parameters
    ----------
    known : ndarray of bool, shape (n,)
    reach : int
        Samples to either side.

    Returns
    -------
    share : ndarray, shape (n,)
    near : ndarray, shape (m,)
        Indices.
    """
    from scipy.ndimage import uniform_filter1d

    width = 2 * reach + 1
    share = uniform_filter1d(known.astype(np.float64), width, mode="constant")
    return share, np.flatnonzero(share > min(reach / width, 0.9 * float(share.max())))
