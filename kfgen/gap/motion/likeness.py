"""Whether readings are of the motion that their reference says: the share of them that it explains at any lag.

Power is that of whitened ordinates, within the band in which the reference moves, without the mean; noise of the
assumed size has one for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.whitener import Whitener

Array = NDArray[np.float64]

MAX_UNEXPLAINED_AXIS_SHARE = 0.2
"""Share of a channel's power that may be no motion of the triad where its axes are looked at."""
MAX_UNEXPLAINED_SHARE = 0.5
"""Share of the power beside the noise that may be no motion of the reference."""
MIN_MOTION_POWER_RATIO = 4.0
"""Power over that of the noise from which on there is motion at all."""
MIN_REFERENCE_POWER_SHARE = 0.01
"""Share of the reference's power below which a sensor does not move."""
BAND_POWER_SHARE = 0.99
"""Share of the reference's power within its band."""
MAX_LAG_FRACTION_OF_RECORD = 0.25
"""The longest lag, in lengths of the log."""


@dataclass(frozen=True)
class Likeness:
    """Powers of a triad's readings and of what is left of them.

    Parameters
    ----------
    total, truth, noise : float
        Of the readings, of the reference, of the assumed noise.
    left : float
        Of what no lagged combination of the reference's axes explains.
    off : float
        Of what differs from the reference as it is.
    """

    total: float
    truth: float
    noise: float
    left: float
    off: float

    @property
    def alike(self) -> bool:
        """Whether it may be the same motion."""
        if max(self.total, self.truth) < MIN_MOTION_POWER_RATIO * self.noise:
            return True
        if self.total < MIN_MOTION_POWER_RATIO * self.noise:
            return (
                self.total > MIN_REFERENCE_POWER_SHARE * self.truth
                or self.left < MAX_UNEXPLAINED_SHARE * self.total
            )
        return self.left - self.noise < MAX_UNEXPLAINED_SHARE * (self.total - self.noise)

    @property
    def error(self) -> float:
        """Share of the power that differs from the reference as it is."""
        return self.off / max(self.total, 1e-300)

    @property
    def correlation(self) -> float:
        """Of the readings and the best combination."""
        return float(np.sqrt(max(0.0, 1.0 - self.left / max(self.total, 1e-300))))


def likeness(read: Sequence[tuple[Whitener, Array, Array, int, int]]) -> Likeness:
    """Readings of a triad against its reference.

    Parameters
    ----------
    read : sequence of (Whitener, ndarray of shape (n,), ndarray of shape (n, 3), int, int)
        Of each channel: its noise, readings about their mean, zero where they do not count; what the triad should
        have read, treated alike; its axis; ordinates that count.
    """
    total = left = off = truth = noise = 0.0
    pairs = []
    for white, y, X, axis, keep in read:
        top = min(keep, _band(X))
        z, A = (white.ordinates(x) for x in (y, X))
        for x in (z, A):
            x[0] = 0.0
            x[top:] = 0.0
        rest = z - A @ np.linalg.lstsq(A[:top], z[:top], rcond=1e-6)[0]
        total, left = total + float(z @ z), left + float(rest @ rest)
        truth, noise = truth + float((A**2).sum()) / len(read), noise + top
        off += float(np.sum((z - A[:, axis]) ** 2))
        pairs.append((z, A))
    found = Likeness(total, truth, noise, left, off)
    return found if found.alike else replace(found, left=min(left, total - _lagged(pairs)))


def _band(X: Array) -> int:
    """Ordinates that hold most of the power of every column that has any."""
    from scipy.fft import dct

    power = np.cumsum(dct(X, type=2, axis=0, norm="ortho")[1:] ** 2, axis=0)
    return int(max(np.searchsorted(p, BAND_POWER_SHARE * p[-1]) for p in power.T)) + 2


def _lagged(pairs: Sequence[tuple[Array, Array]]) -> float:
    """Power that combinations explain at the lag, common to all, at which that is most."""
    from scipy.fft import irfft, next_fast_len, rfft

    n = pairs[0][0].size
    size, reach = next_fast_len(2 * n, real=True), int(MAX_LAG_FRACTION_OF_RECORD * n)
    explained = np.zeros(2 * reach + 1)
    for z, A in pairs:
        y, x = Whitener.back(z), Whitener.back(A)
        b = irfft(rfft(y, size)[:, None] * np.conj(rfft(x, size, axis=0)), size, axis=0)
        b = np.concatenate([b[-reach:], b[: reach + 1]]) if reach else b[:1]
        explained += np.einsum("ki,ij,kj->k", b, np.linalg.pinv(x.T @ x, rcond=1e-9, hermitian=True), b)
    return float(explained.max())


def combination(X: Array, y: Array) -> Array:
    """Coefficients of the columns of `X`, shape (n, 3), of which `y` consists; zeros where it does not.

    Parameters
    ----------
    X : ndarray, shape (n, k)
        Columns.
    y : ndarray, shape (n,)
    """
    row = np.linalg.lstsq(np.nan_to_num(X), y, rcond=1e-6)[0]
    left = y - np.nan_to_num(X) @ row
    return np.asarray(row if left @ left < MAX_UNEXPLAINED_AXIS_SHARE * float(y @ y) else np.zeros(3))
