"""Faults of a recording that its samples or times show by themselves: repeats, drops, jitter, clipping, stuck bits, units.

Each is detected in a `RawSamples` channel before any fit, never by likelihood; one that spoils the samples makes a fit
meaningless.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.core.units import parse_unit
from kfgen.effects.effect import AddsNothingAtRest, Effect, parameter
from kfgen.effects.faults.repeats import repeated_share
from kfgen.effects.filter_role import FilterPlace, FilterRole, NotModelled
from kfgen.effects.series import DetectedFault, RawSamples, periods

Array = NDArray[np.float64]

MIN_STEPS_FOR_REPEATS = 64
"""Steps between samples below which repeats are not judged."""
MIN_REPEATED_SHARE = 0.005
"""Of the samples, below which repeats are not said."""
MIN_CLIPPED_SAMPLES = 4
"""At one value: of a short record one sample is a large share."""
MIN_CLIPPED_SHARE = 0.004
"""Share of the samples at one end of the range above which they are clipped."""
MAX_OVER_CHANCE_OF_EQUALS = 1.5
"""Times the chance by which neighbours are equal on the grid of the ADC, beyond which values are held."""
MIN_JITTER_PERIODS = 0.02
"""Root mean square error of the time steps, in sampling periods, above which jitter is reported."""
MAX_OF_ZEROS = 0.05
"""How often another value may come beside the zeros of a dead zone, if the grid of the samples does not explain it."""
MIN_COARSE_STEP_SIGMAS = 1.0
"""Step of the ADC grid, in standard deviations of the assumed noise, above which it is coarse."""
MIN_INTEGRATED_STEP_RATIO = 1.04
"""Mean square step to the neighbour over that to the next but one, above which the integral is on the grid:
one for rounded samples."""
PLAIN_FACTORS = (("a thousand", 1e3), ("a million", 1e6), ("hours for seconds", 3600.0))
"""Factors between units of any quantity."""
UNIT_FACTORS = (("degrees for radians", 180.0 / np.pi), ("g for m/s^2", 9.80665), *PLAIN_FACTORS)
"""Factors between units that are taken for one another."""
UNIT_FACTOR_TOLERANCE = 0.05
"""Relative distance at which a factor is a known one."""
UNITS_OF_A_QUANTITY = (
    ("rad/s", "deg/s"),
    ("m/s^2", "g"),
    ("T", "mT", "uT", "nT", "gauss", "mgauss"),
    ("m", "cm", "mm"),
    ("m/s", "cm/s", "mm/s", "km/h"),
    ("Pa", "hPa", "kPa", "bar"),
)
"""Units of one quantity in which sensors are logged."""


def unit_factors(unit: str) -> tuple[float, ...]:
    """By how many times readings may be too large whose unit is taken for another one of the same quantity.

    Parameters
    ----------
    unit : str
        That the log states.
    """
    quantity = parse_unit(unit)
    for names in UNITS_OF_A_QUANTITY:
        units = [parse_unit(n) for n in names]
        if units[0].same_dimension(quantity):
            # Powers of ten come in several ways, which differ by rounding.
            ratios = {float(f"{a.factor / b.factor:.9g}") for a in units for b in units}
            return tuple(sorted(ratios - {1.0}))
    return ()


def is_between_units(factor: float, unit: str) -> bool:
    """Whether a channel can be so many times as large because its unit is taken for another one of the same quantity.

    Parameters
    ----------
    factor : float
    unit : str
        That the log states; of a quantity that is not known any factor can be.

    Returns
    -------
    bool
    """
    own = unit_factors(unit)
    known = [*own, *(f for _, k in PLAIN_FACTORS for f in (k, 1.0 / k))]
    return not own or bool(np.isclose(factor, known, rtol=1e-3, atol=0.0).any())


@dataclass(frozen=True)
class Fault(AddsNothingAtRest):
    """An effect of the rig, which a filter does not model.

    `moving` says whether the samples show it where the sensor moves.
    """

    moving: ClassVar[bool] = True

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Nothing: the rig or the log is to be corrected."""
        return NotModelled(
            "it is a fault of the rig or of the log, and none of the sensor", "Correct the log"
        )

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """The fault itself, where it explains a coefficient of a triad's regression (`kfgen.effects.faults.axes`).

        Parameters
        ----------
        own : bool
            Whether the coefficient is of the channel's own axis, or of another one of its triad.
        coefficient : float
            Readings over what that axis should have read.

        Returns
        -------
        Effect or None
        """
        return None


