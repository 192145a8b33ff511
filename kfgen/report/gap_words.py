"""What ``gap`` says of one channel, in words."""

from __future__ import annotations

from kfgen.core.units import derived_unit, from_si
from kfgen.effects.faults.samples import Fault
from kfgen.effects.noise_model import Term
from kfgen.effects.process.periodic import Sinusoid
from kfgen.gap.rest.comb import comb_of
from kfgen.gap.rest.finding import ChannelGap, Finding
from kfgen.report.identify import quantity

VERDICTS = {
    "no_gap": "model and record agree",
    "effects_found": "an effect is missing from the model, and it is named",
    "unknown_effect": "something is missing from the model that the catalogue does not explain",
    "bad_data": "the data are faulty, and a fit to them would mean nothing",
}


SAME = 0.01
"""Relative change of a number below which it is not said."""


def finding_sentence(g: ChannelGap, f: Finding) -> str:
    """A missing effect in words: name, size, share, band, alternatives; of a fault, what is wrong."""
    if isinstance(f.effect, Fault):
        return f.effect.sentence(g.channel, g.unit)
    size = ", ".join(with_interval(f, p.name, derived_unit(p.unit, g.unit)) for p in f.effect.estimated())
    words = (
        f"{g.channel} misses an effect of the model: {f.effect.title}{', ' + size if size else ''}. It is {percent(f.probability)} "
        f"probable among all candidates; without it the disagreement is strongest {_where(f)}"
    )
    if g.gap.before > 0.0:
        words += (
            f", and on {g.gap.held_out}, which the fit did not see, {100 * g.gap.closed:.0f} % of it closes"
        )
    if f.indistinguishable:
        told = {o.other: o.words(type(f.effect)) for o in f.others}
        words += (
            f". This record does not rule out {'; or '.join(told.get(n, n) for n in f.indistinguishable)}"
        )
    return words


def _where(f: Finding) -> str:
    """Band, and span of time where it is not the whole record."""
    lo, hi = f.worst.band_hz
    words = f"at {lo:.4g} Hz" if lo == hi else f"in {lo:.2g} to {hi:.2g} Hz"
    return words + (f" from {f.worst.span[0]:.4g} to {f.worst.span[1]:.4g} s" if f.worst.span else "")


def percent(p: float) -> str:
    """A probability in words."""
    return "more than 99.9 %" if p > 0.999 else f"{100 * p:.3g} %"


def with_interval(f: Finding | Term, name: str, unit: str) -> str:
    """A value with its unit and its interval, where there is one."""
    value = quantity(float(getattr(f.effect, name)), unit)
    if name in f.ci95:
        lo, hi = (from_si(v, unit) for v in f.ci95[name])
        value += f" (95 %: {lo:.3g} to {hi:.3g})"
    return f"{name} = {value}"


def verdict_sentence(g: ChannelGap) -> str:
    """The verdict of a channel in words."""
    if g.verdict == "no_gap":
        return f"{g.channel}: {VERDICTS[g.verdict]} as far as {g.record.duration:.0f} s can tell"
    if g.retuned and not g.findings and g.verdict == "effects_found":
        return f"{g.channel}: the structure of the model holds, its numbers do not; they are fitted anew"
    if g.verdict == "effects_found" and len(g.findings) > 1:
        return f"{g.channel}: {len(g.findings)} effects are missing from the model, and they are named"
    return f"{g.channel}: {VERDICTS[g.verdict]}"


def numbers_anew(g: ChannelGap) -> list[str]:
    """Believed numbers that do not hold, as they were and as they are."""
    if not g.retuned:
        return []
    terms, said = list(g.mended.terms), []
    for old in g.believed:
        term = next((t for t in terms if t.effect.name == old.name), None)
        if term is None:
            continue
        terms.remove(term)
        for p in old.estimated():
            was, unit = float(getattr(old, p.name)), derived_unit(p.unit, g.unit)
            if abs(float(getattr(term.effect, p.name)) - was) > SAME * abs(was):
                said.append(
                    f"{g.channel}: {with_interval(term, p.name, unit)} instead of {quantity(was, unit)}"
                )
    return said


def sentences(g: ChannelGap) -> list[str]:
    """The verdict, other channels that this one goes with though they have no effect that is known, the findings."""
    others = [t.other for t in g.before if t.other and t.significant]
    along = [f"{g.channel} goes with the channel {n}" for n in others]
    comb = comb_of(
        [e.frequency for e in (f.effect for f in g.findings) if isinstance(e, Sinusoid)], g.record.duration
    )
    if comb:
        along.append(
            f"its lines are harmonics of {comb:.6g} Hz: something repeats every {1.0 / comb:.6g} s, and more lines would follow"
        )
    return [verdict_sentence(g), *numbers_anew(g), *along, *(finding_sentence(g, f) for f in g.findings)]
