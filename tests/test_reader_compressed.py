"""Proves that a compressed log is the log inside, and that a damaged or exploding one is refused in words."""

from __future__ import annotations

import gzip
import lzma
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kfgen.core.errors import InputError, MissingExtra
from kfgen.log.readers import read_log
from kfgen.log.readers.packed import compressed as module


def packed(kind: str, data: bytes) -> bytes:
    if kind == "zst":
        return bytes(pytest.importorskip("zstandard").compress(data))
    return gzip.compress(data) if kind == "gz" else lzma.compress(data)


TEXT = b"t [s],gyro_x [deg/s]\n" + b"".join(b"%d,%d\n" % (k, k) for k in range(100))


@pytest.mark.parametrize("kind", ["gz", "xz", "zst"])
def test_a_compressed_text_is_the_text(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.csv.{kind}"
    path.write_bytes(packed(kind, TEXT))
    log = read_log(path)
    assert log.values("gyro_x") == pytest.approx(np.deg2rad(np.arange(100)))
    assert log.source == str(path)


@pytest.mark.parametrize("kind", ["gz", "xz", "zst"])
def test_a_compressed_array_outlives_its_temporary_file(tmp_path: Path, kind: str) -> None:
    np.save(tmp_path / "a.npy", np.arange(1000.0))
    path = tmp_path / f"a.npy.{kind}"
    path.write_bytes(packed(kind, (tmp_path / "a.npy").read_bytes()))
    assert np.array_equal(read_log(path, rate=10, columns="x=#1 [1]").values("x"), np.arange(1000.0))


def test_a_compressed_flight_is_the_flight(recording: Callable[[str], Path], tmp_path: Path) -> None:
    pytest.importorskip("pyulog")
    flight = recording("flights/px4_vtol_small.ulg")
    path = tmp_path / "flight.gz"  # the content says what it is
    path.write_bytes(packed("gz", flight.read_bytes()))
    log = read_log(path, instance=1)
    assert np.array_equal(log.values("gyro_x"), read_log(flight, instance=1).values("gyro_x"))


@pytest.mark.parametrize("kind", ["gz", "xz"])
def test_a_cut_off_one_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.csv.{kind}"
    path.write_bytes(packed(kind, TEXT)[:-40])
    with pytest.raises(InputError, match="no compressed file that can be read"):
        read_log(path)


def test_messages_name_the_compressed_file(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    path.write_bytes(packed("gz", TEXT.replace(b"50,50", b"50,fifty")))
    with pytest.raises(InputError, match=r"a\.csv\.gz: line 52") as error:
        read_log(path)
    assert error.value.where.startswith(str(path))


def test_what_grows_beyond_measure_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SMALL_BYTES", 1 << 16)
    monkeypatch.setattr(module, "MOST_GROWTH", 10)
    path = tmp_path / "a.csv.gz"
    path.write_bytes(packed("gz", bytes(1 << 22)))
    with pytest.raises(InputError, match="Unpack it yourself"):
        read_log(path)


@pytest.mark.parametrize("suffix", ["gz", "xz", "zst"])
def test_what_is_not_compressed_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.csv.{suffix}"
    path.write_bytes(TEXT)
    with pytest.raises(InputError, match="not compressed"):
        read_log(path)


def test_an_unknown_content_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.doc.gz"
    path.write_bytes(packed("gz", TEXT))
    with pytest.raises(InputError, match=r"a\.doc\.gz: files with the ending '\.doc' cannot be read"):
        read_log(path)


def test_the_library_that_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "zstandard", None)
    path = tmp_path / "a.csv.zst"
    path.write_bytes(b"\x28\xb5\x2f\xfd" + bytes(20))
    with pytest.raises(MissingExtra, match=r'pip install "kfgen\[zstd\]"'):
        read_log(path)
