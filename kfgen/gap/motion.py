"""The motion world: sensors that move, against what they should have read.

Each channel of the noise model that has a truth in the log is compared with it. Delay and bandwidth act on the
truth, every other effect adds to it; beside them stand a constant bias for each rate and force channel (no gap)
and, under an attitude alone, the magnetic field in space. What is left is divided by the square root
of the noise's density, to which the noise of the reference is added; where the reference has holes, and beyond
its bandwidth, nothing is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.axes import axis_faults
from kfgen.effects.motion import Bandwidth, Lag, Motion, Signals, TimeDelay, unheard
from kfgen.errors import InputError
from kfgen.gap.offers import Bench, offers
from kfgen.gap.scene import Placed, Point, Unknown
from kfgen.gap.truth import Truth, held, place, truth_of
from kfgen.gap.whitened import Whitener
from kfgen.log import Log
from kfgen.noise import NoiseModel
from kfgen.units import STANDARD_GRAVITY, parse_unit

Array = NDArray[np.float64]

FEW = 128
"""Samples without a truth that may follow the mean beside them; more would be seen in the spectrum."""
BESIDE = 32
"""Samples on either side of a stretch that is not compared to which its noise is joined."""
UNLIKE = 0.2
"""Share of a channel's power that may be no motion of the triad where its axes are looked at."""
NOTICED = 3.0
"""Deviations by which 5 % of a reference's motion must stand above the noise for it to count as motion."""


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
    """

    name: str
    sensor: str
    unit: str
    axis: int
    y: Array
    noise: tuple[Effect, ...]
    keep: int


@dataclass(frozen=True)
class MotionScene:
    """Moving sensors against their truth; see `kfgen.gap.scene.Scene`.

    Parameters
    ----------
    truth : Truth
    compared : tuple of Compared
    good : ndarray of bool, shape (n,)
        Where both the truth and every channel are there.
    drive : mapping of str to ndarray
        Recorded drivers, the temperature.
    own : tuple of Placed
        What is believed of the channels beside their noise.
    """

    truth: Truth
    compared: tuple[Compared, ...]
    good: NDArray[np.bool_]
    drive: Mapping[str, Array]
    own: tuple[Placed, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that are compared."""
        return tuple(c.name for c in self.compared)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Ordinates of each channel."""
        return tuple(c.keep for c in self.compared)

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return self.truth.dt

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        return float(self.truth.t[0]), float(self.truth.t[-1])

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The biases and the field in space, believed as least squares has them."""
        found = []
        for c in self.compared:
            if c.sensor != "mag":
                away = (c.y - self.truth.signals(c.sensor).y[:, c.axis])[self.good]
                found.append(Unknown(f"bias of {c.name}", parse_unit(c.unit).si, float(away.mean()), np.inf))
        field = self.believed_field()
        if field is not None:
            unit = next(parse_unit(c.unit).si for c in self.compared if c.sensor == "mag")
            found += [Unknown(f"field along {a}_n", unit, float(m), np.inf) for a, m in zip("123", field)]
        return tuple(found)

    def believed_field(self, left_out: Array | None = None) -> Array | None:
        """The field in space [T] by least squares, shape (3,), where it is unknown.

        Parameters
        ----------
        left_out : ndarray, shape (n, 3), optional
            What effects add to the readings.
        """
        axes = [c for c in self.compared if c.sensor == "mag"]
        if not axes or "mag" in self.truth.read or self.truth.R_bn is None:
            return None
        J, b = np.zeros((3, 3)), np.zeros(3)
        for c in axes:
            rows = self.truth.R_bn[self.good, c.axis]
            y = c.y if left_out is None else c.y - left_out[:, c.axis]
            J += rows.T @ rows
            b += rows.T @ y[self.good]
        return np.asarray(np.linalg.lstsq(J, b, rcond=1e-9)[0])

    @cached_property
    def whiteners(self) -> tuple[Whitener, ...]:
        """What divides each channel by the square root of its density."""
        return tuple(self._whitener(c) for c in self.compared)

    def _whitener(self, c: Compared) -> Whitener:
        n, dt = self.truth.t.size, self.dt
        white = Whitener.of(c.noise, n, dt, constant=True)
        if c.sensor == "gyro" and "gyro" in self.truth.bandwidth:
            reference = self.truth.floor.density(np.arange(n) / (2.0 * n * dt))
        elif c.sensor not in self.truth.read:
            field = self.believed_field()
            reference = np.full(
                n, float(np.sum((0.0 if field is None else field) ** 2)) * self.truth.angle**2
            )
        else:
            reference = np.full(n, (STANDARD_GRAVITY * self.truth.angle) ** 2 * (c.sensor == "accel"))
        with np.errstate(divide="ignore"):
            S = np.where(white.weight > 0.0, white.weight**-2.0, np.inf) + reference
        return Whitener(S**-0.5)

    def residuals(self, points: Sequence[Point]) -> Array:
        """Whitened residuals, shape (sum of lengths, points)."""
        out = np.empty((sum(self.lengths), len(points)))
        for k, point in enumerate(points):
            at = 0
            for c, white, left in zip(self.compared, self.whiteners, self.left(point)):
                out[at : at + c.keep, k] = white.ordinates(left)[: c.keep]
                at += c.keep
        return out

    def left(self, point: Point) -> list[Array]:
        """What is left of each channel in time [SI], each of shape (n,); zero where nothing is compared."""
        biased = [c for c in self.compared if c.sensor != "mag"]
        bias = {c.name: float(b) for c, b in zip(biased, point.unknowns)}
        m_n = point.unknowns[len(biased) :]
        felt = {s: self.truth.signals(s, m_n) for s in {c.sensor for c in self.compared}}
        out, lagged = [], {}
        for c in self.compared:
            here = self._acting(c, (*self.own, *point.placed))
            late = (c.sensor, *(e for e in here if isinstance(e, Lag)), *_needs(here))
            if late not in lagged:  # the axes of a triad mostly lag alike
                lagged[late] = delayed(felt[c.sensor], here)
            predicted = self._shown(c, lagged[late], here) + bias.get(c.name, 0.0)
            left = self._believed_where(c, c.y - predicted, self.good & ~unheard(self.truth.t, here))
            out.append(self._believed_within(c, left, edges_of(here)))
        return out

    def _believed_where(self, c: Compared, left: Array, known: NDArray[np.bool_]) -> Array:
        """What is left, with noise as it is believed about the mean beside, where no truth is known."""
        if known.all():
            return left
        k = self.compared.index(c)
        noise = self.made_up[k]
        away = np.where(known, left - noise, 0.0)
        beside = np.ones(2 * BESIDE + 1)
        count = np.convolve(known, beside, mode="same")
        near = np.flatnonzero(count > min(BESIDE, 0.9 * float(count.max())))
        level = np.interp(
            np.arange(left.size), near, np.convolve(away, beside, mode="same")[near] / count[near]
        )
        if known.size - int(known.sum()) > FEW:
            level = self.whiteners[k].completed(np.where(known, away, level), known)
        return np.where(known, left, noise + level)

    def _believed_within(self, c: Compared, left: Array, edges: Sequence[tuple[float, float]]) -> Array:
        """What is left, with noise as it is believed where nobody knows what should have been read."""
        for start, stop in edges:
            i, j = np.searchsorted(self.truth.t, [start, stop])
            beside = [left[max(i - BESIDE, 0) : i], left[j : j + BESIDE]]
            if j - i < 2 or not all(b.size for b in beside):
                continue
            noise = self.made_up[self.compared.index(c)][i:j]
            loud = np.sqrt(sum(np.sum(np.diff(b) ** 2) for b in beside) / sum(b.size for b in beside))
            noise = noise * (loud / max(float(np.sqrt(np.mean(np.diff(noise) ** 2))), 1e-300))
            ends = [float(b.mean()) for b in beside]
            own = [float(noise[:BESIDE].mean()), float(noise[-BESIDE:].mean())]
            left = left.copy()
            left[i:j] = noise + np.linspace(ends[0] - own[0], ends[1] - own[1], j - i)
        return left

    @cached_property
    def made_up(self) -> tuple[Array, ...]:
        """Noise of each channel as it is believed, always the same [SI]."""
        rng = np.random.default_rng(0)
        z = rng.standard_normal((len(self.compared), self.truth.t.size))
        weights = [np.where(w.weight > 0.0, w.weight, np.inf) for w in self.whiteners]
        return tuple(Whitener.back(x / w) for x, w in zip(z, weights))

    def _predicted(self, c: Compared, felt: Signals, placed: Sequence[Placed]) -> Array:
        """What a channel should read under effects [SI], shape (n,)."""
        here = self._acting(c, placed)
        return self._shown(c, delayed(felt, here), here)

    @staticmethod
    def _acting(c: Compared, placed: Sequence[Placed]) -> list[Effect]:
        """The effects on a channel."""
        return [p.effect for p in placed if p.where in (c.name, c.sensor)]

    def _shown(self, c: Compared, felt: Signals, here: Sequence[Effect]) -> Array:
        """What a channel should read of what its triad felt, late already [SI], shape (n,)."""
        y = felt.y[:, c.axis].copy()
        for effect in here:
            if isinstance(effect, Motion):
                y += 0.0 if isinstance(effect, Lag) else effect.output(felt, c.axis)
            elif effect.coefficients():
                y += effect.mean(self.truth.t - self.truth.t[0], self.drive)
        return y

    def moving(self, c: Compared) -> bool:
        """Whether 5 % of what a channel should have read would be noticed."""
        field = self.believed_field()
        u = self.truth.signals(c.sensor, field).y[:, c.axis]
        white = self.whiteners[self.compared.index(c)]
        z = white.ordinates(np.where(self.good, u - u[self.good].mean(), 0.0))[1 : c.keep]
        return bool(0.05 * np.linalg.norm(z) > NOTICED)

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """Every addition that the log allows beside these, with typical sizes to start from."""
        return offers(self.bench(placed), placed)

    def bench(self, placed: Sequence[Placed]) -> Bench:
        """What the candidates are chosen by."""
        places = {(c.name, c.sensor, c.axis): self.moving(c) for c in self.compared}
        moved, still = (tuple(k for k, v in places.items() if v is there) for there in (True, False))
        extra = np.zeros((self.truth.t.size, 3))
        y = np.zeros((self.truth.t.size, 3))
        spread = 0.0
        for c in self.compared:
            if c.sensor == "mag":
                felt = self.truth.signals("mag", np.zeros(3))
                alone = felt.y[:, c.axis]
                extra[:, c.axis] = self._predicted(c, felt, (*self.own, *placed)) - alone
                y[:, c.axis] = c.y - (alone if "mag" in self.truth.read else 0.0)
                middle = self._whitener(c).weight[1 : c.keep]
                spread = max(spread, float(1.0 / np.median(middle)))
        field = self.believed_field(extra)
        good = self.good.copy()
        for start, stop in edges_of([p.effect for p in (*self.own, *placed)]):
            good[(self.truth.t >= start) & (self.truth.t < stop)] = False
        return Bench(self.truth, moved, still, good, y - extra, spread, field, self.drive)

    def faults(self) -> tuple[Placed, ...]:
        """Channels that read another axis, the opposite, or another unit than they should."""
        found = []
        for c in self.compared:
            if c.sensor in self.truth.read or c.sensor != "mag":
                X, y = self.truth.signals(c.sensor).y[self.good], c.y[self.good]
                row = combination(X - X.mean(axis=0), y - y.mean())
                found += [Placed(e, c.name) for e in axis_faults(row, c.axis)]
        return tuple(found)

    def part(self, start: float, stop: float) -> MotionScene:
        """The same world from `start` to `stop` [s]."""
        i, j = np.searchsorted(self.truth.t, [start, stop], side="left")
        if stop >= self.truth.t[-1]:
            j = self.truth.t.size
        if j - i < 16:
            raise InputError("a part of the log is too short", remedy="Give a longer log")
        share = (j - i) / self.truth.t.size
        kept = tuple(
            replace(c, y=c.y[i:j], keep=min(int(j - i), max(2, round(share * c.keep)))) for c in self.compared
        )
        drive = {k: v[i:j] for k, v in self.drive.items()}
        return MotionScene(self.truth.cut(int(i), int(j)), kept, self.good[i:j], drive, self.own)


