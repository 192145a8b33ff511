"""Proves that logs are read as their files say, written and read without loss, and refused in words.

A reader may be wrong in two ways: another number than the file holds, or an error that does not say
where. Attitudes are checked by where they send an axis, not by the quaternion's digits.
"""

from __future__ import annotations

import io
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kfgen.core.errors import InputError
from kfgen.log.log import Channel, Log
from kfgen.log.readers import ColumnMap, read_log, write_log

DEG = np.pi / 180.0


def a_log(t: object, **channels: object) -> Log:
    made = {k: Channel.of(v, "deg/s") for k, v in channels.items()}  # type: ignore[arg-type]
    return Log(np.asarray(t, float), made, "a log")


def csv(folder: Path, *lines: str, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


# The log itself.


def test_a_channel_is_kept_in_si_and_remembers_its_unit() -> None:
    channel = Channel.of([180.0], "deg/s")
    assert channel.values[0] == pytest.approx(np.pi, rel=1e-15)
    assert (channel.unit, channel.si) == ("deg/s", "rad/s")


def test_a_log_cannot_be_changed() -> None:
    log = a_log([0.0, 1.0], x=[1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        log.t[0] = 5.0
    with pytest.raises(ValueError, match="read-only"):
        log.values("x")[0] = 5.0
    with pytest.raises(TypeError):
        log.channels["y"] = log.channels["x"]  # type: ignore[index]


@pytest.mark.parametrize(
    ("t", "x", "said"),
    [
        ([], [], "no sample"),
        ([0.0, 1.0, 2.0], [1.0, 2.0], "x has 2 samples, time has 3"),
        ([0.0, np.nan, 2.0], [1.0, 2.0, 3.0], "not a number at sample 2"),
        ([0.0, 1.0, np.inf], [1.0, 2.0, 3.0], "not a number at sample 3"),
        ([0.0, 2.0, 1.0], [1.0, 2.0, 3.0], "sample 3"),
        ([0.0, 1.0, 1.0], [1.0, 2.0, 3.0], "sample 3"),
        ([[0.0, 1.0]], [1.0, 2.0], ""),
    ],
)
def test_an_inconsistent_log_is_refused(t: object, x: object, said: str) -> None:
    with pytest.raises(InputError) as caught:
        a_log(t, x=x)
    assert said in caught.value.what
    assert caught.value.where == "a log"


def test_a_log_without_channels_is_refused() -> None:
    with pytest.raises(InputError, match="no channel"):
        a_log([0.0, 1.0])


def test_dt_and_duration_count_the_last_period() -> None:
    log = a_log(np.arange(100) / 50.0, x=np.zeros(100))
    assert log.dt == pytest.approx(0.02)
    assert log.duration == pytest.approx(2.0)


def test_one_sample_has_no_period() -> None:
    with pytest.raises(InputError, match="one sample"):
        _ = a_log([0.0], x=[1.0]).dt


def test_a_gap_in_time_is_uneven_and_located() -> None:
    t = np.arange(10) * 0.1
    t[6:] += 0.5
    with pytest.raises(InputError, match=r"t = 0\.5 s"):
        a_log(t, x=np.zeros(10)).uniform_dt()


def test_jitter_below_half_a_period_is_even() -> None:
    t = np.arange(11) * 0.1
    t[5] += 0.02
    assert a_log(t, x=np.zeros(11)).uniform_dt() == pytest.approx(0.1)


def test_a_nan_is_kept_but_not_handed_out_as_a_value() -> None:
    log = a_log([0.0, 0.1, 0.2], x=[1.0, np.nan, np.nan])
    assert np.isnan(log.channel("x").values[1])
    with pytest.raises(InputError, match="channel x is not a number at sample 2") as caught:
        log.values("x")
    assert "2 in all" in caught.value.what


def test_a_missing_channel_names_those_that_are_there() -> None:
    with pytest.raises(InputError) as caught:
        a_log([0.0, 1.0], x=[1, 2], y=[3, 4]).channel("z")
    assert "'z'" in caught.value.what
    assert "x, y" in caught.value.remedy


def test_cut_and_select() -> None:
    log = a_log(np.arange(5.0), x=np.arange(5.0), y=np.zeros(5))
    part = log.cut(1, 3).select(["x"])
    np.testing.assert_array_equal(part.t, [1.0, 2.0])
    assert list(part.channels) == ["x"]


# CSV.


def test_header_units_are_converted(tmp_path: Path) -> None:
    path = csv(tmp_path, "t [ms],gyro_x [deg/s],accel_z [g],temperature [degC]", "0,180,1,25", "10,-90,2,0")
    log = read_log(path)
    np.testing.assert_allclose(log.t, [0.0, 0.01], rtol=1e-15)
    np.testing.assert_allclose(log.values("gyro_x"), [np.pi, -np.pi / 2], rtol=1e-15)
    np.testing.assert_allclose(log.values("accel_z"), [9.80665, 19.6133], rtol=1e-15)
    np.testing.assert_allclose(log.values("temperature"), [298.15, 273.15], rtol=1e-15)


def test_a_quaternion_needs_no_unit(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t [s],ref_q_w,ref_q_x\n0,1,0\n1,0.6,0.8\n")
    assert read_log(path).channel("ref_q_x").values.tolist() == [0.0, 0.8]
    path.write_text("t [s],gyro_w\n0,1\n1,0.6\n")
    with pytest.raises(InputError, match="gyro_w"):
        read_log(path)


@pytest.mark.parametrize("separator", [",", ";", "\t", " ; "])
def test_separators(tmp_path: Path, separator: str) -> None:
    rows = [["t [s]", "a [m]", "b [m]"], ["0", "1", "2"], ["1", "3", "4.5"]]
    log = read_log(csv(tmp_path, *(separator.join(r) for r in rows)))
    np.testing.assert_array_equal(log.values("b"), [2.0, 4.5])


def test_space_separated(tmp_path: Path) -> None:
    log = read_log(csv(tmp_path, "t[s] a[m]", "0  1", "1 3", name="log.txt"))
    np.testing.assert_array_equal(log.values("a"), [1.0, 3.0])


def test_space_separated_header_written_as_documented(tmp_path: Path) -> None:
    log = read_log(csv(tmp_path, "t [s] a [m]", "0  1", "1 3", name="log.txt"))
    np.testing.assert_array_equal(log.values("a"), [1.0, 3.0])


def test_one_column_with_a_rate(tmp_path: Path) -> None:
    log = read_log(csv(tmp_path, "a [m]", "1", "3"), rate=10.0)
    np.testing.assert_array_equal(log.values("a"), [1.0, 3.0])
    np.testing.assert_allclose(log.t, [0.0, 0.1])


def test_foreign_lines_and_comments_before_the_header_are_skipped(tmp_path: Path) -> None:
    lines = ["# logger 3000", "Date: yesterday", "range,250", "# t [s],a [m]", "# end", "0,1", "1,2"]
    lines[4] = ""
    log = read_log(csv(tmp_path, *lines))
    np.testing.assert_array_equal(log.values("a"), [1.0, 2.0])


@pytest.mark.parametrize("line", ["# a remark", "", "   "])
def test_comments_and_blank_lines_between_rows_are_skipped(tmp_path: Path, line: str) -> None:
    log = read_log(csv(tmp_path, "t [s],a [m]", "0,1", line, "1,2"))
    np.testing.assert_array_equal(log.values("a"), [1.0, 2.0])


def test_byte_order_mark_and_windows_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"\xef\xbb\xbft [s],a [m]\r\n0,1\r\n1,2\r\n")
    np.testing.assert_array_equal(read_log(path).values("a"), [1.0, 2.0])


def test_a_suffix_in_capitals_is_known(tmp_path: Path) -> None:
    assert read_log(csv(tmp_path, "t [s],a [m]", "0,1", name="LOG.CSV")).n == 1


def test_nan_in_a_cell_is_a_sample_that_was_not_recorded(tmp_path: Path) -> None:
    log = read_log(csv(tmp_path, "t [s],a [m]", "0,nan", "1,2"))
    np.testing.assert_array_equal(log.channel("a").values, [np.nan, 2.0])


def test_columns_map_by_name_and_by_number(tmp_path: Path) -> None:
    path = csv(tmp_path, "gx,gy", "131,16384", "262,32768")
    columns = ColumnMap.parse("gyro_x=gx [deg/s/131], accel_x=#2 [g/16384]")
    log = read_log(path, rate=100.0, columns=columns)
    np.testing.assert_allclose(log.values("gyro_x"), [DEG, 2 * DEG], rtol=1e-14)
    np.testing.assert_allclose(log.values("accel_x"), [9.80665, 19.6133], rtol=1e-14)


def test_number_one_is_the_first_column_of_a_headerless_file(tmp_path: Path) -> None:
    path = csv(tmp_path, "0.0,7", "0.5,8")
    log = read_log(path, columns=ColumnMap.parse("t=#1 [s], a=#2 [m]"))
    np.testing.assert_array_equal(log.t, [0.0, 0.5])
    np.testing.assert_array_equal(log.values("a"), [7.0, 8.0])


def test_only_mapped_columns_are_channels(tmp_path: Path) -> None:
    path = csv(tmp_path, "t [s],a [m],b [furlong]", "0,1,2", "1,2,3")
    assert list(read_log(path, columns=ColumnMap.parse("x=a")).channels) == ["x"]


def test_the_rate_replaces_the_files_time_and_says_so(tmp_path: Path) -> None:
    log = read_log(csv(tmp_path, "t [s],a [m]", "5,1", "4,2"), rate=4.0)
    np.testing.assert_array_equal(log.t, [0.0, 0.25])
    assert any("--rate" in w for w in log.warnings)


@pytest.mark.parametrize(
    "text", ["gyro_x", "gyro_x=", "=gx", "1x=gx", "a=b [m", "a=b,,c=d", "a=b,a=c", "a=b [zz]"]
)
def test_a_garbled_column_map_is_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        ColumnMap.parse(text)
    assert caught.value.where == "--columns"


def test_an_empty_cell_is_where_nothing_was_recorded(tmp_path: Path) -> None:
    """Channels of two rates in one file; the first row has a hole too."""
    log = read_log(csv(tmp_path, "t [s],a [m],b [K]", "0,1,", "1,2,300", "2,,", "3,4,301"))
    np.testing.assert_array_equal(log.channels["a"].values, [1.0, 2.0, np.nan, 4.0])
    np.testing.assert_array_equal(log.channels["b"].values, [np.nan, 300.0, np.nan, 301.0])


BAD_CSV = {
    "no row": (["t [s],a [m]"], "numbers", ""),
    "text": (["hello", "world"], "numbers", ""),
    "word in a later row": (["t [s],a [m]", "0,1", "1,x"], "'x'", "line 3, column 2 (a)"),
    "word in the first row": (["t [s],a [m]", "0,x", "1,2"], "'x'", "line 2, column 2"),
    "number with an underscore": (["t [s],a [m]", "0,1", "1,1_0"], "'1_0'", "line 3, column 2 (a)"),
    "empty time": (["t [s],a [m]", "0,1", ",1", "2,3"], "empty", "line 3, column 1 (t)"),
    "short row": (["t [s],a [m]", "0,1", "1", "2,3"], "1 cells instead of 2", "line 3"),
    "long row": (["t [s],a [m]", "0,1", "# fine", "1,2,3"], "3 cells instead of 2", "line 4"),
    "cut off": (["t [s],a [m]", "0,1", "1,2", "2"], "1 cells", "line 4"),
    "header twice": (["t [s],a [m],a [m]", "0,1,2"], "'a' twice", "line 1, column 3"),
    "no unit": (["t [s],a", "0,1"], "no unit", "'a'"),
    "unknown unit": (["t [s],a [furlong]", "0,1"], "furlong", "'a'"),
    "time unit unknown": (["t [fortnight],a [m]", "0,1"], "fortnight", "t"),
    "time unit no time": (["t [m],a [m]", "0,1"], "no time", "t"),
    "no time": (["a [m]", "1", "2"], "rate", ""),
    "only time": (["t [s]", "0", "1"], "no channel", ""),
    "time back": (["t [s],a [m]", "0,1", "2,1", "1,1"], "sample 3", ""),
    "time twice": (["t [s],a [m]", "0,1", "0,1"], "sample 2", ""),
    "time nan": (["t [s],a [m]", "0,1", "nan,1"], "sample 2", ""),
    "time inf": (["t [s],a [m]", "0,1", "inf,1"], "sample 2", ""),
}


@pytest.mark.parametrize("case", BAD_CSV)
def test_a_broken_csv_is_refused_with_file_place_and_remedy(tmp_path: Path, case: str) -> None:
    lines, said, place = BAD_CSV[case]
    path = csv(tmp_path, *lines)
    with pytest.raises(InputError) as caught:
        read_log(path)
    assert said in caught.value.what
    assert str(path) in caught.value.where
    assert place in caught.value.where + caught.value.what
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("gone.csv", None, "no such file"),
        ("empty.csv", b"", "empty"),
        ("blank.csv", b" \n\n", "empty"),
        ("empty.npz", b"", "empty"),
        ("log.xyz", b"t [s],a [m]\n0,1\n", "'.xyz'"),
        ("log", b"t [s],a [m]\n0,1\n", "''"),
        ("log.csv", b"\x00\xff\xfe\x80 binary \x01\n" * 3, "numbers"),
        ("log.npz", b"t [s],a [m]\n0,1\n", "archive"),
        ("cut.npz", b"PK\x03\x04 and nothing more", "archive"),
    ],
)
def test_what_is_no_log_is_refused_with_file_and_remedy(
    tmp_path: Path, name: str, content: bytes | None, said: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_log(path)
    assert said in caught.value.what
    assert caught.value.where == str(path)
    assert caught.value.remedy


def test_a_mapped_column_that_is_not_there_names_those_that_are(tmp_path: Path) -> None:
    path = csv(tmp_path, "t [s],a [m]", "0,1")
    for wanted in ("b", "#3", "#0"):
        with pytest.raises(InputError) as caught:
            read_log(path, columns=ColumnMap.parse(f"x={wanted} [m]"))
        assert f"'{wanted}'" in caught.value.what
        assert caught.value.where == str(path)
        assert "t, a" in caught.value.remedy


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_that_is_none_is_refused(tmp_path: Path, rate: float) -> None:
    with pytest.raises(InputError, match="must be positive"):
        read_log(csv(tmp_path, "a [m]", "1", "2"), rate=rate)


# Written and read.


def some_log(start: float = 0.0) -> Log:
    rng = np.random.default_rng(1)
    values = {"gyro_x": "deg/s", "accel_x": "g/16384", "mag_x": "uT", "temperature": "degC", "free": "1"}
    channels = {k: Channel.of(rng.normal(size=200), u) for k, u in values.items()}
    return Log(start + np.arange(200) / 100.0, channels)


@pytest.mark.parametrize(("suffix", "precision"), [("csv", 1e-9), ("npz", 1e-14)])
def test_a_log_is_written_and_read_again(tmp_path: Path, suffix: str, precision: float) -> None:
    log, path = some_log(), tmp_path / f"log.{suffix}"
    write_log(log, path)
    again = read_log(path)
    assert {k: c.unit for k, c in again.channels.items()} == {k: c.unit for k, c in log.channels.items()}
    np.testing.assert_allclose(again.t, log.t, rtol=precision)
    for name, channel in log.channels.items():
        scale = np.abs(channel.values).max()
        np.testing.assert_allclose(again.values(name), channel.values, rtol=0, atol=precision * scale)


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_unix_time_survives_to_the_sampling_period(tmp_path: Path, suffix: str) -> None:
    log, path = some_log(start=1.7e9), tmp_path / f"log.{suffix}"
    write_log(log, path)
    np.testing.assert_allclose(read_log(path).t, log.t, rtol=0, atol=1e-4)


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_missing_samples_survive(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log.{suffix}"
    write_log(a_log([0.0, 1.0], x=[np.nan, 2.0]), path)
    np.testing.assert_array_equal(np.isnan(read_log(path).channel("x").values), [True, False])


@pytest.mark.parametrize("name", ["file", "args", "allow_pickle", "arr_0"])
def test_any_channel_name_survives_in_an_npz(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.npz"
    write_log(a_log([0.0, 1.0], **{name: [1.0, 2.0]}), path)
    assert list(read_log(path).channels) == [name]


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_nothing_but_the_log_is_left_in_the_folder(tmp_path: Path, suffix: str) -> None:
    write_log(some_log(), tmp_path / f"log.{suffix}")
    assert [p.name for p in tmp_path.iterdir()] == [f"log.{suffix}"]


def test_the_hash_is_that_of_the_file(tmp_path: Path) -> None:
    path = csv(tmp_path, "t [s],a [m]", "0,1")
    one = read_log(path).sha256
    assert len(one) == 64
    path.write_text("t [s],a [m]\n0,2\n", encoding="utf-8")
    assert read_log(path).sha256 != one


def test_an_unknown_suffix_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'\.xyz'"):
        write_log(some_log(), tmp_path / "log.xyz")
    assert not list(tmp_path.iterdir())


# Foreign archives.


def archive(folder: Path, **arrays: object) -> Path:
    path = folder / "foreign.npz"
    np.savez(path, **{k: np.asarray(v) for k, v in arrays.items()})
    return path


def triad(*row: float, n: int = 4) -> np.ndarray:
    return np.tile(row, (n, 1))


def test_triads_become_channels_in_their_usual_units(tmp_path: Path) -> None:
    path = archive(tmp_path, gyr=triad(1, 2, 3), acc=triad(4, 5, 6), mag=triad(7, 8, 9), fs=50.0)
    log = read_log(path)
    assert log.dt == pytest.approx(0.02)
    assert log.values("gyro_y")[0] == 2.0
    assert log.values("accel_z")[0] == 6.0
    assert log.values("mag_x")[0] == pytest.approx(7e-6)


def test_units_stated_in_meta_are_followed(tmp_path: Path) -> None:
    meta = json.dumps({"columns": "gyr deg/s, acc g"})
    log = read_log(archive(tmp_path, gyr=triad(180, 0, 0), acc=triad(0, 0, 1), meta=meta, fs=10.0))
    assert log.values("gyro_x")[0] == pytest.approx(np.pi)
    assert log.values("accel_z")[0] == pytest.approx(9.80665)


@pytest.mark.parametrize("meta", ["no json {", "[1, 2]", "3"])
def test_a_meta_of_another_kind_is_no_obstacle(tmp_path: Path, meta: str) -> None:
    assert read_log(archive(tmp_path, gyr=triad(1, 2, 3), meta=meta, fs=10.0)).n == 4


def reference(log: Log, k: int = 0) -> Rotation:
    return Rotation.from_quat([log.channel(f"ref_q_{a}").values[k] for a in "wxyz"], scalar_first=True)


ENU = json.dumps({"columns": "quat sensor to ENU, scalar first"})


@pytest.mark.parametrize(
    ("axis_b", "axis_ned"),
    [((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (1, 0, 0)), ((0, 0, 1), (0, 0, -1))],
    ids=["x east", "y north", "z up"],
)
def test_the_identity_of_an_enu_reference_has_x_east_y_north_z_up(
    tmp_path: Path, axis_b: tuple[float, ...], axis_ned: tuple[float, ...]
) -> None:
    log = read_log(archive(tmp_path, gyr=triad(0, 0, 0), quat=triad(1, 0, 0, 0), meta=ENU, fs=1.0))
    np.testing.assert_allclose(reference(log).apply(axis_b), axis_ned, atol=1e-15)


def test_any_enu_reference_sends_vectors_where_swapped_axes_say(tmp_path: Path) -> None:
    enu = Rotation.from_quat(np.random.default_rng(0).standard_normal((6, 4)))
    quat = enu.as_quat(scalar_first=True)
    log = read_log(archive(tmp_path, gyr=triad(0, 0, 0, n=6), quat=quat, meta=ENU, fs=1.0))
    v_b = np.array([0.3, -1.2, 2.0])
    for k in range(6):
        east, north, up = enu[k].apply(v_b)
        np.testing.assert_allclose(reference(log, k).apply(v_b), [north, east, -up], atol=1e-12)


def test_a_reference_that_is_not_enu_is_left_alone(tmp_path: Path) -> None:
    log = read_log(archive(tmp_path, gyr=triad(0, 0, 0), quat=triad(1, 0, 0, 0), fs=1.0))
    np.testing.assert_allclose(reference(log).apply([1, 0, 0]), [1, 0, 0], atol=1e-15)


@pytest.mark.parametrize("gap", [np.nan, 0.0])
def test_a_reference_with_gaps_is_missing_there_only(tmp_path: Path, gap: float) -> None:
    quat = triad(1.0, 0, 0, 0)
    quat[2] = gap
    log = read_log(archive(tmp_path, gyr=triad(0, 0, 0), quat=quat, meta=ENU, fs=1.0))
    np.testing.assert_array_equal(np.isnan(log.channel("ref_q_w").values), [False, False, True, False])


def test_a_real_reference_sends_gravity_and_the_field_where_they_are(
    recording: Callable[[str], Path],
) -> None:
    log = read_log(recording("dynamic/broad_01_undisturbed_slow_rotation_A.npz"))
    rest = slice(1000, 3000)
    good = np.isfinite(log.channel("ref_q_w").values[rest])
    quat = np.column_stack([log.channel(f"ref_q_{a}").values[rest][good] for a in "wxyz"])
    R_nb = Rotation.from_quat(quat, scalar_first=True)
    force, field = (
        np.nanmean(
            R_nb.apply(np.column_stack([log.channel(f"{s}_{a}").values[rest][good] for a in "xyz"])), axis=0
        )
        for s in ("accel", "mag")
    )
    # At rest the specific force is minus gravity: up. In Europe the field dips below the horizon.
    np.testing.assert_allclose(force, [0.0, 0.0, -9.81], atol=0.3)
    assert field[2] > 20e-6


class Trap:
    """A pickle that would show that it was loaded."""

    def __reduce__(self) -> tuple[object, ...]:
        return (exec, ("raise SystemExit('the pickle was loaded')",))


@pytest.mark.parametrize("way", ["object array", "bare pickle", "inside an archive"])
def test_a_pickle_is_refused_and_never_loaded(tmp_path: Path, way: str) -> None:
    path = tmp_path / "trap.npz"
    if way == "bare pickle":
        path.write_bytes(pickle.dumps(Trap()))
    else:
        name = {"object array": "gyr", "inside an archive": "meta"}[way]
        np.savez(path, fs=np.array(1.0), **{name: np.array([Trap()], dtype=object)})
    with pytest.raises(InputError) as caught:
        read_log(path)
    assert "plain arrays" in caught.value.what
    assert caught.value.where == str(path)


def own(**units: object) -> str:
    return json.dumps(units)


BAD_NPZ = {
    "no arrays": {"meta": "{}"},
    "only a rate": {"fs": 10.0},
    "no rate": {"gyr": triad(1, 2, 3)},
    "rate zero": {"gyr": triad(1, 2, 3), "fs": 0.0},
    "rate negative": {"gyr": triad(1, 2, 3), "fs": -5.0},
    "rate nan": {"gyr": triad(1, 2, 3), "fs": np.nan},
    "rate a word": {"gyr": triad(1, 2, 3), "fs": "fast"},
    "own units no json": {"a": [1.0, 2.0], "t": [0.0, 1.0], "kfgen_units": "{"},
    "own units a list": {"a": [1.0, 2.0], "t": [0.0, 1.0], "kfgen_units": "[1]"},
    "own unit unknown": {"a": [1.0, 2.0], "t": [0.0, 1.0], "kfgen_units": own(t="s", a="furlong")},
    "own lengths differ": {"a": [1.0, 2.0, 3.0], "t": [0.0, 1.0], "kfgen_units": own(t="s", a="m")},
    "own words": {"a": ["x", "y"], "t": [0.0, 1.0], "kfgen_units": own(t="s", a="m")},
    "own table": {"a": [[1.0, 2.0]], "t": [0.0], "kfgen_units": own(t="s", a="m")},
    "own time back": {"a": [1.0, 2.0], "t": [1.0, 0.0], "kfgen_units": own(t="s", a="m")},
    "own without time": {"a": [1.0, 2.0], "kfgen_units": own(a="m")},
    "own without channels": {"t": [0.0, 1.0], "kfgen_units": own(t="s")},
}


@pytest.mark.parametrize("case", BAD_NPZ)
def test_a_broken_npz_is_refused_with_its_name_and_a_remedy(tmp_path: Path, case: str) -> None:
    path = archive(tmp_path, **BAD_NPZ[case])
    with pytest.raises(InputError) as caught:
        read_log(path)
    assert str(path) in caught.value.where
    assert caught.value.remedy


def test_a_single_array_under_the_wrong_suffix_is_refused(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    path = tmp_path / "array.npz"
    path.write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="archive"):
        read_log(path)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.99])
@pytest.mark.parametrize("damage", ["cut", "flip"])
def test_a_damaged_archive_is_refused(tmp_path: Path, damage: str, share: float) -> None:
    path = tmp_path / "log.npz"
    write_log(some_log(), path)
    data = bytearray(path.read_bytes())
    at = int(share * len(data))
    if damage == "cut":
        data = data[:at]
    else:
        data[at : at + 8] = bytes(b ^ 0xFF for b in data[at : at + 8])
    path.write_bytes(bytes(data))
    with pytest.raises(InputError) as caught:
        read_log(path)
    assert caught.value.where == str(path)
