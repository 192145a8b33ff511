"""Proves that HDF5, MAT, Parquet and JSON lines are read as their libraries have them, in units that are stated or said.

Twins of recordings in NPZ are other people's conversions; everything else is written here by the formats' own libraries.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from placed import placed

from kfgen.core.errors import InputError, MissingExtra
from kfgen.log.readers import read_log
from kfgen.log.readers.arrays.mat_elements import check_elements
from kfgen.log.readers.tables.seconds import UNITS_S, stamp_unit

Find = Callable[[str], Path]
N = 400
RNG = np.random.default_rng(5)
GYR = RNG.normal(0.0, 0.1, (N, 3))
ACC = RNG.normal([0.0, 0.0, -9.8], 0.2, (N, 3))
T = np.arange(N) * 0.01


def h5(path: Path, arrays: dict[str, Any], attributes: dict[str, Any] | None = None) -> Path:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed (pip install 'kfgen[hdf5]')")
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
        file.attrs.update(attributes or {})
    return path


def written(kind: str, folder: Path, arrays: dict[str, np.ndarray]) -> Path:
    """Columns of one length in a format, by its own library."""
    path = folder / f"a.{kind}"
    if kind == "h5":
        return h5(path, arrays)
    if kind == "mat":
        from scipy.io import savemat

        savemat(path, arrays)
    elif kind == "parquet":
        pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed (pip install 'kfgen[parquet]')")
        pq = pytest.importorskip("pyarrow.parquet")
        pq.write_table(pa.table({k: pa.array(v) for k, v in arrays.items()}), path)
    else:
        rows = [{k: float(v[i]) for k, v in arrays.items()} for i in range(len(next(iter(arrays.values()))))]
        path.write_text("\n".join(map(json.dumps, rows)) + "\n")
    return path


KINDS = ("h5", "mat", "parquet", "jsonl")
COLUMNS = {
    "time": T,
    **{f"g{a}": GYR[:, k] for k, a in enumerate("xyz")},
    **{f"a{a}": ACC[:, k] for k, a in enumerate("xyz")},
}


@pytest.mark.parametrize("kind", KINDS)
def test_columns_by_their_usual_names(tmp_path: Path, kind: str) -> None:
    log = read_log(written(kind, tmp_path, COLUMNS))
    assert log.t == pytest.approx(T)
    for k, axis in enumerate("xyz"):
        assert log.values(f"gyro_{axis}") == pytest.approx(GYR[:, k])
        assert log.values(f"accel_{axis}") == pytest.approx(ACC[:, k])
    assert any("gyro: no unit is stated, rad/s is assumed" in w for w in log.warnings)


def test_a_gyro_that_reads_thousands_is_in_degrees(tmp_path: Path) -> None:
    """Of a foot, too short to tell by gravity; no gyro measures 1,500 rad/s."""
    fast = {f"g{a}": 1500.0 * np.sin(0.7 * T + k) for k, a in enumerate("xyz")}
    log = read_log(written("jsonl", tmp_path, COLUMNS | fast))
    assert log.values("gyro_x") == pytest.approx(np.deg2rad(fast["gx"]))
    assert any("gyro: no unit is stated, deg/s is assumed" in w for w in log.warnings)


def test_a_reference_and_columns_without_a_channel(tmp_path: Path) -> None:
    """The attitude is read as `ref_qw`, too; what is not read is said."""
    more = {f"ref_q{a}": np.full(N, float(a == "w")) for a in "wxyz"} | {"battery_state": np.ones(N)}
    log = read_log(written("jsonl", tmp_path, COLUMNS | more))
    assert log.values("ref_q_w") == pytest.approx(np.ones(N))
    assert "battery_state: the names say no channel; map what is wanted with --columns" in log.warnings


@pytest.mark.parametrize("kind", KINDS)
def test_units_that_cannot_be_known_are_asked_for(tmp_path: Path, kind: str) -> None:
    """In units of gravity the accelerometer is known by its size; the gyro may be in degrees."""
    path = written(kind, tmp_path, {**COLUMNS, **{f"a{a}": ACC[:, k] / 9.80665 for k, a in enumerate("xyz")}})
    with pytest.raises(InputError, match=r"'gyro_x' has no unit.*--columns"):
        read_log(path)
    log = read_log(path, columns="gyro_x=gx [deg/s], accel_z=az [g]")
    assert log.values("gyro_x") == pytest.approx(np.deg2rad(GYR[:, 0]))
    assert log.values("accel_z") == pytest.approx(ACC[:, 2])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.1, 0.6, 0.95])
def test_a_cut_off_file_is_refused_in_words(tmp_path: Path, kind: str, share: float) -> None:
    path = written(kind, tmp_path, COLUMNS)
    cut = tmp_path / f"cut.{kind}"
    cut.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    if kind == "jsonl":
        assert read_log(cut).n == pytest.approx(share * N, abs=0.05 * N)
        return
    with pytest.raises(InputError, match=rf"cut\.{kind}: .+\. .+"):
        read_log(cut)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_such_file_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    path.write_text("hello\n" * 200)
    with pytest.raises(InputError):
        read_log(path)


def test_hdf5_is_the_numbers_of_its_npz_twin(recording: Find) -> None:
    pytest.importorskip("h5py")
    log = read_log(recording("native/broad_33.hdf5"))
    twin = read_log(recording("dynamic/broad_33_disturbed_attached_magnet_2cm.npz"))
    np.testing.assert_allclose(log.t, twin.t, rtol=1e-6)
    for name in [f"{s}_{a}" for s in ("gyro", "accel", "mag") for a in "xyz"] + ["movement"]:
        np.testing.assert_allclose(log.values(name), twin.values(name), rtol=1e-6, atol=1e-9)
    for a in "wxyz":
        own, theirs = log.channels[f"ref_q_{a}"].values, twin.channels[f"ref_q_{a}"].values
        assert np.array_equal(np.isfinite(own), np.isfinite(theirs))
        same = np.nan_to_num(own) - np.nan_to_num(theirs), np.nan_to_num(own) + np.nan_to_num(theirs)
        assert np.minimum(*np.abs(same)).max() < 1e-6


def test_mat_is_the_numbers_of_its_npz_twin(recording: Find) -> None:
    log = read_log(recording("native/inertialnav_swisslog1.mat"))
    twin = np.load(recording("dynamic/inertialnav_swisslog1.npz"))
    assert log.t == pytest.approx(twin["t_imu"], abs=1e-9)
    for k, axis in enumerate("xyz"):
        assert log.values(f"gyro_{axis}") == pytest.approx(twin["gyr"][:, k], abs=1e-6)
        assert log.values(f"accel_{axis}") == pytest.approx(twin["acc"][:, k], abs=1e-5)
        assert log.values(f"mag_{axis}") == pytest.approx(twin["mag"][:, k] * 1e-4, abs=1e-9)
    t, down = placed(log, "gnss_p_D")
    assert down == pytest.approx(twin["hgt"][0] - np.interp(t, twin["t_gps"], twin["hgt"]), abs=0.02)
    _, north = placed(log, "gnss_v_N")
    expected = twin["gndspd"] * np.cos(twin["course"])  # the manifest: course in rad, whatever its name says
    assert np.abs(north - np.interp(t, twin["t_gps"], expected)).max() < 0.5
    assert placed(log, "baro_height")[1][0] == 0.0


def test_structs_of_mat_are_looked_into(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    savemat(path, {"log": {"imu": {"gyro": GYR, "acc": ACC, "t": T[:, None]}, "fs": 100.0, "name": "x"}})
    log = read_log(path)
    assert log.values("gyro_z") == pytest.approx(GYR[:, 2])
    assert log.t == pytest.approx(T)


def test_mat_of_v73_is_hdf5_with_rows_and_columns_exchanged(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["gyro"], file["acc"], file["fs"] = GYR.T, ACC.T, np.array([[100.0]])
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    log = read_log(path)
    assert log.values("accel_z") == pytest.approx(ACC[:, 2])
    assert log.dt == pytest.approx(0.01)


def test_units_and_rates_of_attributes(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["imu/gyr"] = GYR
        file["imu/gyr"].attrs["unit"] = "deg/s"
        file.attrs["sampling_rate"] = 50.0
    log = read_log(path)
    assert log.values("gyro_x") == pytest.approx(np.deg2rad(GYR[:, 0]))
    assert log.dt == pytest.approx(0.02)


def test_data_outside_of_an_hdf5_file_are_not_read(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret.bin").write_bytes(np.ones(N).tobytes())
    path = h5(tmp_path / "a.h5", {"gyr": GYR, "acc": ACC}, {"fs": 100.0})
    with h5py.File(path, "a") as file:
        file["temperature"] = h5py.ExternalLink("b.h5", "x")
        file.create_dataset("voltage", (N,), "f8", external=[(str(tmp_path / "secret.bin"), 0, N * 8)])
    log = read_log(path)
    assert "voltage" not in log.channels
    assert "gyro_x" in log.channels


def test_a_topic_of_px4_in_parquet(tmp_path: Path) -> None:
    """Flight Review's names: fields with an index, stamps in microseconds since boot."""
    arrays = {"timestamp": (600e6 + T * 1e6).astype(np.int64)}
    arrays |= {f"gyro_rad[{k}]": GYR[:, k] for k in range(3)} | {
        f"accelerometer_m_s2[{k}]": ACC[:, k] for k in range(3)
    }
    log = read_log(written("parquet", tmp_path, arrays))
    assert log.t == pytest.approx(600.0 + T)
    assert log.values("gyro_y") == pytest.approx(GYR[:, 1])
    assert log.channels["gyro_y"].unit == "rad/s"


