"""The motion world: sensors that move, against what they should have read.

Each channel of the noise model that has a truth in the log is compared with it. Delay and bandwidth act on the
truth, every other effect adds to it; beside them stand a constant bias for each rate and force channel (no gap)
and, under an attitude alone, the magnetic field in space. What is left is divided by the square root
of the noise's density, to which the noise of the reference is added; where the reference has holes, and beyond
its bandwidth, nothing is compared.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES, acts_on
from kfgen.core.recent_results import RecentResults
from kfgen.core.units import STANDARD_GRAVITY, parse_unit
from kfgen.effects import Effect
from kfgen.effects.faults.axes import axis_faults
from kfgen.effects.inertial.errors import Mounting
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.lag import MAX_NOISE_SIGMAS, Lag, unheard
from kfgen.gap.core.completion import Completion
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.motion.candidates import MotionCandidates, offers
from kfgen.gap.motion.compared_channel import Compared, known_beside
from kfgen.gap.motion.likeness import Likeness, combination, likeness
from kfgen.gap.motion.placed_effects import delayed, edges_of, is_motion, needs_of, with_errors
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed, ScenePoint, Unknown

Array = NDArray[np.float64]

BESIDE = 32
"""Samples on either side of a stretch that is not compared to which its noise is joined."""
RECENT = 4
"""Results of a channel that are kept: those of the point about which a fit or a screen moves, and of some beside."""


@dataclass(frozen=True)
class MotionScene:
    """Moving sensors against their truth; see `kfgen.gap.scene.scene.Scene`.

    Parameters
    ----------
    truth : Truth
    compared : tuple of Compared
    good : ndarray of bool, shape (n,)
        Where both the truth and every channel are there.
    drive : mapping of str to ndarray
        Recorded drivers.
    own : tuple of Placed
        What is assumed about the channels beside their noise.
    said : tuple of Placed
        Faults of the samples and the references that were left out, or corrected.
    spoilt : tuple of Placed
        Faults with which a fit would mean nothing.
    warnings : tuple of str
        What is not compared, and why.
    sensors : int
        Of the log, each of which is compared in a scene of its own: an effect may be in any of them.
    """

    truth: Truth
    compared: tuple[Compared, ...]
    good: NDArray[np.bool_]
    drive: Mapping[str, Array]
    own: tuple[Placed, ...] = ()
    said: tuple[Placed, ...] = ()
    spoilt: tuple[Placed, ...] = ()
    warnings: tuple[str, ...] = ()
    sensors: int = 1

    def by_sensor(self) -> tuple[MotionScene, ...]:
        """A scene of each sensor: none changes what another should have read, and what one lacks must not hide another.

        One whose samples are spoilt stays as it is.
        """
        sensors = list(dict.fromkeys(_device(c) for c in self.compared))
        if len(sensors) == 1 or self.faults():
            return (self,)
        return tuple(self._of(s, len(sensors)) for s in sensors)

    def _of(self, sensor: str, sensors: int) -> MotionScene:
        compared = tuple(c for c in self.compared if _device(c) == sensor)
        own, said = (
            tuple(p for p in ps if any(acts_on(p.where, c.name) for c in compared))
            for ps in (self.own, self.said)
        )
        return replace(self, compared=compared, own=own, said=said, sensors=sensors)

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
        """The biases and the field in space, assumed as least squares has them."""
        found = []
        for c in self.compared:
            if c.biased:
                away = (c.y - self.truth.signals(c.sensor).y[:, c.axis])[self.good & c.there]
                found.append(Unknown(f"bias of {c.name}", parse_unit(c.unit).si, float(away.mean()), np.inf))
        field = self.assumed_field()
        if field is not None:
            unit = next(parse_unit(c.unit).si for c in self.compared if c.sensor == "mag")
            found += [Unknown(f"field along {a}_n", unit, float(m), np.inf) for a, m in zip("123", field)]
        return tuple(found)

    def assumed_field(self, left_out: Array | None = None) -> Array | None:
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
            good = self.good & c.there
            rows = self.truth.R_bn[good, c.axis]
            y = c.y if left_out is None else c.y - left_out[:, c.axis]
            J += rows.T @ rows
            b += rows.T @ y[good]
        return np.asarray(np.linalg.lstsq(J, b, rcond=1e-9)[0])

    @cached_property
    def whiteners(self) -> tuple[Whitener, ...]:
        """What divides each channel by the square root of its density."""
        return tuple(self._whitener(c) for c in self.compared)

    def _whitener(self, c: Compared) -> Whitener:
        n, dt = c.size(self.truth.t.size), c.step * self.dt
        white = Whitener.of(c.noise, n, dt, constant=True)
        if c.sensor == "gyro" and "gyro" in self.truth.bandwidth:
            reference = self.truth.floor.density(np.arange(n) / (2.0 * n * dt))
        elif c.sensor not in self.truth.read:
            field = self.assumed_field()
            reference = np.full(
                n, float(np.sum((0.0 if field is None else field) ** 2)) * self.truth.angle**2
            )
        else:
            reference = np.full(n, (STANDARD_GRAVITY * self.truth.angle) ** 2 * (c.sensor == "accel"))
        with np.errstate(divide="ignore"):
            S = np.where(white.weight > 0.0, white.weight**-2.0, np.inf) + reference
        return Whitener(S**-0.5)

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """Whitened residuals, shape (sum of lengths, points)."""
        out = np.empty((sum(self.lengths), len(points)), order="F")
        ends = np.cumsum(self.lengths)
        for k, point in enumerate(points):
            for i, (c, end) in enumerate(zip(self.compared, ends)):
                out[end - c.keep : end, k] = self._ordinates(i, point)
        return out

    def _ordinates(self, i: int, point: ScenePoint) -> Array:
        """Whitened residuals of one channel; most points differ in what acts on another."""
        c, white = self.compared[i], self.whiteners[i]
        acting = self._acting(c, (*self.own, *point.placed))
        unknowns = self._unknowns_of(c, point.unknowns)
        return self.memory[i].recalled(
            (*acting, *unknowns), lambda: white.ordinates(self._left(c, acting, unknowns))[: c.keep]
        )

    @cached_property
    def memory(self) -> tuple[RecentResults[Array], ...]:
        """What was computed of each channel last."""
        return tuple(RecentResults(RECENT) for _ in self.compared)

    @cached_property
    def lagged(self) -> RecentResults[Signals]:
        """What triads felt late, as it was computed last: their axes mostly lag alike."""
        return RecentResults(RECENT)

    @cached_property
    def beside(self) -> RecentResults[tuple[Array, NDArray[np.intp]]]:
        """Shares of known samples about each one, and the samples with enough of them."""
        return RecentResults(RECENT)

    @cached_property
    def completions(self) -> RecentResults[Completion]:
        """What completes the samples of a channel that have no truth."""
        return RecentResults(RECENT)

    def left(self, point: ScenePoint) -> list[Array]:
        """What is left of each channel at its own samples [SI], each of shape (rows,)."""
        placed = (*self.own, *point.placed)
        return [
            self._left(c, self._acting(c, placed), self._unknowns_of(c, point.unknowns))
            for c in self.compared
        ]

    def _unknowns_of(self, c: Compared, unknowns: Array) -> tuple[float, ...]:
        """The bias of a channel, or the field in space of a magnetometer."""
        if not c.biased:
            return tuple(unknowns[len(self.biased) :].tolist())
        k = self.biased.index(c.name)
        return tuple(unknowns[k : k + 1].tolist())

    @cached_property
    def biased(self) -> tuple[str, ...]:
        """The channels with a bias, in the order of the unknowns."""
        return tuple(c.name for c in self.compared if c.biased)

    def _left(self, c: Compared, here: Sequence[Effect], unknowns: tuple[float, ...]) -> Array:
        """What effects and unknowns of a channel leave of its samples [SI], shape (rows,)."""
        m_n = np.array(() if c.biased else unknowns)
        bias = sum(unknowns if c.biased else ())
        lags = tuple(e for e in here if isinstance(e, Lag))
        felt = (
            self.truth.signals(c.sensor, m_n)
            if not lags
            else self.lagged.recalled(
                (c.sensor, *m_n.tolist(), *lags, *needs_of(here)),
                lambda: delayed(self.truth.signals(c.sensor, m_n), here),
            )
        )
        left = c.y - with_errors(felt, c.axis, here, self.drive) - bias
        known = self.good & c.there
        unknown = unheard(self.truth.t, lags)
        if unknown.any():
            # What was before the log is a guess: where it leaves no noise, a lag neither gains nor loses.
            others = [e for e in here if not isinstance(e, Lag)]
            plain = c.y - with_errors(self.truth.signals(c.sensor, m_n), c.axis, others, self.drive) - bias
            loud = MAX_NOISE_SIGMAS * float(np.std(self.made_up[self.compared.index(c)]))
            left = np.where(unknown & (np.abs(left) > loud), plain, left)
            known = known & ~(unknown & (np.abs(left) > loud))
        left = self._assumed_where(c, left[c.at], known[c.at])
        return self._assumed_within(c, left, edges_of(here))

    def _assumed_where(self, c: Compared, left: Array, known: NDArray[np.bool_]) -> Array:
        """What is left, with assumed noise about the mean beside, where no truth is known."""
        if known.all():
            return left
        from scipy.ndimage import uniform_filter1d

        k = self.compared.index(c)
        noise = self.made_up[k]
        away = np.where(known, left - noise, 0.0)
        count, near = self.beside.recalled(known.tobytes(), lambda: known_beside(known, BESIDE))
        mean = uniform_filter1d(away, 2 * BESIDE + 1, mode="constant")
        level = np.interp(np.arange(left.size), near, mean[near] / count[near])
        completion = self.completions.recalled(
            (k, known.tobytes()), lambda: Completion.of(self.whiteners[k], known)
        )
        level = completion.completed(np.where(known, away, level))
        return np.where(known, left, noise + level)

    def _assumed_within(self, c: Compared, left: Array, edges: Sequence[tuple[float, float]]) -> Array:
        """What is left, with assumed noise where nobody knows what should have been read."""
        for start, stop in edges:
            i, j = np.searchsorted(self.truth.t[c.at], [start, stop])
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
        """Assumed noise of each channel, always the same [SI]."""
        rng = np.random.default_rng(0)
        z = [rng.standard_normal(c.size(self.truth.t.size)) for c in self.compared]
        weights = [np.where(w.weight > 0.0, w.weight, np.inf) for w in self.whiteners]
        return tuple(Whitener.back(x / w) for x, w in zip(z, weights))

    @staticmethod
    def _acting(c: Compared, placed: Sequence[Placed]) -> list[Effect]:
        """The effects on a channel."""
        return [p.effect for p in placed if acts_on(p.where, c.name)]

    def moving(self, c: Compared) -> bool:
        """Whether 5 % of what a channel should have read would be noticed."""
        field = self.assumed_field()
        u = self.truth.signals(c.sensor, field).y[:, c.axis]
        white = self.whiteners[self.compared.index(c)]
        good = self.good & c.there
        if not good.any():
            return False
        z = white.ordinates(np.where(good, u - u[good].mean(), 0.0)[c.at])[1 : c.keep]
        return is_motion(float(np.linalg.norm(z)))

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """Every addition that the log allows beside these, with typical sizes to start from."""
        rarer = float(np.log(self.sensors))
        return [
            [replace(p, prior_penalty_nats=p.prior_penalty_nats + rarer) for p in starts]
            for starts in offers(self.bench(placed), placed)
        ]

    def bench(self, placed: Sequence[Placed]) -> MotionCandidates:
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
                here = self._acting(c, (*self.own, *placed))
                extra[:, c.axis] = with_errors(delayed(felt, here), c.axis, here, self.drive) - alone
                y[:, c.axis] = c.y - (alone if "mag" in self.truth.read else 0.0)
                middle = self._whitener(c).weight[1 : c.keep]
                spread = max(spread, float(1.0 / np.median(middle)))
        field = self.assumed_field(extra)
        good = self.good & np.all([c.there for c in self.compared if c.sensor == "mag"], axis=0)
        for start, stop in edges_of([p.effect for p in (*self.own, *placed)]):
            good[(self.truth.t >= start) & (self.truth.t < stop)] = False
        unknown = () if "mag" in self.truth.read else (0, 1, 2)
        triads = Counter(c.sensor for c in self.compared if c.sensor in Mounting.sensors)
        boards = tuple(s for s, axes in triads.items() if axes == len(AXES))
        return MotionCandidates(
            self.truth, moved, still, good, y - extra, spread, field, self.drive, unknown, boards
        )

    def faults(self) -> tuple[Placed, ...]:
        """What spoils a fit: of the samples, the reference, or channels that read another axis or unit."""
        return self.spoilt or tuple(p for c in self.compared for p in self.turned(c))

    def turned(self, c: Compared) -> list[Placed]:
        """Whether a channel reads another axis, the opposite, or another unit than it should."""
        if c.sensor == "mag" and "mag" not in self.truth.read:
            return []
        good = self.good & c.there
        X, y = self.truth.signals(c.sensor).y[good], c.y[good]
        row = combination(X - X.mean(axis=0), y - y.mean())
        return [Placed(e, c.name) for e in axis_faults(row, c.axis)]

    def likeness(self, sensor: str, X: Array, bandwidth: float = np.inf) -> Likeness:
        """Of the readings of a triad and what it should have read, shape (n, 3), up to a frequency [Hz]."""

        def about(x: Array, good: NDArray[np.bool_]) -> Array:
            kept = good.reshape(-1, *(1,) * (x.ndim - 1))
            return np.asarray(np.where(kept, x - x[good].mean(axis=0), 0.0))

        top = int(min(2.0 * self.truth.t.size * self.dt * bandwidth, self.truth.t.size))
        pairs = [
            (c, w, self.good & c.there) for c, w in zip(self.compared, self.whiteners) if c.sensor == sensor
        ]
        return likeness(
            [(w, about(c.y, good)[c.at], about(X, good)[c.at], c.axis, top) for c, w, good in pairs]
        )


def _device(c: Compared) -> str:
    """What a channel is read by: position and velocity of one receiver are late together."""
    return c.name.partition("_")[0]
