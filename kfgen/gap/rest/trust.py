"""What is assumed about a channel, made ready to be compared: trust in its numbers, its known terms removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.process.sensor_response import SensorResponse
from kfgen.effects.process.stochastic import has_white_noise
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.fit.fit import Fit, Key, Prior, Problem, maximise
from kfgen.identify.identify import MIN_SAMPLES

DEFAULT_RELATIVE_SD = 0.1
"""Relative standard deviation of an assumed number that states no interval."""
MIN_RELATIVE_SD = 0.02
MAX_SHIFT_SD = 1.0
"""Standard deviations from an assumed number beyond which it does not hold."""
CHANCE_OF_GAINS_NATS = 6.0
"""What gains that were measured in a record of the same length leave unexplained at most; nothing where they are known,
and twice as much where that record was a short one."""
CHANCE_OF_GAINS_OF_A_LINE_NATS = 2.0
"""The same at one frequency: a level that is off by a fifth makes that much of the highest of ten thousand ordinates."""
MIN_RETUNING_NATS = 7.0
"""Nats that assumed numbers must lose against those of a fit: by chance once in a thousand records with three."""


def priors_of(noise: ChannelNoise) -> dict[Key, Prior]:
    """Trust in the assumed numbers: from their intervals, else `DEFAULT_RELATIVE_SD`."""
    priors: dict[Key, Prior] = {}
    for i, term in enumerate(noise.terms):
        if term.effect.coefficients():
            continue
        for p in term.effect.estimated():
            value = float(getattr(term.effect, p.name))
            lo, hi = term.ci95.get(p.name, (0.0, 0.0))
            known = 0.0 < lo < hi < np.inf
            deviation = max(float(np.log(hi / lo)) / 3.92, MIN_RELATIVE_SD) if known else DEFAULT_RELATIVE_SD
            if value > 0.0:
                priors[i, p.name] = Prior(float(np.log(value)), deviation)
    return priors


def without_assumed_terms(
    record: Record, noise: ChannelNoise
) -> tuple[Record, tuple[Term, ...], ChannelNoise]:
    """The record less what the assumed deterministic terms say, those terms, and the random ones.

    So a wrong coefficient shows as a missing rest of the same effect, and a constant as nothing.

    Parameters
    ----------
    record : Record
    noise : ChannelNoise
        Assumed of it.

    Raises
    ------
    InputError
        An assumed effect has a driver that the log lacks.
    """
    trusted = tuple(t for t in noise.terms if t.effect.coefficients())
    for term in noise.terms:
        driver = term.effect.driver
        if driver and driver not in record.drive:
            raise InputError(
                f"the model has the effect {term.effect.name}, but the log has no channel '{driver}'",
                remedy="Give a log with it, or take the effect out of the model",
            )
    y = record.y - record.drift([t.effect for t in trusted])
    random = tuple(t for t in noise.terms if not t.effect.coefficients())
    return replace(record, y=y), trusted, replace(noise, terms=random)


def merged(trusted: tuple[Term, ...], terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Assumed deterministic terms with what was found to be missing of them added.

    Parameters
    ----------
    trusted : tuple of Term
        Assumed deterministic terms.
    terms : tuple of Term
        What was found.
    """
    out = list(terms)
    for old in trusted:
        same = [t for t in out if t.effect.name == old.effect.name and not old.effect.repeatable]
        if not same:
            out.append(old)
            continue
        rest, name = same[0], old.effect.coefficients()[0]
        base = float(getattr(old.effect, name))
        total = replace(rest.effect, **{name: base + float(getattr(rest.effect, name))})
        out[out.index(rest)] = Term(total, {k: (lo + base, hi + base) for k, (lo, hi) in rest.ci95.items()})
    return tuple(out)


def moved(problem: Problem, fit: Fit, assumed: Sequence[Effect]) -> bool:
    """Whether an assumed number does not hold: far from what a fit makes of it, and surely so.

    Parameters
    ----------
    problem, fit
        Of the assumed effects and those that were added.
    assumed : sequence of Effect
        The first of them, as they are written.
    """
    far = [
        abs(x - problem.priors[key].mean) > MAX_SHIFT_SD * problem.priors[key].deviation
        for key, x in zip(fit.free, fit.point.tolist())
        if key in problem.priors
    ]
    if not any(far):
        return False
    held = frozenset((i, p.name) for i, e in enumerate(assumed) for p in e.searched())
    effects = (*assumed, *fit.effects[len(assumed) :])
    as_written = maximise(replace(problem, effects=effects, fixed=problem.fixed | held))
    return fit.likelihood.value - as_written.likelihood.value > MIN_RETUNING_NATS


def check(channel: str, record: Record, noise: ChannelNoise) -> None:
    """Raise `InputError` where a comparison would mean nothing.

    Parameters
    ----------
    channel : str
    record : Record
    noise : ChannelNoise
    """
    if record.y.size < 4 * MIN_SAMPLES:
        raise InputError(
            f"{channel} has {record.y.size} samples, too few to fit and to prove",
            remedy=f"Log at least {4 * MIN_SAMPLES}",
        )
    if not np.ptp(record.y) > 0.0:
        raise InputError(f"{channel} never changes", remedy="Check the sensor and the column")
    check_model(channel, noise)


def check_model(channel: str, noise: ChannelNoise) -> None:
    """Raise `InputError` where nothing in what is assumed of a channel is white."""
    if not has_white_noise(noise.effects):
        raise InputError(
            f"the model of {channel} has no white noise",
            remedy="Give it an effect white_noise, or identify it first",
        )


def chance_of_gains(record: Evidence, effects: Sequence[Effect]) -> float:
    """What an addition pays beside a response whose gains were estimated and are off by chance [nats].

    Parameters
    ----------
    record : Evidence
    effects : sequence of Effect
        The addition last, fitted; one that acts below the response pays nothing.

    Returns
    -------
    float
    """
    if not is_among_gains(record, effects[:-1], effects[-1]):
        return 0.0
    price = CHANCE_OF_GAINS_OF_A_LINE_NATS if effects[-1].coefficients() else CHANCE_OF_GAINS_NATS
    far = np.array([np.inf])
    variance = max(float(e.variance_of_measured(far, record.duration)[0]) for e in effects[:-1])
    return price * 2.0 * variance / (1.0 + variance)


def is_among_gains(record: Evidence, effects: Sequence[Effect], effect: Effect) -> bool:
    """Whether an effect acts where a response in the model has its gains.

    Parameters
    ----------
    record : Evidence
    effects : sequence of Effect
        Of the model, fitted.
    effect : Effect
        One of them, or beside them.

    Returns
    -------
    bool
    """
    starts = [e.knots[0] for e in effects if isinstance(e, SensorResponse)]
    if not starts:
        return False
    if effect.coefficients():
        return effect.lowest_hz > starts[0]
    if effect.is_filter:
        return True
    data = record.ordinates(())
    whole = effects if effect in effects else [*effects, effect]
    weight = data.count * (data.part(effect) * data.weight(whole)) ** 2
    return float(weight[data.frequency > starts[0]].sum()) > 0.5 * float(weight.sum())
