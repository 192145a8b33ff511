"""`Constant`: a number of a filter that firmware may set."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp


@dataclass(frozen=True)
class Constant:
    """A number of the model that firmware may set: name, SI unit, default, meaning."""

    name: str
    unit: str
    value: float
    title: str

    @property
    def symbol(self) -> sp.Symbol:
        """Its symbol."""
        return sp.Symbol(self.name, real=True)
