"""`NoisyPlantScene`: a plant's scene with process noise: residuals are the innovations of a filter about a smoothed path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.expression import symbol
from kfgen.effects.plant.process_noise import ProcessNoise, root_density
from kfgen.gap.core.random_course import COURSE_POINTS, not_random
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.plant.hole_responses import Simulation, moves_in_holes
from kfgen.gap.plant.initial_history import independent
from kfgen.gap.plant.lost_rows import Disturbed
from kfgen.gap.plant.noise.linear_path import LinearPath, defects, linear_path
from kfgen.gap.plant.noise.path_filter import PathFilter
from kfgen.gap.plant.noise.process_noises import NoisyPlant
from kfgen.gap.plant.scene import PlantScene
from kfgen.gap.plant.sensor_errors import without_sensor_errors
from kfgen.gap.scene.evidence import parameter_width
from kfgen.gap.scene.posterior import log_posterior
from kfgen.gap.scene.random_error import FittedRandomError
from kfgen.gap.scene.scene import Placed, ScenePoint, start_of
from kfgen.model.plant.plant import Run

Array = NDArray[np.float64]

CHANCE_COURSES = 399
"""Courses of white innovations by which is seen what chance does."""
COURSES_AT_ONCE = 57


@dataclass(frozen=True)
class NoisyPlantScene(PlantScene):
    """See `PlantScene`.

    Parameters
    ----------
    random_errors : tuple of Placed
        Process noises beside those of the model file.
    path : ndarray, shape (n, states)
        That the states may have taken [SI]; empty where no noise drives them.
    noise_free : NoisyPlantScene, optional
        The same without these process noises; None of one that has none.
    """

    random_errors: tuple[Placed, ...] = ()
    path: Array = field(default_factory=lambda: np.zeros((0, 0)))
    noise_free: NoisyPlantScene | None = field(default=None, repr=False, compare=False)

    @staticmethod
    def of_scene(scene: PlantScene) -> NoisyPlantScene:
        """A scene with the process noise of its model file, if that has any.

        Raises
        ------
        InputError
            It has, and the noise of a channel is not white.
        """
        noisy = NoisyPlantScene(**{f.name: getattr(scene, f.name) for f in fields(scene)})
        if noisy.model.process_noise and (coloured := noisy.not_white):
            raise InputError(
                f"the noise of {coloured[0]} is not white, and beside process noise only white noise can be filtered",
                where=noisy.model.path,
                remedy=f"Leave out the process noise, or every effect of {coloured[0]} but its white noise",
            )
        return noisy.on_smoothed_path()

    @property
    def not_white(self) -> list[str]:
        """The channels whose noise is not white."""
        return [n for n, r in self.recorded.items() if not np.allclose(r.whitener.weight, 1.0 / r.noise)]

    def on_smoothed_path(self) -> NoisyPlantScene:
        """The scene about the path that is most likely with its noises."""
        if not self._densities.any():
            return self
        start = start_of(self)
        X = self.simulated(start).states[:, :, 0]
        return self.on_path(self._noisy_at(start, X).smoothed(X))

    def on_path(self, path: Array) -> NoisyPlantScene:
        """The scene about a path, shape (n, states) [SI]."""
        return replace(self, path=path, starts=(0,), initial=path[:1])

    @cached_property
    def _densities(self) -> Array:
        """Root densities of the noise of every state [SI/sqrt(Hz)]."""
        own = self.model.process_noise
        every = {n: [ProcessNoise(own.get(n, 0.0))] for n in self.model.states}
        for p in self.random_errors:
            assert isinstance(p.effect, ProcessNoise)
            every[p.where].append(p.effect)
        return np.array([root_density(e) for e in every.values()])

    def _noisy_at(self, point: ScenePoint, X: Array) -> NoisyPlant:
        """The plant of a point, beside the errors of its sensors along a path, shape (n, states)."""
        inside = without_sensor_errors(point)
        sim, sizes = self._simulation([inside]), self.shooting.scale
        shown = sim.run(self.inputs, range(self.log.n), X[:, :, None]).channels
        errors = {n: v - shown[n] for n, v in self.sensors.added(shown, [point]).items()}
        recorded = {n: replace(r, values=r.values - errors[n][r.at, 0]) for n, r in self.recorded.items()}

        mean, Q = self._holes

        def about(X: Array) -> LinearPath:
            path = linear_path(sim, self.inputs, X, sizes, recorded)
            return replace(path, d=path.d + mean)

        return NoisyPlant(about, tuple(self.model.states), sizes, Q, self._densities)

    def _simulation(self, points: Sequence[ScenePoint]) -> Simulation:
        """Of points with the same effects."""
        return Simulation(*self._plant(points), self.clock, (0,))

    @cached_property
    def _holes(self) -> tuple[Array, Array]:
        """Mean of what rows that the log has lost do to the states, shape (n - 1, states), and its covariance."""
        k = len(self.model.states)
        mean, Q = np.zeros((self.log.n - 1, k)), np.zeros((self.log.n - 1, k, k))
        lost = self.rows.moving(self.inputs)
        if not lost.before.size or not k:
            return mean, Q
        point = start_of(self)
        X = self.path if self.path.size else self.simulated(point).states[:, :, 0]
        sim = self._simulation([point])
        means, moves = moves_in_holes(lost, sim, self.inputs, X, self.shooting.scale)
        for at, m in means.items():
            mean[at - 1] += m[:, 0]
        for at, m in moves.items():
            Q[at - 1] += m @ m.T
        return mean, Q

    @cached_property
    def _filter(self) -> PathFilter:
        """Of the plant about its path; where it begins is fitted."""
        path = self._noisy_at(start_of(self), self.path).about(self.path)
        k = len(self.model.states)
        return PathFilter(path, self._holes[1] + path.driving(self._densities), np.zeros((k, k)))

    @cached_property
    def lost(self) -> Disturbed:
        """Nothing where noise drives the states: what rows that are lost do to them is a part of it."""
        return Disturbed() if self.path.size else super().lost

    def _shown(self, points: Sequence[ScenePoint]) -> Mapping[str, Array]:
        if not self.path.size:
            return super()._shown(points)
        initial = np.repeat(self.path[:, :, None], len(points), axis=2)
        return self._simulation(points).run(self.inputs, range(self.log.n), initial).channels

    def simulated(self, point: ScenePoint) -> Run:
        """The simulation at a point; with process noise what the channels show along the path."""
        if not self.path.size:
            return super().simulated(point)
        shown = self.sensors.added(self._shown([without_sensor_errors(point)]), [point])
        return Run(self.path[:, :, None], shown, 1)

    def _innovations(self, channels: Mapping[str, Array], points: Sequence[ScenePoint]) -> Array:
        """Normalised innovations of points with the same effects, shape (n, channels, points)."""
        sim = self._simulation(points)
        initial = np.repeat(self.path[:, :, None], len(points), axis=2)
        there = sim.reached(self.inputs, np.arange(self.log.n - 1), initial[:-1], np.arange(1, self.log.n))
        d = defects(there, self.path, self.shooting.scale) + self._holes[0][:, :, None]
        y = np.zeros((self.log.n, len(self.recorded), len(points)))
        for j, (name, r) in enumerate(self.recorded.items()):
            y[r.at, j] = r.left(channels[name])
        return self._filter.innovations(y, d, sim.batch.initial[0] - self.path[0][:, None])

    def _ordinates(self, z: Array) -> Array:
        """Cosine transforms of innovations, shape (n, channels, columns), of each channel's samples."""
        from scipy.fft import dct

        parts = [z[r.at, j] for j, r in enumerate(self.recorded.values())]
        return np.concatenate([dct(x, type=2, axis=0, norm="ortho") for x in parts])

    def _left(self, channels: Mapping[str, Array], points: Sequence[ScenePoint]) -> Array:
        if not self.path.size:
            return super()._left(channels, points)
        return self._ordinates(self._innovations(channels, points))

    def _begun(self, shown: Mapping[str, Array], points: Sequence[ScenePoint]) -> list[Array]:
        found = super()._begun(shown, points)
        return independent([self._filtered(E) for E in found]) if self.path.size else found

    def _unforced(self, shown: Mapping[str, Array], points: Sequence[ScenePoint]) -> Mapping[str, Array]:
        return super()._shown(points) if self.path.size else shown

    def _filtered(self, E: Array) -> Array:
        """Columns of whitened channels, shape (sum of lengths, k), as their innovations."""
        n, k = self.log.n, E.shape[1]
        y = np.zeros((n, len(self.recorded), k))
        parts = np.split(E, np.cumsum(self.lengths)[:-1])
        for j, (r, part) in enumerate(zip(self.recorded.values(), parts)):
            y[r.at, j] = r.noise * Whitener.back(part)
        states = len(self.model.states)
        return self._ordinates(
            self._filter.innovations(y, np.zeros((n - 1, states, k)), np.zeros((states, k)))
        )

    @cached_property
    def log_widths(self) -> Array:
        """See `kfgen.gap.scene.scene.HasWidths`."""
        if not self.path.size:
            return np.zeros(sum(self.lengths))
        widths = self._filter.log_widths
        return np.concatenate([widths[r.at, j] for j, r in enumerate(self.recorded.values())])

    def likely_random_errors(self, point: ScenePoint) -> list[FittedRandomError]:
        """See `kfgen.gap.scene.random_error.HasRandomErrors`."""
        known = {p.where for p in self.random_errors}
        among = [n for n in self.model.states if n not in known and not self._is_integral(n)]
        if not among or self.not_white:
            return []
        key = point.placed, point.unknowns.tobytes()
        if key not in self._likely:
            X = self.simulated(point).states[:, :, 0]
            width = parameter_width(self, ProcessNoise(1.0), "N")
            found, X = self._noisy_at(point, X).likely(X, among, width)
            if found:
                self._with[found[0].placed] = self._more(found[0].placed).on_path(X)
                found = self._over_this(found, point)
            self._likely[key] = found
        return self._likely[key]

    @cached_property
    def _likely(self) -> dict[tuple[tuple[Placed, ...], bytes], list[FittedRandomError]]:
        """What is likely beside points, as far as it was looked for: it is asked for again and again."""
        return {}

    @cached_property
    def _with(self) -> dict[Placed, NoisyPlantScene]:
        """The same with one process noise more, as far as it was asked for."""
        return {}

    def _over_this(self, found: list[FittedRandomError], point: ScenePoint) -> list[FittedRandomError]:
        """The same by the likelihood of scenes, in which noises of channels may be of other sizes and starts are fitted."""
        noisy = self.with_random_error(found[0].placed)
        k = len(self.model.states)
        begun = np.concatenate([noisy.path[0], point.unknowns[k * len(self.starts) :]])
        values = []
        for scene, unknowns in ((self, point.unknowns), (noisy, begun)):
            there = ScenePoint(point.placed, unknowns)
            value = log_posterior(scene, scene.residuals([there])[:, 0], unknowns)
            values.append(value - scene.spread(there) - scene.log_widths.sum())
        more = float(values[1] - values[0]) - (found[0].evidence - found[0].occam)
        return [replace(f, evidence=f.evidence + more) for f in found]

    def _is_integral(self, state: str) -> bool:
        """Whether the derivative of a state is another state, and nothing else."""
        return self.model.dynamics[state].value in {symbol(n) for n in self.model.states}

    def with_random_error(self, placed: Placed) -> NoisyPlantScene:
        """The same with one process noise more."""
        if placed not in self._with:
            self._with[placed] = self._more(placed).on_smoothed_path()
        return self._with[placed]

    def _more(self, placed: Placed) -> NoisyPlantScene:
        return replace(self, random_errors=(*self.random_errors, placed), noise_free=self.noise_free or self)

    def without_random_errors(self, where: str) -> NoisyPlantScene:
        """The same without the process noise of a state beside that of the model file."""
        scene = self.noise_free or self
        for p in self.random_errors:
            scene = scene.with_random_error(p) if p.where != where else scene
        return scene

    def not_random(self, placed: Placed, point: ScenePoint) -> str:
        """See `kfgen.gap.scene.random_error.HasRandomErrors`."""
        assert isinstance(placed.effect, ProcessNoise)
        N = float(placed.effect.N)
        inside = without_sensor_errors(point)
        shown = self.sensors.added(self._shown([inside]), [point])
        state = list(self.model.states).index(placed.where)
        steps = self.log.n - 1
        first = np.unique(np.linspace(0, steps, min(COURSE_POINTS, steps) + 1).astype(np.intp))[:-1]
        widths = np.diff(np.append(first, steps))[:, None]

        def course(z: Array) -> Array:
            drove = self._filter.drove(z, state, N)
            return np.asarray(np.add.reduceat(drove, first, axis=0) / widths)

        rng = np.random.default_rng(0)
        shape = self.log.n, len(self.recorded), COURSES_AT_ONCE
        drawn = [course(rng.standard_normal(shape)) for _ in range(CHANCE_COURSES // COURSES_AT_ONCE)]
        companions = dict(self.inputs)
        companions |= {f"the state {n}": self.path[:, i] for i, n in enumerate(self.model.states)}
        companions["time"] = self.clock
        seen = {n: v[first] for n, v in companions.items() if float(np.ptp(v[first])) > 0.0}
        return not_random(
            self.clock[first], course(self._innovations(shown, [inside]))[:, 0], np.column_stack(drawn), seen
        )
