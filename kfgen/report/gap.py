"""The answer of ``gap``: for each comparison a sentence first, then pictures, before and after, detection limits."""

from __future__ import annotations

import difflib

from kfgen.core.numbers import quantity
from kfgen.core.units import derived_unit
from kfgen.gap.core.battery import FALSE_ALARM_RATE, Test
from kfgen.gap.core.holdout import Gap
from kfgen.gap.core.result import NO_GAP, Comparison, Finding
from kfgen.gap.flight_words import PARKED, noise_factor_sentence, not_excited_sentence, outage_sentence
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.result import GapResult, Proof, span_of_test
from kfgen.gap.words import (
    VERDICTS,
    check_sentences,
    finding_sentence,
    left_sentences,
    limit_words,
    noise_scale_sentences,
    not_excited_words,
    own_noise_sentence,
    parameter_words,
    percent,
    size_words,
    verdict_sentence,
)
from kfgen.report.figures.gap_figures import figures
from kfgen.report.page import (
    Answer,
    Page,
    PagePart,
    code,
    columns,
    heading,
    sentence,
    source_words,
    table,
    text,
)

FINDINGS_HEAD = ("of", "effect", "parameter", "value", "95 % interval", "probability", "closes")
NOT_EXCITED = "Not excited by the motion of this log: what it cannot show"
NOT_EXCITED_HEAD = ("effect", "would be seen from", "excited by")
MAX_TEST_ROWS = 20
"""Rows of a table of tests."""
LEAST_P = 1e-99
"""Probability below which no digit of it means anything."""
RETUNED_MIN_RELATIVE_CHANGE = 0.01
"""Of a number that was estimated again, below which it is not said."""


def gap_answer(result: GapResult) -> Answer:
    """Text, JSON and page."""
    head = _together(result)
    lines, parts = [*head, *([""] if head else [])], [*(text(w) for w in head), *_overview(result)]
    for c in result.comparisons:
        lines += [*comparison_lines(c), ""]
        parts += _comparison_parts(c)
    if diff := model_diff(result):
        lines += ["The model changes by", diff, ""]
        parts += [
            heading("What changes in the model"),
            code(diff),
            code(result.updated_text, "The updated model, ready to be copied", folded=True),
        ]
    for more_lines, more_parts in (_recordings(result), _proofs(result)):
        lines += more_lines
        parts += more_parts
    of = f"{len(result.logs)} recordings" if head else result.logs[0].name.rsplit("/", 1)[-1]
    verdict = tuple(f"{verdict_sentence(c)}." for c in result.comparisons)
    good = all(c.verdict == NO_GAP for c in result.comparisons)
    logs = tuple(("log", source_words(log.name, log.sha256)) for log in result.logs)
    page = Page(f"Model against {of}", tuple(parts), verdict, good, logs)
    return Answer("\n".join(lines).rstrip(), result.to_dict(), page, warnings=result.warnings)


def model_diff(result: GapResult) -> str:
    """What changes in the model's file."""
    texts = result.assumed_text.splitlines(), result.updated_text.splitlines()
    return "\n".join(difflib.unified_diff(*texts, "assumed", "updated", lineterm="", n=1))


def _overview(result: GapResult) -> list[PagePart]:
    """Every finding in a table: its size with its interval, how probable it is, what it closes."""
    rows = []
    for c in result.comparisons:
        closed = f"{100 * c.gap.closed:.0f} %" if c.gap.before > 0.0 and c.is_updated else ""
        for f in c.findings:
            sizes = [p for p in f.effect.estimated() if p.name in f.ci95] or list(f.effect.estimated())
            for k, p in enumerate(sizes):
                value, interval = size_words(f, p, derived_unit(p.unit, f.unit))
                first = [f.where, f.effect.title] if k == 0 else ["", ""]
                rows.append(
                    [
                        *first,
                        p.name,
                        value,
                        interval,
                        *([_short_percent(f.probability), closed] if k == 0 else ["", ""]),
                    ]
                )
            if not sizes:
                rows.append([f.where, f.effect.title, "", "", "", _short_percent(f.probability), closed])
    return [heading("What was found"), table(FINDINGS_HEAD, rows)] if rows else []


