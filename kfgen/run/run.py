"""The emitted filterpy filter over a log: estimates, innovations, and how far from a reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.core.numbers import quantity
from kfgen.core.recent_results import RecentResults
from kfgen.core.result import Result, ShortTable
from kfgen.emit.align import Alignment
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name, module
from kfgen.emit.targets.loaded import loaded
from kfgen.emit.watch.parts import PARTS
from kfgen.log.log import Log
from kfgen.log.readers import LogOrPath, log_of
from kfgen.model.build import ModelSource, NoiseSource, filter_of
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter_equations import FilterEquations
from kfgen.run.adaptive.rules import rule_named
from kfgen.run.against_reference import AttitudeError, StateErrors, attitude_error, state_errors
from kfgen.run.filter_calls import FilterCall, FilterCalls, rates_in
from kfgen.run.filter_log import as_named_by
from kfgen.run.sensor_run import SensorRun
from kfgen.run.track import LevelAxes, Track, logged_tracks, track
from kfgen.run.words import assumes_exact_field, beyond_gate, consistency

Array = NDArray[np.float64]

MODULES = RecentResults[ModuleType](8)
"""Emitted modules by their program: a search runs the same filter over a log many times."""


@dataclass(frozen=True, repr=False)
class FilterRun(Result):
    """A filter over a log.

    Parameters
    ----------
    model : str
        Its name.
    t : ndarray, shape (n,)
        Times [s].
    names : tuple of str
        Of the stored state.
    estimate : ndarray, shape (n, nx)
        Stored state [SI] after the updates of each sample.
    deviation : ndarray, shape (n, states)
        Standard deviations [SI] of the error states: square roots of the diagonal of P.
    sensors : mapping of str to SensorRun
        By sensor; without updates where the log has none of its samples.
    covariance : ndarray, shape (states, states), optional
        P at the end.
    source, sha256 : str
        Of the log.
    duration : float
        Of the log [s].
    attitude : AttitudeError, optional
        Against the log's reference attitude, where it has one.
    smoothed : bool
        Whether `estimate` and `deviation` are those with all readings known, later ones as well.
    forward : FilterRun, optional
        Of a smoothed run: the run of the filter alone.
    calls : FilterCalls, optional
        Of the run: its filter and its log, from which errors and tracks are made when they are wanted.
    """

    model: str
    t: Array
    names: tuple[str, ...]
    estimate: Array
    deviation: Array
    sensors: Mapping[str, SensorRun]
    covariance: Array | None = None
    source: str = ""
    sha256: str = ""
    duration: float = 0.0
    attitude: AttitudeError | None = None
    smoothed: bool = False
    forward: FilterRun | None = field(default=None, compare=False)
    calls: FilterCalls | None = field(default=None, compare=False)

    @cached_property
    def errors(self) -> tuple[StateErrors, ...]:
        """Errors of every block of states for which the log has a reference, with their standard deviations."""
        if self.calls is None:
            return ()
        equations = FilterEquations(self.calls.program.discrete)
        return state_errors(equations, self.estimate, self.deviation, self.calls.log)

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Where the vehicle was and how it was turned: as estimated, and as the log says it."""
        if self.calls is None:
            return ()
        model, names = self.calls.program.discrete.model, self.names
        fixed = {c.name: float(c.value) for c in model.constants}
        axes = LevelAxes.of(model, names, self.estimate[0], fixed)
        label = "smoothed" if self.smoothed else "filter"
        runs = [(label, self), *([("filter", self.forward)] if self.forward is not None else [])]
        estimated = [track(n, axes, model, names, self.t, r.estimate) for n, r in runs]
        if estimated[0].position is None and estimated[0].attitude is None:
            return ()
        return (*estimated, *logged_tracks(axes, model, names, self.calls.log))

    @property
    def updated(self) -> dict[str, SensorRun]:
        """The sensors that had an update."""
        return {name: s for name, s in self.sensors.items() if s.t.size}

    def unit_of(self, channel: str) -> str:
        """The unit of a channel of a sensor, SI; empty where it is not known."""
        return self.calls.program.discrete.model.channel_units.get(channel, "") if self.calls else ""

    def consistency(self, sensor: str) -> str:
        """The verdict on a sensor: whether its innovations are as large as the filter expects, and what the gate would do."""
        s = self.updated[sensor]
        said = consistency(sensor, float(s.nis.mean()), s.t.size, s.expected_nis95)
        return f"{said}; {beyond_gate(s.beyond_gate, s.t.size, s.gate)}" if s.beyond_gate else said

    @cached_property
    def cautions(self) -> tuple[str, ...]:
        """What the log holds or lacks, and what may be why innovations are too large, a sentence each."""
        if self.calls is None:
            return ()
        said = (*self.calls.log.held, *self.calls.through_pauses)
        too_large = any(float(s.nis.mean()) > s.expected_nis95[1] for s in self.updated.values())
        if not too_large or not (measured := self.calls.assumed_exact):
            return said
        tilt = Alignment(self.calls.program.discrete.model).tilt
        error = quantity(tilt * float(np.linalg.norm([*measured.values()])), "uT", 2)
        components = ", ".join(f"{n} {quantity(v, 'uT')}" for n, v in measured.items())
        return (*said, assumes_exact_field(components, tilt, error))

    @property
    def title(self) -> str:
        """What ran over what."""
        known = ", smoothed with all readings" if self.smoothed else ""
        return f"{self.model} over {self.duration:.6g} s of {self.source}{known}"

    def summary(self) -> list[str]:
        """What ran over what, and the mean NIS of each sensor beside its number of rows."""
        nis = [f"{n} {s.nis.mean():.3g} of {s.innovation.shape[1]}" for n, s in self.updated.items()]
        lines = [self.title, f"mean NIS: {', '.join(nis)}"]
        if self.attitude is not None:
            lines.append(f"attitude error: {np.degrees(self.attitude.total):.3g} deg RMS")
        return lines

    def short_table(self) -> ShortTable:
        """Updates, rows, mean NIS and samples beyond the gate of each sensor."""
        rows = [
            [name, str(s.t.size), str(s.innovation.shape[1]), f"{s.nis.mean():.3g}", str(s.beyond_gate)]
            for name, s in self.updated.items()
        ]
        return ("sensor", "updates", "rows", "mean NIS", "beyond gate"), rows

    def to_dict(self) -> dict[str, Any]:
        """The estimate at the end [SI], the mean NIS of each sensor, the errors of the attitude."""
        data: dict[str, Any] = {
            "format": "kfgen-run-1",
            "kfgen": kfgen.__version__,
            "model": self.model,
            "log": self.source,
            "sha256": self.sha256,
            "duration_s": self.duration,
            "smoothed": self.smoothed,
        }
        if self.attitude is not None:
            data["attitude_error"] = {
                "inclination_rmse": self.attitude.inclination,
                "heading_rmse": self.attitude.heading,
                "total_rmse": self.attitude.total,
                "unit": "rad",
                "samples": self.attitude.samples,
            }
        if self.errors:
            data["errors"] = {
                name: {"rmse": rms, "unit": e.unit, "outside_3_sigma_share": share, "samples": int(e.t.size)}
                for e in self.errors
                for name, rms, share in zip(e.names, e.rms, e.outside)
            }
        data["sensors"] = {
            name: {**s.to_dict(), "sentence": self.consistency(name)} for name, s in self.updated.items()
        }
        return data | {"final": dict(zip(self.names, self.estimate[-1].tolist()))}


