"""`PlantScene`: a model file against a log of the plant.

The plant is simulated over the record from unknown initial states; what is left of each channel is whitened by
the channel's noise. A record that one simulation cannot follow, since the plant is unstable or chaotic or the
model too far off, is cut into segments with initial states of their own (multiple shooting [1]_).

References
----------
.. [1] H. G. Bock, Numerical treatment of inverse problems in chemical reaction kinetics, 1981.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import parse_unit
from kfgen.effects.inertial.inertial_error import InertialError
from kfgen.effects.plant.terms import ParameterError, PlantEffect, StateTerm
from kfgen.gap.plant.candidates import additions
from kfgen.gap.plant.columns import Kinds, columns_of, kinds_of, shared
from kfgen.gap.plant.hole_responses import Simulation, disturbed
from kfgen.gap.plant.initial_history import changed, distinct, independent, integrated, of_sensors, unsettled
from kfgen.gap.plant.lost_rows import Disturbed, LostRows
from kfgen.gap.plant.pieces import in_one_piece, lateness, segments, shortest
from kfgen.gap.plant.reach import does_drive, rms, unreached
from kfgen.gap.plant.recorded_channel import RecordedChannel, check_near, check_unit, recorded_of
from kfgen.gap.plant.refuted_starts import refuted_starts
from kfgen.gap.plant.sensor_errors import SensorErrors, without_sensor_errors
from kfgen.gap.plant.shooting import MIN_FIRST_WINDOW_SAMPLES, Shooting
from kfgen.gap.plant.words import of_lost_rows
from kfgen.gap.rest.trust import MAX_SHIFT_SD
from kfgen.gap.scene.scene import Placed, ScenePoint, Unknown, start_of
from kfgen.log.log import Log
from kfgen.model.plant.equations import unknown_deviation
from kfgen.model.plant.plant import Batch, Plant, Run, effects_inside
from kfgen.model.plant.user import UserModel

Array = NDArray[np.float64]

ASTRAY = 0.8
"""Share of the shortest segments that make up a record in which a model follows it nowhere."""
MAX_PARTS_OF_ADDITIONS = 32
"""Parts of a step at most for an addition: friction that stops a motion within a small part of a sample is as good as any."""
FAR_FROM_START = 4.0
"""Standard deviations from where a state is assumed to start beyond which it does not: it starts anew in every log."""


@dataclass(frozen=True)
class PlantScene:
    """See `kfgen.gap.scene.scene.Scene`.

    Parameters
    ----------
    model : UserModel
    log : Log
        With the model's inputs and at least one of its measurements.
    recorded : mapping of str to Recorded
        By channel.
    starts : tuple of int
        Samples at which segments start.
    initial : ndarray, shape (segments, states)
        Where they start, by a fit of the assumed model [SI].
    hidden : tuple of bool, (states,)
        Those that no channel shows: their prior is wide, but finite.
    begun : mapping of str to float
        Parameters that are not trusted, as that fit has them [SI].
    doubted : tuple of str
        States that do not start where the model file says.
    said, spoilt, either : tuple of Placed
        Faults that were left out, those with which a fit means nothing, what may be instead of the first of these.
    seen_late : float, optional
        How much the channels of the whole log seem to be late [s], where that is known.
    """

    model: UserModel
    log: Log
    recorded: Mapping[str, RecordedChannel]
    starts: tuple[int, ...] = (0,)
    initial: Array = field(default_factory=lambda: np.zeros((1, 0)))
    hidden: tuple[bool, ...] = ()
    begun: Mapping[str, float] = field(default_factory=dict)
    doubted: tuple[str, ...] = ()
    said: tuple[Placed, ...] = ()
    spoilt: tuple[Placed, ...] = ()
    either: tuple[Placed, ...] = ()
    seen_late: float | None = None
    has_several_maxima: ClassVar[bool] = True
    _plants: dict[Kinds, Plant] = field(default_factory=dict, repr=False, compare=False)
    _parts: dict[Kinds, int] = field(default_factory=dict, repr=False, compare=False)

    @staticmethod
    def of(model: UserModel, log: Log) -> PlantScene:
        """The scene of a model and a log, segments and initial states found.

        Raises
        ------
        InputError
            An input is missing or not a number, no measurement is in the log, a unit does not fit, a
            measurement has no white noise, or the model cannot be simulated over the log.
        """
        return PlantScene.bare(model, log).cut()

    def cut(self) -> PlantScene:
        """The scene in as many segments as its model needs to follow the log; raises as `of`."""
        return self._started(*segments(self.shooting, self._anew))

    @staticmethod
    def bare(model: UserModel, log: Log) -> PlantScene:
        """The scene before anything is fitted, in one segment that starts where the channels show; raises as `of`."""
        for name, unit in model.inputs.items():
            check_unit(log, name, unit, model)
            log.values(name)
        recorded = {n: recorded_of(model, log, n) for n in model.measurements if n in log.channels}
        if not recorded:
            raise InputError(
                f"no measurement of {model.name} is in the log",
                where=log.source,
                remedy=f"It knows {', '.join(model.measurements)}; map others with --columns",
            )
        scene = PlantScene(model, log, recorded)
        initial = scene.shooting.guess(0, MIN_FIRST_WINDOW_SAMPLES)[None]
        return replace(scene, initial=initial, hidden=(False,) * len(model.states))

    def faults(self) -> tuple[Placed, ...]:
        """See `kfgen.gap.scene.scene.Inspected`."""
        return self.spoilt

    @property
    def channels(self) -> tuple[str, ...]:
        """The measurements that the log has."""
        return tuple(self.recorded)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Samples of each."""
        return tuple(r.values.size for r in self.recorded.values())

    @cached_property
    def rows(self) -> LostRows:
        """What rows the log has lost."""
        return LostRows.of(np.asarray(self.log.t))

    @property
    def warnings(self) -> list[str]:
        """What a user is told of the log."""
        return [*self.log.held, *of_lost_rows(self.rows, np.asarray(self.log.t))]

    @cached_property
    def _anew(self) -> tuple[int, ...]:
        return self.rows.anew(self.log.n)

    @cached_property
    def clock(self) -> Array:
        """Times of the simulation, shape (n,) [s]: those of the log, long holes cut short."""
        return self.rows.clock(np.asarray(self.log.t))

    @property
    def dt(self) -> float:
        """Sampling period [s]; the mean one of uneven times."""
        return float((self.clock[-1] - self.clock[0]) / (self.log.n - 1))

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        return float(self.log.t[0]), float(self.log.t[-1])

    @cached_property
    def late(self) -> float:
        """How much the channels seem to be late [s], against the assumed model in one piece."""
        shooting = self.shooting
        if self.seen_late is not None or not self.inputs or not self.model.states:
            return self.seen_late or 0.0
        simulated = shooting.simulated(np.concatenate([self.initial[0], shooting.trusted]))
        return lateness(shooting.data, simulated) * self.dt

    @cached_property
    def inputs(self) -> dict[str, Array]:
        """The model's inputs [SI], each of shape (n,)."""
        return {n: self.log.values(n) for n in self.model.inputs}

    @property
    def constant_inputs(self) -> tuple[str, ...]:
        """See `kfgen.gap.scene.scene.Driven`."""
        return tuple(n for n, u in self.inputs.items() if not np.ptp(u) > 0.0)

    @property
    def follows_nowhere(self) -> bool:
        """See `kfgen.gap.scene.scene.Driven`."""
        return len(self.starts) > 1 and len(self.starts) > ASTRAY * self.log.n / shortest(self.log.n)

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Initial states of every segment, then the parameters that are not trusted."""
        out = []
        for s, first in enumerate(self.starts):
            for i, (name, state) in enumerate(self.model.states.items()):
                known = s == 0 and np.isfinite(state.sd)
                value = state.initial if known else float(self.initial[s, i])
                unit = parse_unit(state.unit).si
                unseen = unknown_deviation(unit, value) if self.hidden[i] else np.inf
                label = f"{name} at {self.log.t[first]:.6g} s"
                own, far = (name if known else ""), np.inf if name in self.doubted else FAR_FROM_START
                sd = state.sd if known else unseen
                out.append(Unknown(label, unit, value, sd, own=own, far=far, once=True))
        for name, p in self.model.parameters.items():
            if p.sd > 0.0:
                begun = self.begun.get(name)
                out.append(Unknown(name, parse_unit(p.unit).si, p.value, p.sd, begun, name, MAX_SHIFT_SD))
        return tuple(out)

    def unit(self, placed: Placed) -> str:
        """The unit `U` of a placed effect's parameters."""
        if not isinstance(placed.effect, PlantEffect):
            return self.log.unit_at(placed.where)
        if isinstance(placed.effect, ParameterError) and placed.where in self.model.states:
            return self.model.states[placed.where].unit
        return self.model.unit_at(placed.where, placed.effect)

    def in_one_piece(self) -> PlantScene | None:
        """See `kfgen.gap.scene.scene.InPieces`."""
        whole = len(self.starts) <= 1 + len(self._anew)
        found = None if whole else in_one_piece(self.shooting, self._anew)
        return None if found is None else self._started((0, *self._anew), *found)

    def _started(self, starts: tuple[int, ...], initial: Array, parameters: Array) -> PlantScene:
        begun = dict(zip(self.shooting.free, parameters.tolist()))
        hidden = self.shooting.hidden(initial[0])
        return replace(self, starts=starts, initial=initial, hidden=hidden, begun=begun)

    def free_run(self, point: ScenePoint) -> float:
        """See `kfgen.gap.scene.scene.InPieces`."""
        k, segs, few = len(self.model.states), len(self.starts), 1 + len(self._anew)
        at = [self.starts.index(a) for a in (0, *self._anew)]
        states = point.unknowns[: k * segs].reshape(segs, k)[at]
        unknowns = np.concatenate([states.ravel(), point.unknowns[k * segs :]])
        whole = replace(self, starts=(0, *self._anew), initial=self.initial[:few])
        run = whole.simulated(ScenePoint(point.placed, unknowns))
        return float(np.mean([r.share_left(run.channels[n][:, :1]) for n, r in self.recorded.items()]))

    def held(self, names: Collection[str]) -> PlantScene:
        """See `kfgen.gap.scene.scene.Trusting`."""
        parameters = {n: replace(p, sd=0.0) if n in names else p for n, p in self.model.parameters.items()}
        doubted = tuple(n for n in self.model.states if n in names)
        model = replace(self.model, parameters=parameters)
        scene = replace(self, model=model, doubted=doubted, _plants={}, _parts={})
        if len(self.starts) == 1 or not names:
            return scene
        scene = scene.cut()
        if scene.follows_nowhere:
            run = scene.simulated(start_of(scene))
            check_near(model, scene.recorded, run.channels, f"with {', '.join(sorted(names))} as assumed")
        return scene

    def refuted(self) -> tuple[Placed, ...]:
        """See `kfgen.gap.scene.scene.Trusting`."""
        return refuted_starts(self.shooting)

    def stated(self, where: str) -> float:
        """See `kfgen.gap.scene.scene.Trusting`."""
        found = self.model.parameters.get(where)
        return self.model.states[where].initial if found is None else found.value

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """Whitened measured less simulated values, shape (sum of lengths, points)."""
        out = np.empty((sum(self.lengths), len(points)))
        groups: dict[Kinds, list[int]] = {}
        for j, point in enumerate(points):
            groups.setdefault(kinds_of(point.placed), []).append(j)
        for members in groups.values():
            alike = [points[j] for j in members]
            inside = [without_sensor_errors(p) for p in alike]
            shown = self._shown(inside)
            left = self._left(self.sensors.added(shown, alike), inside)
            out[:, members] = reduce(integrated, self._begun(shown, inside), left)
        return out

    @cached_property
    def sensors(self) -> SensorErrors:
        """What may be wrong with gyros, accelerometers and magnetometers among the channels."""
        noise = {n: r.noise for n, r in self.recorded.items()}
        own = [(n, e) for n, m in self.model.measurements.items() for e in m.noise.effects]
        placed = tuple(Placed(e, n) for n, e in own if isinstance(e, InertialError) and n in noise)
        return SensorErrors(self.log, self.inputs, noise, placed)

    def _shown(self, points: Sequence[ScenePoint]) -> Mapping[str, Array]:
        """The simulated channels at points, each of shape (n, points)."""
        segs, states = len(self.starts), len(self.model.states)
        columns, source = shared(points, segs, states)
        if not source.size:
            return self._run(points).channels
        run = self._run(columns)
        segment = np.searchsorted(np.asarray(self.starts), np.arange(self.log.n), side="right") - 1
        rows = np.arange(self.log.n)[:, None]
        return {n: v[rows, source.T[segment]] for n, v in run.channels.items()}

    def simulated(self, point: ScenePoint) -> Run:
        """The simulation at a point."""
        inside = without_sensor_errors(point)
        run = self._run([inside])
        return replace(run, channels=self.sensors.added(run.channels, [point]))

    def assumed(self, placed: Sequence[Placed] = ()) -> ScenePoint:
        """The point of these effects with the unknowns at their assumed values."""
        return ScenePoint(tuple(placed), np.array([u.value for u in self.unknowns]))

    def _run(self, points: Sequence[ScenePoint], before: Mapping[str, Array] | None = None) -> Run:
        plant, batch = self._plant(points)
        batch, parts = replace(batch, before=before or {}), self._parts.get(plant.kinds, 1)
        run = plant.simulate(self.clock, self.inputs, batch, self.starts, parts, self._most)
        self._parts[plant.kinds] = run.substeps
        return run

    @cached_property
    def _most(self) -> int:
        """Parts of a step at most: far more than the assumed model asks for."""
        plant, batch = self._plant([self.assumed()])
        run = plant.simulate(self.clock, self.inputs, batch, self.starts)
        return max(MAX_PARTS_OF_ADDITIONS, run.substeps)

    def _plant(self, points: Sequence[ScenePoint]) -> tuple[Plant, Batch]:
        """The plant with the effects of points, and the points as its columns."""
        own = [(w, type(e)) for w, e in effects_inside(self.model)]
        kinds = (*own, *kinds_of(points[0].placed))
        return self._plants.setdefault(kinds, Plant(self.model, kinds)), self._batch(points)

    def _batch(self, points: Sequence[ScenePoint]) -> Batch:
        """The points as columns."""
        unknowns = [u.name for u in self.unknowns], len(self.starts)
        return columns_of(self.model, self.doubted, unknowns, effects_inside(self.model), points)

    def _left(self, channels: Mapping[str, Array], points: Sequence[ScenePoint]) -> Array:
        """Whitened measured less simulated values, as if all were known that may have begun, shape (sum of lengths, points)."""
        left = np.concatenate([r.whitener.ordinates(r.left(channels[n])) for n, r in self.recorded.items()])
        return self.lost.without(self.lost.centred(left))

    @cached_property
    def lost(self) -> Disturbed:
        """What rows that the log has lost do to the residuals, by the assumed model."""
        states = len(self.model.states)
        initial = self.initial.reshape(len(self.starts), states, 1)
        plant, batch = self._plant([self.assumed()])
        simulation = Simulation(plant, replace(batch, initial=initial), self.clock, self.starts)
        return disturbed(self.rows, simulation, self.inputs, self.shooting.scale, self.recorded)

    def _begun(self, shown: Mapping[str, Array], points: Sequence[ScenePoint]) -> list[Array]:
        """Whitened, what sensors and late inputs may have begun with, each of shape (sum of lengths, points)."""
        batch = self._batch(points)
        found = of_sensors(self.recorded, batch, self.clock, shown)
        for name, size in unsettled(batch, self.inputs).items():
            own, source = distinct(points, len(self.starts) * len(self.model.states) * (len(self.starts) > 1))
            run = self._run([points[j] for j in own], {name: np.full(len(own), size)})
            before = {n: v[:, own] for n, v in self._unforced(shown, points).items()}
            found.append(changed(self.recorded, before, run.channels)[:, source])
        return independent([self.lost.without(E) for E in found])

    def _unforced(self, shown: Mapping[str, Array], points: Sequence[ScenePoint]) -> Mapping[str, Array]:
        """The channels without process noise, of shape (n, points), where `shown` are those of the scene."""
        return shown

    def spread(self, point: ScenePoint) -> float:
        """See `kfgen.gap.scene.scene.Integrating`."""
        inside = without_sensor_errors(point)
        columns = self._begun(self._shown([inside]), [inside])
        return self.lost.spread + 0.5 * float(sum(np.log1p(np.sum(E**2)) for E in columns))

    @property
    def shooting(self) -> Shooting:
        """What the search for segments needs."""
        own = effects_inside(self.model)
        plant = Plant(self.model, [(w, type(e)) for w, e in own])
        weights = {n: 1.0 / r.noise for n, r in self.recorded.items()}
        data = {n: (r.at, r.values) for n, r in self.recorded.items()}
        return Shooting(plant, own, self.clock, self.inputs, data, weights)

    def unreached(self, placed: Placed) -> str:
        """See `kfgen.gap.scene.scene.Reaching`."""
        e = placed.effect
        if isinstance(e, StateTerm) and e.brakes and float(e.term(1.0, None)) > 0.0:
            plant, batch = self._plant([self.assumed()])
            if does_drive(placed, plant, plant.given(batch), self.shooting.scale):
                return f"{e.title} does not drive"
        return unreached(placed, self.inputs, {n: r.values for n, r in self.recorded.items()})

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """Every effect at every place where it makes sense, with start values from the assumed motion."""
        run = self.simulated(self.assumed())
        speeds = {n: rms(run.states[:, i, 0]) for i, n in enumerate(self.model.states)}
        seen = {n: (r.deviation, r.noise) for n, r in self.recorded.items()}
        times = self.dt, self.span[1] - self.span[0], self.late
        found = additions(self.model, self.inputs, speeds, seen, times, placed)
        known = {p.where for p in placed if isinstance(p.effect, ParameterError)}
        found += [[Placed(ParameterError(0.0), n)] for n in self.doubted if n not in known]
        return found + self.sensors.candidates({n: run.channels[n][:, 0] for n in self.recorded}, placed)
