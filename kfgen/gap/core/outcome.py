"""What was found in a scene: effects with their places, the proof on held-out data, what would not have been seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.battery import Test, chance_of, holm, white_tests
from kfgen.gap.core.believed_parameters import Answered, answered
from kfgen.gap.core.engine import Added, Explained, limits
from kfgen.gap.core.holdout import Gap
from kfgen.gap.core.newton import SceneFit, coordinates, fitted, is_signed
from kfgen.gap.core.noise_scale import NoiseScale, levels_in, louder_in
from kfgen.gap.core.scene import (
    HasInputs,
    Inspected,
    Placed,
    Scene,
    ScenePoint,
    Telling,
    Trusting,
    Undecided,
    Unknown,
)
from kfgen.gap.core.scene_holdout import band_edges, held_out
from kfgen.gap.core.screen import basis
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.search import SET

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlacedFinding:
    """A missing effect of a scene.

    Parameters
    ----------
    placed : Placed
        With its fitted values.
    ci95 : mapping
        Intervals of its parameters [SI].
    probability, evidence : float
    alternatives : tuple of (name, place, probability)
    alike : mapping
        Squared cosine between its direction in this record and that of others, by effect and place.
    stated : float, optional
        What is believed of the number of which it is the error [SI].
    once : bool
        Whether that is where a state starts in this record.
    """

    placed: Placed
    ci95: dict[str, tuple[float, float]]
    probability: float
    evidence: float
    alternatives: tuple[tuple[str, str, float], ...]
    alike: dict[tuple[str, str], float]
    stated: float | None = None
    once: bool = False

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Names that the record does not rule out."""
        names = [n for n, _, p in self.alternatives if p > SET and n not in ("none", self.placed.effect.name)]
        return tuple(dict.fromkeys(names))


@dataclass(frozen=True)
class SceneGap:
    """The answer for a scene.

    Parameters
    ----------
    verdict : str
    findings : tuple of PlacedFinding
    before, after : tuple of (channel, Test)
    gap : Gap
    rms : tuple of (channel, before, after)
        Root mean square of the residuals in deviations of the noise.
    limits : tuple of (Placed, parameter, value)
        What would not have been seen [SI].
    idle : tuple of str
        Inputs that never change.
    louder : tuple of Louder
        Channels whose noise is of another size than believed.
    """

    scene: Scene
    verdict: str
    findings: tuple[PlacedFinding, ...]
    before: tuple[tuple[str, Test], ...]
    after: tuple[tuple[str, Test], ...]
    gap: Gap
    rms: tuple[tuple[str, float, float], ...]
    believed: SceneFit
    fit: SceneFit
    limits: tuple[tuple[Placed, str, float], ...] = ()
    constant_inputs: tuple[str, ...] = ()
    noise_scales: tuple[NoiseScale, ...] = ()

    @property
    def unknowns(self) -> dict[str, tuple[Unknown, float]]:
        """What was fitted beside the effects."""
        return {u.name: (u, float(v)) for u, v in zip(self.scene.unknowns, self.fit.point.unknowns)}


def find_scene_gap(scene: Scene) -> SceneGap:
    """Where a scene disagrees with its log, and what is missing."""
    faults = scene.faults() if isinstance(scene, Inspected) else ()
    return _spoilt(scene, faults) if faults else _gap_of(answered(scene))


def _spoilt(scene: Scene, faults: Sequence[Placed]) -> SceneGap:
    """The answer where a fit would mean nothing: the faults alone."""
    believed = fitted(scene, ScenePoint((), _values(scene)))
    findings = tuple(map(_said, faults))
    if findings and isinstance(scene, Undecided):
        first = (findings[0].placed.effect.name, findings[0].placed.where)
        labels = dict.fromkeys((p.effect.name, p.where) for p in scene.either)
        labels.pop(first, None)
        share = 1.0 / (1 + len(labels))
        others = tuple((*label, share) for label in labels)
        findings = (replace(findings[0], probability=share, alternatives=others), *findings[1:])
    tests = tuple(tests_of(scene, believed))
    rms = tuple((c, r, r) for c, r, _ in _rms(scene, believed, believed))
    nothing = Gap(0.0, 0.0, 0.0, (0.0, 0.0), "nothing: no effect was fitted")
    return SceneGap(scene, "bad_data", findings, tests, tests, nothing, rms, believed, believed)


def _said(fault: Placed) -> PlacedFinding:
    """A fault as a finding."""
    return PlacedFinding(fault, {}, 1.0, 0.0, (), {})


def _rms(scene: Scene, before: SceneFit, after: SceneFit) -> tuple[tuple[str, float, float], ...]:
    """Root mean square of the residuals of each channel under two fits."""
    cuts = np.cumsum(scene.lengths)[:-1]
    parts = zip(scene.channels, np.split(before.residual, cuts), np.split(after.residual, cuts))
    return tuple((c, float(np.sqrt(np.mean(a**2))), float(np.sqrt(np.mean(b**2)))) for c, a, b in parts)