def _short_percent(p: float) -> str:
    return percent(p).replace("more than", ">")


def comparison_lines(c: Comparison) -> list[str]:
    """What was found, and the figures, for a terminal."""
    lines = [f"{w}." for w in sentences(c)] + [columns(_figures_rows(c))]
    if c.checks:
        lines += [f"  {w}" for w in check_sentences(c.checks)]
    if seen := [m for m in c.limits if m.is_excited]:
        lines += ["  Detection limits", columns([list(limit_words(m)) for m in seen])]
    if unseen := [m for m in c.limits if not m.is_excited]:
        rows = [list(not_excited_words(m)) for m in unseen]
        lines += [f"  {NOT_EXCITED}", columns([list(NOT_EXCITED_HEAD), *rows])]
    return lines


def _comparison_parts(c: Comparison) -> list[PagePart]:
    tests = [_test_cells(c, t) for t in c.before if t.significant][:MAX_TEST_ROWS]
    head = ("channel", "test", "time [s]", "band [Hz]", "power found / expected", "adjusted p")
    caption = f"Tests that the assumed model fails (family-wise rate {100 * FALSE_ALARM_RATE:g} %)."
    parts = [
        heading(", ".join(c.channels)),
        *(sentence(f"{w}.") for w in sentences(c)[1:] or sentences(c)),
        *figures(c),
        table(("held-out mismatch", ""), _figures_rows(c)),
        table(head, tests or [["none significant", "", "", "", "", ""]], caption, folded=True),
    ]
    if c.checks:
        parts.append(text(" ".join(f"{w}." for w in check_sentences(c.checks))))
    if seen := [m for m in c.limits if m.is_excited]:
        limits = "Detection limits: what would not have been seen"
        parts.append(table(("effect", "below"), [list(limit_words(m)) for m in seen], limits, folded=True))
    if unseen := [m for m in c.limits if not m.is_excited]:
        rows = [list(not_excited_words(m)) for m in unseen]
        parts.append(table(NOT_EXCITED_HEAD, rows, NOT_EXCITED, folded=True))
    return parts


def sentences(c: Comparison) -> list[str]:
    """The verdict, numbers that do not hold, channels that this one goes with, and the findings."""
    others = dict.fromkeys(t.other for t in c.before if t.other and t.significant)
    along = [f"{c.channels[0]} goes with the channel {n}" for n in others]
    if isinstance(c, ChannelGap) and c.comb_hz:
        along.append(
            f"its lines are harmonics of {c.comb_hz:.6g} Hz: something repeats every {1.0 / c.comb_hz:.6g} s, "
            "and more lines would follow"
        )
    return [
        verdict_sentence(c),
        *([PARKED[0].upper() + PARKED[1:]] if c.parked else []),
        *(_retuned_numbers(c) if isinstance(c, ChannelGap) and c.retuned else ()),
        *([own_noise_sentence(c.channels[0], c.own_noise_objection)] if c.own_noise_objection else []),
        *noise_scale_sentences(c.noise_scales),
        *map(noise_factor_sentence, c.noise_factors),
        *along,
        *(finding_sentence(c, f) for f in c.findings),
        *left_sentences(c),
        *(outage_sentence(*pair) for pair in c.outages),
        *([not_excited_sentence(unseen)] if (unseen := [m for m in c.limits if not m.is_excited]) else []),
    ]


def _retuned_numbers(c: ChannelGap) -> list[str]:
    """Assumed numbers that do not hold, as they were and as they are."""
    terms, said = list(c.updated.terms), []
    for old in c.assumed:
        term = next((t for t in terms if t.effect.name == old.name), None)
        if term is None:
            continue
        terms.remove(term)
        for p in old.estimated():
            was, unit = float(getattr(old, p.name)), derived_unit(p.unit, c.unit)
            if abs(float(getattr(term.effect, p.name)) - was) > RETUNED_MIN_RELATIVE_CHANGE * abs(was):
                said.append(f"{c.channel}: {parameter_words(term, p, unit)} instead of {quantity(was, unit)}")
    return said


