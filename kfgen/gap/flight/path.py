"""`FlownPath`: the smoothed path of a filter over a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.first_flight import first_flight
from kfgen.gap.flight.flight_log import FlightLog
from kfgen.gap.flight.heading import start_covariance
from kfgen.gap.flight.linear.linear_flight import LinearFlight
from kfgen.gap.flight.linear.step_matrices import StepMatrices, step_matrices
from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
from kfgen.gap.flight.random.random_error import random_error_of
from kfgen.gap.flight.rows import Rows, rows_of
from kfgen.gap.scene.scene import Placed
from kfgen.model.filter_equations import FilterEquations

Array = NDArray[np.float64]

GAUSS_NEWTON_ROUNDS = 6
"""Smoothed paths after the first flight, at most."""
STEP_SHARES = (1.0, 0.5, 0.25, 0.1)
"""Of a step that are tried until the innovations are not far less likely."""
MAX_LOSS_NATS = 20.0
"""Loss of log-likelihood up to which a step is taken: a filter about its own first path fits its noise."""
SILENCED_VARIANCE_FACTOR = 1e12
"""Of a reading that says nothing."""
ARRIVED_NATS = 0.1
"""Change of log-likelihood below which a path has arrived."""


@dataclass(frozen=True)
class FlownPath:
    """The smoothed path of a filter over a log.

    Parameters
    ----------
    log : FlightLog
    equations : FilterEquations
    x : ndarray, shape (n, stored)
        Stored states.
    du : ndarray, shape (n, inputs)
        Errors of the inputs that are subtracted [SI].
    dz : ndarray, shape (rows,)
        Errors of the other readings that are subtracted [SI].
    sizes : NoiseSizes
        Of the noise, over what the filter assumes.
    silenced : ndarray of bool, shape (rows,), optional
        Readings that the filter is not given, though the path was smoothed with them.
    random_errors : tuple of Placed
        Random errors of channels that are states of the filter beside those of its model.
    """

    log: FlightLog
    equations: FilterEquations
    x: Array
    du: Array
    dz: Array
    sizes: NoiseSizes = field(default_factory=NoiseSizes)
    silenced: NDArray[np.bool_] | None = None
    random_errors: tuple[Placed, ...] = ()

    @cached_property
    def rows(self) -> Rows:
        """The scalar readings."""
        return rows_of(self.log)

    @cached_property
    def given(self) -> list[Array]:
        """Values of every symbol along the path."""
        log = self.log
        return self.equations.given(self.x, log.u - self.du, log.drive, log.constants, log.dt)

    def at_rows(self, values: Array, channel: str) -> Array:
        """A course along the path, shape (n,), at the times of a channel's readings."""
        at = self.rows.of(channel)
        return interpolated(self.log.t, values, self.rows.t[at], self.rows.at[at])

    def expected(self, given: list[Array] | None = None) -> Array:
        """What every reading should be, shape (rows,).

        Parameters
        ----------
        given : list of ndarray, optional
            Values of every symbol, where they are not the path's own.
        """
        out = np.empty(self.rows.t.size)
        given = self.given if given is None else given
        for a in self.log.aiding:
            for c, course in zip(a.sensor.channels, self.equations.reading(a.sensor).table(given).T):
                out[self.rows.of(c)] = self.at_rows(course, c)
        return out

    @cached_property
    def linear(self) -> LinearFlight:
        """The filter about it."""
        eq, rows, x = self.equations, self.rows, self.x
        c = np.zeros((x.shape[0], eq.n))
        c[:-1] = eq.difference(x[1:], eq.stepped(self.given)[:-1])
        H = np.zeros((rows.t.size, eq.n))
        for a in self.log.aiding:
            J = eq.jacobian(a.sensor).at([g[a.at] if g.size > 1 else g for g in self.given])
            for k, name in enumerate(a.sensor.channels):
                H[rows.of(name)] = J[:, k]
        y = rows.z - self.dz - self.expected()
        R = rows.R * self.sizes.of_rows(rows) ** 2
        if self.silenced is not None:
            R = np.where(self.silenced, SILENCED_VARIANCE_FACTOR * R, R)
        P0 = start_covariance(self.log, eq)
        x0 = eq.difference(x[:1], self.log.start[None, :])[0]
        matrices = step_matrices(eq, self.given, x.shape[0], self.sizes.of_inputs)
        linear = LinearFlight(eq, rows, matrices, c, P0, x0, H, y, R)
        for placed in self.random_errors:
            linear = linear.with_random_error(random_error_of(placed, self.log.dt))
        return linear.filtered()

    def log_likelihood_with(self, sizes: NoiseSizes) -> float:
        """The log-likelihood [nats] of the innovations about this path with other noises of the inputs; minus infinity where
        it is no number.

        Parameters
        ----------
        sizes : NoiseSizes
        """
        after = {n: sizes.of_inputs.get(n, 1.0) for n in self.equations.input_noise}
        matrices = self._matrices.resized(self._input_sizes, after)
        states = self.equations.n
        for error in (random_error_of(placed, self.log.dt) for placed in self.random_errors):
            matrices = matrices.with_random_error(self.equations, error, states)
            states += error.order
        return replace(self.linear, matrices=matrices).filtered().log_likelihood

    @property
    def _input_sizes(self) -> dict[str, float | Array]:
        """Of the noise of every input, over what the filter assumes."""
        return {n: self.sizes.of_inputs.get(n, 1.0) for n in self.equations.input_noise}

    @cached_property
    def _matrices(self) -> StepMatrices:
        """Of the filter about it, with the noise of each input by itself."""
        return step_matrices(self.equations, self.given, self.x.shape[0], self._input_sizes)

    def smoothed(self, rounds: int = GAUSS_NEWTON_ROUNDS) -> FlownPath:
        """The path moved to where all readings want it (Gauss and Newton), by shorter steps where whole ones fail.

        Parameters
        ----------
        rounds : int
            Steps at most.
        """
        path = self
        for _ in range(rounds):
            error, before = path.linear.smoothed()[:, : self.equations.n], path.linear.log_likelihood
            for share in STEP_SHARES:
                x = path.equations.injected(path.x, share * error)
                moved = replace(path, x=x)
                if np.isfinite(x).all() and moved.linear.log_likelihood > before - MAX_LOSS_NATS:
                    break
            else:
                break
            path = moved
            if abs(path.linear.log_likelihood - before) < ARRIVED_NATS:
                break
        return path

    def changed(self, constants: Mapping[str, float]) -> Array:
        """By how much readings differ where constants have other values, shape (rows,).

        Parameters
        ----------
        constants : mapping of str to float
            Some of the model's [SI].
        """
        log = self.log
        there = {**log.constants, **constants}
        given = self.equations.given(self.x, log.u - self.du, log.drive, there, log.dt)
        return self.expected(given) - self.expected()

    def without(self, du: Array, dz: Array, constants: Mapping[str, float]) -> FlownPath:
        """Smoothed with errors of the readings subtracted.

        Parameters
        ----------
        du : ndarray, shape (n, inputs)
        dz : ndarray, shape (rows,)
        constants : mapping of str to float
            Values of some of the model's constants [SI].
        """
        log = replace(self.log, constants={**self.log.constants, **constants})
        return replace(self, log=log, du=du, dz=dz).smoothed()


def interpolated(t: Array, values: Array, times: Array, at: NDArray[np.int64]) -> Array:
    """A course at other times, by a parabola through the three nearest samples."""
    k = np.clip(at, 1, t.size - 2)
    s = (times - t[k]) / (t[1] - t[0])
    before, now, after = values[k - 1], values[k], values[k + 1]
    return np.asarray(now + s * (0.5 * (after - before) + 0.5 * s * (after - 2.0 * now + before)))


def flown(log: FlightLog) -> FlownPath:
    """The smoothed path of the filter of a log.

    Raises
    ------
    InputError
        The filter diverges, or the extra ``kfgen[fast]`` is not installed.
    """
    equations = FilterEquations(log.discrete)
    log, x = first_flight(log, equations)
    return FlownPath(log, equations, x, np.zeros_like(log.u), np.zeros(rows_of(log).t.size)).smoothed()
