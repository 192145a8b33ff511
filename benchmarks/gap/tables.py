"""Scores in tables of text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from case import OBVIOUS
from scipy.stats import beta
from score import ERROR, NONE, Score

SEPARABLE = (
    "quantisation",
    "sinusoid",
    "outliers",
    "bias_step",
    "temperature",
    "rate_ramp",
    "noise_change",
    "low_pass",
    "resonance",
)
"""Effects whose signature no other entry of the catalogue shares."""
BINS = ((0.0, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 0.99), (0.99, 1.0001))


def interval(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """The exact (Clopper-Pearson) interval of a share of k in n."""
    if not n:
        return 0.0, 1.0
    a = 0.5 * (1.0 - level)
    lo = float(beta.ppf(a, k, n - k + 1)) if k else 0.0
    hi = float(beta.ppf(1.0 - a, k + 1, n - k)) if k < n else 1.0
    return lo, hi


def share(hits: Iterable[bool]) -> str:
    """``12/20 0.60 [0.36, 0.81]``."""
    flags = [bool(h) for h in hits]
    if not flags:
        return "-"
    lo, hi = interval(sum(flags), len(flags))
    return f"{sum(flags)}/{len(flags)} {sum(flags) / len(flags):.2f} [{lo:.2f}, {hi:.2f}]"


def _level(X: float) -> str:
    return "obvious" if X >= OBVIOUS else f"{X:g} nats"


def _grid(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(r[k]) for r in rows) for k in range(len(rows[0]))]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(r, widths)).rstrip() for r in rows)


def _of(scores: Sequence[Score], kind: str) -> list[Score]:
    return [s for s in scores if s.kind == kind]


def report(scores: Sequence[Score]) -> str:
    """All tables of one world."""
    parts = [
        _title("one hidden effect", _singles(scores)),
        _title("each excitation", _excitations(scores)),
        _title("each effect", _effects(scores)),
        _title("a second record: gain of the updated model over that of the oracle", _second(scores)),
        _title("false alarms on null records", _nulls(scores)),
        _title("stacks: named exactly", _stacks(scores)),
        _title("outside the catalogue, near misses, thermometer withheld", _outside(scores)),
        _title("faults of the data", _faults(scores)),
        _title("claimed probability against share right (single effects)", _calibration(scores)),
        _title("95 % intervals that hold the truth", _coverage(scores)),
        _title("lowest AIC and BIC of the Allan variance: right first", _baselines(scores)),
        *(
            _title(f"said first (columns) of each truth (rows), {_level(X)}", confusion(scores, X))
            for X in sorted({s.strength for s in _of(scores, "single")}, reverse=True)
        ),
        _title("time per case", _times(scores)),
        _title("errors", _errors(scores)),
    ]
    return "\n\n".join(p for p in parts if p)


def _title(title: str, body: str) -> str:
    return f"{title}\n{'-' * len(title)}\n{body}" if body else ""


def _singles(scores: Sequence[Score]) -> str:
    singles = _of(scores, "single")
    rows = [
        ["strength", "right first, all", "separable", "detected", "truth in set", "mean set", "gap closed"]
    ]
    for X in sorted({s.strength for s in singles}, reverse=True):
        at = [s for s in singles if s.strength == X]
        seen = [s for s in at if s.verdict not in ("no_gap", ERROR)]
        sizes = [s.set_size for s in seen if s.set_size]
        closed = [s.closed for s in seen if not math.isnan(s.closed)]
        rows.append(
            [
                _level(X),
                share(s.right_first for s in at),
                share(s.right_first for s in at if s.cell in SEPARABLE),
                share(s.verdict not in ("no_gap", ERROR) for s in at),
                share(s.in_set for s in at),
                f"{np.mean(sizes):.2f}" if sizes else "-",
                f"{np.median(closed):.2f}" if closed else "-",
            ]
        )
    return _grid(rows) if len(rows) > 1 else ""


def _excitations(scores: Sequence[Score]) -> str:
    """Of moving sensors: rich, poor, and rich where two effects are alike all the same."""
    singles = [s for s in _of(scores, "single") if s.world == "motion"]
    rows = [["strength", "excitation", "named right first", "it, or its twin", "truth in set"]]
    for X in sorted({s.strength for s in singles}, reverse=True):
        for variant in sorted({_excitation(s) for s in singles}):
            at = [s for s in singles if s.strength == X and _excitation(s) == variant]
            rows.append(
                [
                    _level(X),
                    variant,
                    share(s.first in s.truths for s in at),
                    share(s.right_first for s in at),
                    share(s.in_set for s in at),
                ]
            )
    return _grid(rows) if singles else ""


def _excitation(s: Score) -> str:
    return s.variant.partition("-")[0]


def _effects(scores: Sequence[Score]) -> str:
    singles = _of(scores, "single")
    levels = sorted({s.strength for s in singles}, reverse=True)
    rows = [["effect", *(f"first, {_level(X)}" for X in levels), *(f"in set, {_level(X)}" for X in levels)]]
    for cell in dict.fromkeys(s.cell for s in singles):
        row = [cell]
        tests: tuple[Callable[[Score], bool], ...] = (lambda s: s.right_first, lambda s: s.in_set)
        for test in tests:
            for X in levels:
                at = [test(s) for s in singles if s.cell == cell and s.strength == X]
                row.append(f"{sum(at)}/{len(at)}")
        rows.append(row)
    return _grid(rows) if len(rows) > 1 else ""


def pooled(pairs: Sequence[tuple[float, float]]) -> str:
    """``0.97 [0.95, 0.98]``: the sum of gains over that of the oracle's, 95 % by bootstrap over the cases."""
    if not pairs:
        return "-"
    table = np.asarray(pairs)
    drawn = table[np.random.default_rng(0).integers(len(pairs), size=(4000, len(pairs)))].sum(axis=1)
    lo, hi = np.quantile(drawn[:, 0] / drawn[:, 1], (0.025, 0.975))
    return f"{table[:, 0].sum() / table[:, 1].sum():.2f} [{lo:.2f}, {hi:.2f}]"


