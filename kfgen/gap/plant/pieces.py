"""Where a record is cut for its plant to be followed: into pieces with a start each, or not at all.

A window grows from the first sample by doubling. It ends where the model, its parameters as far from what is assumed
as that allows, no longer follows the data, or where the initial state would have to be known too well; there the next
segment begins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.core.time_budget import fit_is_over
from kfgen.gap.plant.shooting import MAX_SEGMENTS, MIN_FIRST_WINDOW_SAMPLES, Shooting

Array = NDArray[np.float64]

MAX_WHOLE_FITS = 3
"""Fits of a whole record, from the best of the parameters that were drawn."""
MIN_ALIKE_CORRELATION = 0.8
"""Correlation of channels with their simulation moved in time from which on they look like it."""


def lateness(data: Mapping[str, tuple[NDArray[np.intp], Array]], simulated: Mapping[str, Array]) -> int:
    """Samples by which channels follow their simulation, each of shape (n,); zero where they do not look like it.

    It is where their correlation is largest; negative where the simulation comes after them.

    Parameters
    ----------
    data, simulated : ndarray, shape (n,)
        The same channel.
    """
    n = next(iter(simulated.values())).size
    total = np.zeros(2 * n)
    for name, (at, values) in data.items():
        y, h = np.zeros(n), np.zeros(n)
        y[at], h[at] = values - values.mean(), simulated[name][at] - simulated[name][at].mean()
        size = float(np.linalg.norm(y) * np.linalg.norm(h))
        if not 0.0 < size < np.inf:
            return 0
        total += np.fft.irfft(np.fft.rfft(y, 2 * n) * np.conj(np.fft.rfft(h, 2 * n)), 2 * n) / size
    best = int(np.argmax(total))
    if total[best] < MIN_ALIKE_CORRELATION * len(data):
        return 0
    return best if best < n else best - 2 * n


def segments(shooting: Shooting, anew: Sequence[int] = ()) -> tuple[tuple[int, ...], Array, Array]:
    """Where segments start, their initial states, shape (segments, states), and the untrusted parameters.

    Parameters
    ----------
    shooting : Shooting
    anew : sequence of int
        Samples at which a segment starts whether the model follows or not.

    Raises
    ------
    InputError
        The model cannot be simulated even over a segment.
    """
    n, k = shooting.t.size, shooting.states
    if k == 0:
        shooting.check(shooting.trusted, 0, n)
        return (0,), np.zeros((1, 0)), shooting.trusted
    least = min(n, shortest(n))
    starts, initial, a = [0], [], 0
    before: Array | None = None
    while True:
        stop = min((c for c in anew if c > a), default=n)
        x0, b = _segment(shooting, (a, stop), least, before)
        shooting.check(x0, a, b)
        initial.append(x0)
        if b == n:
            edges = (*starts, n)
            agreed, parameters = _agreed(shooting, edges, np.array(initial))
            for x0, a, b in zip(agreed, edges[:-1], edges[1:]):
                shooting.check(np.concatenate([x0, parameters]), a, b)
            return tuple(starts), agreed, parameters
        before = shooting.last(x0, a, b + 1) if b < stop else None
        starts.append(b)
        a = b


def in_one_piece(shooting: Shooting, anew: Sequence[int] = ()) -> tuple[Array, Array] | None:
    """What is fitted to a whole record where one simulation follows it from one place where it starts anew to the next.

    Where it starts from decides whether a fit over many turns of a plant ends where it should, so it starts from the best
    of many parameters within what is assumed of them.

    Parameters
    ----------
    shooting : Shooting
    anew : sequence of int
        Samples at which it does.

    Returns
    -------
    (ndarray, ndarray) or None
        Initial states, shape (1 + samples, states), and the untrusted parameters; None where none follows.
    """
    edges = (0, *anew, shooting.t.size)
    found = [_whole(shooting, a, b) for a, b in pairwise(edges)]
    followed = [x0 for x0 in found if x0 is not None]
    return _agreed(shooting, edges, np.array(followed)) if len(followed) == len(found) else None


def _whole(shooting: Shooting, a: int, b: int) -> Array | None:
    """What is fitted over samples a to b where one simulation follows them; None where none does."""
    first = np.concatenate([shooting.guess(a, min(b - a, MIN_FIRST_WINDOW_SAMPLES)), shooting.trusted])
    tried = np.column_stack([first, shooting.drawn(first)])
    for best in np.argsort(shooting.cost(tried, a, b))[:MAX_WHOLE_FITS].tolist():
        x0 = shooting.fit(tried[:, best], a, b)
        if shooting.follows_whole(x0, a, b):
            return x0
        if fit_is_over():
            break
    return None


def shortest(n: int) -> int:
    """Samples of the shortest segment of a record of n."""
    return max(MIN_FIRST_WINDOW_SAMPLES, -(-n // MAX_SEGMENTS))


def _agreed(shooting: Shooting, edges: tuple[int, ...], found: Array) -> tuple[Array, Array]:
    """Initial states of all segments under the parameters of the longest one, and those."""
    k = shooting.states
    parameters = found[int(np.argmax(np.diff(edges))), k:]
    initial = []
    for x0, a, b in zip(found, edges[:-1], edges[1:]):
        guesses = np.array([x0[:k], shooting.guess(a, min(b - a, MIN_FIRST_WINDOW_SAMPLES))])
        tried = np.column_stack([guesses, np.tile(parameters, (2, 1))]).T
        initial.append(guesses[int(np.argmin(shooting.cost(tried, a, b)))])
    return np.array(initial), parameters


def _segment(
    shooting: Shooting, between: tuple[int, int], least: int, before: Array | None
) -> tuple[Array, int]:
    """What is fitted at the first of two samples, and the sample up to which it is followed; at least so many."""
    a, n = between
    window = min(n - a, max(MIN_FIRST_WINDOW_SAMPLES, least // 4))
    guesses = [np.concatenate([shooting.guess(a, window), shooting.trusted])]
    if before is not None and np.isfinite(before).all():
        guesses += [np.concatenate([guesses[0][: shooting.states], before[shooting.states :]]), before]
    costs = shooting.cost(np.array(guesses).T, a, a + window)
    x0 = shooting.fit(guesses[int(np.argmin(costs))], a, a + window)
    while a + window < n:
        longer = min(n - a, 2 * window)
        tried = shooting.fit(x0, a, a + longer)
        if longer > least and not shooting.follows(tried, a, a + longer):
            break
        x0, window = tried, longer
    if a + window == n or n - a < 2 * least:
        return x0, n
    return x0, min(a + max(window, least), n - least)
