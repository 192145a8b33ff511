"""`Effect`: a physical effect, declared once.

A subclass states its name, its parameters and its `LinearSystem`; Allan variance, spectrum, simulation, likelihood,
filter states, report row and sentence follow from that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import derived_unit, from_si, parse_quantity
from kfgen.effects import linear_system as law
from kfgen.effects.filter_role import FilterPlace, FilterRole, LinearStates
from kfgen.effects.linear_system import LinearSystem
from kfgen.effects.parameter import Parameter as Parameter  # noqa: PLC0414 - declarations import both from here
from kfgen.effects.parameter import parameter as parameter  # noqa: PLC0414
from kfgen.effects.series import OF_A_COEFFICIENT, DetectedFault, Detection, OnGrid, RawSamples, WhiteSeries

Array = NDArray[np.float64]

POSITIVE = ("size", "time", "frequency", "corner", "ratio", "slope", "width")
"""Kinds of parameters that are not below zero."""


@dataclass(frozen=True)
class Meaning:
    """Another name, with another definition, under which a file may give a parameter.

    Parameters
    ----------
    name : str
        The explicit name.
    unit : str
        Unit template of the number under that name.
    parameter : str
        The parameter that it determines.
    title, users : str
        Its definition in words, and who writes it so.
    to : callable
        The parameter from the number and the parameters known so far [SI].
    back : callable
        The number from an effect [SI].
    """

    name: str
    unit: str
    parameter: str
    title: str
    users: str
    to: Callable[[float, Mapping[str, float]], float]
    back: Callable[[Any], float]


@dataclass(frozen=True)
class Look:
    """A first look at a record, from which an effect guesses where a fit of it should start.

    Parameters
    ----------
    tau, deviation : ndarray, shape (m,)
        Allan deviation [U] at averaging times [s].
    dt, duration : float
        Sampling period and length [s].
    drive : mapping of str to float
        Mean of each recorded driver [SI].
    """

    tau: Array
    deviation: Array
    dt: float
    duration: float
    drive: Mapping[str, float]


OBLIGATIONS = {"form": "what it adds to a channel at rest", "in_filter": "what it is in a filter"}
"""What every named effect says itself or by its family; one that is silent does not import."""


@dataclass(frozen=True)
class Effect:
    """One declared effect with the values of its parameters [SI], numbers or sympy symbols."""

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""
    sentence_template: ClassVar[str] = ""
    separating_experiment: ClassVar[str] = ""
    driver: ClassVar[str] = ""
    repeatable: ClassVar[bool] = False
    is_filter: ClassVar[bool] = False
    is_measured: ClassVar[bool] = False
    """Of a filter: whether its gain is that of the samples themselves, with what is added behind it."""
    shrinks_with_size: ClassVar[bool] = False
    prior_penalty_nats: ClassVar[float] = 0.0
    changes_samples: ClassVar[bool] = False
    typical: ClassVar[Mapping[str, str]] = {}
    """Usual size of each of its numbers by the beginning of a channel, ``""`` for all others; none where there is none."""
    meanings: ClassVar[tuple[Meaning, ...]] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        silent = [n for n in OBLIGATIONS if cls.name and getattr(cls, n) is getattr(Effect, n)]
        if silent:
            name, cls.name = cls.name, ""  # no effect of the catalogue
            raise TypeError(f"the effect {name} does not say {OBLIGATIONS[silent[0]]}: define {silent[0]}()")

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """The linear stochastic system that it adds to a channel at rest.

        Parameters
        ----------
        drive : mapping
            The recorded driver by name: a number, an array over time, or a symbol.
        """
        raise NotImplementedError

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """What it is in a filter at a place; `NotModelled`, with a remedy, where no filter models it.

        Parameters
        ----------
        place : FilterPlace
            The channel or sensor, whether the filter predicts it, and the drivers in symbols.
        """
        raise NotImplementedError

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """Where fits should start; none for an effect that a record at rest cannot show."""
        return []

    @classmethod
    def ceiling(cls, name: str, grid: OnGrid) -> float:
        """The largest value [SI] of a parameter that the ADC grid of the samples allows; infinite where it says nothing."""
        return math.inf

    @classmethod
    def ranges(cls, name: str) -> tuple[tuple[float, float], ...]:
        """Ranges [SI] in one of which a parameter is looked for, in order; none where the record alone says where."""
        return ()

    def range_of(self, name: str) -> tuple[float, float] | None:
        """Of `ranges`, the one in which its value is, or which is nearest."""
        value = float(getattr(self, name))
        return min(self.ranges(name), key=lambda r: max(r[0] - value, value - r[1]), default=None)

    def rarer_by_nats(self) -> float:
        """By how many nats it is rarer than others, before any data: that of its class, unless its values say more."""
        return self.prior_penalty_nats

    def in_record(self, dt: float, duration: float) -> Effect:
        """What the effect is in a record of this sampling period and length [s]: itself, unless its numbers leave that open."""
        return self

    @classmethod
    @cache
    def parameters(cls) -> tuple[Parameter, ...]:
        """The declared parameters in order."""
        return tuple(Parameter(f.name, f.metadata["unit"], f.metadata["kind"]) for f in fields(cls))

    @classmethod
    @cache
    def estimated(cls) -> tuple[Parameter, ...]:
        """The parameters that a fit may change."""
        return tuple(p for p in cls.parameters() if p.kind != "setting")

    @classmethod
    @cache
    def coefficients(cls) -> tuple[str, ...]:
        """The numbers of either sign in which the output is linear: the effect is a regressor."""
        return tuple(p.name for p in cls.parameters() if p.kind == "signed")

    @classmethod
    @cache
    def sizes(cls) -> tuple[str, ...]:
        """The estimated parameters with the square of which its power grows."""
        return tuple(p.name for p in cls.estimated() if p.kind == "size")

    @classmethod
    @cache
    def searched(cls) -> tuple[Parameter, ...]:
        """The estimated parameters that are fitted in their logarithm."""
        return tuple(p for p in cls.estimated() if p.kind not in ("signed", "solved", "place"))

    @property
    def values(self) -> tuple[float, ...]:
        """Its coefficients."""
        return tuple(float(getattr(self, name)) for name in self.coefficients())

    def solved(self, values: Sequence[float]) -> Self:
        """The same with these coefficients."""
        return replace(self, **dict(zip(self.coefficients(), values)))

    @property
    def shape(self) -> Self:
        """The same with all coefficients zero."""
        return self.solved([0.0] * len(self.coefficients()))

    def spread(self, covariance: Array) -> dict[str, float]:
        """Standard deviations of the parameters that follow from its coefficients' covariance."""
        return dict(zip(self.coefficients(), np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()))

    def log_prior(self, covariance: Array) -> float:
        """Log density of its coefficients' prior: each log-uniform in size over four decades, of either sign."""
        sizes = np.maximum(np.abs(self.values), np.sqrt(np.maximum(np.diag(covariance), 0.0)))
        return -float(np.log(OF_A_COEFFICIENT * sizes).sum())

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Where it shows in a series that should be white: for effects that no start value finds."""
        return []

    def distinguishing_experiment(self, other: str) -> str:
        """What would tell it from another effect, by name."""
        return self.separating_experiment

    @property
    def lowest_hz(self) -> float:
        """Frequency [Hz] below which it does nothing, of a periodic effect; zero of others."""
        return 0.0

    def variance_of_measured(self, f: Array, duration: float) -> Array:
        """Variance of the power that it passes at `f` [Hz], over that of the ordinates of a record of `duration` [s]."""
        return np.zeros(f.size)

    def forbidden(self) -> str:
        """Why physics allows no effect with these values; empty where it does."""
        return ""

    def is_itself(self, duration: float) -> bool:
        """Whether in a record of that length [s] it is not a mere double of another effect."""
        return True

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """Whether the samples as they were logged show it: for faults of the rig."""
        return None

    def removed_from(self, series: WhiteSeries) -> Array | None:
        """The samples without it, shape (n,), of an effect that is no sum of a known spectrum or shape."""
        return None

    def response(self, omega: Array, dt: float) -> Array | None:
        """Factor on the spectrum of everything else, shape (m,), of an effect that filters."""
        return None

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """What it does to samples, shape (n,), beside what it adds to them."""
        return y

    def shifted(self, name: str, step: float) -> Self:
        """The effect with a step in the logarithm of one of its parameters."""
        return replace(self, **{name: float(getattr(self, name)) * math.exp(step)})

    def regressors(self, t: Array, drive: Mapping[str, Array] | None = None) -> list[Array]:
        """The output [U] for one of each coefficient, the others zero, each of shape (n,)."""
        k = len(self.coefficients())
        return [self.solved(np.eye(k)[i].tolist()).mean(t, drive) for i in range(k)]

    @classmethod
    def read(cls, entry: Mapping[str, Any], unit: str, where: str) -> Self:
        """From a file's entry, for a channel in `unit`; a parameter may be given by one of its `meanings`.

        Raises
        ------
        InputError
            A parameter is missing, unknown, given twice or of another unit, or not positive where it must be.
        """
        known = {p.name: p for p in cls.parameters()}
        others = {m.name: m for m in cls.meanings if m.name not in known}
        values: dict[str, float] = {}
        aliases: dict[str, float] = {}
        said: dict[str, str] = {}
        for key, value in entry.items():
            if key in ("effect", "as") or key.endswith("_ci95"):
                continue
            if key not in known and key not in others:
                names = ", ".join([*known, *others])
                raise InputError(
                    f"{cls.name} has no parameter '{key}'", where=where, remedy=f"It has {names}"
                )
            target = key if key in known else others[key].parameter
            if target in said:
                raise InputError(
                    f"{said[target]} and {key} both given",
                    where=where,
                    remedy=f"Either gives {target}; keep one",
                )
            said[target] = key
            template = known[key].unit if key in known else others[key].unit
            number = parse_quantity(
                value, derived_unit(template, unit), where=f"{where}.{key}", offset="U" not in template
            )
            zero_is_wrong = key in others or known[key].kind != "size"
            if known[target].kind in POSITIVE and (number < 0 or (number == 0 and zero_is_wrong)):
                raise InputError(f"{key} = {value!r} is not positive", where=where)
            (values if key in known else aliases)[key] = number
        missing = [f.name for f in fields(cls) if f.name not in said and f.default is f.default_factory]
        if missing:
            ways = [missing[0], *(m.name for m in others.values() if m.parameter == missing[0])]
            raise InputError(
                f"{cls.name} lacks its parameter '{missing[0]}'",
                where=where,
                remedy=f"Give one of {', '.join(ways)}" if len(ways) > 1 else "",
            )
        return cls(**cls._converted(values, aliases, where))

    @classmethod
    def _converted(cls, values: dict[str, float], aliases: Mapping[str, float], at: str) -> dict[str, float]:
        """The parameters, those of the aliases put in by the order in which the meanings are declared."""
        for m in cls.meanings:
            if m.name in aliases:
                values[m.parameter] = value = m.to(aliases[m.name], values)
                if not 0.0 < value < math.inf:
                    what = f"{m.name} makes {m.parameter} = {value:g}"
                    raise InputError(f"{what}, beyond any number", where=at)
        return values

    def draw(self, rng: np.random.Generator) -> Self:
        """One realisation of what differs from switch-on to switch-on; most effects have nothing."""
        return self

    def allan_variance(self, tau: Array) -> Array:
        """Allan variance [U^2] at `tau` [s], shape (m,); see `form.allan_variance`."""
        return law.allan_variance(self.form(), tau)

    def density(self, f: Array) -> Array:
        """Two-sided spectral density [U^2/Hz] at `f` [Hz], shape (m,)."""
        return law.density(self.form(), f)

    def sampled_density(self, omega: Array, dt: float, block: int = 1) -> Array:
        """Spectral density of the samples [U^2]; see `form.sampled_density`."""
        return law.sampled_density(self.form(), omega, dt, block)

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """Expected output [U], shape (n,), at even times `t` [s] since switch-on."""
        return law.mean(self.form(drive), t)

    def simulate(self, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None) -> Array:
        """One random output [U], shape (n,), at even times `t` [s]; the mean of what is not random."""
        form = self.form(drive)
        return self.mean(t, drive) if form.deterministic else law.simulate(form, t, rng)

    def row(self, unit: str) -> dict[str, tuple[float, str]]:
        """Report row: each parameter in the user's unit, as (value, unit)."""
        shown = {}
        for p in self.parameters():
            text = derived_unit(p.unit, unit)
            shown[p.name] = (from_si(float(getattr(self, p.name)), text), text)
        return shown

    def under(self, name: str) -> float:
        """Its number [SI] under one of the names of `meanings`."""
        return float({m.name: m for m in self.meanings}[name].back(self))

    def called(self, unit: str) -> dict[str, tuple[float, str]]:
        """Its sizes under every name that `meanings` declares, in the user's unit, as (value, unit)."""
        sizes = {p.name for p in self.parameters() if p.kind == "size"}
        shown = {}
        for m in self.meanings:
            if m.parameter in sizes:
                text = derived_unit(m.unit, unit)
                shown[m.name] = (from_si(self.under(m.name), text), text)
        return shown

    def sentence(self, channel: str, unit: str) -> str:
        """The effect on a channel in words, with sizes in the user's unit."""
        shown = {k: f"{v:.3g} {u}".rstrip() for k, (v, u) in self.row(unit).items()}
        return f"{channel} {self.sentence_template.format(**shown)}"


@dataclass(frozen=True)
class LinearProcess(Effect):
    """An effect that is a linear stochastic system: its states are those of a filter."""

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The states of its own linear system."""
        return LinearStates(self.form(place.drive))


@dataclass(frozen=True)
class AddsNothingAtRest(Effect):
    """An effect that adds no linear system to a channel at rest."""

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """Nothing."""
        return LinearSystem()
