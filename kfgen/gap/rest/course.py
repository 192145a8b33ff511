"""Whether random effects of a channel at rest, added or of other numbers than assumed, took courses as their names say.

Slow noise leaves white residuals whatever made it: a resonance of that spectrum stands for a chaotic supply, a
Gauss-Markov bias for a door that opens and shuts. The course that an effect took is the mean that Wiener's filter gives,
ordinate by ordinate of the cosine transform; it is compared with courses of records that the updated model gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, sampled_spectrum
from kfgen.effects.effect import LinearProcess
from kfgen.effects.process.periodic import Resonance, Sinusoid
from kfgen.effects.process.stochastic import GaussMarkov
from kfgen.effects.process.telegraph import RandomTelegraph
from kfgen.effects.samples.event import Outliers
from kfgen.effects.samples.intermittent import IntermittentNoise
from kfgen.gap.core.jump_law import jumps_log_odds
from kfgen.gap.core.level_law import MANY_LEVELS, many_levels_log_odds
from kfgen.gap.core.random_course import COURSE_POINTS, FALSE_ALARM_RATE, least_usual
from kfgen.gap.core.result import Finding
from kfgen.gap.core.swing_law import MODULATED_LINE, comes_and_goes_log_odds, other_law
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.evidence import Candidate, series_of
from kfgen.gap.rest.explanation import ChannelExplanation
from kfgen.gap.rest.words import louder_by_a_clock
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

CHANCE_COURSES = ((199, 0.2), (999, 0.06), (1999, FALSE_ALARM_RATE))
"""Records of the updated model, and the chance of the course among them above which it is usual and no more are drawn."""
MAX_COURSE_POINTS, LEAST_OVER_SHOWN = 2048, 1.5
"""Of a course that is fast, unless that does not show it: then there are so many over those ordinates."""
MOST_COURSE_POINTS = 8192
"""Of any course."""
MAX_DRAWN_NUMBERS, LEAST_DRAWN = 4_000_000, 999
"""Of all courses together: of long ones fewer are drawn, but so many."""
SHOWN_SHARE = 0.99
"""Of the power of a course."""
POINTS_OVER_SHOWN = 4
"""Ordinates over those that have this share: what is fast says most of a law."""
STEPS_OF_A_POINT = 8
"""Of what is simulated in time."""
LOG_ODDS_OF_ITS_OWN_LAW = 2.0
"""Of what an effect is named, over all other laws of its spectrum, before the record is seen [nats]. A likelihood that is so
much larger makes these likelier: of 240 true resonances of 10 to 1000 nats 4 have it (3 of 10 or 30 nats, none of 1000), of
32 true telegraphs and 33 true Gauss-Markov biases none, of 160 true lines four (all of 10 nats)."""


@dataclass(frozen=True)
class OtherLaw:
    """What an effect may be that has its spectrum.

    Parameters
    ----------
    words : str
    log_odds : float
        Over its own law, after the record was seen [nats].
    """

    words: str = ""
    log_odds: float = -np.inf

    @staticmethod
    def seen(words: str, log_likelihood_ratio: float) -> OtherLaw:
        """With the odds before the record was seen."""
        return OtherLaw(words, log_likelihood_ratio - LOG_ODDS_OF_ITS_OWN_LAW)

    @property
    def objection(self) -> str:
        """The words, where it is likelier than the effect's own."""
        return self.words if self.log_odds > 0.0 else ""

    @property
    def own_probability(self) -> float:
        """Of the effect's own law; a stand-in for another law keeps its share among what has a name."""
        return 1.0 if self.objection else float(1.0 / (1.0 + np.exp(self.log_odds)))


