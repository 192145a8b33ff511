"""The answer of ``identify``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.core.numbers import finite, quantity
from kfgen.core.units import derived_unit, display_unit, from_si, parse_unit
from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, ParameterCovariance, Term
from kfgen.identify.evidence.published import Published
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.limits import Limit
from kfgen.identify.identify import Identified
from kfgen.log.log import Log, StoredLog
from kfgen.report.convert import meaning_parts
from kfgen.report.page import Answer, Page, columns, figure, heading, sentence, table, text
from kfgen.report.plots import AFTER, BEFORE, Line, Panel, panels_picture

Array = NDArray[np.float64]


def noise_model(
    logs: Sequence[Log | StoredLog], found: Mapping[str, Identified], method: str = "ml"
) -> NoiseModel:
    """The noise file of what was identified; unresolved drifts are not in it."""
    channels, log = {}, logs[0]
    for name, result in found.items():
        terms = []
        for i, effect in enumerate(result.fit.effects):
            if i not in result.unresolved:
                ci95 = {p: ci for (k, p), ci in result.intervals.items() if k == i and np.isfinite(ci[1])}
                terms.append(Term(effect, ci95))
        unit = display_unit(log.channel(name).unit)
        channels[name] = ChannelNoise(unit, tuple(terms), _covariance(result))
    return NoiseModel(
        channels,
        {
            "log": ", ".join(d.source.rsplit("/", 1)[-1] for d in logs),
            "sha256": ", ".join(d.sha256 for d in logs),
            "method": method,
            "kfgen": kfgen.__version__,
        },
    )


def _covariance(result: Identified) -> ParameterCovariance | None:
    """The covariance of the logarithms of what is written and known."""
    written = [i for i in range(len(result.fit.effects)) if i not in result.unresolved]
    at = [
        k
        for k, (i, name) in enumerate(result.fit.free)
        if i in written and 0.0 < result.intervals[i, name][0] < result.intervals[i, name][1] < np.inf
    ]
    C = result.covariance[np.ix_(at, at)] if at else np.zeros((0, 0))
    if not at or not np.isfinite(C).all():
        return None
    names = tuple((written.index(result.fit.free[k][0]), result.fit.free[k][1]) for k in at)
    return ParameterCovariance(names, tuple(map(tuple, (0.5 * (C + C.T)).tolist())))


def expected_deviation(record: Evidence, effects: tuple[Effect, ...]) -> Array:
    """Allan deviation [SI] that effects give a record at the averaging times of its curve, shape (m,)."""
    tau = record.curve.tau
    random = sum((e.allan_variance(tau) for e in effects if not e.coefficients()), np.zeros(tau.size))
    return np.sqrt(random + record.drift_variance(effects))


def identify_answer(logs: Sequence[Log | StoredLog], found: Mapping[str, Identified]) -> Answer:
    """Text, JSON and page of the channels of a log, or of several of one sensor."""
    lines, parts, log = [], [], logs[0]
    warnings = [w for d in logs for w in d.warnings]
    for name, result in found.items():
        unit = display_unit(log.channel(name).unit)
        rows, missing = _rows(result, unit), _missing(result, unit)
        lines += ["", f"{name}: {result.record.words}", columns(rows)]
        lines += [f"  {line}" for line in missing]
        warnings += [f"{name}: {w}" for w in result.warnings]
        parts += [
            heading(name),
            *(
                sentence(f"{e.sentence(name, unit)}.")
                for i, e in enumerate(result.fit.effects)
                if i not in result.unresolved
            ),
            figure(
                _picture(result, unit, name),
                f"Allan deviation of {name}, {result.record.words}; the curve is the identified model.",
            ),
            table(("effect", "parameter", "value", "95 % interval", "Cramér-Rao bound"), rows),
            *meaning_parts(name, resolved(result), unit),
            *(text(m) for m in missing),
            *(text(w) for w in result.warnings),
        ]
    page = Page(f"Sensor noise in {log.source.rsplit('/', 1)[-1]}", tuple(parts))
    data = identify_data(logs, found)
    return Answer("\n".join(lines).lstrip("\n"), data, page, warnings=tuple(warnings))


def identify_data(logs: Sequence[Log | StoredLog], found: Mapping[str, Identified]) -> dict[str, Any]:
    """The interface's JSON."""
    log = logs[0]
    return {
        "format": "kfgen-identify-1",
        "kfgen": kfgen.__version__,
        "log": log.source,
        "sha256": log.sha256,
        "logs": [{"log": d.source, "sha256": d.sha256} for d in logs],
        "channels": {name: _channel(result, log.channel(name).si) for name, result in found.items()},
    }


def _rows(result: Identified, unit: str) -> list[list[str]]:
    rows = []
    for i, effect in enumerate(result.fit.effects):
        for p in effect.estimated():
            if i in result.unresolved:
                continue
            u = derived_unit(p.unit, unit)
            lo, hi = result.intervals.get((i, p.name), (0.0, np.inf))
            bound = result.bounds.get((i, p.name))
            rows.append(
                [
                    effect.name,
                    p.name,
                    quantity(float(getattr(effect, p.name)), u),
                    f"95 % {from_si(lo, u):.4g} to {from_si(hi, u):.4g}",
                    f"bound {100 * bound:.2g} %" if bound is not None else "",
                ]
            )
    return rows


