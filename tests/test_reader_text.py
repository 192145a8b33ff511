"""Proves that text is read as people have it, that what was done is said, and that what cannot be known is asked for.

The commands that messages print are tried as printed.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from placed import placed

from kfgen.core.errors import InputError
from kfgen.log.log import Log
from kfgen.log.readers import read_log
from kfgen.log.readers.arrays.turning_gravity import gyro_unit

Find = Callable[[str], Path]
T = np.arange(50) * 0.01
ACC = np.random.default_rng(4).normal([0.0, 0.1, -9.8], 0.05, (50, 3))
GYR = np.random.default_rng(5).normal(0.0, 0.1, (50, 3))


def text(folder: Path, content: str | bytes, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def table(
    separator: str = ",", header: str = "t [s],x [m],y [K]", number: Callable[[float], str] = str
) -> str:
    rows = [separator.join(map(number, (T[k], float(k), 0.5 * k))) for k in range(50)]
    return "\n".join([header.replace(",", separator), *rows]) + "\n"


def right(log: Log) -> None:
    assert log.t == pytest.approx(T)
    assert log.values("x") == pytest.approx(np.arange(50.0))
    assert log.values("y") == pytest.approx(0.5 * np.arange(50.0))


def comma(x: float) -> str:
    return str(x).replace(".", ",")


def typed(error: InputError) -> str:
    """What a message says to write after --columns."""
    found = re.search(r"--columns '([^']*)'", error.remedy)
    assert found is not None
    return found.group(1)


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_decimal_commas(tmp_path: Path, separator: str) -> None:
    header = "t [s],x [m],y [K]" if separator != " " else "t[s],x[m],y[K]"
    log = read_log(text(tmp_path, table(separator, header, comma)))
    right(log)
    assert any("decimal commas" in w for w in log.warnings)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    content = table().replace("y [K]", "y [°C]")
    log = read_log(text(tmp_path, content.encode(encoding)))
    assert log.values("y") == pytest.approx(273.15 + 0.5 * np.arange(50.0))


@pytest.mark.parametrize("ends", ["", "Z", "+02:00"])
@pytest.mark.parametrize("between", ["T", " "])
def test_dates_are_seconds(tmp_path: Path, ends: str, between: str) -> None:
    rows = [f"2026-03-01{between}00:00:{t:09.6f}{ends},{k}" for k, t in enumerate(T)]
    log = read_log(text(tmp_path, "\n".join(["time,x [m]", *rows]) + "\n"))
    start = 1772323200.0 - (7200.0 if ends == "+02:00" else 0.0)
    assert log.t == pytest.approx(start + T, abs=1e-6)
    assert any("without a time zone" in w for w in log.warnings) == (ends == "")


@pytest.mark.parametrize(("unit", "factor"), [("ns", 1e9), ("us", 1e6), ("ms", 1e3)])
@pytest.mark.parametrize("named", [True, False])
def test_clocks_in_parts_of_a_second(tmp_path: Path, unit: str, factor: float, named: bool) -> None:
    name = f"time [{unit}]" if named else "timestamp"
    rows = [f"{round((1.7e9 + t) * factor)},{k}" for k, t in enumerate(T)]
    log = read_log(text(tmp_path, "\n".join([f"{name},x [m]", *rows]) + "\n"))
    assert log.t == pytest.approx(1.7e9 + T, abs=1e-6)


def test_words_that_nobody_asked_for(tmp_path: Path) -> None:
    lines = table().splitlines()
    content = "\n".join([lines[0] + ",mode", *(f"{line},hover" for line in lines[1:])]) + "\n"
    log = read_log(text(tmp_path, content))
    right(log)
    assert list(log.channels) == ["x", "y"]
    assert any("columns of words were left out: 'mode'" in w for w in log.warnings)


def test_columns_keep_their_numbers_beside_words(tmp_path: Path) -> None:
    rows = [f"hover,{t},{k}" for k, t in enumerate(T)]
    log = read_log(text(tmp_path, "\n".join(rows) + "\n"), columns="t=#2 [s], x=#3 [m]")
    assert log.values("x") == pytest.approx(np.arange(50.0))


@pytest.mark.parametrize("cell", ["N/A", "NA", "null", "-", "NaN", "none"])
def test_cells_of_missing_samples(tmp_path: Path, cell: str) -> None:
    log = read_log(
        text(tmp_path, table().replace("7.0,3.5", f"7.0,{cell}").replace("9.0,4.5", f"{cell},4.5"))
    )
    assert placed(log, "y")[1].size == placed(log, "x")[1].size == 49
    assert np.isnan(log.channels["y"].values[7])


def test_cells_with_keys(tmp_path: Path) -> None:
    rows = [f"t:{t:.2f} gx:{k} gy:{k + 1} gz:0 ax:0 ay:0 az:-9.8" for k, t in enumerate(T)]
    log = read_log(text(tmp_path, "\n".join(rows) + "\n", "serial.txt"))
    assert log.values("gyro_y") == pytest.approx(np.arange(1.0, 51.0))
    assert log.t == pytest.approx(T)


def test_a_boot_line_before_the_header(tmp_path: Path) -> None:
    right(read_log(text(tmp_path, "MPU init OK, 3 sensors\nready\n" + table())))
    right(read_log(text(tmp_path, "MPU init OK, 3 sensors\nready\n" + table(";", number=comma))))


def test_a_last_line_that_is_cut_off(tmp_path: Path) -> None:
    log = read_log(text(tmp_path, table() + "0.5,3"))
    right(log)
    assert any("last line is cut off" in w for w in log.warnings)


@pytest.mark.parametrize(
    ("wrong", "place"), [("7.x,3.5", "line 9, column 2 (x)"), ("7.0", "line 9"), ("7.0,3.5,1,2", "line 9")]
)
def test_a_wrong_cell_is_still_named(tmp_path: Path, wrong: str, place: str) -> None:
    with pytest.raises(InputError) as caught:
        read_log(text(tmp_path, table().replace("7.0,3.5", wrong)))
    assert place in caught.value.where


@pytest.mark.parametrize(("scale", "units"), [(1.0, "m/s^2"), (9.80665, "g"), (9.80665 / 16384, "g/16384")])
def test_without_a_header_the_printed_line_is_right(tmp_path: Path, scale: float, units: str) -> None:
    rows = np.column_stack([T, ACC / scale, GYR, np.zeros(50)])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",")
    with pytest.raises(InputError, match="its columns have no names") as caught:
        read_log(path)
    assert f"[{units}]" in typed(caught.value)
    assert f"{rows[0, 1]:.13g}" in caught.value.remedy
    log = read_log(path, columns=typed(caught.value))
    assert list(log.channels) == [f"{s}_{a}" for s in ("accel", "gyro") for a in "xyz"]
    assert log.values("accel_z") == pytest.approx(ACC[:, 2])


def test_without_a_time_a_rate_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    np.savetxt(path, ACC, delimiter=",")
    with pytest.raises(InputError, match="--rate HZ") as caught:
        read_log(path)
    assert read_log(path, rate=100.0, columns=typed(caught.value)).values("accel_y") == pytest.approx(
        ACC[:, 1]
    )


def test_usual_names_without_units(tmp_path: Path) -> None:
    rows = np.column_stack([T * 1e6, ACC, GYR])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header="timestamp,ax,ay,az,gx,gy,gz", comments="")
    log = read_log(path)
    assert log.t == pytest.approx(T)
    assert log.values("gyro_x") == pytest.approx(GYR[:, 0])
    assert any("rad/s is assumed" in w for w in log.warnings)


def test_a_recording_of_a_known_logger_is_that_of_its_twin(recording: Find) -> None:
    log = read_log(recording("native/mpu6050_static.csv"))
    twin = np.load(recording("static/mpu6050_static_450s.npz"))
    for k, axis in enumerate("xyz"):
        assert log.values(f"gyro_{axis}") == pytest.approx(np.deg2rad(twin["gyr_counts"][:, k] / 131.0))
        assert log.values(f"accel_{axis}") == pytest.approx(twin["acc_counts"][:, k] * 9.80665 / 16384.0)
    assert np.allclose(np.diff(log.t), 1.0 / float(twin["fs"]))
    assert any("MPU-6050" in w and "--columns" in w for w in log.warnings)


def test_another_range_of_a_known_logger_may_be_said(recording: Find) -> None:
    """As the message types it, for one column."""
    path = recording("native/mpu6050_static.csv")
    one = read_log(path, columns="gyro_x=gx [deg/s/65.5]").values("gyro_x")
    assert one == pytest.approx(2.0 * read_log(path).values("gyro_x"))


@pytest.mark.parametrize("wrong", ["range", "header", "fraction"])
def test_counts_of_an_unknown_logger_are_asked_for(tmp_path: Path, wrong: str) -> None:
    """Another range by gravity, another header, or numbers that are no counts."""
    one_g = 8192 if wrong == "range" else 16384
    rows = np.round(np.random.default_rng(1).normal([0, 0, one_g, 0, 0, 0], 20.0, (80, 6)))
    rows += 0.5 * (wrong == "fraction")
    lines = ["Fs,100", "" if wrong == "header" else "Logging Type,1", "ax,ay,az,gx,gy,gz"]
    lines += [",".join(f"{v:g}" for v in row) for row in rows]
    with pytest.raises(InputError, match="no unit") as caught:
        read_log(text(tmp_path, "\n".join(lines) + "\n"))
    assert f"[g/{one_g}]" in typed(caught.value)


def test_a_recording_without_a_header_is_known_by_gravity(recording: Find) -> None:
    """Its author's program converts the gyro to rad/s before it writes the file, and leaves specific force in g."""
    path = recording("flights/rtk_walk_imu.csv")
    log, own = read_log(path), np.loadtxt(path, delimiter=",")
    assert log.t == pytest.approx(own[:, 0], abs=1e-6)
    assert list(log.channels) == [f"{s}_{a}" for s in ("accel", "gyro") for a in "xyz"]
    for k, axis in enumerate("xyz"):
        assert log.values(f"accel_{axis}") == pytest.approx(own[:, 1 + k] * 9.80665)
        assert log.values(f"gyro_{axis}") == pytest.approx(own[:, 4 + k])
    assert any("by gravity" in w and "gyro_z=#7 [rad/s]" in w for w in log.warnings)


