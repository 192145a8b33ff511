"""`Identification`: the noise of every channel of a log, as a result that makes its own noise model and JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.core.numbers import finite, quantity
from kfgen.core.result import Result, ShortTable
from kfgen.core.units import derived_unit, display_unit, from_si, parse_unit
from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, ParameterCovariance, Term, write_noise
from kfgen.identify.evidence.published import Published
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.limits import Limit
from kfgen.identify.fit.lines import PeriodicLine
from kfgen.identify.identify import Identified, records_within
from kfgen.identify.screening.left_out import LeftOut
from kfgen.identify.words import no_limit

Array = NDArray[np.float64]
Interval = tuple[float, float]


def expected_deviation(record: Evidence, effects: tuple[Effect, ...]) -> Array:
    """Allan deviation that effects give a record.

    Parameters
    ----------
    record : Evidence
        What was identified.
    effects : tuple of Effect
        Random effects add their Allan variance, deterministic ones that of their output over the record.

    Returns
    -------
    ndarray, shape (m,)
        [SI], at the averaging times ``record.curve.tau``.
    """
    tau = record.curve.tau
    random = sum((e.allan_variance(tau) for e in effects if not e.coefficients()), np.zeros(tau.size))
    return np.sqrt(random + record.drift_variance(effects))


OPEN = "the record does not close the interval: null is an end that is not known"
"""Said beside an interval with an infinite end."""


@dataclass(frozen=True)
class IdentifiedEffect:
    """One effect with what is known of its parameters.

    Parameters
    ----------
    effect : Effect
        With the estimated values [SI].
    ci95 : mapping of str to (float, float)
        95 % interval [SI] of each estimated parameter; an end that the record does not close is 0 or infinite.
    crlb_rel : mapping of str to float
        Cramér-Rao bound of each parameter: the smallest relative standard deviation that an estimate can have.
    """

    effect: Effect
    ci95: Mapping[str, Interval]
    crlb_rel: Mapping[str, float]

    @property
    def name(self) -> str:
        """The effect's name in files."""
        return self.effect.name

    @property
    def values(self) -> dict[str, float]:
        """The estimated parameters [SI]."""
        return {p.name: float(getattr(self.effect, p.name)) for p in self.effect.estimated()}

    def said(self, unit: str) -> str:
        """In words, without the channel, of an effect that has no estimated parameters; in the user's unit."""
        return "" if self.values else self.effect.sentence("", unit).strip()

    def to_dict(self, unit: str) -> dict[str, Any]:
        """Its entry in the JSON of a channel that has the SI unit `unit`."""
        units = {p.name: derived_unit(p.unit, unit) for p in self.effect.parameters()}
        chosen = [p.name for p in self.effect.parameters() if p.kind == "setting"]
        settings = {n: {"value": float(getattr(self.effect, n)), "unit": units[n]} for n in chosen}
        return {
            "effect": self.name,
            **({"settings": settings} if settings else {}),
            "parameters": {
                name: {
                    "value": value,
                    "unit": units[name],
                    "ci95": [finite(v) for v in self.ci95[name]],
                    **({"crlb_rel": finite(self.crlb_rel[name])} if name in self.crlb_rel else {}),
                    **({} if np.isfinite(self.ci95[name]).all() else {"open": OPEN}),
                }
                for name, value in self.values.items()
            },
        }


