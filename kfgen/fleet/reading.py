"""`LogReading`: what one log says of one number, as the answers of ``identify`` and ``gap`` give it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kfgen.effects import catalogue
from kfgen.effects.effect import POSITIVE


@dataclass(frozen=True, order=True)
class ReadNumber:
    """A number that the sensors of a fleet have in common: where, of what, which.

    Parameters
    ----------
    place : int
        Of several effects of one name in a channel, which; from 1.
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
        return self._kinds().get(self.parameter, "") in POSITIVE

    @property
    def lasting(self) -> bool:
        """Whether it belongs to the sensor: a phase, and all of what happened at a time, belong to the record."""
        return self.parameter != "phase" and "time" not in self._kinds()

    def _kinds(self) -> dict[str, str]:
        known = catalogue().get(self.effect)
        return {p.name: p.kind for p in known.parameters()} if known else {}


@dataclass(frozen=True)
class LogReading:
    """A value [SI] with its 95 % interval; of a number that cannot be negative, in its logarithm they are normal."""

    log: str
    value: float
    lo: float
    hi: float
    unit: str

    def known(self, positive: bool) -> bool:
        """Whether the interval is closed."""
        return (
            bool(np.isfinite([self.lo, self.hi]).all())
            and self.lo < self.hi
            and (not positive or min(self.lo, self.value) > 0.0)
        )


@dataclass(frozen=True)
class Found:
    """An effect that a log has in a channel."""

    channel: str
    effect: str


def readings_of(log: str, data: Mapping[str, Any]) -> list[tuple[ReadNumber, LogReading]]:
    """Every number that an answer (``kfgen-identify-1`` or ``kfgen-gap-1``) gives."""
    out = []
    for found, place, parameters in _effects(data):
        for name, p in parameters.items():
            lo, hi = (np.nan if v is None else float(v) for v in p.get("ci95") or (None, None))
            number = ReadNumber(found.channel, found.effect, place, name)
            out.append((number, LogReading(log, float(p["value"]), lo, hi, str(p.get("unit", "")))))
    return out


def effects_of(data: Mapping[str, Any]) -> list[Found]:
    """The effects that an answer names, each once."""
    return list(dict.fromkeys(found for found, _, _ in _effects(data)))


def _effects(data: Mapping[str, Any]) -> list[tuple[Found, int, Mapping[str, Any]]]:
    """Each effect with its place among those of its name, the fastest first, and its parameters."""
    named: Sequence[tuple[str, Mapping[str, Any]]] = [
        (channel, e) for channel, c in data.get("channels", {}).items() for e in c["effects"]
    ] + [(s["channel"], s) for s in data.get("steps", ())]
    out: list[tuple[Found, int, Mapping[str, Any]]] = []
    for channel, e in sorted(named, key=lambda pair: _time(pair[1])):
        found = Found(channel, e["effect"])
        out.append((found, 1 + sum(f == found for f, _, _ in out), e.get("parameters", {})))
    return out


def _time(e: Mapping[str, Any]) -> float:
    """The time by which effects of one name are put in order."""
    given = e.get("parameters", {})
    known = catalogue().get(e["effect"])
    for p in known.parameters() if known else ():
        if p.name in given and p.kind in ("time", "frequency"):
            value = float(given[p.name]["value"])
            return value if p.kind == "time" else 1.0 / max(value, 1e-300)
    return 0.0
