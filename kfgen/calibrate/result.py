"""`Calibration`: the numbers of a calibration as a result that makes its own noise model and JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import kfgen
from kfgen.calibrate import words
from kfgen.calibrate.fit import Fitted
from kfgen.calibrate.parameters import CalibratedNumber, placed
from kfgen.core.result import Result, ShortTable
from kfgen.core.units import derived_unit, display_unit, from_si, parse_unit
from kfgen.effects import effect_named
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, write_noise

LOW_COVERAGE = 0.6
"""Share of the directions below which it is said."""
MIN_SHARE_LEFT = 0.5
"""Error of the length that is left, of what it was, above which the field was not constant."""
LARGE_MISFIT = 3.0
"""Residual over the noise above which it is said."""


@dataclass(frozen=True)
class CalibratedSensor:
    """One triad.

    Parameters
    ----------
    sensor : str
        ``accel``, ``mag`` or ``gyro``.
    unit : str
        Of its channels, as the user gave it.
    entries : tuple of CalibratedNumber
        What was fitted.
    fit : Fitted
        Their values first [SI].
    noise : NoiseModel
        White noise of the channels.
    readings : int
        Poses, samples or turns.
    coverage : float
        Share of the directions that the readings cover; of a gyro, of its axes.
    before, after : float
        Root mean square error of the length, or of the angle, without and with the calibration [SI].
    length : float
        What should have been read: gravity, the field [SI]; or the angle of a turn [rad].
    said : tuple of str
        What is to be said of the log.
    """

    sensor: str
    unit: str
    entries: tuple[CalibratedNumber, ...]
    fit: Fitted
    noise: NoiseModel
    readings: int
    coverage: float
    before: float
    after: float
    length: float
    said: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be said of it."""
        said = list(self.said)
        if self.sensor != "gyro" and self.coverage < LOW_COVERAGE:
            said.append(words.low_coverage(self.sensor, self.coverage))
        if self.sensor == "mag" and self.after > MIN_SHARE_LEFT * self.before:
            said.append(words.uneven_field(self.sensor, self.before, self.after))
        elif self.fit.misfit > LARGE_MISFIT:
            said.append(words.misfit(self.sensor, self.fit.misfit))
        return tuple(said)

    @property
    def counted(self) -> str:
        """How much was read, in words."""
        return words.readings(self.sensor, self.readings, self.coverage)

    @property
    def sentence(self) -> str:
        """What was read, and what the calibration does to its error."""
        unit = "deg" if self.sensor == "gyro" else display_unit(self.unit)
        return f"{self.sensor}: {self.counted}; {words.error_of(self.sensor, self.before, self.after, unit)}"

    def unit_of(self, entry: CalibratedNumber) -> str:
        """The unit in which an entry is shown."""
        template = {p.name: p.unit for p in effect_named(entry.effect).parameters()}[entry.parameter]
        return derived_unit(template, display_unit(self.unit))

    def rows(self) -> list[tuple[CalibratedNumber, float, float, float, str]]:
        """CalibratedNumber, value and the ends of its 95 % interval in its unit, and the unit."""
        out = []
        for entry, value, half in zip(self.entries, self.fit.values.tolist(), self.fit.half_widths.tolist()):
            unit = self.unit_of(entry)
            shown = [from_si(v, unit) for v in (value, value - half, value + half)]
            out.append((entry, *shown, unit))
        return out

    @cached_property
    def channels(self) -> Mapping[str, ChannelNoise]:
        """Its part of a noise file: white noise, and the errors with their intervals."""
        found = dict(self.noise.channels)
        ends = {
            (e.effect, e.where, e.parameter): (float(v - h), float(v + h))
            for e, v, h in zip(self.entries, self.fit.values, self.fit.half_widths)
        }
        for p in placed(self.entries, self.fit.values.tolist()):
            ci = {
                n: c for (effect, where, n), c in ends.items() if (effect, where) == (p.effect.name, p.where)
            }
            old = found.get(p.where, ChannelNoise(display_unit(self.unit), ()))
            found[p.where] = ChannelNoise(display_unit(old.unit), (*old.terms, Term(p.effect, ci)))
        return found

    def to_dict(self) -> dict[str, Any]:
        """Its entry in ``kfgen-calibrate-1``."""
        si = "rad" if self.sensor == "gyro" else parse_unit(self.unit).si
        return {
            "readings": self.readings,
            "coverage": self.coverage,
            "parameters": [
                {
                    "effect": e.effect,
                    "where": e.where,
                    "parameter": e.parameter,
                    "value": value,
                    "ci95": [lo, hi],
                    "unit": unit,
                }
                for e, value, lo, hi, unit in self.rows()
            ],
            "error": {"before": self.before, "after": self.after, "unit": si},
            "length": {"value": self.length, "unit": si},
            "residual_over_noise": self.fit.misfit,
            "warnings": list(self.warnings),
        }


@dataclass(frozen=True, repr=False)
class Calibration(Result):
    """What a log calibrates.

    Parameters
    ----------
    sensors : tuple of CalibratedSensor
    logs : tuple of (str, str)
        Source and SHA-256 of the log.
    warnings : tuple of str
    """

    sensors: tuple[CalibratedSensor, ...]
    logs: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...] = ()

    @cached_property
    def noise(self) -> NoiseModel:
        """The errors and the white noise of the sensors, as other verbs read them."""
        channels = {k: c for s in self.sensors for k, c in s.channels.items()}
        (source, sha256), *_ = self.logs
        return NoiseModel(channels, {"log": source, "sha256": sha256, "kfgen": kfgen.__version__})

    def save(self, path: str | Path) -> None:
        """Write it as a noise file (TOML), whole or not at all."""
        write_noise(self.noise, path)

    def to_dict(self) -> dict[str, Any]:
        """The JSON ``kfgen-calibrate-1``; every number with its unit."""
        source, sha256 = self.logs[0]
        return {
            "format": "kfgen-calibrate-1",
            "kfgen": kfgen.__version__,
            "log": source,
            "sha256": sha256,
            "sensors": {s.sensor: s.to_dict() for s in self.sensors},
            "warnings": list(self.warnings),
        }

    def summary(self) -> list[str]:
        """A line for each sensor."""
        return [f"{s.sensor}: {s.counted}, error {s.before:.3g} -> {s.after:.3g}" for s in self.sensors]

    def short_table(self) -> ShortTable:
        """The numbers with their intervals."""
        rows = [
            [e.where, f"{e.effect} {e.parameter}", f"{v:.4g} {unit}", f"{lo:.4g} to {hi:.4g}"]
            for s in self.sensors
            for e, v, lo, hi, unit in s.rows()
        ]
        return ("where", "parameter", "value", "95 % interval"), rows
