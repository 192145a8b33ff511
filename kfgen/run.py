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
from kfgen.model.motion import Constant

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
                extra = {d: v[k] for d, v in drive.items() if d in takes[f"expect_{name}"]}
                getattr(kf, f"update_{name}")(z, **extra)
                seen[name].append((log.t[k], kf.innovation[: z.size].copy(), kf.nis))
        estimate[k], deviation[k] = kf.nominal, np.sqrt(np.maximum(np.diag(kf.P), 0.0))
        if steps[k] > 0.0:
            given: dict[str, Any] = {n: v[k] for n, v in (inputs | drive).items() if n in stepping}
            kf.predict(**given, dt=steps[k])
    sensors = {
        name: SensorRun(
            np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
        )
        for name, rows in seen.items()
    }
    return FilterRun(model.name, np.asarray(log.t), discrete.nominal_names, estimate, deviation, sensors)


def _align(kf: Any, discrete: DiscreteModel, log: Log, constants: tuple[Constant, ...]) -> None:
    """First attitude from gravity and the magnetic field at rest, first position and velocity from GNSS.

    A plant's state that starts unknown starts where a sensor shows it.
    """
    names = list(discrete.nominal_names)
    motion = discrete.model.motion
    if isinstance(motion, Equations):
        for s in discrete.model.sensors:
            channel = log.channels.get(s.channels[0])
            if isinstance(s, Shown) and channel is not None and motion.starts_unknown(s.value):
                known = channel.values[np.isfinite(channel.values)]
                kf.nominal[names.index(s.value.name)] = float(known[0]) if known.size else 0.0
        return
    if "q_w" in names and all(f"accel_{a}" in log.channels for a in "xyz"):
        kf.nominal[names.index("q_w") : names.index("q_w") + 4] = _level(log, kf, constants)
    for name in ("p", "v"):
        for axis in "NED":
            channel = log.channels.get(f"gnss_{name}_{axis}")
            if channel is not None and f"{name}_{axis}" in names:
                known = channel.values[np.isfinite(channel.values)]
                kf.nominal[names.index(f"{name}_{axis}")] = float(known[0]) if known.size else 0.0


def _level(log: Log, kf: Any, constants: tuple[Constant, ...]) -> list[float]:
    """Attitude from the first second: down from gravity, north from the field's horizontal part."""
    from scipy.spatial.transform import Rotation

    first = log.t - log.t[0] <= ALIGNMENT
    f_b = _first_mean(log, "accel", first)
    down = -f_b / np.linalg.norm(f_b)
    ahead = np.array([1.0, 0.0, 0.0])
    if all(f"mag_{a}" in log.channels for a in "xyz"):
        m_b = _first_mean(log, "mag", first)
        ahead = m_b
        field = {"mag_D": float(m_b @ down), "mag_N": float(np.linalg.norm(m_b - (m_b @ down) * down))}
        for i, c in enumerate(constants):
            kf.constants[i] = field.get(c.name, kf.constants[i])
    elif abs(down @ ahead) > 0.9:
        ahead = np.array([0.0, 0.0, 1.0])
    north = ahead - (ahead @ down) * down
    north /= np.linalg.norm(north)
    R_nb = np.vstack([north, np.cross(down, north), down])
    return [float(v) for v in Rotation.from_matrix(R_nb).as_quat(scalar_first=True)]


def _first_mean(log: Log, triad: str, first: NDArray[np.bool_]) -> Array:
    """The mean of a triad over the alignment; raises `InputError` where it says nothing."""
    values = np.column_stack([log.channel(f"{triad}_{a}").values[first] for a in "xyz"])
    good = values[np.isfinite(values).all(axis=1)]
    if not good.size or not np.linalg.norm(good.mean(axis=0)) > 0.0:
        raise InputError(
            f"{triad} has no usable sample in the first {ALIGNMENT:g} s, so there is no first attitude",
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
