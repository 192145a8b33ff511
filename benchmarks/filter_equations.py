"""The equations of a model's whole filter in symbols of its stored state, and what they give in double precision."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import sympy as sp
from codegen import Problem

from kfgen.model.parts.sensors import Sensor


class Equations(Problem):
    """One model's whole filter in symbols, and what it makes of numbers in double precision."""

    @cached_property
    def sensors(self) -> Sequence[Sensor]:
        """Of the model."""
        return self.discrete.model.sensors

    @cached_property
    def x(self) -> list[sp.Symbol]:
        """The stored state."""
        return [sp.Symbol(n, real=True) for n in self.discrete.nominal_names]

    @cached_property
    def inputs(self) -> list[sp.Symbol]:
        """Channels of the inputs, and the step."""
        channels = [c for i in self.discrete.model.motion.inputs for c in i.channels]
        return [*(sp.Symbol(c, real=True) for c in channels), self.dt]

    @cached_property
    def dt(self) -> sp.Symbol:
        """The step."""
        return next(s for e in self.discrete.step for s in e.free_symbols if s.name == "dt")

    @cached_property
    def k(self) -> list[sp.Symbol]:
        """The constants."""
        return [sp.Symbol(c.name, real=True) for c in self.discrete.model.constants]

    @property
    def known(self) -> list[sp.Symbol]:
        """What is given to every routine."""
        return [*self.x, *self.inputs, *self.k]

    @cached_property
    def dx(self) -> list[sp.Symbol]:
        """The correction."""
        return [sp.Symbol(f"d_{k}") for k in range(self.n)]

    def plain(self, e: sp.Expr) -> sp.Expr:
        """An expression of the stored state: the rotation's entries as the quaternion's products, symbols by name."""
        by_name = {s.name: s for s in (*self.known, *self.dx)}
        own = {s.error: d for s, d in zip(self.discrete.model.states, self.dx, strict=True)}
        e = e.xreplace(self.rotation).xreplace(own)
        return e.xreplace({s: by_name[s.name] for s in e.free_symbols if s.name in by_name})

    @cached_property
    def step(self) -> list[sp.Expr]:
        """The stored state after a step, its quaternion of unit length."""
        return self.unit([self.plain(e) for e in self.discrete.step])

    @cached_property
    def corrected(self) -> list[sp.Expr]:
        """The stored state after a correction."""
        return self.unit([self.plain(e) for e in self.discrete.model.corrected])

    def unit(self, new: list[sp.Expr]) -> list[sp.Expr]:
        """With the quaternion scaled."""
        attitude = self.discrete.model.attitude
        assert attitude is not None
        where = [self.discrete.nominal_names.index(n) for n in attitude.nominal_names]
        scale = 1 / sp.sqrt(sp.Add(*(new[k] ** 2 for k in where)))
        return [e * scale if k in where else e for k, e in enumerate(new)]

    def measurement(self, sensor: Sensor) -> tuple[list[sp.Expr], list[dict[int, sp.Expr]], list[float]]:
        """Expected sample, non-zeros of the Jacobian by row, variances."""
        h, H = self.discrete.expected(sensor), self.discrete.H(sensor)
        rows = [
            {j: self.plain(H[i, j]) for j in range(self.n) if H[i, j] != 0}
            for i in range(len(sensor.channels))
        ]
        return (
            [self.plain(e) for e in h],
            rows,
            [self.discrete.measurement_variance(sensor, c) for c in sensor.channels],
        )

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """State, inputs and constants in a row, and a covariance of the size of the priors; in single precision."""
        rng = np.random.default_rng(1)
        d = self.discrete
        sd = {s.name: s.prior for s in d.model.states}
        x = np.array(
            [v + 0.3 * sd.get(n, 1.0) * rng.normal() for n, v in zip(d.nominal_names, d.start, strict=True)]
        )
        q = [k for k, n in enumerate(d.nominal_names) if n.startswith("q_")]
        x[q] /= np.linalg.norm(x[q])
        known = {"dt": 0.01, "accel_z": -9.8, "v_N": 20.0} | {c.name: c.value for c in d.model.constants}
        given = {s: float(v) for s, v in zip(self.x, x, strict=True)}
        row = np.array([known.get(s.name, given.get(s, 0.1 * rng.normal())) for s in self.known])
        A = rng.normal(size=(self.n, 2 * self.n)) * np.array([[s] for s in sd.values()])
        return row.astype(np.float32), (A @ A.T / (2 * self.n)).astype(np.float32)

    def numbers(self, expressions: Sequence[sp.Expr], given: np.ndarray) -> np.ndarray:
        """Their values."""
        return np.array(sp.lambdify(self.known, list(expressions), "numpy")(*map(float, given)), float)

    def predicted(self, given: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State and covariance after a step."""
        Phi, Qd = (
            self.numbers([self.plain(e) for e in M], given).reshape(self.n, self.n)
            for M in (self.Phi, self.Qd)
        )
        return self.numbers(self.step, given), Phi @ P.astype(float) @ Phi.T + Qd

    def updated(self, sensor: Sensor, given: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, ...]:
        """A sample, then state and covariance after it is fused."""
        h, rows, R = self.measurement(sensor)
        H = np.zeros((len(rows), self.n))
        for i, row in enumerate(rows):
            H[i, list(row)] = self.numbers(list(row.values()), given)
        S = H @ P.astype(float) @ H.T + np.diag(R)
        rng = np.random.default_rng(2)
        expected = self.numbers(h, given)
        z = (expected + 0.1 * np.linalg.cholesky(S) @ rng.normal(size=len(S))).astype(np.float32)
        K = np.linalg.solve(S, H @ P.astype(float)).T
        dx = dict(zip(self.dx, K @ (z.astype(float) - expected), strict=True))
        new = self.numbers([e.subs(dx) for e in self.corrected], given)
        return z, new, P - K @ S @ K.T
