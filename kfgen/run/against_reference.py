"""How far the estimates of a run are from what its log knows: the ``ref_`` channels of the filter's stored states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kfgen.log.log import Log
from kfgen.model.filter_equations import FilterEquations
from kfgen.model.symbols.blocks import Attitude

if TYPE_CHECKING:
    from kfgen.run.run import FilterRun

Array = NDArray[np.float64]

REFERENCE = "ref_"
"""Before a channel: a reference for it."""
MAX_SMALL_ANGLE_RAD = 0.1
"""Rotation up to which the filter's own error of an attitude is found; beyond it is the rotation vector."""
BAND_SIGMAS = 3.0
CHANCE_OUTSIDE_PERCENT = 0.27
"""Of normal errors, outside of that band."""


@dataclass(frozen=True)
class AttitudeError:
    """Root mean square errors [rad] against a reference attitude, over the samples that have one.

    The total is the angle of the whole rotation that is left once the norths agree.
    """

    inclination: float
    heading: float
    samples: int
    total: float = float("nan")


@dataclass(frozen=True)
class StateErrors:
    """The errors of a block of states, with the standard deviations that the filter has for them.

    Parameters
    ----------
    title : str
        Of the block.
    names : tuple of str
        Of the error states: of an attitude the rotation from estimate to reference.
    unit : str
        SI.
    t : ndarray, shape (m,)
        Times of the samples that have a reference [s].
    error, deviation : ndarray, shape (m, k)
        Reference less estimate, as the filter writes its errors, and their standard deviations [SI].
    north : float
        Constant angle [rad] by which the reference's north differs, which is not in the errors.
    """

    title: str
    names: tuple[str, ...]
    unit: str
    t: Array
    error: Array
    deviation: Array
    north: float = 0.0

    @property
    def rms(self) -> list[float]:
        """Root mean square of each [SI]."""
        return [float(v) for v in np.sqrt(np.mean(self.error**2, axis=0))]

    @property
    def outside(self) -> list[float]:
        """Share of each outside of three standard deviations."""
        return [float(v) for v in np.mean(np.abs(self.error) > BAND_SIGMAS * self.deviation, axis=0)]


def referenced(log: Log, names: Sequence[str]) -> Array | None:
    """The reference of stored states, shape (n, k); none where the log lacks one of them.

    Parameters
    ----------
    log : Log
    names : sequence of str
    """
    channels = [f"{REFERENCE}{name}" for name in names]
    if any(c not in log.channels for c in channels):
        return None
    return np.column_stack([log.channel(c).values for c in channels])


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
    q = [f"q_{a}" for a in "wxyz"]
    reference = referenced(log, q) if "q_w" in result.names else None
    if reference is None:
        return None
    at = result.names.index("q_w")
    good = np.isfinite(reference).all(axis=1)
    if "movement" in log.channels:
        good &= log.channel("movement").values > 0.5
    if not good.any():
        return None
    w, x, y, z = _between(result.estimate[good, at : at + 4], reference[good]).T
    inclination = 2.0 * np.arcsin(np.clip(np.hypot(x, y), 0.0, 1.0))
    heading = _turn(w, z)
    heading -= _mean_angle(heading)
    heading = np.angle(np.exp(1j * heading))
    total = 2.0 * np.arccos(np.clip(np.cos(heading / 2.0) * np.cos(inclination / 2.0), -1.0, 1.0))
    sizes = [float(np.sqrt(np.mean(e**2))) for e in (inclination, heading, total)]
    return AttitudeError(sizes[0], sizes[1], int(good.sum()), sizes[2])


def state_errors(
    equations: FilterEquations, estimate: Array, deviation: Array, log: Log
) -> tuple[StateErrors, ...]:
    """The errors of every block of states for which the log has a reference, in the filter's own convention.

    Parameters
    ----------
    equations : FilterEquations
        Of the filter.
    estimate : ndarray, shape (n, stored)
        At the times of the log [SI].
    deviation : ndarray, shape (n, states)
    log : Log

    Notes
    -----
    A reference of attitude alone (optical, say) has a north of its own: its constant difference is removed.
    """
    model, names = equations.discrete.model, equations.names
    known = {b.name: r for b in model.blocks if (r := referenced(log, b.nominal_names)) is not None}
    known = {n: r for n, r in known.items() if np.isfinite(r).all(axis=1).any()}
    if not known:
        return ()
    places, north = {n: k for k, n in enumerate(names)}, 0.0
    truth = np.array(estimate)
    for b in (b for b in model.blocks if b.name in known):
        reference, at = known[b.name], np.array([places[n] for n in b.nominal_names])
        there = np.isfinite(reference).all(axis=1)
        if isinstance(b, Attitude):
            reference[there] /= np.linalg.norm(reference[there], axis=1)[:, None]
            if len(known) == 1 and b.frame == Attitude.frame:
                north = _mean_angle(_turn(*_between(estimate[there][:, at], reference[there]).T[[0, 3]]))
                reference[there] = _turned(reference[there], north)
        truth[np.ix_(there, at)] = reference[there]
    away = equations.difference(estimate, truth)
    states = [s.name for s in model.states]
    out = []
    for b in (b for b in model.blocks if b.name in known):
        there = np.isfinite(known[b.name]).all(axis=1)
        columns = np.array([states.index(s) for s in b.error_names])
        error = away[np.ix_(there, columns)]
        if isinstance(b, Attitude):
            q = np.array([places[n] for n in b.nominal_names])
            error = _rotation(b, estimate[np.ix_(there, q)], truth[np.ix_(there, q)], error)
        sd = deviation[np.ix_(there, columns)]
        own = north if isinstance(b, Attitude) else 0.0
        out.append(StateErrors(b.title, b.error_names, b.unit, log.t[there], error, sd, own))
    return tuple(out)


def _rotation(block: Attitude, estimate: Array, truth: Array, error: Array) -> Array:
    """The filter's own error where it is small, else the rotation vector from estimate to truth on the error's side."""
    from scipy.spatial.transform import Rotation

    old, new = (Rotation.from_quat(q, scalar_first=True) for q in (estimate, truth))
    whole = (old.inv() * new if block.convention.side.body else new * old.inv()).as_rotvec()
    large = np.linalg.norm(whole, axis=1) > MAX_SMALL_ANGLE_RAD
    return np.where(large[:, None], whole, error)


def _between(estimate: Array, reference: Array) -> Array:
    """The rotation from reference to estimate in navigation axes, quaternions (m, 4), scalar first."""
    from scipy.spatial.transform import Rotation

    found = (
        Rotation.from_quat(estimate, scalar_first=True)
        * Rotation.from_quat(reference, scalar_first=True).inv()
    )
    return np.asarray(found.as_quat(scalar_first=True))


def _turn(w: Array, z: Array) -> Array:
    """The part of rotations about the vertical [rad], by the scalar and the vertical part of quaternions."""
    return np.asarray(2.0 * np.arctan2(z, w))


def _mean_angle(angle: Array) -> float:
    """The mean direction of angles [rad]."""
    return float(np.angle(np.mean(np.exp(1j * angle))))


def _turned(q: Array, angle: float) -> Array:
    """Attitudes, shape (m, 4), turned about the vertical by an angle [rad]."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.0, 0.0, angle])
    return np.asarray((turn * Rotation.from_quat(q, scalar_first=True)).as_quat(scalar_first=True))
