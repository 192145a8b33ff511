"""`LogAnswer`: what one log says of its sensor, from an identification or from a gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kfgen.core.units import derived_unit
from kfgen.effects import Parameter, catalogue
from kfgen.effects.effect import POSITIVE
from kfgen.identify.identification import Identification


@dataclass(frozen=True, order=True)
class SensorNumber:
    """A number that the sensors of a fleet have in common: where, of what, which.

    Parameters
    ----------
    channel, effect, parameter : str
        Their names.
    place : int
        Of several effects of one name in a channel, which; from 1, the fastest first.
    """

    channel: str
    effect: str
    place: int
    parameter: str

    @property
    def label(self) -> str:
        """``gauss_markov tau``, ``gauss_markov_2 tau``."""
        return f"{self.effect}{f'_{self.place}' if self.place > 1 else ''} {self.parameter}"

    @property
    def positive(self) -> bool:
        """Whether it is compared by ratios: the catalogue says it cannot be negative."""
        parameters = _parameters(self.effect)
        return self.parameter in parameters and parameters[self.parameter].kind in POSITIVE

    @property
    def lasting(self) -> bool:
        """Whether it belongs to the sensor: a phase, and all of what happened at a time, belong to the record."""
        parameters = _parameters(self.effect)
        is_phase = self.parameter in parameters and parameters[self.parameter].is_phase
        return not is_phase and "time" not in parameters


@dataclass(frozen=True)
class Estimated:
    """A value [SI] with its 95 % interval, not a number where an end is not known; its unit."""

    value: float
    lo: float
    hi: float
    unit: str


@dataclass(frozen=True)
class FoundEffect:
    """An effect in a channel of one log, with its estimated parameters."""

    channel: str
    effect: str
    parameters: Mapping[str, Estimated]

    @property
    def time_constant(self) -> float:
        """The time [s] by which effects of one name are put in order; zero where there is none."""
        for name, parameter in _parameters(self.effect).items():
            if name in self.parameters and parameter.kind in ("time", "frequency"):
                value = self.parameters[name].value
                return value if parameter.kind == "time" else 1.0 / max(value, 1e-300)
        return 0.0


@dataclass(frozen=True)
class Frequencies:
    """What of a channel's spectrum a wrong sampling rate would shift.

    Parameters
    ----------
    lines : tuple of float
        Frequencies of spectral lines [Hz].
    corner : float
        From which an internal low-pass takes power away [Hz]; zero without one.
    """

    lines: tuple[float, ...] = ()
    corner: float = 0.0


@dataclass(frozen=True)
class LogAnswer:
    """What one log says.

    Parameters
    ----------
    effects : tuple of FoundEffect
        In the order of the channels.
    units : mapping of str to str
        SI unit of every channel that was looked at; empty where that is not said (a gap).
    verdict : str
        Of a gap.
    frequencies : mapping of str to Frequencies
        Of every channel of an identification.
    """

    effects: tuple[FoundEffect, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    verdict: str = ""
    frequencies: Mapping[str, Frequencies] = field(default_factory=dict)

    @property
    def numbers(self) -> list[tuple[SensorNumber, Estimated]]:
        """Every number that it gives; of effects of one name in a channel the fastest first."""
        out: list[tuple[SensorNumber, Estimated]] = []
        count: dict[tuple[str, str], int] = {}
        for e in sorted(self.effects, key=lambda e: e.time_constant):
            place = count[e.channel, e.effect] = count.get((e.channel, e.effect), 0) + 1
            out += [(SensorNumber(e.channel, e.effect, place, n), p) for n, p in e.parameters.items()]
        return out

    @property
    def names(self) -> list[tuple[str, str]]:
        """Channel and name of the effects, each once, the fastest first."""
        ordered = sorted(self.effects, key=lambda e: e.time_constant)
        return list(dict.fromkeys((e.channel, e.effect) for e in ordered))


def answer_of_identification(found: Identification) -> LogAnswer:
    """What an identification says of the sensor."""
    effects = [
        FoundEffect(
            name,
            e.name,
            {
                p.name: _estimated(e.values[p.name], *e.ci95[p.name], derived_unit(p.unit, channel.si))
                for p in e.effect.estimated()
            },
        )
        for name, channel in found.channels.items()
        for e in channel.effects
    ]
    frequencies = {
        name: Frequencies(tuple(line.frequency for line in c.lines), _corner(c.fitted.record.skip))
        for name, c in found.channels.items()
    }
    return LogAnswer(
        tuple(effects), {name: c.si for name, c in found.channels.items()}, frequencies=frequencies
    )


def _corner(skip: Sequence[tuple[float, float]]) -> float:
    """Where a band that is left out up to any frequency begins: at an internal low-pass."""
    return min((lo for lo, hi in skip if hi == float("inf")), default=0.0)


def answer_of_gap(data: Mapping[str, Any]) -> LogAnswer:
    """What a gap says of the sensor, from its JSON ``kfgen-gap-1``."""
    effects = []
    for step in data["steps"]:
        parameters = {}
        for name, p in step.get("parameters", {}).items():
            lo, hi = (np.nan if v is None else float(v) for v in p.get("ci95") or (None, None))
            parameters[name] = Estimated(float(p["value"]), lo, hi, str(p.get("unit", "")))
        effects.append(FoundEffect(step["channel"], step["effect"], parameters))
    return LogAnswer(tuple(effects), verdict=str(data["verdict"]))


def _estimated(value: float, lo: float, hi: float, unit: str) -> Estimated:
    """An estimate; an end of its interval that is infinite is not known."""
    lo, hi = (v if np.isfinite(v) else float("nan") for v in (lo, hi))
    return Estimated(value, lo, hi, unit)


def _parameters(effect: str) -> dict[str, Parameter]:
    """Each parameter of an effect of the catalogue by its name."""
    known = catalogue().get(effect)
    return {p.name: p for p in known.parameters()} if known else {}
