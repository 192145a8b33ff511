"""When something was there: a field on a magnetometer, a vibration on an accelerometer.

With blocks of samples and running sums, the least squares of the field in space ``m_n`` and of the vector
``h`` are solved for every pair of a first and a last block at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIN_VIBRATION_NOISE_RATIO = 5.0
"""How far the standard deviation of a vibration stands above that of the sensor's noise."""
COARSE_BLOCKS = 120
"""Blocks of the first look; the edges are then found again inside theirs."""
FINE_BLOCKS = 24
FIELD_WINDOW_S = 0.2
"""Length [s] of means that show whether a field is there, or not, or on its way."""
MIN_TRANSITION_SHARE = 0.25
"""Share of a field that such a mean is off while it is on its way."""
MIN_TRANSITION_MEDIANS = 2.5
"""Or so many medians of what such means are off elsewhere: one in a thousand of noise is."""
MAX_PAUSE_S = 1.0
"""Pauses [s] on the way that are bridged, distance from the sharp edge at which it is looked for."""


@dataclass(frozen=True)
class Span:
    """A span of time [s], the vector in it [U], and by how much the sum of squares falls [U^2].

    Within `edge` [s] at either end it is neither there nor gone; zero where it came at once.
    """

    start: float
    stop: float
    vector: tuple[float, float, float]
    gain: float
    edge: float = 0.0


@dataclass(frozen=True)
class _Sums:
    """Running sums over blocks: samples, what multiplies the other unknown, and readings, from zero on."""

    edges: NDArray[np.int64]
    count: Array
    cross: Array
    read: Array


def best_span(
    t: Array, m_b: Array, good: NDArray[np.bool_], R_bn: Array | None, in_body: bool
) -> Span | None:
    """The span in which a constant vector, in body or in space axes, lowers the sum of squares most.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    m_b : ndarray, shape (n, 3)
        Readings [U]; where `R_bn` is none, less their truth.
    good : ndarray of bool, shape (n,)
        Which count.
    R_bn : ndarray, shape (n, 3, 3), optional
        Navigation to body axes; the field in space is unknown beside the vector.
    in_body : bool
        Whether the vector turns with the body.
    """
    n = t.size
    if n < 4 * COARSE_BLOCKS:
        return None
    edges = np.unique(np.linspace(0, n, COARSE_BLOCKS + 1).astype(np.int64))
    found = _search(m_b, good, R_bn, in_body, edges, edges)
    if found is None:
        return None
    width = n // COARSE_BLOCKS + 1
    while width > 0:  # until neighbours of the grid are neighbours of the log
        near = [_about(e, width, n) for e in found[:2]]
        found = _search(m_b, good, R_bn, in_body, near[0], near[1]) or found
        width = (2 * width) // (FINE_BLOCKS - 1)
    start, stop, h, gain = found
    dt = float((t[-1] - t[0]) / (n - 1))
    start, stop, edge = _edges(
        start, stop, _off(m_b, good, R_bn, in_body, found), dt, float(np.linalg.norm(h))
    )
    vector = (float(h[0]), float(h[1]), float(h[2]))
    # A sharp edge is somewhere between two samples.
    first, last = (float(t[0] + (at - (0.0 if edge else 0.5)) * dt) for at in (start, stop))
    return Span(first, last, vector, gain, edge * dt)


def _about(at: int, width: int, n: int) -> NDArray[np.int64]:
    """Samples about one, evenly."""
    return np.unique(np.clip(np.linspace(at - width, at + width, FINE_BLOCKS).round(), 0, n).astype(np.int64))


def _off(
    m_b: Array,
    good: NDArray[np.bool_],
    R_bn: Array | None,
    in_body: bool,
    found: tuple[int, int, Array, float],
) -> Array:
    """What a field with sharp edges leaves of the readings, shape (n, 3), zero where they do not count."""
    start, stop, h, _ = found
    inside = np.zeros(len(m_b))
    inside[start:stop] = 1.0
    left = m_b - inside[:, None] * (h if in_body or R_bn is None else R_bn @ h)
    if R_bn is not None:
        left = left - R_bn @ (_turned(left, good, R_bn) / good.sum())
    return np.asarray(left * good[:, None])


