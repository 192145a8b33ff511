"""The numbers of an inertial sensor as other programs want them: by axis, and the worst and the mean of the axes.

A random walk is wanted by nearly every consumer, a Gauss-Markov term by nearly none. The rule: over times
short against its tau a Gauss-Markov term is a random walk of its driving density ``q = sigma sqrt(2/tau)``,
so ``K`` is replaced by ``sqrt(K^2 + q^2)``; over longer times that overstates the drift. Each number made in
this way has a note beside it. Flicker is no random walk at any time scale and is not converted.

References
----------
.. [1] P. S. Maybeck, Stochastic Models, Estimation, and Control, vol. 1, 1979, sec. 4.11.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import kfgen
from kfgen.core.errors import InputError
from kfgen.core.units import from_si, parse_unit
from kfgen.effects import Effect
from kfgen.effects.noise_model import NoiseModel
from kfgen.effects.process.stochastic import GaussMarkov, RateRandomWalk, WhiteNoise

SENSORS = {"gyro": ("gyroscope", "rad/s"), "accel": ("accelerometer", "m/s^2")}
AXES = ("x", "y", "z")
IMU_RATE = "the sampling rate of the IMU"
"""How the rate of a consumer begins that is the rate of the log from which the noise was identified."""
WALK_APPROXIMATION = "equal over times short against tau only, too large over longer ones"


@dataclass(frozen=True)
class Value:
    """One parameter of a consumer.

    Parameters
    ----------
    numbers : tuple of float
        In `unit`: one, or one for each axis; empty when it was not identified.
    unit : str
    words : str
        How it comes about.
    """

    numbers: tuple[float, ...]
    unit: str
    words: str

    @property
    def shown(self) -> str:
        """Its numbers with the unit."""
        return (
            f"{', '.join(f'{n:.6g}' for n in self.numbers)} {self.unit}" if self.numbers else "not identified"
        )


@dataclass(frozen=True)
class Converted:
    """What a consumer gets.

    Parameters
    ----------
    text : str
        The file.
    values : mapping of str to Value
        The parameters in it by name.
    warnings : tuple of str
        What of the noise model it does not hold, or holds otherwise.
    """

    text: str
    values: Mapping[str, Value]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class AxisValue:
    """One axis of a sensor.

    Parameters
    ----------
    channel : str
        ``gyro_x``, ...
    effects : tuple of Effect
        On that channel.
    """

    channel: str
    effects: tuple[Effect, ...]

    @property
    def drifts(self) -> tuple[GaussMarkov, ...]:
        """Its Gauss-Markov terms."""
        return tuple(e for e in self.effects if isinstance(e, GaussMarkov) and e.sigma > 0)

    @property
    def K(self) -> float | None:
        """Its random walk alone [U/sqrt(s)]."""
        return root_sum(e.K for e in self.effects if isinstance(e, RateRandomWalk))

    def number(self, letter: str) -> float | None:
        """``N`` [U/sqrt(Hz)], or ``K`` [U/sqrt(s)] with the Gauss-Markov terms in it; None without any."""
        if letter == "N":
            return root_sum(e.N for e in self.effects if isinstance(e, WhiteNoise))
        return root_sum([self.K or 0.0, *(e.under("q") for e in self.drifts)])


def root_sum(sizes: Iterable[float]) -> float | None:
    """Root of the sum of squares; None where nothing is positive."""
    total = math.hypot(*sizes)
    return total if total > 0.0 else None


def formula(readings: Sequence[AxisValue], letter: str, by: str = "") -> tuple[str, str]:
    """How the numbers of some axes come about, in letters.

    Parameters
    ----------
    readings : sequence of AxisValue
        The axes.
    letter : str
        ``N`` or ``K``.
    by : str
        What the number is multiplied by, as text: ``" / sqrt(dt)"``.

    Returns
    -------
    formula, note : str
        The formula, and what the end of the line notes about it.
    """
    drifts = max(len(r.drifts) for r in readings)
    if letter == "N" or not drifts:
        return f"{letter}{by}", ""
    q = "2 sigma^2/tau" if drifts == 1 else "sum of 2 sigma^2/tau"
    walk = "K^2 + " if any(r.K for r in readings) else ""
    return f"sqrt({walk}{q}){by}", f"; Gauss-Markov as a random walk: {WALK_APPROXIMATION}"


@dataclass(frozen=True)
class Imu:
    """A noise model seen as an inertial sensor.

    Parameters
    ----------
    noise : NoiseModel
    rate : float, optional
        The rate [Hz] that the consumer's numbers depend on.
    safety : float
        Multiplies every size.
    origin : str
        The noise file, named in the text.
    """

    noise: NoiseModel
    rate: float | None = None
    safety: float = 1.0
    origin: str = ""

    def readings(self, sensor: str) -> tuple[AxisValue, ...]:
        """The axes of ``gyro`` or ``accel`` that the noise file has, in order."""
        found = []
        for name in (*(f"{sensor}_{a}" for a in AXES), sensor):
            channel = self.noise.channels.get(name)
            if channel is None:
                continue
            title, unit = SENSORS[sensor]
            if not parse_unit(channel.unit).same_dimension(parse_unit(unit)):
                raise InputError(
                    f"{name} is in {channel.unit}, which is no unit of a {title}",
                    where=self.origin,
                    remedy=f"Give it in a unit of {unit}",
                )
            found.append(AxisValue(name, channel.effects))
        return tuple(found)

    def known(self, sensor: str, letter: str) -> list[tuple[float, AxisValue]]:
        """The axes that have a number.

        Parameters
        ----------
        sensor : str
            ``gyro`` or ``accel``.
        letter : str
            ``N`` or ``K``.

        Returns
        -------
        list of (float, AxisValue)
            The number [SI], and the axis.
        """
        pairs = [(r.number(letter), r) for r in self.readings(sensor)]
        return [(number, reading) for number, reading in pairs if number is not None]

    def scalar(
        self, sensor: str, letter: str, unit: str, factor: float = 1.0, by: str = "", *, power: int = 1
    ) -> Value:
        """The worst axis as one number.

        Parameters
        ----------
        sensor : str
            ``gyro`` or ``accel``.
        letter : str
            ``N`` or ``K``.
        unit : str
            Of the result.
        factor : float
            Multiplies the number.
        by : str
            That factor as text: ``" / sqrt(dt)"``.
        power : int
            1, or 2 for a variance.

        Returns
        -------
        Value
            Without numbers where no axis has one.
        """
        known = self.known(sensor, letter)
        if not known:
            return Value((), unit, self.absence(sensor, letter))
        scale = factor * self.safety
        number, worst = max(known, key=lambda pair: pair[0])
        mean = from_si((scale * sum(n for n, _ in known) / len(known)) ** power, unit)
        words, end = formula([worst], letter, by)
        words = f"{'square of ' if power == 2 else ''}{words}; {worst.channel}"
        if len(known) > 1:
            words += f", the worst of {len(known)} axes, mean {mean:.4g}"
        return Value((from_si((scale * number) ** power, unit),), unit, words + self.safely(power) + end)

    def vector(
        self, sensor: str, letter: str, unit: str, power: int = 1, factor: float = 1.0, by: str = ""
    ) -> Value:
        """Three numbers, one for each axis; an axis without a number has the worst one's.

        Parameters
        ----------
        sensor : str
            ``gyro`` or ``accel``.
        letter : str
            ``N`` or ``K``.
        unit : str
            Of the result.
        power : int
            1, or 2 for a covariance.
        factor : float
            Multiplies the number.
        by : str
            That factor as text.

        Returns
        -------
        Value
            Without numbers where no axis has one.
        """
        known = {reading.channel: number for number, reading in self.known(sensor, letter)}
        if not known:
            return Value((), unit, self.absence(sensor, letter))
        worst = max(known.values())
        names = [f"{sensor}_{a}" for a in AXES]
        numbers = tuple(from_si((factor * self.safety * known.get(n, worst)) ** power, unit) for n in names)
        words, end = formula([reading for _, reading in self.known(sensor, letter)], letter, by)
        words = f"square of {words}" if power == 2 else words
        return Value(numbers, unit, words + by_axis(names, known) + self.safely(power) + end)

    def absence(self, sensor: str, letter: str) -> str:
        """Why there is no number, in words.

        Parameters
        ----------
        sensor : str
            ``gyro`` or ``accel``.
        letter : str
            ``N`` or ``K``.

        Returns
        -------
        str
        """
        channels = ", ".join(r.channel for r in self.readings(sensor))
        if not channels:
            return f"not identified, left out: the noise file has no {SENSORS[sensor][0]} channel"
        wanted = "white_noise" if letter == "N" else "rate_random_walk or gauss_markov"
        limits = [
            f"{letter} of {r.channel} is {text}"
            for r in self.readings(sensor)
            if (text := self.noise.provenance.get(f"{r.channel} {wanted.partition(' ')[0]} {letter}"))
        ]
        return "; ".join([f"not identified, left out: no {wanted} in {channels}", *limits])

    def safely(self, power: int = 1) -> str:
        """The safety factor in words."""
        return "" if self.safety == 1.0 else f", times safety {self.safety:g}{'^2' if power == 2 else ''}"

    def given_rate(self, words: str) -> Value:
        """The rate as a parameter."""
        return Value((float(self.rate or 0.0),), "Hz", words)

    def warnings(self, title: str) -> tuple[str, ...]:
        """What of the model a consumer of N and K does not get, or gets otherwise."""
        said = []
        for sensor in SENSORS:
            readings = self.readings(sensor)
            missing = [f"{sensor}_{a}" for a in AXES if f"{sensor}_{a}" not in {r.channel for r in readings}]
            if readings and missing and readings[0].channel != sensor:
                said.append(f"the noise file lacks {', '.join(missing)}: the worst axis is one of the others")
            for r in readings:
                if r.drifts:
                    taus = ", ".join(f"{e.tau:.3g} s" for e in r.drifts)
                    said.append(
                        f"{r.channel}: Gauss-Markov of tau = {taus} given as a random walk "
                        f"{'added to K' if r.K else 'in place of K'}, {WALK_APPROXIMATION}"
                    )
                said += unused(r, title)
        return tuple(said)

    def header(self, title: str, source: str, per_axis: bool = False) -> list[str]:
        """Comment lines that begin every file.

        Parameters
        ----------
        title : str
            What the file is.
        source : str
            Where its convention was read.
        per_axis : bool
            Whether it has a number for each axis.

        Returns
        -------
        list of str
        """
        origin = "".join(c if c.isprintable() else "?" for c in self.origin)
        safety = "no safety factor" if self.safety == 1.0 else f"safety factor {self.safety:g} on every size"
        axes = "each axis by itself" if per_axis else "the worst axis of each sensor"
        return [
            f"# {title}, by kfgen {kfgen.__version__}{' from ' + origin if origin else ''}",
            f"# {axes}; {safety}; a log at rest shows neither vibration nor scale errors",
            f"# convention: {source}",
        ]


def by_axis(names: Sequence[str], known: Mapping[str, float]) -> str:
    """The order of three numbers in words, and which of them were filled in.

    Parameters
    ----------
    names : sequence of str
        The channels of the three numbers.
    known : mapping of str to float
        Those that have a number of their own.

    Returns
    -------
    str
    """
    filled = " ".join(name for name in names if name not in known)
    return f"; axes x y z{f', {filled} as the worst of the others' if filled else ''}"


def unused(reading: AxisValue, title: str) -> list[str]:
    """The effects on an axis that have no parameter in N, K and Gauss-Markov terms, in words.

    Parameters
    ----------
    reading : AxisValue
    title : str
        The consumer's.

    Returns
    -------
    list of str
        One warning, or none.
    """
    carried = (WhiteNoise, RateRandomWalk, GaussMarkov)
    names = [e.name for e in reading.effects if not isinstance(e, carried)]
    if not names:
        return []
    flicker = (
        "; flicker is no random walk: identify it as a gauss_markov" if "bias_instability" in names else ""
    )
    return [f"{reading.channel}: no parameter of {title} holds {', '.join(names)}{flicker}"]
