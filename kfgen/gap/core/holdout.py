"""Does the gap shrink on data that the fit did not see.

On a held-out stretch the parameters are frozen. In each band of ``m`` ordinates the mean ratio
``r`` of power to expectation is one where the model holds; what the model loses against one that
has the band's own level is ``m/2 (r - 1 - ln r)`` nats, of which half a nat is chance. The sum per
sample is the gap, its floor zero. The stretch suits the effect. Noise, which has no time of its own, is
judged on every third of the record by a fit to the other two: all samples testify, and chance moves the
share that closed least. Ramps and lines are judged on the tail; every other block serves for what happens
once or is over before the tail, the extreme third of its driver for what is driven. There the
coefficients are fitted to the rest, and the bands are those of the white series in each held-out block: that
of the assumed model as it is written, and that of the updated one.

References
----------
.. [1] S. Kullback, Information Theory and Statistics, 1959, ch. 9 (divergence of variances).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.gap.core.battery import bands
from kfgen.gap.core.whitener import Whitener
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import residual_ratio
from kfgen.identify.fit.fit import Fit, Problem, maximise

Array = NDArray[np.float64]

HELD_OUT_SHARE = 0.3
"""Share of the record, at its end, that no fit sees."""
FOLDS = 3
"""Parts of a record, each of which is predicted from the others where no shape ties it to its time."""
MIN_TAIL_POWER_SHARE = 0.01
"""Share of a shape's power in the tail below which the tail cannot show it."""
MIN_SEEN_SHARE = 0.02
"""Of the power of a course of shapes in the part to which they are fitted, below which that part does not tell its size."""
BLOCKS = 32
"""Into which a record is cut to leave out every other one."""
INTERVAL_DRAWS = 2000
METRIC = "held-out log-likelihood per sample above the noise floor"


@dataclass(frozen=True)
class Gap:
    """The gap on held-out data [nats per sample] before and after, and the share that closed.

    Parameters
    ----------
    held_out : str
        What was held out, in words.
    """

    before: float
    after: float
    closed: float
    ci95: tuple[float, float]
    held_out: str = ""


def held_out_gap(raw: Record, clean: Record, written: Sequence[Effect], updated: Problem) -> Gap:
    """Compare the assumed and the updated model on data that the compared fits did not see.

    Parameters
    ----------
    raw, clean : Record
        As it was logged (less trusted terms), and without what alters samples.
    written : sequence of Effect
        The assumed random effects, as they are written.
    updated : Problem
        The updated model on the clean record.
    """
    shapes = [e for e in updated.effects if e.coefficients()]
    blocked = [e for e in shapes if e.driver or (e.repeatable and not is_line(e)) or _is_over(e, clean)]
    if blocked:
        return _masked(raw, clean, written, updated, blocked)
    if not shapes:
        return _folded(raw, clean, written, updated)
    return _tail(raw, clean, written, updated)


def _is_over(effect: Effect, record: Record) -> bool:
    """Whether next to nothing of a shape is left in the tail: an exponential that has died."""
    power = np.sum(np.square(record.regressors(effect)), axis=0)
    tail = int(record.n * (1.0 - HELD_OUT_SHARE))
    return bool(np.sum(power[tail:]) < MIN_TAIL_POWER_SHARE * np.sum(power))


def is_line(effect: Effect | type[Effect]) -> bool:
    """Whether its amplitude and phase are two coefficients."""
    return len(effect.coefficients()) > 1


def _tail(raw: Record, clean: Record, written: Sequence[Effect], updated: Problem) -> Gap:
    k = int(raw.n * (1.0 - HELD_OUT_SHARE))
    r0, r1, m = judged(raw.cut(k, raw.n), clean.cut(k, raw.n), (clean.cut(0, k),), written, updated)
    return divergence(r0, r1, m, "the last 30 % of the record")


def _folded(raw: Record, clean: Record, written: Sequence[Effect], updated: Problem) -> Gap:
    """Each part of equal length by a fit to the others; the powers of all parts are averaged in each band."""
    size, parts = raw.n // FOLDS, []
    cuts = [(k * size, (k + 1) * size) for k in range(FOLDS)]
    for left_out in cuts:
        rest = tuple(clean.cut(*cut) for cut in cuts if cut != left_out)
        parts.append(judged(raw.cut(*left_out), clean.cut(*left_out), rest, written, updated))
    r0, r1 = (np.mean([part[i] for part in parts], axis=0) for i in (0, 1))
    return divergence(r0, r1, FOLDS * parts[0][2], "every third of the record, by a fit to the other two")


def judged(
    raw: Record, clean: Record, rest: tuple[Record, ...], written: Sequence[Effect], updated: Problem
) -> tuple[Array, Array, Array]:
    """Power over expectation on what is left out, assumed and updated, the latter fitted to the rest.

    Parameters
    ----------
    raw, clean : Record
        What is left out, as it was logged and without what changes samples.
    rest : tuple of Record
        To which the updated model is fitted.
    written : sequence of Effect
        The assumed random effects.
    updated : Problem
        The updated model.

    Returns
    -------
    tuple of ndarray, shape (bands,)
        Mean ratios before and after, and how many ordinates each has.
    """
    after = maximise(replace(updated, record=rest[0] if len(rest) == 1 else JointRecord(rest)))
    r0, m = ratios(raw, written, np.zeros(0))
    r1, _ = ratios(clean, after.effects, after.likelihood.coefficients)
    return r0, r1, m