def _second(scores: Sequence[Score]) -> str:
    """Of effects that last: all cases, those where something was named, and each effect."""
    have = [s for s in _of(scores, "single") if not math.isnan(s.best)]
    levels = sorted({s.strength for s in have}, reverse=True)
    rows = [["", *(f"{_level(X)}" for X in levels)]]

    def row(name: str, of: Sequence[Score], say: Callable[[list[tuple[float, float]]], str] = pooled) -> None:
        rows.append([name, *(say([(s.gained, s.best) for s in of if s.strength == X]) for X in levels)])

    row("cases", have, lambda pairs: str(len(pairs)))
    row("all, pooled", have)
    row("all, median", have, lambda pairs: f"{np.median([g / b for g, b in pairs]):.2f}" if pairs else "-")
    row("something named, pooled", [s for s in have if s.named])
    row("right first, pooled", [s for s in have if s.right_first])
    for cell in dict.fromkeys(s.cell for s in have):
        row(cell, [s for s in have if s.cell == cell])
    return _grid(rows) if have else ""


def _nulls(scores: Sequence[Score]) -> str:
    nulls = [s for s in _of(scores, "null") if s.verdict != ERROR]
    if not nulls:
        return ""
    rows = [["records", "verdict not no_gap", "what was said"]]
    for variant in ("all", *sorted({s.variant for s in nulls})):
        at = [s for s in nulls if variant in ("all", s.variant)]
        said = Counter(s.first for s in at if s.verdict != "no_gap")
        words = ", ".join(f"{k} {v}" for k, v in said.items())
        rows.append([variant, share(s.verdict != "no_gap" for s in at), words])
    return _grid(rows)


def _stacks(scores: Sequence[Score]) -> str:
    rows = [["stack", "exact", "recall", "false names per case"]]
    for kind in ("pair", "triple"):
        at = _of(scores, kind)
        if at:
            hits = [n in s.named for s in at for n in s.truths]
            false = [sum(n not in s.truths for n in s.named) for s in at]
            rows.append([kind, share(s.exact for s in at), share(hits), f"{np.mean(false):.2f}"])
    return _grid(rows) if len(rows) > 1 else ""


def _outside(scores: Sequence[Score]) -> str:
    rows = [
        ["truth", "said unknown", "nine tenths closed", "nothing left", "acceptable name", "missed", "named"]
    ]
    for kind in ("unknown", "near", "withheld"):
        for cell in dict.fromkeys(s.cell for s in _of(scores, kind)):
            at = [s for s in _of(scores, kind) if s.cell == cell]
            said = Counter("+".join(s.named) or s.first for s in at)
            rows.append(
                [
                    f"{cell} ({kind})",
                    share(_unknown(s) for s in at),
                    share(_closed(s) for s in at),
                    share(_nothing_left(s) for s in at),
                    share(s.right_first for s in at) if kind != "unknown" else "-",
                    share(s.verdict == "no_gap" for s in at),
                    ", ".join(f"{k} {v}" for k, v in said.most_common(4)),
                ]
            )
    outside = _of(scores, "unknown")
    lines = [_grid(rows)] if len(rows) > 1 else []
    if outside:
        lines += [
            f"unknown, or nine tenths closed:  {share(_unknown(s) or _closed(s) for s in outside)}",
            f"unknown, or nine tenths reached: {share(_unknown(s) or _reached(s) for s in outside)}"
            "  (of what the best normal model gains on a second record)",
            f"unknown, or nothing left:        {share(_unknown(s) or _nothing_left(s) for s in outside)}",
        ]
    return "\n".join(lines)


