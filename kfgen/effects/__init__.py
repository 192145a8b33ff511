"""The catalogue: every physical effect that kfgen knows, one class each.

To add an effect, write one class in a file of this package; `catalogue` finds it. Another package brings its own by an entry
point, see `kfgen.core.optional_library`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any

from kfgen.core.errors import InputError
from kfgen.core.optional_library import modules_of_others
from kfgen.effects.driven.history import LAGGED, lagged
from kfgen.effects.driven.noise_level import NOISE_LEVEL, leveled
from kfgen.effects.driven.proportional import COUPLING, coupled, is_plain
from kfgen.effects.effect import Effect, Look, Parameter
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.samples.filtered_spectrum import filtered, sampled_spectrum

__all__ = [
    "Effect",
    "LinearSystem",
    "Look",
    "Parameter",
    "State",
    "catalogue",
    "effect_named",
    "filtered",
    "make",
    "on_trial",
    "sampled_spectrum",
    "tried",
]


OF_CHANNELS = {COUPLING: coupled, LAGGED: lagged, NOISE_LEVEL: leveled}
"""What makes the effect of any channel, by the beginning of its name."""


_ON_TRIAL: set[type[Effect]] = set()
_TRIED: ContextVar[type[Effect] | None] = ContextVar("tried", default=None)


def on_trial(cls: type[Effect]) -> None:
    """Leave a declaration out of the catalogue but where it is `tried`.

    Parameters
    ----------
    cls : type of Effect
    """
    _ON_TRIAL.add(cls)


@contextmanager
def tried(cls: type[Effect]) -> Iterator[None]:
    """The catalogue with a declaration that is on trial.

    Parameters
    ----------
    cls : type of Effect
    """
    before = _TRIED.set(cls)
    try:
        yield
    finally:
        _TRIED.reset(before)


@cache
def _load() -> None:
    for info in pkgutil.walk_packages(__path__, f"{__name__}."):
        importlib.import_module(info.name)
    modules_of_others("effects")


def catalogue() -> dict[str, type[Effect]]:
    """Every declared effect by its name, in order of declaration; of those on trial, the one that is `tried`."""
    _load()
    found: dict[str, type[Effect]] = {}
    queue = list(Effect.__subclasses__())
    while queue:
        cls = queue.pop(0)
        queue.extend(cls.__subclasses__())
        if cls.name and ":" not in cls.name and (cls not in _ON_TRIAL or cls is _TRIED.get()):
            found[cls.name] = cls
    return found


def effect_named(name: str, *, where: str = "") -> type[Effect]:
    """The effect class of that name.

    Raises
    ------
    InputError
        There is none, or the channel that it names is more than letters, digits and underscores.
    """
    known = catalogue()
    prefix, _, channel = name.partition(":")
    if channel and prefix + ":" in OF_CHANNELS:
        if not is_plain(channel):  # it comes to stand in emitted code
            raise InputError(
                f"'{channel}' cannot be the channel of an effect",
                where=where,
                remedy="A channel's name is made of letters, digits and underscores; rename it with --columns",
            )
        return OF_CHANNELS[prefix + ":"](channel)
    if name not in known:
        raise InputError(f"there is no effect '{name}'", where=where, remedy=f"Known are {', '.join(known)}")
    return known[name]


def make(name: str, **values: Any) -> Effect:
    """An effect of that name with these values [SI]."""
    cls: Any = effect_named(name)
    effect: Effect = cls(**values)
    return effect