@dataclass(frozen=True, repr=False)
class IdentifiedChannel:
    """The noise of one channel.

    Parameters
    ----------
    name : str
        The channel of the log.
    unit : str
        The unit in which the user gave it.
    fitted : Identified
        The fit in full: with slow terms whose kind the record cannot tell, and the record itself.
    """

    name: str
    unit: str
    fitted: Identified

    @property
    def si(self) -> str:
        """The SI unit of its values."""
        return parse_unit(self.unit).si

    @property
    def effects(self) -> tuple[IdentifiedEffect, ...]:
        """The effects that the record shows; a drift of unknown kind is not among them."""
        found = self.fitted
        fitted = [
            IdentifiedEffect(
                e,
                {p.name: found.intervals.get((i, p.name), (0.0, np.inf)) for p in e.estimated()},
                {p.name: found.bounds[i, p.name] for p in e.estimated() if (i, p.name) in found.bounds},
            )
            for i, e in enumerate(found.fit.effects)
            if i not in found.unresolved
        ]
        outliers = [
            IdentifiedEffect(part.outliers, part.ci95, {}) for part in self.left_out[:1] if part.outliers
        ]
        response = [IdentifiedEffect(found.response, {}, {})] if found.response else []
        return (*fitted, *outliers, *response)

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Shocks and outliers of each even record, those with outliers first."""
        parts = [r.left_out for r in records_within(self.fitted.record)]
        return tuple(sorted(parts, key=lambda part: part.outliers is None))

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Effects that the record does not show, with their upper limits and the log that would show them."""
        return self.fitted.limits

    @property
    def lines(self) -> tuple[PeriodicLine, ...]:
        """Spectral lines that were left out of the fit."""
        return self.fitted.lines

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be said of the record and of the fit."""
        return self.fitted.warnings

    @property
    def covariance(self) -> ParameterCovariance | None:
        """The covariance of the logarithms of the parameters that are known."""
        found = self.fitted
        shown = [i for i in range(len(found.fit.effects)) if i not in found.unresolved]
        at = [
            k
            for k, (i, name) in enumerate(found.fit.free)
            if i in shown and 0.0 < found.intervals[i, name][0] < found.intervals[i, name][1] < np.inf
        ]
        C = found.covariance[np.ix_(at, at)] if at else np.zeros((0, 0))
        if not at or not np.isfinite(C).all():
            return None
        names = tuple((shown.index(found.fit.free[k][0]), found.fit.free[k][1]) for k in at)
        return ParameterCovariance(names, tuple(map(tuple, (0.5 * (C + C.T)).tolist())))

    @property
    def noise(self) -> ChannelNoise:
        """Its part of a noise file, in the user's unit, with closed intervals and the covariance."""
        terms = tuple(
            Term(e.effect, {name: ci for name, ci in e.ci95.items() if self._is_written(ci)})
            for e in self.effects
        )
        return ChannelNoise(display_unit(self.unit), terms, self.covariance)

    def limits_said(self, name: str) -> dict[str, str]:
        """Upper limits of what the record cannot show, by ``gyro_x rate_random_walk K``."""
        said = {}
        for limit in self.limits:
            unit = {p.name: p.unit for p in limit.effect.parameters()}[limit.parameter]
            text = quantity(limit.upper95, derived_unit(unit, display_unit(self.unit)))
            said[f"{name} {limit.effect.name} {limit.parameter}"] = (
                f"below {text} at 95 %" if limit.is_known else no_limit(limit.ended_early)
            )
        return said

    @staticmethod
    def _is_written(ci: Interval) -> bool:
        return bool(np.isfinite(ci[1]))

    def to_dict(self) -> dict[str, Any]:
        """Its entry in ``kfgen-identify-1``."""
        found, si = self.fitted, self.si
        curve, shown = found.record.curve, tuple(e.effect for e in self.effects)
        joint = self.covariance
        return {
            "unit": si,
            "duration_s": None if isinstance(found.record, Published) else found.record.duration,
            "rate_hz": 1.0 / found.record.dt,
            "effects": [e.to_dict(si) for e in self.effects],
            "not_identifiable": [_limit_data(limit, si) for limit in self.limits],
            "allan": {
                "tau_s": curve.tau.tolist(),
                "adev": curve.deviation.tolist(),
                "lo95": curve.lo.tolist(),
                "hi95": curve.hi.tolist(),
                "model": expected_deviation(found.record, shown).tolist(),
            },
            "lines": [
                {
                    "frequency_hz": line.frequency,
                    "amplitude": line.amplitude,
                    "unit": si,
                    "band_hz": list(line.band),
                    "harmonic": line.harmonic,
                    "fundamental_hz": line.fundamental or None,
                }
                for line in self.lines
            ],
            "shocks": [{"from_s": a, "to_s": b} for part in self.left_out for a, b in part.shocks],
            "covariance": joint
            and {
                "of": [f"{i}.{name}" for i, name in joint.parameters],
                "log": [list(row) for row in joint.matrix],
            },
            "warnings": list(self.warnings),
        }

    def __repr__(self) -> str:
        unit = display_unit(self.unit)
        sizes = [
            f"{name} = {from_si(value, derived_unit(p.unit, unit)):.3g} {derived_unit(p.unit, unit)}".rstrip()
            for e in self.effects
            for p, (name, value) in zip(e.effect.estimated(), e.values.items())
        ]
        sizes += [f"{e.name} ({said})" for e in self.effects if (said := e.said(unit))]
        drift = ["a drift of unknown kind"] if self.fitted.unresolved else []
        return f"{self.name}: {', '.join([*sizes, *drift])}"


