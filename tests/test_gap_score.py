"""Proves that the blind benchmark counts an interval as holding the truth where it does, known exactly or not."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

AT = Path(__file__).parents[1] / "benchmarks" / "gap" / "score.py"
SPEC = importlib.util.spec_from_file_location("gap_score", AT)
assert SPEC is not None
assert SPEC.loader is not None
MODULE = sys.modules[SPEC.name] = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(MODULE)

TRUTH = {
    "id": "a",
    "world": "recorded",
    "kind": "single",
    "cell": "misalignment",
    "variant": "v",
    "strength": 1.0,
}
ANSWER = {
    "verdict": "effects_found",
    "steps": [
        {
            "effect": "misalignment",
            "probability": 0.9,
            "parameters": {"zy": {"value": 0.020, "ci95": [0.018, 0.022]}},
        }
    ],
}


def held(true: float, deviation: float | None) -> bool:
    hidden: dict[str, Any] = {
        "effect": "misalignment",
        "channel": "gyro_z",
        "also": [],
        "parameters": {"zy": true},
    }
    if deviation is not None:
        hidden["deviations"] = {"zy": deviation}
    ((name, ok),) = MODULE.score({**TRUTH, "hidden": [hidden]}, ANSWER, 1.0).covered
    assert name == "misalignment.zy"
    return bool(ok)


@pytest.mark.parametrize(("true", "ok"), [(0.0215, True), (0.0225, False), (0.0185, True), (0.0175, False)])
def test_interval_of_a_number_that_is_known(true: float, ok: bool) -> None:
    assert held(true, None) is ok
    assert held(true, 0.0) is ok


@pytest.mark.parametrize(("true", "ok"), [(0.0228, True), (0.0230, False), (0.0172, True), (0.0170, False)])
def test_interval_of_the_difference_where_the_number_was_found_with_a_standard_deviation(
    true: float, ok: bool
) -> None:
    """Both are 0.001: half an interval of the difference is sqrt(0.002**2 + (1.96 * 0.001)**2) = 0.0028."""
    assert held(true, 0.001) is ok
