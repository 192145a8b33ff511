"""The proof of a scene: samples that no fit saw, predicted by the assumed and by the updated model.

The whole scene is run, so that what is inside it (the state of a filter, of a plant) is carried over from the part
that was fitted into the part that was not; its white series is cut in time. Effects, biases and all that is unknown
are fitted to the samples that are seen, under either model. On the others, to which only states that start there, or
are seen there too, are fitted anew, the updated model gains

    G = (|z0|^2 - m0 - |z1|^2 + m1) / 2   nats

over the assumed one, ``z`` the white series under either, ``m`` as many as are left to chance. What the updated model
itself still loses, ``A``, is what it loses in each band against one that has the band's own level, see
`kfgen.gap.core.holdout`; below what chance alone exceeds at the rate of the battery it is none. The gap is ``A + G`` before and ``A``
after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.battery import BANDS_PER_DECADE, FALSE_ALARM_RATE
from kfgen.gap.core.holdout import BLOCKS, HELD_OUT_SHARE, INTERVAL_DRAWS, MIN_TAIL_POWER_SHARE, Gap, lost
from kfgen.gap.scene.assumed_parameters import Answered
from kfgen.gap.scene.newton import SceneFit, fitted
from kfgen.gap.scene.posterior import level_sd_of_log
from kfgen.gap.scene.proof import series
from kfgen.gap.scene.scene import HasNoiseSizes, HasWidths, Placed, Scene, ScenePoint, Unknown
from kfgen.gap.scene.screen import basis, orthogonal_part

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_SEEN_SHARE = 1e-3
"""Share of an unknown's effect that must fall on samples for it to be fitted to them."""
MIN_DEGREES_OF_FREEDOM = 0.5
"""Degrees of freedom below which a band says nothing."""
MIN_STRETCH_SAMPLES = 4
"""Samples of a stretch that has a spectrum."""
CHANCE_DRAWS = 20000
"""Draws by which is seen what chance exceeds rarely."""


@dataclass(frozen=True)
class Cut:
    """Which samples of each channel are held out, the stretches of equal length of which they consist, in words."""

    unseen: tuple[Mask, ...]
    stretches: tuple[tuple[tuple[int, int], ...], ...]
    words: str

    @property
    def rows(self) -> Mask:
        """Those of all channels, one after the other."""
        return np.concatenate(self.unseen)


def tail(lengths: Sequence[int]) -> Cut:
    """The last samples."""
    at = [(int(n * (1.0 - HELD_OUT_SHARE)), n) for n in lengths]
    unseen = tuple(np.arange(n) >= k for k, n in at)
    return Cut(unseen, tuple(((k, n),) for k, n in at), f"the last {100 * HELD_OUT_SHARE:.0f} % of the log")


def every_other(lengths: Sequence[int]) -> Cut:
    """Every other block."""
    unseen, stretches = [], []
    for n in lengths:
        size = n // BLOCKS
        blocks = tuple((k * size, (k + 1) * size) for k in range(1, BLOCKS, 2))
        mask = np.zeros(n, dtype=bool)
        for a, b in blocks:
            mask[a:b] = True
        unseen.append(mask)
        stretches.append(blocks)
    return Cut(tuple(unseen), tuple(stretches), "every other block of the log")


@dataclass(frozen=True)
class ScenePart:
    """Some samples of a scene.

    Parameters
    ----------
    scene : Scene
    kept : tuple of ndarray of bool
        Of each channel, which of its white series.
    values : ndarray, shape (q,)
        Of all unknowns.
    free : ndarray of bool, shape (q,)
        Those that are fitted.
    placed : tuple of Placed
        Effects that stand as they are.
    """

    scene: Scene
    kept: tuple[Mask, ...]
    values: Array
    free: Mask
    placed: tuple[Placed, ...] = ()

    channels = property(lambda self: self.scene.channels)
    dt = property(lambda self: self.scene.dt)
    span = property(lambda self: self.scene.span)

    @property
    def noise_level_sd_of_log(self) -> float:
        """As of the scene."""
        return level_sd_of_log(self.scene)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Samples that are kept."""
        return tuple(int(k.sum()) for k in self.kept)

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Those that are fitted."""
        return tuple(u for u, f in zip(self.scene.unknowns, self.free) if f)

    def whole(self, unknowns: Array) -> Array:
        """The values of all unknowns, shape (q,)."""
        out = self.values.copy()
        out[self.free] = unknowns
        return out

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """The white series at the samples that are kept, shape (sum of lengths, points)."""
        there = [ScenePoint((*self.placed, *p.placed), self.whole(p.unknowns)) for p in points]
        return np.asarray(series(self.scene, self.scene.residuals(there))[np.concatenate(self.kept)])

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """None."""
        return []

    def fitted(self, placed: tuple[Placed, ...] = ()) -> SceneFit:
        """To these samples, from the values of the unknowns."""
        return fitted(self, ScenePoint(placed, self.values[self.free]))


