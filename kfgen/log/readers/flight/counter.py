"""How often something happens by a counter in a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.log.readers.tables.streams import LogStream
from kfgen.log.readers.tables.table import TableColumn

Array = NDArray[np.float64]


def rate_of_counter(name: str, t: Array, count: Array, channel: str) -> LogStream | None:
    """How often a second a counter counts, at the middle between its samples; None where it never does.

    Parameters
    ----------
    name : str
        Of the stream.
    t : ndarray, shape (n,)
        [s].
    count : ndarray, shape (n,)
        One that falls back began anew.
    channel : str

    Returns
    -------
    LogStream or None
        With one channel [1/s].
    """
    dt, more = np.diff(t), np.diff(count)
    good = (dt > 0.0) & (more >= 0.0)
    if not (more[good] > 0.0).any():
        return None
    middle = 0.5 * (t[1:] + t[:-1])[good]
    return LogStream(name, middle, {channel: TableColumn(more[good] / dt[good], "1/s")})