def test_dates_of_parquet_are_times(tmp_path: Path) -> None:
    arrays = {"time": (np.datetime64("2026-01-02T03:04:05", "ns") + (T * 1e9).astype("timedelta64[ns]"))}
    arrays |= {"accel_x": ACC[:, 0], "accel_y": ACC[:, 1], "accel_z": ACC[:, 2]}
    log = read_log(written("parquet", tmp_path, arrays))
    assert log.t == pytest.approx(1767323045.0 + T, abs=1e-6)


def test_json_lines_with_lists_objects_and_gaps(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    lines = [
        {"t": float(T[k]), "gyro": GYR[k].tolist(), "acc": dict(zip("xyz", ACC[k].tolist(), strict=True))}
        for k in range(N)
    ]
    mag = [{"t": float(T[k]), "mag": [20.0, 0.0, 45.0], "kind": "mag"} for k in range(0, N, 10)]
    path.write_text("\n".join(map(json.dumps, [*lines, *mag])) + '\n{"t": 9.0, "gy')
    log = read_log(path)
    assert log.n == N
    assert log.values("gyro_y") == pytest.approx(GYR[:, 1])
    assert placed(log, "mag_x")[0] == pytest.approx(T[::10])


def test_a_line_that_is_no_object_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text('{"t": 0, "gx": 1}\n[1, 2]\n{"t": 1, "gx": 1}\n')
    with pytest.raises(InputError, match=r"a\.jsonl: line 2: it is no object"):
        read_log(path)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
@pytest.mark.parametrize("rate", [10.0, 100.0, 1000.0])
def test_the_unit_of_stamps_is_found(unit: str, start: float, rate: float) -> None:
    t = (start + np.arange(200) / rate) / UNITS_S[unit]
    if not (start == 0.0 and rate == 1000.0 and unit == "ms"):  # steps of one may be seconds
        assert stamp_unit("t", t) == unit
    assert stamp_unit(f"time_{unit}", t) == unit


@pytest.mark.parametrize(
    ("stated", "seconds"), [("microseconds", 1e-6), ("msec", 1e-3), ("Seconds since 1970", 1e-6)]
)
def test_the_unit_of_stamps_may_be_spelled_out(tmp_path: Path, stated: str, seconds: float) -> None:
    """As in the files of a maker of body-worn sensors, with an attribute of each array; what is no unit is found from the values."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["Time"] = np.round((1.62e9 + T) / seconds).astype(np.uint64)
        file["Time"].attrs["Units"] = stated
        file["Accelerometer"] = ACC
        file["Accelerometer"].attrs["Units"] = "m/s^2"
        file["Temperature"] = 25.0 + 0.0 * T
        file["Temperature"].attrs["Units"] = "deg C"
    log = read_log(tmp_path / "a.h5")
    assert log.dt == pytest.approx(0.01, rel=1e-6)
    assert log.channels["temperature"].values == pytest.approx(298.15)


def test_of_several_sensors_in_one_file_the_first_is_read_and_the_others_are_named(tmp_path: Path) -> None:
    sensors = {f"Sensors/{s}/Gyroscope": GYR + k for k, s in enumerate(("AA", "BB", "CC"))}
    log = read_log(h5(tmp_path / "a.h5", {"Time": T, "Sensors/AA/Accelerometer": ACC, **sensors}))
    assert log.channels["gyro_x"].values == pytest.approx(GYR[:, 0])
    (said,) = [w for w in log.warnings if "channels of the same names" in w]
    assert said.startswith("Sensors/AA is read, and not Sensors/BB, Sensors/CC,")
    other = read_log(tmp_path / "a.h5", columns="gyro_x=Sensors/BB/Gyroscope_x [rad/s]")
    assert other.channels["gyro_x"].values == pytest.approx(GYR[:, 0] + 1.0)


@pytest.mark.parametrize(("kind", "library"), [("h5", "h5py"), ("parquet", "pyarrow")])
def test_the_library_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, library: str
) -> None:
    monkeypatch.setitem(__import__("sys").modules, library, None)
    path = tmp_path / f"a.{kind}"
    path.write_bytes({"h5": b"\x89HDF\r\n\x1a\n", "parquet": b"PAR1"}[kind])
    with pytest.raises(MissingExtra, match=r"pip install"):
        read_log(path)


TAGS = {
    "a type that does not exist": (128, b"\xff\x7f\x00\x00"),
    "more bytes than there are": (132, b"\xff\xff\xff\x7f"),
    "no flags": (136, b"\x09\x00\x00\x00"),
    "a type that does not exist, inside": (136 + 16 + 16, b"\x1e\x00\x00\x00"),
    "no order of bytes": (126, b"XX"),
}


@pytest.mark.parametrize("case", TAGS)
@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_mat_file_does_not_end_the_process(case: str, compressed: bool, tmp_path: Path) -> None:
    """scipy's compiled reader ends the interpreter by SIGSEGV on some of these."""
    scipy_io = pytest.importorskip("scipy.io")
    path = tmp_path / "log.mat"
    scipy_io.savemat(path, {"t": np.arange(40) * 0.01, "gyr": np.ones((40, 3))}, do_compression=False)
    data = bytearray(path.read_bytes())
    at, new = TAGS[case]
    data[at : at + len(new)] = new
    if compressed:
        packed = zlib.compress(bytes(data[128:]))
        data[128:] = struct.pack("<II", 15, len(packed)) + packed
    path.write_bytes(data)
    with pytest.raises(InputError, match="no MAT file that can be read"):
        read_log(path)


def test_objects_of_matlab_beside_the_samples_are_passed_over(tmp_path: Path) -> None:
    """An opaque element has names and no sizes: its tags are in order."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack("<II", 17, 0))
    check_elements(
        bytes(124) + b"\x00\x01IM" + element(14, flags + element(1, b"when") + element(1, b"MCOS"))
    )


def test_of_several_recordings_in_one_file_the_longest_is_read(tmp_path: Path) -> None:
    path, size = tmp_path / "trials.h5", {"short": 200, "long": 300}
    arrays = {}
    for k, (name, n) in enumerate(size.items()):
        arrays[f"{name}/time"] = 100.0 * k + np.arange(n) / 100.0
        arrays[f"{name}/acc"] = np.column_stack([np.full(n, 0.1 * k), np.zeros(n), np.ones(n)])
    log = read_log(h5(path, arrays))
    assert log.n == size["long"]
    assert log.values("accel_x")[0] == pytest.approx(0.980665)
    assert any("of arrays of 200 samples are left out" in w for w in log.warnings)


@pytest.mark.parametrize(
    ("size", "pascals"), [(1008.0, 100_800.0), (100_800.0, 100_800.0), (100.8, 100_800.0)]
)
def test_the_pressure_of_air_is_known_by_its_size(tmp_path: Path, size: float, pascals: float) -> None:
    log = read_log(written("mat", tmp_path, COLUMNS | {"Barometer": np.full(N, size)}))
    assert log.values("pressure")[0] == pytest.approx(pascals)
