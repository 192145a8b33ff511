"""The DataFlash format of ArduPilot: binary messages that the file itself describes.

A message is the bytes A3 95, its type, and its fields; messages of type 128 (`FMT`) name the fields of a type and
give their kinds as letters (https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HEAD = b"\xa3\x95"
FMT = 128
FMT_LENGTH = 89
KINDS: Mapping[str, tuple[Any, float]] = {
    "a": (("<i2", 32), 1.0),
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "g": ("<f2", 1.0),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "c": ("<i2", 1e-2),
    "C": ("<u2", 1e-2),
    "e": ("<i4", 1e-2),
    "E": ("<u4", 1e-2),
    "L": ("<i4", 1e-7),
    "M": ("u1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}
"""By letter: the kind of number, and what a stored number is multiplied by."""


@dataclass(frozen=True)
class Messages:
    """All messages of one type.

    Parameters
    ----------
    name : str
    fields : mapping of str to ndarray, shape (n,) or (n, 32)
        Numbers in the unit of the message, texts as bytes.
    at : ndarray of int, shape (n,)
        Where in the file each begins.
    """

    name: str
    fields: Mapping[str, NDArray[Any]]
    at: NDArray[np.int64]

    def numbers(self, field: str) -> Array:
        """A field as numbers, shape (n,); not numbers where the messages have no such field."""
        values = self.fields.get(field)
        return np.full(self.at.size, np.nan) if values is None else np.asarray(values, np.float64)

    def where(self, chosen: NDArray[np.bool_]) -> Messages:
        """Some of the messages."""
        return Messages(self.name, {k: v[chosen] for k, v in self.fields.items()}, self.at[chosen])


@dataclass(frozen=True)
class _Format:
    name: str
    length: int
    letters: str
    columns: tuple[str, ...]

    @staticmethod
    def of(data: bytes) -> tuple[int, _Format]:
        """The type that the content of a `FMT` message describes, and its fields."""
        name, letters, columns = (
            data[a:b].split(b"\0")[0].decode("ascii", "replace") for a, b in ((2, 6), (6, 22), (22, 86))
        )
        return data[0], _Format(name, data[1], letters, tuple(c.strip() for c in columns.split(",")))

    def dtype(self) -> np.dtype[Any] | None:
        """The kinds of its fields; None where it contradicts itself."""
        if len(self.letters) != len(self.columns) or not set(self.letters) <= set(KINDS):
            return None
        if len(set(self.columns)) != len(self.columns) or not all(self.columns):
            return None
        parts = [
            (c, *np.atleast_1d(KINDS[k][0]).tolist()) for k, c in zip(self.letters, self.columns, strict=True)
        ]
        kind = np.dtype(
            [("", "V3"), *((p[0], p[1]) if len(p) == 2 else (p[0], p[1], (int(p[2]),)) for p in parts)]
        )
        return kind if kind.itemsize == self.length else None


def messages(data: bytes) -> tuple[dict[str, Messages], int]:
    """Every message of a DataFlash log, by name, and how many bytes belong to none.

    Parameters
    ----------
    data : bytes
        The file.

    Returns
    -------
    found : dict of str to Messages
    skipped : int
        Bytes that are no message: damage, or a last message that is cut off.
    """
    formats: dict[int, _Format] = {FMT: _Format("FMT", FMT_LENGTH, "", ())}
    places: dict[int, list[int]] = {}
    at, skipped, size = 0, 0, len(data)
    while at + 3 <= size:
        known = formats.get(data[at + 2]) if data[at : at + 2] == HEAD else None
        if known is None or at + known.length > size:
            after = data.find(HEAD, at + 1)
            after = size if after < 0 else after
            skipped, at = skipped + after - at, after
            continue
        if data[at + 2] == FMT:
            kind, described = _Format.of(data[at + 3 : at + FMT_LENGTH])
            if described.length >= 3 and kind != FMT:
                formats.setdefault(kind, described)
        else:
            places.setdefault(data[at + 2], []).append(at)
        at += known.length
    raw = np.frombuffer(data, np.uint8)
    found = {formats[k].name: m for k, where in places.items() if (m := _decoded(formats[k], raw, where))}
    return found, skipped + size - at


def _decoded(described: _Format, raw: NDArray[np.uint8], where: list[int]) -> Messages | None:
    kind = described.dtype()
    if kind is None:
        return None
    at = np.asarray(where, np.int64)
    rows = np.ascontiguousarray(raw[at[:, None] + np.arange(described.length)]).view(kind)[:, 0]
    fields = {}
    for letter, column in zip(described.letters, described.columns, strict=True):
        factor = KINDS[letter][1]
        fields[column] = rows[column] if factor == 1.0 else rows[column].astype(np.float64) * factor
    return Messages(described.name, fields, at)
