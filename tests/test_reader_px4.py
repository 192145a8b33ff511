"""Proves that PX4 logs are read as pyulog has them, at the times of their own stamps, and said where they are not whole.

The oracle is pyulog itself: fields and stamps come from it here by hand, message by message. Positions are
compared with the integral of the receiver's own velocity, heights with the receiver's.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from placed import nearest, placed

from kfgen.core.errors import InputError, MissingExtra
from kfgen.log.readers import read_log
from kfgen.log.readers.flight.px4 import _Topics
from kfgen.log.readers.tables.streams import LogChoice

pyulog = pytest.importorskip("pyulog", reason="pyulog is not installed (pip install 'kfgen[px4]')")
Find = Callable[[str], Path]

FLIGHTS = ("gps_interference", "battery_brownout", "motor_failure", "vtol_small", "appended_multiple")


def topic(path: Path, name: str, instance: int = 0) -> dict[str, Any]:
    return dict(pyulog.ULog(str(path)).get_dataset(name, instance).data)


@pytest.mark.parametrize("name", FLIGHTS)
def test_inertial_samples_are_those_of_the_log(recording: Find, name: str) -> None:
    path = recording(f"flights/px4_{name}.ulg")
    log, own = read_log(path), topic(path, "sensor_combined")
    assert np.array_equal(log.t, own["timestamp"] * 1e-6)
    for k, axis in enumerate("xyz"):
        assert np.array_equal(log.values(f"gyro_{axis}"), own[f"gyro_rad[{k}]"].astype(float))
        assert np.array_equal(log.values(f"accel_{axis}"), own[f"accelerometer_m_s2[{k}]"].astype(float))
    assert log.samples == "before"


def test_the_numbers_of_the_npz_twin(recording: Find) -> None:
    log = read_log(recording("native/px4_auav_x21.ulg"))
    twin = np.load(recording("dynamic/px4_auav_x21_68s.npz"))
    assert np.allclose(log.t, twin["t_us"] * 1e-6, atol=1e-9, rtol=0)
    for k, axis in enumerate("xyz"):
        assert np.array_equal(log.values(f"gyro_{axis}"), twin["gyr"][:, k].astype(float))
        assert np.array_equal(log.values(f"accel_{axis}"), twin["acc"][:, k].astype(float))
    _, x = placed(log, "mag_x")
    assert np.isin((x * 1e4).astype(np.float32), twin["mag"][:, 0]).mean() > 0.99
    said = next(w for w in log.warnings if "8 gaps" in w)
    assert "0.0648 s" in said
    assert any("lost data 4 times, 0.119 s" in w for w in log.warnings)


def test_gravity_is_up_in_axes_forward_right_down(recording: Find) -> None:
    log = read_log(recording("flights/px4_vtol_small.ulg"))
    mean = [log.values(f"accel_{axis}").mean() for axis in "xyz"]
    assert mean == pytest.approx([0.0, 0.0, -9.8], abs=0.25)


@pytest.mark.parametrize(
    ("channel", "name", "field", "factor"),
    [
        ("mag_x", "vehicle_magnetometer", "magnetometer_ga[0]", 1e-4),
        ("pressure", "vehicle_air_data", "baro_pressure_pa", 1.0),
        ("airspeed", "airspeed", "true_airspeed_m_s", 1.0),
        ("current", "battery_status", "current_a", 1.0),
        ("voltage", "battery_status", "voltage_v", 1.0),
        ("gnss_v_N", "vehicle_gps_position", "vel_n_m_s", 1.0),
        ("gnss_v_D", "vehicle_gps_position", "vel_d_m_s", 1.0),
        ("vibration", "vehicle_imu_status", "accel_vibration_metric", 1.0),
        ("temperature", "sensor_gyro", "temperature", 1.0),
    ],
)
def test_an_aiding_sample_is_in_the_row_nearest_its_stamp(
    recording: Find, channel: str, name: str, field: str, factor: float
) -> None:
    path = recording("flights/px4_vtol_small.ulg")
    own, log = topic(path, name), read_log(path)
    stamps = np.asarray(own["timestamp"], float)
    sampled = np.asarray(own.get("timestamp_sample", 0 * stamps), float)
    stamps = np.where(sampled > 0, sampled, stamps) * 1e-6
    t, values = placed(log, channel)
    index = nearest(t, stamps)
    assert np.abs(t - stamps[index]).max() <= 0.5 * 0.0053
    zero = 273.15 if channel == "temperature" else 0.0
    assert values == pytest.approx(np.asarray(own[field], float)[index] * factor + zero, rel=1e-6)
    assert np.unique(index).size == t.size >= 0.95 * stamps.size


def test_each_row_was_the_nearest(recording: Find) -> None:
    path = recording("flights/px4_vtol_small.ulg")
    log, own = read_log(path), topic(path, "vehicle_magnetometer")
    stamps = own["timestamp"] * 1e-6
    t, _ = placed(log, "mag_z")
    rows = np.unique(nearest(stamps, log.t))
    assert np.isin(t, log.t[rows]).all()


def test_increments_are_divided_by_their_intervals(recording: Find) -> None:
    """`vehicle_imu` and `sensor_combined` of PX4 are the same samples, as increments and as means."""
    path = recording("flights/px4_gps_interference.ulg")
    with_increments = read_log(path, topic="vehicle_imu", instance=0)
    means = read_log(path)
    row = nearest(with_increments.t, means.t)
    same = np.abs(means.t[row] - with_increments.t) < 1e-6
    assert same.sum() > 100
    for channel in ("gyro_x", "gyro_z", "accel_y", "accel_z"):
        assert with_increments.values(channel)[same] == pytest.approx(
            means.values(channel)[row[same]], rel=1e-5
        )
    assert any("mean over 5.05 ms" in w and "every 500 ms" in w for w in with_increments.warnings)


def test_an_instance_is_chosen(recording: Find) -> None:
    path = recording("flights/px4_vtol_small.ulg")
    own = topic(path, "vehicle_imu", 2)
    log = read_log(path, instance=2)
    assert log.values("gyro_x") == pytest.approx(
        own["delta_angle[0]"] / (own["delta_angle_dt"] * 1e-6), rel=1e-6
    )
    with pytest.raises(InputError, match=r"no inertial sensor of instance 7. It has 0, 1, 2"):
        read_log(path, instance=7)


def test_a_topic_is_chosen(recording: Find) -> None:
    path = recording("flights/px4_vtol_small.ulg")
    log, own = read_log(path, topic="sensor_gyro", instance=1), topic(path, "sensor_gyro", 1)
    assert np.array_equal(log.values("gyro_y"), own["y"].astype(float))
    assert log.samples == "at"
    _, z = placed(log, "accel_z")
    assert z == pytest.approx(np.asarray(topic(path, "sensor_accel", 1)["z"], float)[: z.size], rel=1e-6)


def test_positions_follow_the_receivers_velocity(recording: Find) -> None:
    """Metres north and east over 40 s of flight against the sum of the velocity, which the receiver measures by itself."""
    log = read_log(recording("flights/px4_motor_failure.ulg"))
    t, north = placed(log, "gnss_p_N")
    for axis, limit in (("N", 0.5), ("E", 0.5), ("D", 3.0)):
        _, p = placed(log, f"gnss_p_{axis}")
        _, v = placed(log, f"gnss_v_{axis}")
        along = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
        wrong = (p - p[0]) - along
        assert np.std(wrong) < limit * max(1.0, np.std(p) / 5)
    assert np.hypot(north[0], placed(log, "gnss_p_E")[1][0]) < 5.0


def test_the_barometer_agrees_with_gnss_heights(recording: Find) -> None:
    log = read_log(recording("flights/px4_motor_failure.ulg"))
    (tb, up), (tg, down) = placed(log, "baro_height"), placed(log, "gnss_p_D")
    assert np.corrcoef(np.interp(tg, tb, up), -down)[0, 1] > 0.9
    assert np.abs(np.interp(tg, tb, up) + down).max() < 8.0


def test_a_receiver_without_a_fix_gives_no_position(recording: Find) -> None:
    log = read_log(recording("flights/px4_gps_interference.ulg"))
    assert not any(name.startswith("gnss") for name in log.channels)
    assert any("no fix in any of 312 solutions" in w for w in log.warnings)


def test_a_cut_off_log_is_read_up_to_its_end(recording: Find, tmp_path: Path) -> None:
    path = recording("flights/px4_gps_interference.ulg")
    data, cut = path.read_bytes(), tmp_path / "cut.ulg"
    cut.write_bytes(data[: len(data) // 2 + 7])
    whole, part = read_log(path), read_log(cut)
    assert 0.4 * whole.n < part.n < 0.6 * whole.n
    assert np.array_equal(part.values("gyro_x"), whole.values("gyro_x")[: part.n])
    assert any("cut off" in w for w in part.warnings)
    assert not any("cut off" in w for w in whole.warnings)


@pytest.mark.parametrize("size", [7, 16, 100, 5000])
def test_a_log_without_samples_is_refused(recording: Find, tmp_path: Path, size: int) -> None:
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(recording("flights/px4_gps_interference.ulg").read_bytes()[:size])
    with pytest.raises(InputError, match=r"cut\.ulg: "):
        read_log(cut)


def test_a_damaged_log_is_read_or_refused_in_words(
    recording: Find, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = recording("flights/px4_vtol_small.ulg").read_bytes()
    rng, said = np.random.default_rng(1), list[str]()
    for k in range(8):
        broken = bytearray(data)
        for at in rng.integers(16, len(data), 60):
            broken[at] = int(rng.integers(256))
        path = tmp_path / f"{k}.ulg"
        path.write_bytes(bytes(broken))
        try:
            log = read_log(path)
        except InputError as error:
            said.append(str(error))
        else:
            assert (np.diff(log.t) > 0.0).all()
    assert all(str(tmp_path) in text for text in said)
    assert capsys.readouterr().out == ""


def test_what_is_no_ulog_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ulg"
    path.write_text("hello\n" * 100)
    with pytest.raises(InputError, match="no PX4 log"):
        read_log(path)


def test_a_ulog_is_known_by_any_name(recording: Find, tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    path.write_bytes(recording("flights/px4_vtol_small.ulg").read_bytes())
    assert read_log(path).n == 1298


def test_the_library_that_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyulog", None)
    path = tmp_path / "a.ulg"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8))
    with pytest.raises(MissingExtra, match=r'pip install "kfgen\[px4\]"'):
        read_log(path)


def test_a_reader_that_never_ends_is_ended(tmp_path: Path) -> None:
    """pyulog comes back to the same byte for ever where definitions end in the middle of an unknown message."""
    path = tmp_path / "a.ulg"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8) + b"\xff\x7fz" + bytes(range(256)) * 4)
    with pytest.raises(InputError, match=r"a\.ulg: "):
        read_log(path)


def test_clipped_samples_a_second_are_those_of_the_counters() -> None:
    """A second sensor has its own; counters that do not move are no channel, one that began anew says nothing there."""

    def status(instance: int, *counts: int) -> SimpleNamespace:
        fields = {f"accel_clipping[{k}]": np.array(counts) * (k == 2) for k in range(3)}
        stamps = {"timestamp": 1e6 * np.arange(1.0, 1.0 + len(counts))}
        return SimpleNamespace(name="vehicle_imu_status", multi_id=instance, data={**stamps, **fields})

    data = [status(0, 4, 4, 4), status(1, 0, 30, 2, 4)]
    assert _Topics(data, LogChoice(), "")._clipping() == []
    (stream,) = _Topics(data, LogChoice(instance=1), "")._clipping()
    assert stream.t == pytest.approx([1.5, 3.5])
    assert stream.columns["clipping"].values == pytest.approx([30.0, 2.0])
    assert stream.columns["clipping"].unit == "1/s"
