"""What was found, in words: one vocabulary for every kind of log and model."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kfgen.core.numbers import digits_of, quantity
from kfgen.core.units import derived_unit, from_si
from kfgen.effects import catalogue
from kfgen.effects.effect import Parameter
from kfgen.effects.faults.samples import Fault
from kfgen.effects.inertial.magnetic import SoftIron
from kfgen.effects.noise_model import Term
from kfgen.gap.core.battery import Test
from kfgen.gap.core.result import (
    BAD_DATA,
    EFFECTS_FOUND,
    NO_GAP,
    UNKNOWN_EFFECT,
    Checks,
    Comparison,
    DetectionLimit,
    Finding,
    NoiseScale,
)
from kfgen.gap.core.search import Refused
from kfgen.gap.core.thresholds import NEARLY_ALIKE_MIN_COS2, NOTHING_MIN_PROBABILITY
from kfgen.gap.motion.candidates import FIELD_PREFIX
from kfgen.gap.rest.evidence import RETUNE

VERDICTS = {
    NO_GAP: "model and record agree",
    EFFECTS_FOUND: "an effect is missing from the model, and it is named",
    UNKNOWN_EFFECT: "something is missing from the model that the catalogue does not explain",
    BAD_DATA: "the data are faulty, and a fit to them would mean nothing",
}
NUMBERS_OF_THE_MODEL = "other numbers of the model itself"
"""What a record does not rule out where these could stand in the place of an effect."""
MAX_RECORD_FACTOR = 1000.0
"""Times the length of a record beyond which nobody logs."""
MIN_SAID_COS2 = 0.5
"""Squared cosine above which a likeness is said with its number."""
NESTED_TOLERANCE_NATS = 1e-6
"""Change of a log-likelihood that is none."""
MAX_NEARLY_ALIKE = 3
"""Effects that are said to look alike."""
MAX_KINDS_LEFT = 3
"""Kinds of tests of which is said what they see."""
TAILS_PER_KURTOSIS = 3.0
"""Kurtosis of Gaussian noise, in which the ratio of the test for tails is counted."""
_POWERS = ("power", "power in a stretch")
MAX_REFUSED_SAID = 3
"""Effects that were not added, of which the names are said."""


def percent(p: float) -> str:
    """A probability in words."""
    return "more than 99.9 %" if p > 0.999 else f"{100 * p:.3g} %"


def compared_at(rate_hz: float) -> str:
    """Of a long flight whose inertial samples are averaged."""
    return f"the flight is compared at {rate_hz:.4g} Hz: of so long a log inertial samples are averaged between its steps"


def verdict_sentence(c: Comparison) -> str:
    """The verdict in words."""
    of = ", ".join(c.channels)
    if c.verdict == NO_GAP:
        return f"{of}: {VERDICTS[NO_GAP]} as far as {c.span_s[1] - c.span_s[0]:.0f} s can tell"
    if c.verdict == BAD_DATA and c.constant_inputs:
        still = ", ".join(c.constant_inputs)
        return f"{of}: what was recorded is not driven by the input {still}, which never changes; check its column"
    if c.verdict == EFFECTS_FOUND and not c.findings:
        return f"{of}: model structure confirmed; {'parameters' if c.retuned else 'the size of its noise'} re-estimated"
    if c.verdict == EFFECTS_FOUND and len(c.findings) > 1:
        return f"{of}: {len(c.findings)} effects are missing from the model, and they are named"
    return f"{of}: {VERDICTS[c.verdict]}"


def left_sentences(c: Comparison) -> list[str]:
    """What tests see in the residuals of a record that nothing explains, the strongest of each kind, of the worst channel."""
    left = sorted((t for t in c.after if t.significant), key=lambda t: t.p)
    if c.verdict != UNKNOWN_EFFECT or not left:
        return []
    channel = left[0].channel or c.channels[0]
    kinds: dict[tuple[str, bool], str] = {}
    for t in (t for t in left if (t.channel or channel) == channel):
        kinds.setdefault(("power", t.ratio > 1.0) if t.name in _POWERS else (t.name, True), _seen_by(t))
    said = [words for words in kinds.values() if words]
    return [f"What is left of {channel}: {'; '.join(said[:MAX_KINDS_LEFT])}"] if said else []


def _seen_by(t: Test) -> str:
    """What a test saw, in words; empty of one whose name says it elsewhere."""
    kurtosis = TAILS_PER_KURTOSIS * (t.ratio - 1.0)
    return {
        **dict.fromkeys(_POWERS, f"{t.ratio:.2g} times the power of its noise {_band(t)}"),
        "periodic line": f"a periodic line {_band(t)}",
        "constant offset": "a constant offset",
        "tails": f"{'more' if kurtosis > 0.0 else 'fewer'} large values than Gaussian noise has (excess kurtosis {kurtosis:.2g})",
        "skewness": "values that are larger to one side than to the other",
        "correlated squares": "noise that is louder at some times than at others",
    }.get(t.name, "")


def noise_scale_sentences(scales: Sequence[NoiseScale]) -> list[str]:
    """Noises of another size in words, each size once: channels of one sensor share theirs."""
    alike: dict[tuple[float, tuple[float, float], bool], list[str]] = {}
    for s in scales:
        alike.setdefault((s.times, s.ci95, s.white), []).append(s.channel)
    return [
        f"The {'white noise' if white else 'noise'} of {', '.join(channels)} is {times:.3g} times as large as assumed "
        f"(95 %: {lo:.3g} to {hi:.3g})"
        for (times, (lo, hi), white), channels in alike.items()
    ]


def finding_sentence(c: Comparison, f: Finding) -> str:
    """A finding in words: what, where, how large, how probable, what it closes, what else it could be.

    Parameters
    ----------
    c : Comparison
        To which it belongs.
    f : Finding
    """
    if isinstance(f.effect, Fault):
        words = f.effect.sentence(f.where, f.unit)
        others = dict.fromkeys(f"{name} of {where}" for name, where, _ in f.alternatives)
        others.pop(f"{f.name} of {f.where}", None)
        return f"{words}. Just as well it is {' or '.join(others)}" if others else words
    words = f"{_what(f)}{_in_unknown_field(c, f)}. It is "
    words += (
        f"the likeliest of all candidates, but it {_stands_in(f.objection)}"
        if f.objection
        else f"{percent(f.probability)} probable among all candidates"
    )
    if f.nothing_probability > NOTHING_MIN_PROBABILITY:
        words += f", that nothing is missing {percent(f.nothing_probability)}"
    if f.test is not None:
        words += f"; without it the mismatch is strongest {_band(f.test)}"
    if c.gap.before > 0.0:
        words += (
            f". The updated model removes {100 * c.gap.closed:.0f} % of the mismatch on held-out data "
            f"({c.gap.held_out})"
        )
    if f.indistinguishable:
        words += f". This log does not rule out {'; or '.join(_likened(f, n) for n in f.indistinguishable)}"
    alike = sorted((o for o in f.others if o.cos2 > NEARLY_ALIKE_MIN_COS2), key=lambda o: -o.cos2)
    near = [n for n in dict.fromkeys(o.effect for o in alike) if n not in (f.name, *f.indistinguishable)]
    if near:
        words += f"; in this log it looks nearly like {', '.join(near[:MAX_NEARLY_ALIKE])}"
    return words


def own_noise_sentence(channel: str, objection: str) -> str:
    """That other numbers of the assumed noise are no explanation, in words.

    Parameters
    ----------
    channel : str
    objection : str
        In what the course of that noise is none of its kind.
    """
    return f"{channel}: the noise with these numbers {_stands_in(objection)}"


def _stands_in(objection: str) -> str:
    return f"stands in for something else, for the course that it took is none of its kind: {objection}"


def _what(f: Finding) -> str:
    """The effect with its size; of a wrong number, what it is and what the model says."""
    if f.assumed_value is None:
        shown = [p for p in f.effect.estimated() if p.name in f.ci95 or getattr(f.effect, p.name)]
        size = ", ".join(parameter_words(f, p, derived_unit(p.unit, f.unit)) for p in shown)
        title = f"{f.effect.title}, {size}" if size else f.effect.title
        return f"The model of {f.where} is missing an effect: {title}{_when(f)}"
    error = float(getattr(f.effect, _VALUE))
    away = derived_unit("U", f.unit)
    new, old = (_beside(v, error, f.unit) for v in (f.assumed_value + error, f.assumed_value))
    lo, hi = (from_si(v, away) for v in f.ci95[_VALUE])
    words = f"{f.where} {'starts at' if f.once else 'is'} {new} instead of {old}"
    return f"{words}, off by {quantity(error, away)} (95 %: {lo:.3g} to {hi:.3g})"


_VALUE = "value"


def _beside(value: float, error: float, unit: str) -> str:
    """A value [SI] in a unit, with as many digits as its error has."""
    orders = [math.floor(math.log10(abs(v))) if v else 0 for v in (value, error)]
    return f"{from_si(value, unit):.{min(3 + max(orders[0] - orders[1], 0), 12)}g} {unit}".rstrip()


def parameter_words(f: Finding | Term, p: Parameter, unit: str) -> str:
    """A parameter of an effect with its value and, where there is one, its 95 % interval.

    Parameters
    ----------
    f : Finding or Term
    p : Parameter
        Of its effect.
    unit : str
        In which it is said.
    """
    value, interval = size_words(f, p, unit)
    return f"{p.name} = {value}" + (f" (95 %: {interval})" if interval else "")


def size_words(f: Finding | Term, p: Parameter, unit: str) -> tuple[str, str]:
    """The value of a parameter and its 95 % interval, with as many digits as the interval deserves.

    Parameters
    ----------
    f : Finding or Term
    p : Parameter
        Of its effect.
    unit : str
        In which it is said.

    Returns
    -------
    value : str
    interval : str
        Empty where there is none.
    """
    number = float(getattr(f.effect, p.name))
    if p.name not in f.ci95:
        return quantity(number, unit), ""
    lo, hi = (from_si(v, unit) for v in f.ci95[p.name])
    digits = digits_of(lo, hi)
    return quantity(number, unit, digits), f"{lo:.{digits}g} to {hi:.{digits}g}"


def _when(f: Finding) -> str:
    """The span of an effect that is not always there."""
    start, lasts = (float(getattr(f.effect, n, 0.0)) for n in ("time", "duration"))
    return f", from {start:.4g} to {start + lasts:.4g} s" if lasts else ""


def _in_unknown_field(c: Comparison, f: Finding) -> str:
    """Which scales of soft iron were taken to be zero, where nobody knows how large the field is."""
    scales = ("xx", "yy", "zz")
    fixed = [e for e in scales if e not in f.ci95]
    unknown = any("field" in name.split() or name.startswith(FIELD_PREFIX) for name in c.unknowns)
    if not (isinstance(f.effect, SoftIron) and unknown and 0 < len(fixed) < len(scales)):
        return ""
    held = f"{' and '.join(fixed)} {'is' if len(fixed) == 1 else 'are'} taken to be zero"
    return f"; in a field of unknown size only differences of xx, yy and zz can be seen: {held}"


def _band(t: Test) -> str:
    """The band of a test, and its span of time where it is not the whole record."""
    lo, hi = t.band_hz
    words = f"at {lo:.4g} Hz" if lo == hi else f"in {lo:.2g} to {hi:.2g} Hz"
    return words + (f" from {t.span[0]:.4g} to {t.span[1]:.4g} s" if t.span else "")


def _likened(f: Finding, name: str) -> str:
    """Another name that the log does not rule out, how much it looks like what was found, and what would tell."""
    near = [o for o in f.others if o.effect == name]
    cos2 = max((o.cos2 for o in near), default=0.0)
    known = catalogue().get(name)
    ways = [
        f"a record {x:.2g} times as long"
        for o in near[:1]
        if 1.0 < (x := o.record_factor or 1.0) < MAX_RECORD_FACTOR
    ]
    if known is not None:
        ways += [w for w in (f.effect.distinguishing_experiment(name) or known.separating_experiment,) if w]
    said = [f"cos2 {cos2:.2f}"] if cos2 > MIN_SAID_COS2 or any(o.nats is not None for o in near) else []
    said += [f"distinguished by {' or '.join(ways).rstrip(',')}"] if ways else []
    name = NUMBERS_OF_THE_MODEL if name == RETUNE else name
    return f"{name} ({', '.join(said)})" if said else name


def distinguishing(f: Finding) -> str:
    """What would tell it from every other name that the log does not rule out."""
    found = dict.fromkeys(f.effect.distinguishing_experiment(n) for n in f.indistinguishable)
    return " and ".join(w for w in found if w)


def check_sentences(checks: Checks) -> list[str]:
    """The checks of what was added, in words."""
    nested = checks.nested_nats < NESTED_TOLERANCE_NATS
    out = [
        "Check passed: with added terms set to zero the original likelihood is recovered"
        if nested
        else f"Check failed: an added term set to zero changes the likelihood by {checks.nested_nats:.2g} nats"
    ]
    hidden = [n for n, ok in checks.seen.items() if not ok]
    out.append(
        f"Check failed: this log does not bound the size of {', '.join(hidden)} away from zero"
        if hidden
        else "Check passed: 95 % intervals of all added terms exclude zero"
    )
    if checks.found_again is None:
        return [*out, "Check skipped (log too long): re-detection in simulated data"]
    found = ", ".join(checks.found_again) or "nothing"
    if sorted(checks.found_again) == sorted(checks.named):
        return [*out, f"Check passed: re-detection in simulated data finds {found}"]
    return [
        *out,
        f"Check failed: re-detection in simulated data finds {found}, not {', '.join(checks.named)}: "
        "take the names with care",
    ]


def refused_sentence(refused: Sequence[Refused]) -> str:
    """What was not added in spite of its evidence, and why: the best few by name."""
    best = sorted(refused, key=lambda r: -r.evidence_nats)
    by_reason: dict[str, list[str]] = {}
    for r in best[:MAX_REFUSED_SAID]:
        title = catalogue()[r.effect].title if r.effect in catalogue() else r.effect
        nats = f" ({r.evidence_nats:.3g} nats)" if r.evidence_nats else ""
        by_reason.setdefault(r.why, []).append(title + (f" of {r.where}" if r.where else "") + nats)
    said = "; ".join(f"{', '.join(names)}: {why}" for why, names in by_reason.items())
    more = f"; and {len(best) - MAX_REFUSED_SAID} more" if len(best) > MAX_REFUSED_SAID else ""
    return f"Not added in spite of the evidence: {said}{more}"


def not_excited_words(m: DetectionLimit) -> tuple[str, str, str]:
    """What is not excited, the size from which on it would be seen all the same, and what would excite it."""
    what, size = limit_words(m)
    return what, size, m.manoeuvre or "no manoeuvre known"


def limit_words(m: DetectionLimit) -> tuple[str, str]:
    """What has a detection limit, and the limit."""
    if not math.isfinite(m.value):
        return f"{m.effect.name} {m.parameter} of {m.where}", "at no size"
    unit = derived_unit({p.name: p.unit for p in m.effect.parameters()}[m.parameter], m.unit)
    times = [
        f" at tau = {getattr(m.effect, p.name):.3g} s" for p in m.effect.parameters() if p.kind == "time"
    ]
    return f"{m.effect.name} {m.parameter} of {m.where}", f"{quantity(m.value, unit)}{''.join(times)}"