def held_out(answer: Answered, rescaled: Mask | None = None) -> Gap:
    """The gap on samples that the fits of the effects did not see.

    Parameters
    ----------
    rescaled : ndarray of bool, shape (channels,), optional
        Channels whose noise is of another size.
    """
    scene, found, fit = answer.scene, answer.found, answer.fit
    cut = _cut(scene, fit)
    if any(b - a < MIN_STRETCH_SAMPLES for blocks in cut.stretches for a, b in blocks):
        return Gap(0.0, 0.0, 0.0, (0.0, 0.0), "nothing: a part of the log is too little")
    learnt, trained, after = _predicted(scene, cut, fit, answer.likelihood)
    before = _predicted(answer.written, cut, found.assumed, answer.written)[2]
    levels = np.ones(len(scene.channels))
    same = scene is answer.written or not (isinstance(scene, HasNoiseSizes) or answer.random_errors)
    if same and not fit.point.placed and (rescaled is None or not rescaled.any()):
        after = before  # nothing was updated
    if rescaled is not None and rescaled.any():
        split = np.split(trained.residual, np.cumsum(learnt.lengths)[:-1])
        levels = np.where(rescaled, [np.sqrt(np.mean(z**2)) for z in split], 1.0)
    wider = _log_widths(scene, cut) - _log_widths(answer.written, cut)
    return _gap(cut, before, after, levels, wider)


def _log_widths(scene: Scene, cut: Cut) -> float:
    """Of all readings that are held out, by how much the likelihood is lower for their standard deviations [nats]."""
    return float(scene.log_widths[cut.rows].sum()) if isinstance(scene, HasWidths) else 0.0


def _predicted(
    scene: Scene, cut: Cut, fit: SceneFit, likelihood: Scene
) -> tuple[ScenePart, SceneFit, SceneFit]:
    """What is seen, the fit to it by a likelihood, and the fit to the rest of where things start: all else is as it was seen."""
    seen = tuple(~m for m in cut.unseen)
    learnt = ScenePart(likelihood, seen, fit.point.unknowns, _shown(scene, seen, fit))
    trained = learnt.fitted(fit.point.placed)
    values = learnt.whole(trained.point.unknowns)
    once = np.array([u.once for u in scene.unknowns], dtype=bool)
    free = _shown(scene, cut.unseen, fit) & (once | ~learnt.free)
    rest = ScenePart(scene, cut.unseen, values, free, trained.point.placed)
    return learnt, trained, rest.fitted()


def _shown(scene: Scene, kept: tuple[Mask, ...], fit: SceneFit) -> Mask:
    """The unknowns that some samples show."""
    J = series(scene, fit.jacobian[:, len(fit.keys) :])
    there = np.linalg.norm(J[np.concatenate(kept)], axis=0)
    return np.asarray(there > MIN_SEEN_SHARE * np.maximum(np.linalg.norm(J, axis=0), 1e-300))


def _cut(scene: Scene, fit: SceneFit) -> Cut:
    """What is held out: the tail, or every other block where the tail cannot show what was found."""
    last, blocks = tail(scene.lengths), every_other(scene.lengths)
    placed = fit.point.placed
    if not placed or min(scene.lengths) < MIN_STRETCH_SAMPLES * BLOCKS:
        return last
    if any(float(getattr(p.effect, "duration", 0.0)) > 0.0 for p in placed):
        return blocks
    without = [ScenePoint((*placed[:i], *placed[i + 1 :]), fit.point.unknowns) for i in range(len(placed))]
    alone = series(scene, np.column_stack([scene.residuals([p])[:, 0] - fit.residual for p in without]))
    J = series(scene, fit.jacobian[:, len(fit.keys) :])
    power, shown = (
        np.sum(orthogonal_part(alone[rows], basis(J[rows])) ** 2, axis=0)
        for rows in (np.ones(len(alone), dtype=bool), last.rows)
    )
    return blocks if (shown < MIN_TAIL_POWER_SHARE * power).any() else last


