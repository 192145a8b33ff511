"""`Rows`: the scalar readings of all aiding sensors in the order of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.flight_log import AidingSamples, FlightLog

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """Scalar readings of all aiding sensors in the order of time.

    Parameters
    ----------
    at : ndarray of int, shape (rows,)
        The grid's time at which each is used.
    t, z, R : ndarray, shape (rows,)
        Its own time [s], value [SI] and variance.
    index : ndarray of int, shape (rows,)
        Row of all sensors' readings one after the other.
    channels : tuple of str
        Names of those rows.
    """

    at: NDArray[np.int64]
    t: Array
    z: Array
    R: Array
    index: NDArray[np.int64]
    channels: tuple[str, ...]

    def of(self, channel: str) -> NDArray[np.intp]:
        """Where the readings of a channel are."""
        return np.flatnonzero(self.index == self.channels.index(channel))


def rows_of(log: FlightLog) -> Rows:
    """The scalar readings of a log."""
    names = tuple(c for a in log.aiding for c in a.sensor.channels)
    at = np.concatenate([np.repeat(a.at, a.z.shape[1]) for a in log.aiding]).astype(np.int64)
    t = np.concatenate([np.repeat(a.t, a.z.shape[1]) for a in log.aiding])
    z = np.concatenate([a.z.ravel() for a in log.aiding])
    R = np.concatenate([np.outer(a.noise**2, _variances(log, a)).ravel() for a in log.aiding])
    first = np.cumsum([0, *(a.z.shape[1] for a in log.aiding)])
    index = np.concatenate(
        [np.tile(np.arange(a.z.shape[1]) + k, a.t.size) for a, k in zip(log.aiding, first)]
    )
    order = np.lexsort((index, t, at))
    return Rows(at[order], t[order], z[order], R[order], index[order].astype(np.int64), names)


def _variances(log: FlightLog, aiding: AidingSamples) -> Array:
    """Of the white noise of a sensor's rows, without what the filter adds for what its model leaves out."""
    return np.array([log.discrete.sample_variance(aiding.sensor, c) for c in aiding.sensor.channels])
