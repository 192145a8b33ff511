"""`GapResult`: where a model and its logs disagree, in one form for every kind of log and model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import kfgen
from kfgen.core.numbers import finite
from kfgen.core.result import Result
from kfgen.core.units import derived_unit, parse_unit
from kfgen.effects.effect import Parameter
from kfgen.effects.noise_model import NoiseModel, noise_text
from kfgen.gap.core.battery import Test
from kfgen.gap.core.holdout import METRIC, Gap
from kfgen.gap.core.result import GRAVEST_FIRST, Comparison, DetectionLimit, Finding
from kfgen.gap.core.search import Distinguishability
from kfgen.gap.words import VERDICTS, distinguishing, finding_sentence, percent
from kfgen.model.filter_file import FilterFile, filter_text
from kfgen.model.plant.file import model_text
from kfgen.model.plant.user import UserModel

ModelFile = NoiseModel | FilterFile | UserModel
"""What a team keeps: each has a file format of its own."""
MIN_LISTED_COS2 = 0.5
"""Squared cosine above which another effect's likeness is listed."""

MAX_SUMMARY_FINDINGS = 4
"""Findings of which the summary says the names."""


@dataclass(frozen=True)
class LogSource:
    """A log that was compared: its name and the SHA-256 of its file."""

    name: str
    sha256: str


@dataclass(frozen=True)
class Proof:
    """What another recording of a channel says of what was found.

    Parameters
    ----------
    log : LogSource
    channel : str
    gap : Gap
        Over that recording, under the assumed and the updated model.
    happened_once : tuple of str
        Titles of the findings that are not looked for there.
    """

    log: LogSource
    channel: str
    gap: Gap
    happened_once: tuple[str, ...] = ()


