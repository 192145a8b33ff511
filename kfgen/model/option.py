"""Options of models and sensors: declared once as data, read from text.

A model's motion and its sensors declare a tuple of `Option`; ``kfgen list`` prints them, ``--set name=value``
chooses, and an unknown name is refused with those that are known.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

from kfgen.core.errors import InputError
from kfgen.core.units import parse_quantity

STATE = "state"
"""The value of an option that is unknown and therefore a state of the filter."""
NOTHING: Mapping[str, Any] = MappingProxyType({})
"""No choice made: the defaults."""


class Kind:
    """What values an option takes."""

    @property
    def words(self) -> str:
        """The values in words."""
        raise NotImplementedError

    def read(self, text: str, where: str) -> Any:
        """The value; raises `InputError`."""
        raise NotImplementedError


@dataclass(frozen=True)
class YesNo(Kind):
    """Yes or no."""

    @property
    def words(self) -> str:
        """The two words."""
        return "true or false"

    def read(self, text: str, where: str) -> bool:
        """A truth value."""
        if text not in ("true", "false"):
            raise InputError(f"'{text}' is neither true nor false", where=where)
        return text == "true"


@dataclass(frozen=True)
class Choice(Kind):
    """One of some names; files of earlier versions may have other words for them."""

    names: tuple[str, ...]
    earlier: Mapping[str, str] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """The names."""
        return ", ".join(self.names)

    def read(self, text: str, where: str) -> str:
        """The name."""
        text = self.earlier.get(text, text)
        if text not in self.names:
            raise InputError(f"there is no '{text}'", where=where, remedy=f"Known are {self.words}")
        return text


@dataclass(frozen=True)
class Names(Kind):
    """Some of some names, separated by commas."""

    known: tuple[str, ...]

    @property
    def words(self) -> str:
        """The names."""
        return f"of {', '.join(self.known)}"

    def read(self, text: str, where: str) -> tuple[str, ...]:
        """The names, each once, in order."""
        names = tuple(dict.fromkeys(n.strip() for n in text.split(",") if n.strip()))
        for name in names:
            Choice(self.known).read(name, where)
        if not names:
            raise InputError("it names none", where=where, remedy=f"Known are {', '.join(self.known)}")
        return names


@dataclass(frozen=True)
class Quantity(Kind):
    """One number with a unit, or `count` numbers that share one."""

    unit: str
    count: int = 1

    @property
    def words(self) -> str:
        """The unit."""
        of = f" in {self.unit}" if self.unit != "1" else ""
        return f"{self.count} numbers{of}" if self.count > 1 else f"a number{of}"

    def read(self, text: str, where: str) -> tuple[float, ...] | float:
        """The numbers [SI]."""
        parts = text.split()
        values, unit = parts[: self.count], " ".join(parts[self.count :])
        if len(values) < self.count or not all(re.fullmatch(r"[-+.\deE]+", v) for v in values):
            raise InputError(
                f"'{text}' is not {self.count} numbers",
                where=where,
                remedy=f"Write it like '{' '.join(['0.1'] * self.count)} {self.unit}'",
            )
        numbers = [parse_quantity(f"{v} {unit}".strip(), self.unit, where=where) for v in values]
        return tuple(numbers) if self.count > 1 else numbers[0]


@dataclass(frozen=True)
class OrState(Kind):
    """A value that is known, or the word ``state``."""

    known: Kind

    @property
    def words(self) -> str:
        """The kind of the known value, or the word."""
        return f"{self.known.words}, or {STATE}"

    def read(self, text: str, where: str) -> Any:
        """The known value, or `STATE`."""
        return STATE if text == STATE else self.known.read(text, where)


@dataclass(frozen=True)
class Option:
    """A choice that a model or a sensor offers.

    Parameters
    ----------
    name, title : str
    kind : Kind
    default : str
        As a user would write it.
    """

    name: str
    title: str
    kind: Kind
    default: str

    def read(self, text: str) -> Any:
        """The value of a text; raises `InputError` with the place ``--set name``."""
        return self.kind.read(text.strip(), f"--set {self.name}")


class Configured:
    """Something with options: `chosen` holds their values, the defaults where nothing is said.

    Parameters
    ----------
    chosen : mapping of str to value
        Values of some options, as `Option.read` gives them.
    """

    options: ClassVar[tuple[Option, ...]] = ()
    chosen: Mapping[str, Any] = NOTHING

    def __init__(self, chosen: Mapping[str, Any] = NOTHING) -> None:
        own = {o.name: chosen[o.name] if o.name in chosen else o.read(o.default) for o in self.options}
        self.chosen = MappingProxyType(own)


def read_pairs(pairs: Iterable[str], where: str = "--set") -> dict[str, str]:
    """``name=value`` texts of the command line as a mapping; raises `InputError`."""
    found: dict[str, str] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        name = name.strip()
        if not equals or not re.fullmatch(r"\w+", name):
            raise InputError(
                f"'{pair}' is no option", where=where, remedy=f"Write it like {where} name=value"
            )
        if name in found:
            raise InputError(f"{name} is given twice", where=where)
        found[name] = value.strip()
    return found


def read_options(known: Sequence[Option], texts: Mapping[str, str], of: str) -> dict[str, Any]:
    """The values of the options that are given.

    Parameters
    ----------
    known : sequence of Option
    texts : mapping of str to str
    of : str
        Whose options they are, said in errors.

    Raises
    ------
    InputError
        An option that is not among `known`, or a value that it does not take.
    """
    by_name = {o.name: o for o in known}
    for name in texts:
        if name not in by_name:
            raise InputError(
                f"{of} has no option '{name}'",
                where=f"--set {name}",
                remedy=f"It has {', '.join(by_name)}" if by_name else "It has none",
            )
    return {name: by_name[name].read(text) for name, text in texts.items()}