def with_objections(search: ChannelExplanation, findings: Sequence[Finding]) -> list[Finding]:
    """The findings, with what speaks against the courses that they took together, as probable as their laws are.

    Parameters
    ----------
    search : ChannelExplanation
        Finished.
    findings : sequence of Finding
        Of it.
    """
    base, assumed = search.base, len(search.effects)
    (record, *more) = records_of(base.problem.record)
    known, added = base.fit.effects[:assumed], base.fit.effects[assumed:]
    if more:
        return list(findings)
    if len(search.altering) == 1 and has_course(search.altering[0]):
        record, added = records_of(search.record)[0], (*added, *search.altering)
    every = [*known, *added]
    laws, said = list[OtherLaw](), ""
    for effect in (f.effect for f in findings):
        if said and has_course(effect):  # it stands in for what the first one stands in for
            laws.append(OtherLaw())
            continue
        if isinstance(effect, RandomTelegraph):
            laws.append(_more_levels(search))
        elif isinstance(effect, IntermittentNoise | Outliers):
            laws.append(_beat(search))
        else:
            laws.append(_other_law(base, record, every, effect))
        said = said or (laws[-1].objection if has_course(effect) else "")
    objection = said or none_of_their_kind(record, known, added)
    return [
        replace(
            f,
            probability=f.probability * law.own_probability,
            objection=objection if has_course(f.effect) else law.objection,
        )
        for law, f in zip(laws, findings)
    ]


def _beat(search: ChannelExplanation) -> OtherLaw:
    """Whether noise that is louder at times is so by a clock, and not by chance."""
    seconds, log_odds = IntermittentNoise.beat(
        series_of(replace(search.base, problem=replace(search.base.problem, record=search.record)))
    )
    return OtherLaw(louder_by_a_clock(seconds), log_odds)


def _more_levels(search: ChannelExplanation) -> OtherLaw:
    """Whether the only effect that changes samples is a telegraph that has more levels than two."""
    telegraphs = [e for e in search.altering if isinstance(e, RandomTelegraph)]
    if not telegraphs or len(search.altering) > 1:
        return OtherLaw()
    base, assumed = search.base, len(search.effects)
    base = replace(base, problem=replace(base.problem, record=search.record))
    fit = base.fit
    kept = tuple(e for k, e in enumerate(fit.effects) if k < assumed or not has_course(e))
    free = tuple(key for key in fit.free if key[0] < assumed)
    own = replace(fit, effects=kept, free=free, point=fit.point[: len(free)])
    odds = many_levels_log_odds(series_of(base), telegraphs[0], series_of(replace(base, fit=own)))
    return OtherLaw.seen(MANY_LEVELS, odds)


def own_noise_objection(search: ChannelExplanation) -> str:
    """What speaks against the course of the assumed noise where its numbers were estimated anew; empty where nothing does.

    A larger Gauss-Markov bias of the model follows a heater's pulses as one that was added would.

    Parameters
    ----------
    search : ChannelExplanation
        Finished.
    """
    base, assumed = search.base, len(search.effects)
    (record, *more) = records_of(base.problem.record)
    if more:
        return ""
    own, added = base.fit.effects[:assumed], base.fit.effects[assumed:]
    slow, others = [e for e in own if has_course(e)], [*(e for e in own if not has_course(e)), *added]
    laws = (_other_law(base, record, [*others, *slow], e).objection for e in slow)
    return next((words for words in laws if words), "") or none_of_their_kind(record, others, slow)


