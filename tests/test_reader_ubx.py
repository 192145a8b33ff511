"""Proves that NAV-PVT of u-blox is read as pyubx2 writes it, whatever lies between its messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.log.contents import contents
from kfgen.log.readers import read_log
from kfgen.log.readers.gnss.ubx import checksum

pyubx2 = pytest.importorskip("pyubx2", reason="pyubx2 is not installed")

LATITUDE, LONGITUDE, HEIGHT = 47.0, 8.0, 500
START = int(np.datetime64("2024-02-28T23:59:59").astype(int))
"""A leap day is crossed."""
NMEA = b"$GNGGA,000000.00,,,,,0,00,99.99,,,,,,*56\r\n"


def pvt(k: int, **changed: Any) -> bytes:
    """The solution `k` at 5 Hz, 1 m/s north."""
    second, fraction = divmod(k, 5)
    when = np.datetime64(int(START + second), "s").astype(object)
    fields = {
        "iTOW": 200 * k,
        "year": when.year,
        "month": when.month,
        "day": when.day,
        "hour": when.hour,
        "min": when.minute,
        "second": when.second,
        "validDate": 1,
        "validTime": 1,
        "nano": 200_000_000 * fraction,
        "fixType": 3,
        "gnssFixOk": 1,
        "lon": LONGITUDE,
        "lat": LATITUDE + k * 1e-5,
        "height": 1000 * HEIGHT,
        "velN": 1000,
        "velE": -20,
        "velD": 3,
    }
    return bytes(pyubx2.UBXMessage("NAV", "NAV-PVT", pyubx2.GET, **(fields | changed)).serialize())


def written(folder: Path, content: bytes) -> Path:
    path = folder / "drive.ubx"
    path.write_bytes(content)
    return path


def test_solutions_are_those_of_pyubx2(tmp_path: Path) -> None:
    ack = bytes(pyubx2.UBXMessage("ACK", "ACK-ACK", pyubx2.GET, clsID=6, msgID=1).serialize())
    content = NMEA + ack + NMEA.join(pvt(k) for k in range(20)) + pvt(20)[:50]
    path = written(tmp_path, content)
    log = read_log(path)
    assert log.t == pytest.approx(START + 0.2 * np.arange(20), abs=1e-6)
    # A degree of latitude at 47 degrees is 111.174 km (WGS 84, meridian radius 6 369 745 m).
    assert log.values("gnss_p_N") == pytest.approx(1.11174 * np.arange(20), rel=1e-4)
    assert log.values("gnss_p_E") == pytest.approx(0.0, abs=1e-3)
    assert log.values("gnss_p_D") == pytest.approx(np.zeros(20), abs=1e-3)
    for axis, v in zip("NED", (1.0, -0.02, 0.003), strict=True):
        assert log.values(f"gnss_v_{axis}") == pytest.approx(np.full(20, v))
    assert any("1 messages are damaged or cut off" in w for w in log.warnings)
    assert "class 0x05 id 0x01" in contents(path).topics


def test_solutions_without_a_fix_are_left_out(tmp_path: Path) -> None:
    kinds = [{"fixType": 0}, {"fixType": 5}, {"gnssFixOk": 0}]
    content = b"".join(pvt(k, **(kinds[k] if k < 3 else {})) for k in range(9))
    log = read_log(written(tmp_path, content))
    assert log.n == 6
    assert any("3 of 9 solutions" in w for w in log.warnings)


def test_seconds_of_the_week_without_a_date(tmp_path: Path) -> None:
    log = read_log(written(tmp_path, b"".join(pvt(k, validDate=0) for k in range(5))))
    assert log.t == pytest.approx(0.2 * np.arange(5))


def test_a_damaged_message_costs_itself_only(tmp_path: Path) -> None:
    content = bytearray(b"".join(pvt(k) for k in range(9)))
    content[4 * 100 + 40] ^= 0xFF
    assert read_log(written(tmp_path, bytes(content))).n == 8


@pytest.mark.parametrize("content", [NMEA * 3, b"\xb5\x62", b"\xb5\x62\x01\x07\xff\xff"])
def test_a_file_without_solutions_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match="NAV-PVT"):
        read_log(written(tmp_path, content))


def test_the_checksum_is_that_of_rfc_1145() -> None:
    a = b = 0
    content = bytes(np.random.default_rng(2).integers(0, 256, 3000, np.uint8))
    for byte in content:
        a = (a + byte) % 256
        b = (b + a) % 256
    assert checksum(content) == bytes((a, b))
