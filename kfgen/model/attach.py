"""How the effects of channels become states, noise and outputs of a filter.

Every effect says its role (`kfgen.effects.filter_role`). A linear process appends its states; those that it shares (a bias, in
which constants, random walks and ramps of one channel gather and cannot be distinguished) are one state per channel,
whose driving noises add. What follows a driver is a known output, or one constant state. Changes of readings are
`kfgen.model.parts.attached_error`. What no filter models is an `Omission`, which every command says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import sympy as sp

from kfgen.core.units import derived_unit, parse_unit
from kfgen.effects import Effect, LinearSystem
from kfgen.effects.filter_role import (
    DrivenOutput,
    LinearStates,
    NoiseFactor,
    SampleVariance,
    SharedNoise,
    Use,
)
from kfgen.effects.linear_system import State, initial_covariance
from kfgen.model.parts.constant import Constant
from kfgen.model.register import DT, Register


class Omission(NamedTuple):
    """An effect that a filter is built without.

    Parameters
    ----------
    where, effect : str
        Channel or sensor; name of the effect.
    why, instead : str
        Why no filter models it there, and what to do instead.
    """

    where: str
    effect: str
    why: str
    instead: str

    @property
    def sentence(self) -> str:
        """In words."""
        return f"{self.effect} of {self.where} is not in the filter: {self.why}. {self.instead}"


@dataclass(frozen=True)
class StateInfo:
    """One component of the error state.

    Parameters
    ----------
    name, unit, title : str
        SI unit; in words.
    prior : float
        Standard deviation before the first measurement [SI].
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
    """One effect on one channel: its linear system, its states in the filter, and which of them it brought."""

    channel: str
    effect: Effect
    form: LinearSystem
    states: tuple[int, ...]
    brought: tuple[bool, ...]


@dataclass(frozen=True)
class KnownOutput:
    """What a driver gives a channel, corrected by its value: coefficient times course."""

    channel: str
    expression: sp.Expr
    constant: Constant


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
        self.outputs: list[KnownOutput] = []
        self.registers: list[Register] = []
        self.factors: dict[str, sp.Expr] = {}
        self.extra: dict[str, sp.Expr] = {}
        self.shared: dict[str, sp.Expr] = {}
        self.sampled: set[str] = set()
        self._bias: dict[str, int] = {}

    def add_states(self, channel: str, unit: str, effect: Effect, role: LinearStates, use: Use) -> None:
        """Attach a linear process to a channel in an SI unit."""
        self._append(channel, unit, effect, role.system, _priors(effect, role.system, use))

    def add_output(self, channel: str, unit: str, effect: Effect, role: DrivenOutput, use: Use) -> None:
        """Attach what follows a driver: known, a constant of the filter; else one state with its value as mean."""
        stem = effect.name.replace(":", "_")
        driver, stored = self.drive[role.driver], sp.Integer(0)
        if role.stored is not None:
            value = role.stored
            stored = sp.Symbol(f"{channel}_{stem}_{value.name}", real=True)
            after = value.after(stored, driver, DT)
            self.registers.append(Register(str(stored), value.unit, value.title, after, value.driver))
        course, coefficient = role.course(driver, stored), float(effect.values[0])
        template = {p.name: p.unit for p in effect.parameters()}[effect.coefficients()[0]]
        if use.known:
            own = parse_unit(derived_unit(template, unit)).si
            constant = Constant(f"{channel}_{stem}", own, coefficient, f"{effect.title} of {channel}")
            self.outputs.append(KnownOutput(channel, constant.symbol * course, constant))
            return
        system = LinearSystem(((0,),), ((0,),), (course,), x0=(coefficient,), states=(State(stem, template),))
        sd = use.sd.get(effect.coefficients()[0], 0.0) or abs(coefficient)
        self._append(channel, unit, effect, system, [sd])

    def scale_noise(self, channel: str, role: NoiseFactor | SampleVariance | SharedNoise) -> None:
        """Change the white noise of a channel."""
        if isinstance(role, NoiseFactor):
            self.factors[channel] = self.factors.get(channel, sp.Integer(1)) * sp.sympify(
                role.factor, strict=True
            )
        elif isinstance(role, SampleVariance):
            self.extra[channel] = self.extra.get(channel, sp.Integer(0)) + sp.sympify(
                role.variance, strict=True
            )
            self.sampled |= {channel} if role.alone else set()
        else:
            self.shared[channel] = sp.sympify(role.rho, strict=True)

    def dynamics(self) -> tuple[sp.Matrix, sp.Matrix]:
        """Dynamics A and driving density W of the states, shape (m, m)."""
        m = len(self.states)
        A, W = sp.zeros(m, m), sp.zeros(m, m)
        for effect in self.effects:
            places = [k - self.offset for k in effect.states]
            for i, k in enumerate(places):
                for j, l in enumerate(places):
                    W[k, l] += sp.sympify(effect.form.W[i][j], strict=True)
                    A[k, l] += sp.sympify(effect.form.A[i][j], strict=True)
        return A, W

    def _append(
        self, channel: str, unit: str, effect: Effect, form: LinearSystem, priors: list[float]
    ) -> None:
        places, brought = [], []
        for k, prior in enumerate(priors):
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
        used = {s.name for s in self.states}
        return next(n for n in (stem, *(f"{stem}{i}" for i in range(2, 1000))) if n not in used)


def _priors(effect: Effect, form: LinearSystem, use: Use) -> list[float]:
    """Standard deviation of each state before the first measurement [SI]."""
    if not form.order:
        return []
    spread = initial_covariance(form)
    priors = []
    stated = max(use.sd.values(), default=0.0) if not use.known else 0.0
    for i, state in enumerate(form.states):
        known = float(getattr(effect, "sd", 0.0)) if state.shared else 0.0
        start = abs(float(form.x0[i]))
        priors.append(max(float(spread[i, i]) ** 0.5, known, (stated or start) if start else 0.0))
    return priors
