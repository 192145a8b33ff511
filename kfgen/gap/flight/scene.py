"""The world of a filter in flight: its innovations, and what every effect would do to them.

An effect changes readings along the smoothed path; the filter's own gains carry that change into the innovations, so
that every coefficient is judged after the states have absorbed what they can. What is written of an effect anywhere
else holds here: the same expressions act on the same signals.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES, GROUPS, acts_on
from kfgen.effects import Effect
from kfgen.effects.inertial.errors import EarthRate, ScaleAsymmetry
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.lag import Bandwidth, TimeDelay
from kfgen.gap.core.result import NoiseScale, OutageDrift
from kfgen.gap.flight.flight_truth import flight_truth
from kfgen.gap.flight.noise.changed_noise import with_noise_changes
from kfgen.gap.flight.noise.inertial_noise import with_inertial_noise
from kfgen.gap.flight.noise.tuned import TunedSize, shown_scales, tuned
from kfgen.gap.flight.outages import outage_drifts
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.random.likely_random_errors import likely_random_errors
from kfgen.gap.flight.random.random_course import none_of_a_random_error
from kfgen.gap.flight.reach import unreached
from kfgen.gap.flight.steps import StepEnergies, likely_steps, step_energies
from kfgen.gap.flight.sums import units_of
from kfgen.gap.motion.candidates import FIELD_PREFIX, MotionCandidates, offers
from kfgen.gap.motion.placed_effects import delayed, with_errors
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.random_error import FittedRandomError
from kfgen.gap.scene.scene import Placed, ScenePoint, Unknown
from kfgen.gap.scene.screen import basis, orthogonal_part
from kfgen.model.parts.motion import NED

Array = NDArray[np.float64]

NOISE_LEVEL_SD_OF_LOG = 0.7
"""Standard deviation of the logarithm of a sensor's noise level before the flight."""
MIN_SIGN_SHARE = 0.05
"""Share of the readings that either sign has at least, for an asymmetry of the two to be seen."""
CONSTANT_STEP_SHARE = 1e-4
"""Change of a constant, as a share of it, by which readings are differentiated."""
MOVED_SHARE = 1e-9
"""Relative variation of what a channel should have read from which on it moves."""