@dataclass(frozen=True)
class RecordingGap:
    """One of several recordings by itself: its name, and the comparison of each channel."""

    name: str
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True, repr=False)
class GapResult(Result):
    """Where a model and its logs disagree.

    Parameters
    ----------
    logs : tuple of LogSource
    comparisons : tuple of Comparison
        Of each channel at rest; of all channels of sensors that move, or of a plant, together.
    assumed, updated : NoiseModel, FilterFile or UserModel
        The model as it was given, and with everything that was found.
    warnings : tuple of str
    recordings : tuple of RecordingGap
        Of several recordings, each by itself; of a long log, its beginning. What happened once is said there.
    proofs : tuple of Proof
        Of other recordings.
    """

    logs: tuple[LogSource, ...]
    comparisons: tuple[Comparison, ...]
    assumed: ModelFile
    updated: ModelFile
    warnings: tuple[str, ...] = ()
    recordings: tuple[RecordingGap, ...] = ()
    proofs: tuple[Proof, ...] = ()

    def summary(self) -> list[str]:
        """One to five lines: the verdict, the effects, the held-out mismatch."""
        found = [f"{f.name} of {f.where} ({percent(f.probability)} probable)" for f in self.findings]
        more = [f"and {len(found) - MAX_SUMMARY_FINDINGS} more"] if len(found) > MAX_SUMMARY_FINDINGS else []
        lines = [f"{self.logs[0].name}: {VERDICTS[self.verdict]}"]
        lines += [", ".join([*found[:MAX_SUMMARY_FINDINGS], *more])] if found else []
        gap = self.gap
        if gap.before > 0.0:
            left = f"{gap.after:.3g} nats per sample" if gap.after > 0.0 else "none above chance"
            lines.append(
                f"held-out mismatch before {gap.before:.3g} nats per sample, after {left}, "
                f"closed {100.0 * gap.closed:.0f} %"
            )
        return lines

    def short_table(self) -> tuple[list[str], list[list[str]]]:
        """Heads and rows: every finding with its place, probability and evidence."""
        rows = [
            [
                f.name,
                f.where,
                percent(f.probability),
                f"{f.evidence_nats:.3g}",
                ", ".join(f.indistinguishable),
            ]
            for f in self.findings
        ]
        return ["effect", "where", "probability", "evidence [nats]", "not ruled out"], rows

    @property
    def verdict(self) -> str:
        """``no_gap``, ``effects_found``, ``unknown_effect`` or ``bad_data``, the gravest of all comparisons."""
        return next(v for v in GRAVEST_FIRST if any(c.verdict == v for c in self.comparisons))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Everything that was found, and then what happened once in one of several recordings."""
        lasting = tuple(f for c in self.comparisons for f in c.findings)
        return lasting + tuple(f for _, _, f in self.once)

    @property
    def once(self) -> list[tuple[str, Comparison, Finding]]:
        """What happened in one of several recordings, the name of the recording before it; by channel."""
        channels = [c.channels for c in self.comparisons]
        return [
            (r.name, c, f)
            for wanted in channels
            for r in self.recordings
            for c in r.comparisons
            if c.channels == wanted
            for f in c.findings
            if f.once
        ]

    @property
    def gap(self) -> Gap:
        """The held-out mismatch where it was largest before."""
        return self._worst.gap

    @property
    def improved(self) -> ModelFile:
        """The updated model."""
        return self.updated

    @property
    def assumed_text(self) -> str:
        """The file of the assumed model."""
        return file_text(self.assumed)

    @property
    def updated_text(self) -> str:
        """The file of the updated model."""
        return file_text(self.updated)

    @property
    def _worst(self) -> Comparison:
        return max(self.comparisons, key=lambda c: c.gap.before)

    def to_dict(self) -> dict[str, Any]:
        """The JSON of ``kfgen gap --json``."""
        every, worst = self.comparisons, self._worst
        remaining = [_test(c, t) for c in every for t in c.after if t.significant]
        data: dict[str, Any] = {
            "format": "kfgen-gap-1",
            "kfgen": kfgen.__version__,
            "log": self.logs[0].name,
            "sha256": self.logs[0].sha256,
            "verdict": self.verdict,
            "localised": [_test(c, t) for c in every for t in c.before if t.significant],
            "steps": [
                *(_step(c, f) for c in every for f in c.findings),
                *({**_step(c, f), "recording": name} for name, c, f in self.once),
            ],
            "gap": {
                "metric": METRIC,
                "held_out": worst.gap.held_out,
                "channel": ", ".join(worst.channels),
                **_gap(worst.gap),
            },
            "remaining": {"significant": bool(remaining), "tests": remaining},
            "checks": {", ".join(c.channels): _checks(c) for c in every if c.checks},
            "retuned": [n for c in every for n in c.retuned_channels],
            "retuned_stand_in_because": {
                c.channels[0]: c.own_noise_objection for c in every if c.own_noise_objection
            },
            "noise_times": {
                s.channel: {"value": s.times, "ci95": list(s.ci95)} for c in every for s in c.noise_scales
            },
            "noise_factors": [
                {
                    "channel": f.channel,
                    "times": f.times,
                    "ci95": list(f.ci95),
                    "parts": [{"cause": p.cause, "channel": p.where, "factor": p.factor} for p in f.parts],
                    "left": f.left,
                }
                for c in every
                for f in c.noise_factors
            ],
            "rms_in_deviations": {n: {"before": a, "after": b} for c in every for n, a, b in c.rms},
            "outages": [
                {
                    "seconds": a.seconds,
                    "count": a.count,
                    "drift_before_m": a.metres,
                    "drift_after_m": b.metres,
                }
                for c in every
                for a, b in c.outages
            ],
            "unknowns": {n: {"value": v, "unit": u} for c in every for n, (u, v) in c.unknowns.items()},
            "parked": any(c.parked for c in every),
            "limits": [_limit(c, m) for c in every for m in c.limits],
            "refused": [
                {"effect": r.effect, "channel": r.where, "evidence_nats": r.evidence_nats, "why": r.why}
                for c in every
                for r in c.refused
            ],
            "warnings": list(self.warnings),
        }
        if self.recordings:
            logs = self.logs if len(self.logs) == len(self.recordings) else self.logs * len(self.recordings)
            data["recordings"] = [_recording(*pair) for pair in zip(logs, self.recordings)]
        if self.proofs:
            data["proofs"] = [
                {"log": p.log.name, "sha256": p.log.sha256, "channel": p.channel, **_gap(p.gap)}
                for p in self.proofs
            ]
        return data


def _recording(log: LogSource, alone: RecordingGap) -> dict[str, Any]:
    verdicts = {c.channels[0]: c.verdict for c in alone.comparisons}
    return {"log": alone.name, "sha256": log.sha256, "verdicts": verdicts}


def file_text(model: ModelFile) -> str:
    """The file of a model."""
    if isinstance(model, FilterFile):
        return filter_text(model)
    return noise_text(model) if isinstance(model, NoiseModel) else model_text(model)


def _gap(gap: Gap) -> dict[str, Any]:
    return {
        "before": gap.before,
        "after": gap.after,
        "closed_fraction": gap.closed,
        "ci95": list(gap.ci95),
    }


def _checks(c: Comparison) -> dict[str, Any]:
    assert c.checks is not None
    again = c.checks.found_again
    return {
        "nested_nats": c.checks.nested_nats,
        "seen": dict(c.checks.seen),
        "found_again": list(again) if again is not None else None,
    }


def _test(c: Comparison, t: Test) -> dict[str, Any]:
    lo, hi = span_of_test(c, t)
    regime = ("a stretch" if t.span else "whole record") if c.is_at_rest else "all"
    return {
        "channel": t.channel,
        "test": t.name,
        "p": t.p,
        "from_s": lo,
        "to_s": hi,
        "band_hz": list(t.band_hz),
        "regime": regime,
        "ratio": t.ratio,
    }


def span_of_test(c: Comparison, t: Test) -> tuple[float, float]:
    """The stretch of time that a test of a comparison looked at [s].

    Parameters
    ----------
    c : Comparison
        To which the test belongs.
    t : Test
    """
    first, last = c.span_s
    return (first + t.span[0], first + t.span[1]) if t.span else (first, last)


def _step(c: Comparison, f: Finding) -> dict[str, Any]:
    values = {p.name: float(getattr(f.effect, p.name)) for p in f.effect.parameters()}
    first, last = c.span_s
    if values.get("duration", 0.0) > 0.0:
        first, last = values["time"], values["time"] + values["duration"]
    return {
        "effect": f.name,
        "channel": f.where,
        "probability": f.probability,
        "evidence_nats": f.evidence_nats,
        "alternatives": [{"effect": n, "channel": w, "probability": p} for n, w, p in f.alternatives],
        "indistinguishable": list(f.indistinguishable),
        "apart": [_distinguished(o) for o in f.others],
        "separator": distinguishing(f) or f.effect.separating_experiment,
        "cos2": {f"{o.effect} ({o.where})": o.cos2 for o in f.others if o.cos2 > MIN_LISTED_COS2},
        "parameters": parameters_of(c, f),
        "where": {"from_s": first, "to_s": last},
        "stands_in_because": f.objection,
        "sentence": finding_sentence(c, f),
    }


def _distinguished(o: Distinguishability) -> dict[str, Any]:
    by = {"nats": o.nats, "record_factor": o.record_factor}
    return {"effect": o.effect, "channel": o.where, "cos2": o.cos2, **by}


def parameters_of(c: Comparison, f: Finding) -> dict[str, dict[str, Any]]:
    """The parameters of a finding by name, values and intervals in SI.

    A wrong number of a model has its own name and its new value.

    Parameters
    ----------
    c : Comparison
        To which the finding belongs.
    f : Finding
    """
    out = {}
    for p in f.effect.estimated():
        value, base = float(getattr(f.effect, p.name)), f.assumed_value or 0.0
        if not c.is_at_rest and p.name not in f.ci95 and not value:
            continue  # an entry of a matrix that was not fitted
        ci95 = f.ci95.get(p.name, (np.nan, np.nan))
        entry: dict[str, Any] = {"value": base + value, "unit": _si(c, p, f.unit)}
        if c.is_at_rest or p.name in f.ci95:
            entry["ci95"] = [finite(base + v) for v in ci95]
        if f.assumed_value is not None:
            entry |= {"believed": base, "off_by": value}
        out[p.name if f.assumed_value is None else f.where] = entry
    return out


def _limit(c: Comparison, m: DetectionLimit) -> dict[str, Any]:
    p = {p.name: p for p in m.effect.parameters()}[m.parameter]
    return {
        "effect": m.effect.name,
        "channel": m.where,
        "parameter": m.parameter,
        "would_not_see_below": finite(m.value),
        "unit": _si(c, p, m.unit),
        "excited": m.is_excited,
        **({"excited_by": m.manoeuvre} if m.manoeuvre else {}),
    }


def _si(c: Comparison, p: Parameter, unit: str) -> str:
    """The SI unit of a parameter, of a channel, state or input in a unit; in the user's own spelling where that is SI."""
    if c.is_at_rest:
        return derived_unit(p.unit, parse_unit(unit).si)
    own = derived_unit(p.unit, unit)
    found = parse_unit(own)
    return own if found.factor == 1.0 and not found.offset and own.strip() else found.si