def load(program: Program) -> ModuleType:
    """The emitted filterpy module, imported from a scratch folder; the last few are kept."""
    options = (getattr(program, f.name) for f in fields(program) if f.name != "discrete")
    return MODULES.recalled((program.discrete.hash, *options), lambda: loaded(module(program)))


def program_over(model: ModelSource, log: Log, noise: NoiseSource | None = None) -> Program:
    """A filter that may be run over a log: at the log's rate, with steps as long as its longest gap.

    Parameters
    ----------
    model : FilterModel, str or Path
        As `kfgen.build` gives or takes it.
    log : Log
    noise : NoiseModel or path-like, optional
        The effects of the channels; only beside a name or a path.
    """
    longest = max(DiscreteModel.max_step, 1.001 * float(np.diff(log.t).max(initial=log.dt)))
    built = filter_of(model, noise)
    rates = rates_in(log, built)
    discrete = DiscreteModel.at_rate(built, 1.0 / log.dt, max_step=longest, rates=rates)
    return Program(discrete, without=tuple(PARTS))


def run(  # noqa: PLR0913 - what a user may choose
    model: ModelSource | Program,
    log: LogOrPath,
    noise: NoiseSource | None = None,
    adaptive: str | None = None,
    *,
    wrap: Callable[[type[Any]], type[Any]] | None = None,
    start: Mapping[str, float] | None = None,
    smooth: bool = False,
) -> FilterRun:
    """Run the emitted filterpy filter over a log from its alignment on, without a gate.

    Parameters
    ----------
    model : FilterModel, str, Path or Program
        A filter of `kfgen.build`, the name of a library model, the path of a file, or a program as it is.
    log : Log or path-like
        With the model's inputs and drivers; sensors whose channels it lacks are left out.
    noise : NoiseModel or path-like, optional
        The effects of the channels; only beside a name or a path.
    adaptive : str, optional
        A rule by which P, Q or R adapt to the innovations, a key of `kfgen.run.adaptive.rules.rules`.
    wrap : callable, optional
        Makes another class of the emitted one, as `kfgen.run.adaptive.wrapper.adapted` does.
    start : mapping of str to float, optional
        Stored states that are known better than by alignment [SI].
    smooth : bool
        Whether estimates and standard deviations are those of a Rauch-Tung-Striebel smoother: each with all readings
        of the log, those after it as well. Innovations and NIS stay those of the filter.

    Returns
    -------
    FilterRun

    Raises
    ------
    InputError
        As in `kfgen.build`; an input is missing or not a number, no sensor is in the log, or no such rule. Smoothed: the
        filter adapts, has no state, diverges, or the log is too long for the memory.
    """
    built = model.discrete.model if isinstance(model, Program) else filter_of(model, noise)
    log = as_named_by(built, log_of(log))
    program = model if isinstance(model, Program) else program_over(built, log)
    if adaptive is not None:
        from kfgen.run.adaptive.wrapper import adapted

        rule = rule_named(adaptive, "--adaptive")
        wrap = lambda emitted: adapted(emitted, rule)  # noqa: E731
    calls = FilterCalls(program, log, start or {})
    if not smooth:
        return _with_reference(_played(calls, wrap, as_emitted=wrap is None), calls)
    from kfgen.run.smooth import ForwardPass, check_smoothable, of_all_readings

    check_smoothable(calls, adapts=wrap is not None)
    forward = ForwardPass()
    filtered = _with_reference(_played(calls, forward.wrap, as_emitted=True), calls)
    known = _with_reference(of_all_readings(filtered, calls, forward), calls)
    return replace(known, forward=filtered)


