"""Where a vehicle was and how it was turned: what a run estimates, what a reference and a receiver say, in level axes."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.log.log import Log
from kfgen.manoeuvre.truth import level_at
from kfgen.model.filter import FilterModel
from kfgen.model.plant.equations import Equations
from kfgen.model.symbols.blocks import Attitude
from kfgen.run.against_reference import REFERENCE

Array = NDArray[np.float64]

RECEIVER = "gnss_"
"""Before the name of a stored position: what a receiver says of it."""


@dataclass(frozen=True)
class Track:
    """A motion over time, in axes that are level at the start; not numbers where nothing is known.

    Parameters
    ----------
    label : str
        Who says it.
    t : ndarray, shape (n,)
        Times [s].
    position : ndarray, shape (n, 3), optional
        North, east and height [m]; in Earth axes less the first estimate.
    attitude : ndarray, shape (n, 3), optional
        Roll, pitch and heading [rad].
    """

    label: str
    t: Array
    position: Array | None = None
    attitude: Array | None = None


@dataclass(frozen=True)
class LevelAxes:
    """The axes that are level where a run begins.

    Parameters
    ----------
    R_ln : ndarray, shape (3, 3)
        Navigation axes to north, east, down.
    origin : ndarray, shape (3,)
        Position [m] that is left out.
    """

    R_ln: Array
    origin: Array

    @staticmethod
    def of(
        model: FilterModel, names: tuple[str, ...], first: Array, constants: dict[str, float]
    ) -> LevelAxes:
        """Of a model at its first estimate.

        Parameters
        ----------
        model : FilterModel
        names : tuple of str
            Of the stored state.
        first : ndarray, shape (stored,)
            The estimate [SI].
        constants : dict of str to float
            Of the model [SI].
        """
        if not np.isfinite(first).all():
            return LevelAxes(np.eye(3), np.zeros(3))
        start = dict(zip(names, first.tolist()))
        is_level = model.attitude is None or model.attitude.frame == Attitude.frame
        origin = np.zeros(3) if is_level else np.array([start.get(n, 0.0) for n in position_names(model)])
        return LevelAxes(level_at(model, constants | start), origin)

    def position(self, p: Array) -> Array:
        """Positions in navigation axes, shape (n, 3), as north, east and height [m]."""
        return np.asarray((p - self.origin) @ self.R_ln.T * [1.0, 1.0, -1.0])

    def attitude(self, q: Array) -> Array:
        """Attitudes, quaternions (n, 4), as roll, pitch and heading [rad]."""
        from scipy.spatial.transform import Rotation

        out = np.full((len(q), 3), np.nan)
        good = np.isfinite(q).all(axis=1) & (np.abs(q).max(axis=1) > 0.0)
        if good.any():
            turned = Rotation.from_matrix(self.R_ln) * Rotation.from_quat(q[good], scalar_first=True)
            with warnings.catch_warnings():  # straight up roll and heading are one: any of both will do
                warnings.simplefilter("ignore", UserWarning)
                out[good] = turned.as_euler("ZYX")[:, ::-1]
        return out


def position_names(model: FilterModel) -> tuple[str, ...]:
    """Names of the stored position, empty where the model has none."""
    if isinstance(model.motion, Equations):
        return ()
    return next((b.nominal_names for b in model.blocks if b.name == "p" and len(b.nominal_names) == 3), ())


def track(
    label: str, axes: LevelAxes, model: FilterModel, names: tuple[str, ...], t: Array, estimate: Array
) -> Track:
    """What estimates say of a motion.

    Parameters
    ----------
    label : str
        Who says it.
    axes : LevelAxes
    model : FilterModel
    names : tuple of str
        Of the stored state.
    t : ndarray, shape (n,)
        Times [s].
    estimate : ndarray, shape (n, stored)
        Stored states [SI], not numbers where nothing is known.
    """
    at = [names.index(n) for n in position_names(model)]
    q = [names.index(n) for n in model.attitude.nominal_names] if model.attitude is not None else []
    return Track(
        label,
        t,
        axes.position(estimate[:, at]) if at and np.isfinite(estimate[:, at]).any() else None,
        axes.attitude(estimate[:, q]) if q and np.isfinite(estimate[:, q]).any() else None,
    )


def logged_tracks(axes: LevelAxes, model: FilterModel, names: tuple[str, ...], log: Log) -> list[Track]:
    """What a log says of the motion: its reference, and the positions of its receiver.

    Parameters
    ----------
    axes : LevelAxes
    model : FilterModel
    names : tuple of str
        Of the stored state.
    log : Log
    """
    out = []
    for label, before, wanted in (
        ("reference", REFERENCE, names),
        ("GNSS", RECEIVER, position_names(model)),
    ):
        logged = np.full((log.n, len(names)), np.nan)
        for k, name in enumerate(names):
            if name in wanted and before + name in log.channels:
                logged[:, k] = log.channels[before + name].values
        there = np.isfinite(logged).any(axis=1)
        said = track(label, axes, model, names, log.t[there], logged[there])
        if said.position is not None or said.attitude is not None:
            out.append(said)
    return out
