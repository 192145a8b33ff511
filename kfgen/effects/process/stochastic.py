"""Stochastic effects of a sensor at rest: white noise, quantisation, Gauss-Markov, flicker, random walk.

Definitions and closed forms are in ``docs/noise.md``; here each is a linear system, from which they follow.

References
----------
.. [1] IEEE Std 952-1997, annex C, eqs (C.1)-(C.21).
.. [2] P. S. Maybeck, Stochastic Models, Estimation, and Control, vol. 1, 1979, sec. 4.11.
.. [3] V. Saini, S. C. Rana, M. M. Kuber, Online estimation of state space error model for MEMS IMU,
   J. Modelling and Simulation of Systems 1(4), 2010.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects.effect import Effect, LinearProcess, Look, Meaning, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, LinearStates, NotModelled, SampleVariance
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.series import OnGrid

Array = NDArray[np.float64]

GRID_RELATIVE_TOLERANCE = 1e-6
"""Relative error with which the digits of a log give the step of an ADC grid times the period."""

FLICKER_FLOOR_OVER_B = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Allan deviation of flicker of density ``B^2 / (2 pi f)``, in units of B, at every time [1]_."""


@cache
def gauss_markov_peak() -> tuple[float, float]:
    """Where the Allan deviation of a Gauss-Markov process peaks, in units of tau, and its height in sigma."""
    from scipy.optimize import minimize_scalar

    unit = GaussMarkov(sigma=1.0, tau=1.0)

    def below(t: float) -> float:
        return -float(unit.allan_variance(np.array([t]))[0])

    found = minimize_scalar(below, bracket=(1.0, 2.0, 4.0), tol=1e-10)
    return float(found.x), math.sqrt(-float(found.fun))


