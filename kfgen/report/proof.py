"""The answer of ``verify``."""

from __future__ import annotations

import math
from pathlib import Path

import kfgen
from kfgen.report.page import Answer, Page, columns, sentence, table
from kfgen.verify.core import CoreVerdict
from kfgen.verify.rounding import OnLog

VERDICT_HEAD = ("core", "words", "differing", "instructions", "stack [B]", "code [B]")


def verdict_rows(verdicts: list[CoreVerdict]) -> list[list[str]]:
    """One row a core."""
    rows = []
    for v in verdicts:
        counts = ", ".join(f"{r} {n}" for r, n in v.cost.instructions.items())
        rows.append(
            [
                v.core,
                str(v.words),
                str(v.differing),
                counts or "not counted",
                _known(v.cost.stack_bytes),
                _known(v.cost.text_bytes),
            ]
        )
    return rows


def _known(value: int | None) -> str:
    return "-" if value is None else str(value)


def verify_sentence(verdicts: list[CoreVerdict]) -> str:
    """The proof in words."""
    wrong = [v for v in verdicts if v.differing]
    if wrong:
        return "; ".join(
            f"{v.differing} of {v.words} words differ on {v.core} (by up to {v.max_ulp} ulp)" for v in wrong
        )
    exact = [v for v in verdicts if not v.tolerance]
    said = [
        f"{v.core} agrees with the reference within {v.tolerance:g} of a deviation"
        for v in verdicts
        if v.tolerance
    ]
    if exact:
        where, words = " and ".join(v.core for v in exact), sum(v.words for v in exact)
        said.insert(0, f"The emitted filter gives the words of its reference on {where}: 0 of {words} differ")
    return "; ".join(said)


def on_log_sentences(found: OnLog) -> list[str]:
    """What was played, and what single precision does to it, in words."""
    counts = ", ".join(f"{n} {r}" for r, n in found.calls.items())
    refused = ", ".join(f"{n} {s}" for s, n in found.refused.items()) or "none refused"
    r = found.rounding
    attitude = "" if r.attitude is None else f" the attitude within {r.attitude:.2g} rad,"
    return [
        f"Over {found.seconds:.6g} s of {Path(found.source).name}: {counts}; {refused}.",
        f"Beside double precision (kfgen run):{attitude} every state within {r.share:.2g} of its deviation "
        f"({r.state} at {r.t:.6g} s), deviations within {100.0 * r.spread:.2g} %.",
    ]


def verify_answer(model_hash: str, verdicts: list[CoreVerdict], found: OnLog | None = None) -> Answer:
    """The comparison, with its counts, and what a log adds to it."""
    rows = verdict_rows(verdicts)
    data = {
        "format": "kfgen-verify-1",
        "kfgen": kfgen.__version__,
        "model_hash": model_hash,
        "cores": {
            v.core: {
                "words": v.words,
                "differing": v.differing,
                "max_ulp": v.max_ulp,
                "tolerance": v.tolerance,
                "calls": v.calls,
                "instructions": v.cost.instructions,
                "stack_bytes": v.cost.stack_bytes,
                "text_bytes": v.cost.text_bytes,
                "stack_bytes_by_routine": v.cost.stacks,
                "text_bytes_by_routine": v.cost.texts,
            }
            for v in verdicts
        },
    }
    words = [f"{verify_sentence(verdicts)}."]
    if found is not None:
        words += on_log_sentences(found)
        data["log"] = _on_log_data(found)
    page = Page("Proof on cores", (*map(sentence, words), table(VERDICT_HEAD, rows)))
    text = "\n".join([columns([list(VERDICT_HEAD), *rows]), *words])
    warnings = () if found is None else found.warnings
    return Answer(text, data, page, ok=not any(v.differing for v in verdicts), warnings=warnings)


def _on_log_data(found: OnLog) -> dict[str, object]:
    r = found.rounding
    return {
        "source": found.source,
        "sha256": found.sha256,
        "duration_s": found.seconds,
        "calls": dict(found.calls),
        "refused": dict(found.refused),
        "beside_double": {
            "attitude_rad": r.attitude,
            "state": r.state,
            "deviations": r.share if math.isfinite(r.share) else None,
            "t_s": r.t,
            "relative_of_deviation": r.spread if math.isfinite(r.spread) else None,
        },
    }