def _with_reference(result: FilterRun, calls: FilterCalls) -> FilterRun:
    """Where the run comes from, and how far it is from the log's reference attitude."""
    log = calls.log
    known = replace(result, source=log.source, sha256=log.sha256, duration=log.duration, calls=calls)
    return replace(known, attitude=attitude_error(result, log))


def _played(calls: FilterCalls, wrap: Callable[[type[Any]], type[Any]] | None, as_emitted: bool) -> FilterRun:
    """The calls of a log on the emitted filter; `as_emitted`: with the covariances of its model."""
    program, log = calls.program, calls.log
    emitted = getattr(load(program), class_name(program))
    kf = (wrap(emitted) if wrap else emitted)()
    gates = dict(kf.gates)
    kf.gates = dict.fromkeys(kf.gates, calls.GATE)
    kf.nominal[:], kf.constants[:] = calls.start, calls.constants
    names = program.discrete.nominal_names
    estimate = np.empty((log.n, len(names)))
    deviation = np.empty((log.n, program.n))
    seen: dict[str, list[tuple[float, Array, float, Array]]] = {name: [] for name in calls.present}

    def make(call: FilterCall) -> None:
        kf.nis = np.nan
        getattr(kf, call.routine)(**call.given)
        if call.sensor and np.isfinite(kf.nis):  # else it was refused before it was compared with anything
            y, S = (x[: np.size(call.given["z"])].copy() for x in (kf.innovation, kf.variance))
            seen[call.sensor].append((log.t[call.row], y, kf.nis, np.sqrt(S)))

    for k in range(log.n):
        for call in calls.updates(k):
            make(call)
        estimate[k], deviation[k] = kf.nominal, np.sqrt(np.maximum(kf.P.diagonal(), 0.0))
        for call in calls.steps(k):
            make(call)
    channels = {s.name: s.channels for s in program.discrete.model.sensors}
    sensors = {}
    for name, rows in seen.items():
        t, y, nis, sd = (np.array([r[i] for r in rows]) for i in range(4))
        sensors[name] = SensorRun(t, y, nis, channels[name], sd if as_emitted else None, gates[name])
    t, model = np.asarray(log.t), program.discrete.model.name
    return FilterRun(model, t, names, estimate, deviation, sensors, np.array(kf.P))
