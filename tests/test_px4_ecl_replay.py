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
    """Until the landing, within four there: the samples' sum and GNSS have the emitted filter's jump, PX4-ECL has more.

    GNSS has noise of 0.03 m/s, a mean of five before and after 0.02.
    """
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
    jump = example["landing"](given)
    assert jump["ins23"] == pytest.approx(jump["gnss"], abs=0.06)
    assert jump["ins23"] == pytest.approx(jump["samples"], abs=0.06)
    assert jump["px4-ecl"] < jump["gnss"] - 0.1