@dataclass(frozen=True)
class RepeatedSamples(Fault):
    """A `share` of the samples repeats the one before."""

    share: Any = parameter("", "ratio")

    name: ClassVar[str] = "repeated_samples"
    title: ClassVar[str] = "repeated samples"
    sentence_template: ClassVar[str] = "repeats the sample before in a share of {share}"

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """More equal neighbours than the ADC grid and the noise explain."""
        if raw.n <= MIN_STEPS_FOR_REPEATS or raw.adc_step > MIN_COARSE_STEP_SIGMAS * raw.assumed:
            return None
        share = cls._while_moving(raw) if raw.moves else repeated_share(raw.y, raw.adc_step)
        if share < MIN_REPEATED_SHARE:
            return None
        return DetectedFault(cls(share), float(np.mean(np.diff(raw.y) == 0.0)) * raw.n, spoils=True)

    @staticmethod
    def _while_moving(raw: RawSamples) -> float:
        """The share of a sensor that moves: it is not Gaussian, and only what is far above chance is told."""
        same = np.diff(raw.y) == 0.0
        looked = same if raw.still is None else same[~raw.still]
        if looked.size < MIN_STEPS_FOR_REPEATS:
            return 0.0
        equal = float(np.mean(looked))
        chance = min(raw.chance_of_equals, 1.0)
        share = (equal - chance) / max(1.0 - chance, 1e-9)
        least = 3.0 / looked.size + 5.0 * np.sqrt(chance / looked.size) + 0.25 * chance
        one, two = raw.steps
        # Samples that repeat make steps to neighbours small.
        return share if equal - chance >= least and one <= (1.0 - 0.25 * share) * two else 0.0


@dataclass(frozen=True)
class Stuck(Fault):
    """From `time` on, for `lasting`, every sample is the one before."""

    time: Any = parameter("s", "place")
    lasting: Any = parameter("s", "time")

    name: ClassVar[str] = "stuck"
    title: ClassVar[str] = "a stuck channel"
    sentence_template: ClassVar[str] = "shows one and the same value from {time} on, for {lasting}"


@dataclass(frozen=True)
class TooEarly(Fault):
    """An input does what it does `shift` before the log says that it was given: two clocks."""

    shift: Any = parameter("s", "time")

    name: ClassVar[str] = "too_early"
    title: ClassVar[str] = "an effect before its cause"
    sentence_template: ClassVar[str] = "is logged {shift} after what it does: align the clocks of the columns"


