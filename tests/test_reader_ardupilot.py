"""Proves that ArduPilot logs are read as pymavlink has them, at the times of the sensors' own stamps.

The oracle is pymavlink's DFReader, message by message. Messages that no recording here has (increments, a log in
degraded shape) are packed by hand with `struct`.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from placed import nearest, placed

from kfgen.core.errors import InputError
from kfgen.log.readers import read_log
from kfgen.log.readers.flight.dataflash import messages

Find = Callable[[str], Path]
ONE_SECOND = "flights/ardupilot_1s.BIN"
PLANE = "flights/arduplane_pilot_0004.BIN"


def by_pymavlink(path: Path) -> dict[str, list[Any]]:
    reader = pytest.importorskip("pymavlink.DFReader", reason="pymavlink is not installed")
    log, found = reader.DFReader_binary(str(path)), defaultdict(list)
    while (m := log.recv_msg()) is not None:
        found[m.get_type()].append(m)
    return found


@pytest.mark.parametrize("name", [ONE_SECOND, PLANE])
def test_every_number_of_every_message_is_that_of_pymavlink(recording: Find, name: str) -> None:
    path = recording(name)
    own, _ = messages(path.read_bytes())
    theirs = by_pymavlink(path)
    compared = 0
    for kind, rows in theirs.items():
        if kind == "FMT":
            continue
        assert own[kind].at.size == len(rows), kind
        for field in rows[0].get_fieldnames():
            values = own[kind].fields[field]
            if (
                values.dtype.kind in "SV"
                or values.ndim > 1
                or isinstance(getattr(rows[0], field), (str, bytes, list))
            ):
                continue
            expected = np.array([float(getattr(m, field)) for m in rows])
            np.testing.assert_allclose(
                own[kind].numbers(field), expected, rtol=1e-12, err_msg=f"{kind} {field}"
            )
            compared += expected.size
    assert compared > 4000


def test_sensors_are_those_of_the_messages(recording: Find) -> None:
    path = recording(ONE_SECOND)
    log, theirs = read_log(path), by_pymavlink(path)
    assert log.t == pytest.approx([m.TimeUS * 1e-6 for m in theirs["IMU"]], abs=1e-9)
    assert log.values("gyro_y") == pytest.approx([m.GyrY for m in theirs["IMU"]])
    assert log.values("accel_z") == pytest.approx([m.AccZ for m in theirs["IMU"]])
    for channel, kind, field, stamp, factor in (
        ("mag_x", "MAG", "MagX", lambda m: m.S * 1e-6, 1e-7),
        ("pressure", "BARO", "Press", lambda m: m.SMS * 1e-3, 1.0),
        ("voltage", "BAT", "Volt", lambda m: m.TimeUS * 1e-6, 1.0),
        ("gnss_v_D", "GPS", "VZ", lambda m: m.TimeUS * 1e-6, 1.0),
    ):
        t, values = placed(log, channel)
        stamps = np.array([stamp(m) for m in theirs[kind]])
        rows = nearest(t, stamps)
        assert np.abs(t - stamps[rows]).max() < 0.0275
        assert values == pytest.approx([getattr(theirs[kind][k], field) * factor for k in rows])
    assert log.samples == "at"


def test_gravity_is_up_in_axes_forward_right_down(recording: Find) -> None:
    log = read_log(recording(ONE_SECOND))
    mean = np.array([log.values(f"accel_{axis}").mean() for axis in "xyz"])
    assert np.linalg.norm(mean) == pytest.approx(9.8, abs=0.25)
    assert mean[2] < -9.5


def test_the_second_sensor_is_chosen(recording: Find) -> None:
    path = recording(ONE_SECOND)
    log, theirs = read_log(path, instance=1), by_pymavlink(path)
    assert log.values("gyro_x") == pytest.approx([m.GyrX for m in theirs["IMU2"]])
    t, x = placed(log, "mag_x")
    assert x * 1e7 == pytest.approx([m.MagX for m in theirs["MAG2"]][: t.size])
    with pytest.raises(InputError, match="no inertial sensor of instance 5"):
        read_log(path, instance=5)


def test_velocity_is_that_of_speed_and_course(recording: Find) -> None:
    path = recording(PLANE)
    log = read_log(path)
    fixed = [m for m in by_pymavlink(path)["GPS"] if m.Status >= 3]
    speed = np.hypot(placed(log, "gnss_v_N")[1], placed(log, "gnss_v_E")[1])
    assert speed == pytest.approx([m.Spd for m in fixed][: speed.size], abs=1e-6)
    assert any("376 of 461 solutions without a fix" in w for w in log.warnings)


def test_a_log_without_an_inertial_sensor_says_how_to_log_one(recording: Find) -> None:
    log = read_log(recording(PLANE))
    assert any("no inertial sensor" in w and "LOG_REPLAY = 1" in w for w in log.warnings)
    assert "gyro_x" not in log.channels
    assert "mag_x" in log.channels


def test_a_cut_off_log_is_read_up_to_its_end(recording: Find, tmp_path: Path) -> None:
    path, cut = recording(ONE_SECOND), tmp_path / "cut.bin"
    cut.write_bytes(path.read_bytes()[:-20_000])
    whole, part = read_log(path), read_log(cut)
    assert 0 < part.n < whole.n
    assert np.array_equal(part.values("gyro_x"), whole.values("gyro_x")[: part.n])
    assert any("cut off" in w for w in part.warnings)


def test_a_damaged_log_is_read_or_refused_in_words(recording: Find, tmp_path: Path) -> None:
    data = recording(ONE_SECOND).read_bytes()
    rng, said = np.random.default_rng(3), list[str]()
    for k in range(20):
        broken = bytearray(data)
        for at in rng.integers(3, len(data), 200):
            broken[at] = int(rng.integers(256))
        path = tmp_path / f"{k}.bin"
        path.write_bytes(bytes(broken))
        try:
            log = read_log(path)
        except InputError as error:
            said.append(str(error))
        else:
            assert (np.diff(log.t) > 0.0).all()
    assert all(str(tmp_path) in text for text in said)


def test_what_is_no_dataflash_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_text("hello\n" * 100)
    with pytest.raises(InputError, match="no DataFlash log"):
        read_log(path)


# Messages packed by hand.


def described(kind: int, name: str, letters: str, columns: str) -> bytes:
    length = 3 + struct.calcsize("<" + "".join({"Q": "Q", "f": "f", "B": "B", "H": "H"}[k] for k in letters))
    return b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s", kind, length, name.encode(), letters.encode(), columns.encode()
    )


def packed(kind: int, letters: str, *values: float) -> bytes:
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + letters, *values)


def test_increments_of_a_replay_log_are_divided_by_their_intervals(tmp_path: Path) -> None:
    """RISI has no time of its own: that of the frame before it."""
    letters = "ffffffffBB"
    data = b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"
    )
    data += described(1, "RFRH", "Q", "TimeUS")
    data += described(2, "RISI", letters, "DVX,DVY,DVZ,DAX,DAY,DAZ,DVDT,DADT,Flags,I")
    for k in range(200):
        data += packed(1, "Q", 1_000_000 + 2500 * k)
        for instance in (0, 1):
            rate, dt = 0.1 * (instance + 1), 0.0025
            data += packed(2, letters, 0, 0, -9.8 * dt, rate * dt, 0, 0, dt, dt, 3, instance)
    path = tmp_path / "replay.bin"
    path.write_bytes(data)
    log = read_log(path)
    assert log.values("accel_z") == pytest.approx(np.full(200, -9.8), rel=1e-6)
    assert log.values("gyro_x") == pytest.approx(np.full(200, 0.1), rel=1e-6)
    assert (log.t[0], log.dt, log.samples) == (1.0, pytest.approx(0.0025), "before")
    assert read_log(path, instance=1).values("gyro_x") == pytest.approx(np.full(200, 0.2), rel=1e-6)


def test_clipped_samples_a_second_are_those_of_the_counter(tmp_path: Path) -> None:
    """60 clips between two messages half a second apart are 120 a second, at the middle between them."""
    letters = "ffffff"
    data = b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"
    )
    data += described(1, "IMU", "Q" + letters, "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    data += described(2, "VIBE", "QBfffH", "TimeUS,IMU,VibeX,VibeY,VibeZ,Clip")
    for k in range(400):
        data += packed(1, "Q" + letters, 1_000_000 + 5000 * k, 0, 0, 0, 0, 0, -9.8)
        if k % 100 == 0:
            data += packed(2, "QBfffH", 1_000_000 + 5000 * k, 0, 3, 4, 0, 60 if k >= 200 else 0)
    path = tmp_path / "clips.bin"
    path.write_bytes(data)
    log = read_log(path)
    seen = np.flatnonzero(np.isfinite(log.channels["clipping"].values))
    assert log.channels["clipping"].values[seen] == pytest.approx([0.0, 120.0, 0.0])
    assert log.t[seen] == pytest.approx([1.25, 1.75, 2.25])
    assert np.nanmax(log.channels["vibration"].values) == pytest.approx(5.0)