def _edges(start: int, stop: int, off: Array, dt: float, size: float) -> tuple[int, int, int]:
    """The first and last+1 sample at which a field of a size begins to come and has gone, and the samples between."""
    from scipy.ndimage import binary_closing, label, uniform_filter1d

    n, window, near = len(off), max(1, round(FIELD_WINDOW_S / dt)), max(1, round(MAX_PAUSE_S / dt))
    d = np.linalg.norm(uniform_filter1d(off, window, axis=0), axis=1)
    noise = MIN_TRANSITION_MEDIANS * float(np.median(d))
    if MIN_TRANSITION_SHARE * size < 0.4 * noise:  # too small a field for its edges to be seen
        return start, stop, 0
    between = d > max(MIN_TRANSITION_SHARE * size, noise)
    marked, _ = label(binary_closing(np.pad(between, near), iterations=max(1, near // 2))[near:-near])
    ends = []
    for at in (start, stop):
        about = marked[max(at - near, 0) : at + near]
        found = np.flatnonzero(marked == about.max(initial=0)) if about.any() else np.zeros(0, dtype=np.intp)
        long = found.size > 3 * window and 0 < at < n
        ends.append((int(found[0]), int(found[-1]) + 1) if long else (at, at))
    edge = max(b - a for a, b in ends)
    if 2 * edge >= ends[1][1] - ends[0][0]:
        return start, stop, 0
    return ends[0][0], ends[1][1], edge


def _search(
    m_b: Array,
    good: NDArray[np.bool_],
    R_bn: Array | None,
    in_body: bool,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
) -> tuple[int, int, Array, float] | None:
    """The best pair of edges, its vector and gain."""
    sums = _sums(m_b, good, R_bn, in_body, np.unique(np.concatenate([[0], first, last, [len(m_b)]])))
    at, to = np.searchsorted(sums.edges, first), np.searchsorted(sums.edges, last)
    i, j = np.repeat(at, to.size), np.tile(to, at.size)
    whole = (sums.edges[j] - sums.edges[i]) > 0.9 * len(m_b)
    i, j = i[(j > i) & ~whole], j[(j > i) & ~whole]
    if not i.size:
        return None
    L = sums.count[j] - sums.count[i]
    C = sums.cross[j] - sums.cross[i]
    b = sums.read[j] - sums.read[i]
    J = L[:, None, None] * np.eye(3)
    if R_bn is not None:
        N = sums.count[-1]
        J = J - np.swapaxes(C, 1, 2) @ C / N
        b = b - np.einsum("kmi,m->ki", C, _turned(m_b, good, R_bn)) / N
    # What of the vector is a field that is there all the time, or falls on no sample, is left out of it.
    size, V = np.linalg.eigh(J)
    seen = size > 1e-3 * np.maximum(L, 1.0)[:, None]
    along = np.where(seen, np.einsum("kij,ki->kj", V, b) / np.where(seen, size, 1.0), 0.0)
    h = np.einsum("kij,kj->ki", V, along)
    gain = np.einsum("ki,ki->k", b, h)
    k = int(np.argmax(gain))
    return int(sums.edges[i[k]]), int(sums.edges[j[k]]), h[k], float(gain[k])


def _turned(m_b: Array, good: NDArray[np.bool_], R_bn: Array) -> Array:
    """Sum of the readings in space, shape (3,)."""
    return np.asarray(np.einsum("nbi,nb->i", R_bn[good], m_b[good]))


def _sums(
    m_b: Array, good: NDArray[np.bool_], R_bn: Array | None, in_body: bool, edges: NDArray[np.int64]
) -> _Sums:
    """Running sums at edges: ``cross`` multiplies ``h`` (columns) against ``m_n`` (rows)."""
    w = good.astype(np.float64)
    if R_bn is None:
        cross, read = np.zeros((len(m_b), 9)), m_b * w[:, None]
    elif in_body:
        cross = np.swapaxes(R_bn, 1, 2).reshape(-1, 9) * w[:, None]
        read = m_b * w[:, None]
    else:
        cross = np.eye(3).ravel() * w[:, None]
        read = np.einsum("nbi,nb->ni", R_bn, m_b) * w[:, None]
    total = [np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])[edges] for x in (cross, read)]
    count = np.concatenate([[0.0], np.cumsum(w)])[edges]
    return _Sums(edges, count, total[0].reshape(-1, 3, 3), total[1])


def vibrations(
    t: Array, f_b: Array, noise: float, corner: float, window: float = 1.0
) -> list[tuple[float, float]]:
    """Spans of time [s] of vibration: the high-frequency power of a specific force stands above the noise.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    f_b : ndarray, shape (n, 3)
        Specific force [m/s^2].
    noise : float
        Standard deviation [m/s^2] of the noise of all three axes together above `corner`.
    corner : float
        Frequency [Hz] above which there is no motion to speak of.
    window : float
        Length [s] over which power is averaged; shorter spans are left out, shorter pauses bridged.
    """
    from scipy.fft import dct, idct
    from scipy.ndimage import binary_closing, label, uniform_filter1d

    n, dt = t.size, float((t[-1] - t[0]) / (t.size - 1))
    X = dct(f_b, type=2, axis=0, norm="ortho")
    X[: int(2.0 * n * dt * corner)] = 0.0
    size = max(3, round(window / dt))
    power = uniform_filter1d((idct(X, type=2, axis=0, norm="ortho") ** 2).sum(axis=1), size)
    loud = binary_closing(
        np.pad(power > (MIN_VIBRATION_NOISE_RATIO * noise) ** 2, size), iterations=size // 2
    )[size:-size]
    marked, count = label(loud)
    spans = [np.flatnonzero(marked == k + 1) for k in range(count)]
    return [(float(t[at[0]]), float(t[at[-1]])) for at in spans if at.size >= size]
