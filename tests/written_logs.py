"""Logs of other programs, written for tests from a log of ours: a bag of ROS 1, a ULog of PX4."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

import kfgen as kf

SYNC = b"ULog\x01\x12\x35\x01"
ORIGIN_DEG = 47.0
METRES_A_DEGREE = 111_132.95 - 559.85 * np.cos(np.radians(2 * ORIGIN_DEG))
"""North, at latitude `ORIGIN_DEG`: the usual series, good to a centimetre a kilometre."""
FORMATS = {
    "sensor_combined": ("uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;", "<Q6f"),
    "vehicle_gps_position": (
        "uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_msl_m;"
        "float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;uint8_t fix_type;",
        "<Q3d3fB",
    ),
}
"""Fields of a topic, and how a message of it is packed."""


def triad(log: kf.Log, name: str, axes: str = "xyz") -> np.ndarray:
    """Three channels beside each other, shape (n, 3)."""
    return np.stack([log.channel(f"{name}_{a}").values for a in axes], 1)


def write_bag(log: kf.Log, path: Path) -> None:
    """A ROS 1 bag of the topic /imu0, axes forward, left, up."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    vector, imu = types["geometry_msgs/msg/Vector3"], types["sensor_msgs/msg/Imu"]
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    quaternion = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    none = np.zeros(9)
    gyro, accel = (triad(log, s) * [1, -1, -1] for s in ("gyro", "accel"))
    with Writer(path) as writer:
        topic = writer.add_connection("/imu0", imu.__msgtype__, typestore=store)
        for k in range(log.n):
            ns = round(log.t[k] * 1e9) + 10**18
            head = header(k, stamp(ns // 10**9, ns % 10**9), "imu")
            message = imu(head, quaternion, none, vector(*gyro[k]), none, vector(*accel[k]), none)
            writer.write(topic, ns, store.serialize_ros1(message, imu.__msgtype__))


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<Hc", len(body), kind.encode()) + body


def write_ulog(log: kf.Log, path: Path) -> None:
    """A ULog of ``sensor_combined``, whose samples stand for the interval before, and ``vehicle_gps_position``."""
    dt = float(np.median(np.diff(log.t)))
    rows: list[tuple[int, int, bytes]] = []
    for t, w, f in zip(log.t, triad(log, "gyro"), triad(log, "accel"), strict=True):
        us = round((t + dt + 1.0) * 1e6)
        rows.append((us, 0, struct.pack(FORMATS["sensor_combined"][1], us, *w, *f)))
    p, v = triad(log, "gnss_p", "NED"), triad(log, "gnss_v", "NED")
    east = 111_412.84 * np.cos(np.radians(ORIGIN_DEG)) - 93.5 * np.cos(np.radians(3 * ORIGIN_DEG))
    for k in np.flatnonzero(np.isfinite(p).all(axis=1)):
        us = round((log.t[k] + 1.0) * 1e6)
        place = (ORIGIN_DEG + p[k, 0] / METRES_A_DEGREE, 8.0 + p[k, 1] / east, 400.0 - p[k, 2])
        rows.append((us, 1, struct.pack(FORMATS["vehicle_gps_position"][1], us, *place, *v[k], 3)))
    parts = [SYNC + struct.pack("<Q", 0)]
    parts += [_message("F", f"{name}:{fields}".encode()) for name, (fields, _) in FORMATS.items()]
    parts += [_message("A", struct.pack("<BH", 0, k) + n.encode()) for k, n in enumerate(FORMATS)]
    parts += [_message("D", struct.pack("<H", k) + body) for _, k, body in sorted(rows)]
    path.write_bytes(b"".join(parts))
