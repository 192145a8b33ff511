"""`Conversion`: noise parameters as a program that consumes them wants them, and what each consumer calls B."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import kfgen
from kfgen.consumers.base import Value
from kfgen.consumers.table import labelled, plain
from kfgen.core.result import Result, ShortTable
from kfgen.effects.noise_model import NoiseModel


@dataclass(frozen=True, repr=False)
class Conversion(Result):
    """A consumer's file, and its parameters by name.

    Parameters
    ----------
    text : str
        The file.
    values : mapping of str to Value
        The consumer's own parameters.
    warnings : tuple of str
        What was not identified, and what a convention cannot say.
    noise : NoiseModel
        Where they come from.
    consumer, title, convention : str
        Its key, its name, and where its convention was read.
    rate : float or None
        The rate [Hz] that its numbers depend on.
    safety : float
        Multiplies every size.
    source, sha256 : str
        The noise file, empty where there is none.
    missing : tuple of str
        Parameters that the consumer cannot do without and that were not identified.
    """

    text: str
    values: Mapping[str, Value]
    warnings: tuple[str, ...]
    noise: NoiseModel
    consumer: str
    title: str
    convention: str
    rate: float | None = None
    safety: float = 1.0
    source: str = ""
    sha256: str = ""
    missing: tuple[str, ...] = ()

    def summary(self) -> list[str]:
        """For which program, and how many parameters were identified."""
        known = sum(bool(v.numbers) for v in self.values.values())
        return [f"{self.title}: {known} of {len(self.values)} parameters identified", *self.warnings[:4]]

    def short_table(self) -> ShortTable:
        """Parameters, their values and how they come about."""
        return ("parameter", "value", "from"), [[name, v.shown, v.words] for name, v in self.values.items()]

    def to_dict(self) -> dict[str, Any]:
        """The parameters in the consumer's units, every meaning of B, the text."""
        return {
            "format": "kfgen-convert-1",
            "kfgen": kfgen.__version__,
            "consumer": self.consumer,
            "noise": self.source,
            "sha256": self.sha256,
            "rate_hz": self.rate,
            "safety": self.safety,
            "source": self.convention,
            "parameters": {name: self._entry(v) for name, v in self.values.items()},
            "meanings": self._meanings(),
            "text": self.text,
            "missing": list(self.missing),
            "warnings": list(self.warnings),
        }

    def _entry(self, v: Value) -> dict[str, Any]:
        number: Any = None if not v.numbers else v.numbers[0] if len(v.numbers) == 1 else list(v.numbers)
        return {"value": number, "unit": v.unit, "from": v.words, "source": self.convention}

    def _meanings(self) -> dict[str, Any]:
        """The numbers of each term, times the safety factor, by channel, term and name."""
        found: dict[str, Any] = {}
        for name, channel in self.noise.channels.items():
            for label, term in labelled(channel):
                titles = {m.name: m for m in term.effect.meanings}
                called = term.effect.called(channel.unit)
                if called:
                    entry: dict[str, Any] = {
                        m: {
                            "value": self.safety * v,
                            "unit": plain(u),
                            "meaning": titles[m].title,
                            "users": titles[m].users,
                        }
                        for m, (v, u) in called.items()
                    }
                    times = {p.name for p in term.effect.parameters() if p.kind == "time"}
                    row = term.effect.row(channel.unit)
                    entry |= {t: {"value": row[t][0], "unit": row[t][1]} for t in sorted(times)}
                    found.setdefault(name, {})[label] = entry
        return found
