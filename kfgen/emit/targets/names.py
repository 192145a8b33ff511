"""Names that code can carry: no keyword, nothing that differs from another by case only."""

from __future__ import annotations

import keyword
import re

from sympy.printing import c, cxx

from kfgen.core.errors import InputError
from kfgen.model.discretise import DiscreteModel

C_WORDS = frozenset(
    {*c.reserved_words, *c.reserved_words_c99, "_Bool", "_Complex", "_Imaginary"} - {"entry"}
) | {"bool", "true", "false", "main"}
"""Keywords of C99, and what its headers and programs make one."""
SHADOWING = frozenset(["enum", "filterpy", "math", "numpy", "selftest", "sys", "typing"])
"""Modules that an emitted one of the same name would hide from its own folder."""
CLASSES = frozenset(["any", "f", "real", "status", "vector"])
"""Models whose class would hide another one of the emitted module."""
OWN = {
    "model": SHADOWING | CLASSES,
    "state": frozenset(["covariance", "innovation", "nis", "state", "variance"]),
}
"""Names that the emitted code has for itself: modules and classes, and what its getters end in."""
CPP_WORDS = frozenset().union(
    *cxx.reserved.values(), ("catch", "char8_t", "concept", "consteval", "constinit", "requires")
)
"""Keywords of C++, with those of C++20."""


def identifier(name: str) -> str:
    """A name with everything but letters, digits and underscores replaced."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def check_names(discrete: DiscreteModel) -> None:
    """Refuse names that are no names in C or Python, or that fall together.

    Raises
    ------
    InputError
        A keyword, a name that begins with a digit, or two that differ by case only.
    """
    model = discrete.model
    families = {
        "model": [model.name],
        "state": list(dict.fromkeys([*(s.name for s in model.states), *discrete.nominal_names])),
        "sensor": [s.name for s in model.sensors],
        "channel": list(dict.fromkeys([*model.channel_units, *model.drivers])),
        "constant": [c.name for c in model.constants],
    }
    for family, names in families.items():
        seen: dict[str, str] = {}
        for name in names:
            word = identifier(name)
            if (
                word.lower() in OWN.get(family, ())
                or word in C_WORDS
                or keyword.iskeyword(word)
                or not word
                or word[0].isdigit()
            ):
                raise InputError(
                    f"'{name}' cannot be the name of a {family} in emitted C and Python",
                    where=model.name,
                    remedy="Give it another name",
                )
            other = seen.setdefault(word.lower(), name)
            if other != name:
                raise InputError(
                    f"the {family} names '{other}' and '{name}' are one in code, or differ by case only",
                    where=model.name,
                    remedy="Rename one of them",
                )


RESERVED = frozenset(
    [
        "dt",
        "z",
        "x",
        "P",
        "UD",
        "k",
        "kf",
        "status",
        "gain",
        "dx",
        "fused",
        "kept",
        "due",
        "why",
        "ahead",
        "spread",
        "tilted",
        "heading",
        "sum_P",
        "weight",
        "held",
        "any_held",
        "nis",
        "health",
        "innovation",
        "variance",
        "ring",
        "queue",
        "horizon",
        "present",
        "age",
        "span",
        "place",
        "same",
        "younger",
        "later",
        "when",
        "part",
        "rest",
        "left",
        "bound",
        "soonest",
        "follow",
        "lag",
        "row",
        "free",
        "number",
        "turn",
        "waiting",
    ]
)
"""What the emitted routines call their own; their other locals are short or end in a number or underscore."""


def argument(name: str) -> str:
    """The name of a channel as an argument: one that cannot meet a local of the routine."""
    own = name in RESERVED | CPP_WORDS or re.fullmatch(r"[A-Za-z]{1,2}|.*[0-9_]", name)
    return f"{name}_in" if own else name