def divergence(r0: Array, r1: Array, m: Array, held_out: str) -> Gap:
    """The gap from ratios of power before and after in bands of m ordinates; the interval from draws of their chance.

    Parameters
    ----------
    r0, r1 : ndarray, shape (bands,)
        Power over expectation, before and after.
    m : ndarray, shape (bands,)
        Degrees of freedom.
    held_out : str
        What was held out, in words.
    """
    chance = np.random.default_rng(0).chisquare(m, (INTERVAL_DRAWS, m.size)) / m
    lost0, lost1, n = float(lost(r0, m)), float(lost(r1, m)), float(m.sum())
    draws0 = lost(r0 * chance, m) - 0.5 * m.size
    draws1 = np.maximum(lost(r1 * chance, m) - 0.5 * m.size, 0.0)
    closed = 1.0 - max(lost1, 0.0) / lost0 if lost0 > 0.0 else 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(draws0 > 0.0, 1.0 - draws1 / draws0, 0.0)
    lo, hi = np.clip(np.quantile(shares, [0.025, 0.975]), -1.0, 1.0).tolist()
    closed = max(closed, -1.0)
    return Gap(lost0 / n, lost1 / n, closed, (min(lo, closed), max(hi, closed)), held_out)


def _masked(
    raw: Record, clean: Record, written: Sequence[Effect], updated: Problem, blocked: Sequence[Effect]
) -> Gap:
    """Shapes fitted to one part of the series that the updated noise makes white, and judged on the other."""
    fit: Fit = maximise(updated)
    others = [e for e in fit.effects if e.coefficients() and e.name not in {b.name for b in blocked}]
    shapes = [e for e in fit.effects if e.coefficients() and e not in others]
    whitener = Whitener.on(clean, fit.effects)
    z = whitener.series(clean.y - clean.drift(others))
    B = np.column_stack([whitener.series(x) for e in shapes for x in clean.regressors(e)])
    unseen, words = _unseen(clean, shapes)
    r0, m = _block_ratios(Whitener.on(raw, written).series(raw.y), unseen)
    r1, _ = _block_ratios(z - _predicted(z, B, ~unseen), unseen)
    return divergence(r0, r1, m, words)


def _predicted(z: Array, B: Array, seen: NDArray[np.bool_]) -> Array:
    """A series from shapes that are fitted to a part of it.

    Of the independent courses that the shapes can take together those are zero of which that part holds next to nothing:
    two steps inside one block that is left out are one there, and what they differ by could be anything.
    """
    U, s, _ = np.linalg.svd(B / np.maximum(np.linalg.norm(B, axis=0), 1e-300), full_matrices=False)
    U = U[:, s > 1e-9 * s.max(initial=0.0)]
    share, V = np.linalg.eigh(U[seen].T @ U[seen])
    known = share > MIN_SEEN_SHARE
    course = U @ V[:, known]
    return np.asarray(course @ (course[seen].T @ z[seen] / share[known]))


def _unseen(record: Record, shapes: Sequence[Effect]) -> tuple[NDArray[np.bool_], str]:
    """Which samples are held out, in whole blocks: the driver's extreme third, else every other block."""
    drivers = {e.driver for e in shapes}
    block = np.minimum(np.arange(record.n) // (record.n // BLOCKS), BLOCKS - 1)
    if len(drivers) == 1 and (name := next(iter(drivers))):
        level = np.bincount(block, record.drive[name]) / np.bincount(block)
        hot = level >= np.quantile(level, 2.0 / 3.0)
        return hot[block], f"the third of the record where {name} is highest"
    return block % 2 == 1, "every other block of the record"


def _block_ratios(z: Array, unseen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Mean power of a white series in bands, over the held-out blocks, and how many ordinates each has."""
    from scipy.fft import dct

    size = z.size // BLOCKS
    parts = [z[k * size : (k + 1) * size] for k in range(BLOCKS) if unseen[k * size + size // 2]]
    power = np.mean([dct(part, type=2, norm="ortho") ** 2 for part in parts], axis=0)
    edges = np.unique(np.concatenate([[0, 1], np.geomspace(2, size, 12)]).astype(np.int64))
    m = np.diff(edges) * float(len(parts))
    return np.add.reduceat(power, edges[:-1]) / np.diff(edges), m


def ratios(tail: Record, effects: Sequence[Effect], coefficients: Array) -> tuple[Array, Array]:
    """Mean power of a record over what is expected in bands, and how many ordinates each has.

    Parameters
    ----------
    tail : Record
    effects : sequence of Effect
    coefficients : ndarray, shape (k,)
        Of the deterministic ones [SI].
    """
    data = tail.ordinates(effects)
    ratio = residual_ratio(data, effects, coefficients)
    parts = [
        (float(data.count[lo:hi].sum()), float(data.count[lo:hi] @ ratio[lo:hi])) for lo, hi in bands(data)
    ]
    m = np.array([p[0] for p in parts])
    return np.array([p[1] for p in parts]) / m, m


def lost(r: Array, m: Array) -> Array:
    """Nats lost against each band's own level, less what chance loses, shape (...,) of ratios (..., bands).

    Parameters
    ----------
    r : ndarray, shape (..., bands)
        Power over expectation.
    m : ndarray, shape (bands,)
        Degrees of freedom.
    """
    return np.asarray((0.5 * m * (r - 1.0 - np.log(r)) - 0.5).sum(axis=-1))
