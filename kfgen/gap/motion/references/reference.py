"""What a reference lacks: it repeats itself while the sensor moves, held at its own rate or stuck; its holes.

A rate table at rest, or at a constant rate, repeats itself too: there the sensor does not move either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.core.errors import InputError
from kfgen.effects.faults.reference import HeldReference, StuckReference
from kfgen.effects.series import noise_of
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log

Array = NDArray[np.float64]

MIN_LONG_RUN_SAMPLES = 8
"""Equal samples in a row that are looked at one by one."""
MIN_MOTION_SD = 8.0
"""Standard deviations of a sample's noise by which more than half of a stretch must be off its median ..."""
MIN_MOTION_SHARE = 0.05
"""... and share of the standard deviation of the whole log: then the sensor moves."""
MAX_HOLD_S = 1.0
"""Seconds for which a reference is held at most; what repeats itself for longer was set."""
MIN_REGULAR_SHARE = 0.9
"""Share of the samples that stand in stretches of the usual length, give or take one."""
MIN_VARIANCE_RATIO = 4.0
"""Ratio of the variance within a stretch to that of the noise from which on the sensor moves in it."""
SPLINE_DEGREE = 9
"""Of the spline between held values: at a quarter of their rate its error is 3e-5."""
SPLINE_MARGIN_VALUES = 5.0
"""Held values at either end between which the spline is not taken: it has none beyond."""
MAX_KNOWN_RATE_SHARE = 0.3
"""Share of the rate of held values up to which the spline is compared: its error there is 4e-4."""


@dataclass(frozen=True)
class Heard:
    """A log whose references are what they say.

    Parameters
    ----------
    log : Log
        Stuck samples have no number, held ones are interpolated.
    bandwidth : mapping of str to float
        Highest frequency [Hz] up to which a held reference is known, by sensor.
    said : tuple of Placed
    """

    log: Log
    bandwidth: Mapping[str, float] = field(default_factory=dict)
    said: tuple[Placed, ...] = ()


def heard(log: Log) -> Heard:
    """The references of an even log, less what repeats itself though the sensor moves.

    Raises
    ------
    InputError
        Only some of the columns of an attitude are there, or a reference never changes though its sensor moves.
    """
    out = Heard(log)
    for sensor, names in references(log).items():
        read = _read(log, [f"gyro_{a}" for a in AXES] if sensor == "q" else [n[4:] for n in names])
        if read is not None:
            out = _without_repeats(out, sensor, names, read)
    return out


def references(log: Log) -> dict[str, tuple[str, ...]]:
    """The reference channels by sensor; those of the attitude are ``q``.

    Raises
    ------
    InputError
        Only some of the columns of an attitude are there.
    """
    found: dict[str, tuple[str, ...]] = {}
    for name in (n for n in log.channels if n.startswith("ref_")):
        sensor, _, axis = name.removeprefix("ref_").rpartition("_")
        key = sensor if sensor and axis in (*AXES, "w") else name.removeprefix("ref_")
        found[key] = (*found.get(key, ()), name)
    lacks = [f"ref_q_{c}" for c in "wxyz" if f"ref_q_{c}" not in log.channels]
    if 0 < len(lacks) < 4:
        raise InputError(
            f"the reference attitude lacks {', '.join(lacks)}",
            where=log.source,
            remedy="Give all four columns of ref_q, or none",
        )
    return found


def _read(log: Log, names: Sequence[str]) -> Array | None:
    """What channels read, shape (n, channels), holes bridged; none where none is in the log."""
    columns = []
    for name in (n for n in names if n in log.channels):
        y = log.channels[name].values
        there = np.isfinite(y)
        if there.sum() >= MIN_LONG_RUN_SAMPLES:
            columns.append(np.interp(log.t, log.t[there], y[there]))
    return np.array(columns).T if columns else None


def _without_repeats(out: Heard, sensor: str, names: tuple[str, ...], read: Array) -> Heard:
    """The log with one reference put right."""
    u = np.array([out.log.channels[n].values for n in names]).T
    first, length = _stretches(u)
    if length.max() < 2:
        return out
    noise = np.array([noise_of(y) for y in read.T])
    where = "gyro" if sensor == "q" else sensor
    if _is_held(first, length, read, noise, out.log.dt):
        return _between(out, sensor, names, u, first)
    stuck = _stuck(first, length, read, noise)
    if sensor == "q":
        stuck &= _turned(first, length, read * out.log.dt, u)
    if not stuck.any():
        return out
    if stuck.mean() > 0.99:
        raise InputError(
            f"{', '.join(names)} never change{'s' * (len(names) == 1)}, though {where} moves",
            where=out.log.source,
            remedy="Leave the reference out, or give one that moves with the sensor",
        )
    said = Placed(StuckReference(float(stuck.mean())), where)
    return replace(
        out, log=_with(out.log, names, np.where(stuck[:, None], np.nan, u)), said=(*out.said, said)
    )


