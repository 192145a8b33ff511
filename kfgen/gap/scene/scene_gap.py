"""What was found in a scene: effects with their places, the proof on held-out data, what would not have been seen."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import acts_on
from kfgen.core.time_budget import time_budget
from kfgen.gap.core.battery import Test, chance_of, holm, white_tests
from kfgen.gap.core.holdout import HELD_OUT_SHARE, Gap
from kfgen.gap.core.result import (
    BAD_DATA,
    EFFECTS_FOUND,
    NO_GAP,
    UNKNOWN_EFFECT,
    Comparison,
    DetectionLimit,
    Finding,
    NoiseScale,
    OutageDrift,
    beside_misfit,
)
from kfgen.gap.core.search import Chosen, Refused
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.second_recording import happens_once
from kfgen.gap.scene.addition import FittedAddition
from kfgen.gap.scene.assumed_parameters import Answered, answered, complete
from kfgen.gap.scene.detection_limits import limits
from kfgen.gap.scene.holdout import band_edges, held_out
from kfgen.gap.scene.newton import SceneFit, fitted
from kfgen.gap.scene.noise_scale import levels_in, noise_scales_in
from kfgen.gap.scene.random_error import HasRandomErrors, NamedRandomError
from kfgen.gap.scene.random_error_search import refusing, with_inertial_noise, with_random_errors
from kfgen.gap.scene.scene import (
    HasInputs,
    HasNoiseSizes,
    HasOutages,
    Inspected,
    Placed,
    Scene,
    Telling,
    Trusting,
    Undecided,
    coordinates,
    is_signed,
    start_of,
)
from kfgen.gap.scene.screen import basis
from kfgen.gap.scene.under_misfit import (
    AMONG_OTHER_EVENTS,
    under_misfit,
    without_events,
    without_trifles,
    without_weakest,
)
from kfgen.gap.scene.unevenness import scattered_deviations

Array = NDArray[np.float64]
UnitOf = Callable[[Placed], str]
"""The unit ``U`` of a placed effect's parameters, as the user writes it."""

MIN_TESTED_ORDINATES = 64
"""Of a channel, below which nothing is tested."""
MAX_NOISE_TIMES = 50.0
"""Over the assumed noise of an aiding channel: what would have to be louder is no noise."""
MAX_FOLLOWED_SIGMAS = 10.0
"""Root mean square of normalised innovations beyond which the filter does not follow its readings, whatever is added."""
MIN_BAND_FREEDOM = 0.5
"""Degrees of freedom that the fit leaves to a band, below which its power is not tested."""


@dataclass(frozen=True, kw_only=True)
class SceneGap(Comparison):
    """The answer for a scene: all channels of sensors that move, or of a plant.

    Parameters
    ----------
    scene : Scene
        In which the explanation holds.
    assumed, fit : SceneFit
        Of what is assumed, and of the updated model.
    """

    scene: Scene
    assumed: SceneFit
    fit: SceneFit


def scene_gap(scene: Scene, unit_of: UnitOf = lambda _: "") -> SceneGap:
    """Where a scene disagrees with its log, and what is missing.

    Parameters
    ----------
    scene : Scene
    unit_of : callable
        Units of what is found.
    """
    faults = scene.faults() if isinstance(scene, Inspected) else ()
    if faults:
        return _spoilt(scene, faults, unit_of)
    with time_budget():
        with time_budget(parts=2):  # the other half is for a search with the misfit in the noise
            answer = answered(scene)
        if isinstance(scene, HasRandomErrors):
            with time_budget(parts=2):  # the other half is for random errors, and for effects beside them
                answer = with_inertial_noise(answer)
            is_unfinished = bool(_doubtful_channels(answer))
            with time_budget(parts=2 if is_unfinished else 1):
                noisy = with_random_errors(answer, is_unfinished=is_unfinished)
            if isinstance(scene, HasNoiseSizes) or not (noisy.random_errors and _doubtful_channels(noisy)):
                answer = noisy
            else:  # what process noise takes up of a misfit, effects beside it cannot explain any more
                bare = answer if answer.found.added else answered(scene, noise_first=False)
                answer = refusing(bare, noisy.random_errors)
        elif not _doubtful_channels(answer):
            answer = complete(answer)
        if doubtful := _doubtful_channels(answer):
            answer = without_trifles(without_events(under_misfit(answer), doubtful))
        found = _gap_of(answer, unit_of)
        while answer.found.added and found.gap.ci95[1] < 0.0:
            answer = without_weakest(answer)
            found = _gap_of(answer, unit_of)
        return found


