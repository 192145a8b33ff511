"""The verb `list_all`: everything in the package that has a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import kfgen
from kfgen.arma.estimate import estimators
from kfgen.consumers import consumers
from kfgen.core.result import Result, ShortTable
from kfgen.effects import catalogue
from kfgen.emit import targets
from kfgen.log.readers.known import folder_readers, readers
from kfgen.manoeuvre.library import LIBRARY as MANOEUVRES
from kfgen.model.library import LIBRARY, option_rows
from kfgen.model.parts.sensors import sensors
from kfgen.run.adaptive.rules import rules
from kfgen.verify.compare import cores


@dataclass(frozen=True, repr=False)
class Catalogue(Result):
    """Names with their meaning.

    Parameters
    ----------
    groups : mapping of str to sequence of (str, str)
        ``models``, ``sensors``, ``options``, ``effects``, ``manoeuvres``, ``targets``, ``cores``, ``consumers``,
        ``filters``, ``estimators`` and ``formats``: the name and the meaning of each entry. An option that means another thing
        in another model has several entries.
    """

    groups: Mapping[str, Sequence[tuple[str, str]]]

    def summary(self) -> list[str]:
        """How many there are of each."""
        return [", ".join(f"{len(entries)} {group}" for group, entries in self.groups.items())]

    def short_table(self) -> ShortTable:
        """Every name, by group."""
        names = {group: dict.fromkeys(n for n, _ in entries) for group, entries in self.groups.items()}
        return ("group", "names"), [[group, ", ".join(own)] for group, own in names.items()]

    def to_dict(self) -> dict[str, Any]:
        """Meanings by group and name."""
        entries = {group: dict(own) for group, own in self.groups.items()}
        return {"format": "kfgen-list-1", "kfgen": kfgen.__version__, **entries}


def list_all() -> Catalogue:
    """Library models, sensors, options, effects, manoeuvres, targets, cores, consumers, adaptive filters, estimators, formats."""
    return Catalogue(
        {
            "models": [(n, e.title) for n, e in LIBRARY.items()],
            "sensors": [(n, s.title) for n, s in sensors().items()],
            "options": option_rows(),
            "effects": [(n, e.title) for n, e in catalogue().items()],
            "manoeuvres": [(n, m.title) for n, m in MANOEUVRES.items()],
            "targets": [(n, t.TITLE) for n, t in targets().items()],
            "cores": list(cores().items()),
            "consumers": [(n, c.TITLE) for n, c in consumers().items()],
            "filters": [(n, c.title) for n, c in rules().items()],
            "estimators": [(n, c.title) for n, c in estimators().items()],
            "formats": [
                *((n, (m.__doc__ or "").split(".\n")[0].splitlines()[0]) for n, m in readers().items()),
                *(("folder", m.FOLDER) for m in folder_readers()),
            ],
        }
    )