@dataclass(frozen=True)
class FlightScene:
    """See `kfgen.gap.scene.scene.Scene`.

    Parameters
    ----------
    path : FlownPath
        Smoothed with the effects `subtracted` subtracted from its readings.
    subtracted : tuple of Placed
    sizes : tuple of TunedSize
        Of noises, where they were estimated.
    energies : StepEnergies, optional
        Of steps, where they are known about a path nearby.
    memory : dict
        Responses of the innovations that were computed before.
    spoilt : tuple of Placed
        Faults of the log.
    said : tuple of Placed
        See `kfgen.gap.scene.scene.Telling`.
    cautious : bool
        Whether what is rare is no candidate, for something else is still there.
    """

    path: FlownPath
    subtracted: tuple[Placed, ...] = ()
    sizes: tuple[TunedSize, ...] = ()
    energies: StepEnergies | None = None
    memory: dict[Placed, Array] = field(default_factory=dict, compare=False, repr=False)
    spoilt: tuple[Placed, ...] = ()
    said: tuple[Placed, ...] = ()
    cautious: bool = False

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The constants that the alignment took from the first readings: as uncertain as these are."""
        log = self.path.log
        units = {c.name: c.unit for c in log.discrete.model.constants}
        return tuple(Unknown(n, units[n], log.constants[n], np.inf, once=True) for n in log.measured)

    @property
    def noise_level_sd_of_log(self) -> float:
        """What a receiver says of its own noise is a guess: a factor of two is usual."""
        return NOISE_LEVEL_SD_OF_LOG

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of the aiding sensors: those that have innovations."""
        return self.path.rows.channels

    @cached_property
    def lengths(self) -> tuple[int, ...]:
        """Innovations of each channel."""
        return tuple(int(self.path.rows.of(c).size) for c in self.channels)

    @property
    def dt(self) -> float:
        """Step of the filter [s]."""
        return self.path.log.dt

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        return float(self.path.log.t[0]), float(self.path.log.t[-1])

    @cached_property
    def truth(self) -> Truth:
        """What every sensor should have read along the path."""
        return flight_truth(self.path)

    @cached_property
    def compared(self) -> tuple[str, ...]:
        """All channels on which an effect may act: of the inputs and of the aiding sensors."""
        return (*self.path.equations.channels, *self.channels)

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """Cosine transforms of the normalised innovations of each channel, shape (sum of lengths, points)."""
        self._remember(p for point in points for p in point.placed)
        out = np.repeat(self._base[:, None], len(points), axis=1)
        for k, point in enumerate(points):
            for p in point.placed:
                out[:, k] -= self._response(p)
            out[:, k] -= self.of_constants @ (point.unknowns - self._constants)
        return out

    def faults(self) -> tuple[Placed, ...]:
        """See `kfgen.gap.scene.scene.Inspected`."""
        return self.spoilt

    @property
    def _constants(self) -> Array:
        """Values of the unknowns about which the path is smoothed."""
        return np.array([u.value for u in self.unknowns])

    @cached_property
    def of_constants(self) -> Array:
        """What the normalised innovations lose by each unknown [1/SI], shape (rows, unknowns)."""
        steps = {u.name: CONSTANT_STEP_SHARE * max(abs(u.value), 1e-12) for u in self.unknowns}
        dz = np.zeros((self.path.rows.t.size, len(steps)))
        for k, u in enumerate(self.unknowns):
            dz[:, k] = self.path.changed({u.name: u.value + steps[u.name]}) / steps[u.name]
        du = np.zeros((*self.path.log.u.shape, len(steps)))
        return self.ordinates(self.path.linear.columns(du, dz))

    @cached_property
    def _base(self) -> Array:
        """What is left with no effect but those that are subtracted, and these put back in linearly."""
        base = self.ordinates(self.path.linear.normalised[:, None])[:, 0]
        self._remember(self.subtracted)
        for p in self.subtracted:
            base = base + self._response(p)
        return np.asarray(base)

    def ordinates(self, innovations: Array) -> Array:
        """Innovations in the order of time as transforms channel by channel, shape (rows, m) as given.

        Parameters
        ----------
        innovations : ndarray, shape (rows, m)
        """
        from scipy.fft import dct

        return np.concatenate(
            [dct(innovations[self.path.rows.of(c)], type=2, axis=0, norm="ortho") for c in self.channels]
        )

    def _in_time(self, ordinates: Array) -> Array:
        """The inverse of `_ordinates`."""
        from scipy.fft import idct

        out = np.zeros_like(ordinates)
        for c, part in zip(self.channels, np.split(ordinates, np.cumsum(self.lengths)[:-1])):
            out[self.path.rows.of(c)] = idct(part, type=2, axis=0, norm="ortho")
        return out

    def _response(self, placed: Placed) -> Array:
        """What the innovations lose by an effect with its values."""
        return np.asarray(sum(size * self.memory[unit] for unit, size in units_of(placed)))

    def _remember(self, placed: Iterable[Placed]) -> None:
        """Compute the responses that are not known yet, many in one pass."""
        wanted = dict.fromkeys(u for p in placed for u, _ in units_of(p) if u not in self.memory)
        units, at_once = list(wanted), self.path.linear.columns_at_once
        for first in range(0, len(units), at_once):
            some = units[first : first + at_once]
            du = np.zeros((*self.path.log.u.shape, len(some)))
            dz = np.zeros((self.path.rows.t.size, len(some)))
            for k, unit in enumerate(some):
                du[:, :, k], dz[:, k] = self.errors([unit])
            found = self.ordinates(self.path.linear.columns(du, dz))
            self.memory.update({unit: found[:, k].copy() for k, unit in enumerate(some)})

    def errors(self, placed: Sequence[Placed]) -> tuple[Array, Array]:
        """What effects add to the readings along the path: of the inputs, shape (n, inputs), of the others, shape (rows,)."""
        du, dz = np.zeros_like(self.path.log.u), np.zeros(self.path.rows.t.size)
        late: dict[tuple[str, tuple[Effect, ...]], Signals] = {}
        for name in (c for c in self.compared if any(acts_on(p.where, c) for p in placed)):
            change = self._error(name, placed, late)
            if name in self.path.equations.channels:
                du[:, self.path.equations.channels.index(name)] = change
            else:
                dz[self.path.rows.of(name)] = self.path.at_rows(change, name)
        return du, dz

    def _error(
        self,
        channel: str,
        placed: Sequence[Placed],
        late: dict[tuple[str, tuple[Effect, ...]], Signals],
    ) -> Array:
        """What effects add to one channel along the path, shape (n,); `late` keeps what triads felt after their lags."""
        here = tuple(p.effect for p in placed if acts_on(p.where, channel))
        sensor, axis = self.truth.place(channel)
        felt = self.truth.signals(sensor)
        if (sensor, here) not in late:
            late[sensor, here] = delayed(felt, here)
        return with_errors(late[sensor, here], axis, here, self.path.log.drive) - felt.y[:, axis]

    def about(self, point: ScenePoint) -> FlightScene:
        """The same flight about the path that is smoothed with the effects of a point subtracted."""
        du, dz = self.errors(point.placed)
        constants = dict(zip((u.name for u in self.unknowns), point.unknowns.tolist()))
        energies = self.__dict__.get("_energies", self.energies)
        path = self.path.without(du, dz, constants)
        return FlightScene(path, point.placed, self.sizes, energies, said=self.said, cautious=self.cautious)

    @cached_property
    def log_widths(self) -> Array:
        """See `kfgen.gap.scene.scene.HasNoiseSizes`."""
        logs = 0.5 * np.log(self.path.linear.S)
        return np.concatenate([logs[self.path.rows.of(c)] for c in self.channels])

    @property
    def noise_scales(self) -> tuple[NoiseScale, ...]:
        """The noises whose size this flight shows, and that is not as assumed."""
        return shown_scales([s for s in self.sizes if not s.ci95[0] <= 1.0 <= s.ci95[1]])

    def drifts(self, share: float) -> tuple[OutageDrift, ...]:
        """See `kfgen.gap.flight.outages`."""
        return outage_drifts(self.path, share)

    def tuned(self, point: ScenePoint) -> FlightScene:
        """The flight about no effect, its noises of the sizes that are most likely beside the effects of a point."""
        found = tuned(self.about(point).path)
        return replace(self._about_none(found.path), sizes=found.sizes)

    def with_inertial_noise(self, point: ScenePoint) -> FlightScene:
        """See `kfgen.gap.scene.random_error.HasRandomErrors`."""
        path, others, followed = with_inertial_noise(self.about(point).path)
        if not others:
            return self
        found, said = tuned(path, others), (*self.said, *followed)
        sizes = (*(s for s in self.sizes if not set(s.group.inputs) & set(others)), *found.sizes)
        return replace(self._about_none(found.path), sizes=sizes, said=said, cautious=self.cautious)

    def with_noise_changes(self, point: ScenePoint) -> FlightScene:
        """See `kfgen.gap.scene.random_error.HasRandomErrors`."""
        path, changed = with_noise_changes(self.about(point).path)
        return replace(self._about_none(path), said=(*self.said, *changed)) if changed else self

    def _about_none(self, path: FlownPath) -> FlightScene:
        """About a path with no effect subtracted; what is rare is no candidate there, for something is still missing."""
        clean = replace(path, du=np.zeros_like(path.du), dz=np.zeros_like(path.dz))
        return FlightScene(clean.smoothed(), (), self.sizes, said=self.said, cautious=True)

    def likely_random_errors(self, point: ScenePoint) -> list[FittedRandomError]:
        """See `kfgen.gap.scene.random_error.HasRandomErrors`."""
        here = point.placed == self.subtracted and np.array_equal(point.unknowns, self._constants)
        scene = self if here else self.about(point)
        return likely_random_errors(scene.path, self, self.compared, scene.left(point), scene.known)

    def with_random_error(self, placed: Placed) -> FlightScene:
        """The flight about no effect, with one random error more as a state of its filter."""
        return self._about_none(replace(self.path, random_errors=(*self.path.random_errors, placed)))

    def without_random_errors(self, where: str) -> FlightScene:
        """The flight about no effect, without the random errors of a channel as states of its filter."""
        left = tuple(w for w in self.path.random_errors if w.where != where)
        return self._about_none(replace(self.path, random_errors=left))

    def not_random(self, placed: Placed, point: ScenePoint) -> str:
        """See `kfgen.gap.scene.random_error.HasRandomErrors`."""
        there = self.about(point)
        return none_of_a_random_error(there.path, there.truth, placed)

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """Every addition that the log allows beside these, with typical sizes to start from."""
        found = [s for starts in offers(self.bench, placed) if (s := [p for p in starts if self._shows(p)])]
        self._remember(p for starts in found for p in starts)
        return found + self._steps(placed)

    def _steps(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """Steps of biases, each at its most likely time beside these."""
        residual = self.left(ScenePoint(tuple(placed), self._constants))
        steps = likely_steps(self.path, self.compared, self._energies, residual)
        self._remember(steps)
        return [[s] for s in steps]

    def left(self, point: ScenePoint) -> Array:
        """Normalised innovations in the order of time beside a point, less what the unknowns can do, shape (rows,)."""
        left = orthogonal_part(self.residuals([point]), basis(self.of_constants))
        return np.asarray(self._in_time(left)[:, 0])

    @cached_property
    def known(self) -> Array:
        """Orthonormal directions of the innovations in the order of time in which the unknowns move them, shape (rows, k)."""
        return self._in_time(basis(self.of_constants))

    @cached_property
    def _energies(self) -> StepEnergies:
        """Of steps, about this path or one nearby."""
        return self.energies or step_energies(self.path, self.compared, self.known)

    def _shows(self, placed: Placed) -> bool:
        """Whether a log can show it: the Earth's rate is an option of the filter, a corner needs samples as fast.

        An asymmetry needs readings of either sign, else it is a scale factor; the axes of an inertial sensor are read at once.
        """
        if isinstance(placed.effect, EarthRate):
            return False
        if isinstance(placed.effect, TimeDelay) and placed.where in self.path.equations.channels:
            return False
        if isinstance(placed.effect, ScaleAsymmetry):
            sensor, axis = self.truth.place(placed.where)
            above = float(np.mean(self.truth.read[sensor][:, axis] > 0.0))
            return MIN_SIGN_SHARE < above < 1.0 - MIN_SIGN_SHARE
        if not isinstance(placed.effect, Bandwidth):
            return True
        rates = [self.lengths[k] for k, c in enumerate(self.channels) if acts_on(placed.where, c)]
        fastest = max(rates, default=self.path.log.t.size) / (self.span[1] - self.span[0])
        return float(placed.effect.corner) <= fastest

    def unreached(self, placed: Placed) -> str:
        """See `kfgen.gap.scene.scene.Reaching`."""
        return unreached(placed, self.path, self.truth, cautious=self.cautious)

    @cached_property
    def bench(self) -> MotionCandidates:
        """What the candidates are chosen by."""
        moved: list[tuple[str, str, int]] = []
        still: list[tuple[str, str, int]] = []
        for c in self.compared:
            sensor, axis = self.truth.place(c)
            y = self.truth.read[sensor][:, axis]
            places = moved if np.ptp(y) > MOVED_SHARE * max(float(np.abs(y).max()), 1e-300) else still
            places.append((c, sensor, axis))
        mag, seen = self._mag
        drive = self.path.log.drive
        field = tuple(NED.index(u.name[-1]) for u in self.unknowns if u.name.startswith(FIELD_PREFIX))
        return MotionCandidates(
            self.truth, tuple(moved), tuple(still), seen, mag, 0.0, None, drive, field, self._boards
        )

    @property
    def _boards(self) -> tuple[str, ...]:
        """Boards whose mounting angles show: of a magnetometer against the inertial sensors, of these against the vehicle."""
        aiding = [a.sensor for a in self.path.log.aiding]
        boards = [s.name for s in aiding if s.name == "mag" and len(s.channels) == len(AXES)]
        inertial = all(s in self.path.log.triads for s in GROUPS["imu"])
        return (*boards, *(["imu"] if inertial and any(s.has_vehicle_axes for s in aiding) else []))

    @cached_property
    def _mag(self) -> tuple[Array, NDArray[np.bool_]]:
        """What a magnetometer reads beside the path, shape (n, 3), and where it reads; everywhere where there is none."""
        n, rows = self.path.log.t.size, self.path.rows
        away, seen = np.zeros((n, 3)), np.zeros(n, dtype=bool)
        for c in (c for c in self.channels if self.truth.place(c)[0] == "mag"):
            at = rows.of(c)
            away[rows.at[at], self.truth.place(c)[1]] = self.path.linear.y[at]
            seen[rows.at[at]] = True
        return away, seen if seen.any() else ~seen