def _doubtful_channels(answer: Answered) -> set[str]:
    """Channels in which the updated model leaves more than noise, or a random error that is none."""
    failed = {t.channel for t in _updated_tests(answer)[0] if t.significant}
    return failed | {w.fitted.placed.where for w in answer.random_errors if w.objection}


def _spoilt(scene: Scene, faults: Sequence[Placed], unit_of: UnitOf) -> SceneGap:
    """The answer where a fit would mean nothing: the faults alone."""
    assumed = fitted(scene, start_of(scene))
    findings = tuple(_fault_finding(f, unit_of) for f in faults)
    if findings and isinstance(scene, Undecided):
        labels = dict.fromkeys((p.effect.name, p.where) for p in scene.either)
        labels.pop((findings[0].name, findings[0].where), None)
        share = 1.0 / (1 + len(labels))
        others = tuple((*label, share) for label in labels)
        findings = (replace(findings[0], probability=share, alternatives=others), *findings[1:])
    tests = tuple(tests_of(scene, assumed))
    return SceneGap(
        channels=tuple(scene.channels),
        verdict=BAD_DATA,
        findings=findings,
        before=tests,
        after=tests,
        gap=Gap(0.0, 0.0, 0.0, (0.0, 0.0), "nothing: no effect was fitted"),
        span_s=scene.span,
        rms=tuple((c, r, r) for c, r, _ in _rms(scene, assumed, assumed)),
        unknowns=_unknowns(scene, assumed),
        scene=scene,
        assumed=assumed,
        fit=assumed,
    )


def _fault_finding(fault: Placed, unit_of: UnitOf) -> Finding:
    return Finding(fault.effect, fault.where, unit_of(fault))


def _unknowns(scene: Scene, fit: SceneFit) -> dict[str, tuple[str, float]]:
    """What was fitted beside the effects, units and values [SI]."""
    return {u.name: (u.unit, float(v)) for u, v in zip(scene.unknowns, fit.point.unknowns)}


def _limits(scene: Scene, fit: SceneFit, unit_of: UnitOf) -> tuple[DetectionLimit, ...]:
    return tuple(
        DetectionLimit(p.effect, p.where, name, value, unit_of(p)) for p, name, value in limits(scene, fit)
    )


def _rms(scene: Scene, before: SceneFit, after: SceneFit) -> tuple[tuple[str, float, float], ...]:
    """Root mean square of the residuals of each channel under two fits."""
    cuts = np.cumsum(scene.lengths)[:-1]
    parts = zip(scene.channels, np.split(before.residual, cuts), np.split(after.residual, cuts))
    return tuple((c, float(np.sqrt(np.mean(a**2))), float(np.sqrt(np.mean(b**2)))) for c, a, b in parts)


