"""How the effects of channels become states of a filter.

Every effect appends its states. Those that it shares (a bias, in which constants, random walks
and ramps of one channel gather and cannot be told apart) are one state per channel, whose
driving noises add.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import sympy as sp

from kfgen.core.units import derived_unit
from kfgen.effects import Effect, LinearSystem
from kfgen.effects.linear_system import initial_covariance


@dataclass(frozen=True)
class StateInfo:
    """One component of the error state.

    Parameters
    ----------
    name, unit, title : str
        SI unit; in words.
    prior : float
        Deviation before the first measurement [SI].
    start : float
        The estimate before it, of an effect's state [SI].
    """

    name: str
    unit: str
    title: str
    prior: float
    start: float = 0.0

    @property
    def symbol(self) -> sp.Symbol:
        """The nominal symbol (of an effect's state)."""
        return sp.Symbol(self.name, real=True)

    @property
    def error(self) -> sp.Symbol:
        """The error symbol."""
        return sp.Symbol(f"d_{self.name}", real=True)


@dataclass(frozen=True)
class Attached:
    """One effect on one channel: its form, its states in the filter, and which of them it brought."""

    channel: str
    effect: Effect
    form: LinearSystem
    states: tuple[int, ...]
    brought: tuple[bool, ...]


class Attachment:
    """Gathers effects one after the other.

    Parameters
    ----------
    letters : mapping of str to str
        Name of the bias state of channels that have one by custom.
    drive : mapping of str to Symbol
        Drivers by name.
    offset : int
        Index of the first effect's state in the filter.
    """

    def __init__(self, letters: Mapping[str, str], drive: Mapping[str, sp.Symbol], offset: int) -> None:
        self.letters = letters
        self.drive = drive
        self.offset = offset
        self.states: list[StateInfo] = []
        self.effects: list[Attached] = []
        self._bias: dict[str, int] = {}

    def add(self, channel: str, unit: str, effect: Effect) -> None:
        """Attach an effect to a channel."""
        form = effect.form(self.drive)
        places, brought = [], []
        for k, prior in enumerate(_priors(effect, form)):
            state = form.states[k]
            known = self._bias.get(channel) if state.shared else None
            if known is None:
                stem = (
                    self.letters.get(channel, f"b_{channel}") if state.shared else f"{channel}_{state.name}"
                )
                title = f"{channel} {'bias' if state.shared else effect.title}"
                self.states.append(
                    StateInfo(
                        self._unique(stem), derived_unit(state.unit, unit), title, prior, float(form.x0[k])
                    )
                )
            else:
                old = self.states[known]
                self.states[known] = replace(
                    old, prior=max(old.prior, prior), start=old.start + float(form.x0[k])
                )
            place = len(self.states) - 1 if known is None else known
            if state.shared:
                self._bias[channel] = place
            places.append(self.offset + place)
            brought.append(known is None)
        self.effects.append(Attached(channel, effect, form, tuple(places), tuple(brought)))

    def _unique(self, stem: str) -> str:
        taken = {s.name for s in self.states}
        return next(n for n in (stem, *(f"{stem}{i}" for i in range(2, 1000))) if n not in taken)


def _priors(effect: Effect, form: LinearSystem) -> list[float]:
    """Deviation of each state before the first measurement [SI]."""
    if not form.order:
        return []
    spread = initial_covariance(form)
    priors = []
    for i, state in enumerate(form.states):
        known = float(getattr(effect, "sd", 0.0)) if state.shared else 0.0
        priors.append(max(float(spread[i, i]) ** 0.5, known, abs(float(form.x0[i]))))
    return priors
