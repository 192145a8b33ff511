"""Proves the emitted `ins23` beside PX4-ECL over a recorded replay, whose states PX4-ECL wrote itself."""

from __future__ import annotations

import os
import runpy
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples" / "recordings"


@pytest.mark.long
def test_states_are_within_three_standard_deviations(
    recording: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until the landing, which is a jump of 0.9 m/s within a few samples: there within four."""
    folder = recording("flights/ecl_iris_gps_replay.csv").parent
    if shutil.which(os.environ.get("CC") or "cc") is None:
        pytest.skip("there is no C compiler on this machine")
    monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])
    example = runpy.run_path(str(EXAMPLES / "px4_ecl.py"))
    given = example["replay"](folder)
    flying = example["differences"](given, example["TOUCH_DOWN_S"])
    landed = example["differences"](given)
    assert flying.keys() == {"position", "velocity", "attitude"}
    assert 0.1 < max(flying.values()) < 3.0
    assert max(landed.values()) < 4.0
