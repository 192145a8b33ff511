"""Samples that a sensor at rest lost at random are told as lost, at the rate that it has, and as nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kfgen as kf
from kfgen.core.sampling_period import single_period, usual_period
from kfgen.log.log import Channel, Log

DT, N, SIZE = 0.01, 6000, 1e-3
MODEL = (
    "format = 'kfgen-noise-1'\n[gyro_x]\nunit = 'rad/s'\neffects = [{{effect = 'white_noise', N = {!r}}}]\n"
)


def lost(share: float, seed: int = 9000) -> np.ndarray:
    """Which samples are lost."""
    return np.random.default_rng(seed).random(N) < share


@pytest.mark.parametrize("ratio", [0.6, 1.75], ids=lambda r: f"noise {r} times the model's")
@pytest.mark.parametrize("share", [0.1, 0.48])
def test_lost_samples_are_no_outliers_and_no_uneven_time(share: float, ratio: float, tmp_path: Path) -> None:
    """Half of them lost was called uneven time; a tenth, drawn in the model's size among smaller ones, outliers."""
    gone = lost(share)
    y = SIZE * np.random.default_rng(1).standard_normal(N)
    y[gone] = np.nan
    (tmp_path / "n.toml").write_text(MODEL.format(SIZE * DT**0.5 / ratio), encoding="utf-8")
    found = kf.find_gap(Log(DT * np.arange(N), {"gyro_x": Channel.of(y, "rad/s")}), tmp_path / "n.toml")
    (dropped,) = found.findings
    assert dropped.name == "dropped_samples"
    assert dropped.effect.share == pytest.approx(float(gone.mean()), abs=2e-3)  # less those at the ends
    assert found.verdict == ("bad_data" if share > 0.2 else "effects_found")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.7])
def test_the_period_of_a_log_that_lost_samples(share: float) -> None:
    """At 0.5 and 0.7 the median step is two and three periods."""
    assert usual_period(DT * np.flatnonzero(~lost(share))) == pytest.approx(DT)


def test_times_without_single_steps_have_their_median() -> None:
    t = np.cumsum(np.tile([0.002, 0.0083], 300))
    assert single_period(np.diff(t)) == 0.0
    assert usual_period(t) == pytest.approx(np.median(np.diff(t)))