@dataclass(frozen=True)
class WhiteNoise(LinearProcess):
    """White noise (angle or velocity random walk): density ``N^2``, AVAR ``N^2 / tau``."""

    N: Any = parameter("U/sqrt(Hz)")

    name: ClassVar[str] = "white_noise"
    title: ClassVar[str] = "white noise (random walk of the integral)"
    sentence_template: ClassVar[str] = "carries white noise of N = {N}"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """The first point of the Allan deviation."""
        return [cls(N=float(look.deviation[0] * np.sqrt(look.tau[0])))]

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``y = v``."""
        return LinearSystem(V=self.N**2)


@dataclass(frozen=True)
class SampleNoise(Effect):
    """White noise of the samples of an aiding channel, `sd` each, whatever their rate; ``white_noise`` with ``sd`` in a file."""

    sd: Any = parameter("U", "setting")

    name: ClassVar[str] = "sample_noise"
    title: ClassVar[str] = "white noise of the samples"
    sentence_template: ClassVar[str] = "carries white noise of {sd} in each sample"

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """None: it is no process in time, whose density would be the same at another rate."""
        return LinearSystem()

    @classmethod
    @cache
    def sizes(cls) -> tuple[str, ...]:
        """Its standard deviation."""
        return ("sd",)

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """All the variance that each sample has."""
        return SampleVariance(self.sd**2, alone=True)

    def sampled_density(self, omega: Array, dt: float, block: int = 1) -> Array:
        """The same at every frequency [U^2]."""
        return np.full(np.shape(omega), float(self.sd) ** 2 / block)

    def in_record(self, dt: float, duration: float) -> WhiteNoise:
        """White noise of the density that gives samples of this period that standard deviation: ``N = sd sqrt(dt)``.

        Parameters
        ----------
        dt, duration : float
            Sampling period and length [s].

        Returns
        -------
        WhiteNoise
        """
        return WhiteNoise(N=float(self.sd) * float(np.sqrt(dt)))

    def simulate(self, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None) -> Array:
        """Independent samples, shape (n,)."""
        return np.asarray(float(self.sd) * rng.standard_normal(np.size(t)))


def has_white_noise(effects: Iterable[Effect]) -> bool:
    """Whether something in the noise of a channel is white, so that no sample is exact.

    Parameters
    ----------
    effects : iterable of Effect
    """
    return any(e.form().V or e.form().Z or isinstance(e, SampleNoise) for e in effects)


@dataclass(frozen=True)
class Quantisation(LinearProcess):
    """Quantisation of the integrated output: AVAR ``3 Q^2 / tau^2``."""

    Q: Any = parameter("U*s")

    name: ClassVar[str] = "quantisation"
    title: ClassVar[str] = "quantisation of the integrated output"
    separating_experiment: ClassVar[str] = "another sampling rate"
    sentence_template: ClassVar[str] = "is quantised in its integral by Q = {Q}"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """The first point of the Allan deviation."""
        return [cls(Q=float(look.deviation[0] * look.tau[0] / np.sqrt(3.0)))]

    @classmethod
    def ceiling(cls, name: str, grid: OnGrid) -> float:
        """``step dt / sqrt(12)``: the integral of samples on an ADC grid is rounded to its step times the period."""
        bound = grid.adc_step * grid.dt / math.sqrt(12.0) * (1.0 + GRID_RELATIVE_TOLERANCE)
        return bound if grid.adc_step > 0.0 else math.inf

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """A white sequence of variance ``Q^2`` on the integral."""
        return LinearSystem(Z=self.Q**2)

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """White noise of a measurement; of an input it stays within a step of the integral for ever."""
        if place.measured:
            return LinearStates(self.form())
        return NotModelled(
            "the error of the integral of an input stays within Q and does not grow, so that no white noise stands for it",
            "Add Q to the standard deviation of the angle or velocity that the filter gives",
        )


@dataclass(frozen=True)
class GaussMarkov(LinearProcess):
    """First-order Gauss-Markov process, stationary standard deviation `sigma`, correlation time `tau`."""

    sigma: Any = parameter("U")
    tau: Any = parameter("s", "time")

    name: ClassVar[str] = "gauss_markov"
    title: ClassVar[str] = "first-order Gauss-Markov bias"
    separating_experiment: ClassVar[str] = "a record of a hundred of its correlation times"
    repeatable: ClassVar[bool] = True
    sentence_template: ClassVar[str] = (
        "has a bias that wanders by sigma = {sigma} with a correlation time of tau = {tau}"
    )
    meanings: ClassVar[tuple[Meaning, ...]] = (
        Meaning(
            "beta",
            "1/s",
            "tau",
            "inverse correlation time",
            "the literature on state-space models",
            lambda beta, v: 1.0 / beta,
            lambda e: 1.0 / e.tau,
        ),
        Meaning(
            "sigma",
            "U",
            "sigma",
            "stationary standard deviation",
            "KF-GINS (gbstd, abstd), kfgen's own files",
            lambda sigma, v: sigma,
            lambda e: e.sigma,
        ),
        Meaning(
            "q",
            "U/sqrt(s)",
            "sigma",
            "root density of the driving noise, sigma sqrt(2/tau)",
            "Gazebo, RotorS, PX4 SITL; a random walk's K over times short against tau",
            lambda q, v: q * math.sqrt(v["tau"] / 2.0),
            lambda e: e.sigma * math.sqrt(2.0 / e.tau),
        ),
        Meaning(
            "B_ieee",
            "U",
            "sigma",
            "flicker (bias instability) whose Allan floor is as high as this term's Allan peak",
            "IEEE Std 952, data sheets that divide the floor by 0.664",
            lambda B, v: B * FLICKER_FLOOR_OVER_B / gauss_markov_peak()[1],
            lambda e: e.sigma * gauss_markov_peak()[1] / FLICKER_FLOOR_OVER_B,
        ),
        Meaning(
            "adev_min",
            "U",
            "sigma",
            "the floor of the Allan deviation as read off, taken for this term's peak",
            "data sheets and Allan tools that do not divide by 0.664",
            lambda floor, v: floor / gauss_markov_peak()[1],
            lambda e: e.sigma * gauss_markov_peak()[1],
        ),
        Meaning(
            "B_saini",
            "U/sqrt(Hz)",
            "sigma",
            "B of x' = -beta x + beta B w, so that the driver's root density is beta B",
            "Saini, Rana, Kuber 2010; Hemerly 2017",
            lambda B, v: B / math.sqrt(2.0 * v["tau"]),
            lambda e: e.sigma * math.sqrt(2.0 * e.tau),
        ),
    )

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """Correlation times over the record, each with the Allan deviation seen there as its peak."""
        times = np.geomspace(max(look.duration / 1000.0, 20.0 * look.dt), look.duration / 10.0, 4)
        return [cls(float(np.interp(t, look.tau, look.deviation)) / 0.6, float(t)) for t in times]

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``dx = -x / tau dt + dw``, ``W = 2 sigma^2 / tau``."""
        return LinearSystem(
            A=((-1 / self.tau,),),
            W=((2 * self.sigma**2 / self.tau,),),
            C=(1,),
            x0=(0,),
            states=(State("gm"),),
        )


DEFAULT_FLICKER_BAND_S = (1.0, 1e4)
"""Shortest and longest time constant [s] of a flicker of which only B is stated."""