# The unit of a gyro.


def turning(rate_hz: float = 50.0, seconds: float = 100.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, specific force [g] and angular rate [rad/s] of a body that swings about two axes, shaken by 0.1 g."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    roll, pitch = 0.4 * np.sin(0.9 * t), 0.3 * np.sin(0.5 * t + 1.0)
    rolling, pitching = 0.36 * np.cos(0.9 * t), 0.15 * np.cos(0.5 * t + 1.0)
    down = np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    w = np.column_stack([rolling, pitching * np.cos(roll), -pitching * np.sin(roll)])
    return t, -down + np.random.default_rng(3).normal(0.0, 0.1, down.shape), w


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "rad/s"), (180.0 / np.pi, "deg/s")])
def test_gravity_turns_as_the_gyro_says(tmp_path: Path, scale: float, unit: str) -> None:
    t, accel, w = turning()
    assert gyro_unit(t, accel, w * scale) == unit
    path = tmp_path / "log.csv"
    header = "time,ax,ay,az,gx,gy,gz"
    np.savetxt(path, np.column_stack([t, accel, w * scale]), delimiter=",", header=header, comments="")
    log = read_log(path)
    assert log.channels["gyro_x"].unit == unit
    assert log.values("gyro_x") == pytest.approx(w[:, 0])


