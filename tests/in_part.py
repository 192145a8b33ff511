"""What a test is tried on, in part: `make test` takes the first few, `make test-long` all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def in_part(values: Iterable[Any], count: int = 1) -> list[Any]:
    """The values of a parameter, the first few in every run.

    Parameters
    ----------
    values : iterable
        Of one parameter, or a tuple for several; one that is marked stays so.
    count : int
        That are in every run, beside those that are marked.

    Returns
    -------
    list
    """
    out = []
    for value in values:
        count -= not (is_marked := hasattr(value, "marks"))
        out.append(
            value if is_marked or count >= 0 else pytest.param(*_values(value), marks=pytest.mark.long)
        )
    return out


def _values(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)
