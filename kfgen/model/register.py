"""`Register`: numbers that a filter keeps beside its state, exactly known: the last samples of an input, where a backlash stands.

They stand behind the stored state, have no error and no place in the covariance, and take a new value with every step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import sympy as sp

from kfgen.core.errors import InputError

DT = sp.Symbol("dt", positive=True)
"""The step of a filter [s]."""
MAX_DELAY_SAMPLES = 256
"""Samples that a delay line may hold."""
WHOLE_SAMPLE_TOLERANCE = 1e-3
"""Samples that a delay may differ from a whole number of them and still count as one."""


TOUCHING_SHARE_OF_BACKLASH = sp.Float(1e-6)
"""Share of a backlash within which it is used up."""


@dataclass(frozen=True)
class Register:
    """One number.

    Parameters
    ----------
    name, unit, title : str
        SI unit; in words.
    after : sympy expression
        What it is after a step, in what was before it.
    channel : str
        The channel of whose first sample it has the value when a log begins; zero before that.
    """

    name: str
    unit: str
    title: str
    after: sp.Expr
    channel: str

    @property
    def symbol(self) -> sp.Symbol:
        """Its symbol."""
        return sp.Symbol(self.name, real=True)


@dataclass(frozen=True)
class DelayLine:
    """A held input that acts late: its last samples, and which of them act.

    Parameters
    ----------
    channel, unit : str
        SI unit.
    delay : float
        [s], positive.
    """

    channel: str
    unit: str
    delay: float

    @property
    def sentence(self) -> str:
        """What who calls the filter must know."""
        return (
            f"{self.channel} is given as it is sent: the filter keeps it back by {self.delay:.6g} s itself, so that it must "
            "be called once per sample, at the rate that it was made for."
        )

    def _split(self, rate: float) -> tuple[int, float]:
        """Whole samples of the delay, and the share of another one, at a rate [Hz]."""
        whole = math.floor(self.delay * rate + WHOLE_SAMPLE_TOLERANCE)
        part = self.delay * rate - whole
        return whole, part if part > WHOLE_SAMPLE_TOLERANCE else 0.0

    def memories(self, rate: float) -> tuple[Register, ...]:
        """The samples that are kept at a rate [Hz], the youngest first.

        Raises
        ------
        InputError
            They are too many.
        """
        whole, part = self._split(rate)
        count = whole + (part > 0.0)
        if count > MAX_DELAY_SAMPLES:
            raise InputError(
                f"a delay of {self.delay:g} s of {self.channel} is {count} samples at {rate:g} Hz, more than {MAX_DELAY_SAMPLES}",
                where=f"input_delay on {self.channel}",
                remedy=f"Give a --rate of {MAX_DELAY_SAMPLES / self.delay:.4g} Hz or less, or shift {self.channel} before the filter",
            )
        symbols = self._symbols(count)
        ago = [f"{self.channel}, {k} sample{'s' * (k > 1)} ago" for k in range(1, count + 1)]
        return tuple(
            Register(str(new), self.unit, title, old, self.channel)
            for old, new, title in zip(symbols, symbols[1:], ago)
        )

    def _symbols(self, count: int) -> list[sp.Symbol]:
        """The sample that is given, then those that are kept."""
        kept = [sp.Symbol(f"{self.channel}_ago{k}", real=True) for k in range(1, count + 1)]
        return [sp.Symbol(self.channel, real=True), *kept]

    def acting(self, rate: float) -> sp.Expr:
        """What acts on average over a step at a rate [Hz]: two neighbouring samples, by their shares of it."""
        whole, part = self._split(rate)
        symbols = self._symbols(whole + 1)
        old = symbols[whole]
        return old + sp.Float(part) * (symbols[whole + 1] - old) if part else old


@dataclass(frozen=True)
class BacklashOperator:
    """A backlash between a value and what shows it: where it stands is remembered from sample to sample.

    Parameters
    ----------
    channel, unit : str
        SI unit.
    width : Any
        Of the backlash, a number or a symbol [SI].
    """

    channel: str
    unit: str
    width: Any

    @property
    def sentence(self) -> str:
        """What who calls the filter must know."""
        return f"{self.channel} has a backlash: within it a sample says nothing of the state and corrects nothing."

    @property
    def symbol(self) -> sp.Symbol:
        """Where it stood at the last step."""
        return sp.Symbol(f"{self.channel}_stood", real=True)

    def memory(self, h: sp.Expr) -> Register:
        """What is remembered, for the value `h` in symbols."""
        title = f"{self.channel} at the last step, within its backlash"
        return Register(str(self.symbol), self.unit, title, self.shown(h), self.channel)

    def shown(self, h: sp.Expr) -> sp.Expr:
        """The backlash operator: where it stood, taken along by `h` where the backlash is used up."""
        lo, hi = h - self.width / 2, h + self.width / 2
        pushed = (lo + self.symbol + sp.Abs(lo - self.symbol)) / 2
        return (pushed + hi - sp.Abs(pushed - hi)) / 2

    def follows(self, h: sp.Expr) -> sp.Expr:
        """The derivative of what is shown by `h`: one where the backlash is used up, zero within it.

        What just touches is used up, whichever way a last digit is rounded.
        """
        touching = self.width * (sp.Rational(1, 2) - TOUCHING_SHARE_OF_BACKLASH)
        up, down = sp.sign(h - touching - self.symbol), sp.sign(self.symbol - h - touching)
        return (1 + up) / 2 + (1 + down) / 2
