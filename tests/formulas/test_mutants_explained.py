"""What is said of changes that no test can notice is said of lines that are there."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks" / "trust"))

from same_answer import SAME_ANSWER, reason  # noqa: E402


@pytest.mark.parametrize(("path", "piece", "change", "why"), SAME_ANSWER)
def test_a_reason_is_that_of_a_line(path: str, piece: str, change: str, why: str) -> None:
    lines = [line for line in (ROOT / path).read_text(encoding="utf-8").splitlines() if piece in line]
    assert lines, f"{path} no longer has {piece}"
    assert all(reason(path, line, change or "1 -> 2") for line in lines)
    assert len(why) > 20
