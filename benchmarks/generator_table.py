"""What generators of code cost, as a table of the documentation: nobody types a figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from textwrap import wrap

from docs_table import measured_at, write_table


@dataclass(frozen=True)
class Measured:
    """What a generator's code costs: flops, instructions, stack and code [B], and seconds to write it."""

    name: str
    flops: int
    changes: int
    instructions: int
    stack: int
    code: int
    seconds: float
    error: float

    @property
    def line(self) -> str:
        """As the terminal shows it."""
        return (
            f"  {self.name:18} {self.flops:>7} {self.changes:>8} {self.flops / self.changes:>6.1f} {self.instructions:>8}"
            f" {self.stack:>7} {self.code:>7} {self.seconds:>9.2f}  {self.error:.1e}"
        )

    @property
    def cells(self) -> tuple[str, ...]:
        """As the page shows it."""
        return tuple(str(n) for n in (self.flops, self.instructions, self.stack, self.code))


@dataclass(frozen=True)
class Cost:
    """What one call costs: executed floating-point operations and instructions, stack, and all code [B]."""

    flops: int
    instructions: int
    stack: int
    code: int


def advantage(found: dict[str, list[Measured]]) -> str:
    """By how much each form of kfgen is ahead of the best other generator, in words; behind where it is."""
    parts = []
    for own in ("kfgen p", "kfgen ud"):
        for what in ("flops", "instructions"):
            said = []
            for model, rows in found.items():
                best = min(
                    (r for r in rows if not r.name.startswith("kfgen")), key=lambda r: getattr(r, what)
                )
                mine = getattr(next(r for r in rows if r.name == own), what)
                less = 100.0 * (1.0 - mine / getattr(best, what))
                said.append(
                    f"{abs(less):.1f} % {'fewer' if less >= 0 else 'more'} than {best.name} ({model})"
                )
            parts.append(f"`{own}` takes {' and '.join(said)} {what}")
    return "; ".join(parts) + "."


def write(found: dict[str, list[Measured]], bounds: dict[str, int], load: float) -> None:
    """The page's table."""
    models = list(found)
    head = [f"{m} {c}" for m in models for c in ("flops", "instructions", "stack [B]", "code [B]")]
    lines = [f"| | {' | '.join(head)} |", f"|{'---|' * (len(head) + 1)}"]
    for of_one in zip(*found.values(), strict=True):
        lines.append(f"| {of_one[0].name} | {' | '.join(c for r in of_one for c in r.cells)} |")
    least = " and ".join(f"{b} ({m})" for m, b in bounds.items())
    words = f"{advantage(found)} No elementary congruence in place takes fewer flops than {least}. {measured_at(load)}."
    write_table("benchmarks.md", "generators", "\n".join([*lines, "", *wrap(words, 119)]))


Filters = dict[str, dict[str, Cost]]
"""Of one model: the cost of each routine, by generator."""


def a_second(costs: Mapping[str, Cost], rates: Mapping[str, int], what: str) -> int:
    """Operations or instructions of a second of flight."""
    return sum(rates[name.removeprefix("update_")] * getattr(c, what) for name, c in costs.items())


def whole_advantage(found: Mapping[str, Filters], rates: Mapping[str, int]) -> str:
    """By how much each form of kfgen is ahead of the best other generator over a second, in words; behind where it is."""
    parts = []
    for own in ("kfgen p", "kfgen ud"):
        for what in ("flops", "instructions"):
            said = []
            for model, filters in found.items():
                others = [n for n in filters if not n.startswith("kfgen")]
                best = min(others, key=lambda n: a_second(filters[n], rates, what))
                mine, least = (a_second(filters[n], rates, what) for n in (own, best))
                less = 100.0 * (1.0 - mine / least)
                said.append(f"{abs(less):.1f} % {'fewer' if less >= 0 else 'more'} than {best} ({model})")
            parts.append(f"`{own}` takes {', '.join(said)} {what}")
    return "; ".join(parts) + "."


def write_whole(found: Mapping[str, Filters], rates: Mapping[str, int], load: float) -> None:
    """The table of whole filters."""
    head = ("filter", "generator", "`predict`", "updates", "a second", "stack [B]", "code [B]")
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for model, filters in found.items():
        for name, costs in filters.items():
            calls = [f"{c.flops}, {c.instructions}" for c in costs.values()]
            second = " / ".join(f"{a_second(costs, rates, w) / 1000:.0f}k" for w in ("flops", "instructions"))
            stack, code = max(c.stack for c in costs.values()), next(iter(costs.values())).code
            lines.append(
                f"| {model} | {name} | {calls[0]} | {'; '.join(calls[1:])} | {second} | {stack} | {code} |"
            )
    words = f"{whole_advantage(found, rates)} {measured_at(load)}."
    write_table("benchmarks.md", "whole filters", "\n".join([*lines, "", *wrap(words, 119)]))
