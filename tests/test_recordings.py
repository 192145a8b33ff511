"""Proves that real recordings at rest give what their own figures say.

The figures stand in the manifest of the recordings, taken there by hand, or are computed here by numpy and scipy
from the samples: a difference's variance, a least-squares exponential. Nothing is random.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import curve_fit

Find = Callable[[str], Path]
Call = Callable[..., Result]


def channel(kfgen: Call, tmp_path: Path, name: str, *words: object) -> tuple[dict[str, Any], str]:
    """The JSON answer of one channel, and all that was printed."""
    out = tmp_path / "id.json"
    result = kfgen("identify", *words, "--json", out)
    assert result.exit_code == 0, result.output
    return json.loads(out.read_text())["channels"][name], result.output + result.stderr


def parameters(answer: dict[str, Any], effect: str) -> dict[str, Any]:
    (found,) = (e["parameters"] for e in answer["effects"] if e["effect"] == effect)
    return dict(found)


def test_mpu6050_gyro_y_has_its_line(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    """Manifest: a line at 38.0 Hz, N = 0.0112 deg/s/rtHz; x and z have none within 0.5 Hz of it."""
    path = recording("native/mpu6050_static.csv")
    answer, _ = channel(kfgen, tmp_path, "gyro_y", path, "--columns", "gyro_y=gy [deg/s/131]")
    assert any(line["frequency_hz"] == pytest.approx(38.0, abs=0.1) for line in answer["lines"])
    assert parameters(answer, "white_noise")["N"]["value"] == pytest.approx(np.deg2rad(0.0112), rel=0.05)


def test_tof_says_that_its_header_contradicts_itself(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    """50 Hz in the header, 200 244 samples in 3600 s; given the rate, nothing is said."""
    path, words = recording("static/tof_vl53l0x_1h.npz"), ("--effects", "white_noise,gauss_markov")
    _, said = channel(kfgen, tmp_path, "dist", path, "--columns", "dist=dist_mm [mm]", *words)
    assert "50 Hz" in said
    assert "55.62 Hz" in said
    _, said = channel(
        kfgen, tmp_path, "dist", path, "--columns", "dist=dist_mm [mm]", "--rate", 55.62, *words
    )
    assert "50 Hz" not in said


def test_tof_has_its_white_noise(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    """The variance of its first difference, halved, is 4.32 mm^2: N^2 times the rate, within 1 %."""
    path, rate = recording("static/tof_vl53l0x_1h.npz"), 55.62
    half = 0.5 * float(np.var(np.diff(np.load(path)["dist_mm"].astype(float))))
    assert half == pytest.approx(4.32, abs=0.005)
    answer, _ = channel(kfgen, tmp_path, "dist", path, "--columns", "dist=dist_mm [mm]", "--rate", rate)
    N = parameters(answer, "white_noise")["N"]["value"] * 1e3
    assert N**2 * rate == pytest.approx(half, rel=0.01)


@pytest.mark.long
def test_the_warm_up_of_a_gyro(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    """875 mdps gyro at one sample a second: warm-up, 0.445 deg/s a sample, a line at 0.050 of the rate.

    The least-squares exponential has a time constant near 25 500 samples (the manifest's 20 200 was read by eye).
    """
    path = recording("static/gyro_875mdps_warmup.npz")
    data = np.load(path)
    y = data["gyr_counts"] * float(data["gyr_lsb"])
    # Means of 64 samples carry all of so slow a curve.
    means = y[: y.size // 64 * 64].reshape(-1, 64).mean(axis=1)
    t = 64.0 * np.arange(means.size) + 31.5
    (c, size, tau), _ = curve_fit(lambda t, c, a, tau: c + a * np.exp(-t / tau), t, means, (0.64, 0.42, 2e4))
    assert tau == pytest.approx(25_500, rel=0.02)
    assert c == pytest.approx(0.64, abs=0.05)
    counts = f"gyro_x=gyr_counts [deg/s/{1 / float(data['gyr_lsb']):.9g}]"
    answer, _ = channel(kfgen, tmp_path, "gyro_x", path, "--rate", 1, "--columns", counts)
    warm = parameters(answer, "warm_up")
    lo, hi = warm["tau"]["ci95"]
    assert lo < tau < hi < 1.6 * lo
    lo, hi = np.rad2deg(warm["size"]["ci95"])
    assert lo < size < hi < 1.3 * lo
    # Read off the plateau by hand; the spectrum rises by some per cent to its end, which the interval includes.
    white = parameters(answer, "white_noise")["N"]
    assert np.rad2deg(white["value"]) == pytest.approx(0.445, rel=0.025)
    assert np.rad2deg(white["ci95"][0]) < 0.447
    assert any(line["frequency_hz"] == pytest.approx(0.050, abs=0.0005) for line in answer["lines"])


def test_the_barometer_follows_its_thermometer(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    """The coefficient is the generalised least squares of all samples, at the noise that was found.

    Differences of white noise and a walk have a tridiagonal covariance, solved here by its band. The thermometer is
    averaged over a second first: its own noise enters the altitude by the sensor's compensation, -5.9 m/K that are none.
    """
    path = recording("static/baro_ms5611_400s.npz")
    data = np.load(path)
    alt, temperature = data["alt"].astype(float), data["temp"].astype(float)
    columns = ["--columns", "alt=alt [m],temperature=temp [degC]", "--channels", "alt"]
    chosen, _ = channel(kfgen, tmp_path, "alt", path, *columns)
    assert "temperature" not in [e["effect"] for e in chosen["effects"]]
    effects = "white_noise,rate_random_walk,temperature"
    answer, _ = channel(kfgen, tmp_path, "alt", path, *columns, "--effects", effects)
    noise = {k: v["value"] for e in answer["effects"] for k, v in e["parameters"].items()}
    V, W = noise["N"] ** 2 * 80.0, noise["K"] ** 2 / 80.0
    band = np.array([np.full(alt.size - 1, -V), np.full(alt.size - 1, 2 * V + W)])
    x = np.diff(gaussian_filter1d(temperature, 80.0))
    solved = solveh_banded(band, x)
    expected, deviation = float(solved @ np.diff(alt) / (solved @ x)), float((solved @ x) ** -0.5)
    found = parameters(answer, "temperature")["coefficient"]
    assert found["value"] == pytest.approx(expected, abs=deviation)
    assert np.diff(found["ci95"])[0] == pytest.approx(2 * 1.96 * deviation, rel=0.1)
    half = np.sqrt(0.5 * np.var(np.diff(alt)) / 80.0)
    assert parameters(answer, "white_noise")["N"]["value"] == pytest.approx(half, rel=0.05)


def test_the_barometers_floor_is_that_of_its_manifest(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    """The smallest Allan deviation is 0.0155 m at 2 s."""
    path = recording("static/baro_ms5611_400s.npz")
    answer, _ = channel(
        kfgen, tmp_path, "alt", path, "--columns", "alt=alt [m]", "--channels", "alt", "--effects",
        "white_noise,rate_random_walk",
    )  # fmt: skip
    tau, deviation = np.array(answer["allan"]["tau_s"]), np.array(answer["allan"]["adev"])
    k = int(np.argmin(deviation))
    assert deviation[k] == pytest.approx(0.0155, rel=0.03)
    assert tau[k] == pytest.approx(2.0, rel=0.5)
