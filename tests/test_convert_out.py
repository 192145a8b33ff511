"""Proves that every other program gets its own numbers: the file is read by a parser, and its noise is that of the model.

What each program does with a number is written down here once more, from its source, and run: the variance of an angle
after a second, and of a bias, must be that of the noise model.
"""

from __future__ import annotations

import json
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from test_convert import DEG, K_ACCEL, K_GYRO, N_ACCEL, N_GYRO, imu
from typer.testing import Result

from kfgen.consumers import convert
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, write_noise
from kfgen.effects.process.stochastic import GaussMarkov

Cli = Callable[..., Result]
RATE, DT = 200.0, 0.005
STEPS = 200


def yaml(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text.removeprefix("%YAML:1.0\n"))


def after_a_second(step: float) -> float:
    """The variance that a second of steps adds."""
    return STEPS * step


def test_vins_adds_the_noise_of_the_model() -> None:
    """``V noise V'`` of its midpoint rule: two halves of independent samples a step, a walk of dt times its number."""
    text = convert(imu(), "vins", rate=RATE).text
    assert text.startswith("%YAML:1.0\n")
    found = yaml(text)
    half = 0.5 * DT
    for name, N in (("acc_n", N_ACCEL), ("gyr_n", N_GYRO)):
        assert after_a_second(2 * (half * found[name]) ** 2) == pytest.approx(N**2, rel=1e-5)
    for name, K in (("acc_w", K_ACCEL), ("gyr_w", K_GYRO)):
        assert after_a_second((DT * found[name]) ** 2) == pytest.approx(K**2, rel=1e-5)


def test_fastlio_adds_the_noise_of_the_model() -> None:
    found = yaml(convert(imu(), "fastlio", rate=RATE).text)["mapping"]
    wanted = {"acc_cov": N_ACCEL, "gyr_cov": N_GYRO, "b_acc_cov": K_ACCEL, "b_gyr_cov": K_GYRO}
    assert set(found) == set(wanted)
    for name, size in wanted.items():
        assert after_a_second(DT**2 * found[name]) == pytest.approx(size**2, rel=1e-5)


def test_liosam_has_continuous_numbers() -> None:
    found = yaml(convert(imu(), "liosam").text)["lio_sam"]
    numbers = [found[k] for k in ("imuAccNoise", "imuGyrNoise", "imuAccBiasN", "imuGyrBiasN")]
    assert numbers == pytest.approx([N_ACCEL, N_GYRO, K_ACCEL, K_GYRO], rel=1e-6)


def test_basalt_has_continuous_numbers_of_each_axis() -> None:
    found = json.loads(convert(imu(), "basalt", rate=RATE).text)["value0"]
    assert found["imu_update_rate"] == RATE
    assert found["gyro_noise_std"] == pytest.approx([n * DEG for n in (0.005, 0.006, 0.004)], rel=1e-6)
    assert found["accel_bias_std"] == pytest.approx([1e-5, 2e-5, 3e-5], rel=1e-6)
    assert [len(found[k]) for k in ("accel_noise_std", "gyro_bias_std")] == [3, 3]


def test_matlab_gets_a_script() -> None:
    text = convert(imu(), "matlab", rate=RATE).text
    code = [line.partition("%")[0].strip() for line in text.splitlines()]
    assert all(line.endswith(";") for line in code if line)
    assert "IMU = imuSensor('accel-gyro', 'SampleRate', 200);" in code
    numbers = {
        m.group(1): [float(c) for c in m.group(2).split()]
        for line in code
        if (m := re.fullmatch(r"IMU\.(\S+) = \[(.*)\];", line))
    }
    assert numbers["Gyroscope.NoiseDensity"] == pytest.approx(
        [n * DEG for n in (0.005, 0.006, 0.004)], rel=1e-6
    )
    assert numbers["Accelerometer.RandomWalk"] == pytest.approx([1e-5, 2e-5, 3e-5], rel=1e-6)
    assert text.count("'single-sided'") == 2


def test_gazebo_has_the_process_of_the_model() -> None:
    """Its recursion is written down from its source; driven by it, the bias has the variance of the model."""
    text = convert(imu(), "gazebo", rate=RATE, origin="a--b.toml").text
    root = ET.fromstring(f"<all>{text}</all>")
    sensor = root.find("sensor")
    assert sensor is not None
    assert float(sensor.findtext("update_rate", "")) == RATE
    y = sensor.find("imu/angular_velocity/y/noise")
    assert y is not None
    assert float(y.findtext("stddev", "")) == pytest.approx(N_GYRO * math.sqrt(RATE), rel=1e-6)
    sigma_b, tau = (
        float(y.findtext(k, "")) for k in ("dynamic_bias_stddev", "dynamic_bias_correlation_time")
    )
    step, phi = -(sigma_b**2) * tau / 2 * math.expm1(-2 * DT / tau), math.exp(-DT / tau)
    assert tau == pytest.approx(100.0)
    assert step / (1.0 - phi**2) == pytest.approx((3e-3 * DEG) ** 2, rel=1e-6)  # of the Gauss-Markov term
    z = sensor.find("imu/angular_velocity/z/noise")
    assert z is not None
    walk, long = (float(z.findtext(k, "")) for k in ("dynamic_bias_stddev", "dynamic_bias_correlation_time"))
    hour = walk**2 * long / 2 * -math.expm1(-2 * 3600.0 / long)
    assert hour == pytest.approx((2e-4 * DEG) ** 2 * 3600.0, rel=5e-3)


