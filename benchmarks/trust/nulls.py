"""False alarms and intervals over all worlds, collected from what the benchmarks measured, with exact binomial bands.

Usage: python benchmarks/trust/nulls.py [SCORES.json ...] [RECORD.jsonl ...] [--docs]

The figures are those of docs/benchmarks.md, and of scores that ``python benchmarks/gap --json SCORES.json`` or
``python benchmarks/trust/drawn.py RECORD.jsonl`` wrote, which are counted beside them. A place of the page that no longer reads as it did is an error, not a row that is left out.
``--docs`` writes the table into the page of trust.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from scipy.stats import binomtest

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks")]

from docs_table import DOCS, write_table  # noqa: E402

NULLS = {
    "sensors at rest": r"\| nothing hidden \| (?P<k>\d+)\s+of\s+(?P<n>\d+)\s+called\s+a\s+gap",
    "real recordings": r"(?P<k>\d+)\s+of\s+(?P<n>\d+)\s+pieces\s+with\s+decoys\s+beside\s+them\s+called\s+a\s+gap",
    "moving sensors": r"(?P<k>\d+)\s+of\s+(?P<n>\d+)\s+without\s+an\s+effect\s+called\s+a\s+gap;\s+\d+\s+of\s+\d+\s+names\s+claimed\s+with\s+more\s+than\s+90\s+%\s+right;\s+95\s+%",
    "plants": r"alone\s+in\s+the\s+set;\s+(?P<k>\d+)\s+of\s+(?P<n>\d+)\s+without\s+an\s+effect\s+called\s+a\s+gap",
    "flights without a reference": r"\| nothing hidden \| (?P<silent>\d+)\s+of\s+(?P<n>\d+)\s+silent",
}
"""Where the page says how many records without an effect were called a gap, by world."""
SILENCE = r"\| `(?P<model>[\w-]+)` \| (?P<n>\d+) \| \d+ \| (?P<k>\d+) \|"
"""A row of the table of library models on logs of their own."""
ALARM = r"`(?P<model>[\w-]+)`, [\w-]+, seed (?P<seed>\d+):"
"""A false alarm of that table."""
SHARED = "library models on logs of their own"
"""The row of that table, whose logs share random numbers."""
MANOEUVRES = 12
"""Logs of one seed in that table, which share their random numbers."""
COVERED = {
    "sensors at rest": r"95\s+%\s+intervals\s+held\s+the\s+truth\s+in\s+(\d+)\s+of\s+(\d+)\s+\(95\s+to\s+99\s+%\)",
    "real recordings": r"95\s+%\s+intervals\s+held\s+the\s+truth\s+in\s+(\d+)\s+of\s+(\d+)\s+\(82\s+to\s+93\s+%\)",
    "moving sensors": r"95\s+%\s+intervals\s+held\s+the\s+truth\s+in\s+(\d+)\s+of\s+(\d+)\s+\(87\s+to\s+95\s+%\)",
    "flights without a reference": r"95\s+%\s+intervals\s+hold\s+the\s+truth\s+in\s+(\d+)\s+of\s+(\d+)\.\s+First",
}
"""Where it says how many intervals of planted effects hold the truth, by world."""


@dataclass
class Count:
    """How many of how many."""

    k: int = 0
    n: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(self.k + other.k, self.n + other.n)

    @property
    def band(self) -> str:
        """The exact 95 % interval of the share."""
        found = binomtest(self.k, self.n).proportion_ci(method="exact")
        return f"{100 * found.low:.2g} to {100 * found.high:.3g} %"


def read(pattern: str, page: str) -> re.Match[str]:
    """The one place of a page; raises `ValueError` where it is not there once."""
    found = list(re.finditer(pattern, page))
    if len(found) != 1:
        raise ValueError(f"docs/benchmarks.md has {len(found)} places like {pattern}: correct the pattern")
    return found[0]


def scores(paths: list[Path]) -> Iterator[tuple[str, Count, Count]]:
    """By world of each file: false alarms, and intervals that hold the truth."""
    for path in paths:
        text = path.read_text("utf-8")
        is_lines = path.suffix == ".jsonl"
        for s in map(json.loads, text.splitlines()) if is_lines else json.loads(text)["scores"]:
            if s["error"]:
                raise ValueError(f"{path}: no answer of {s['world']}: {s['error']}")
            if s["kind"] == "null":
                yield s["world"], Count(int(not s["exact"]), 1), Count()
            yield s["world"], Count(), Count(sum(bool(held) for _, held in s["covered"]), len(s["covered"]))


def collected(page: str, paths: list[Path]) -> tuple[dict[str, Count], dict[str, Count]]:
    """False alarms and intervals by world."""
    alarms, covered = dict[str, Count](), dict[str, Count]()
    for world, pattern in NULLS.items():
        found = read(pattern, page).groupdict()
        n = int(found["n"])
        alarms[world] = Count(int(found["k"]) if "k" in found else n - int(found["silent"]), n)
    rows = [m.groupdict() for m in re.finditer(SILENCE, page)]
    alarms[SHARED] = Count(sum(int(r["k"]) for r in rows), sum(int(r["n"]) for r in rows))
    drawn = Counter((m["model"], m["seed"]) for m in re.finditer(ALARM, page))
    alarms[f"the same, by random numbers: {MANOEUVRES} logs share theirs"] = Count(
        len(drawn), alarms[SHARED].n // MANOEUVRES
    )
    for world, pattern in COVERED.items():
        k, n = map(int, read(pattern, page).groups())
        covered[world] = Count(k, n)
    for world, alarm, held in scores(paths):
        alarms[f"{world}, beside these"] = alarms.get(f"{world}, beside these", Count()) + alarm
        covered[f"{world}, beside these"] = covered.get(f"{world}, beside these", Count()) + held
    return alarms, covered


def table(alarms: dict[str, Count], covered: dict[str, Count]) -> str:
    """Markdown: worlds with their false alarms and their intervals."""
    rows = ["| records without a hidden effect | called a gap | of | exact 95 % band |", "|---|---|---|---|"]
    whole = sum((c for name, c in alarms.items() if not name.startswith("the same")), Count())
    distinct = sum((c for name, c in alarms.items() if name != SHARED), Count())
    sums = [("all", whole), ("all with random numbers of their own", distinct)]
    rows += [f"| {n} | {c.k} | {c.n} | {c.band} |" for n, c in [*alarms.items(), *sums] if c.n]
    rows += [
        "",
        "| 95 % intervals of planted effects | hold the truth | of | exact 95 % band |",
        "|---|---|---|---|",
    ]
    everything = sum(covered.values(), Count())
    rows += [f"| {n} | {c.k} | {c.n} | {c.band} |" for n, c in [*covered.items(), ("all", everything)] if c.n]
    return "\n".join(rows)


def main() -> int:
    """Collect and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scores", type=Path, nargs="*", help="what benchmarks/gap --json or drawn.py wrote")
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    text = table(*collected((DOCS / "benchmarks.md").read_text("utf-8"), given.scores))
    print(text)
    if given.docs:
        write_table("trust.md", "nulls", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
