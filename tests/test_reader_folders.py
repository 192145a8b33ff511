"""Proves that logs that are folders, or archives of them, are read: EuRoC and TUM-VI, phyphox, split bags of ROS 2.

The folders are written here as their makers write them; what they must give follows from geometry.
"""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import Result

from kfgen.core.errors import InputError
from kfgen.core.wgs84 import local_metres
from kfgen.log.contents import contents
from kfgen.log.readers import read_log

Cli = Callable[..., Result]
START_NS = 1_403_636_579_758_555_392
N = 400
IMU_HEAD = "#timestamp [ns]," + ",".join(
    [*(f"w_RS_S_{a} [rad s^-1]" for a in "xyz"), *(f"a_RS_S_{a} [m s^-2]" for a in "xyz")]
)
POSE_HEAD = "#timestamp, " + ", ".join(
    [*(f"p_RS_R_{a} [m]" for a in "xyz"), *(f"q_RS_{a} []" for a in "wxyz")]
)
RNG = np.random.default_rng(7)
GYRO = RNG.normal(0.0, 0.01, (N, 3))
ACCEL = RNG.normal([9.8, 0.0, 0.0], 0.05, (N, 3))
YAW = np.linspace(0.0, 1.0, N // 2)


def rows(head: str, stamps: np.ndarray, values: np.ndarray) -> str:
    lines = [
        ",".join([str(int(s)), *(f"{v:.17g}" for v in row)]) for s, row in zip(stamps, values, strict=True)
    ]
    return "\n".join([head, *lines]) + "\n"


def euroc(folder: Path, pose: str = "state_groundtruth_estimate0", settings: str = "") -> Path:
    """A sequence: 200 Hz of an inertial sensor, 100 Hz of a pose that turns left about the vertical."""
    stamps = START_NS + 5_000_000 * np.arange(N)
    for name, content in {
        "imu0": rows(IMU_HEAD, stamps, np.hstack([GYRO, ACCEL])),
        pose: rows(POSE_HEAD, stamps[::2], poses()),
        "cam0": "#timestamp [ns],filename\n" + "".join(f"{s},{s}.png\n" for s in stamps[::10]),
    }.items():
        (folder / "mav0" / name).mkdir(parents=True)
        (folder / "mav0" / name / "data.csv").write_text(content)
    (folder / "mav0" / "imu0" / "sensor.yaml").write_text(
        "sensor_type: imu\nrate_hz: 200\ngyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]\n"
    )
    (folder / "mav0" / pose / "sensor.yaml").write_text(settings)
    return folder


def poses() -> np.ndarray:
    """Positions (t, 2 t, 3 t) and attitudes turned left by `YAW` about the third axis, which is up."""
    k = np.arange(N // 2)[:, None]
    q = Rotation.from_rotvec(np.outer(YAW, [0.0, 0.0, 1.0])).as_quat(scalar_first=True)
    return np.hstack([0.01 * k * [1.0, 2.0, 3.0], q])


def test_a_folder_of_euroc_has_its_sensors_and_its_pose(tmp_path: Path) -> None:
    log = read_log(euroc(tmp_path / "V1_01"))
    assert log.n == N
    assert 1.0 / log.dt == pytest.approx(200.0, rel=1e-4)
    assert log.t[0] == pytest.approx(START_NS * 1e-9, abs=1e-6)
    for k, a in enumerate("xyz"):
        assert np.array_equal(log.values(f"gyro_{a}"), GYRO[:, k])
        assert np.array_equal(log.values(f"accel_{a}"), ACCEL[:, k])
    ref = {n: c.values[::2] for n, c in log.channels.items() if n.startswith("ref_")}
    k = 0.01 * np.arange(N // 2)
    # forward, left, up is forward, right, down after a half turn about the first axis
    assert np.stack([ref[f"ref_p_{a}"] for a in "NED"]) == pytest.approx(np.stack([k, -2.0 * k, -3.0 * k]))
    q = np.stack([ref[f"ref_q_{a}"] for a in "wxyz"], axis=1)
    up = Rotation.from_quat(q, scalar_first=True).apply([0.0, 0.0, 1.0])
    ahead = Rotation.from_quat(q, scalar_first=True).apply([1.0, 0.0, 0.0])
    assert up == pytest.approx(np.tile([0.0, 0.0, -1.0], (N // 2, 1)), abs=1e-12)
    assert ahead == pytest.approx(np.stack([np.cos(YAW), -np.sin(YAW), 0.0 * YAW], axis=1), abs=1e-9)
    assert any("gyroscope_noise_density 1.6968e-04" in w for w in log.warnings)


@pytest.mark.parametrize("inner", ["mav0", "mav0/imu0"])
def test_the_folder_inside_may_be_given(tmp_path: Path, inner: str) -> None:
    folder = euroc(tmp_path / "a")
    whole, part = read_log(folder), read_log(folder / inner)
    assert np.array_equal(whole.values("gyro_x"), part.values("gyro_x"))
    assert whole.sha256 != part.sha256 or inner == "mav0"


def test_a_marker_away_from_the_body_is_brought_back_to_it(tmp_path: Path) -> None:
    """A marker 0.2 m ahead of the body, turned by a right angle: T_BS is its pose in the body."""
    settings = (
        "T_BS:\n  cols: 4\n  rows: 4\n"
        "  data: [0.0, -1.0, 0.0, 0.2,\n         1.0, 0.0, 0.0, 0.0,\n         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\n"
    )
    plain, marked = read_log(euroc(tmp_path / "a")), read_log(euroc(tmp_path / "b", "vicon0", settings))
    turned = Rotation.from_rotvec(
        np.outer(YAW - np.pi / 2, [0.0, 0.0, 1.0])
    )  # the body is turned right of its marker
    body = poses()[:, :3] - turned.apply([0.2, 0.0, 0.0])
    for k, (a, sign) in enumerate(zip("NED", (1.0, -1.0, -1.0), strict=True)):
        assert marked.channels[f"ref_p_{a}"].values[::2] == pytest.approx(sign * body[:, k])
    assert plain.channels["ref_q_w"].values[0] == pytest.approx(0.0, abs=1e-12)


def test_a_cut_last_line_is_left_out_and_any_other_is_said(tmp_path: Path) -> None:
    folder = euroc(tmp_path / "a")
    table = folder / "mav0/imu0/data.csv"
    whole = table.read_text()
    table.write_text(whole + "1403636581758555392,0.1")
    log = read_log(folder)
    assert log.n == N
    assert any("last line" in w for w in log.warnings)
    table.write_text(whole.replace("\n", "\nx,y\n", 2))
    with pytest.raises(InputError, match=r"data\.csv: line 2: it is no line of numbers"):
        read_log(folder)


def test_topics_of_a_folder_are_listed(tmp_path: Path, kfgen: Cli) -> None:
    folder = euroc(tmp_path / "a")
    assert list(contents(folder).topics) == ["cam0", "imu0", "state_groundtruth_estimate0"]
    answer = kfgen("list", folder)
    assert answer.exit_code == 0
    assert "ref_q_w" in answer.output


def test_a_folder_of_something_else_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no log")
    with pytest.raises(InputError, match=r"holds no log that is known.*EuRoC"):
        read_log(tmp_path)


def phyphox(folder: Path, separator: str = ",") -> Path:
    """Half a second: gyroscope and accelerometer at 100 Hz on clocks 2 ms apart, pressure, place."""
    folder.mkdir()

    def write(name: str, head: list[str], values: np.ndarray) -> None:
        decimal = "," if separator == ";" else "."
        body = [separator.join(f"{v:.9E}".replace(".", decimal) for v in row) for row in values]
        (folder / f"{name}.csv").write_text("\n".join([separator.join(f'"{h}"' for h in head), *body]) + "\n")

    t = 0.01 * np.arange(50)[:, None]
    write("Gyroscope", ["Time (s)", *(f"Gyroscope {a} (rad/s)" for a in "xyz")], np.hstack([t, GYRO[:50]]))
    write("Accelerometer", ["Time (s)", *(f"{a} (m/s^2)" for a in "XYZ")], np.hstack([t + 0.002, ACCEL[:50]]))
    write(
        "Linear Accelerometer", ["Time (s)", *(f"{a} (m/s^2)" for a in "XYZ")], np.hstack([t, 0 * GYRO[:50]])
    )
    write("Pressure", ["Time (s)", "Pressure (hPa)"], np.hstack([t[::5], 950.0 + 0 * t[::5]]))
    head = ["Time (s)", "Latitude (°)", "Longitude (°)", "Height (m)", "Velocity (m/s)", "Direction (°)"]
    place = np.array([[0.1, 47.0, 8.0, 500.0, 2.0, 90.0], [0.3, 47.0, 8.00001, 500.0, 2.0, 90.0]])
    write("Location", head, place)
    (folder / "meta").mkdir()
    (folder / "meta" / "device.csv").write_text('"property","value"\n"version","1.1.16"\n')
    return folder


def archived(folder: Path, name: str, top: str = "") -> Path:
    path = folder.parent / name
    with zipfile.ZipFile(path, "w") as archive:
        for part in folder.rglob("*"):
            archive.write(part, f"{top}{part.relative_to(folder)}")
    return path


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("packed", [False, True])
def test_an_export_of_phyphox(tmp_path: Path, separator: str, packed: bool) -> None:
    folder = phyphox(tmp_path / "pendulum", separator)
    log = read_log(archived(folder, "pendulum.zip") if packed else folder)
    assert log.values("gyro_y") == pytest.approx(GYRO[:50, 1], rel=1e-8)
    assert log.values("accel_x") == pytest.approx(ACCEL[:50, 0], rel=1e-8)
    assert np.nanmean(log.channels["pressure"].values) == pytest.approx(95_000.0)
    _, east, _ = local_metres(*np.deg2rad([[47.0, 47.0], [8.0, 8.00001]]), np.array([500.0, 500.0]))
    found = log.channels["gnss_p_E"].values
    assert found[np.isfinite(found)] == pytest.approx(east)
    assert np.nanmax(log.channels["gnss_v_E"].values) == pytest.approx(2.0)
    assert any("without gravity" in w for w in log.warnings)


def test_one_file_in_an_archive_and_a_folder_in_a_folder(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "log.csv").write_text("t [s],x [m]\n0,1\n1,2\n")
    assert read_log(archived(tmp_path / "in", "one.zip")).values("x") == pytest.approx([1.0, 2.0])
    folder = euroc(tmp_path / "seq")
    log = read_log(archived(folder, "seq.zip", "deep/er/"))
    assert np.array_equal(log.values("gyro_x"), GYRO[:, 0])
    assert log.source.endswith("seq.zip")


def test_an_archive_that_leads_out_of_itself_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../out.csv", "t [s],x [m]\n0,1\n1,2\n")
    with pytest.raises(InputError, match="leads out of it"):
        read_log(path)
    assert not (tmp_path.parent / "out.csv").exists()


@pytest.mark.parametrize("content", [b"PK\x03\x04 cut", b"no archive at all"])
def test_a_damaged_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.zip"
    path.write_bytes(content)
    with pytest.raises(InputError, match="zip archive"):
        read_log(path)


def test_an_archive_that_grows_beyond_measure_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kfgen.log.readers.packed.compressed.SMALL_BYTES", 1000)
    monkeypatch.setattr("kfgen.log.readers.packed.compressed.MOST_GROWTH", 2)
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", "0" * 1_000_000)
    with pytest.raises(InputError, match="more than"):
        read_log(path)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_split_bag_is_all_its_files(tmp_path: Path, kind: str) -> None:
    """Two bags of the halves, put into one folder with the metadata of a split bag, have what the whole has."""
    pytest.importorskip("rosbags", reason="rosbags is not installed (pip install 'kfgen[ros]')")
    whole, split = tmp_path / "whole", tmp_path / "split"
    bag(whole, kind, range(200))
    halves = [tmp_path / "a", tmp_path / "b"]
    for half, k in zip(halves, (range(100), range(100, 200)), strict=True):
        bag(half, kind, k)
    split.mkdir()
    names = []
    for k, half in enumerate(halves):
        names.append(f"split_{k}.{kind}")
        shutil.copy(next(half.glob(f"*.{kind}")), split / names[-1])
    metadata = (whole / "metadata.yaml").read_text()
    old = next(whole.glob(f"*.{kind}")).name
    assert old in metadata
    listed = "\n".join(f"  - {name}" for name in names)
    lines = metadata.splitlines()
    at = next(i for i, line in enumerate(lines) if line.strip().startswith("relative_file_paths"))
    lines[at + 1] = listed
    (split / "metadata.yaml").write_text(without_files("\n".join(lines)) + "\n")
    one, two = read_log(whole), read_log(split)
    assert two.n == 200
    assert np.array_equal(one.values("gyro_x"), two.values("gyro_x"))
    (split / names[0]).unlink()
    with pytest.raises(InputError, match="no bag that can be read"):
        read_log(split)


def without_files(metadata: str) -> str:
    """Metadata without the list of what each file holds, as version 4 has none; readers need the paths alone."""
    lines, out, inside = metadata.splitlines(), [], False
    for line in lines:
        if line.startswith("  files:"):
            inside = True
        elif inside and line.startswith("  ") and line[2] not in " -":
            inside = False
        if not inside:
            out.append(line.replace("version: 5", "version: 4").replace("version: 8", "version: 4"))
    return "\n".join(out)


def bag(folder: Path, kind: str, samples: range) -> None:
    """A bag of one inertial sensor."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    T = {k.rsplit("/", 1)[-1]: v for k, v in store.types.items()}
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer(folder, version=8, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for k in samples:
            ns = START_NS + 5_000_000 * k
            stamp = store.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            nine = np.zeros(9)
            message = T["Imu"](
                header=store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
                orientation=T["Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
                orientation_covariance=nine,
                angular_velocity=T["Vector3"](x=0.001 * k, y=0.0, z=0.0),
                angular_velocity_covariance=nine,
                linear_acceleration=T["Vector3"](x=0.0, y=0.0, z=9.8),
                linear_acceleration_covariance=nine,
            )
            writer.write(connection, ns, store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