def _gap_of(answer: Answered, unit_of: UnitOf) -> SceneGap:
    """The answer where effects were looked for."""
    answer = _as_assumed(answer)
    scene, found, fit = answer.scene, answer.found, answer.fit
    before = tests_of(scene, found.assumed)
    after, noise_scales = _updated_tests(answer)
    levels = levels_in(scene, noise_scales)
    sizes = (*noise_scales, *(scene.noise_scales if isinstance(scene, HasNoiseSizes) else ()))
    said, unsaid = _said(scene, {t.channel for t in after if t.significant})
    findings = _findings(answer, said, unit_of)
    refused = [*found.refused, *_stand_ins(answer), *unsaid]
    verdict = EFFECTS_FOUND if findings or sizes else NO_GAP
    if any(w.objection for w in answer.random_errors) or any(t.significant for t in after):
        verdict, findings = UNKNOWN_EFFECT, beside_misfit(findings)
    rms = tuple((c, a, b / s) for (c, a, b), s in zip(_rms(scene, found.assumed, fit), levels.tolist()))
    if isinstance(scene, HasNoiseSizes) and (why := _not_followed(rms, sizes)):
        refused += [Refused(f.name, f.where, f.evidence_nats, why) for f in findings]
        verdict, findings, sizes = UNKNOWN_EFFECT, (), ()
    constant_inputs = scene.constant_inputs if isinstance(scene, HasInputs) else ()
    if (
        verdict == UNKNOWN_EFFECT
        and constant_inputs
        and isinstance(scene, HasInputs)
        and scene.follows_nowhere
    ):
        unseen = _limits(scene, found.assumed, unit_of)
        return replace(_spoilt(scene, (), unit_of), limits=unseen, constant_inputs=constant_inputs)
    return SceneGap(
        channels=tuple(scene.channels),
        verdict=verdict,
        findings=findings,
        before=tuple(before),
        after=tuple(after),
        gap=held_out(answer, levels != 1.0),
        span_s=scene.span,
        limits=_limits(answer.likelihood, found.fit, unit_of),
        noise_scales=sizes,
        rms=rms,
        unknowns=_unknowns(scene, fit),
        constant_inputs=constant_inputs,
        refused=tuple(refused),
        outages=_outages(answer) if findings or sizes else (),
        scene=scene,
        assumed=found.assumed,
        fit=fit,
    )


def _as_assumed(answer: Answered) -> Answered:
    """The answer by the fit of what is assumed, where nothing was added: a fit with the misfit in its noise is another one."""
    found = answer.found
    if found.added or answer.random_errors or answer.scene is not answer.written:
        return answer
    return replace(answer, found=replace(found, fit=found.assumed), tempered=None)


def _said(scene: Scene, doubtful: Collection[str]) -> tuple[list[Placed], list[Refused]]:
    """What a scene was made without, and what of it may be something else: a moment of channels that fail their tests."""
    said = scene.said if isinstance(scene, Telling) else ()
    unsure = [happens_once(p.effect) and any(acts_on(p.where, c) for c in doubtful) for p in said]
    refused = [
        Refused(p.effect.name, p.where, 0.0, AMONG_OTHER_EVENTS) for p, is_one in zip(said, unsure) if is_one
    ]
    return [p for p, is_one in zip(said, unsure) if not is_one], refused


def _findings(answer: Answered, said: Sequence[Placed], unit_of: UnitOf) -> tuple[Finding, ...]:
    """Faults that were left out, the effects that were added, and the random errors whose course is one."""
    sd = _deviations(answer)
    return (
        *(_fault_finding(f, unit_of) for f in said),
        *(_finding(answer, a, i, sd, unit_of) for i, a in enumerate(answer.found.added)),
        *(_random_finding(w, unit_of) for w in answer.random_errors if not w.objection),
    )


def _stand_ins(answer: Answered) -> list[Refused]:
    """Random errors that are in the noise, though their course is none of one."""
    return [Refused(*w.fitted.label, w.gain, w.objection) for w in answer.random_errors if w.objection]


def _not_followed(rms: Sequence[tuple[str, float, float]], sizes: Sequence[NoiseScale]) -> str:
    """Why no effect is named where a filter does not follow its readings at all; empty where it does."""
    aiding = {c for c, _, _ in rms}
    for s in (s for s in sizes if s.times > MAX_NOISE_TIMES and s.channel in aiding):
        asked = f"its noise would have to be {s.times:.0f} times as large as assumed"
        return f"the filter does not follow {s.channel}: {asked}, so check its axes, signs and unit"
    channel, _, worst = max(rms, key=lambda r: r[2], default=("", 0.0, 0.0))
    if worst < MAX_FOLLOWED_SIGMAS:
        return ""
    return (
        f"the filter does not follow {channel}: its readings are {worst:.0f} standard deviations from what the filter "
        "expects, so check its axes, signs and unit"
    )


def _outages(answer: Answered) -> tuple[tuple[OutageDrift, OutageDrift], ...]:
    """Drifts of the filter as assumed and updated, in outages in the part of the log that is held out elsewhere."""
    before, after = answer.written, answer.scene
    if not isinstance(before, HasOutages) or not isinstance(after, HasOutages):
        return ()
    return tuple(zip(before.drifts(HELD_OUT_SHARE), after.drifts(HELD_OUT_SHARE)))


