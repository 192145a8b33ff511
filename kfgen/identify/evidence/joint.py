"""Several records of one sensor, as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.identify.evidence.allan import AllanCurve, allan_curve, log_factors, overlapping_variance, pooled
from kfgen.identify.evidence.record import Evidence, Peaks, Record
from kfgen.identify.evidence.whittle import Ordinates

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointRecord(Evidence):
    """Several records of one sensor: one noise, and a constant of its own in each.

    Raises
    ------
    InputError
        Their sampling periods differ by more than one percent: of several logs, or along one.
    """

    records: tuple[Record, ...]

    def __post_init__(self) -> None:
        periods = [r.dt for r in self.records]
        if max(periods) <= 1.01 * min(periods):
            return
        rates = f"{1 / max(periods):.4g} to {1 / min(periods):.4g} Hz"
        if _of_one_log(self.records):
            raise InputError(
                f"the sampling rate drifts along the log, from part to part {rates}",
                remedy="Give the sensor's rate with --rate HZ if only the time stamps drift, or cut the log into parts "
                "of one rate",
            )
        raise InputError(
            f"the logs are sampled at {rates}", remedy="Fit logs of one rate together, the others separately"
        )

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float(np.mean([r.dt for r in self.records]))

    @property
    def lengths(self) -> tuple[int, ...]:
        """Samples of each."""
        return tuple(r.n for r in self.records)

    @property
    def skip(self) -> tuple[tuple[float, float], ...]:
        """Bands [Hz] that are left out of some record."""
        return tuple(dict.fromkeys(band for r in self.records for band in r.skip))

    def drift_variance(self, effects: Sequence[Effect]) -> Array:
        """The Allan variance [U^2] of deterministic effects: of each record, weighted by its samples."""
        m = np.round(self.curve.tau / self.dt).astype(np.int64)
        total, weight = np.zeros((2, m.size))
        for r in self.records:
            known = m <= r.n // 3
            total[known] += r.n * overlapping_variance(r.drift(effects), m[known])
            weight[known] += r.n
        return np.asarray(total / weight)

    @property
    def words(self) -> str:
        """How many and how much."""
        return f"{len(self.records)} records, {super().words}"

    @property
    def step(self) -> float:
        """The longest block [s]."""
        return max(r.step for r in self.records)

    @property
    def scale(self) -> float:
        """Largest standard deviation of a record [SI]."""
        return max(r.scale for r in self.records)

    @cached_property
    def adc_step(self) -> float:
        """The largest step of their ADC grids [SI], zero where the samples of one lie on none."""
        steps = [r.adc_step for r in self.records]
        return max(steps) if all(steps) else 0.0

    @property
    def driven(self) -> Mapping[str, float]:
        """The drivers that every record has."""
        shared = set.intersection(*(set(r.driven) for r in self.records))
        return {k: float(np.mean([r.driven[k] for r in self.records])) for k in sorted(shared)}

    @cached_property
    def curve(self) -> AllanCurve:
        """The Allan deviation of all: variances weighted by their degrees of freedom."""
        m = log_factors(max(r.n for r in self.records))
        return pooled([allan_curve(r.y, r.dt, m[m <= r.n // 3]) for r in self.records])

    @cached_property
    def octaves(self) -> AllanCurve:
        """The same at octaves."""
        return pooled([r.octaves for r in self.records])

    def ordinates(self, effects: Sequence[Effect], peaks: Peaks | None = None) -> Ordinates:
        """The ordinates of all records together: they are independent. See `Evidence.ordinates`."""
        parts = [r.ordinates(effects, peaks) for r in self.records]
        first = parts[0]
        return replace(
            first,
            omega=np.concatenate([p.omega for p in parts]),
            count=np.concatenate([p.count for p in parts]),
            gram=np.concatenate([p.gram for p in parts]),
        )


def records_of(evidence: Evidence) -> tuple[Record, ...]:
    """The even records that it is made of.

    Raises
    ------
    TypeError
        It is not made of such.
    """
    if isinstance(evidence, JointRecord):
        return evidence.records
    if isinstance(evidence, Record):
        return (evidence,)
    raise TypeError(f"{type(evidence).__name__} is not made of even records")


def _of_one_log(records: Sequence[Record]) -> bool:
    """Whether they are parts of one log: switched on at one time, and each before the next."""
    ordered = sorted(records, key=lambda r: float(r.t[0]))
    follow = all(a.t[-1] < b.t[0] for a, b in pairwise(ordered))
    return follow and len({r.since for r in records}) == 1
