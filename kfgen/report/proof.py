"""The answer of ``verify``."""

from __future__ import annotations

from pathlib import Path

from kfgen.report.page import Answer, Page, columns, sentence, table
from kfgen.verify.compare import Verification
from kfgen.verify.rounding import OnLog


def on_log_sentences(found: OnLog) -> list[str]:
    """What was played, and what single precision does to it, in words."""
    counts = ", ".join(f"{n} {r}" for r, n in found.calls.items())
    refused = ", ".join(f"{n} {s}" for s, n in found.refused.items()) or "none refused"
    r = found.rounding
    attitude = "" if r.attitude is None else f" the attitude within {r.attitude:.2g} rad,"
    return [
        f"Over {found.seconds:.6g} s of {Path(found.source).name}: {counts}; {refused}.",
        f"Beside double precision (kfgen run):{attitude} every state within {r.share:.2g} of its standard deviation "
        f"({r.state} at {r.t:.6g} s), standard deviations within {100.0 * r.spread:.2g} %.",
    ]


def verify_answer(found: Verification) -> Answer:
    """The comparison, with its counts, and what a log adds to it."""
    head, rows = found.short_table()
    words = [f"{'; '.join(found.summary())}."]
    if found.on_log is not None:
        words += on_log_sentences(found.on_log)
    facts = (("filter", found.model_hash[:16]),)
    parts = (*map(sentence, words[1:]), table(head, rows))
    page = Page("Proof on cores", parts, (words[0],), found.ok, facts)
    text = "\n".join([columns([head, *rows]), *words])
    warnings = () if found.on_log is None else found.on_log.warnings
    return Answer(text, found.to_dict(), page, ok=found.ok, warnings=warnings)