def test_sih_gets_lines_of_its_source() -> None:
    made = convert(imu(), "px4-sih", rate=250.0)
    found = dict(re.findall(r"^(\w+) \+= noiseGauss3f\((.*)\);$", made.text, re.M))
    gyro = [float(v.removesuffix("f")) for v in found["gyro"].split(", ")]
    assert gyro == pytest.approx([n * DEG * math.sqrt(250.0) for n in (0.005, 0.006, 0.004)], rel=1e-6)
    assert "no parameter" in made.text
    assert any("no drift" in w for w in made.warnings)


def test_ardupilot_simulates_the_variance_of_the_model() -> None:
    """Two uniform numbers a sample, as its source adds them; 200 000 samples, standard error 0.16 %."""
    noisy = {f"accel_{a}": ChannelNoise("m/s^2", (Term(make("white_noise", N=2e-3)),)) for a in "xyz"}
    text = convert(imu(**noisy), "ardupilot-sim", rate=1000.0).text
    found = {k: float(v) for k, v in re.findall(r"^(SIM_\w+),(\S+)$", text, re.M)}
    rng = np.random.default_rng(3)
    one, two = rng.uniform(-1.0, 1.0, (2, 200_000))
    accel = 0.01 * one + found["SIM_ACC1_RND"] * two
    assert accel.std() == pytest.approx(2e-3 * math.sqrt(1000.0), rel=8e-3)
    gyro = 0.04 * one + found["SIM_GYR1_RND"] * two
    assert gyro.std() == pytest.approx(0.006 * math.sqrt(1000.0), rel=8e-3)


def test_a_sensor_quieter_than_the_simulator_is_said() -> None:
    quiet = {f"gyro_{a}": ChannelNoise("deg/s", (Term(make("white_noise", N=1e-6)),)) for a in "xyz"}
    made = convert(imu(**quiet), "ardupilot-sim", rate=1000.0)
    assert made.values["SIM_GYR1_RND"].numbers == (0.0,)
    assert "own noise" in made.values["SIM_GYR1_RND"].words


NEEDY = (
    "kalibr",
    "openvins",
    "orbslam3",
    "gtsam",
    "kfgins",
    "vins",
    "fastlio",
    "liosam",
    "basalt",
    "matlab",
    "gazebo",
)


@pytest.mark.parametrize("to", NEEDY)
def test_a_key_that_is_needed_and_missing_ends_with_1(tmp_path: Path, kfgen: Cli, to: str) -> None:
    white = Term(make("white_noise", N=1e-4))
    noise = NoiseModel(
        {f"{s}_x": ChannelNoise(u, (white,)) for s, u in (("gyro", "rad/s"), ("accel", "m/s^2"))}
    )
    write_noise(noise, tmp_path / "n.toml")
    answer = kfgen("convert", tmp_path / "n.toml", "--to", to, "--rate", "100", "-o", tmp_path / "out")
    assert answer.exit_code == 1
    assert "is not complete: it cannot do without" in answer.output
    assert (tmp_path / "out").exists()
    whole = Term(make("rate_random_walk", K=1e-6)), Term(GaussMarkov(sigma=1e-4, tau=100.0))
    full = {k: ChannelNoise(c.unit, (white, *whole)) for k, c in noise.channels.items()}
    write_noise(NoiseModel(full), tmp_path / "n.toml")
    answer = kfgen("convert", tmp_path / "n.toml", "--to", to, "--rate", "100", "-o", tmp_path / "out")
    assert answer.exit_code == 0


@pytest.mark.parametrize("to", ["px4", "ardupilot", "px4-sih", "ardupilot-sim", "table"])
def test_what_has_a_default_is_not_needed(tmp_path: Path, kfgen: Cli, to: str) -> None:
    noise = NoiseModel({"gyro_x": ChannelNoise("rad/s", (Term(make("white_noise", N=1e-4)),))})
    write_noise(noise, tmp_path / "n.toml")
    assert kfgen("convert", tmp_path / "n.toml", "--to", to, "--rate", "100").exit_code == 0


@pytest.mark.parametrize("to", ["vins", "fastlio", "basalt", "matlab", "gazebo", "px4-sih", "ardupilot-sim"])
def test_a_rate_is_asked_for(to: str) -> None:
    with pytest.raises(InputError, match="needs a rate"):
        convert(imu(), to)


def test_the_rate_and_the_limits_of_the_log_are_kept(tmp_path: Path, kfgen: Cli) -> None:
    """A minute of white noise at 200 Hz: the file says its rate, and how small a walk may be that it does not show."""
    rng = np.random.default_rng(11)
    t = np.arange(12_000) * DT
    columns = [t, *rng.normal(0.0, 1e-3, (6, t.size))]
    head = ["t [s]", *(f"gyro_{a} [rad/s]" for a in "xyz"), *(f"accel_{a} [m/s^2]" for a in "xyz")]
    np.savetxt(
        tmp_path / "log.csv", np.column_stack(columns), delimiter=",", header=",".join(head), comments=""
    )
    found = kfgen("identify", tmp_path / "log.csv", "-o", tmp_path / "n.toml", "--channels", "gyro_x,accel_x")
    assert found.exit_code == 0
    text = (tmp_path / "n.toml").read_text()
    assert 'rate" = "200 Hz"' in text
    answer = kfgen("convert", tmp_path / "n.toml", "--to", "kalibr")
    assert answer.exit_code == 1
    assert "update_rate: 200.0" in answer.output
    limit = re.search(
        r"gyroscope_random_walk: not identified.*K of gyro_x is below (\S+) deg/s/sqrt\(s\) at 95 %",
        answer.output,
    )
    assert limit
    # In T seconds a walk of K moves the mean by K sqrt(T/3), which white noise of N hides below N / sqrt(T).
    N = math.degrees(1e-3) * math.sqrt(DT)
    assert 0.1 < float(limit.group(1)) / (math.sqrt(3.0) * N / 60.0) < 10.0
