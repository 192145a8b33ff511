"""The emitted filterpy filter over a log: estimates, innovations, and how far from a reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.core.result import Result, ShortTable
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name, module
from kfgen.emit.targets.loaded import loaded
from kfgen.emit.watch.parts import PARTS
from kfgen.log.log import Log
from kfgen.log.readers import LogOrPath, log_of
from kfgen.model.build import ModelSource, NoiseSource, filter_of
from kfgen.model.discretise import DiscreteModel
from kfgen.run.adaptive.rules import rule_named
from kfgen.run.filter_calls import FilterCall, FilterCalls, rates_in
from kfgen.run.filter_log import as_named_by

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorRun:
    """One sensor's updates: times of the samples in the log (m,), innovations (m, rows), their normalised squares (m,).

    `channels` are the names of the rows.
    """

    t: Array
    innovation: Array
    nis: Array
    channels: tuple[str, ...]

    @property
    def expected_nis95(self) -> tuple[float, float]:
        """Between which ends the mean NIS of a consistent filter is with 95 %: a chi-square of all rows, over the updates."""
        from scipy.stats import chi2

        m, rows = self.innovation.shape
        lo, hi = chi2.ppf([0.025, 0.975], m * rows) / m
        return float(lo), float(hi)


@dataclass(frozen=True)
class AttitudeError:
    """Root mean square errors [rad] against a reference attitude, over the samples that have one.

    The total is the angle of the whole rotation that is left once the norths agree.
    """

    inclination: float
    heading: float
    samples: int
    total: float = float("nan")


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

    @property
    def updated(self) -> dict[str, SensorRun]:
        """The sensors that had an update."""
        return {name: s for name, s in self.sensors.items() if s.t.size}

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
        """Updates, rows and mean NIS of each sensor."""
        rows = [
            [name, str(s.t.size), str(s.innovation.shape[1]), f"{s.nis.mean():.3g}"]
            for name, s in self.updated.items()
        ]
        return ("sensor", "updates", "rows", "mean NIS"), rows

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
        data["sensors"] = {
            name: {"updates": int(s.t.size), "mean_nis": float(s.nis.mean())}
            for name, s in self.updated.items()
        }
        return data | {"final": dict(zip(self.names, self.estimate[-1].tolist()))}


def load(program: Program) -> ModuleType:
    """The emitted filterpy module, imported from a scratch folder."""
    return loaded(module(program))


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
        return _with_reference(_played(calls, wrap), log)
    from kfgen.run.smooth import ForwardPass, check_smoothable, of_all_readings

    check_smoothable(calls, adapts=wrap is not None)
    forward = ForwardPass()
    return _with_reference(of_all_readings(_played(calls, forward.wrap), calls, forward), log)


def _with_reference(result: FilterRun, log: Log) -> FilterRun:
    """Where the run comes from, and how far it is from the log's reference attitude."""
    known = replace(result, source=log.source, sha256=log.sha256, duration=log.duration)
    return replace(known, attitude=attitude_error(result, log))


def _played(calls: FilterCalls, wrap: Callable[[type[Any]], type[Any]] | None) -> FilterRun:
    """The calls of a log on the emitted filter."""
    program, log = calls.program, calls.log
    emitted = getattr(load(program), class_name(program))
    kf = (wrap(emitted) if wrap else emitted)()
    kf.gates = dict.fromkeys(kf.gates, calls.GATE)
    kf.nominal[:], kf.constants[:] = calls.start, calls.constants
    names = program.discrete.nominal_names
    estimate = np.empty((log.n, len(names)))
    deviation = np.empty((log.n, program.n))
    seen: dict[str, list[tuple[float, Array, float]]] = {name: [] for name in calls.present}

    def make(call: FilterCall) -> None:
        getattr(kf, call.routine)(**call.given)
        if call.sensor:
            rows = np.size(call.given["z"])
            seen[call.sensor].append((log.t[call.row], kf.innovation[:rows].copy(), kf.nis))

    for k in range(log.n):
        for call in calls.updates(k):
            make(call)
        estimate[k], deviation[k] = kf.nominal, np.sqrt(np.maximum(np.diag(kf.P), 0.0))
        for call in calls.steps(k):
            make(call)
    channels = {s.name: s.channels for s in program.discrete.model.sensors}
    sensors = {
        name: SensorRun(
            np.array([r[0] for r in rows]),
            np.array([r[1] for r in rows]),
            np.array([r[2] for r in rows]),
            channels[name],
        )
        for name, rows in seen.items()
    }
    t, model = np.asarray(log.t), program.discrete.model.name
    return FilterRun(model, t, names, estimate, deviation, sensors, np.array(kf.P))


def attitude_error(result: FilterRun, log: Log) -> AttitudeError | None:
    """Compare with the log's ``ref_q_*``; None where it has none.

    Parameters
    ----------
    result : FilterRun
        Over `log`.
    log : Log
        With the reference ``ref_q_w`` to ``ref_q_z``; where it has a channel ``movement``, samples above 0.5 count.

    Returns
    -------
    AttitudeError or None

    Notes
    -----
    Inclination is the angle between the two verticals; heading is what remains about the vertical,
    after the constant difference of the two norths is removed.
    """
    from scipy.spatial.transform import Rotation

    if "q_w" not in result.names or any(f"ref_q_{a}" not in log.channels for a in "wxyz"):
        return None
    at = result.names.index("q_w")
    reference = np.column_stack([log.channel(f"ref_q_{a}").values for a in "wxyz"])
    good = np.isfinite(reference).all(axis=1)
    if "movement" in log.channels:
        good &= log.channel("movement").values > 0.5
    if not good.any():
        return None
    estimated = Rotation.from_quat(result.estimate[good, at : at + 4], scalar_first=True)
    error = (estimated * Rotation.from_quat(reference[good], scalar_first=True).inv()).as_quat(
        scalar_first=True
    )
    w, x, y, z = error.T
    inclination = 2.0 * np.arcsin(np.clip(np.hypot(x, y), 0.0, 1.0))
    heading = 2.0 * np.arctan2(z, w)
    heading -= np.angle(np.mean(np.exp(1j * heading)))
    heading = np.angle(np.exp(1j * heading))
    total = 2.0 * np.arccos(np.clip(np.cos(heading / 2.0) * np.cos(inclination / 2.0), -1.0, 1.0))
    sizes = [float(np.sqrt(np.mean(e**2))) for e in (inclination, heading, total)]
    return AttitudeError(sizes[0], sizes[1], int(good.sum()), sizes[2])