def _needs(effects: Sequence[Effect]) -> tuple[str, ...]:
    """The drivers that effects need."""
    return tuple(sorted({n for e in effects if isinstance(e, Motion) for n in e.needs}))


def combination(X: Array, y: Array) -> Array:
    """Coefficients of the columns of `X`, shape (n, 3), of which `y` consists; zeros where it does not."""
    row = np.linalg.lstsq(np.nan_to_num(X), y, rcond=1e-6)[0]
    left = y - np.nan_to_num(X) @ row
    return np.asarray(row if left @ left < UNLIKE * float(y @ y) else np.zeros(3))


def edges_of(effects: Sequence[Effect]) -> list[tuple[float, float]]:
    """Times [s] within which effects come or go, and nobody knows how."""
    out = []
    for e in effects:
        edge = float(getattr(e, "edge", 0.0))
        if edge > 0.0:
            first, last = float(getattr(e, "time", 0.0)), float(getattr(e, "duration", 0.0))
            out += [(first, first + edge), (first + last - edge, first + last)]
    return out


def delayed(felt: Signals, effects: Sequence[Effect]) -> Signals:
    """What a triad feels after its delays and then its bandwidths; drivers too where an effect needs them."""
    lags: list[Lag] = [e for e in effects if isinstance(e, TimeDelay)]
    lags += [e for e in effects if isinstance(e, Bandwidth)]
    needed = _needs(effects)
    for lag in lags:
        moved: dict[str, Any] = {
            name: lag.passed(value, felt.dt)
            for name in ("y", *needed)
            if (value := getattr(felt, name)) is not None
        }
        felt = replace(felt, **moved)
    return felt