def _gap(cut: Cut, before: SceneFit, after: SceneFit, levels: Array, wider: float) -> Gap:
    """See the head of the module; by `wider` nats the updated model expects the readings less."""
    P0, m0 = _powers(cut, before)
    P1, m1 = _powers(cut, after)
    loss0 = loss1 = 0.0
    r, m = [], []
    for p0, f0, p1, f1, s in zip(P0, m0, P1, m1, levels.tolist()):
        loss0 += 0.5 * float(p0.sum() - f0.sum())
        loss1 += 0.5 * float(p1.sum() / s**2 - f1.sum()) + float(f1.sum() * np.log(s))
        edges = band_edges(p1.size)
        power, count = (np.add.reduceat(x, edges[:-1]) for x in (p1 / s**2, f1))
        enough = count > MIN_DEGREES_OF_FREEDOM
        r.append(np.maximum(power[enough] / count[enough], 1e-12))
        m.append(count[enough])
    noise = float(np.sqrt(sum(p.sum() for p in P1) / max(sum(f.sum() for f in m1), 1.0)))
    away = noise * float(np.linalg.norm(before.residual - after.residual))
    size = np.array([(s**2 - 1.0) * np.sqrt(0.5 * f.sum()) for s, f in zip(levels, m1)])
    moved = float(np.hypot(away, np.linalg.norm(size)))
    return gap_of(np.concatenate(r), np.concatenate(m), loss0 - loss1 - wider, moved, cut.words)


def gap_of(r: Array, m: Array, gain: float, deviation: float, words: str) -> Gap:
    """The gap from what the updated model leaves and from what it gains.

    Parameters
    ----------
    r, m : ndarray, shape (bands,)
        Power over expectation under the updated model, and degrees of freedom.
    gain, deviation : float
        Nats over the assumed model, and how far chance moves them.
    """
    rng = np.random.default_rng(0)
    chance = rng.chisquare(m, (CHANCE_DRAWS, m.size)) / m
    left, n = float(lost(r, m)), float(m.sum())
    A = left if left > float(np.quantile(lost(chance, m), 1.0 - FALSE_ALARM_RATE)) else 0.0
    before, after = A + max(gain, 0.0), A + max(-gain, 0.0)
    drawn = np.maximum(lost(r * chance[:INTERVAL_DRAWS], m) - 0.5 * m.size, 0.0)
    gains = gain + deviation * rng.standard_normal(INTERVAL_DRAWS)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(gains > 0.0, gains / (gains + drawn), np.maximum(gains / drawn, -1.0))
    closed = max(1.0 - after / before, -1.0) if before > 0.0 else 0.0
    lo, hi = np.nan_to_num(np.quantile(shares, [0.025, 0.975])).tolist()
    return Gap(before / n, after / n, closed, (min(lo, closed), max(hi, closed)), words)


def _powers(cut: Cut, fit: SceneFit) -> tuple[list[Array], list[Array]]:
    """Of each channel the power of each ordinate, all stretches together, and its degrees of freedom."""
    Q = basis(fit.jacobian)
    ends = np.cumsum([m.sum() for m in cut.unseen])[:-1]
    power, count = [], []
    for z, q, blocks in zip(np.split(fit.residual, ends), np.split(Q, ends), cut.stretches):
        size = blocks[0][1] - blocks[0][0]
        power.append(_spectrum(z, size).sum(axis=0))
        absorbed = _spectrum(q, size).sum(axis=(0, 2)) if q.shape[1] else 0.0
        count.append(np.maximum(len(blocks) - absorbed, 0.0) * np.ones(size))
    return power, count


def _spectrum(z: Array, size: int) -> Array:
    """Squared cosine coefficients of stretches of equal size, shape (stretches, size, ...)."""
    from scipy.fft import dct

    return np.asarray(dct(z.reshape(-1, size, *z.shape[1:]), type=2, axis=1, norm="ortho") ** 2)


def band_edges(n: int) -> NDArray[np.int64]:
    """Of bands of n ordinates: the constant, the first, and then evenly in the logarithm."""
    count = max(2, int(np.log10(n) * BANDS_PER_DECADE))
    return np.unique(np.concatenate([[0.0, 1.0], np.geomspace(2.0, n, count).round()])).astype(np.int64)