def test_gravity_says_nothing_of_a_body_at_rest() -> None:
    """White noise passes a correlation of 0.35 over two free directions of 99 intervals once in 10^6."""
    t, _, _ = turning()
    rng = np.random.default_rng(8)
    for _ in range(200):
        accel = rng.normal([0.0, 0.0, 1.0], 0.01, (t.size, 3))
        assert gyro_unit(t, accel, rng.normal(0.0, 0.01, (t.size, 3))) == ""
    assert gyro_unit(t[:100], *(x[:100] for x in turning()[1:])) == ""


@pytest.mark.parametrize("size", [0.0, 1e-322, 1e308, np.inf, np.nan])
def test_numbers_of_a_damaged_file_have_no_unit(size: float) -> None:
    t, accel, w = turning()
    with np.errstate(all="ignore"):
        times, forces, rates = t * size, accel * size, w * size
    assert gyro_unit(times, accel, w) == gyro_unit(t, forces, w) == gyro_unit(t, accel, rates) == ""


# Replays of PX4-ECL.


def test_a_replay_of_ecl_is_that_of_its_lines(recording: Find) -> None:
    path = recording("flights/ecl_iris_gps_replay.csv")
    log = read_log(path)
    cells = [line.split(",") for line in path.read_text().splitlines()]
    imu = np.array([[float(c) for c in (own[0], *own[2:])] for own in cells if own[1] == "imu"])
    assert log.t == pytest.approx(imu[:, 0] * 1e-6)
    assert log.values("accel_z") == pytest.approx(imu[:, 3])
    assert log.values("gyro_x") == pytest.approx(imu[:, 4])
    t, x = placed(log, "mag_x")
    mag = np.array([[float(own[0]), float(own[2])] for own in cells if own[1] == "mag"])
    assert x == pytest.approx(np.interp(t, mag[:, 0] * 1e-6, mag[:, 1]) * 1e-4, abs=4e-7)
    (_, east), (tg, v) = placed(log, "gnss_p_E"), placed(log, "gnss_v_E")
    along = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(tg))])
    assert np.std(east - east[0] - along) < 0.5 * np.std(east)


