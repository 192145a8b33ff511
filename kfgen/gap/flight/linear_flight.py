"""`LinearFlight`: a filter about a path, with its innovations and gains."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.rows import Rows
from kfgen.model.filter_equations import FilterEquations

Array = NDArray[np.float64]

COLUMNS_AT_ONCE = 32
"""Columns of one pass: memory for the errors of all inputs at all times."""


@dataclass(frozen=True)
class LinearFlight:
    """The filter about a path: its matrices, innovations and gains; see `kfgen.gap.flight.compiled`.

    Parameters
    ----------
    Phi, Qd, B : ndarray, shape (n, entries)
    c : ndarray, shape (n, states)
    P0, x0 : ndarray, shape (states, states), ndarray, shape (states,)
    H : ndarray, shape (rows, states)
    y : ndarray, shape (rows,)
        Readings less what the path says.
    R : ndarray, shape (rows,)
        Variances of the readings.
    e, S, K : ndarray, shape (rows,), (rows,), (rows, states)
    """

    equations: FilterEquations
    rows: Rows
    Phi: Array
    Qd: Array
    B: Array
    c: Array
    P0: Array
    x0: Array
    H: Array
    y: Array
    R: Array
    e: Array
    S: Array
    K: Array

    @property
    def _entries(self) -> tuple[Array | NDArray[np.int64], ...]:
        F, Q = self.equations.transition, self.equations.process_noise
        return self.Phi, F.rows, F.columns, self.Qd, Q.rows, Q.columns

    @property
    def normalised(self) -> Array:
        """Innovations over their standard deviations, shape (rows,)."""
        return np.asarray(self.e / np.sqrt(self.S))

    @property
    def nats_of_readings(self) -> Array:
        """Log-likelihood of every reading given those before it, up to a constant, shape (rows,)."""
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
        Phi, Pi, Pj, _, Qi, Qj = self._entries
        scores(
            Phi,
            Pi,
            Pj,
            np.ascontiguousarray(parts),
            Qi,
            Qj,
            self.rows.at,
            self.H,
            self.e,
            self.S,
            self.K,
            of_rows,
            of_parts,
        )
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
        F, B = self.equations.transition, self.equations.input_errors
        du = np.ascontiguousarray(du, dtype=np.float64)
        columns(
            self.Phi,
            F.rows,
            F.columns,
            self.B,
            B.rows,
            B.columns,
            du,
            self.rows.at,
            self.H,
            self.S,
            self.K,
            out,
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

        F, B = self.equations.transition, self.equations.input_errors
        of_inputs = np.zeros((self.Phi.shape[0], len(self.equations.channels)))
        of_readings = np.zeros(self.y.size)
        products(
            self.Phi, F.rows, F.columns, self.B, B.rows, B.columns, self.rows.at, self.H, self.S, self.K,
            np.ascontiguousarray(series), of_inputs, of_readings,
        )  # fmt: skip
        return of_inputs, of_readings

    def smoothed(self) -> Array:
        """Errors of the path with all readings known, shape (n, states)."""
        from kfgen.gap.flight.compiled import smooth

        out = np.zeros((self.Phi.shape[0], self.x0.size))
        smooth(*self._entries, self.c, self.P0, self.x0, self.rows.at, self.H, self.e, self.S, self.K, out)
        return out
