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

Outliers, bursts and whatever else changes samples need not change a spectrum. Where one is added, the white samples
are counted in classes of their size as well: counts c where a normal law expects e lose ``c ln(c / e) - c + e`` nats.

References
----------
.. [1] S. Kullback, Information Theory and Statistics, 1959, ch. 9 (divergence of variances).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

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
CLASSES_BEYOND = np.array(
    [0.8, 0.6, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-12]
)
"""Share of normal samples beyond the end of each class of sizes but the last."""
MIN_SURE_LOSS_NATS = 10.0
"""Of an updated model on all that was held out, below which it may be chance."""
INTERVAL_DRAWS = 2000
METRIC = "held-out log-likelihood per sample above the noise floor"


@dataclass(frozen=True)
class Gap:
    """The gap on held-out data [nats per sample] before and after, and the share that closed.

    Parameters
    ----------
    held_out : str
        What was held out, in words.
    samples : float
        That were held out.
    """

    before: float
    after: float
    closed: float
    ci95: tuple[float, float]
    held_out: str = ""
    samples: float = 0.0

    @property
    def surely_grows(self) -> bool:
        """Whether the updated model is worse than the assumed one beyond chance."""
        return self.lost_nats > MIN_SURE_LOSS_NATS and self.ci95[1] <= 0.0

    @property
    def lost_nats(self) -> float:
        """By which the mismatch of all that was held out grows."""
        return (self.after - self.before) * self.samples


@dataclass(frozen=True)
class HeldOut:
    """What was held out under the assumed and under the updated model.

    Parameters
    ----------
    before, after : ndarray, shape (bands,)
        Power over expectation in bands.
    m : ndarray, shape (bands,)
        Degrees of freedom.
    sizes_before, sizes_after : ndarray, shape (classes,), optional
        Counts of white samples by their size, where an effect that changes samples is added.
    """

    before: Array
    after: Array
    m: Array
    sizes_before: Array = field(default_factory=lambda: np.zeros(0))
    sizes_after: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def expected(self) -> Array:
        """Counts of a normal law, shape (classes,)."""
        return _expected_sizes(self.sizes_before)

    def lost(self, r: Array, counts: Array) -> Array:
        """Nats lost in all, what chance loses included, shape (...,) of ratios (..., bands) and counts (..., classes)."""
        return lost(r, self.m) + 0.5 * self.m.size + _lost_by_size(counts, self.expected)


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


def _is_altered(raw: Record, clean: Record) -> bool:
    """Whether an effect changes samples: the record without it is another one."""
    return not np.array_equal(raw.y, clean.y)


def _tail(raw: Record, clean: Record, written: Sequence[Effect], updated: Problem) -> Gap:
    k = int(raw.n * (1.0 - HELD_OUT_SHARE))
    parts = raw.cut(k, raw.n), clean.cut(k, raw.n), (clean.cut(0, k),)
    held = judged(*parts, written, updated, altered=_is_altered(raw, clean))
    return divergence(held, "the last 30 % of the record")


def _folded(raw: Record, clean: Record, written: Sequence[Effect], updated: Problem) -> Gap:
    """Each part of equal length by a fit to the others; the powers of all parts are averaged in each band."""
    size, parts = raw.n // FOLDS, []
    cuts = [(k * size, (k + 1) * size) for k in range(FOLDS)]
    for left_out in cuts:
        rest = tuple(clean.cut(*cut) for cut in cuts if cut != left_out)
        part = raw.cut(*left_out), clean.cut(*left_out), rest
        parts.append(judged(*part, written, updated, altered=_is_altered(raw, clean)))
    whole = HeldOut(
        np.mean([part.before for part in parts], axis=0),
        np.mean([part.after for part in parts], axis=0),
        FOLDS * parts[0].m,
        np.sum([part.sizes_before for part in parts], axis=0),
        np.sum([part.sizes_after for part in parts], axis=0),
    )
    return divergence(whole, "every third of the record, by a fit to the other two")


