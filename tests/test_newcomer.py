"""The three first tasks of the README, typed as it prints them: a PX4 log, a bag at rest, a folder of EuRoC."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_reader_folders import euroc
from typer.testing import Result
from written_logs import write_bag, write_ulog

import kfgen as kf

Cli = Callable[..., Result]
ROOT = Path(__file__).resolve().parents[1]
SECTION = re.search(
    r"<!-- five minutes -->(.*)<!-- end five minutes -->",
    (ROOT / "README.md").read_text(encoding="utf-8"),
    re.S,
)
N_GYRO, N_ACCEL, RATE = 1e-4, 2e-3, 100.0
"""White noise [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)], rate [Hz]."""


def typed(first: str, count: int) -> list[list[str]]:
    """So many command lines of the README from one on."""
    assert SECTION
    (block,) = re.findall(r"```sh\n(.*?)```", SECTION.group(1), re.S)
    lines = block.splitlines()
    (at,) = (k for k, line in enumerate(lines) if line.startswith(first))
    return [shlex.split(line, comments=True) for line in lines[at : at + count]]


def run(kfgen: Cli, lines: list[list[str]]) -> list[Result]:
    assert all(words[0] == "kfgen" for words in lines)
    return [kfgen(*words[1:]) for words in lines]


def at_rest() -> kf.Log:
    """Twenty seconds of white noise in six channels."""
    rng, n = np.random.default_rng(3), 2000
    channels = {}
    for sensor, unit, size in (("gyro", "rad/s", N_GYRO), ("accel", "m/s^2", N_ACCEL)):
        for axis in "xyz":
            level = -9.80665 if (sensor, axis) == ("accel", "z") else 0.0
            channels[f"{sensor}_{axis}"] = kf.Channel(level + size * np.sqrt(RATE) * rng.normal(size=n), unit)
    return kf.Log(np.arange(n) / RATE, channels, "rest")


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.long
def test_a_px4_log_to_the_noise_of_its_sensors(kfgen: Cli) -> None:
    pytest.importorskip("pyulog")
    flown = kf.simulate("ins15", "figure-8", duration=12.0, rate=100.0, seed=3, rates={"gnss": 5.0})
    write_ulog(flown, Path("flight.ulg"))
    listed, answer = run(kfgen, typed("kfgen list flight.ulg", 2))
    assert listed.exit_code == answer.exit_code == 0, answer.stderr
    assert "sensor_combined" in listed.stdout
    assert [w for w in ("gyro_x: 12 s at 100 Hz", "white_noise", "accel_z") if w not in answer.stdout] == []
    assert "the sensors moved" in answer.stderr
    assert "<svg" in Path("noise.html").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_bag_at_rest_to_imu_yaml(kfgen: Cli) -> None:
    pytest.importorskip("rosbags")
    yaml = pytest.importorskip("ruamel.yaml")
    write_bag(at_rest(), Path("rest.bag"))
    identified, converted = run(kfgen, typed("kfgen identify rest.bag", 2))
    assert identified.exit_code == 0, identified.stderr
    # Twenty seconds show no random walk: what there is, is written; the two keys that it lacks are named.
    assert converted.exit_code == 1
    assert all(key in converted.stderr for key in ("gyroscope_random_walk", "accelerometer_random_walk"))
    found = yaml.YAML(typ="safe").load(Path("imu.yaml"))
    assert found["gyroscope_noise_density"] == pytest.approx(N_GYRO, rel=0.05)
    assert found["accelerometer_noise_density"] == pytest.approx(N_ACCEL, rel=0.05)
    assert found["update_rate"] == pytest.approx(RATE, rel=1e-3)


@pytest.mark.long
def test_a_folder_of_euroc_to_its_allan_plots(kfgen: Cli, tmp_path: Path) -> None:
    euroc(tmp_path / "calib-imu-static2")
    (answer,) = run(kfgen, typed("kfgen identify calib-imu-static2", 1))
    assert answer.exit_code == 0, answer.stderr
    page = Path("allan.html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 6
    assert "Allan deviation" in page