def runs(y: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where equal samples of shape (n,) begin to follow one another, and how many there are."""
    first = np.concatenate([[0], 1 + np.flatnonzero(np.diff(y) != 0.0)])
    return first, np.diff(np.append(first, y.size))


@dataclass(frozen=True)
class DroppedSamples(Fault):
    """A `share` of the samples is missing, and the time stamps say so."""

    share: Any = parameter("", "ratio")

    name: ClassVar[str] = "dropped_samples"
    moving: ClassVar[bool] = False
    title: ClassVar[str] = "dropped samples"
    sentence_template: ClassVar[str] = "lacks a share of {share} of its samples"

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """Steps of time of more than one and a half periods."""
        lost = float(np.sum(periods(raw.t, raw.dt) - 1.0))
        if lost < 1.0:
            return None
        return DetectedFault(cls(lost / (lost + raw.n)), lost, spoils=lost > 0.2 * (lost + raw.n))


@dataclass(frozen=True)
class TimestampJitter(Fault):
    """Time stamps off by `sigma`, root mean square."""

    sigma: Any = parameter("s", "size")

    name: ClassVar[str] = "timestamp_jitter"
    moving: ClassVar[bool] = False
    title: ClassVar[str] = "jitter of the time stamps"
    sentence_template: ClassVar[str] = "has time stamps that are off by {sigma}"

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """Steps of time that differ by more than a few percent of a period."""
        error = np.diff(raw.t) / raw.dt - periods(raw.t, raw.dt)
        rms = float(np.sqrt(0.5 * np.mean(error**2)))
        return DetectedFault(cls(rms * raw.dt), float(raw.n)) if rms > MIN_JITTER_PERIODS else None


@dataclass(frozen=True)
class Clipping(Fault):
    """Samples beyond `limit` stand at it."""

    limit: Any = parameter("U", "signed")

    name: ClassVar[str] = "clipping"
    title: ClassVar[str] = "clipping"
    sentence_template: ClassVar[str] = "is clipped at {limit}"

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """The largest or smallest value, far too often."""
        same = np.diff(raw.y) == 0.0
        chance = MAX_OVER_CHANCE_OF_EQUALS * raw.chance_of_equals
        for end in (float(raw.y.max()), float(raw.y.min())):
            count = int(np.sum(raw.y == end))
            share = count / raw.n
            # A slower sensor holds any value, not only the last one.
            held = float(np.mean(same & (raw.y[1:] != end))) - chance
            often = count >= MIN_CLIPPED_SAMPLES and share > max(MIN_CLIPPED_SHARE, held)
            if often and raw.adc_step < 0.25 * raw.noise:
                return DetectedFault(cls(end), share * raw.n, spoils=True)
        return None


@dataclass(frozen=True)
class CoarseQuantisation(Fault):
    """Values on an ADC grid whose `step` is wider than the noise."""

    step: Any = parameter("U", "size")

    name: ClassVar[str] = "coarse_quantisation"
    title: ClassVar[str] = "coarse quantisation of the samples"
    sentence_template: ClassVar[str] = "has values {step} apart, wider than its noise"

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """The step of the ADC grid against the noise."""
        if raw.adc_step < MIN_COARSE_STEP_SIGMAS * raw.assumed or raw.noise > 3.0 * raw.adc_step:
            return None
        one, two = raw.steps
        if one > MIN_INTEGRATED_STEP_RATIO * two:  # the ADC grid is that of the integral
            return None
        return DetectedFault(cls(raw.adc_step), float(raw.n), spoils=True)


@dataclass(frozen=True)
class StuckBit(Fault):
    """Bit `bit` of the converter never changes, though higher ones do."""

    bit: Any = parameter("", "setting")

    name: ClassVar[str] = "stuck_bit"
    title: ClassVar[str] = "a stuck bit"
    sentence_template: ClassVar[str] = "has a converter whose bit {bit} never changes"

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """Codes of which none has the bit, or all have, while the bit above changes."""
        if raw.adc_step <= 0.0:
            return None
        codes = np.round(raw.y / raw.adc_step).astype(np.int64)
        for bit in range(1, 16):
            if codes.max() - codes.min() < 2 ** (bit + 1):
                break
            inside = codes[np.abs(raw.y - np.median(raw.y)) < 3.0 * float(np.std(raw.y))]
            share, above = (float(np.mean((inside >> b) & 1)) for b in (bit, bit + 1))
            if share in (0.0, 1.0) and 0.02 < above < 0.98:
                return DetectedFault(cls(float(bit)), float(raw.n), spoils=True)
        return None


@dataclass(frozen=True)
class DeadZone(Fault):
    """Values closer to zero than `width` are zero."""

    width: Any = parameter("U", "size")

    name: ClassVar[str] = "dead_zone"
    title: ClassVar[str] = "a dead zone about zero"
    sentence_template: ClassVar[str] = "shows zero for anything below {width}"

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """Zeros in place of the values about them: none stands next to zero, and no fewer than are missing are zero."""
        zero = raw.y == 0.0
        share = float(np.mean(zero))
        away = np.abs(raw.y[~zero])
        if share < 0.02 or away.size < 100 or raw.adc_step > 0.25 * raw.noise:
            return None
        width = float(np.quantile(away, 0.001))
        if width < max(
            1.5 * raw.adc_step, 0.02 * raw.assumed
        ):  # the ADC grid itself; or zeros that were put in
            return None
        next_to = float(np.mean((away >= width) & (away < 2.0 * width)))
        if share <= 0.2 * next_to:
            return None
        # Where other values recur, too, oftener than on its grid, zero is one code of a coarse ADC whose axes were mixed.
        commonest = int(np.unique(away, return_counts=True)[1].max()) / raw.n
        if commonest > max(MAX_OF_ZEROS * share, 2.0 * raw.adc_step / max(raw.noise, 1e-300)):
            return None
        return DetectedFault(cls(width), share * raw.n, spoils=True)


@dataclass(frozen=True)
class UnitError(Fault):
    """All values are `factor` times what they should be, as by a wrong unit."""

    factor: Any = parameter("", "size")

    name: ClassVar[str] = "unit_error"
    title: ClassVar[str] = "a wrong unit"
    sentence_template: ClassVar[str] = (
        "is {factor} times as large as it should be: check the unit of the column"
    )
    moving: ClassVar[bool] = False

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """A noise that is larger or smaller than assumed by just such a factor."""
        found = _between(raw.noise / raw.assumed) if raw.assumed > 0.0 else None
        return DetectedFault(found, float(raw.n), spoils=True) if found else None

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """Near a factor between two units."""
        return _between(abs(coefficient)) if own else None


def _between(ratio: float) -> UnitError | None:
    """The unit error of a ratio that is near a known one."""
    known = [f for _, k in UNIT_FACTORS for f in (k, 1.0 / k) if abs(ratio / f - 1.0) < UNIT_FACTOR_TOLERANCE]
    return UnitError(known[0]) if known else None
