"""What an answer of ``kfgen gap`` is worth beside the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

EXACT = 0.05
"""Probability above which an alternative counts as not ruled out, where the answer gives no set."""
NONE, ERROR, UNKNOWN, RETUNE = "none", "error", "unknown", "retune"


@dataclass(frozen=True)
class Score:
    """One case, scored.

    Parameters
    ----------
    first : str
        The name given first; ``none``, ``unknown``, ``retune`` (numbers anew, no effect) or ``error``.
    named : tuple of str
        All effects that were added.
    right_first : bool
        The first name is a hidden effect (or an exact equivalent of it).
    in_set : bool
        The truth is the first name or cannot be distinguished from it.
    set_size : int
    probability : float
        Claimed for the first name; nan without one.
    exact : bool
        The set of names is the set of hidden effects.
    covered : tuple of (str, bool)
        Parameters of the rightly named effects, and whether their 95 % intervals hold the truth.
    closed : float
        Fraction of the held-out gap that the updated model closes, by the tool's own account.
    after : float
        Held-out gap of the updated model by the tool's own account; zero or less is none above chance.
    remaining : bool
        A test of what is left is significant, by the tool's own account.
    gained, best : float
        Nats over the assumed model on a second record, of the updated model and of the oracle; see `second`.
    """

    id: str
    world: str
    kind: str
    cell: str
    variant: str
    strength: float
    truths: tuple[str, ...]
    verdict: str
    first: str
    named: tuple[str, ...]
    right_first: bool
    in_set: bool
    set_size: int
    probability: float
    exact: bool
    covered: tuple[tuple[str, bool], ...]
    closed: float
    after: float
    remaining: bool
    seconds: float
    gained: float = math.nan
    best: float = math.nan
    error: str = ""
    allan_aic: str = ""
    allan_bic: str = ""

    @property
    def first_is_hidden(self) -> bool:
        """The first name itself is hidden: of what is exactly alike each has its own share of the probability."""
        return self.first in self.truths

    @property
    def plain(self) -> dict[str, Any]:
        """As data for a file."""
        return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(self).items()}


def score(truth: Mapping[str, Any], answer: Mapping[str, Any], seconds: float) -> Score:
    """Compare one answer, or ``{"error": …}``, with the truth."""
    hidden = truth["hidden"]
    names = [{h["effect"], *h["also"]} for h in hidden]
    accepted = set().union(*names) if names else set()
    steps = steps_of(answer)
    verdict = str(answer.get("verdict", ERROR)) if "error" not in answer else ERROR
    first = _first(verdict, steps)
    options = _options(steps[0]) if steps else {first}
    named = tuple(str(s["effect"]) for s in steps)
    gap = answer.get("gap") or {}
    return Score(
        id=truth["id"],
        world=truth["world"],
        kind=truth["kind"],
        cell=truth["cell"],
        variant=truth["variant"],
        strength=truth["strength"],
        truths=tuple(h["effect"] for h in hidden),
        verdict=verdict,
        first=first,
        named=named,
        right_first=first in accepted if hidden else verdict == "no_gap",
        in_set=bool(options & accepted) if hidden else verdict == "no_gap",
        set_size=len(options) if steps else 0,
        probability=float(steps[0].get("probability", math.nan)) if steps else math.nan,
        exact=_exact(named, names) if hidden else verdict == "no_gap",
        covered=_covered(hidden, steps),
        closed=_number(gap.get("closed_fraction")),
        after=_number(gap.get("after")),
        remaining=bool((answer.get("remaining") or {}).get("significant", False)),
        seconds=seconds,
        error=str(answer.get("error", "")),
    )


def steps_of(answer: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The effects named, in order; faults of the data count as steps wherever the answer lists them."""
    found = [s for s in answer.get("steps") or [] if isinstance(s, Mapping) and "effect" in s]
    for key in ("integrity", "faults", "data"):
        listed = answer.get(key)
        if isinstance(listed, Sequence) and not isinstance(listed, str):
            said = [{"effect": s} if isinstance(s, str) else s for s in listed]
            found = [s for s in said if isinstance(s, Mapping) and "effect" in s] + found
    return found


def _first(verdict: str, steps: Sequence[Mapping[str, Any]]) -> str:
    if steps:
        return str(steps[0]["effect"])
    return {"no_gap": NONE, "unknown_effect": UNKNOWN, "effects_found": RETUNE}.get(verdict, verdict)


def _options(step: Mapping[str, Any]) -> set[str]:
    """The effect and what the answer says cannot be distinguished from it."""
    listed = step.get("indistinguishable")
    if listed is None:
        listed = [a for a in step.get("alternatives", ()) if float(a.get("probability", 0.0)) > EXACT]
    return {str(step["effect"]), *(str(a["effect"] if isinstance(a, Mapping) else a) for a in listed)} - {
        NONE
    }


def _exact(named: Sequence[str], truths: Sequence[set[str]]) -> bool:
    left = list(truths)
    for name in named:
        match = next((k for k, names in enumerate(left) if name in names), None)
        if match is None:
            return False
        del left[match]
    return not left


def _covered(
    hidden: Sequence[Mapping[str, Any]], steps: Sequence[Mapping[str, Any]]
) -> tuple[tuple[str, bool], ...]:
    """Intervals of effects named by their own name; a sign or phase counts as it is.

    Where the truth has a standard deviation of its own the interval is that of the difference.
    """
    out = []
    for h in hidden:
        step = next((s for s in steps if s["effect"] == h["effect"]), None)
        given = (step or {}).get("parameters", {})
        for name, value in h["parameters"].items():
            interval = given.get(name, {}).get("ci95") if isinstance(given.get(name), Mapping) else None
            if interval and None not in interval:
                lo, hi = float(interval[0]), float(interval[1])
                half = 1.96 * h.get("deviations", {}).get(name, 0.0)
                if half:
                    best = float(given[name]["value"])
                    lo, hi = best - math.hypot(best - lo, half), best + math.hypot(hi - best, half)
                out.append((f"{h['effect']}.{name}", bool(lo <= value <= hi)))
    return tuple(out)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan
