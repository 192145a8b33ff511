"""Proves that files of `convert` are read by the programs that consume them, or by the parser that those use, where it is installed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_convert import DEG, K_ACCEL, K_GYRO, N_ACCEL, N_GYRO, imu

from kfgen.consumers import convert

RATE = 200.0
DT = 1.0 / RATE
CONTINUOUS = {
    "accelerometer_noise_density": N_ACCEL,
    "accelerometer_random_walk": K_ACCEL,
    "gyroscope_noise_density": N_GYRO,
    "gyroscope_random_walk": K_GYRO,
    "update_rate": RATE,
}


def library(name: str, package: str) -> Any:
    return pytest.importorskip(name, reason=f"{package}, the parser of this program, is not installed")


def written(tmp_path: Path, to: str, ending: str) -> Path:
    path = tmp_path / f"made{ending}"
    path.write_text(convert(imu(), to, rate=RATE).text + "\n", encoding="utf-8")
    return path


# cv::FileStorage of OpenCV reads the settings of OpenVINS, VINS-Fusion and ORB-SLAM3.

STORED = {
    "openvins": ("imu0", CONTINUOUS),
    "vins": (
        "",
        {
            "acc_n": N_ACCEL * math.sqrt(2.0 / DT),
            "gyr_n": N_GYRO * math.sqrt(2.0 / DT),
            "acc_w": K_ACCEL / math.sqrt(DT),
            "gyr_w": K_GYRO / math.sqrt(DT),
            "g_norm": 9.80665,
        },
    ),
    "orbslam3": (
        "",
        {
            "IMU.NoiseGyro": N_GYRO,
            "IMU.NoiseAcc": N_ACCEL,
            "IMU.GyroWalk": K_GYRO,
            "IMU.AccWalk": K_ACCEL,
            "IMU.Frequency": RATE,
        },
    ),
}


@pytest.mark.parametrize("to", STORED)
def test_opencv_reads_it(tmp_path: Path, to: str) -> None:
    cv2 = library("cv2", "opencv-python-headless")
    node, wanted = STORED[to]
    storage = cv2.FileStorage(str(written(tmp_path, to, ".yaml")), cv2.FILE_STORAGE_READ)
    assert storage.isOpened()
    at = storage.getNode(node) if node else storage
    read = {key: at.getNode(key) for key in wanted}
    assert [key for key, value in read.items() if not value.isReal()] == []
    assert {key: value.real() for key, value in read.items()} == pytest.approx(wanted, rel=1e-6)


# PyYAML reads Kalibr's files, and the parameters of ROS nodes (rosparam).


@pytest.mark.parametrize(
    ("to", "node", "wanted"),
    [
        ("kalibr", "", {**CONTINUOUS, "rostopic": "/imu0"}),
        (
            "liosam",
            "lio_sam",
            {"imuAccNoise": N_ACCEL, "imuGyrNoise": N_GYRO, "imuAccBiasN": K_ACCEL, "imuGyrBiasN": K_GYRO},
        ),
        (
            "fastlio",
            "mapping",
            {
                "acc_cov": N_ACCEL**2 / DT,
                "gyr_cov": N_GYRO**2 / DT,
                "b_acc_cov": K_ACCEL**2 / DT,
                "b_gyr_cov": K_GYRO**2 / DT,
            },
        ),
    ],
)
def test_pyyaml_reads_it(tmp_path: Path, to: str, node: str, wanted: dict[str, Any]) -> None:
    yaml = library("yaml", "PyYAML")
    read = yaml.safe_load(written(tmp_path, to, ".yaml").read_text(encoding="utf-8"))
    read = read[node] if node else read
    assert {key: read[key] for key in wanted if key != "rostopic"} == pytest.approx(
        {key: value for key, value in wanted.items() if key != "rostopic"}, rel=1e-6
    )
    assert all(isinstance(read[key], type(value)) for key, value in wanted.items())


def test_kf_gins_reads_lists_of_three(tmp_path: Path) -> None:
    yaml = library("yaml", "PyYAML")
    read = yaml.safe_load(written(tmp_path, "kfgins", ".yaml").read_text(encoding="utf-8"))["imunoise"]
    assert read["arw"] == pytest.approx([n * 60.0 for n in (0.005, 0.006, 0.004)], rel=1e-6)
    assert {len(read[key]) for key in ("arw", "vrw", "gbstd", "abstd")} == {3}
    assert isinstance(read["corrtime"], float)


# pymavlink reads parameters of ArduPilot, as MAVProxy does.


@pytest.mark.parametrize(
    ("to", "wanted"),
    [
        ("ardupilot", {"EK3_GYRO_P_NSE": N_GYRO / math.sqrt(DT), "EK3_ACC_P_NSE": N_ACCEL / math.sqrt(DT)}),
        ("ardupilot-sim", {"SIM_GYR1_RND": math.sqrt(3.0 * RATE * 0.006**2 - 0.04**2)}),
    ],
)
def test_pymavlink_reads_it(tmp_path: Path, to: str, wanted: dict[str, float]) -> None:
    parameters = library("pymavlink.mavparm", "pymavlink").MAVParmDict()
    path = written(tmp_path, to, ".parm")
    assert parameters.load(str(path))
    assert {key: float(parameters[key]) for key in wanted} == pytest.approx(wanted, rel=1e-5)
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    assert len(parameters) == len(lines)


# GTSAM itself runs what is written for it.


def test_gtsam_runs_it(tmp_path: Path) -> None:
    library("gtsam", "gtsam")
    names: dict[str, Any] = {}
    exec(convert(imu(), "gtsam", rate=RATE).text, names)
    params = names["params"]
    gyro = np.diag([(n * DEG) ** 2 for n in (0.005, 0.006, 0.004)])
    assert params.getGyroscopeCovariance() == pytest.approx(gyro, rel=1e-6, abs=1e-30)
    walk = np.diag([(k * 1e-5) ** 2 for k in (1, 2, 3)])
    assert params.getBiasAccCovariance() == pytest.approx(walk, rel=1e-6, abs=1e-30)
