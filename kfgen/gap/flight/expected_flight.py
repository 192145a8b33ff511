"""A filter in flight along a manoeuvre that nobody has flown yet: its gains, and what effects would do to its innovations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.emit.routines import Program
from kfgen.gap.flight.flight_log import flight_log
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.rows import rows_of
from kfgen.gap.flight.scene import FlightScene
from kfgen.log.log import Log
from kfgen.manoeuvre.flight import ManoeuvreMotion
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.filter_equations import FilterEquations
from kfgen.model.known_delays import without_shifts
from kfgen.simulate.expected import expected_log
from kfgen.simulate.rates import sensor_rates

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ExpectedFlights:
    """A filter along manoeuvres.

    Parameters
    ----------
    model : FilterModel
        With an attitude and a velocity, without inputs that come late.
    rate : float
        Of its inputs [Hz].
    drivers : tuple of str
        That are logged beside its own.
    """

    model: FilterModel
    rate: float
    drivers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.model.attitude is None or "v" not in {b.name for b in self.model.blocks}:
            raise InputError(
                f"{self.model.name} has no attitude or no velocity: no manoeuvre moves it",
                where="--model",
                remedy="Give a filter with both, ins15 for example",
            )
        if self.discrete.memories:
            raise InputError(
                f"{self.model.name} keeps samples of late inputs, and its expected innovations are not computed",
                where="--model",
                remedy="Plan with the same filter without the delay of its inputs",
            )

    @cached_property
    def discrete(self) -> DiscreteModel:
        """With its sensors at their usual rates."""
        rates = sensor_rates(DiscreteModel.at_rate(self.model, self.rate))
        slower = {name: rate for name, rate in rates.items() if rate < self.rate}
        return DiscreteModel.at_rate(self.model, self.rate, rates=slower)

    @cached_property
    def equations(self) -> FilterEquations:
        """In numbers, once for all flights."""
        return FilterEquations(self.discrete)

    def log(self, manoeuvre: Manoeuvre) -> Log:
        """The readings that are to be expected of a manoeuvre, without noise.

        Parameters
        ----------
        manoeuvre : Manoeuvre
            In its own length.
        """
        t = np.arange(max(2, round(manoeuvre.length * self.rate))) / self.rate
        motion = ManoeuvreMotion(manoeuvre, t, manoeuvre.length)
        return expected_log(self.discrete, motion, manoeuvre.name, self.drivers)

    def scene(self, manoeuvre: Manoeuvre) -> FlightScene:
        """The flight about the true path, its start known as well as the filter's alignment knows it.

        Parameters
        ----------
        manoeuvre : Manoeuvre
            In its own length.
        """
        log = self.log(manoeuvre)
        equations = self.equations
        x = _true_states(log, equations)
        flown = replace(flight_log(log, Program(self.discrete)), discrete=self.discrete, start=x[0])
        constants = {c.name: float(c.value) for c in self.model.constants} | without_shifts(self.model)
        flown = replace(flown, constants=constants)
        return FlightScene(
            FlownPath(flown, equations, x, np.zeros_like(flown.u), np.zeros(rows_of(flown).t.size))
        )


def _true_states(log: Log, equations: FilterEquations) -> Array:
    """The stored states along a log with its references, shape (n, stored); what has none is as the model starts it."""
    x = np.tile(np.asarray(equations.discrete.start, dtype=np.float64), (log.n, 1))
    for k, name in enumerate(equations.names):
        if f"ref_{name}" in log.channels:
            x[:, k] = log.values(f"ref_{name}")
    return equations.normalised(x)
