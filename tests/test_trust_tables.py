"""Proves that the table of false alarms reads the page it collects from, and counts what is drawn beside it."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest
from scipy.stats import beta

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.quick


@pytest.fixture
def nulls(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module that makes the table."""
    monkeypatch.setattr(sys, "path", [str(ROOT / "benchmarks" / "trust"), *sys.path])
    return importlib.import_module("nulls")


def test_every_place_of_the_page_that_is_counted_is_there(nulls: ModuleType) -> None:
    """Each pattern stands in the page once; else `read` raises."""
    alarms, covered = nulls.collected((ROOT / "docs/benchmarks.md").read_text("utf-8"), [])
    assert all(0 <= c.k <= c.n and c.n > 0 for c in (*alarms.values(), *covered.values()))
    assert set(nulls.COVERED) == set(covered)


def test_a_place_that_reads_otherwise_is_an_error(nulls: ModuleType) -> None:
    with pytest.raises(ValueError, match="0 places like"):
        nulls.read(next(iter(nulls.COVERED.values())), "95 % intervals held the truth in most cases")


def test_drawn_records_are_counted_by_world_and_kind(nulls: ModuleType, tmp_path: Path) -> None:
    """Three without an effect, of which one is called a gap; one of two intervals holds."""
    path = tmp_path / "drawn.jsonl"
    null = {"world": "w", "kind": "null", "covered": [], "error": ""}
    single = {
        "world": "w",
        "kind": "single",
        "exact": False,
        "covered": [["a", True], ["b", False]],
        "error": "",
    }
    lines = [{**null, "exact": exact} for exact in (True, False, True)]
    path.write_text("\n".join(map(json.dumps, [*lines, single])), encoding="utf-8")
    found = list(nulls.scores([path]))
    alarms, held = (sum((c[k] for c in found), nulls.Count()) for k in (1, 2))
    assert (alarms.k, alarms.n, held.k, held.n) == (1, 3, 1, 2)
    path.write_text(json.dumps({**lines[0], "error": "no answer"}), encoding="utf-8")
    with pytest.raises(ValueError, match="no answer"):
        list(nulls.scores([path]))


def test_the_band_is_clopper_and_pearsons(nulls: ModuleType) -> None:
    """C. J. Clopper, E. S. Pearson, Biometrika 26, 1934: quantiles of beta distributions."""
    low, high = beta.ppf(0.025, 2, 299), beta.ppf(0.975, 3, 298)
    assert nulls.Count(2, 300).band == f"{100 * low:.2g} to {100 * high:.3g} %"
