"""What a filter file says that an autopilot has settings for: delays, arms, offsets, noise of samples, by a name each.

The file's options hold what was assumed, its effects what was found beyond it; an autopilot wants the sum.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kfgen.core.channel_names import AXES
from kfgen.core.unit_names import STANDARD_GRAVITY
from kfgen.core.units import parse_quantity
from kfgen.effects import Effect
from kfgen.effects.noise_model import SAMPLED
from kfgen.effects.process.drift import RateRamp
from kfgen.effects.process.stochastic import GaussMarkov, RateRandomWalk, WhiteNoise
from kfgen.model.filter_file import FilterFile

GNSS_PARTS = ("gnss_p", "gnss_v")
SAME_DELAY_S = 1e-3
"""Difference of two delays below which one parameter holds both."""
AXES_OF_CHANNELS = ("x", "y", "z", "N", "E", "D")
NOISE = ".noise"
"""How the name of a finding ends of which the largest counts; others are added up."""


@dataclass(frozen=True)
class SettableValue:
    """A number of a filter file.

    Parameters
    ----------
    value : float
        [SI]
    words : str
        How it comes about.
    source : tuple of str
        The effects that it holds, as ``effect of place``.
    """

    value: float
    words: str
    source: tuple[str, ...] = ()


@dataclass(frozen=True)
class SettableValues:
    """The numbers of a filter file by name, and the effects that are in none of them.

    Parameters
    ----------
    named : mapping of str to SettableValue
        ``gnss.delay``, ``gnss.arm.x``, ``mag.offset.z``, ``baro.noise``, ...
    others : tuple of str
        ``effect of place``, with what is to be said of it.
    warnings : tuple of str
    """

    named: Mapping[str, SettableValue]
    others: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    @property
    def sources(self) -> tuple[str, ...]:
        """Every effect, as ``effect of place``."""
        return tuple(dict.fromkeys((*(s for f in self.named.values() for s in f.source), *self.others)))

    @staticmethod
    def of(file: FilterFile) -> SettableValues:
        """What a filter file says beside the noise of its inertial sensors."""
        named: dict[str, SettableValue] = {}
        others: list[str] = []
        warnings: list[str] = []
        for place, effect in _placed(file):
            found = list(_findings(place, effect))
            for name, value, words in found:
                named[name] = _joined(name, named.get(name), value, words, f"{effect.name} of {place}")
            inertial = place.startswith(("gyro", "accel")) and isinstance(effect, _AT_REST)
            if not found and not inertial:
                others.append(f"{effect.name} of {place}")
        _with_options(file, named, warnings)
        return SettableValues(named, tuple(dict.fromkeys(others)), tuple(warnings))


_AT_REST = (WhiteNoise, RateRandomWalk, GaussMarkov, RateRamp)
"""Noise of inertial sensors, which `kfgen.consumers.autopilots.steps` converts or names."""


def _joined(name: str, before: SettableValue | None, value: float, words: str, source: str) -> SettableValue:
    """A finding with another one of its name: the larger noise, the sum of anything else."""
    if before is None:
        return SettableValue(value, words, (source,))
    total = max(value, before.value) if name.endswith(NOISE) else value + before.value
    return SettableValue(total, words, (*before.source, source))


def _placed(file: FilterFile) -> Iterator[tuple[str, Effect]]:
    for place, channel in (file.noise.channels if file.noise else {}).items():
        for term in channel.terms:
            yield place, term.effect


def _findings(place: str, effect: Any) -> Iterator[tuple[str, float, str]]:
    """Names, values [SI] and words of what an effect of a place is to an autopilot."""
    sensor, _, axis = place.rpartition("_")
    sensor, axis = (sensor, axis) if axis in AXES_OF_CHANNELS else (place, "")
    kind = "baro" if sensor == "baro_height" else sensor
    if effect.name == SAMPLED:
        yield f"{place}{NOISE}", float(effect.sd), "sd of a sample"
    elif effect.name == "time_delay" and kind not in ("gyro", "accel"):
        yield f"{kind}.delay", float(effect.delay), "delay found"
    elif effect.name == "lever_arm":
        for a in AXES:
            yield f"{kind}.arm.{a}", float(getattr(effect, a)), "arm found"
    elif effect.name == "hard_iron" and not effect.duration:
        for a in AXES:
            yield f"mag.offset.{a}", float(getattr(effect, a)), "hard iron"
    elif effect.name == "supply_current" and sensor == "mag" and axis:
        yield f"mag.current.{axis}", float(effect.coefficient), "field of the current"
    elif effect.name == "soft_iron":
        yield from _distortion(effect)
    elif effect.name == "scale_factor" and sensor == "accel" and axis:
        yield f"accel.scale.{axis}", 1.0 / (1.0 + float(effect.coefficient)) - 1.0, "1 / (1 + s)"
    elif effect.name == "static_pressure_error":
        # A height that reads c v^2 too much is a static pressure of -2 g c times the dynamic one.
        yield "baro.dynamic", -2.0 * STANDARD_GRAVITY * float(effect.coefficient), "-2 g c"
    elif effect.name == "declination":
        yield "mag.declination", float(effect.angle), "declination"


def _distortion(effect: Any) -> Iterator[tuple[str, float, str]]:
    """The symmetric part of the inverse of ``I + A``: what turns the field besides belongs to the mounting."""
    A = np.array([[float(getattr(effect, i + j)) for j in AXES] for i in AXES])
    inverse = np.linalg.inv(np.eye(3) + A)
    symmetric = 0.5 * (inverse + inverse.T)
    for i, a in enumerate(AXES):
        for j, b in enumerate(AXES[i:], i):
            value = float(symmetric[i, j]) - float(i == j)
            yield f"mag.distortion.{a}{b}", value, "symmetric part of (I + A)^-1"


def _with_options(file: FilterFile, named: dict[str, SettableValue], warnings: list[str]) -> None:
    """The delay and the arm that were assumed, to which what was found is added."""
    where = f"[options] of {file.name}"
    delay = parse_quantity(file.options.get("delay", "0 s"), "s", where=where)
    both = named.pop("gnss.delay", None)
    total = {}
    for part in GNSS_PARTS:
        own = named.pop(f"{part}.delay", None)
        found = [f for f in (both, own) if f]
        total[part] = SettableValue(
            delay + sum(f.value for f in found),
            "assumed delay and what was found" if found else "assumed delay",
            tuple(s for f in found for s in f.source),
        )
    p, v = (total[part] for part in GNSS_PARTS)
    if delay or p.source or v.source:
        if abs(p.value - v.value) > SAME_DELAY_S:
            warnings.append(
                f"position is {1e3 * p.value:.4g} ms late and velocity {1e3 * v.value:.4g} ms: one parameter "
                "holds both, their mean is written"
            )
        source = tuple(dict.fromkeys((*p.source, *v.source)))
        named["gnss.delay"] = SettableValue(
            0.5 * (p.value + v.value), p.words if p.source else v.words, source
        )
    arm = file.options.get("lever_arm", "")
    if arm or "gnss.arm.x" in named:
        numbers = [float(c) for c in arm.split()[:3]] if arm else [0.0] * 3
        unit = " ".join(arm.split()[3:]) or "m"
        for a, number in zip(AXES, numbers):
            assumed = parse_quantity(f"{number!r} {unit}", "m", where=where)
            found_arm = named.get(f"gnss.arm.{a}", SettableValue(0.0, ""))
            words = "assumed arm and what was found" if found_arm.source else "assumed arm"
            named[f"gnss.arm.{a}"] = SettableValue(assumed + found_arm.value, words, found_arm.source)