def gap_rows(gap: Gap, updated: bool) -> list[list[str]]:
    """The held-out mismatch before and after, and the share that closed.

    Parameters
    ----------
    gap : Gap
    updated : bool
        Whether anything was changed in the model.
    """

    def nats(value: float) -> str:
        return f"{value:.3g} nats per sample" if value > 0.0 else "none above chance"

    closed = "nothing to close"
    if gap.before > 0.0 and updated:
        lo, hi = gap.ci95
        closed = f"{100 * gap.closed:.0f} % (95 %: {100 * lo:.0f} to {100 * hi:.0f})"
    return [
        ["held-out mismatch before", nats(gap.before)],
        ["held-out mismatch after", nats(gap.after)],
        ["closed", closed],
    ]


def _figures_rows(c: Comparison) -> list[list[str]]:
    return [
        *gap_rows(c.gap, c.is_updated),
        ["significant tests before", str(sum(t.significant for t in c.before))],
        ["significant tests after", str(sum(t.significant for t in c.after))],
        *(
            [f"rms residual of {n}", f"{a:.3g} standard deviations of its noise before, {b:.3g} after"]
            for n, a, b in c.rms
        ),
    ]


def _test_cells(c: Comparison, t: Test) -> list[str]:
    lo, hi = span_of_test(c, t)
    a, b = t.band_hz
    band = f"{a:.4g}" if a == b else f"{a:.2g} to {b:.2g}"
    p = f"{t.p:.2g}" if t.p >= LEAST_P else f"below {LEAST_P:g}"
    return [t.channel, t.name, f"{lo:.4g} to {hi:.4g}", band, f"{t.ratio:.3g}", p]


def _together(result: GapResult) -> list[str]:
    if len(result.logs) == 1:
        return []
    return [
        f"{len(result.logs)} recordings together; the figures are of each recording in turn, "
        "pictures of the first."
    ]


def _recordings(result: GapResult) -> tuple[list[str], list[PagePart]]:
    """Each of several recordings by itself, and what happened once in it."""
    if not result.recordings:
        return [], []
    title = "Each recording by itself" if len(result.logs) > 1 else "Its beginning by itself"
    rows = [
        [c.channels[0], r.name, _alone(own)]
        for c in result.comparisons
        for r in result.recordings
        for own in r.comparisons
        if own.channels == c.channels
    ]
    once = [f"Once, in {name} only: {finding_sentence(c, f)}." for name, c, f in result.once]
    lines = [
        f"{title}:",
        *(f"  {c} of {name}: {words}" for c, name, words in rows),
        *once,
        "",
    ]
    parts = [heading(title), table(("channel", "recording", "answer"), rows)]
    return lines, [*parts, *(text(w) for w in once)]


def _alone(c: Comparison) -> str:
    def words(f: Finding) -> str:
        return f"{f.name} ({100.0 * f.probability:.3g} %)"

    return ": ".join([VERDICTS[c.verdict], *([", ".join(map(words, c.findings))] if c.findings else [])])


def _proofs(result: GapResult) -> tuple[list[str], list[PagePart]]:
    """What other recordings say of what was found."""
    lines: list[str] = []
    parts: list[PagePart] = []
    changed = {c.channels[0]: c.is_updated for c in result.comparisons}
    for p in result.proofs:
        head = f"{p.channel} on another recording, {p.gap.held_out}"
        rows = [[r[0].removeprefix("held-out "), *r[1:]] for r in gap_rows(p.gap, changed[p.channel])]
        said = _once_words(p)
        lines += [head, columns(rows), *(f"  {w}" for w in said), ""]
        parts += [heading(head), table(("mismatch", ""), rows), *(text(w) for w in said)]
    return lines, parts


def _once_words(p: Proof) -> list[str]:
    once = " and ".join(p.happened_once)
    return [f"{once}: happened once, and is not looked for there"] if once else []