def test_a_wrong_line_of_a_replay_is_named(tmp_path: Path) -> None:
    lines = [f"{k * 4000},imu,0,0,-9.8,0,0,0" for k in range(300)]
    path = text(tmp_path, "\n".join([*lines[:250], "oops", *lines[250:]]) + "\n")
    with pytest.raises(InputError, match="line 251: it is no sample"):
        read_log(path)
    cut = text(tmp_path, "\n".join(lines) + "\n1200000,im", "cut.csv")
    assert read_log(cut).n == 300


def test_a_row_that_is_commented_out_is_no_header(tmp_path: Path) -> None:
    """It ended in a traceback: a line of numbers between header and rows, none of them a word."""
    path = tmp_path / "log.csv"
    path.write_text("t [s],gyro_x [deg/s]\n#0.00,1\n0.01,2\n0.02,3\n", encoding="utf-8")
    assert read_log(path).values("gyro_x") == pytest.approx(np.radians([2.0, 3.0]))


def test_quotation_marks_about_cells_that_blanks_separate(tmp_path: Path) -> None:
    """The triple one is what a spreadsheet makes of a quoted cell; it is no part of the number."""
    text = 't[s] gyro_x[rad/s]\n"""0.01 "1"\n0.02 2"""\n0.03 3\n'
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    log = read_log(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.t, [0.01, 0.02, 0.03])
    np.testing.assert_array_equal(log.values("gyro_x"), [1.0, 2.0, 3.0])


def test_a_rate_in_a_comment_and_rows_that_end_in_a_separator(tmp_path: Path) -> None:
    """As the software of Xsens exports: four lines of comment, no time, a tab after every row but none after the header."""
    names = "Counter\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z"
    rows = ["\t".join(f"{v:.6f}" for v in (k, *ACC[k], *GYR[k])) + "\t" for k in range(50)]
    head = ["// Start Time: 0", "// Sample rate: 50.0Hz", "// Scenario: 4.9", "// Firmware Version: 2.5.1"]
    path = text(tmp_path, "\n".join([*head, names, *rows]) + "\n", "xsens.txt")
    log = read_log(path, columns="accel_x=Acc_X [m/s^2], gyro_z=Gyr_Z [rad/s]")
    assert log.dt == pytest.approx(0.02)
    assert log.channel("gyro_z").values == pytest.approx(GYR[:, 2], abs=1e-6)


@pytest.mark.parametrize(("line", "hertz"), [("# Sampling frequency = 2 kHz", 2000.0), ("Fs,100", 100.0)])
def test_rates_of_headers(tmp_path: Path, line: str, hertz: float) -> None:
    rows = [f"{x:.6f},{y:.6f}" for x, y in ACC[:, :2]]
    path = text(tmp_path, "\n".join([line, "accel_x [m/s^2],accel_y [m/s^2]", *rows]) + "\n")
    assert read_log(path).dt == pytest.approx(1.0 / hertz)


def test_units_in_parentheses_behind_names(tmp_path: Path) -> None:
    """As the software of x-io exports: packet numbers and no time, so that the rate is asked for, and nothing else."""
    rows = [f"{3 * k},{g:.6f},{a:.6f},{0.3:.6f}" for k, g, a in zip(range(50), GYR[:, 0], ACC[:, 0])]
    head = "Packet number,Gyroscope X (deg/s),Accelerometer X (g),Magnetometer X (G)"
    path = text(tmp_path, "\n".join([head, *rows]) + "\n")
    with pytest.raises(InputError, match="--rate"):
        read_log(path)
    log = read_log(path, rate=256.0)
    assert list(log.channels) == ["gyro_x", "accel_x", "mag_x"]
    assert log.channel("gyro_x").values == pytest.approx(np.deg2rad(GYR[:, 0]), abs=1e-6)
    assert log.channel("mag_x").values == pytest.approx(np.full(50, 0.3e-4))
    timed = text(
        tmp_path, "\n".join([f"Time (s),{head}", *(f"{0.01 * k:.2f},{r}" for k, r in enumerate(rows))]) + "\n"
    )
    log = read_log(timed)
    assert log.dt == pytest.approx(0.01)
    assert any("'Packet number'" in w for w in log.warnings)


@pytest.mark.parametrize("head", ["time,ch0", "time,ch0 [g]"])
def test_a_column_of_time_is_mapped_by_its_own_name(tmp_path: Path, head: str) -> None:
    """It was read as t, and said to be missing where it was mapped."""
    path = tmp_path / "a.csv"
    path.write_text(head + "\n" + "".join(f"{0.01 * k:.2f},{k % 7}\n" for k in range(50)))
    log = read_log(path, columns="t=time [s], accel_x=ch0 [m/s^2]")
    assert log.t == pytest.approx(0.01 * np.arange(50))
    assert log.values("accel_x")[:3] == pytest.approx([0.0, 1.0, 2.0])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("ended", [True, False])
