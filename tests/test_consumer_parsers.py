"""Proves that files of `convert` are read by the programs that consume them, or by the parser that those use, where it is installed."""

from __future__ import annotations

import math
import shutil
import subprocess
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


# SDFormat, the library by which Gazebo reads models; Debian has it (libsdformat-dev).

READ_SDF = """
#include <iostream>
#include <sdf/sdf.hh>
int main(int, char **argv) {
  sdf::Root root;
  for (const auto &error : root.Load(argv[1])) { std::cerr << error.Message() << "\\n"; return 1; }
  const auto *sensor = root.Model()->LinkByIndex(0)->SensorByIndex(0);
  const auto *imu = sensor->ImuSensor();
  std::cout.precision(10);
  std::cout << sensor->UpdateRate();
  for (const auto &n : {imu->AngularVelocityXNoise(), imu->AngularVelocityYNoise(), imu->AngularVelocityZNoise(),
                        imu->LinearAccelerationXNoise(), imu->LinearAccelerationYNoise(), imu->LinearAccelerationZNoise()})
    std::cout << " " << (n.Type() == sdf::NoiseType::GAUSSIAN) << " " << n.StdDev() << " " << n.DynamicBiasStdDev()
              << " " << n.DynamicBiasCorrelationTime();
  std::cout << "\\n";
}
"""


def compiled(folder: Path, source: str, *flags: str) -> Path:
    """A program of C++."""
    compiler = shutil.which("c++") or pytest.skip("there is no compiler of C++")
    (folder / "read.cpp").write_text(source)
    subprocess.run([compiler, "-std=c++17", "read.cpp", *flags, "-o", "read"], cwd=folder, check=True)
    return folder / "read"


def numbers_read(program: Path, file: Path) -> list[float]:
    done = subprocess.run([program, file], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


@pytest.mark.long
def test_sdformat_reads_it(tmp_path: Path) -> None:
    """The element of a sensor, in a link of a model of ours."""
    flags = (
        subprocess.run(
            ["pkg-config", "--cflags", "--libs", "sdformat12"], capture_output=True, text=True, check=False
        )
        if shutil.which("pkg-config")
        else None
    )
    if flags is None or flags.returncode:
        pytest.skip("SDFormat, the parser of Gazebo, is not installed (libsdformat-dev of Debian)")
    sensor = convert(imu(), "gazebo", rate=RATE).text
    model = tmp_path / "model.sdf"
    model.write_text(f'<sdf version="1.9"><model name="m"><link name="l">{sensor}</link></model></sdf>')
    rate, *rest = numbers_read(compiled(tmp_path, READ_SDF, *flags.stdout.split()), model)
    rows = np.reshape(rest, (6, 4))
    assert rate == RATE
    assert (rows[:, 0] == 1.0).all()
    gyro = [n * DEG / math.sqrt(DT) for n in (0.005, 0.006, 0.004)]
    assert rows[:3, 1] == pytest.approx(gyro, rel=1e-6)
    assert rows[3:, 2] == pytest.approx([k * 1e-5 for k in (1, 2, 3)], rel=1e-6)
    assert (rows[:, 3] > 0.0).all()


# cereal, the library by which Basalt reads its calibration; Debian has it (libcereal-dev). Basalt itself is in no registry.

READ_BASALT = """
#include <array>
#include <fstream>
#include <iostream>
#include <cereal/archives/json.hpp>
#include <cereal/types/array.hpp>
struct Calibration {
  double rate;
  std::array<double, 3> accel, gyro, accel_bias, gyro_bias;
  template <class Archive> void serialize(Archive &ar) {
    ar(cereal::make_nvp("imu_update_rate", rate), cereal::make_nvp("accel_noise_std", accel),
       cereal::make_nvp("gyro_noise_std", gyro), cereal::make_nvp("accel_bias_std", accel_bias),
       cereal::make_nvp("gyro_bias_std", gyro_bias));
  }
};
int main(int, char **argv) {
  std::ifstream file(argv[1]);
  cereal::JSONInputArchive archive(file);
  Calibration c;
  archive(c);
  std::cout.precision(10);
  std::cout << c.rate;
  for (const auto &v : {c.accel, c.gyro, c.accel_bias, c.gyro_bias}) for (double x : v) std::cout << " " << x;
}
"""


@pytest.mark.long
def test_cereal_reads_it(tmp_path: Path) -> None:
    if not Path("/usr/include/cereal/cereal.hpp").is_file():
        pytest.skip("cereal, the parser of Basalt, is not installed (libcereal-dev of Debian)")
    rate, *rest = numbers_read(compiled(tmp_path, READ_BASALT), written(tmp_path, "basalt", ".json"))
    assert rate == RATE
    rows = np.reshape(rest, (4, 3))
    assert rows[1] == pytest.approx([n * DEG for n in (0.005, 0.006, 0.004)], rel=1e-6)
    assert rows[2] == pytest.approx([k * 1e-5 for k in (1, 2, 3)], rel=1e-6)