def _updated_tests(answer: Answered) -> tuple[list[Test], tuple[NoiseScale, ...]]:
    """The tests on what the updated model leaves; noise of another size is in it where that explains all."""
    scene, fit = answer.scene, answer.fit
    after = tests_of(scene, fit)
    if not any(t.significant for t in after):
        return after, ()
    noise_scales = noise_scales_in(scene, fit)
    each = np.repeat(levels_in(scene, noise_scales), scene.lengths)
    anew = tests_of(scene, replace(fit, residual=fit.residual / each)) if noise_scales else after
    return (after, ()) if any(t.significant for t in anew) else (anew, noise_scales)


def _deviations(answer: Answered) -> Array:
    """Standard deviations of what was fitted: where something is left, by the scatter over the log if that is larger."""
    fit = answer.found.fit
    if answer.tempered is not None:
        return scattered_deviations(answer.tempered, fit)
    return np.asarray(np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)))


def _finding(
    answer: Answered, added: Chosen[FittedAddition], index: int, deviation: Array, unit_of: UnitOf
) -> Finding:
    """With 95 % intervals from the last fit."""
    scene, fit = answer.scene, answer.found.fit
    x, placed = coordinates(fit.point), fit.point.placed[index]
    ci95 = {}
    for i, (at, name) in enumerate(fit.keys):
        if at == index:
            lo, hi = float(x[i] - 1.96 * deviation[i]), float(x[i] + 1.96 * deviation[i])
            if not is_signed(placed.effect, name):
                lo, hi = float(np.exp(lo)), float(np.exp(min(hi, 700.0)))
            ci95[name] = (lo, hi)
    wrong = isinstance(scene, Trusting) and placed.effect.name == "parameter_error"
    return Finding(
        placed.effect,
        placed.where,
        unit_of(placed),
        ci95,
        added.probability,
        added.gain,
        added.alternatives,
        added.others,
        assumed_value=scene.stated(placed.where) if isinstance(scene, Trusting) and wrong else None,
        once=wrong and any(u.once and u.own == placed.where for u in scene.unknowns),
    )


def _random_finding(named: NamedRandomError, unit_of: UnitOf) -> Finding:
    """Of a random error that is in the noise."""
    placed, label = named.fitted.placed, named.fitted.label
    others = [(*other, p) for other, p in named.probabilities.items() if other != label]
    return Finding(
        placed.effect,
        placed.where,
        unit_of(placed),
        named.fitted.ci95,
        named.probabilities[label],
        named.gain,
        tuple(sorted(others, key=lambda other: -other[2])),
    )


def tests_of(scene: Scene, fit: SceneFit) -> list[Test]:
    """All tests on the white residuals of every channel, by adjusted p value.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
    named: list[Test] = []
    cuts = np.cumsum(scene.lengths)[:-1]
    Q = basis(fit.jacobian)
    parts = np.split(fit.residual, cuts), np.split(1.0 - np.sum(Q**2, axis=1), cuts)
    t0, t1 = scene.span
    for channel, X, left in zip(scene.channels, *parts):
        if X.size < MIN_TESTED_ORDINATES:
            continue
        dt = (t1 - t0) / X.size
        # What was fitted takes power away: it is given back before powers are looked at in time.
        whole = X / np.sqrt(np.clip(left, 0.05, 1.0))
        found = [*_band_tests(X, np.clip(left, 0.0, 1.0), dt), *white_tests(Whitener.back(whole), dt, whole)]
        named += [replace(t, channel=channel) for t in found]
    return holm(named)


def _band_tests(X: Array, left: Array, dt: float) -> list[Test]:
    """Power in bands, of which each ordinate has as many degrees of freedom as are left to it."""
    edges, n = band_edges(X.size), X.size
    out = []
    for lo, hi in zip(edges[:-1].tolist(), edges[1:].tolist()):
        total, m = float(X[lo:hi] @ X[lo:hi]), float(left[lo:hi].sum())
        if m < MIN_BAND_FREEDOM:
            continue  # a fitted constant leaves nothing of the lowest ordinate: its power is no evidence
        band = (0.5 * lo / (n * dt), 0.5 * hi / (n * dt))
        out.append(Test("power", chance_of(total, m), band, total / m))
    return out
