"""What was found: `Finding`, `DetectionLimit`, and `Comparison` of some channels with what is assumed about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

from kfgen.effects import Effect
from kfgen.effects.faults.samples import Fault
from kfgen.gap.core.battery import Test
from kfgen.gap.core.holdout import Gap
from kfgen.gap.core.search import NO_EFFECT, Distinguishability, Refused
from kfgen.gap.core.thresholds import (
    CONFUSION_SET_MIN_PROBABILITY,
    MAX_PROBABILITY_BESIDE_MISFIT,
    MAX_PROBABILITY_OF_STAND_IN,
)

NO_GAP = "no_gap"
EFFECTS_FOUND = "effects_found"
UNKNOWN_EFFECT = "unknown_effect"
BAD_DATA = "bad_data"
GRAVEST_FIRST = (BAD_DATA, UNKNOWN_EFFECT, EFFECTS_FOUND, NO_GAP)
"""The verdicts: of several comparisons together the first of these that one of them has."""


@dataclass(frozen=True)
class Finding:
    """A missing effect, or a fault of the data.

    Parameters
    ----------
    effect : Effect
        With its fitted values [SI].
    where : str
        Where it acts: a channel, a triad of channels, a state or an input of a plant.
    unit : str
        The unit U of its parameters, as the user writes it.
    ci95 : mapping of str to (float, float)
        95 % intervals of its parameters [SI].
    probability : float
        Among all candidates and none.
    evidence_nats : float
        Over the explanation without it.
    alternatives : tuple of (effect, where, probability)
        What else competed for its place.
    others : tuple of Distinguishability
        How far others are from it in this record.
    test : Test, optional
        The one that showed most disagreement before it was added.
    assumed_value : float, optional
        What is assumed about the number of which it is the error [SI].
    once : bool
        Whether it belongs to this recording alone: a step, single samples, a line with its phase, where a state starts.
    objection : str
        In what the course that it took is none of its kind, so that it stands in for something else; empty where in nothing.
    """

    effect: Effect
    where: str
    unit: str = ""
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    probability: float = 1.0
    evidence_nats: float = 0.0
    alternatives: tuple[tuple[str, str, float], ...] = ()
    others: tuple[Distinguishability, ...] = ()
    test: Test | None = None
    assumed_value: float | None = None
    once: bool = False
    objection: str = ""

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name

    @property
    def nothing_probability(self) -> float:
        """Of that nothing is missing in its place."""
        return sum(p for n, _, p in self.alternatives if n == NO_EFFECT[0])

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Names that the record does not rule out, each once."""
        return tuple(
            dict.fromkeys(
                n
                for n, _, p in self.alternatives
                if p > CONFUSION_SET_MIN_PROBABILITY and n not in (NO_EFFECT[0], self.name)
            )
        )