def test_units_in_a_row_of_their_own(tmp_path: Path, separator: str, ended: bool) -> None:
    """What spreadsheets and loggers write: ``sep=``, names, units, and a separator at the end of all rows but the last."""
    rows = [
        ["time", "x", "note"],
        ["ms", "mm", "no_units"],
        *([f"{1e3 * t:.9g}", f"{k}.5", "0"] for k, t in enumerate(T)),
    ]
    end = separator if ended else ""
    content = f'"sep={separator}"\r\n' + "".join(separator.join(r) + end + "\r\n" for r in rows[:-1])
    log = read_log(text(tmp_path, content + separator.join(rows[-1]) + "\r\n"))
    assert log.t == pytest.approx(T)
    assert log.values("x") == pytest.approx((np.arange(T.size) + 0.5) * 1e-3)
    assert list(log.channels) == ["x", "note"]


def test_names_that_are_units_too_are_names(tmp_path: Path) -> None:
    """Below a line of as many words: a row of units has nothing but units."""
    content = "log,of,board\ntime,g,force\n" + "".join(f"{t},{k},1\n" for k, t in enumerate(T))
    log = read_log(text(tmp_path, content), columns="t=time [s], a=g [1], b=force [N]")
    assert list(log.channels) == ["a", "b"]


def test_columns_of_consensys(tmp_path: Path) -> None:
    sensors = ["Accel_LN_X", "Accel_LN_Y", "Accel_LN_Z", "Accel_WR_X", "Gyro_Y", "Mag_Z"]
    names = ["S1_Timestamp_Unix_CAL", *(f"S1_{s}_CAL" for s in sensors)]
    units = ["ms", *["m/(s^2)"] * 4, "deg/s", "local_flux"]
    rows = [f"{1e3 * (1.6e9 + t):.3f},1,2,3,4,90,0.5" for t in T]
    log = read_log(text(tmp_path, "\n".join(["sep=,", ",".join(names), ",".join(units), *rows]) + "\n"))
    assert log.t == pytest.approx(1.6e9 + T, abs=1e-6)
    assert list(log.channels) == ["accel_x", "accel_y", "accel_z", "gyro_y", "mag_z"]
    assert log.values("accel_x")[0] == pytest.approx(1.0)
    assert log.values("gyro_y")[0] == pytest.approx(np.pi / 2.0)
    assert any("'S1_Accel_WR_X_CAL'" in w for w in log.warnings)


@pytest.mark.parametrize("words", [True, False])
def test_what_rostopic_echoes(tmp_path: Path, words: bool) -> None:
    """``rostopic echo -p``: a header behind a sign of percent, times in ns, a column of words for the frame."""
    axes = [f"field.{s}.{a}" for s in ("angular_velocity", "linear_acceleration") for a in "xyz"]
    names = ["%time", "field.header.stamp", *(["field.header.frame_id"] if words else []), *axes]
    rows = [
        ",".join(
            [
                f"{int(1e9 * (1.6e9 + t)) + 700_000}",
                f"{int(1e9 * (1.6e9 + t))}",
                *(["imu"] if words else []),
                "1,2,3,0.1,0,9.8",
            ]
        )
        for t in T
    ]
    log = read_log(text(tmp_path, "\n".join([",".join(names), *rows]) + "\n"))
    assert log.t == pytest.approx(1.6e9 + T, abs=1e-6)  # of the header, not of the receipt 0.7 ms later
    assert [log.values(f"gyro_{a}")[0] for a in "xyz"] == [1.0, 2.0, 3.0]
    assert log.values("accel_z")[0] == pytest.approx(9.8)


def test_one_file_of_the_inertial_sensor_of_euroc(tmp_path: Path) -> None:
    names = [*(f"w_RS_S_{a} [rad s^-1]" for a in "xyz"), *(f"a_RS_S_{a} [m s^-2]" for a in "xyz")]
    rows = [f"{int(1e9 * (1.4e9 + t))},1,2,3,0.1,0,9.8" for t in T]
    log = read_log(text(tmp_path, "\n".join([",".join(["#timestamp [ns]", *names]), *rows]) + "\n"))
    assert log.t == pytest.approx(1.4e9 + T, abs=1e-6)
    assert log.values("gyro_z")[0] == pytest.approx(3.0)
    assert log.values("accel_z")[0] == pytest.approx(9.8)
