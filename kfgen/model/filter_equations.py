"""The equations of a filter in numbers, at many states at once or one after the other: step, transition, noise, readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.tape import ROWS_AT_ONCE, Tape, tape
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.sensors import Sensor
from kfgen.model.register import DT
from kfgen.model.symbols.blocks import Attitude
from kfgen.model.symbols.rotation import matrix_of

Array = NDArray[np.float64]

DIFFERENCE_ROUNDS = 3
"""Of Newton's method for the error between two stored states; attitudes a tenth of a radian apart need two."""
NO_ANGLE_RAD = 1e-14
"""Angle that another round would add, at which there is none; a round leaves the angle times what it added itself."""


@dataclass(frozen=True)
class SparseRows:
    """Entries of matrices that are not zero: a tape, and their rows and columns."""

    tape: Tape
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    shape: tuple[int, int]

    def entries(self, given: Sequence[Array]) -> Array:
        """The entries at every set of values, shape (m, entries)."""
        return self.tape.table(given)

    def at(self, given: Sequence[Array]) -> Array:
        """The matrices at every set of values, shape (m, rows, columns)."""
        entries = self.entries(given)
        out = np.zeros((entries.shape[0], *self.shape))
        out[:, self.rows, self.columns] = entries
        return out


@dataclass(frozen=True)
class FilterEquations:
    """A discrete filter in numbers.

    Parameters
    ----------
    discrete : DiscreteModel
    """

    discrete: DiscreteModel

    @property
    def n(self) -> int:
        """Error states."""
        return len(self.discrete.model.states)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the stored state."""
        return self.discrete.nominal_names

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Of the inputs, in the order of the model."""
        return tuple(c for i in self.discrete.model.motion.inputs for c in i.channels)

    @cached_property
    def variables(self) -> tuple[sp.Symbol, ...]:
        """What every tape is given: stored state, inputs, drivers, constants, step, errors."""
        drivers, errors = self.discrete.model.drivers, self._errors
        given = (*self.names, *self.channels, *drivers, *(c.name for c in self.discrete.model.constants))
        return (*(sp.Symbol(n, real=True) for n in given), DT, *errors)

    @cached_property
    def _errors(self) -> tuple[sp.Symbol, ...]:
        return tuple(s.error for s in self.discrete.model.states)

    def given(
        self, x: Array, u: Array, drive: Mapping[str, Array], constants: Mapping[str, float], dt: float
    ) -> list[Array]:
        """Values of `variables`, the errors zero.

        Parameters
        ----------
        x : ndarray, shape (m, stored)
        u : ndarray, shape (m, inputs)
        drive : mapping of str to ndarray, shape (m,)
        constants : mapping of str to float
            Of the model, in its order.
        dt : float
            Step [s].
        """
        columns = [*x.T, *u.T, *(drive[d] for d in self.discrete.model.drivers)]
        fixed = [np.full(1, v) for v in (*constants.values(), dt)]
        return [*columns, *fixed, *(np.zeros(1) for _ in self._errors)]

    @cached_property
    def _rotation(self) -> dict[sp.Expr, sp.Expr]:
        """Entries of rotation matrices in stored quaternions."""
        found = [b for b in self.discrete.model.blocks if isinstance(b, Attitude)]
        return {a: e for b in found for a, e in zip(b.nominal, matrix_of(b.quaternion))}

    def tape(self, expressions: Sequence[sp.Expr]) -> Tape:
        """Expressions of the model as a tape of `variables`."""
        return tape(
            [sp.sympify(e, strict=True).xreplace(self._rotation) for e in expressions], self.variables
        )

    def _sparse(self, M: sp.Matrix, before: Sequence[sp.Expr] = ()) -> SparseRows:
        """The entries of a matrix that are not zero; on the tape stand other expressions before them."""
        at = [(i, j) for i in range(M.rows) for j in range(M.cols) if M[i, j] != 0]
        made = self.tape([*before, *(M[i, j] for i, j in at)])
        rows, columns = (np.array(x, dtype=np.int64) for x in (list(zip(*at)) or [(), ()]))
        return SparseRows(made, rows, columns, (M.rows, M.cols))

    @cached_property
    def transition(self) -> SparseRows:
        """``Phi``, shape (n, n)."""
        return self._sparse(self.discrete.Phi)

    @cached_property
    def process_noise(self) -> SparseRows:
        """``Qd``, shape (n, n)."""
        return self._sparse(self.discrete.Qd)

    @cached_property
    def input_noise(self) -> dict[str, SparseRows]:
        """What the noise of each input alone gives to ``Qd``, entries where `process_noise` has them."""
        Qd, named = self.discrete.named_noise
        places = self.process_noise
        at = list(zip(places.rows.tolist(), places.columns.tolist()))
        out = {}
        for name, (symbol, density) in named.items():
            made = self.tape([density * sp.diff(Qd[i, j], symbol) for i, j in at])
            out[name] = SparseRows(made, places.rows, places.columns, places.shape)
        return out

    @cached_property
    def input_errors(self) -> SparseRows:
        """By how much an error of each input moves the error state in a step, shape (n, inputs)."""
        model = self.discrete.model
        G = model.G[:, : len(self.channels)]
        return self._sparse(G * DT)

    @cached_property
    def step(self) -> Tape:
        """The stored state after a step, quaternions not normalised."""
        return self.tape(self.discrete.step)

    @cached_property
    def prediction(self) -> Tape:
        """The step, then the entries of `transition` and of `process_noise`, in one tape."""
        Phi, Qd, F, Q = self.discrete.Phi, self.discrete.Qd, self.transition, self.process_noise
        entries = [Phi[i, j] for i, j in zip(F.rows.tolist(), F.columns.tolist())]
        entries += [Qd[i, j] for i, j in zip(Q.rows.tolist(), Q.columns.tolist())]
        return self.tape([*self.discrete.step, *entries])

    def readings(self, sensors: Sequence[Sensor]) -> SparseRows:
        """The expected samples of sensors, then the entries of their Jacobian, in one tape."""
        names = tuple(s.name for s in sensors)
        if names not in self._readings:
            h = sp.Matrix.vstack(*(self.discrete.expected(s) for s in sensors))
            H = sp.Matrix.vstack(*(self.discrete.H(s) for s in sensors))
            self._readings[names] = self._sparse(H, before=list(h))
        return self._readings[names]

    @cached_property
    def _readings(self) -> dict[tuple[str, ...], SparseRows]:
        """Of sensors by their names, as they were asked for: a filter flies over one log many times."""
        return {}

    @cached_property
    def inject(self) -> Tape:
        """The stored state with the errors put in, quaternions not normalised."""
        return self.tape(self.discrete.model.corrected)

    @cached_property
    def true_inputs(self) -> Tape:
        """What each input should have read, by the estimate."""
        found = self.discrete.model.inputs(False)
        return self.tape([e for i in self.discrete.model.motion.inputs for e in found[i.name]])

    @cached_property
    def level(self) -> SparseRows:
        """Navigation axes to north, east and down, shape (3, 3)."""
        model = self.discrete.model
        return self._sparse(model.motion.offers({b.name: b.value for b in model.motion.blocks}, {})["level"])

    @cached_property
    def _of_sensors(self) -> dict[str, tuple[Tape, Tape, SparseRows]]:
        d = self.discrete
        return {
            s.name: (self.tape(list(d.expected(s))), self.tape(list(d.model.clean(s))), self._sparse(d.H(s)))
            for s in d.model.sensors
        }

    def reading(self, sensor: Sensor) -> Tape:
        """The expected sample of a sensor."""
        return self._of_sensors[sensor.name][0]

    def clean(self, sensor: Sensor) -> Tape:
        """The expected sample of a sensor without any effect."""
        return self._of_sensors[sensor.name][1]

    def jacobian(self, sensor: Sensor) -> SparseRows:
        """Of the expected sample, shape (rows, n)."""
        return self._of_sensors[sensor.name][2]

    @cached_property
    def quaternions(self) -> tuple[int, ...]:
        """Where quaternions begin in the stored state."""
        out, k = [], 0
        for b in self.discrete.model.blocks:
            if isinstance(b, Attitude):
                out.append(k)
            k += len(b.nominal_names)
        return tuple(out)

    def normalised(self, x: Array) -> Array:
        """Stored states, shape (m, stored), with quaternions of unit length."""
        for k in self.quaternions:
            x[:, k : k + 4] /= np.linalg.norm(x[:, k : k + 4], axis=1)[:, None]
        return x

    def stepped(self, given: Sequence[Array]) -> Array:
        """Every state one step on, shape (m, stored)."""
        return self.normalised(self.step.table(given))

    def injected(self, x: Array, error: Array) -> Array:
        """Stored states, shape (m, stored), with errors, shape (m, n), put in."""
        given = [*self._around(x), *error.T]
        made = self.inject.table(given)
        return self.normalised(
            np.hstack([made, x[:, made.shape[1] :]])
        )  # kept samples of inputs have no error

    def _around(self, x: Array) -> list[Array]:
        """Values of `variables` without the errors, where only the stored state matters."""
        rest = len(self.variables) - len(self.names) - self.n
        return [*x.T, *(np.zeros(1) for _ in range(rest))]

    @cached_property
    def _places(self) -> list[tuple[int, int, bool]]:
        """First entry of each block in the stored state and in the error, and whether it is an attitude."""
        out, stored, error = [], 0, 0
        for b in self.discrete.model.blocks:
            out.append((stored, error, isinstance(b, Attitude)))
            stored, error = stored + len(b.nominal_names), error + len(b.error_names)
        return [*out, (stored, error, False)]

    def difference(self, x: Array, y: Array) -> Array:
        """The errors, shape (m, n), that lead from stored states `x` to `y`, each of shape (m, stored).

        Newton's method with the derivative at no error: of vectors it is one; of a unit quaternion in its angle its
        columns are orthogonal and half as long, so that four times its transpose is its inverse.
        """
        parts = [slice(k, k + ROWS_AT_ONCE) for k in range(0, x.shape[0], ROWS_AT_ONCE)]
        return np.concatenate(
            [np.zeros((0, self.n)), *(self._difference(x[part], y[part]) for part in parts)]
        )

    def _difference(self, x: Array, y: Array) -> Array:
        y = y.copy()
        slopes = {}
        for stored, _, attitude in self._places:
            if attitude:
                q = slice(stored, stored + 4)
                y[np.einsum("mi,mi->m", x[:, q], y[:, q]) < 0.0, q] *= -1.0
                columns = self._turned[stored].table([*self._around(x), *np.zeros((self.n, 1))])
                slopes[stored] = [columns[:, k : k + 4] for k in (0, 4, 8)]
        out = np.zeros((x.shape[0], self.n))
        for _ in range(DIFFERENCE_ROUNDS):
            away, before = y - (self.injected(x, out) if out.any() else x), out.copy()
            for (stored, error, attitude), end in zip(self._places, [*self._places[1:], (0, self.n, False)]):
                if attitude:
                    q = slice(stored, stored + 4)
                    for k, slope in enumerate(slopes[stored]):
                        out[:, error + k] += 4.0 * np.einsum("mi,mi->m", slope, away[:, q])
                else:
                    out[:, error : end[1]] += away[:, stored : stored + end[1] - error]
            turned = [slice(e, e + 3) for _, e, attitude in self._places if attitude]
            left = (
                np.abs(out[:, e] - before[:, e]).max(initial=0.0) * np.abs(out[:, e]).max(initial=0.0)
                for e in turned
            )
            if max(left, default=0.0) < NO_ANGLE_RAD:
                break
        return out

    @cached_property
    def _turned(self) -> dict[int, Tape]:
        """Of the quaternion that begins at each place: derivatives in its attitude's three errors at none, one after the other."""
        e, corrected = self._errors, self.discrete.model.corrected
        none = dict.fromkeys(e, 0)
        return {
            q: self.tape(
                [sp.diff(x, e[error + k]).subs(none) for k in range(3) for x in corrected[q : q + 4]]
            )
            for q, error, attitude in self._places
            if attitude
        }