def beside_misfit(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings as probable as a model allows that leaves more than noise, or as a stand-in is; faults are seen, and stay.

    Parameters
    ----------
    findings : sequence of Finding
    """
    return tuple(f if isinstance(f.effect, Fault) else _as_probable(f) for f in findings)


def _as_probable(f: Finding) -> Finding:
    limit = MAX_PROBABILITY_OF_STAND_IN if f.objection else MAX_PROBABILITY_BESIDE_MISFIT
    return replace(f, probability=min(f.probability, limit))


@dataclass(frozen=True)
class DetectionLimit:
    """The size below which an effect that was not found would not have been seen.

    Parameters
    ----------
    effect : Effect
    where : str
    parameter : str
        Of the effect.
    value : float
        Of the parameter [SI]; infinite where no size would be seen.
    unit : str
        The unit U of the effect's parameters, as the user writes it.
    is_excited : bool
        Whether the motion shows an effect of a size that a vehicle may have.
    manoeuvre : str
        Of the library, the shortest that would show one of usual size; empty where none does, or none was looked for.
    """

    effect: Effect
    where: str
    parameter: str
    value: float
    unit: str = ""
    is_excited: bool = True
    manoeuvre: str = ""


@dataclass(frozen=True)
class Checks:
    """What the checks of the added effects gave.

    Parameters
    ----------
    nested_nats : float
        Largest change of log-likelihood when an addition's size is taken to zero.
    seen : mapping of str to bool
        Whether the 95 % interval of each addition's size excludes zero.
    found_again : tuple of str, optional
        What was found in a record simulated from the updated model; None where none was simulated.
    named : tuple of str
        What the updated model adds.
    """

    nested_nats: float
    seen: Mapping[str, bool]
    found_again: tuple[str, ...] | None
    named: tuple[str, ...] = ()

    def tempered(self, findings: Sequence[Finding]) -> list[Finding]:
        """Findings, as probable as beside misfit where the log does not bound their size or they are not found again.

        Parameters
        ----------
        findings : sequence of Finding
            Of what was checked.
        """
        again = set(self.named if self.found_again is None else self.found_again)
        return [
            f if f.name in again and self.seen.get(f.name, True) else beside_misfit([f])[0] for f in findings
        ]


@dataclass(frozen=True)
class NoiseScale:
    """The noise of a channel of another size than assumed.

    Parameters
    ----------
    channel : str
        Or the sensor, where all its channels have one size.
    times : float
        Standard deviation over the assumed one.
    ci95 : (float, float)
        Its interval.
    white : bool
        Whether it is the size of the white noise alone, and not of every noise of the channel.
    """

    channel: str
    times: float
    ci95: tuple[float, float]
    white: bool = False


@dataclass(frozen=True)
class NoiseCause:
    """What one cause does to the size that a noise seems to have.

    Parameters
    ----------
    cause, where : str
        A named effect, or ``vibration``, and its place.
    factor : float
        Standard deviation with the cause unexplained over that with it explained.
    """

    cause: str
    where: str
    factor: float


@dataclass(frozen=True)
class NoiseSplit:
    """By how much a noise looks larger than assumed where nothing is named, split by causes.

    Parameters
    ----------
    channel : str
        Input or channels of an aiding sensor that have one size.
    times : float
        Standard deviation over the assumed one, with nothing named.
    ci95 : (float, float)
        Its interval.
    parts : tuple of NoiseCause
        Their product and `left` is `times`.
    left : float
        What nothing that was named explains.
    """

    channel: str
    times: float
    ci95: tuple[float, float]
    parts: tuple[NoiseCause, ...]
    left: float


@dataclass(frozen=True)
class OutageDrift:
    """How far a filter is from the first fix after outages.

    Parameters
    ----------
    seconds : float
        Length of each outage [s].
    metres : float
        Root mean square distance [m].
    count : int
        Outages.
    """

    seconds: float
    metres: float
    count: int


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Channels that were compared together: one at rest by itself, all channels of sensors that move or of a plant.

    Parameters
    ----------
    channels : tuple of str
    verdict : str
        One of `GRAVEST_FIRST`.
    findings : tuple of Finding
    before, after : tuple of Test
        The battery under the assumed and under the updated model, each with its channel.
    gap : Gap
        The held-out mismatch.
    span_s : (float, float)
        First and last time [s].
    limits : tuple of DetectionLimit
    retuned : bool
        Whether assumed numbers were estimated again.
    own_noise_objection : str
        In what the course of the noise of those numbers is none of its kind, so that it stands in for something else; empty
        where in nothing.
    noise_scales : tuple of NoiseScale
        Channels whose noise is of another size than assumed.
    checks : Checks, optional
        Of what was added.
    rms : tuple of (channel, before, after)
        Root mean square of the residuals in standard deviations of the noise.
    unknowns : mapping of str to (unit, value)
        What was fitted beside the effects [SI].
    constant_inputs : tuple of str
        Inputs of a plant that never change.
    refused : tuple of Refused
        Effects that were not added in spite of their evidence.
    outages : tuple of (OutageDrift, OutageDrift)
        How far a filter drifts where its receiver is silent, as assumed and updated; outages in the last part of the log.
    parked : bool
        Whether the vehicle never moves.
    noise_factors : tuple of NoiseSplit
        Why noises of a flight look larger than assumed.
    """

    is_at_rest: ClassVar[bool] = False

    channels: tuple[str, ...]
    verdict: str
    findings: tuple[Finding, ...]
    before: tuple[Test, ...]
    after: tuple[Test, ...]
    gap: Gap
    span_s: tuple[float, float]
    limits: tuple[DetectionLimit, ...] = ()
    retuned: bool = False
    own_noise_objection: str = ""
    noise_scales: tuple[NoiseScale, ...] = ()
    checks: Checks | None = None
    rms: tuple[tuple[str, float, float], ...] = ()
    unknowns: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    constant_inputs: tuple[str, ...] = ()
    refused: tuple[Refused, ...] = ()
    outages: tuple[tuple[OutageDrift, OutageDrift], ...] = ()
    parked: bool = False
    noise_factors: tuple[NoiseSplit, ...] = ()

    @property
    def is_updated(self) -> bool:
        """Whether anything is added to the model or changed in it."""
        return bool(self.findings or self.retuned or self.noise_scales)

    @property
    def retuned_channels(self) -> list[str]:
        """Channels of which assumed numbers were estimated again."""
        return list(self.channels) if self.retuned else [s.channel for s in self.noise_scales]
