"""`LinearFlight`: a filter about a path, with its innovations and gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.linear.step_matrices import StepMatrices, in_block
from kfgen.gap.flight.random.random_error import RandomError
from kfgen.gap.flight.rows import Rows
from kfgen.model.filter_equations import FilterEquations

Array = NDArray[np.float64]

COLUMNS_AT_ONCE = 32
"""Columns of one pass at most."""
BYTES_AT_ONCE = 100e6
"""Memory for the columns of one pass, of the inputs at all times and of what they do to the readings."""


@dataclass(frozen=True)
class LinearFlight:
    """The filter about a path: its matrices, innovations and gains; see `kfgen.gap.flight.linear.compiled`.

    Parameters
    ----------
    matrices : StepMatrices
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
    matrices: StepMatrices
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
    def states(self) -> int:
        """Error states, those of random errors among them."""
        return int(self.x0.size)

    @property
    def columns_at_once(self) -> int:
        """Of `columns`: as many as the memory allows."""
        numbers = self.matrices.steps * len(self.equations.channels) + 4 * self.y.size
        return int(np.clip(BYTES_AT_ONCE / (8.0 * numbers), 1, COLUMNS_AT_ONCE))

    def filtered(self) -> LinearFlight:
        """With the innovations, their variances and the gains of one pass of the filter."""
        from kfgen.gap.flight.linear.compiled import forward

        m = self.y.size
        e, S, K = np.empty(m), np.empty(m), np.empty((m, self.states))
        P, x, at = self.P0.copy(), self.x0.copy(), 0
        Phi_at, Qd_at = self.matrices.Phi_at, self.matrices.Qd_at
        for b in self.matrices.blocks():
            at = forward(
                b.first, at, b.Phi, *Phi_at, b.Qd, *Qd_at, self.c, P, x, self.rows.at, self.H, self.y, self.R, e, S, K
            )  # fmt: skip
        return replace(self, e=e, S=S, K=K)

    def with_random_error(self, random_error: RandomError) -> LinearFlight:
        """The filter with the states of a random error appended, to be `filtered` anew.

        Parameters
        ----------
        random_error : RandomError
        """
        k, n = random_error.order, self.states
        H = np.pad(self.H, ((0, 0), (0, k)))
        if random_error.channel not in self.equations.channels:
            H[self.rows.of(random_error.channel), n:] = random_error.C
        P0 = np.zeros((n + k, n + k))
        P0[:n, :n], P0[n:, n:] = self.P0, random_error.P0
        return replace(
            self,
            matrices=self.matrices.with_random_error(self.equations, random_error, n),
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

    def scores(self, sizes: Mapping[str, float | Array]) -> tuple[Array, Array]:
        """Derivatives of the log-likelihood in the logarithms of standard deviations, see `kfgen.gap.flight.linear.compiled.scores`.

        Parameters
        ----------
        sizes : mapping of str to float or ndarray, shape (n,)
            Of the noise of inputs, over what the filter assumes, as the matrices have them.

        Returns
        -------
        tuple of ndarray, shape (rows,) and (inputs,)
            Of every reading by itself, of the noise of every input.
        """
        from kfgen.gap.flight.linear.compiled import scores

        of_rows, of_parts = np.zeros(self.y.size), np.zeros(len(sizes))
        r, N, at = np.zeros(self.states), np.zeros((self.states, self.states)), self.y.size - 1
        Phi_at, Qd_at, last = self.matrices.Phi_at, self.matrices.Qd_at, self.matrices.steps - 1
        for b in self.matrices.blocks(backwards=True):
            parts = np.zeros((len(sizes), *b.Qd.shape))
            for part, (name, size) in zip(parts, sizes.items()):
                part[:, : b.noise[name].shape[1]] = in_block(size, b.first, len(part)) ** 2 * b.noise[name]
            at = scores(
                b.first, at, last, b.Phi, *Phi_at, parts, *Qd_at, r, N, self.rows.at, self.H, self.e, self.S, self.K,
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
        from kfgen.gap.flight.linear.compiled import columns

        out = np.ascontiguousarray(dz, dtype=np.float64).copy()
        B, Phi_at = self.equations.input_errors, self.matrices.Phi_at
        du = np.ascontiguousarray(du, dtype=np.float64)
        U, at = np.zeros((self.states, out.shape[1])), 0
        for b in self.matrices.blocks():
            at = columns(
                b.first, at, b.Phi, *Phi_at, b.B, B.rows, B.columns, du, U, self.rows.at, self.H, self.S, self.K, out
            )  # fmt: skip
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
        from kfgen.gap.flight.linear.compiled import products

        B, Phi_at = self.equations.input_errors, self.matrices.Phi_at
        of_inputs = np.zeros((self.matrices.steps, len(self.equations.channels)))
        of_readings = np.zeros(self.y.size)
        lam, at, w = np.zeros(self.states), self.y.size - 1, np.ascontiguousarray(series)
        for b in self.matrices.blocks(backwards=True):
            at = products(
                b.first, at, b.Phi, *Phi_at, b.B, B.rows, B.columns, lam, self.rows.at, self.H, self.S, self.K, w,
                of_inputs, of_readings,
            )  # fmt: skip
        return of_inputs, of_readings

    def smoothed(self) -> Array:
        """Errors of the path with all readings known, shape (n, states)."""
        from kfgen.gap.flight.linear.compiled import disturbances, smoothed

        out = np.zeros((self.matrices.steps, self.states))
        Phi_at, Qd_at = self.matrices.Phi_at, self.matrices.Qd_at
        r, at = np.zeros(self.states), self.y.size - 1
        for b in self.matrices.blocks(backwards=True):
            at = disturbances(
                b.first, at, b.Phi, *Phi_at, r, self.rows.at, self.H, self.e, self.S, self.K, out
            )
        x = self.x0 + self.P0 @ out[0]
        for b in self.matrices.blocks():
            smoothed(b.first, b.Phi, *Phi_at, b.Qd, *Qd_at, self.c, x, out)
        return out
