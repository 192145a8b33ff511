"""The result of an audit: rank, hidden directions, how well each state shows, and what frees what is hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

import kfgen
from kfgen.audit.degree import PRACTICAL, Degree
from kfgen.audit.numeric import Numeric, numeric
from kfgen.audit.words import amount, called
from kfgen.core.errors import InputError
from kfgen.core.numbers import finite
from kfgen.core.result import Result, ShortTable
from kfgen.core.units import parse_quantity, parse_unit
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.filter import FilterModel

UNDETERMINED = "unobservable"
FAINT = "practically_unobservable"
SEEN = "observable"
UNKNOWN = "unknown"


@dataclass(frozen=True)
class WantedAccuracy:
    """A standard deviation that is asked for: the name of the state, its size [SI], the size as written."""

    state: str
    sigma: float
    written: str

    @staticmethod
    def parse(entry: str, audit: Audit) -> WantedAccuracy:
        """Read ``phi_D=0.1 deg``.

        Parameters
        ----------
        entry : str
            State and standard deviation; without a unit it is in SI.
        audit : Audit
            Whose states are meant.

        Raises
        ------
        InputError
            No such state, or a size that is not positive.
        """
        name, _, value = entry.partition("=")
        names = {n: s for s, n in zip(audit.model.states, audit.names)}
        names |= {s.name: s for s in audit.model.states}
        state = names.get(name.strip())
        if state is None or not value:
            raise InputError(
                f"'{entry}' asks for no state",
                where="--want",
                remedy=f'Write it like "{next(iter(names))}=0.1"; known are {", ".join(dict.fromkeys(audit.names))}',
            )
        sigma = parse_quantity(value.strip(), state.unit, where=f"--want {name.strip()}", offset=False)
        if sigma <= 0.0:
            raise InputError(
                f"a standard deviation of '{value}' is none", where="--want", remedy="Give a positive one"
            )
        return WantedAccuracy(state.name, sigma, value.strip())


@dataclass(frozen=True)
class Direction:
    """A hidden direction.

    Parameters
    ----------
    vector : dict of str to float
        State (body axes called by the navigation axes that they lie along) to amount [SI].
    units : dict of str to str
    sentence : str
    exact : dict of str to str
        The amounts as fractions; empty where they depend on durations or on a generic point.
    formula : dict of str to str
        The amounts in the model's parameters, where nothing changes with time.
    freed_by : tuple of str
        Manoeuvres of the library along which it shows.
    """

    vector: dict[str, float]
    units: dict[str, str]
    sentence: str
    exact: dict[str, str] = field(default_factory=dict)
    formula: dict[str, str] = field(default_factory=dict)
    freed_by: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The states that are hidden together."""
        return " + ".join(self.vector)

    def to_dict(self) -> dict[str, Any]:
        """Its fields."""
        return {
            "vector": self.vector,
            "units": self.units,
            "exact": self.exact,
            "formula": self.formula,
            "sentence": self.sentence,
            "freed_by": list(self.freed_by),
        }