def judged(
    raw: Record,
    clean: Record,
    rest: tuple[Record, ...],
    written: Sequence[Effect],
    updated: Problem,
    *,
    altered: bool = False,
) -> HeldOut:
    """What is left out under the assumed model and under the updated one, the latter fitted to the rest.

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
    altered : bool
        Whether it has an effect that changes samples.
    """
    after = maximise(replace(updated, record=rest[0] if len(rest) == 1 else JointRecord(rest)))
    r0, m = ratios(raw, written, np.zeros(0))
    r1, _ = ratios(clean, after.effects, after.likelihood.coefficients)
    if not altered:
        return HeldOut(r0, r1, m)
    shapes = [e for e in after.effects if e.coefficients()]
    first, last = Whitener.on(raw, written), Whitener.on(clean, after.effects)
    c0 = _sizes(first, first.series(raw.y))
    return HeldOut(r0, r1, m, c0, _sizes(last, last.series(clean.y - clean.drift(shapes))))


def _sizes(whitener: Whitener, z: Array) -> Array:
    """How many white samples are in each class of sizes, shape (classes,); what a filter stops is missing in all of them."""
    from scipy.stats import norm

    passed = float(np.mean(whitener.weight[1:] > 0.0))
    u = np.abs(z) / np.sqrt(max(passed, 1.0 / z.size))
    edges = np.concatenate([[0.0], norm.isf(0.5 * CLASSES_BEYOND), [np.inf]])
    return np.asarray(np.histogram(u, edges)[0], dtype=np.float64)


def _expected_sizes(counts: Array) -> Array:
    """What a normal law expects of as many samples in each class, shape (classes,)."""
    share = -np.diff(np.concatenate([[1.0], CLASSES_BEYOND, [0.0]]))
    return np.asarray(counts.sum() * share[: counts.shape[-1]])


def _lost_by_size(counts: Array, expected: Array) -> Array:
    """Nats that a normal law loses on counts of shape (..., classes), what chance loses included."""
    with np.errstate(divide="ignore", invalid="ignore"):
        lost = np.where(counts > 0.0, counts * np.log(counts / expected), 0.0) - counts + expected
    return np.asarray(lost.sum(axis=-1))


def divergence(held: HeldOut, words: str) -> Gap:
    """The gap of what was held out, with an interval from draws of its chance.

    Parameters
    ----------
    held : HeldOut
    words : str
        What was held out.
    """
    rng, m = np.random.default_rng(0), held.m
    chance = rng.chisquare(m, (INTERVAL_DRAWS, m.size)) / m
    c0, c1 = held.sizes_before, held.sizes_after
    chance_of_sizes = rng.poisson(held.expected, (INTERVAL_DRAWS, c0.size)).astype(np.float64)
    floor = 0.5 * m.size + float(np.mean(_lost_by_size(chance_of_sizes, held.expected)))
    lost0, lost1 = float(held.lost(held.before, c0)) - floor, float(held.lost(held.after, c1)) - floor
    again = rng.poisson(np.maximum(c0, 1.0), (INTERVAL_DRAWS, c0.size)) / np.maximum(c0, 1.0)
    more = floor + 0.5 * (m.size + np.count_nonzero(c0))  # what a second chance loses
    draws0 = held.lost(held.before * chance, c0 * again) - more
    draws1 = np.maximum(held.lost(held.after * chance, c1 * again) - more, 0.0)
    closed = 1.0 - max(lost1, 0.0) / lost0 if lost0 > 0.0 else 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(draws0 > 0.0, 1.0 - draws1 / draws0, 0.0)
    lo, hi = np.clip(np.quantile(shares, [0.025, 0.975]), -1.0, 1.0).tolist()
    closed, n = max(closed, -1.0), float(m.sum())
    return Gap(lost0 / n, lost1 / n, closed, (min(lo, closed), max(hi, closed)), words, n)


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
    first = Whitener.on(raw, written)
    z0, z1 = first.series(raw.y), z - _predicted(z, B, ~unseen)
    (r0, m), (r1, _) = _block_ratios(z0, unseen), _block_ratios(z1, unseen)
    if not _is_altered(raw, clean):
        return divergence(HeldOut(r0, r1, m), words)
    c0, c1 = _sizes(first, z0[unseen]), _sizes(whitener, z1[unseen])
    return divergence(HeldOut(r0, r1, m, c0, c1), words)


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
