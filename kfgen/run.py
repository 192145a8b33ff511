"""The emitted filterpy filter over a log: estimates, innovations, and how far from a reference."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.discretise import DiscreteModel
from kfgen.emit.filterpy import class_name, files
from kfgen.emit.names import argument
from kfgen.emit.routines import Program
from kfgen.errors import InputError
from kfgen.log import Log
from kfgen.model.equations import Equations, Shown
from kfgen.model.motion import AFTER, AT, BEFORE, Constant, Input
from kfgen.model.sensors import Sensor
from kfgen.model.truth import level_at

Array = NDArray[np.float64]

ALIGNMENT = 1.0
"""Seconds at rest from which the first attitude is taken."""


@dataclass(frozen=True)
class SensorRun:
    """One sensor's updates: times (m,), innovations (m, rows), their normalised squares (m,)."""

    t: Array
    innovation: Array
    nis: Array


@dataclass(frozen=True)
class FilterRun:
    """A filter over a log.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    names : tuple of str
        Of the stored state.
    estimate : ndarray, shape (n, nx)
        Stored state after the updates of each sample.
    deviation : ndarray, shape (n, states)
        Square roots of the diagonal of P.
    sensors : mapping of str to SensorRun
    """

    model: str
    t: Array
    names: tuple[str, ...]
    estimate: Array
    deviation: Array
    sensors: Mapping[str, SensorRun]


