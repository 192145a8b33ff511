"""Proves that a file of one array is mapped and read as it is, and that any other content is refused in words."""

from __future__ import annotations

import pickle
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.log.log import Log
from kfgen.log.readers import ColumnMap, read_log, read_long
from kfgen.log.readers.arrays.npy import read as read_npy
from kfgen.log.readers.tables.table import chunks


def npy(folder: Path, array: object, **how: bool) -> Path:
    path = folder / "log.npy"
    np.save(path, np.asarray(array), **how)
    return path


@pytest.mark.parametrize("kind", ["f4", "f8", "i2", ">i4"])
def test_an_npy_file_is_mapped_and_read_in_the_users_unit(tmp_path: Path, kind: str) -> None:
    array = np.arange(12).reshape(4, 3).astype(kind)
    path = npy(tmp_path, array)
    assert read_npy(path).columns["#2"].values.dtype == np.dtype(kind)
    log = read_log(path, rate=10.0, columns=ColumnMap.parse("gyro_x=#1 [deg/s], t=#2 [s]"))
    np.testing.assert_allclose(log.values("gyro_x"), np.radians(array[:, 0].astype(float)), rtol=1e-14)
    assert log.dt == pytest.approx(0.1)


def test_one_row_of_samples(tmp_path: Path) -> None:
    path = npy(tmp_path, np.array([1.0, 2.0], dtype=np.float32))
    log = read_log(path, rate=10.0, columns=ColumnMap.parse("a=#1 [m]"))
    np.testing.assert_array_equal(log.values("a"), [1.0, 2.0])
    with pytest.raises(InputError, match="no unit"):
        read_log(path, rate=10.0)


def test_chunks_of_a_mapped_column_are_those_of_the_array(tmp_path: Path) -> None:
    array = np.random.default_rng(1).standard_normal(10_000).reshape(-1, 2)
    column = read_npy(npy(tmp_path, array)).columns["#2"].values
    np.testing.assert_array_equal(np.concatenate([c.copy() for c in chunks(column, 999)]), array[:, 1])


class Trap:
    def __reduce__(self) -> tuple[object, ...]:
        return (exec, ("raise SystemExit('the pickle was loaded')",))


BAD_NPY: dict[str, object] = {
    "objects": np.array([Trap()], dtype=object),
    "structured": np.zeros(3, dtype=[("a", "f8"), ("b", "f8")]),
    "words": np.array(["a", "b"]),
    "complex": np.zeros(3, dtype=complex),
    "truth": np.zeros(3, dtype=bool),
    "times": np.zeros(3, dtype="M8[s]"),
    "one number": np.float64(3.0),
    "three dimensions": np.zeros((2, 2, 2)),
    "no sample": np.zeros(0),
    "no column": np.zeros((3, 0)),
}


@pytest.mark.parametrize("case", BAD_NPY)
def test_an_array_of_another_kind_is_refused(tmp_path: Path, case: str) -> None:
    path = npy(tmp_path, BAD_NPY[case], allow_pickle=True)
    with pytest.raises(InputError) as caught:
        read_log(path, rate=1.0)
    assert caught.value.where == str(path)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "damage", ["pickle", "archive", "text", "empty", "cut header", "cut data", "garbled header", "huge shape"]
)
def test_a_damaged_npy_is_refused(tmp_path: Path, damage: str) -> None:
    path = npy(tmp_path, np.arange(1000.0))
    data = path.read_bytes()
    if damage == "archive":
        with path.open("wb") as file:
            np.savez(file, a=np.zeros(3))
    else:
        path.write_bytes(
            {
                "pickle": pickle.dumps(Trap()),
                "text": b"t [s],a [m]\n0,1\n",
                "empty": b"",
                "cut header": data[:40],
                "cut data": data[:-8],
                "garbled header": data.replace(b"'shape'", b"'shxpe'"),
                "huge shape": data.replace(b"(1000,)", b"(9**99)"),
            }[damage]
        )
    with pytest.raises(InputError) as caught:
        read_log(path, rate=1.0)
    assert caught.value.where == str(path)
    assert caught.value.remedy


def test_a_log_that_is_too_long_for_memory_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kfgen.log.readers.MAX_SAMPLES_IN_MEMORY", 99)
    path, columns = npy(tmp_path, np.zeros((100, 1))), "gyro_x=#1 [rad/s]"
    with pytest.raises(InputError, match="more than the 99 samples"):
        read_log(path, rate=100.0, columns=columns)
    assert read_long(path, rate=100.0, columns=columns).channel("gyro_x").unit == "rad/s"


def no_file() -> object:
    raise OSError("no room")


def owner(values: Any) -> object:
    """What holds the memory of an array."""
    while isinstance(values, np.ndarray):
        values = values.base
    return values


def test_what_is_read_goes_into_a_file_where_it_is_many_numbers_and_stays_where_none_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kfgen.log.readers.MAX_NUMBERS_IN_MEMORY", 11)
    array = np.arange(12.0).reshape(4, 3)
    array[1, 2] = np.nan
    path = npy(tmp_path, array)
    how = {"rate": 10.0, "columns": "gyro_x=#1 [deg/s], gyro_y=#2 [rad/s], gyro_z=#3 [rad/s]"}
    mapped = read_long(path, **how)
    monkeypatch.setattr("tempfile.TemporaryFile", no_file)
    held = read_long(path, **how)
    for log, is_mapped in ((mapped, True), (held, False)):
        assert isinstance(log, Log)
        assert isinstance(owner(log.channels["gyro_z"].values), mmap) is is_mapped
        for k, (c, factor) in enumerate(zip(log.channels.values(), (np.pi / 180.0, 1.0, 1.0))):
            np.testing.assert_allclose(c.values, array[:, k] * factor, rtol=1e-15)
            assert not c.values.flags.writeable