def _stretches(u: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Stretches of equal rows of values, shape (n, k): the first sample of each, and how many they are."""
    first = np.flatnonzero(np.concatenate([[True], (np.diff(u, axis=0) != 0.0).any(axis=1)]))
    return first, np.diff(np.append(first, len(u)))


def frozen(y: Array, truth: Array, noise: float) -> NDArray[np.bool_]:
    """Where a sensor, shape (n,), repeats itself for long while what it should read moves; the first of them too.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].
    truth : ndarray, shape (n,)
        What should have been read [SI].
    noise : float
        Standard deviation of a sample [SI].
    """
    out = _stuck(*_stretches(y[:, None]), truth[:, None], np.array([noise]))
    out[:-1] |= out[1:]
    return out


def _is_held(first: NDArray[np.intp], length: NDArray[np.intp], read: Array, noise: Array, dt: float) -> bool:
    """Whether values stand for equal times, and the sensor moves within them."""
    usual = float(np.median(length))
    regular = length[np.abs(length - usual) <= 1.0].sum() > MIN_REGULAR_SHARE * length.sum()
    if usual < 2.0 or not regular or usual * dt > MAX_HOLD_S or length.size < 4 * SPLINE_DEGREE:
        return False
    total, square = (np.add.reduceat(x, first, axis=0) for x in (read, read**2))
    n = length[:, None]
    within = (square - total**2 / n) / np.maximum(n - 1.0, 1.0)
    return bool((np.median(within, axis=0) > MIN_VARIANCE_RATIO * noise**2).any())


def _stuck(first: NDArray[np.intp], length: NDArray[np.intp], read: Array, noise: Array) -> NDArray[np.bool_]:
    """Repeated samples during which the sensor moves, shape (n,)."""
    out = np.zeros(len(read), dtype=bool)
    least = np.maximum(MIN_MOTION_SD * noise, MIN_MOTION_SHARE * read.std(axis=0))
    for i, m in zip(first[length >= MIN_LONG_RUN_SAMPLES], length[length >= MIN_LONG_RUN_SAMPLES]):
        part = read[i : i + m]
        if (np.median(np.abs(part - np.median(part, axis=0)), axis=0) > least).any():
            out[i + 1 : i + m] = True
    return out


def _turned(first: NDArray[np.intp], length: NDArray[np.intp], turns: Array, q: Array) -> NDArray[np.bool_]:
    """Where an attitude repeats itself through a turn [rad] that its rounding would show, shape (n,).

    A turn by four times their smallest change moves one of four components by at least that.
    """
    steps = np.abs(np.diff(q, axis=0))
    least = 4.0 * float(steps[steps > 0.0].min(initial=np.inf)) if length.max() < len(q) else 0.0
    out = np.zeros(len(q), dtype=bool)
    for i, m in zip(first[length >= MIN_LONG_RUN_SAMPLES], length[length >= MIN_LONG_RUN_SAMPLES]):
        out[i : i + m] = float(np.linalg.norm(np.cumsum(turns[i : i + m], axis=0), axis=1).max()) > least
    return out


def _between(out: Heard, sensor: str, names: tuple[str, ...], u: Array, first: NDArray[np.intp]) -> Heard:
    """Held values at the times at which they came, and a spline between; an attitude is interpolated as one."""
    from scipy.interpolate import make_interp_spline

    log, k = out.log, np.arange(first.size)
    period = float((first[-1] - first[0]) / (first.size - 1))
    said = (*out.said, Placed(HeldReference(period * log.dt), "gyro" if sensor == "q" else sensor))
    if sensor == "q":
        at = np.zeros(len(u), dtype=bool)
        at[first] = True
        return replace(out, log=_with(log, names, np.where(at[:, None], u, np.nan)), said=said)
    whole = (np.diff(first) == round(period)).all()
    came = first.astype(np.float64) if whole else np.polyval(np.polyfit(k, first, 1), k)
    there = np.isfinite(u[first]).all(axis=1)
    n = np.arange(len(u), dtype=np.float64)
    smooth = make_interp_spline(came[there], u[first][there], k=SPLINE_DEGREE)(n)
    smooth[(n < came[0] + SPLINE_MARGIN_VALUES * period) | (n > came[-1] - SPLINE_MARGIN_VALUES * period)] = (
        np.nan
    )
    known = dict(out.bandwidth) | {sensor: MAX_KNOWN_RATE_SHARE / (period * log.dt)}
    return Heard(_with(log, names, smooth), known, said)


def _with(log: Log, names: tuple[str, ...], values: Array) -> Log:
    """The log with other values in some channels."""
    new = {n: replace(log.channels[n], values=values[:, i]) for i, n in enumerate(names)}
    return replace(log, channels={**log.channels, **new})


def long_holes(holes: NDArray[np.bool_], short: int, margin: int) -> NDArray[np.bool_]:
    """Holes longer than `short` samples, and `margin` on either side; shorter ones are bridged well.

    Parameters
    ----------
    holes : ndarray of bool, shape (n,)
    short : int
        Samples of a hole that is bridged.
    margin : int
        Samples beside a longer one that are left out with it.
    """
    from scipy.ndimage import binary_dilation, binary_opening

    wide = binary_opening(np.pad(holes, 1), structure=np.ones(short + 1))[1:-1]
    return np.asarray(binary_dilation(wide, iterations=max(1, margin))) if wide.any() else wide