def load(program: Program) -> ModuleType:
    """The emitted filterpy module, written to a scratch folder and imported from there."""
    ((name, text),) = files(program).items()
    with tempfile.TemporaryDirectory(prefix="kfgen-run-") as folder:
        path = Path(folder) / name
        path.write_text(text, encoding="utf-8")
        spec = importlib.util.spec_from_file_location(f"kfgen_emitted_{program.name}", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module


def run(program: Program, log: Log) -> FilterRun:
    """Run a filter over a log from its alignment on.

    Parameters
    ----------
    program : Program
    log : Log
        With the model's inputs and drivers; sensors whose channels it lacks are left out.

    Raises
    ------
    InputError
        An input is missing or not a number, or no sensor is in the log.
    """
    discrete = program.discrete
    model, module = discrete.model, load(program)
    kf = getattr(module, class_name(program))()
    kf.gate = np.inf  # every sample counts: the innovations of a run are its result
    inputs = {
        argument(i.name): log.values(i.name)
        if i.scalar
        else np.column_stack([log.values(c) for c in i.channels])
        for i in model.motion.inputs
    }
    acting = {n: _over_steps(v, model.motion.chosen.get("samples", AFTER)) for n, v in inputs.items()}
    drive = {argument(d): log.values(d) for d in model.drivers}
    present = {
        s.name: np.column_stack([log.channel(c).values for c in s.channels])
        for s in model.sensors
        if all(c in log.channels for c in s.channels)
    }
    if not present:
        raise InputError(
            f"no sensor of {model.name} is in the log",
            where=log.source,
            remedy="It knows " + ", ".join(c for s in model.sensors for c in s.channels),
        )
    _align(kf, discrete, log, model.constants)
    takes = {r.name: {a.name for a in r.arguments} for r in program.pieces}
    stepping = set().union(*(takes[n] for n in ("step", "transition", "noise")))
    steps = np.append(np.diff(log.t), 0.0)
    estimate = np.empty((log.n, len(discrete.nominal_names)))
    deviation = np.empty((log.n, program.n))
    seen: dict[str, list[tuple[float, Array, float]]] = {name: [] for name in present}
    for k in range(log.n):
        for name, values in present.items():
            z = values[k]
            if np.isfinite(z).all():
                extra = {n: v[k] for n, v in (inputs | drive).items() if n in takes[f"expect_{name}"]}
                getattr(kf, f"update_{name}")(z, **extra)
                seen[name].append((log.t[k], kf.innovation[: z.size].copy(), kf.nis))
        estimate[k], deviation[k] = kf.nominal, np.sqrt(np.maximum(np.diag(kf.P), 0.0))
        if steps[k] > 0.0:
            given: dict[str, Any] = {n: v[k] for n, v in (acting | drive).items() if n in stepping}
            kf.predict(**given, dt=steps[k])
    sensors = {
        name: SensorRun(
            np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
        )
        for name, rows in seen.items()
    }
    return FilterRun(model.name, np.asarray(log.t), discrete.nominal_names, estimate, deviation, sensors)


def _over_steps(values: Array, samples: str) -> Array:
    """What acts from each sample to the next, by what a sample stands for."""
    later: Array = np.concatenate([values[1:], values[-1:]])
    return {AFTER: values, BEFORE: later, AT: 0.5 * (values + later)}[samples]


def _align(kf: Any, discrete: DiscreteModel, log: Log, constants: tuple[Constant, ...]) -> None:
    """The first state: attitude from what points up and north at rest, blocks from the sensors that show them.

    A plant's state that starts unknown starts where a sensor shows it.
    """
    model = discrete.model
    names = list(discrete.nominal_names)
    motion = model.motion
    shown: list[tuple[Sensor, str]]
    if isinstance(motion, Equations):
        shown = [
            (s, s.value.name)
            for s in model.sensors
            if isinstance(s, Shown) and motion.starts_unknown(s.value)
        ]
    else:
        if model.attitude is not None:
            _align_attitude(kf, discrete, log, constants)
        places = {b.name: b.nominal_names for b in model.blocks}
        shown = [(s, n) for s in model.sensors if s.shows in places for n in places[s.shows]]
    for s, name in shown:
        channel = log.channels.get(s.channels[[n for o, n in shown if o is s].index(name)])
        if channel is not None:
            known = channel.values[np.isfinite(channel.values)]
            kf.nominal[names.index(name)] = float(known[0]) if known.size else 0.0


def _align_attitude(kf: Any, discrete: DiscreteModel, log: Log, constants: tuple[Constant, ...]) -> None:
    """Attitude from the first second, and what a sensor knows of its own constants then."""
    from scipy.spatial.transform import Rotation

    model, names = discrete.model, list(discrete.nominal_names)
    declared: list[Input | Sensor] = [*model.motion.inputs, *model.sensors]
    parts = [p for p in declared if all(c in log.channels for c in p.channels)]
    up = next((p for p in parts if p.at_rest == "up"), None)
    if up is None:
        return
    up_b = _first_mean(log, up)
    up_b = up_b / np.linalg.norm(up_b)
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up_b[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    for s in model.sensors:
        if s.at_rest == "north" and s in parts:
            ahead = _first_mean(log, s)
            told = s.calibrated(tuple(ahead), tuple(up_b))
            for i, c in enumerate(constants):
                kf.constants[i] = told.get(c.name, kf.constants[i])
            for name in told.keys() & set(names):
                kf.nominal[names.index(name)] = told[name]
    north = ahead - (ahead @ up_b) * up_b
    north /= np.linalg.norm(north)
    R_lb = np.vstack([north, np.cross(-up_b, north), -up_b])
    values = {c.name: c.value for c in constants} | dict(zip(names, discrete.start))
    at = names.index("q_w")
    q = Rotation.from_matrix(level_at(model, values).T @ R_lb).as_quat(scalar_first=True)
    kf.nominal[at : at + 4] = [float(v) for v in q]


def _first_mean(log: Log, part: Input | Sensor) -> Array:
    """The mean of a triad over the alignment; raises `InputError` where it says nothing."""
    first = log.t - log.t[0] <= ALIGNMENT
    values = np.column_stack([log.channel(c).values[first] for c in part.channels])
    good = values[np.isfinite(values).all(axis=1)]
    if not good.size or not np.linalg.norm(good.mean(axis=0)) > 0.0:
        raise InputError(
            f"{part.name} has no usable sample in the first {ALIGNMENT:g} s, so there is no first attitude",
            where=log.source,
            remedy="Cut the log to where the sensor works and is at rest",
        )
    return np.asarray(good.mean(axis=0))


@dataclass(frozen=True)
class AttitudeError:
    """Root mean square errors [rad] against a reference attitude, over the samples that have one."""

    inclination: float
    heading: float
    samples: int


def attitude_error(result: FilterRun, log: Log) -> AttitudeError | None:
    """Compare with the log's ``ref_q_*``; None where it has none.

    Inclination is the angle between the two verticals; heading is what remains about the vertical,
    after the constant difference of the two norths is taken out.
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
    return AttitudeError(
        float(np.sqrt(np.mean(inclination**2))), float(np.sqrt(np.mean(heading**2))), int(good.sum())
    )