def motion_scene(log: Log, noise: NoiseModel) -> MotionScene | None:
    """The motion world of a log; none where there is no reference or nothing moves.

    Raises
    ------
    InputError
        Time is uneven, a reference has no numbers, or a channel's unit does not meet its noise's.
    """
    if not any(name.startswith("ref_") for name in log.channels):
        return None
    log = log.cut(*held(log))
    truth = truth_of(log)
    if truth is None:
        return None
    compared = tuple(c for name in noise.channels if (c := _compared(log, noise, truth, name)) is not None)
    if not compared:
        return None
    good = truth.good & np.isfinite([log.channels[c.name].values for c in compared]).all(axis=0)
    drive = {}
    if "temperature" in log.channels and np.isfinite(log.channels["temperature"].values).all():
        drive["temperature"] = log.channels["temperature"].values
    own = tuple(
        Placed(e, c.name) for c in compared for e in c.noise if isinstance(e, Motion) or e.coefficients()
    )
    scene = MotionScene(truth, compared, good, drive, own)
    return scene if any(scene.moving(c) for c in compared) else None


def _compared(log: Log, noise: NoiseModel, truth: Truth, name: str) -> Compared | None:
    sensor, axis = place(name)
    if name not in log.channels or axis not in truth.axes.get(sensor, ()):
        return None
    channel, believed = log.channels[name], noise.channel(name)
    if not parse_unit(channel.unit).same_dimension(parse_unit(believed.unit)):
        raise InputError(
            f"{name} is in {channel.unit}, its noise in {believed.unit}",
            where=log.source,
            remedy="Give the unit with --columns",
        )
    keep = log.n
    if sensor in truth.bandwidth:
        keep = min(keep, int(2.0 * log.n * truth.dt * truth.bandwidth[sensor]))
    y = np.where(np.isfinite(channel.values), channel.values, 0.0)
    return Compared(name, sensor, channel.unit, axis, y, believed.effects, keep)
