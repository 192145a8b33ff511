"""Whether the elements of a MAT file (v5 to v7) fit into one another: scipy trusts what they say of themselves.

A tag that names a type which does not exist, or more bytes than there are, ends the whole process in scipy's compiled
reader, so that every tag is looked at first [1]_.

References
----------
.. [1] The MathWorks, MAT-File Format, 2024, "Level 5 MAT-File Format".
"""

from __future__ import annotations

import struct
import zlib
from mmap import mmap

Bytes = bytes | mmap

HEADER_BYTES, TAG_BYTES = 128, 8
PLAIN = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18})
"""Types of elements that hold numbers or letters."""
MATRIX, COMPRESSED = 14, 15
FLAGS_TYPE, FLAGS_BYTES = 6, 8
SIZES_TYPE, NAME_TYPES = 5, frozenset({1, 2, 16})
OPAQUE_CLASS = 17
"""Of objects of MATLAB, which have names and no sizes."""
MAX_DIMENSIONS = 32
MAX_DEPTH = 32
MAX_INFLATED_BYTES = 1 << 31


def check_elements(data: Bytes) -> None:
    """Refuse a file whose elements do not fit.

    Parameters
    ----------
    data : bytes or mmap
        The whole file.

    Raises
    ------
    ValueError
        The file is cut off or damaged; the byte is said.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[HEADER_BYTES - 2 : HEADER_BYTES])
    if order is None:
        raise ValueError(f"byte {HEADER_BYTES - 2} says no order of bytes")
    _check(data, HEADER_BYTES, len(data), order, 0)


def _tag(data: Bytes, at: int, end: int, order: str) -> tuple[int, int, int, int]:
    """Type of the element at a byte, where its data begin and end, and where the next begins."""
    if end - at < TAG_BYTES:
        raise ValueError(f"it is cut off at byte {at}")
    kind, size = struct.unpack_from(order + "II", data, at)
    begin = at + TAG_BYTES
    if kind >> 16:  # a small element: its data are in the tag
        kind, size, begin = kind & 0xFFFF, kind >> 16, at + 4
        if size > 4:
            raise ValueError(f"a small element of {size} bytes at byte {at}")
    stop = begin + size
    following = at + TAG_BYTES if begin == at + 4 else stop if kind == COMPRESSED else stop + -size % 8
    if stop > end or not (kind in PLAIN or kind in (MATRIX, COMPRESSED)):
        raise ValueError(f"an element of type {kind} with {size} bytes at byte {at}")
    return kind, begin, stop, following


def _check(data: Bytes, at: int, end: int, order: str, depth: int) -> None:
    """Look at every element between two bytes, and inside them."""
    if depth > MAX_DEPTH:
        raise ValueError(f"matrices within matrices at byte {at}")
    while at < end:
        kind, begin, stop, following = _tag(data, at, end, order)
        if kind == COMPRESSED and depth == 0:
            _check_inflated(data[begin:stop], order, at)
        elif kind == MATRIX and stop > begin:
            _check_matrix(data, begin, stop, order, depth)
        elif (depth == 0 and kind != MATRIX) or kind == COMPRESSED:
            raise ValueError(f"an element of type {kind} at byte {at}")
        at = following


def _check_inflated(packed: bytes, order: str, at: int) -> None:
    try:
        inside = zlib.decompressobj().decompress(packed, MAX_INFLATED_BYTES)
    except zlib.error:
        raise ValueError(f"what is compressed at byte {at} is damaged") from None
    _check(inside, 0, len(inside), order, 1)


def _check_matrix(data: Bytes, at: int, end: int, order: str, depth: int) -> None:
    """Flags, sizes and name of an array, and then what it holds."""
    kind, begin, stop, at = _tag(data, at, end, order)
    if kind != FLAGS_TYPE or stop - begin != FLAGS_BYTES:
        raise ValueError(f"an array without flags at byte {begin}")
    if struct.unpack_from(order + "I", data, begin)[0] & 0xFF == OPAQUE_CLASS:
        return _check(data, at, end, order, depth + 1)
    kind, begin, stop, at = _tag(data, at, end, order)
    count = (stop - begin) // 4
    if kind != SIZES_TYPE or (stop - begin) % 4 or not 2 <= count <= MAX_DIMENSIONS:
        raise ValueError(f"an array without sizes at byte {begin}")
    if min(struct.unpack_from(f"{order}{count}i", data, begin)) < 0:
        raise ValueError(f"an array of negative size at byte {begin}")
    kind, begin, _, at = _tag(data, at, end, order)
    if kind not in NAME_TYPES:
        raise ValueError(f"an array without a name at byte {begin}")
    _check(data, at, end, order, depth + 1)
