"""Reads recordings of u-blox receivers (.ubx): position and velocity of NAV-PVT; other messages are counted.

Times are seconds since 1970 of UTC where the receiver knows the date, else seconds of the GPS week.

References
----------
.. [1] u-blox M8 receiver description (UBX-13003221), 32.17.17: NAV-PVT; 32.2: frame and checksum.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.log.readers.tables.aiding import gnss_stream
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording, LogStream

Array = NDArray[np.float64]

SUFFIXES = (".ubx",)
SYNC = b"\xb5\x62"
NAV_PVT = (0x01, 0x07)
LEAST_BYTES = 84
"""Length of NAV-PVT in the first protocol that has it."""
FRAME_BYTES = 8
"""Sync, class, number, length and checksum."""
POSITION_FIXES = (2, 3, 4)
"""Kinds of fix with a position: in the plane, in space, with dead reckoning."""
FIX_OK = 1
"""Flag of a fix within the receiver's own limits."""
VALID_DATE_AND_TIME = 0b11
_PVT = struct.Struct("<IHBBBBBBIiBBBBiiiiIIiii")
"""NAV-PVT up to the velocity."""


def recording(path: Path, choice: LogChoice = ANY) -> LogRecording:
    """The solutions of a receiver.

    Parameters
    ----------
    path : Path
    choice : LogChoice
        Has no meaning here.

    Returns
    -------
    LogRecording

    Raises
    ------
    InputError
        No message of u-blox is in it, or no NAV-PVT.
    """
    data = path.read_bytes()
    solutions: list[tuple[float, ...]] = []
    counts: dict[str, int] = {}
    damaged = 0
    for kind, payload in _messages(data):
        if payload is None:
            damaged += 1
            continue
        name = "NAV-PVT" if kind == NAV_PVT else f"class 0x{kind[0]:02X} id 0x{kind[1]:02X}"
        counts[name] = counts.get(name, 0) + 1
        if kind == NAV_PVT and len(payload) >= LEAST_BYTES:
            solutions.append(_solution(payload))
    if not solutions:
        raise InputError(
            f"there is no solution NAV-PVT in it ({_said(counts)})",
            where=str(path),
            remedy="Switch UBX-NAV-PVT on in the receiver, or give it as .pos of RTKLIB",
        )
    values = np.array(solutions).T
    dated = bool((values[0] > 0.0).all())
    t = values[0] if dated else values[1]
    words = [
        "times are UTC in seconds since 1970"
        if dated
        else "the receiver knows no date: seconds of the GPS week"
    ]
    words += [f"{damaged} messages are damaged or cut off and were left out"] if damaged else []
    stream, said = gnss_stream("NAV-PVT", t, values[2] > 0.0, list(values[3:6]), list(values[6:9]))
    clocks = {name: Clock.counted(n) for name, n in sorted(counts.items())} | {"NAV-PVT": Clock.of(t)}
    streams: list[LogStream] = [stream] if stream else []
    return LogRecording(str(path), streams, clocks, (*words, said))


def _said(counts: dict[str, int]) -> str:
    return f"it has {', '.join(sorted(counts))}" if counts else "no message of u-blox is in it"


def _messages(data: bytes) -> Iterator[tuple[tuple[int, int], bytes | None]]:
    """Kind and content of each message; None as content where the checksum is wrong or the file ends.

    Text between messages, as NMEA sentences are, is skipped.
    """
    at = data.find(SYNC)
    while at >= 0:
        head = data[at : at + 6]
        if len(head) < 6:
            yield (0, 0), None
            return
        kind, length = (head[2], head[3]), int.from_bytes(head[4:6], "little")
        end = at + FRAME_BYTES + length
        frame = data[at + 2 : end]
        whole = len(frame) == FRAME_BYTES - 2 + length and checksum(frame[:-2]) == frame[-2:]
        yield kind, frame[4:-2] if whole else None
        at = data.find(SYNC, end if whole else at + 2)


def checksum(content: bytes) -> bytes:
    """The two bytes of Fletcher's algorithm (RFC 1145) over class, number, length and content."""
    # Of a row c: the sum, and the sum of all partial sums, both modulo 256.
    row = np.frombuffer(content, np.uint8).astype(np.int64)
    weights = np.arange(row.size, 0, -1)
    return bytes((int(row.sum()) & 0xFF, int((weights * row).sum()) & 0xFF))


def _solution(payload: bytes) -> tuple[float, ...]:
    """UTC [s since 1970] or zero, time of week [s], whether it is a fix, latitude, longitude [rad], height [m], velocity NED [m/s]."""
    v = _PVT.unpack_from(payload)
    week_ms, year, month, day, hour, minute, second, valid = v[:8]
    utc = 0.0
    if valid & VALID_DATE_AND_TIME == VALID_DATE_AND_TIME and 1 <= month <= 12 and 1 <= day <= 31:
        days = int(np.datetime64(f"{year:04d}-{month:02d}", "D").astype(int)) + day - 1
        utc = days * 86400.0 + hour * 3600.0 + minute * 60.0 + second + v[9] * 1e-9
    fix = float(v[11] & FIX_OK and v[10] in POSITION_FIXES)
    longitude, latitude = np.deg2rad(np.array(v[14:16]) * 1e-7)
    return utc, week_ms * 1e-3, fix, latitude, longitude, v[16] * 1e-3, *(1e-3 * n for n in v[20:23])
