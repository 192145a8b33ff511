"""Rank modulo one prime, in 64 bits: leaves few states and orders to the exact answer, which is far more work.

Residues are kept between -p/2 and p/2, so that sums of `MAX_PRODUCTS_IN_A_SUM` products fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Whole = NDArray[np.int64]

MAX_PRODUCTS_IN_A_SUM = 120
"""Products of residues below 2^28 that a signed 64-bit sum holds."""


def centred(A: Whole, p: int) -> Whole:
    """Residues of least size.

    Parameters
    ----------
    A : ndarray of int64
    p : int
        The prime.
    """
    out: Whole = (A + p // 2) % p - p // 2
    return out


def product(A: Whole, B: Whole, p: int) -> Whole:
    """``A B`` modulo p, for residues of least size.

    Parameters
    ----------
    A : ndarray of int64, shape (l, m)
    B : ndarray of int64, shape (m, n)
    p : int
        The prime, below 2^29.
    """
    if A.shape[1] <= MAX_PRODUCTS_IN_A_SUM:
        return centred(A @ B, p)
    total = np.zeros((A.shape[0], B.shape[1]), dtype=np.int64)
    for k in range(0, A.shape[1], MAX_PRODUCTS_IN_A_SUM):
        total = centred(
            total + centred(A[:, k : k + MAX_PRODUCTS_IN_A_SUM] @ B[k : k + MAX_PRODUCTS_IN_A_SUM], p), p
        )
    return total


class Echelon:
    """A row space modulo p that grows, in reduced echelon form."""

    def __init__(self, columns: int, p: int) -> None:
        self.p = p
        self.rows: Whole = np.zeros((0, columns), dtype=np.int64)
        self.pivots: list[int] = []

    @property
    def rank(self) -> int:
        """Its dimension."""
        return len(self.pivots)

    def add(self, rows: Whole) -> bool:
        """Take rows in; whether the rank has grown."""
        before = self.rank
        if before:
            rows = centred(rows - product(rows[:, self.pivots], self.rows, self.p), self.p)
        for k in range(rows.shape[0]):
            self._take(rows[k], rows[k + 1 :])
        return self.rank > before

    def _take(self, row: Whole, others: Whole) -> None:
        at = np.flatnonzero(row)
        if not at.size:
            return
        c = int(at[0])
        row = centred(row * pow(int(row[c]), -1, self.p), self.p)
        others -= centred(np.outer(others[:, c], row), self.p)
        others[:] = centred(others, self.p)
        self.rows = centred(self.rows - centred(np.outer(self.rows[:, c], row), self.p), self.p)
        self.rows = np.vstack([self.rows, row])
        self.pivots.append(c)

    @property
    def unobservable_columns(self) -> list[int]:
        """The columns in which a null vector may differ from zero."""
        if self.rank == self.rows.shape[1]:
            return []
        free = [c for c in range(self.rows.shape[1]) if c not in self.pivots]
        mixed = [p for p, row in zip(self.pivots, self.rows) if row[free].any()]
        return sorted(free + mixed)


def coefficient(
    entries: Sequence[tuple[int, int, list[int]]], k: int, shape: tuple[int, int], p: int
) -> Whole:
    """Coefficient k of a matrix of power series.

    Parameters
    ----------
    entries : sequence of (row, column, list of int)
        Entries that are not zero, with their power series.
    k : int
        The order.
    shape : (int, int)
        Of the matrix.
    p : int
        The prime.
    """
    out = np.zeros(shape, dtype=np.int64)
    for i, j, series in entries:
        out[i, j] = series[k]
    return centred(out, p)
