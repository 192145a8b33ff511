"""`LinearFlight`: a filter about a path, with its innovations and gains."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.random.random_error import RandomError
from kfgen.gap.flight.rows import Rows
from kfgen.model.filter_equations import FilterEquations

Array = NDArray[np.float64]
Places = tuple[NDArray[np.int64], NDArray[np.int64]]

COLUMNS_AT_ONCE = 32
"""Columns of one pass: memory for the errors of all inputs at all times."""


@dataclass(frozen=True)
class LinearFlight:
    """The filter about a path: its matrices, innovations and gains; see `kfgen.gap.flight.compiled`.

    Parameters
    ----------
    Phi, Qd, B : ndarray, shape (n, entries)
    Phi_at, Qd_at : (ndarray, ndarray)
        Rows and columns of the entries of ``Phi`` and ``Qd``.
    c : ndarray, shape (n, states)
    P0, x0 : ndarray, shape (states, states), ndarray, shape (states,)
    H : ndarray, shape (rows, states)
    y : ndarray, shape (rows,)
        Readings less what the path says.
    R : ndarray, shape (rows,)
        Variances of the readings.
    e, S, K : ndarray, shape (rows,), (rows,), (rows, states)
        Of `filtered`.
    """

    equations: FilterEquations
    rows: Rows
    Phi: Array
    Phi_at: Places
    Qd: Array
    Qd_at: Places
    B: Array
    c: Array
    P0: Array
    x0: Array
    H: Array
    y: Array
    R: Array
    e: Array = field(default_factory=lambda: np.empty(0))
    S: Array = field(default_factory=lambda: np.empty(0))
    K: Array = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def _entries(self) -> tuple[Array | NDArray[np.int64], ...]:
        return self.Phi, *self.Phi_at, self.Qd, *self.Qd_at

    @property
    def states(self) -> int:
        """Error states, those of random errors among them."""
        return int(self.x0.size)

    def filtered(self) -> LinearFlight:
        """With the innovations, their variances and the gains of one pass of the filter."""
        from kfgen.gap.flight.compiled import forward

        m = self.y.size
        e, S, K = np.empty(m), np.empty(m), np.empty((m, self.states))
        P, x = self.P0.copy(), self.x0.copy()
        forward(*self._entries, self.c, P, x, self.rows.at, self.H, self.y, self.R, e, S, K)
        return replace(self, e=e, S=S, K=K)

    def with_random_error(self, random_error: RandomError) -> LinearFlight:
        """The filter with the states of a random error appended, to be `filtered` anew.

        Parameters
        ----------
        random_error : RandomError
        """
        N, k, n = self.Phi.shape[0], random_error.order, self.states
        block = np.arange(k)
        here, there = np.repeat(n + block, k), n + np.tile(block, k)
        Phi, Qd = ([np.broadcast_to(M.ravel(), (N, k * k))] for M in (random_error.Phi, random_error.Qd))
        at = [(here, there)]
        B, H = self.equations.input_errors, np.pad(self.H, ((0, 0), (0, k)))
        if random_error.channel in self.equations.channels:
            own = np.flatnonzero(B.columns == self.equations.channels.index(random_error.channel))
            for j, c in enumerate(random_error.C.tolist()):
                Phi.append(c * self.B[:, own])
                at.append((B.rows[own], np.full(own.size, n + j)))
        else:
            H[self.rows.of(random_error.channel), n:] = random_error.C
        places = [np.concatenate([old, *new]) for old, new in zip(self.Phi_at, zip(*at))]
        P0 = np.zeros((n + k, n + k))
        P0[:n, :n], P0[n:, n:] = self.P0, random_error.P0
        return replace(
            self,
            Phi=np.ascontiguousarray(np.hstack([self.Phi, *Phi])),
            Phi_at=(places[0], places[1]),
            Qd=np.ascontiguousarray(np.hstack([self.Qd, *Qd])),
            Qd_at=(np.append(self.Qd_at[0], here), np.append(self.Qd_at[1], there)),
            c=np.pad(self.c, ((0, 0), (0, k))),
            P0=P0,
            x0=np.append(self.x0, np.zeros(k)),
            H=H,
        )

    @property
    def normalised(self) -> Array:
        """Innovations over their standard deviations, shape (rows,)."""
        return np.asarray(self.e / np.sqrt(self.S))

    @property
    def nats_of_readings(self) -> Array:
        """Log-likelihood of every reading given those before it, up to a constant, shape (rows,)."""
        with np.errstate(invalid="ignore"):  # of a filter that diverges they are no numbers
            return np.asarray(-0.5 * (self.e**2 / self.S + np.log(self.S)))

    @property
    def log_likelihood(self) -> float:
        """Of the innovations, up to a constant [nats]; minus infinity where they are no numbers."""
        value = float(np.sum(self.nats_of_readings))
        return value if np.isfinite(value) else -np.inf

    def until(self, stop: int | None) -> LinearFlight:
        """The same with the readings before a step alone; with all where there is none.

        Parameters
        ----------
        stop : int, optional
            First step whose readings are left out.
        """
        if stop is None:
            return self
        kept = int(np.searchsorted(self.rows.at, stop))
        rows = replace(self.rows, **{n: getattr(self.rows, n)[:kept] for n in ("at", "t", "z", "R", "index")})
        cut = {n: getattr(self, n)[:kept] for n in ("H", "y", "R", "e", "S", "K")}
        return replace(self, rows=rows, **cut)

    def scores(self, parts: Array) -> tuple[Array, Array]:
        """Derivatives of the log-likelihood in the logarithms of standard deviations, see `kfgen.gap.flight.compiled.scores`.

        Parameters
        ----------
        parts : ndarray, shape (parts, n, entries)
            Of the process noise.

        Returns
        -------
        tuple of ndarray, shape (rows,) and (parts,)
            Of every reading by itself, of every part.
        """
        from kfgen.gap.flight.compiled import scores

        of_rows, of_parts = np.zeros(self.y.size), np.zeros(parts.shape[0])
        own = np.pad(parts, ((0, 0), (0, 0), (0, self.Qd.shape[1] - parts.shape[2])))
        scores(
            self.Phi, *self.Phi_at, np.ascontiguousarray(own), *self.Qd_at, self.rows.at, self.H, self.e, self.S, self.K,
            of_rows, of_parts,
        )  # fmt: skip
        return self.R * of_rows, of_parts

    def columns(self, du: Array, dz: Array) -> Array:
        """What the normalised innovations lose by errors of the readings, shape (rows, m).

        Parameters
        ----------
        du : ndarray, shape (n, inputs, m)
            Errors of the inputs [SI].
        dz : ndarray, shape (rows, m)
            Errors of the other readings [SI].
        """
        from kfgen.gap.flight.compiled import columns

        out = np.ascontiguousarray(dz, dtype=np.float64).copy()
        B = self.equations.input_errors
        du = np.ascontiguousarray(du, dtype=np.float64)
        columns(
            self.Phi, *self.Phi_at, self.B, B.rows, B.columns, du, self.rows.at, self.H, self.S, self.K, out
        )
        return out

    def products(self, series: Array) -> tuple[Array, Array]:
        """Products of a series with what unit errors of single readings do to the normalised innovations.

        Parameters
        ----------
        series : ndarray, shape (rows,)

        Returns
        -------
        tuple of ndarray, shape (n, inputs) and (rows,)
            Of the inputs at every time, of every other reading.
        """
        from kfgen.gap.flight.compiled import products

        B = self.equations.input_errors
        of_inputs = np.zeros((self.Phi.shape[0], len(self.equations.channels)))
        of_readings = np.zeros(self.y.size)
        products(
            self.Phi, *self.Phi_at, self.B, B.rows, B.columns, self.rows.at, self.H, self.S, self.K,
            np.ascontiguousarray(series), of_inputs, of_readings,
        )  # fmt: skip
        return of_inputs, of_readings

    def smoothed(self) -> Array:
        """Errors of the path with all readings known, shape (n, states)."""
        from kfgen.gap.flight.compiled import smooth

        out = np.zeros((self.Phi.shape[0], self.x0.size))
        smooth(*self._entries, self.c, self.P0, self.x0, self.rows.at, self.H, self.e, self.S, self.K, out)
        return out
