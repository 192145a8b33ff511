"""`FleetResult`: what sensors of one kind have in common, and which is not like the others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import kfgen
from kfgen.core.errors import InputError
from kfgen.core.numbers import finite
from kfgen.core.result import Result
from kfgen.core.units import display_unit
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, write_noise
from kfgen.fleet.answer import Estimated, LogAnswer, SensorNumber
from kfgen.fleet.clock import ClockFactor
from kfgen.fleet.population import MIN_SENSORS_FOR_OUTLIER, OutlyingSensor, Population

FALSE_ALARM_SHARE_OF_FLEETS = 0.01
"""Share of fleets without an outlier in which one is named, over all their numbers together."""


@dataclass(frozen=True)
class Outcome:
    """What became of one log.

    Parameters
    ----------
    log : str
        Its path.
    sha256 : str
        Of the file.
    answer : LogAnswer or None
        What it says of its sensor; None where it could not be used.
    error : str
        Why.
    warnings : tuple of str
    """

    log: str
    sha256: str = ""
    answer: LogAnswer | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def complaint(self) -> str:
        """The error with the log that it is about."""
        return self.error if self.error.startswith(self.log) else f"{self.log}: {self.error}"


@dataclass(frozen=True)
class SensorEstimate:
    """The estimate of a number from one log; of one that cannot be negative, its logarithm is normal."""

    log: str
    estimate: Estimated

    def is_closed(self, positive: bool) -> bool:
        """Whether its interval is closed: of a positive number, away from zero too."""
        e = self.estimate
        return (
            bool(np.isfinite([e.lo, e.hi]).all())
            and e.lo < e.hi
            and (not positive or min(e.lo, e.value) > 0.0)
        )


@dataclass(frozen=True)
class PooledNumber:
    """A number over the sensors that have it.

    Parameters
    ----------
    number : SensorNumber
    unit : str
        [SI]
    estimates : tuple of SensorEstimate
    population : Population or None
        Of the logarithms where the number cannot be negative; None where no interval is closed, and of what
        belongs to a record and not to its sensor.
    outliers : tuple of (SensorEstimate, OutlyingSensor)
    """

    number: SensorNumber
    unit: str
    estimates: tuple[SensorEstimate, ...]
    population: Population | None
    outliers: tuple[tuple[SensorEstimate, OutlyingSensor], ...] = ()

    def value(self, scaled: float) -> float:
        """From the scale of the population to a value [SI]."""
        return float(np.exp(scaled)) if self.number.positive else scaled

    def is_outlier(self, estimate: SensorEstimate) -> bool:
        """Whether the sensor of an estimate is not like the others in this number."""
        return any(estimate is out for out, _ in self.outliers)

    def to_dict(self) -> dict[str, Any]:
        """Its entry in ``kfgen-fleet-1``."""
        p, n = self.population, self.number
        return {
            "channel": n.channel,
            "effect": n.effect,
            "place": n.place,
            "parameter": n.parameter,
            "unit": self.unit,
            "scale": "logarithm" if n.positive else "linear",
            "values": [
                {
                    "log": s.log,
                    "value": s.estimate.value,
                    "ci95": [finite(s.estimate.lo), finite(s.estimate.hi)],
                    "outlier": self.is_outlier(s),
                }
                for s in self.estimates
            ],
            "population": p
            and {
                "sensors": p.size,
                "median": self.value(p.mean),
                "median_ci95": [finite(self.value(v)) for v in p.mean95] if p.size > 1 else None,
                "spread": p.spread,
                "spread_ci95": [finite(v) for v in p.spread95],
                "new_sensor95": [finite(self.value(v)) for v in p.next95] if p.size > 2 else None,
            },
        }


@dataclass(frozen=True)
class EffectCount:
    """In which of the logs an effect was found.

    Parameters
    ----------
    channel, effect : str
        Their names.
    logs : tuple of str
        That have it.
    of : int
        Logs that have the channel.
    """

    channel: str
    effect: str
    logs: tuple[str, ...]
    of: int

    @property
    def kind(self) -> str:
        """``common`` to all, ``one-off``, or ``some``."""
        if len(self.logs) == self.of and self.of > 1:
            return "common"
        return "one-off" if len(self.logs) == 1 else "some"


@dataclass(frozen=True, repr=False)
class FleetResult(Result):
    """What was done, what failed, and what the sensors have in common.

    Parameters
    ----------
    done, failed : tuple of Outcome
        In the order of the names of their logs.
    numbers : tuple of PooledNumber
    effects : tuple of EffectCount
    tested : int
        Numbers in which outliers were looked for.
    model, model_sha256 : str
        What every sensor was compared with, empty where they were identified; its hash where it is a file.
    clocks : tuple of ClockFactor
        Sensors that are sampled at another rate than their logs say.
    """

    done: tuple[Outcome, ...]
    failed: tuple[Outcome, ...]
    numbers: tuple[PooledNumber, ...]
    effects: tuple[EffectCount, ...]
    tested: int
    model: str = ""
    model_sha256: str = ""
    clocks: tuple[ClockFactor, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be said of the logs."""
        return tuple(f"{o.log}: {w}" for o in self.done for w in o.warnings)

    @cached_property
    def noise(self) -> NoiseModel:
        """The noise of a typical sensor: effects that most have, at the population's median.

        The interval written beside each value is that in which a new sensor lies: what ``gap`` takes it for.

        Raises
        ------
        InputError
            The logs were compared with a model, or no effect is found in more than half of them.
        """
        if self.model:
            raise InputError(
                "a typical sensor is identified, and no model is given for that", where="--output"
            )
        channels: dict[str, ChannelNoise] = {}
        for e in self.effects:
            own = [n for n in self.numbers if (n.number.channel, n.number.effect) == (e.channel, e.effect)]
            for place in sorted({n.number.place for n in own}):
                numbers = [n for n in own if n.number.place == place]
                if all(2 * len(n.estimates) > e.of and n.population for n in numbers):
                    old = channels.get(e.channel) or ChannelNoise(self._unit(e.channel), ())
                    channels[e.channel] = replace(old, terms=(*old.terms, _typical(numbers)))
        if not channels:
            raise InputError("no effect is found in more than half of the logs", remedy="Leave -o out")
        return NoiseModel(channels, {"logs": str(len(self.done)), "kfgen": kfgen.__version__})

    def _unit(self, channel: str) -> str:
        """The unit in which a channel is shown."""
        units = [o.answer.units for o in self.done if o.answer]
        return shown_unit(next(u[channel] for u in units if channel in u))

    def save(self, path: str | Path) -> None:
        """Write the noise of a typical sensor as a noise file."""
        write_noise(self.noise, path)

    def to_dict(self) -> dict[str, Any]:
        """The JSON ``kfgen-fleet-1``."""
        gap = {"model": self.model, "model_sha256": self.model_sha256 or None} if self.model else {}
        return {
            "format": "kfgen-fleet-1",
            "kfgen": kfgen.__version__,
            "task": "gap" if self.model else "identify",
            **gap,
            "logs": [self._log(o) for o in (*self.done, *self.failed)],
            "numbers": [n.to_dict() for n in self.numbers],
            "effects": [
                {
                    "channel": e.channel,
                    "effect": e.effect,
                    "found_in": len(e.logs),
                    "of": e.of,
                    "kind": e.kind,
                    "logs": list(e.logs),
                }
                for e in self.effects
            ],
            "outliers": [self._outlier(n, s, o) for n in self.numbers for s, o in n.outliers],
            "clocks": [
                {"log": c.log, "factor": c.factor, "ci95": list(c.ci95), "by": list(c.by)}
                for c in self.clocks
            ],
            "outlier_rate": FALSE_ALARM_SHARE_OF_FLEETS,
            "outliers_tested": {"numbers": self.tested, "from_sensors": MIN_SENSORS_FOR_OUTLIER},
        }

    def _log(self, o: Outcome) -> dict[str, Any]:
        out: dict[str, Any] = {"log": o.log, "sha256": o.sha256 or None}
        if o.answer is None:
            return out | {"error": o.error}
        return out | ({"verdict": o.answer.verdict} if self.model else {}) | {"warnings": list(o.warnings)}

    def _outlier(self, n: PooledNumber, s: SensorEstimate, o: OutlyingSensor) -> dict[str, Any]:
        return {
            "log": s.log,
            "channel": n.number.channel,
            "effect": n.number.effect,
            "place": n.number.place,
            "parameter": n.number.parameter,
            "value": s.estimate.value,
            "unit": n.unit,
            "deviations": o.deviations,
            "p_adjusted": self.adjusted(o),
        }

    def adjusted(self, outlier: OutlyingSensor) -> float:
        """The p-value of an outlier, for all numbers that were tested."""
        return min(1.0, outlier.p * self.tested)

    def __repr__(self) -> str:
        outlying = dict.fromkeys(s.log for n in self.numbers for s, _ in n.outliers)
        said = [f"{len(self.done)} logs", f"{len(self.failed)} failed" if self.failed else ""]
        said += [", ".join(f"{e.channel} {e.effect} in {len(e.logs)}" for e in self.effects)]
        said += [f"not like the others: {', '.join(outlying)}" if outlying else ""]
        return f"FleetResult({'; '.join(s for s in said if s)})"


def shown_unit(unit: str) -> str:
    """The unit in which a person reads a number of an SI unit: degrees, microtesla."""
    if unit.startswith("rad"):
        return "deg" + unit[3:]
    return display_unit(unit)


def _typical(numbers: list[PooledNumber]) -> Term:
    """An effect at the medians of its parameters, with the intervals of a new sensor."""
    values: dict[str, float] = {}
    ci95: dict[str, tuple[float, float]] = {}
    for n in numbers:
        assert n.population is not None
        values[n.number.parameter] = n.value(n.population.mean)
        lo, hi = (n.value(v) for v in n.population.next95)
        if n.population.size > 2 and np.isfinite([lo, hi]).all():
            ci95[n.number.parameter] = (lo, hi)
    return Term(make(numbers[0].number.effect, **values), ci95)
