"""The band of two standard deviations that innovations and residuals should keep to: how many leave it, and when."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BAND_SIGMAS = 2.0
CHANCE_OUTSIDE_PERCENT = 4.6
"""Of normal samples, outside of that band."""
SHARE_PARTS = 40
"""Of a series, in each of which samples outside of the band are counted."""
MAX_OUTSIDE_SHARE = 0.25
"""Of a part, above which its time is said."""
MAX_WINDOWS = 3
MIN_PART_SAMPLES = 24
"""Of a part: seven of them are outside by chance once in ten thousand parts."""


def outside_share(x: Array) -> float:
    """The share of samples, in standard deviations, outside of their band.

    Parameters
    ----------
    x : ndarray, shape (n,)
    """
    return float(np.mean(np.abs(x) > BAND_SIGMAS))


def windows_outside(x: Array, t: Array) -> list[tuple[float, float]]:
    """When most samples leave their band: the longest spans, in the order of time.

    Parameters
    ----------
    x : ndarray, shape (n,)
        In standard deviations.
    t : ndarray, shape (n,)
        Their times [s].

    Returns
    -------
    list of (float, float)
        First and last time [s].
    """
    outside = np.abs(x) > BAND_SIGMAS
    parts = min(SHARE_PARTS, max(1, x.size // MIN_PART_SAMPLES))
    edges = np.linspace(0, x.size, parts + 1).astype(np.int64)
    shares = np.array([outside[a:b].mean() for a, b in pairwise(edges.tolist())])
    changes = np.diff(np.concatenate([[False], shares > MAX_OUTSIDE_SHARE, [False]]))
    spans = [(int(a), int(b)) for a, b in np.flatnonzero(changes).reshape(-1, 2)]
    longest = sorted(spans, key=lambda w: w[0] - w[1])[:MAX_WINDOWS]
    return [(float(t[edges[a]]), float(t[min(edges[b], x.size - 1)])) for a, b in sorted(longest)]


def outside_words(what: str, x: Array, t: Array) -> str:
    """How many samples of white noise lie outside of their band, and when most of them do.

    Parameters
    ----------
    what : str
        Whose they are.
    x : ndarray, shape (n,)
        In standard deviations.
    t : ndarray, shape (n,)
        Their times [s].
    """
    share = 100.0 * outside_share(x)
    said = f"{what}: {share:.1f} % outside of {BAND_SIGMAS:g} ({CHANCE_OUTSIDE_PERCENT:g} % by chance)"
    windows = [f"{a:.0f} to {b:.0f} s" for a, b in windows_outside(x, t)]
    return f"{said}, mostly from {' and '.join(windows)}." if windows else f"{said}."
