"""Dirty records: lines, outliers, an internal low-pass, a header that contradicts itself.

Records are made by plain numpy and scipy. Chance enters at the rates of the modules (1e-3 for a line,
4e-11 a sample for an outlier); seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from scipy.signal import butter, lfilter

from kfgen.effects.process.stochastic import GRID_RELATIVE_TOLERANCE
from kfgen.effects.series import adc_step
from kfgen.identify.evidence.kalman import Exact
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.sampling import evidence
from kfgen.identify.fit.lines import find_lines
from kfgen.identify.identify import Identified, identify, without_lines
from kfgen.identify.screening.record_faults import is_outlier, noise_change, roll_off

RATE, SECONDS = 100.0, 300.0
T = np.arange(int(RATE * SECONDS)) / RATE


def white(seed: int) -> np.ndarray:
    """Samples of standard deviation one: N = 0.1."""
    return np.random.default_rng(seed).standard_normal(T.size)


def found(y: np.ndarray) -> Identified:
    return identify(Record(T, y))


def N_of(result: Identified) -> float:
    return float(result.fit.effects[0].N)  # type: ignore[attr-defined]


@pytest.mark.parametrize("frequency", in_part([3.217, 12.0, 41.9]))
def test_a_line_is_found_and_removed(frequency: float) -> None:
    result = found(white(1) + 0.4 * np.sin(2 * np.pi * frequency * T + 0.3))
    assert len(result.lines) == 1
    assert result.lines[0].frequency == pytest.approx(frequency, abs=2.0 / SECONDS)
    assert result.lines[0].amplitude == pytest.approx(0.4, rel=0.15)
    assert N_of(result) == pytest.approx(0.1, rel=0.02)


@pytest.mark.long
def test_without_a_line_none_is_found() -> None:
    assert [len(found(white(seed)).lines) for seed in range(5)] == [0] * 5


def test_outliers_are_left_out_and_said() -> None:
    rng = np.random.default_rng(2)
    y = white(2)
    at = rng.choice(T.size, 60, replace=False)
    y[at] += 40.0 * rng.choice([-1.0, 1.0], 60)
    result = found(y)
    assert N_of(result) == pytest.approx(0.1, rel=0.02)
    assert any("% of the samples are outliers" in w for w in result.warnings)


@pytest.mark.parametrize("at", in_part([T.size // 2, 0, 1, T.size - 1], 2))
def test_one_spike_anywhere_is_left_out(at: int) -> None:
    y = white(6)
    y[at] += 200.0
    result = found(y)
    assert N_of(result) == pytest.approx(0.1, rel=0.02)
    assert not any("low-pass" in w for w in result.warnings)


def test_a_step_and_an_adc_grid_are_no_outliers() -> None:
    stepped = white(3) + 30.0 * (T > 100.0)
    coarse = np.round(0.4 * white(4))
    assert not is_outlier(stepped).any()
    assert not is_outlier(coarse).any()


@pytest.mark.parametrize("corner", in_part([10.0, 20.0, 35.0]))
def test_a_low_pass_is_left_out_of_the_fit(corner: float) -> None:
    b, a = butter(2, corner / (RATE / 2))
    result = found(lfilter(b, a, white(5)))
    assert N_of(result) == pytest.approx(0.1, rel=0.05)
    assert any("low-pass" in w for w in result.warnings)


def test_a_change_of_the_noise_is_said_and_chance_is_none() -> None:
    """40 records of constant noise, 20 stretches each: six standard deviations are passed less than once in 1e5."""
    assert [noise_change(white(seed)) for seed in range(40)] == [None] * 40
    y = white(3).copy()
    y[y.size // 2 :] *= 2.0
    change = noise_change(y)
    assert change is not None
    assert change[1] / change[0] == pytest.approx(2.0, rel=0.2)
    assert any("not the same all along" in w for w in found(y).warnings)


def test_white_noise_has_no_low_pass() -> None:
    assert [roll_off(Record(T, white(seed))) for seed in range(20)] == [None] * 20


def test_line_of_a_real_gyro(recording: Callable[[str], Path], kfgen: Callable[..., Any]) -> None:
    """The manifest of the recording: gyro y has a line at 38.0 Hz. The rate stands in the file's header."""
    path = recording("native/mpu6050_static.csv")
    answer = kfgen("identify", path, "--columns", "gyro_y=gy [deg/s/131]")
    assert answer.exit_code == 0
    assert "line at 38 Hz" in answer.output.replace("37.99", "38").replace("38.00", "38")


