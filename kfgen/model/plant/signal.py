"""Inputs of a plant between their samples: held, or smooth; changed, late, behind a lag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.driven.first_order_lag import behind, faded
from kfgen.effects.plant.terms import InputChange

Array = NDArray[np.float64]

NODES = np.array([0.0, 0.5, 1.0])
"""Where a Runge-Kutta step looks at an input."""
WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
"""What each look counts."""


@dataclass(frozen=True)
class Signal:
    """One input over a record.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the samples [s].
    values : ndarray, shape (n,)
        SI.
    held : bool
        A sample acts until the next one; else it is of a smooth signal.
    changes : sequence of InputChange
        Their numbers may be of shape (batch,).
    before : float or ndarray, shape (batch,)
        By how much the input was another one before the first sample, where what is late or lags still shows it.
    columns : ndarray of int, shape (columns,), optional
        Which of the batch acts in each column of a simulation, where several have the same; else each has its own.
    """

    t: Array
    values: Array
    held: bool
    changes: Sequence[InputChange] = ()
    before: Array | float = 0.0
    columns: NDArray[np.intp] | None = None

    @classmethod
    def of(cls, t: Array, values: Array, held: bool, changes: Sequence[InputChange], before: Array) -> Signal:
        """The signal of the columns of a simulation: what is the same in several of them is computed once.

        Parameters
        ----------
        t, values, held
            As of the class.
        changes : sequence of InputChange
            Their numbers of shape (columns,).
        before : ndarray, shape (columns,)
        """
        numbers = [(c, f.name, np.asarray(getattr(c, f.name), float)) for c in changes for f in fields(c)]
        table = np.stack([*np.broadcast_arrays(*(v for _, _, v in numbers), before)])
        place: dict[bytes, int] = {}
        columns = np.array([place.setdefault(column.tobytes(), len(place)) for column in table.T.copy()])
        own = np.unique(columns, return_index=True)[1]
        kept = [
            replace(c, **{name: row[own] for (of, name, _), row in zip(numbers, table) if of is c})
            for c in changes
        ]
        return cls(t, values, held, kept, table[-1, own], columns)

    def _each(self, found: Array) -> Array:
        """What acts in each column, from what acts in each of the batch, the last axis of both."""
        alike = self.columns is None or found.shape[-1] == 1
        return found if alike else np.asarray(found[..., self.columns])

    @property
    def samples(self) -> Array:
        """The samples after what changes their size, shape (n, columns or 1)."""
        return self._each(self._samples)

    @cached_property
    def _samples(self) -> Array:
        u = self.values[:, None]
        for change in self.changes:
            u = change.samples(u)
        return np.asarray(u)

    @cached_property
    def _lag(self) -> Array:
        lags = [np.atleast_1d(np.asarray(c.lag, dtype=np.float64)) for c in self.changes]
        return np.asarray(sum(lags, np.zeros(1)))

    @cached_property
    def _late(self) -> Array:
        lates = [np.atleast_1d(np.asarray(c.late, dtype=np.float64)) for c in self.changes]
        return np.asarray(sum(lates, np.zeros(1)))

    @cached_property
    def _behind(self) -> Array:
        """The state of the lag at the samples, shape (n, batch); it starts settled with what was before."""
        u, tau = self._samples, self._lag
        first = u[0] + self.before
        if not self.held:
            return behind(self.t, u, np.broadcast_to(tau, np.broadcast_shapes(tau.shape, first.shape)), first)
        stay = np.exp(-np.diff(self.t)[:, None] / tau)
        driven = np.empty(np.broadcast_shapes(u.shape, (1, tau.size), (1, first.size)))
        driven[0] = first
        driven[1:] = u[:-1] * (1.0 - stay)
        return faded(self.t, stay, driven)

    @property
    def plain(self) -> bool:
        """Whether it is constant between samples."""
        return self.held and not self._lag.any() and not self._late.any()

    def nodes(self, first: int, last: int, substeps: int) -> Array:
        """What acts in the steps `first` to `last`, shape (steps, substeps or 1, 3 or 1, columns or 1).

        The third axis is the beginning, the middle and the end of each part of a step.
        """
        return self._each(self._nodes(first, last, substeps))

    def at(self, times: Array) -> Array:
        """What acts at times [s], shape (m, columns or 1)."""
        return self._each(self._at(times))

    def _nodes(self, first: int, last: int, substeps: int) -> Array:
        if self.plain:
            return self._samples[first:last, None, None, :]
        t, dt = self.t[first:last], np.diff(self.t)[first:last]
        parts = np.arange(substeps) / substeps
        if self.held and not self._lag.any():
            return self._means(first, last, substeps)[:, :, None, :]
        at = parts[:, None] + NODES / substeps
        times = t[:, None, None] + dt[:, None, None] * at
        found = self._at(times.ravel()).reshape(t.size, substeps, NODES.size, -1)
        # A lag much shorter than the part ends between the nodes: its integral is kept.
        return (
            found + (self._means(first, last, substeps) - WEIGHTS @ found)[:, :, None] if self.held else found
        )

    def _means(self, first: int, last: int, substeps: int) -> Array:
        """What acts on average in each part of the steps, of a held input, shape (steps, substeps, batch)."""
        t, dt = self.t[first:last], np.diff(self.t)[first:last]
        edges = (t[:, None] + dt[:, None] * (np.arange(substeps + 1) / substeps)).ravel()
        total = self._integral(edges).reshape(t.size, substeps + 1, -1)
        return np.asarray(np.diff(total, axis=1) / (dt[:, None, None] / substeps))

    def _integral(self, times: Array) -> Array:
        """The integral of a held input that is late or behind a lag, at times, shape (m, batch)."""
        u, lag = self._samples, self._lag
        steps = np.append(np.diff(self.t), 0.0)[:, None]
        s = times[:, None] - self._late
        k = self._before(s)
        columns = np.broadcast_to(np.arange(u.shape[1]), (1, u.shape[1]))
        whole = u * steps
        part = u[k, columns] * (s - self.t[k]) + self.before * np.minimum(s - self.t[0], 0.0)
        if lag.any():
            distance = lag * (self._behind - u)
            whole = whole + distance * -np.expm1(-steps / lag)
            inner = np.broadcast_to(np.arange(distance.shape[1]), (1, distance.shape[1]))
            part = part + distance[k, inner] * -np.expm1(-np.maximum(s - self.t[k], 0.0) / lag)
        total = np.vstack([np.zeros((1, whole.shape[1])), np.cumsum(whole, axis=0)])[:-1]
        ordinal = np.broadcast_to(np.arange(whole.shape[1]), (1, whole.shape[1]))
        return np.asarray(total[k, ordinal] + part)

    def _before(self, s: Array) -> NDArray[np.intp]:
        """The last sample before each time; the first before the record."""
        return np.clip(np.searchsorted(self.t, s, side="right") - 1, 0, self.t.size - 1)

    def _at(self, times: Array) -> Array:
        u, lag = self._samples, self._lag
        s = times[:, None] - self._late
        earlier = self.before * (s < self.t[0])
        if not self.held:
            s = np.clip(s, self.t[0], self.t[-1])
        k = self._before(s)
        columns = np.broadcast_to(np.arange(u.shape[1]), (1, u.shape[1]))
        if not lag.any():
            return np.asarray((u[k, columns] if self.held else self._smooth(s)) + earlier)
        x = self._behind
        inner = np.broadcast_to(np.arange(x.shape[1]), (1, x.shape[1]))
        away = np.maximum(s - self.t[k], 0.0)
        fade = np.exp(-away / lag)
        if self.held:
            return np.asarray(u[k, columns] + (x[k, inner] - u[k, columns]) * fade)
        steps = np.diff(self.t)[:, None]
        slope = np.vstack([np.diff(u, axis=0) / steps, np.zeros((1, u.shape[1]))])[k, columns]
        return np.asarray(
            u[k, columns] + slope * (away - lag) + fade * (x[k, inner] - u[k, columns] + slope * lag)
        )

    def _smooth(self, s: Array) -> Array:
        """Cubic interpolation at times of shape (m, batch or 1)."""
        u = self._samples
        if self.t.size < 4:
            return np.column_stack(
                [np.interp(s[:, min(j, s.shape[1] - 1)], self.t, u[:, j]) for j in range(u.shape[1])]
            )
        columns = max(s.shape[1], u.shape[1])
        wide = np.broadcast_to(s, (s.shape[0], columns))
        if u.shape[1] == 1:
            return np.asarray(self._spline(wide.ravel())[:, 0]).reshape(wide.shape)
        return np.column_stack([self._spline(wide[:, j])[:, j] for j in range(columns)])

    @cached_property
    def _spline(self):  # type: ignore[no-untyped-def]
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.t, self._samples, axis=0)
