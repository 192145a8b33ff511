"""The heading at the start of a log in which nothing points north: the one of some with which the filter fits best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.flight_log import FlightLog
from kfgen.model.filter_equations import FilterEquations
from kfgen.model.filter_file import HEADING

Array = NDArray[np.float64]

TRIED_HEADINGS = 12
"""Evenly around the circle: the filter finds its way from 15 degrees off."""
UNKNOWN_HEADING_SD_RAD = 1.0
"""Standard deviation of a heading that nothing shows before the log moves."""


def is_unknown(log: FlightLog) -> bool:
    """Whether nothing says where north is at the start."""
    shown = any(a.sensor.at_rest == "north" for a in log.aiding)
    return not shown and HEADING not in log.discrete.model.initial


def headings(log: FlightLog, equations: FilterEquations) -> list[FlightLog]:
    """The log with every start that is to be tried."""
    if not is_unknown(log):
        return [log]
    angles = 2.0 * np.pi * np.arange(TRIED_HEADINGS) / TRIED_HEADINGS
    return [replace(log, start=_turned(log, equations, float(a))) for a in angles]


def start_covariance(log: FlightLog, equations: FilterEquations) -> Array:
    """Covariance of the error state at the start, shape (states, states)."""
    model = log.discrete.model
    P0 = np.diag([s.prior**2 for s in model.states])
    if is_unknown(log) and model.attitude is not None:
        names = [s.name for s in model.states]
        at = [names.index(n) for n in model.attitude.error_names]
        level, R_nb = _axes(log, equations)
        down = level.T @ np.array([0.0, 0.0, 1.0])
        axis = R_nb.T @ down if model.attitude.convention.side.body else down
        P0[np.ix_(at, at)] += UNKNOWN_HEADING_SD_RAD**2 * np.outer(axis, axis)
    return np.asarray(P0)


def _axes(log: FlightLog, equations: FilterEquations) -> tuple[Array, Array]:
    """Navigation axes to north-east-down, and body to navigation axes, at the start."""
    from scipy.spatial.transform import Rotation

    x, k = log.start[None, :], equations.quaternions[0]
    drive = {d: v[:1] for d, v in log.drive.items()}
    given = equations.given(x, log.u[:1], drive, log.constants, log.dt)
    R_nb = Rotation.from_quat(log.start[k : k + 4], scalar_first=True).as_matrix()
    return equations.level.at(given)[0], R_nb


def _turned(log: FlightLog, equations: FilterEquations, angle: float) -> Array:
    """The stored state at the start, turned about down."""
    from scipy.spatial.transform import Rotation

    level, R_nb = _axes(log, equations)
    turn = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    x, k = log.start.copy(), equations.quaternions[0]
    x[k : k + 4] = Rotation.from_matrix(level.T @ turn @ level @ R_nb).as_quat(scalar_first=True)
    return x
