"""Proves that a log too long to be searched at its full rate is compared by its beginning and by means of all of it.

Expected values are those of theory: a line's mean over a block is its value times ``sin(x) / x``, whitened ordinates are
unit normal deviates, and what is planted is found in its size. Limits of memory are lowered, so that a small log is long.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from scipy.signal import lfilter

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import NoiseModel, parse_noise
from kfgen.gap.core.result import EFFECTS_FOUND, NO_GAP
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.find_gap import find_gap
from kfgen.gap.result import GapResult
from kfgen.identify.evidence.long import condense
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import block_means
from kfgen.log.log import Channel, Log, StoredLog
from kfgen.log.readers import read_long

RATE_HZ, N_DENSITY = 10.0, 0.05
SAMPLES = 1 << 17
"""Of which every 16 make a mean, and the first 2^12 are the beginning."""
MODEL = f"""
format = "kfgen-noise-1"
[gyro_x]
unit = "rad/s"
effects = [ {{ effect = "white_noise", N = "{N_DENSITY} rad/s/sqrt(Hz)" }} ]
"""


@pytest.fixture
def short_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """A log of `SAMPLES` is too long for memory, and for a search at its full rate."""
    monkeypatch.setattr("kfgen.log.readers.MAX_SAMPLES_IN_MEMORY", SAMPLES - 1)
    monkeypatch.setattr("kfgen.gap.find_gap.MAX_SAMPLES_AT_FULL_RATE", SAMPLES - 1)
    monkeypatch.setattr("kfgen.gap.rest.long_log.BEGINNING_SAMPLES", 1 << 12)
    # The verb `identify` has the name of its package, so that a path of names does not lead there.
    monkeypatch.setattr(sys.modules[condense.__module__], "MAX_BLOCK_MEANS", SAMPLES >> 4)


def white(seed: int) -> np.ndarray:
    return N_DENSITY * np.sqrt(RATE_HZ) * np.random.default_rng(seed).standard_normal(SAMPLES)


def model() -> NoiseModel:
    return parse_noise(MODEL, "model")


def stored_log(folder: Path, y: np.ndarray) -> StoredLog:
    np.save(folder / "log.npy", y)
    log = read_long(folder / "log.npy", rate=RATE_HZ, columns="gyro_x=#1 [rad/s]")
    assert isinstance(log, StoredLog)
    return log


def compared(y: np.ndarray) -> GapResult:
    t = np.arange(y.size) / RATE_HZ
    return find_gap(Log(t, {"gyro_x": Channel.of(y, "rad/s")}), model())


def test_means_of_a_line_are_those_of_theory() -> None:
    """To 0.7 %, what eight points of a mean give at two means a period."""
    n, averaged, dt = 4000, 50, 0.01
    length = averaged * dt
    t = (np.arange(n) + 0.5) * length
    record = Record(t, np.zeros(n), origin=0.0, averaged=averaged)
    for f in (0.02, 0.3, 0.9):
        line = make("sinusoid", amplitude=1.0, phase=0.3, frequency=f)
        (found, _), x = record.regressors(line), np.pi * f * length
        (instant, _) = line.regressors(t)
        np.testing.assert_allclose(found, instant * np.sin(x) / x, atol=0.007)
        assert np.abs(found - instant).max() > 0.9 * (1.0 - np.sin(x) / x)


def test_means_of_a_random_walk_whiten_to_unit_variance() -> None:
    """Standard deviation of the mean of n squares of normal deviates: sqrt(2 / n); five of them."""
    n, averaged, dt, K = 4096, 16, 0.1, 0.02
    walk = np.cumsum(K * np.sqrt(dt) * np.random.default_rng(3).standard_normal(n * averaged))
    y = block_means(walk, averaged)
    effects = [make("rate_random_walk", K=K)]
    t = (np.arange(n) + 0.5) * averaged * dt
    of_means, of_samples = (Record(t, y, averaged=a) for a in (averaged, 1))
    upper = slice(n // 2, n)
    right = np.mean(Whitener.on(of_means, effects).ordinates(y)[upper] ** 2)
    assert abs(right - 1.0) < 5.0 * np.sqrt(2.0 / (n // 2))
    # Samples of a walk, where means of it are taken for them, have up to three times the power of these.
    assert np.mean(Whitener.on(of_samples, effects).ordinates(y)[upper] ** 2) < 0.7
    data = of_means.ordinates(effects)
    ratio = data.gram[:, 0, 0].sum() / (data.count @ data.density(effects))
    assert abs(ratio - 1.0) < 5.0 * np.sqrt(2.0 / n)


@pytest.mark.usefixtures("short_memory")
def test_a_long_log_of_the_very_model_has_no_gap() -> None:
    found = compared(white(1))
    assert found.verdict == NO_GAP
    assert found.comparisons[0].span_s[1] > 0.99 * SAMPLES / RATE_HZ
    assert any("what is faster is not looked for" in w for w in found.warnings)
    # Of a quantisation the means show nothing: its limit is that of the beginning.
    beginning = found.recordings[0].comparisons[0]
    limits = ({m.effect.name: m.value for m in c.limits} for c in (found.comparisons[0], beginning))
    whole, first = limits
    assert whole["quantisation"] == first["quantisation"]
    assert whole["rate_random_walk"] < first["rate_random_walk"] / 10.0


@pytest.mark.long
@pytest.mark.usefixtures("short_memory")
def test_a_drift_whose_beginning_looks_like_a_ramp_is_named_by_all_of_the_log() -> None:
    """Alone, the beginning is called a ramp; beside the drift that all of the log shows it has nothing."""
    sigma, tau = 0.008, 200.0
    phi = np.exp(-1.0 / (RATE_HZ * tau))
    drive = sigma * np.sqrt(1.0 - phi**2) * np.random.default_rng(5).standard_normal(SAMPLES)
    y = white(2) + lfilter([1.0], [1.0, -phi], drive)
    found = compared(y)
    (finding,) = found.findings
    assert finding.name == "gauss_markov"
    lo, hi = finding.ci95["sigma"]
    assert lo < sigma < hi
    assert [f.name for f in compared(y[: 1 << 12]).findings] == ["rate_ramp"]
    assert found.recordings[0].comparisons[0].verdict == NO_GAP


@pytest.mark.usefixtures("short_memory")
@pytest.mark.parametrize("stored", in_part([True, False]))
def test_a_step_after_the_beginning_is_found_at_its_time_and_in_its_size(
    tmp_path: Path, stored: bool
) -> None:
    """In a file and in memory alike."""
    size, time = 0.015, 0.6 * SAMPLES / RATE_HZ
    y = white(4)
    y[int(time * RATE_HZ) :] += size
    found = find_gap(stored_log(tmp_path, y), model()) if stored else compared(y)
    (finding,) = found.findings
    assert finding.name == "bias_step"
    lo, hi = finding.ci95["size"]
    assert lo < size < hi
    assert float(found.to_dict()["steps"][0]["parameters"]["time"]["value"]) == pytest.approx(time, abs=60.0)


@pytest.mark.usefixtures("short_memory")
def test_what_the_beginning_shows_of_the_noise_is_in_the_updated_model() -> None:
    """The rounding of an integrated output, uniform over a step: Q is the step over sqrt(12)."""
    step = 0.05
    dithered = np.diff(step * np.random.default_rng(106).random(SAMPLES + 1)) * RATE_HZ
    found = compared(white(6) + dithered)
    assert found.verdict == EFFECTS_FOUND
    (finding,) = found.findings
    assert finding.name == "quantisation"
    assert finding.ci95["Q"][0] < step / np.sqrt(12.0) < finding.ci95["Q"][1]
    assert isinstance(found.updated, NoiseModel)
    assert [e.name for e in found.updated.channel("gyro_x").effects] == ["white_noise", "quantisation"]


@pytest.mark.usefixtures("short_memory")
def test_a_log_that_stays_in_its_file_is_compared_with_a_noise_file_only(tmp_path: Path) -> None:
    log = stored_log(tmp_path, white(1))
    for given, against in (([log], "gyro-static"), ([log, log], model())):
        with pytest.raises(InputError, match="compared alone, at rest, and with a noise file") as caught:
            find_gap(given, against)
        assert caught.value.remedy