def one_line(result: Identified, unit: str) -> str:
    """What was found of a channel, in one line."""
    parts = []
    for effect in resolved(result):
        sizes = [
            f"{p.name} {quantity(float(getattr(effect, p.name)), derived_unit(p.unit, unit))}"
            for p in effect.estimated()
        ]
        parts.append(sizes[0] if len(sizes) == 1 else f"{effect.name} ({', '.join(sizes)})")
    parts += [f"line {line.frequency:.3g} Hz" for line in result.lines]
    return ", ".join(parts) + ("; a drift of unknown kind" if result.unresolved else "")


def _missing(result: Identified, unit: str) -> list[str]:
    """Lines that were found, then what the record cannot show."""
    lines = [
        f"line at {line.frequency:.4g} Hz, amplitude {quantity(line.amplitude, unit)}, taken out of the fit"
        for line in result.lines
    ]
    return lines + [_limit(limit, result, unit) for limit in result.limits]


def _limit(limit: Limit, result: Identified, unit: str) -> str:
    u = derived_unit({p.name: p.unit for p in limit.effect.parameters()}[limit.parameter], unit)
    times = [
        f" (at {p.name} = {getattr(limit.effect, p.name):.3g} s)"
        for p in limit.effect.parameters()
        if p.kind == "time"
    ]
    hours = f"{limit.hours:.2g} h" if np.isfinite(limit.hours) else "more than any log"
    return (
        f"not identifiable in {result.record.longest:.0f} s: {limit.effect.name} {limit.parameter} below "
        f"{quantity(limit.upper95, u)}{''.join(times)} at 95 %; {hours} would show half of that to 20 %"
    )


def resolved(result: Identified) -> tuple[Effect, ...]:
    """The effects that are written to a noise file."""
    return tuple(e for i, e in enumerate(result.fit.effects) if i not in result.unresolved)


def _picture(result: Identified, unit: str, name: str) -> str:
    return panels_picture([panel(result, unit, "")], f"allan-{name}")


def panel(result: Identified, unit: str, title: str) -> Panel:
    """The Allan deviation of a channel with its model, as a panel of a picture."""
    curve = result.record.curve
    seen = curve.tau >= 0.999 * result.record.dt  # of a published curve the first points may be left out
    tau = curve.tau[seen]
    written = expected_deviation(result.record, resolved(result))[seen]
    lines = [Line("model, as written", tau, written, AFTER)]
    if result.unresolved:
        whole = expected_deviation(result.record, result.fit.effects)[seen]
        lines.append(Line("with the drift that is not resolved", tau, whole, BEFORE, dashed=True))
    return Panel(curve, lines, unit, parse_unit(unit).factor, title)


def _channel(result: Identified, si: str) -> dict[str, Any]:
    curve = result.record.curve
    effects = []
    for i, effect in enumerate(result.fit.effects):
        if i not in result.unresolved:
            effects.append(
                {
                    "effect": effect.name,
                    "parameters": {
                        p.name: _parameter(result, i, effect, p.name, derived_unit(p.unit, si))
                        for p in effect.estimated()
                    },
                }
            )
    missing = [
        {
            "effect": m.effect.name,
            "parameter": m.parameter,
            "upper95": finite(m.upper95),
            "unit": derived_unit({p.name: p.unit for p in m.effect.parameters()}[m.parameter], si),
            "log_hours_for_20_percent": finite(m.hours),
            **{p.name + "_s": getattr(m.effect, p.name) for p in m.effect.parameters() if p.kind == "time"},
        }
        for m in result.limits
    ]
    return {
        "unit": si,
        "duration_s": None if isinstance(result.record, Published) else result.record.duration,
        "rate_hz": 1.0 / result.record.dt,
        "effects": effects,
        "not_identifiable": missing,
        "allan": {
            "tau_s": curve.tau.tolist(),
            "adev": curve.deviation.tolist(),
            "lo95": curve.lo.tolist(),
            "hi95": curve.hi.tolist(),
            "model": expected_deviation(result.record, resolved(result)).tolist(),
        },
        "lines": [
            {"frequency_hz": line.frequency, "amplitude": line.amplitude, "unit": si} for line in result.lines
        ],
        "covariance": _joint_data(result),
        "warnings": list(result.warnings),
    }


def _joint_data(result: Identified) -> dict[str, Any] | None:
    joint = _covariance(result)
    if joint is None:
        return None
    return {"of": [f"{i}.{name}" for i, name in joint.parameters], "log": [list(row) for row in joint.matrix]}


def _parameter(result: Identified, i: int, effect: Effect, name: str, unit: str) -> dict[str, Any]:
    lo, hi = result.intervals.get((i, name), (0.0, float("inf")))
    entry: dict[str, Any] = {
        "value": float(getattr(effect, name)),
        "unit": unit,
        "ci95": [finite(lo), finite(hi)],
    }
    if (i, name) in result.bounds:
        entry["crlb_rel"] = finite(result.bounds[i, name])
    return entry