def none_of_their_kind(record: Record, known: Sequence[Effect], added: Sequence[Effect]) -> str:
    """In what the course of random effects is none of their kind; empty where in nothing, or where none has a course.

    Parameters
    ----------
    record : Record
        Without what changes samples, but for the added effects.
    known, added : sequence of Effect
        The updated model, those together whose courses are looked at last.
    """
    from scipy.fft import dct, idct

    effects = [*known, *added]
    slow = [e for e in added if has_course(e)]
    if not slow:
        return ""
    n, dt = record.n, record.dt / record.averaged
    omega: Array = np.asarray(np.arange(1, n) * (np.pi / n), dtype=np.float64)
    filters = [e for e in effects if e.is_filter]

    def density(some: Sequence[Effect]) -> Array:
        return np.maximum(
            sampled_spectrum([*some, *filters], omega, dt, record.averaged, n), np.finfo(float).tiny
        )

    own, whole = density(slow), density([e for e in effects if not e.is_filter])
    shown = np.cumsum(own**2 / whole)
    last = int(np.searchsorted(shown, SHOWN_SHARE * shown[-1])) + 2
    points = max(
        min(POINTS_OVER_SHOWN * last, MAX_COURSE_POINTS), COURSE_POINTS, int(LEAST_OVER_SHOWN * last)
    )
    points = min(points, MOST_COURSE_POINTS, n)
    gain = (own / whole)[: points - 1, None]

    def course(ordinates: Array) -> Array:
        return np.asarray(
            idct(np.vstack([np.zeros(ordinates.shape[1]), gain * ordinates]), axis=0, norm="ortho")
        )

    rng = np.random.default_rng(0)
    switching = [e for e in slow if not _is_normal(e)]
    normal = whole - density(switching) if switching else whole
    at = np.linspace(0.0, record.duration, min(STEPS_OF_A_POINT * points, n))

    def drawn(count: int) -> Array:
        X = np.sqrt(np.maximum(normal[: points - 1, None], 0.0)) * rng.standard_normal((points - 1, count))
        for e in switching:
            each = [dct(e.simulate(at, rng), norm="ortho")[1:points] for _ in range(count)]
            X += np.sqrt(n / at.size) * np.column_stack(each)
        return course(X)

    y = dct(record.y - record.drift(effects), norm="ortho")[1:points, None]
    t = record.elapsed[0] + (np.arange(points) + 0.5) * record.duration / points
    companions = {k: np.interp(t, record.elapsed, v) for k, v in record.drive.items() if np.ptp(v) > 0.0}
    companions |= {"time": t}
    own_course, every = course(y)[:, 0], np.empty((points, 0))
    words, chance = "", 1.0
    for most, usual in CHANCE_COURSES:
        more = min(most, max(MAX_DRAWN_NUMBERS // points, LEAST_DRAWN)) - every.shape[1]
        if more > 0:
            every = np.column_stack([every, drawn(more)])
            words, chance = least_usual(t, own_course, every, companions, law=True)
        if chance > usual:
            return ""
    return words


def _other_law(base: Candidate, record: Record, effects: Sequence[Effect], effect: Effect) -> OtherLaw:
    """By what other law a bias wanders or something swings beside the other effects of a model; by none for other effects."""
    if isinstance(effect, GaussMarkov):
        others = tuple(e for e in effects if e is not effect)
        fit = replace(base.fit, effects=others, free=(), point=np.zeros(0))
        alone = replace(base, fit=fit, problem=replace(base.problem, record=record))
        return OtherLaw.seen(*jumps_log_odds(series_of(alone), effect))
    if not isinstance(effect, Resonance | Sinusoid):
        return OtherLaw()
    z, omega, white = _without(record, effects, effect)
    size = float(effect.rms if isinstance(effect, Resonance) else effect.amplitude) / white
    if not (0.0 < omega < np.pi and 0.0 < size < np.inf):
        return OtherLaw()
    if isinstance(effect, Resonance):
        return OtherLaw.seen(*other_law(z, omega, float(effect.damping), size))
    return OtherLaw.seen(MODULATED_LINE, comes_and_goes_log_odds(z, omega, size))


def _without(
    record: Record, effects: Sequence[Effect], swing: Resonance | Sinusoid
) -> tuple[Array, float, float]:
    """The white record without what swings in its model, its frequency [rad per sample], and the noise beside it [SI]."""
    others = [e for e in effects if e is not swing]
    whitener = Whitener.on(record, others)
    omega = 2.0 * np.pi * float(swing.frequency) * record.dt
    weight = float(whitener.weight[min(round(omega / np.pi * record.n), record.n - 1)])
    return whitener.series(record.y - record.drift(others)), omega, 1.0 / weight if weight > 0.0 else np.inf


def has_course(effect: Effect) -> bool:
    """Whether an effect is noise that is correlated in time."""
    random = not effect.coefficients() and not effect.is_filter
    return random and isinstance(effect, LinearProcess) and effect.form().order > 0


def _is_normal(effect: Effect) -> bool:
    """Whether its law is normal: it is simulated as its linear system is."""
    return type(effect).simulate is LinearProcess.simulate