@dataclass(frozen=True)
class Audit:
    """What one manoeuvre hides; `degree` is how well states show, `start` where the model's own blocks start.

    Of a log (`recorded`) the manoeuvre is generic: what that hides, no motion shows.
    """

    model: FilterModel
    manoeuvre: Manoeuvre
    directions: tuple[Direction, ...]
    hidden_states: frozenset[str]
    generic: bool
    start: Mapping[str, float] = field(default_factory=dict)
    degree: Degree | None = None
    recorded: bool = False

    @cached_property
    def numeric(self) -> Numeric:
        """What floating point says where the manoeuvre starts."""
        return numeric(self.model, self.manoeuvre, self.start)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the states; biases of body axes by navigation axes, where these are the same at the start."""
        return tuple(called(self.model, s, self.manoeuvre) for s in self.model.states)

    @property
    def states(self) -> int:
        """Number of error states."""
        return len(self.model.states)

    @property
    def nullity(self) -> int:
        """Number of hidden directions."""
        return len(self.directions)

    @property
    def rank(self) -> int:
        """Number of visible combinations."""
        return self.states - self.nullity

    def verdict(self, k: int) -> str:
        """Of a state: exactly unobservable, practically so, or observable."""
        if self.model.states[k].name in self.hidden_states:
            return UNDETERMINED
        if self.degree is not None and self.degree.sigma[-1, k] > PRACTICAL * self.degree.sigma[0, k]:
            return FAINT
        return SEEN

    def to_dict(self, wanted: Sequence[WantedAccuracy] = ()) -> dict[str, Any]:
        """Rank, hidden directions and every state, in the numbers of the JSON.

        Parameters
        ----------
        wanted : sequence of WantedAccuracy
            When each is reached is said where the covariance ran.
        """
        run = self.degree
        condition = {"raw": finite(self.numeric.condition)}
        out: dict[str, Any] = {
            "states": self.states,
            "rank": self.rank,
            "nullity": self.nullity,
            "recorded": self.recorded,
            "point": "generic" if self.generic else "declared",
            "condition": condition,
            "numeric_rank": self.numeric.rank,
            "directions": [d.to_dict() for d in self.directions],
            "state": {name: self._state(k) for k, name in enumerate(self.names)},
        }
        if run is not None:
            condition["scaled"] = finite(run.condition) if run.singular.size else None
            out["weakest"] = [self.names[k] for k, _ in run.weakest]
            out["sigmas_of_information"] = [finite(float(s)) for s in run.singular]
            out["duration_s"] = float(run.t[-1])
            out["wanted"] = [
                {"state": w.state, "sigma": w.sigma, "reached_s": run.reaches(self.place(w.state), w.sigma)}
                for w in wanted
            ]
        return out

    def place(self, name: str) -> int:
        """The index of a state."""
        return next(k for k, s in enumerate(self.model.states) if s.name == name)

    def _state(self, k: int) -> dict[str, Any]:
        s, run = self.model.states[k], self.degree
        out: dict[str, Any] = {
            "verdict": self.verdict(k),
            "sigma_prior": s.prior,
            "unit": parse_unit(s.unit).text,
        }
        if run is not None:
            out["sigma_end"] = finite(float(run.sigma[-1, k]))
            out["bits_per_minute"] = finite(float(np.round(run.bits_per_minute[k], 12)))
        return out


@dataclass(frozen=True)
class ManoeuvreTable:
    """Which manoeuvre shows which direction of the first one.

    Parameters
    ----------
    manoeuvres : tuple of Manoeuvre
    observable : tuple of tuple of bool or None
        One row a direction, one column a manoeuvre; None where it is not known.
    """

    manoeuvres: tuple[Manoeuvre, ...]
    observable: tuple[tuple[bool | None, ...], ...]

    @property
    def shortest(self) -> Manoeuvre | None:
        """The shortest manoeuvre that makes all observable."""
        columns = zip(self.manoeuvres, zip(*self.observable)) if self.observable else ()
        able = [m for m, column in columns if all(column)]
        return min(able, key=lambda m: m.length, default=None)

    def cells(self, row: Sequence[bool | None]) -> list[str]:
        """A row of `observable` in words."""
        return [UNKNOWN if seen is None else SEEN if seen else UNDETERMINED for seen in row]

    def to_dict(self, directions: Sequence[Direction]) -> dict[str, Any]:
        """The table by the names of manoeuvres, a row for each of the first manoeuvre's directions."""
        rows = [
            {"direction": d.label, "cells": self.cells(row)} for d, row in zip(directions, self.observable)
        ]
        names = [m.name for m in self.manoeuvres]
        return {"manoeuvres": names, "rows": rows, "shortest": self.shortest.name if self.shortest else None}


@dataclass(frozen=True, repr=False)
class Audited(Result):
    """A model's audits along one manoeuvre after the other.

    Parameters
    ----------
    audits : tuple of Audit
        The first one's directions are held against the library of manoeuvres.
    table : ManoeuvreTable or None
        Which manoeuvre frees which of these; None where nothing is hidden.
    lint : tuple of str
        What the model has too much of, in words.
    wanted : tuple of WantedAccuracy
        Standard deviations that were asked for.
    inputs : mapping of str to str
        SHA-256 of the files that were read.
    """

    audits: tuple[Audit, ...]
    table: ManoeuvreTable | None
    lint: tuple[str, ...]
    wanted: tuple[WantedAccuracy, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)

    @property
    def first(self) -> Audit:
        """The first manoeuvre's."""
        return self.audits[0]

    def summary(self) -> list[str]:
        """The rank along each manoeuvre, and the first hidden directions."""
        lines = [
            f"{a.model.name}, {a.manoeuvre.name}: rank {a.rank} of {a.states}, {a.nullity} unobservable directions"
            for a in self.audits[:2]
        ]
        said = [f"{d.sentence}." for d in self.first.directions]
        more = [f"... and {len(said) - 2} more"] if len(said) > 3 else said[2:]
        return [*lines, *said[:2], *more]

    def short_table(self) -> ShortTable:
        """How well each state shows along the first manoeuvre."""
        a = self.first
        rows = []
        for k, (name, s) in enumerate(zip(a.names, a.model.states)):
            end = amount(float(a.degree.sigma[-1, k]), s.unit) if a.degree is not None else ""
            rows.append([name, amount(s.prior, s.unit), end, a.verdict(k).replace("_", " ")])
        return ("state", "prior (1 sigma)", "at the end (1 sigma)", "verdict"), rows

    def to_dict(self) -> dict[str, Any]:
        """Every audit by the name of its manoeuvre, the table, the notes."""
        first = self.first
        return {
            "format": "kfgen-audit-1",
            "kfgen": kfgen.__version__,
            "model": first.model.name,
            "hash": first.model.hash,
            "inputs": dict(self.inputs),
            "manoeuvres": {a.manoeuvre.name: a.to_dict(self.wanted) for a in self.audits},
            "table": self.table.to_dict(first.directions) if self.table is not None else None,
            "notes": list(self.lint),
        }
