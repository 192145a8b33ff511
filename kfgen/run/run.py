"""The emitted filterpy filter over a log: estimates, innovations, and how far from a reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name, module
from kfgen.emit.targets.loaded import loaded
from kfgen.log.log import Log
from kfgen.run.filter_calls import FilterCalls

Array = NDArray[np.float64]


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
    covariance : ndarray, shape (states, states), optional
        P at the end.
    """

    model: str
    t: Array
    names: tuple[str, ...]
    estimate: Array
    deviation: Array
    sensors: Mapping[str, SensorRun]
    covariance: Array | None = None


def load(program: Program) -> ModuleType:
    """The emitted filterpy module, imported from a scratch folder."""
    return loaded(module(program))


def run(
    program: Program,
    log: Log,
    wrap: Callable[[type[Any]], type[Any]] | None = None,
    start: Mapping[str, float] | None = None,
) -> FilterRun:
    """Run a filter over a log from its alignment on, without a gate.

    Parameters
    ----------
    program : Program
    log : Log
        With the model's inputs and drivers; sensors whose channels it lacks are left out.
    wrap : callable, optional
        Makes another class of the emitted one, as `kfgen.run.adaptive.wrapper.adapted` does.
    start : mapping of str to float, optional
        Stored states that are known better than by alignment [SI].

    Raises
    ------
    InputError
        An input is missing or not a number, or no sensor is in the log.
    """
    play = FilterCalls(program, log, start or {})
    emitted = getattr(load(program), class_name(program))
    kf = (wrap(emitted) if wrap else emitted)()
    kf.gate = play.GATE
    kf.nominal[:], kf.constants[:] = play.start, play.constants
    names = program.discrete.nominal_names
    estimate = np.empty((log.n, len(names)))
    deviation = np.empty((log.n, program.n))
    seen: dict[str, list[tuple[float, Array, float]]] = {name: [] for name in play.present}
    for k in range(log.n):
        for name, given in play.updates(k):
            getattr(kf, f"update_{name}")(**given)
            seen[name].append((log.t[k], kf.innovation[: np.size(given["z"])].copy(), kf.nis))
        estimate[k], deviation[k] = kf.nominal, np.sqrt(np.maximum(np.diag(kf.P), 0.0))
        for given in play.steps(k):
            kf.predict(**given)
    sensors = {
        name: SensorRun(
            np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
        )
        for name, rows in seen.items()
    }
    t, model = np.asarray(log.t), program.discrete.model.name
    return FilterRun(model, t, names, estimate, deviation, sensors, np.array(kf.P))


@dataclass(frozen=True)
class AttitudeError:
    """Root mean square errors [rad] against a reference attitude, over the samples that have one.

    The total is the angle of the whole rotation that is left once the norths agree.
    """

    inclination: float
    heading: float
    samples: int
    total: float = float("nan")


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
    total = 2.0 * np.arccos(np.clip(np.cos(heading / 2.0) * np.cos(inclination / 2.0), -1.0, 1.0))
    sizes = [float(np.sqrt(np.mean(e**2))) for e in (inclination, heading, total)]
    return AttitudeError(sizes[0], sizes[1], int(good.sum()), sizes[2])
