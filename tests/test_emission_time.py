"""Proves that emission stays in seconds of processor time: library models, and the options that cost most of each."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from kfgen.emit.emit import emit
from kfgen.model.library import LIBRARY, build

MOST_S = 20.0
TURNING = {"transport_rate": "true", "earth_rate": "true", "gravity_model": "normal"}
QUICK = [("hemerly-ekf", {}, "ud"), ("ins15", TURNING, "ud")]
CASES = [
    *((n, {}, "ud") for n in LIBRARY if n != "hemerly-ekf"),
    ("ins15", TURNING, "p"),
    *(("ins23", TURNING, form) for form in ("p", "ud")),
    ("ins33", TURNING, "ud"),
    *((name, {"frame": "ecef"}, "ud") for name in ("ins15", "ins23", "ins33")),
    ("ins23", {"delay": "0.1 s", "lever_arm": "state"}, "ud"),
    ("ins15", {"attitude_error": "right-invariant", "earth_rate": "true"}, "ud"),
    ("ahrs6", {"acceleration": "bounded"}, "ud"),
]


@pytest.mark.parametrize(
    ("name", "options", "form"),
    [*QUICK[:1], *(pytest.param(*c, marks=pytest.mark.long) for c in [*QUICK[1:], *CASES])],
)
def test_emission_takes_seconds(name: str, options: dict[str, str], form: str, tmp_path: Path) -> None:
    begun = time.process_time()
    made = emit(build(name, None, options), tmp_path / "f", "c", form)
    assert time.process_time() - begun < MOST_S
    assert len(made.files) > 5
