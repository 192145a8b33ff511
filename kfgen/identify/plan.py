"""The verb `plan`: how long to log for a wanted accuracy, by the Cramér-Rao bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import kfgen
from kfgen.core.errors import InputError
from kfgen.core.numbers import finite, is_sampling_rate
from kfgen.core.result import Result, ShortTable
from kfgen.effects import Effect
from kfgen.effects.noise_model import NoiseModel, read_noise
from kfgen.identify.evidence.whittle import density_of_differences
from kfgen.identify.fit.bounds import relative_bound, seconds_for
from kfgen.identify.words import MAX_RECORD_HOURS, record_length

RECORD_HOURS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Lengths of records [h] at which the bound is said."""
MIN_RECORD_SAMPLES = 64


PROBED_RAD = np.array([0.1, 1.0, 3.0])
"""Phase angles between samples at which there must be noise."""
MIN_WANTED = 1e-6
"""Relative standard deviation that may be asked for."""


@dataclass(frozen=True)
class ParameterBound:
    """The smallest relative standard deviation of an unbiased estimate of a parameter.

    Parameters
    ----------
    bounds : tuple of float
        At each of `RECORD_HOURS`; infinite where a record tells nothing.
    hours_for_wanted : float
        Length of the record [h] from which the wanted accuracy can be had; infinite where none is long enough.
    """

    bounds: tuple[float, ...]
    hours_for_wanted: float

    def to_dict(self) -> dict[str, Any]:
        """Its numbers; null where they are infinite."""
        return {
            "hours": list(RECORD_HOURS),
            "bound_rel": [finite(b) for b in self.bounds],
            "hours_for_wanted": finite(self.hours_for_wanted),
        }


@dataclass(frozen=True, repr=False)
class RecordPlan(Result):
    """How well each parameter of a noise model can be known from records of increasing length.

    Parameters
    ----------
    rate : float
        Sampling rate of the record [Hz].
    wanted : float
        Relative standard deviation that is asked for.
    channels : mapping of str to mapping of str to ParameterBound
        By channel, then by effect and parameter.
    """

    rate: float
    wanted: float
    channels: Mapping[str, Mapping[str, ParameterBound]]

    def summary(self) -> list[str]:
        """For each channel the record that is long enough for every parameter."""
        said = []
        for name, rows in self.channels.items():
            hours = max((b.hours_for_wanted for b in rows.values()), default=0.0)
            long = record_length(hours) or f"no record of {MAX_RECORD_HOURS:g} h is long enough"
            said.append(f"{name}: {long} for {100 * self.wanted:g} % of every parameter at {self.rate:g} Hz")
        return said[:5]

    def short_table(self) -> ShortTable:
        """The length of the record that each parameter takes."""
        rows = [
            [name, label, hours_text(b)] for name, own in self.channels.items() for label, b in own.items()
        ]
        return ("channel", "parameter", f"record for {100 * self.wanted:g} %"), rows

    def to_dict(self) -> dict[str, Any]:
        """The bounds by channel and parameter."""
        channels = {
            name: {label: b.to_dict() for label, b in own.items()} for name, own in self.channels.items()
        }
        return {
            "format": "kfgen-plan-1",
            "kfgen": kfgen.__version__,
            "rate_hz": self.rate,
            "wanted": self.wanted,
            "channels": channels,
        }


def hours_text(bound: ParameterBound) -> str:
    """The length of the record for the wanted accuracy, in words."""
    return record_length(bound.hours_for_wanted) or f"more than {MAX_RECORD_HOURS:g} h"


def plan(noise: NoiseModel | str | Path, rate: float = 100.0, wanted: float = 0.2) -> RecordPlan:
    """How long to log for a wanted accuracy of every parameter of a noise model.

    Parameters
    ----------
    noise : NoiseModel or path-like
        The effects of the channels, as they are assumed before the record is made.
    rate : float
        Sampling rate of the record [Hz].
    wanted : float
        Relative standard deviation that is asked for, 0.2 for 20 %.

    Returns
    -------
    RecordPlan

    Raises
    ------
    InputError
        A rate or an accuracy that is not positive, or a noise file that cannot be read.
    """
    if not MIN_WANTED <= wanted < 10.0 or not is_sampling_rate(rate):
        raise InputError(
            f"a plan for an accuracy of {wanted:g} at {rate:g} Hz cannot be made",
            remedy="Give positive numbers of a sensor, --wanted 0.2 --rate 100 for example",
        )
    model = noise if isinstance(noise, NoiseModel) else read_noise(noise)
    for name, c in model.channels.items():
        random = [e for e in c.effects if not e.coefficients()]
        if random and not (density_of_differences(random, PROBED_RAD, 1.0 / rate, 1) > 0.0).all():
            raise InputError(
                f"the noise of {name} is zero: no record is long enough for it",
                where="" if isinstance(noise, NoiseModel) else str(noise),
                remedy="Give its effects a size, white_noise above all",
            )
    return RecordPlan(
        rate, wanted, {name: _bounds(c.effects, rate, wanted) for name, c in model.channels.items()}
    )


def _bounds(effects: Sequence[Effect], rate: float, wanted: float) -> dict[str, ParameterBound]:
    lengths = [max(MIN_RECORD_SAMPLES, round(h * 3600.0 * rate)) for h in RECORD_HOURS]
    bounds = [relative_bound(effects, 1.0 / rate, n) for n in lengths]
    out = {}
    for key in bounds[0]:
        before = sum(e.name == effects[key[0]].name for e in effects[: key[0]])
        label = f"{effects[key[0]].name}{f'_{before + 1}' if before else ''} {key[1]}"
        hours = seconds_for(effects, 1.0 / rate, key, wanted) / 3600.0
        out[label] = ParameterBound(tuple(float(b[key]) for b in bounds), hours)
    return out
