"""Proves that bags of ROS 1, ROS 2 and MCAP are read as rosbags has them, in kfgen's axes.

Recordings are compared with rosbags' own decoding by the definitions in the file. Bags with every message type are
written here by rosbags; what they must give follows from geometry: where a known rotation sends an axis.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from placed import placed
from scipy.spatial.transform import Rotation

from kfgen.core.errors import InputError, MissingExtra
from kfgen.log.readers import read_log

pytest.importorskip("rosbags", reason="rosbags is not installed (pip install 'kfgen[ros]')")
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

Find = Callable[[str], Path]
START_NS = 1_700_000_000_000_000_000
STORES = {"bag": Stores.ROS1_NOETIC, "db3": Stores.ROS2_HUMBLE, "mcap": Stores.ROS2_HUMBLE}


def by_rosbags(path: Path, topic: str) -> list[Any]:
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        connections = [c for c in bag.connections if c.topic == topic]
        return [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages(connections)]


def test_an_imu_of_ros_1_is_that_of_rosbags(recording: Find) -> None:
    path = recording("flights/ros1_tilt_laser.bag")
    log, theirs = read_log(path), by_rosbags(path, "/imu_data")
    assert log.t == pytest.approx(
        [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in theirs], abs=1e-6
    )
    assert log.values("gyro_x") == pytest.approx([m.angular_velocity.x for m in theirs])
    assert log.values("gyro_y") == pytest.approx([-m.angular_velocity.y for m in theirs])
    assert log.values("accel_z") == pytest.approx([-m.linear_acceleration.z for m in theirs])
    assert np.mean([log.values(f"accel_{a}").mean() for a in "z"]) == pytest.approx(-9.8, abs=0.02)


def test_an_imu_of_ros_2_is_that_of_rosbags(recording: Find) -> None:
    path = recording("flights/rosbag2_test_0.db3")
    log, theirs = read_log(path), by_rosbags(path, "/battery")
    assert log.values("gyro_y") == pytest.approx(np.full(1565, -132.0))
    assert log.values("voltage") == pytest.approx([m.voltage for m in theirs])


# Bags written here.


def bag(
    folder: Path, kind: str, stamped: bool = True, imus: tuple[str, ...] = ("/imu",), up: float = 9.8
) -> Path:
    """Ten seconds at 100 Hz of an inertial sensor, and the other messages at 10 Hz, 3 ms later."""
    store = get_typestore(STORES[kind])
    T: dict[str, Any] = {k.rsplit("/", 1)[-1]: v for k, v in store.types.items()}
    Header = store.types["std_msgs/msg/Header"]
    nine, none = np.zeros(9), np.zeros(36)

    def header(ns: int) -> Any:
        time = store.types["builtin_interfaces/msg/Time"](
            sec=ns // 10**9 if stamped else 0, nanosec=ns % 10**9 if stamped else 0
        )
        return Header(seq=0, stamp=time, frame_id="") if kind == "bag" else Header(stamp=time, frame_id="")

    def xyz(*v: float) -> Any:
        return T["Vector3"](x=v[0], y=v[1], z=v[2])

    def imu(k: int, h: Any, which: int) -> Any:
        return T["Imu"](
            h,
            T["Quaternion"](0.0, 0.0, 0.0, 1.0),
            nine,
            xyz(0.1 + which, 0.2, 0.3),
            nine,
            xyz(0.0, 1.0, up),
            nine,
        )

    turn = Rotation.from_euler("z", 30, degrees=True).as_quat()

    def odometry(k: int, h: Any) -> Any:
        pose = T["Pose"](T["Point"](x=1.0, y=2.0, z=3.0), T["Quaternion"](*turn))
        twist = T["Twist"](xyz(5.0, 0.0, 0.0), xyz(0.0, 0.0, 0.0))
        return T["Odometry"](
            h, "base", T["PoseWithCovariance"](pose, none), T["TwistWithCovariance"](twist, none)
        )

    status = {"status": 0, "service": 1}
    others = {
        "/mag": ("sensor_msgs/msg/MagneticField", lambda k, h: T["MagneticField"](h, xyz(2e-5, 1e-6, -4e-5), nine)),
        "/pressure": ("sensor_msgs/msg/FluidPressure", lambda k, h: T["FluidPressure"](h, 101325.0 - 12.0 * k, 0.0)),
        "/fix": (
            "sensor_msgs/msg/NavSatFix",
            lambda k, h: T["NavSatFix"](h, T["NavSatStatus"](**(status if k else {"status": -1, "service": 1})), 47.0 + 1e-6 * k, 8.0, 400.0 + k, nine, 0),
        ),
        "/temp": ("sensor_msgs/msg/Temperature", lambda k, h: T["Temperature"](h, 20.0 + k, 0.0)),
        "/odom": ("nav_msgs/msg/Odometry", odometry),
    }  # fmt: skip
    path = folder / f"a.{kind}"
    if kind == "bag":
        writer: Any = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer(folder / "a", version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
    with writer as out:
        connections = {n: out.add_connection(n, "sensor_msgs/msg/Imu", typestore=store) for n in imus}
        connections |= {n: out.add_connection(n, t, typestore=store) for n, (t, _) in others.items()}
        for k in range(1000):
            ns = START_NS + k * 10_000_000
            for which, n in enumerate(imus):
                out.write(
                    connections[n], ns + 500_000, serialize(imu(k, header(ns), which), "sensor_msgs/msg/Imu")
                )
            if k % 10 == 0:
                for n, (t, make) in others.items():
                    out.write(
                        connections[n], ns + 3_000_000, serialize(make(k // 10, header(ns + 3_000_000)), t)
                    )
    return path if kind == "bag" else next((folder / "a").glob(f"*.{kind}"))


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_every_sensor_message_is_read(tmp_path: Path, kind: str) -> None:
    log = read_log(bag(tmp_path, kind))
    assert (log.n, log.dt) == (1000, pytest.approx(0.01, rel=1e-4))
    assert [log.values(f"gyro_{a}")[7] for a in "xyz"] == pytest.approx([0.1, -0.2, -0.3])
    assert [log.values(f"accel_{a}")[7] for a in "xyz"] == pytest.approx([0.0, -1.0, -9.8])
    assert [placed(log, f"mag_{a}")[1][0] for a in "xyz"] == pytest.approx([2e-5, -1e-6, 4e-5])
    t, pressure = placed(log, "pressure")
    assert pressure == pytest.approx(101325.0 - 12.0 * np.arange(100))
    assert t == pytest.approx(log.t[::10], abs=1e-9)
    assert placed(log, "temperature")[1] == pytest.approx(293.15 + np.arange(100))
    assert placed(log, "baro_height")[1][50] == pytest.approx(49 * 12 / (1.225 * 9.80665), rel=0.01)
    assert any("moved by at most 3 ms" in w for w in log.warnings)


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_fixes_are_metres_north_east_down(tmp_path: Path, kind: str) -> None:
    log = read_log(bag(tmp_path, kind))
    _, north = placed(log, "gnss_p_N")
    assert north.size == 99  # the first has no fix
    assert north[-1] == pytest.approx(98e-6 * 111_180.0, rel=1e-3)  # a degree of latitude at 47 deg and 400 m
    assert placed(log, "gnss_p_D")[1][-1] == pytest.approx(-98.0)


def test_odometry_is_a_reference_in_axes_north_east_down(tmp_path: Path) -> None:
    """Turned left by 30 deg from east: the nose points to azimuth 60 deg, level."""
    log = read_log(bag(tmp_path, "db3"))
    q = Rotation.from_quat([placed(log, f"ref_q_{a}")[1][0] for a in "wxyz"], scalar_first=True)
    nose = np.deg2rad(60.0)
    assert q.apply([1.0, 0.0, 0.0]) == pytest.approx([np.cos(nose), np.sin(nose), 0.0], abs=1e-9)
    assert q.apply([0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert [placed(log, f"ref_p_{a}")[1][0] for a in "NED"] == pytest.approx([2.0, 1.0, -3.0])
    v = [placed(log, f"ref_v_{a}")[1][0] for a in "NED"]
    assert v == pytest.approx(5.0 * np.array([np.cos(nose), np.sin(nose), 0.0]), abs=1e-9)


def test_axes_that_point_down_already_stay(tmp_path: Path) -> None:
    log = read_log(bag(tmp_path, "bag", up=-9.8))
    assert [log.values(f"accel_{a}")[0] for a in "xyz"] == pytest.approx([0.0, 1.0, -9.8])
    assert any("down already" in w for w in log.warnings)


def test_one_of_several_topics_is_chosen(tmp_path: Path) -> None:
    path = bag(tmp_path, "bag", imus=("/a/imu", "/b/imu"))
    assert any("Imu of /a/imu; there are /b/imu too" in w for w in read_log(path).warnings)
    assert read_log(path, topic="/b/imu").values("gyro_x")[0] == pytest.approx(1.1)
    assert read_log(path, instance=1).values("gyro_x")[0] == pytest.approx(1.1)
    with pytest.raises(InputError, match="no inertial sensor of instance 2"):
        read_log(path, instance=2)


def test_without_stamps_times_of_receipt_are_used_and_said(tmp_path: Path) -> None:
    log = read_log(bag(tmp_path, "bag", stamped=False))
    assert log.t[0] == pytest.approx(START_NS * 1e-9 + 5e-4, abs=1e-6)
    assert any("/imu: messages without a stamp" in w for w in log.warnings)


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.97])
def test_a_cut_off_bag_is_read_or_refused_in_words(tmp_path: Path, kind: str, share: float) -> None:
    path = bag(tmp_path, kind)
    cut = tmp_path / f"cut.{kind}"
    cut.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    try:
        log = read_log(cut)
    except InputError as error:
        said = str(error)
    else:
        said = f"{cut}"
        assert log.n <= 1000
        assert any("cut off" in w for w in log.warnings)
    assert str(cut) in said


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_what_is_no_bag_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    path.write_text("hello\n" * 100)
    with pytest.raises(InputError, match="no bag that can be read"):
        read_log(path)


def test_the_library_that_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rosbags.rosbag1", None)
    path = tmp_path / "a.bag"
    path.write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(MissingExtra, match=r'pip install "kfgen\[ros\]"'):
        read_log(path)