def _limit_data(limit: Limit, si: str) -> dict[str, Any]:
    """The JSON of an upper limit on a channel that has the SI unit `si`."""
    parameters = limit.effect.parameters()
    unit = {p.name: p.unit for p in parameters}[limit.parameter]
    return {
        "effect": limit.effect.name,
        "parameter": limit.parameter,
        "upper95": finite(limit.upper95),
        "unit": derived_unit(unit, si),
        "log_hours_for_20_percent": finite(limit.hours),
        **({} if limit.is_known else {"open": no_limit(limit.ended_early)}),
        **{p.name + "_s": getattr(limit.effect, p.name) for p in parameters if p.kind == "time"},
    }


@dataclass(frozen=True, repr=False)
class Identification(Result):
    """The noise of the channels of a log, or of several logs of one sensor that were fitted together.

    Parameters
    ----------
    channels : mapping of str to IdentifiedChannel
        In the order of the log.
    logs : tuple of (str, str)
        Source and SHA-256 of each log.
    method : str
        How it was identified, see `kfgen.identify.methods.likelihood.METHODS`.
    warnings : tuple of str
        Of the logs, of the choice of channels, and of channels (``gyro, accel_x: warning``).
    cautions : tuple of str
        Those of them without which the numbers would be misread: motion, a search that ended early.
    """

    channels: Mapping[str, IdentifiedChannel]
    logs: tuple[tuple[str, str], ...]
    method: str
    warnings: tuple[str, ...] = ()
    cautions: tuple[str, ...] = ()

    @cached_property
    def noise(self) -> NoiseModel:
        """The noise model with intervals and covariance, ready for a filter or a file; without unresolved drifts."""
        return NoiseModel(
            {name: c.noise for name, c in self.channels.items()},
            {
                "log": ", ".join(source.rsplit("/", 1)[-1] for source, _ in self.logs),
                "sha256": ", ".join(sha256 for _, sha256 in self.logs),
                "method": self.method,
                "kfgen": kfgen.__version__,
                **self._rates(),
                **{k: v for name, c in self.channels.items() for k, v in c.limits_said(name).items()},
            },
        )

    def _rates(self) -> dict[str, str]:
        """The sampling rate, where all channels share it; a published curve has none."""
        rates = {
            c.fitted.record.dt for c in self.channels.values() if not isinstance(c.fitted.record, Published)
        }
        return {"rate": f"{1.0 / rates.pop():.6g} Hz"} if len(rates) == 1 else {}

    def to_dict(self) -> dict[str, Any]:
        """The JSON ``kfgen-identify-1``: SI values with their units."""
        source, sha256 = self.logs[0]
        return {
            "format": "kfgen-identify-1",
            "kfgen": kfgen.__version__,
            "log": source,
            "sha256": sha256,
            "logs": [{"log": log, "sha256": sha} for log, sha in self.logs],
            "channels": {name: c.to_dict() for name, c in self.channels.items()},
        }

    def save(self, path: str | Path) -> None:
        """Write the noise model as a noise file (TOML), whole or not at all."""
        write_noise(self.noise, path)

    def summary(self) -> list[str]:
        """The effects of the first channels."""
        lines = [repr(c) for c in self.channels.values()]
        return lines if len(lines) <= 5 else [*lines[:4], f"... and {len(lines) - 4} more channels"]

    def short_table(self) -> ShortTable:
        """The parameters with their intervals, in the unit of the noise file."""
        rows = []
        for name, channel in self.channels.items():
            unit = display_unit(channel.unit)
            for effect in channel.effects:
                for p in effect.effect.estimated():
                    u = derived_unit(p.unit, unit)
                    lo, hi = (
                        f"{from_si(v, u):.4g}" if np.isfinite(v) else "open" for v in effect.ci95[p.name]
                    )
                    value = quantity(effect.values[p.name], u)
                    rows.append([name, f"{effect.name} {p.name}", value, f"{lo} to {hi}"])
                rows += [[name, effect.name, said, ""]] if (said := effect.said(unit)) else []
        return ("channel", "parameter", "value", "95 % interval"), rows