def _gap_of(answer: Answered) -> SceneGap:
    """The answer where effects were looked for."""
    scene, found = answer.scene, answer.found
    before = tests_of(scene, found.believed)
    after, noise_scales = _mended_tests(scene, found.fit)
    levels = levels_in(scene, noise_scales)
    said = scene.said if isinstance(scene, Telling) else ()
    findings = (*map(_said, said), *(_finding(scene, a, i, found) for i, a in enumerate(found.added)))
    verdict = "effects_found" if findings or noise_scales else "no_gap"
    if any(t.significant for _, t in after):
        verdict = "unknown_effect"
    constant_inputs = scene.constant_inputs if isinstance(scene, HasInputs) else ()
    rms = tuple(
        (c, a, b / s) for (c, a, b), s in zip(_rms(scene, found.believed, found.fit), levels.tolist())
    )
    if (
        verdict == "unknown_effect"
        and constant_inputs
        and isinstance(scene, HasInputs)
        and scene.follows_nowhere
    ):
        return replace(
            _spoilt(scene, ()), limits=tuple(limits(scene, found.believed)), constant_inputs=constant_inputs
        )
    return SceneGap(
        scene,
        verdict,
        findings,
        tuple(before),
        tuple(after),
        held_out(answer, levels != 1.0),
        rms,
        found.believed,
        found.fit,
        tuple(limits(scene, found.fit)),
        constant_inputs,
        noise_scales,
    )


def _mended_tests(scene: Scene, fit: SceneFit) -> tuple[list[tuple[str, Test]], tuple[NoiseScale, ...]]:
    """The tests on what the mended model leaves; noise of another size is mended where that explains all."""
    after = tests_of(scene, fit)
    if not any(t.significant for _, t in after):
        return after, ()
    noise_scales = louder_in(scene, fit)
    each = np.repeat(levels_in(scene, noise_scales), scene.lengths)
    anew = tests_of(scene, replace(fit, residual=fit.residual / each)) if noise_scales else after
    return (after, ()) if any(t.significant for _, t in anew) else (anew, noise_scales)


def _finding(scene: Scene, added: Added, index: int, found: Explained) -> PlacedFinding:
    """With intervals from the last fit."""
    fit, x = found.fit, coordinates(found.fit.point)
    placed = fit.point.placed[index]
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    ci95 = {}
    for i, (at, name) in enumerate(fit.keys):
        if at == index:
            lo, hi = float(x[i] - 1.96 * deviation[i]), float(x[i] + 1.96 * deviation[i])
            if not is_signed(placed.effect, name):
                lo, hi = float(np.exp(lo)), float(np.exp(min(hi, 700.0)))
            ci95[name] = (lo, hi)
    own = added.trial.label
    wrong = isinstance(scene, Trusting) and placed.effect.name == "parameter_error"
    others = [(n, w, p) for (n, w), p in added.shares.items() if (n, w) != own]
    return PlacedFinding(
        placed,
        ci95,
        added.shares[own],
        added.trial.gain,
        tuple(sorted(others, key=lambda a: -a[2])),
        dict(added.alike),
        scene.stated(placed.where) if isinstance(scene, Trusting) and wrong else None,
        wrong and any(u.once and u.own == placed.where for u in scene.unknowns),
    )


def tests_of(scene: Scene, fit: SceneFit) -> list[tuple[str, Test]]:
    """All tests on the white residuals of every channel, by adjusted p value."""
    named: list[tuple[str, Test]] = []
    cuts = np.cumsum(scene.lengths)[:-1]
    Q = basis(fit.jacobian)
    parts = np.split(fit.residual, cuts), np.split(1.0 - np.sum(Q**2, axis=1), cuts)
    t0, t1 = scene.span
    for channel, X, left in zip(scene.channels, *parts):
        if X.size < 64:
            continue
        dt = (t1 - t0) / X.size
        # What was fitted takes power away: it is given back before powers are looked at in time.
        whole = X / np.sqrt(np.clip(left, 0.05, 1.0))
        found = [*_band_tests(X, np.clip(left, 1e-3, 1.0), dt), *white_tests(Whitener.back(whole), dt, whole)]
        named += [(channel, t) for t in found]
    held = holm([replace(t, name=f"{channel}\n{t.name}") for channel, t in named])
    return [(t.name.split("\n")[0], replace(t, name=t.name.split("\n")[1])) for t in held]


def _band_tests(X: Array, left: Array, dt: float) -> list[Test]:
    """Power in bands, of which each ordinate has as many degrees of freedom as are left to it."""
    edges, n = band_edges(X.size), X.size
    out = []
    for lo, hi in zip(edges[:-1].tolist(), edges[1:].tolist()):
        total, m = float(X[lo:hi] @ X[lo:hi]), float(left[lo:hi].sum())
        band = (0.5 * lo / (n * dt), 0.5 * hi / (n * dt))
        out.append(Test("power", chance_of(total, m), band, total / m))
    return out


def _values(scene: Scene) -> Array:
    return np.array([u.start for u in scene.unknowns])