def test_a_rate_that_contradicts_the_duration_is_said(
    recording: Callable[[str], Path], kfgen: Callable[..., Any]
) -> None:
    """200 244 samples in 3600 s are 55.6 Hz, whatever the header says."""
    path = recording("static/tof_vl53l0x_1h.npz")
    answer = kfgen("identify", path, "--columns", "dist=dist_mm [mm]")
    assert answer.exit_code == 0
    assert "55.62 Hz" in answer.output


def on_grid_of_the_integral(step: float) -> np.ndarray:
    """Rates from increments of an angle that a counter rounds: a step of the rate is that of the angle over the period."""
    angle = np.cumsum(white(11)) / RATE
    return np.diff(np.round(angle / step) * step, prepend=0.0) * RATE


def test_quantisation_of_a_counter_has_its_size() -> None:
    """A counter of step q on the angle: Q = q / sqrt(12), which is also the most that its grid allows."""
    step = 3.0 / RATE
    result = found(on_grid_of_the_integral(step))
    names = [e.name for e in result.fit.effects]
    Q = float(result.fit.effects[names.index("quantisation")].Q)  # type: ignore[attr-defined]
    assert pytest.approx(step / np.sqrt(12.0), rel=0.1) == Q
    assert result.intervals[names.index("quantisation"), "Q"][1] <= step / np.sqrt(12.0) * (
        1.0 + 2 * GRID_RELATIVE_TOLERANCE
    )


@pytest.mark.parametrize(("step", "line"), [(0.1, 0.0), (0.5, 0.0), (0.5, 0.4)])
def test_quantisation_cannot_exceed_what_the_grid_allows(step: float, line: float) -> None:
    """A spectrum that rises to its end for another reason, on an ADC grid: Q is not made to explain it.

    A spectral line that is subtracted does not take the samples off their grid.
    """
    blue = lfilter([1.0, -0.15], [1.0], white(12))
    blue = blue + line * np.sin(2.0 * np.pi * 12.3 * T)
    most = step / RATE / np.sqrt(12.0)
    result = found(np.round(blue / step) * step)
    sizes = [float(e.Q) for e in result.fit.effects if e.name == "quantisation"]  # type: ignore[attr-defined]
    sizes += [x.upper95 for x in result.limits if x.effect.name == "quantisation"]
    assert max(sizes) <= most * (1.0 + 2 * GRID_RELATIVE_TOLERANCE)
    free = found(blue)
    (Q,) = [float(e.Q) for e in free.fit.effects if e.name == "quantisation"]  # type: ignore[attr-defined]
    assert 2.0 * most < Q  # what it would be said to be without the grid


def test_samples_that_are_computed_keep_the_grid_on_which_they_were_logged() -> None:
    """Less a spectral line, or drawn onto an even grid by straight lines: what was rounded is what the ADC gave."""
    step, rng = 0.5, np.random.default_rng(14)
    y = np.round((white(14) + 0.4 * np.sin(2.0 * np.pi * 12.3 * T)) / step) * step
    even = Record(T, y)
    (line,) = find_lines(even)
    times = T[:3000] + rng.uniform(0.0, 0.9, 3000) / RATE
    uneven, _ = evidence(times, y[:3000])
    assert isinstance(uneven, Exact)
    for record in (even, uneven):
        assert record.adc_step == pytest.approx(step)
        cleaned = without_lines(record, [line])
        assert adc_step(cleaned.y) == 0.0  # type: ignore[attr-defined]
        assert cleaned.adc_step == pytest.approx(step)


def test_what_a_third_of_the_samples_has_are_no_outliers() -> None:
    """A sensor that shows what is above a threshold only: N is that of all samples (0.1 of their standard deviation)."""
    y = np.maximum(white(31) - 0.3, 0.0)
    result = found(y)
    lo, hi = result.intervals[0, "N"]
    assert lo < 0.1 * y.std() < hi
    assert N_of(result) == pytest.approx(0.1 * y.std(), rel=0.05)
    assert [w for w in result.warnings if "N is that of all" in w] != []
    assert result.record.left_out.outliers is None  # type: ignore[union-attr]