def _unknown(s: Score) -> bool:
    return s.verdict == "unknown_effect"


def _closed(s: Score) -> bool:
    """Named something, no test of the rest fails, and nine tenths of the held-out gap closed."""
    return s.verdict == "effects_found" and not s.remaining and s.closed >= 0.9


def _reached(s: Score) -> bool:
    """Named something, no test of the rest fails, and it predicts a second record nearly as well as the oracle."""
    return s.verdict == "effects_found" and not s.remaining and s.gained >= 0.9 * s.best


def _nothing_left(s: Score) -> bool:
    """Named something, no test of the rest fails, and no held-out gap above chance is left."""
    return s.verdict == "effects_found" and not s.remaining and s.after <= 0.0


def _faults(scores: Sequence[Score]) -> str:
    rows = [["fault", "named", "verdict bad_data", "said"]]
    faults = _of(scores, "integrity")
    for cell in dict.fromkeys(s.cell for s in faults):
        at = [s for s in faults if s.cell == cell]
        said = Counter(f"{s.verdict}: {s.first}" for s in at)
        rows.append(
            [
                cell,
                share(cell in (*s.named, s.first) for s in at),
                share(s.verdict == "bad_data" for s in at),
                ", ".join(f"{k} {v}" for k, v in said.most_common(3)),
            ]
        )
    return _grid(rows) if len(rows) > 1 else ""


def _calibration(scores: Sequence[Score]) -> str:
    rows = [["claimed", "mean claimed", "hidden itself"]]
    singles = [s for s in _of(scores, "single") if not math.isnan(s.probability)]
    for lo, hi in BINS:
        at = [s for s in singles if lo <= s.probability < hi]
        if at:
            mean = f"{np.mean([s.probability for s in at]):.3f}"
            rows.append([f"{lo:g} to {min(hi, 1.0):g}", mean, share(s.first_is_hidden for s in at)])
    sure = [s for s in singles if s.probability > 0.9]
    if sure:
        rows.append(
            ["> 0.9", f"{np.mean([s.probability for s in sure]):.3f}", share(s.right_first for s in sure)]
        )
    return _grid(rows) if len(rows) > 1 else ""


def _coverage(scores: Sequence[Score]) -> str:
    pairs = [c for s in _of(scores, "single") for c in s.covered]
    if not pairs:
        return ""
    rows = [["all", share(hit for _, hit in pairs)]]
    rows += [[name, share(h for n, h in pairs if n == name)] for name in dict.fromkeys(n for n, _ in pairs)]
    return _grid(rows)


def _baselines(scores: Sequence[Score]) -> str:
    rows = [["records", "kfgen", "AIC", "BIC"]]
    have = [s for s in scores if s.allan_aic]
    groups = [
        (f"{_level(X)}", [s for s in _of(have, "single") if s.strength == X])
        for X in sorted({s.strength for s in _of(have, "single")}, reverse=True)
    ]
    for name, at in groups:
        rows.append([name, *(share(t(s) == s.cell for s in at) for t in _SAID)])
    nulls = _of(have, "null")
    if nulls:
        rows.append(["null: nothing said", *(share(t(s) == NONE for s in nulls) for t in _SAID)])
    return _grid(rows) if len(rows) > 1 else ""


_SAID: tuple[Callable[[Score], str], ...] = (lambda s: s.first, lambda s: s.allan_aic, lambda s: s.allan_bic)


def confusion(scores: Sequence[Score], X: float) -> str:
    """Counts of what was said first, at one strength."""
    at = [s for s in _of(scores, "single") if s.strength == X]
    truths = list(dict.fromkeys(s.cell for s in at))
    said = [*(t for t in truths if any(s.first == t for s in at))]
    said += sorted({s.first for s in at} - set(said))
    rows = [["", *(_short(n) for n in said)]]
    for truth in truths:
        counts = Counter(s.first for s in at if s.cell == truth)
        rows.append([truth, *(str(counts[n]) if counts[n] else "." for n in said)])
    return _grid(rows) if at else ""


def _short(name: str) -> str:
    return "_".join(part[:4] for part in name.split("_"))


def _times(scores: Sequence[Score]) -> str:
    seconds = [s.seconds for s in scores if s.verdict != ERROR]
    if not seconds:
        return ""
    return f"{np.median(seconds):.2f} s median, {np.max(seconds):.2f} s longest, {len(seconds)} cases"


def _errors(scores: Sequence[Score]) -> str:
    counts = Counter((s.kind, s.error[:200]) for s in scores if s.verdict == ERROR)
    return "\n".join(f"{n} x {kind}: {text}" for (kind, text), n in counts.most_common(20))
