"""The parts of the supervisor that an emission may leave out, by name."""

from __future__ import annotations

from collections.abc import Iterable

from kfgen.core.errors import InputError

REST, BIASES = "rest", "biases"
PARTS = {
    REST: "finds out that the body rests, and fuses v = 0 then; of a filter with the sensor zero_velocity",
    BIASES: "holds biases at the bound of their sensor, and says so",
}
"""What each of them does."""


def checked(without: Iterable[str]) -> tuple[str, ...]:
    """The parts that are left out, each once, in the order of `PARTS`.

    Raises
    ------
    InputError
        There is no part of that name.
    """
    left_out = set(without)
    unknown = sorted(left_out - PARTS.keys())
    if unknown:
        raise InputError(
            f"there is no part '{unknown[0]}' to leave out",
            where="--without",
            remedy=f"Known are {', '.join(PARTS)}",
        )
    return tuple(p for p in PARTS if p in left_out)
