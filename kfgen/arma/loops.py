"""Compiles loops over samples where numba is installed (the extra ``kfgen[fast]``); else they stay Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any


def fast() -> bool:
    """Whether loops are compiled."""
    try:
        import numba
    except ImportError:
        return False
    return not numba.config.DISABLE_JIT


@cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` as machine code, or itself; it takes numbers, arrays and other compiled functions."""
    if not fast():
        return function
    import numba

    return numba.njit(function)  # type: ignore[no-any-return]