def bank_times(shortest: float, longest: float) -> tuple[float, list[float]]:
    """Correlation times of a bank of Gauss-Markov processes, evenly spaced in the logarithm.

    Parameters
    ----------
    shortest, longest : float
        [s].

    Returns
    -------
    (float, list of float)
        The ratio of neighbours, 4 at most, and the times [s].
    """
    m = max(2, math.ceil(math.log(longest / shortest) / math.log(4.0)) + 1)
    r = (longest / shortest) ** (1.0 / (m - 1))
    return r, [shortest * r**i for i in range(m)]


def bank(taus: Sequence[float], variances: Sequence[Any], name: str) -> LinearSystem:
    """The sum of Gauss-Markov processes, each a state.

    Parameters
    ----------
    taus : sequence of float
        Correlation times [s].
    variances : sequence of float or symbol
        Of each [U^2].
    name : str
        That states begin with.

    Returns
    -------
    LinearSystem
    """
    m = len(taus)

    def diagonal(entries: list[Any]) -> tuple[tuple[Any, ...], ...]:
        return tuple(tuple(e if i == j else 0 for j in range(m)) for i, e in enumerate(entries))

    return LinearSystem(
        A=diagonal([-1 / t for t in taus]),
        W=diagonal([2 * v / t for v, t in zip(variances, taus)]),
        C=(1,) * m,
        x0=(0,) * m,
        states=tuple(State(f"{name}{i}") for i in range(m)),
    )


class OfABand:
    """Noise whose spectrum has its slope between a shortest and a longest correlation time."""

    name: ClassVar[str]
    shortest: float
    longest: float

    def __post_init__(self) -> None:
        if not 0.0 < self.shortest < self.longest:
            raise InputError(
                f"the band of {self.name} from {self.shortest:g} s to {self.longest:g} s is empty",
                remedy="Give longest a larger time than shortest",
            )

    def in_record(self, dt: float, duration: float) -> Self:
        """The same over all that the record shows, where its band was not stated.

        Parameters
        ----------
        dt, duration : float
            Sampling period and length [s].

        Returns
        -------
        Self
        """
        if (self.shortest, self.longest) != DEFAULT_FLICKER_BAND_S:
            return self
        return replace(self, shortest=min(self.shortest, dt), longest=max(self.longest, duration))  # type: ignore[type-var]


@dataclass(frozen=True)
class BiasInstability(OfABand, LinearProcess):
    """Flicker noise of density ``B^2 / (2 pi f)`` inside a band, as a bank of Gauss-Markov states.

    Time constants are spaced evenly in the logarithm with ratio ``r`` from `shortest` to
    `longest`, each of variance ``B^2 ln(r) / pi``. The sum has the flicker's density within 1 % three
    decades inside the band, 3 % below it one decade inside, and a third below it at the ends.
    """

    B: Any = parameter("U")
    shortest: float = parameter("s", "setting", DEFAULT_FLICKER_BAND_S[0])
    longest: float = parameter("s", "setting", DEFAULT_FLICKER_BAND_S[1])

    name: ClassVar[str] = "bias_instability"
    title: ClassVar[str] = "bias instability (flicker)"
    separating_experiment: ClassVar[str] = "a much longer record"
    sentence_template: ClassVar[str] = (
        "has a bias instability (flicker) of B = {B} between {shortest} and {longest}"
    )

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """The floor of the Allan deviation, over the band that the record can show."""
        return [cls(float(look.deviation.min()), look.dt, look.duration)]

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """A diagonal bank of Gauss-Markov processes."""
        r, taus = bank_times(self.shortest, self.longest)
        return bank(taus, [self.B**2 * (math.log(r) / math.pi)] * len(taus), "flicker")


@dataclass(frozen=True)
class RateRandomWalk(LinearProcess):
    """Random walk of the output itself: density ``K^2 / (2 pi f)^2``, AVAR ``K^2 tau / 3``."""

    K: Any = parameter("U/sqrt(s)")

    name: ClassVar[str] = "rate_random_walk"
    title: ClassVar[str] = "rate random walk"
    separating_experiment: ClassVar[str] = "a second record, for a random walk goes another way each time"
    sentence_template: ClassVar[str] = "has a bias in random walk of K = {K}"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """The last point of the Allan deviation."""
        return [cls(K=float(look.deviation[-1] * np.sqrt(3.0 / look.tau[-1])))]

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``dx = dw``, ``W = K^2``."""
        return LinearSystem(
            A=((0,),), W=((self.K**2,),), C=(1,), x0=(0,), states=(State("bias", shared=True),)
        )
