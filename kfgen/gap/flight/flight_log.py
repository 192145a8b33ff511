"""A log as a filter flies it: inputs on an even grid, the samples of every aiding sensor at their own times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.emit.routines import Program
from kfgen.gap.core.drivers import recorded
from kfgen.log.log import Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.sensors import Sensor
from kfgen.run.alignment import constants_at_rest
from kfgen.run.filter_calls import FilterCalls, over_steps, rates_in

Array = NDArray[np.float64]

EVEN_RELATIVE_TOLERANCE = 1e-3
"""Relative differences of steps up to which time is even."""
MAX_STEPS = 500_000
"""Samples of a log beyond which its grid is slower than its samples, and steps of a flight that are held in memory."""
GRID_RATE_HZ = 100.0
"""Of a slower grid at least: what acts is then the mean over an interval, whose integral is that of the samples."""


@dataclass(frozen=True)
class AidingSamples:
    """The samples of one sensor.

    Parameters
    ----------
    sensor : Sensor
    t : ndarray, shape (m,)
        Times [s].
    z : ndarray, shape (m, rows)
        Readings [SI].
    at : ndarray of int, shape (m,)
        The grid's time that is nearest.
    delay : float
        That is assumed, and is off the times already [s].
    noise : ndarray, shape (m,)
        Standard deviation of each sample's noise over the assumed one.
    """

    sensor: Sensor
    t: Array
    z: Array
    at: NDArray[np.intp]
    delay: float
    noise: Array

    def kept(self, these: NDArray[np.bool_]) -> AidingSamples:
        """Some of the samples."""
        return replace(self, t=self.t[these], z=self.z[these], at=self.at[these], noise=self.noise[these])


@dataclass(frozen=True)
class FlightLog:
    """A log for a filter.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    u : ndarray, shape (n, inputs)
        What acts from each time to the next, as it was read [SI].
    drive : mapping of str to ndarray, shape (n,)
        Drivers of effects [SI].
    aiding : tuple of AidingSamples
    start : ndarray, shape (stored,)
        The stored state at the first time, from the alignment.
    constants : mapping of str to float
        Of the model, some as the sensors show them at rest [SI].
    discrete : DiscreteModel
        At the log's rates.
    """

    t: Array
    u: Array
    drive: Mapping[str, Array]
    aiding: tuple[AidingSamples, ...]
    start: Array
    constants: Mapping[str, float]
    discrete: DiscreteModel

    @property
    def dt(self) -> float:
        """Step [s]."""
        return float((self.t[-1] - self.t[0]) / (self.t.size - 1))

    @cached_property
    def measured(self) -> tuple[str, ...]:
        """The constants of the model that an alignment takes from the first samples: the log knows them no better."""
        return constants_at_rest([a.sensor for a in self.aiding])

    @cached_property
    def triads(self) -> dict[str, slice]:
        """The columns of `u` of each input."""
        out, k = {}, 0
        for i in self.discrete.model.motion.inputs:
            out[i.name] = slice(k, k + len(i.channels))
            k += len(i.channels)
        return out


def flight_log(log: Log, program: Program, known: Mapping[str, Array] | None = None) -> FlightLog:
    """A log on an even grid: of its own mean step, or of a multiple of it where the log is longer than `MAX_STEPS`.

    Parameters
    ----------
    log : Log
        With the inputs and drivers of the program's model.
    program : Program
        At the log's rate.
    known : mapping of str to ndarray, shape (log.n,), optional
        Its recorded drivers, smoothed, where that is done already.

    Raises
    ------
    InputError
        The flight is too long, or as `kfgen.run.filter_calls.FilterCalls`.
    """
    own = float(log.t[-1] - log.t[0]) / (log.n - 1)
    stride = _stride(log.n, own)
    steps, dt = (log.n - 1) // stride + 1, stride * own
    if steps > MAX_STEPS:
        raise InputError(
            f"the flight has {steps:,} steps of {dt:.3g} s, more than the {MAX_STEPS:,} that are held in memory",
            where=log.source,
            remedy="Give a part of the log",
        )
    calls = FilterCalls(program, log)
    model = program.discrete.model
    even = stride == 1 and bool(np.allclose(np.diff(log.t), dt, rtol=EVEN_RELATIVE_TOLERANCE))
    t = np.asarray(log.t) if even else np.asarray(log.t[0] + dt * np.arange(steps))
    acting = (over_steps(log.values(c), calls.samples) for i in model.motion.inputs for c in i.channels)
    u = np.column_stack([a if even else _over_grid(log.t, a, t) for a in acting])
    drivers = (recorded(log) if known is None else dict(known)) | {d: calls.inputs[d] for d in model.drivers}
    drive = {d: np.interp(t, log.t, v) for d, v in drivers.items()}
    aiding = []
    for name, z in calls.present.items():
        there = np.isfinite(z).all(axis=1)
        delay = calls.delays.get(name, 0.0)
        times = np.asarray(log.t)[there] - delay
        inside = (times > t[0] - 0.5 * dt) & (times < t[-1] + 0.5 * dt)
        times, there = times[inside], np.flatnonzero(there)[inside]
        at = np.clip(np.rint((times - t[0]) / (t[1] - t[0])), 0, t.size - 1).astype(np.intp)
        if times.size:
            aiding.append(AidingSamples(model.sensor(name), times, z[there], at, delay, np.ones(times.size)))
    discrete = DiscreteModel.at_rate(
        model, 1.0 / dt, max_step=program.discrete.max_step, rates=rates_in(log, model)
    )
    names = [c.name for c in model.constants]
    constants = dict(zip(names, calls.constants))
    return FlightLog(t, u, drive, tuple(aiding), np.array(calls.start), constants, discrete)


def _stride(n: int, step_s: float) -> int:
    """Samples in a step of the grid: one, or of a long log as many as `GRID_RATE_HZ` allows."""
    return max(1, int(1.0 / (GRID_RATE_HZ * step_s) + 1e-6)) if n > MAX_STEPS else 1


def _over_grid(t: Array, u: Array, grid: Array) -> Array:
    """Means over the intervals of an even grid of what acts between uneven times: the integral is kept."""
    total = np.concatenate([np.zeros(1), np.cumsum(u[:-1] * np.diff(t))])
    edges = np.append(grid, grid[-1] + (grid[1] - grid[0]))
    out = np.diff(np.interp(edges, t, total)) / (grid[1] - grid[0])
    out[-1] = u[-1]
    return np.asarray(out)
