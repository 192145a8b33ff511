"""The loops over samples, compiled by numba (the extra ``kfgen[fast]``); import this file late.

The machine code is kept on disk (in ``__pycache__``, or where ``NUMBA_CACHE_DIR`` says) where that can be
written: compiling takes about a second, reading it back some milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Steps = NDArray[np.int64]

if numba.config.DISABLE_JIT:
    raise ImportError("numba is told not to compile: vectors of numpy are faster than loops of Python")


def _compiled(function: Callable[..., Any], signature: str, **options: object) -> Callable[..., Any]:
    """`function` as machine code, kept on disk where possible."""
    try:
        made = numba.njit(signature, nogil=True, cache=True, **options)(function)
    except (RuntimeError, OSError):  # no folder can be written
        made = numba.njit(signature, nogil=True, **options)(function)
    return made  # type: ignore[no-any-return]


def _accumulate(y: Array, rate: float) -> None:
    total = 0.0
    for i in range(y.size):
        total += y[i] - rate
        y[i] = total


def _squares(x: Array, done: int, steps: Steps) -> Array:
    """Three slices with one index: shifted indices could wrap around and are not vectorised."""
    out = np.zeros(steps.size)
    for k in range(steps.size):
        m = steps[k]
        part = x[max(0, done - 2 * m) :]
        count = max(0, part.size - 2 * m)
        a, b, c = part[:count], part[m : m + count], part[2 * m : 2 * m + count]
        total = 0.0
        for i in range(count):
            d = (c[i] - b[i]) - (b[i] - a[i])
            total += d * d
        out[k] = total
    return out


_ACCUMULATE = _compiled(_accumulate, "void(float64[::1], float64)")
_SQUARES = _compiled(_squares, "float64[::1](float64[::1], int64, int64[::1])", fastmath={"reassoc"})


class CompiledKernel:
    """See `kfgen.identify.evidence.differences.Kernel`."""

    def accumulate(self, y: Array, rate: float) -> None:
        """See `kfgen.identify.evidence.differences.Kernel`."""
        _ACCUMULATE(y, rate)

    def squares(self, x: Array, done: int, steps: Steps) -> Array:
        """See `kfgen.identify.evidence.differences.Kernel`."""
        return np.asarray(_SQUARES(x, done, steps), dtype=np.float64)
