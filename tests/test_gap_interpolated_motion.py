"""Proves that sensors that move, brought to a higher rate by straight lines, are compared by the values that they gave.

Lines cut the tops of a fast motion: taken row by row they had been a scale factor of a gyro. The rates are a sum of sines, known at
every time. Seeds are fixed; a sound log is falsely alarmed at 0.2 % by the battery.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import kfgen as kf
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
RATE, N = 100.0, 8000
SIGMA = 0.002
"""Standard deviation of a value of the gyro [rad/s]."""
AXES = "xyz"


def turned(seed: int, rows: int, scale: float = 0.0) -> Log:
    """A gyro whose every `rows`-th row is a value of its own, beside the rates that it should show."""
    rng = np.random.default_rng([176132, seed])
    t, channels = np.arange(N) / RATE, {}
    for axis in AXES:
        f, p = rng.uniform(0.1, 3.0, 5), rng.uniform(0.0, 2.0 * np.pi, 5)
        w = 0.4 * np.sin(2.0 * np.pi * np.outer(t, f) + p).sum(axis=1)
        at = np.arange(0, N, rows)
        y = (1.0 + scale) * w[at] + rng.normal(0.0, 0.01) + SIGMA * rng.standard_normal(at.size)
        channels[f"gyro_{axis}"] = Channel.of(np.interp(np.arange(N), at, y), "rad/s")
        channels[f"ref_gyro_{axis}"] = Channel.of(w, "rad/s")
    return Log(t, channels)


def assumed(folder: Path, rows: int) -> Path:
    """The noise of the gyro at the rate of its values."""
    path = folder / "noise.toml"
    effect = f"effects = [{{effect = 'white_noise', N = {SIGMA * (rows / RATE) ** 0.5!r}}}]"
    own = [f"[gyro_{a}]\nunit = 'rad/s'\n{effect}\n" for a in AXES]
    path.write_text("format = 'kfgen-noise-1'\n" + "".join(own), encoding="utf-8")
    return path


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_interpolated_rows_are_no_scale_factor(tmp_path: Path, rows: int) -> None:
    found = kf.find_gap(turned(rows, rows), assumed(tmp_path, rows))
    assert (found.verdict, found.findings) == ("no_gap", ())
    assert any("draws straight lines from value to value" in w for w in found.warnings)


@pytest.mark.long
def test_a_scale_factor_behind_them_is_found(tmp_path: Path) -> None:
    found = kf.find_gap(turned(5, 3, scale=2e-3), assumed(tmp_path, 3))
    assert {f.name for f in found.findings} == {"scale_factor"}
    assert all(f.ci95["coefficient"][0] < 2e-3 < f.ci95["coefficient"][1] for f in found.findings)
