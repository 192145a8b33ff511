"""How far the transition and the process noise of a step are off the exact ones, at the rate that was chosen.

The exact ones are products of matrix exponentials [1]_ of F and G W G' over parts of a step, along a motion whose body
rate is `TURN` about each axis and whose specific force in body axes is that of rest: the attitude turns within a step.

References
----------
.. [1] C. F. Van Loan, Computing integrals involving the matrix exponential, IEEE Transactions on Automatic Control
   23(3), 1978.
"""

from __future__ import annotations

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from kfgen.core.tape import tape
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.motion import ACCEL, GYRO
from kfgen.model.register import DT

Array = NDArray[np.float64]
TURN = 1.0
"""Rate about each axis [rad/s]."""
SECONDS = 1.0
MAX_STEPS, PARTS = 100, 3
"""Steps that are looked at, and parts of each for the exact ones."""
NOTHING = 1e-9
"""Standard deviations that rounding makes."""


def step_accuracy(discrete: DiscreteModel) -> tuple[str, ...]:
    """Order and error of Phi and Qd, a sentence each; none of a model without attitude, with drivers or late inputs.

    Parameters
    ----------
    discrete : DiscreteModel
    """
    model = discrete.model
    if model.attitude is None or model.drivers or model.motion.late:
        return ()
    turning = _Turning(discrete)
    names = [s.name for s in model.states]
    n, steps, dt = len(names), round(SECONDS * discrete.rate), 1.0 / discrete.rate
    begins: Array = np.arange(min(steps, MAX_STEPS), dtype=np.float64) * dt
    middles: Array = (np.arange(begins.size * PARTS, dtype=np.float64) + 0.5) * dt / PARTS
    Qd = turning.at(3, begins)
    Phi, found = _after(n, turning.at(2, begins), Qd)
    exact, true = _after(n, *turning.exact(middles, dt / PARTS))
    prior = np.array([s.prior for s in model.states])
    off = np.abs(Phi - exact) * prior / prior[:, None]
    if not np.isfinite(off).all():
        return ()
    i, j = np.unravel_index(int(off.argmax()), off.shape)
    after = f"after {min(steps, MAX_STEPS) * dt:.3g} s of predictions at {discrete.rate:.6g} Hz"
    size = f"{off.max():.1e}" if off.max() > NOTHING else "less than 1e-9"
    return (
        f"Phi is of order {discrete.order} in the step: {after} that turn at {TURN:g} rad/s about each axis its error is "
        f"{size} prior standard deviations at most ({names[i]} from {names[j]}).",
        *_said(discrete.order, names, after, np.diag(true), np.diag(found), Qd[0]),
    )


def _said(order: int, names: list[str], after: str, true: Array, found: Array, Qd: Array) -> tuple[str, ...]:
    driven = [k for k in range(len(names)) if true[k] > 0.0]
    if not driven:
        return ()
    ratio = {k: float(np.sqrt(found[k] / true[k])) - 1.0 for k in driven}
    worst = max(ratio, key=lambda k: abs(ratio[k]))
    none = [names[k] for k in driven if Qd[k, k] == 0.0]
    without = f" That of one step is zero for {', '.join(none)}." if none else ""
    return (
        f"Qd is of order {order}: {after} the standard deviation from noise alone is off by "
        f"{100.0 * ratio[worst]:+.1g} % at most ({names[worst]}).{without}",
    )


def _after(n: int, Phi: Array, Qd: Array) -> tuple[Array, Array]:
    """Transition and noise covariance after all steps."""
    whole, P = np.eye(n), np.zeros((n, n))
    for T, Q in zip(Phi, Qd):
        whole, P = T @ whole, T @ P @ T.T + Q
    return whole, P


class _Turning:
    """The matrices of a model along the motion.

    Parameters
    ----------
    discrete : DiscreteModel
        With an attitude.
    """

    def __init__(self, discrete: DiscreteModel) -> None:
        model = discrete.model
        assert model.attitude is not None
        matrices = (model.F, model.G * model.W * model.G.T, discrete.Phi, discrete.Qd)
        self.n = model.F.rows
        rotation = list(model.attitude.nominal)
        given = _values(discrete)
        known = {
            s: sp.Float(given.get(s.name, np.nan)) for M in matrices for s in M.free_symbols - set(rotation)
        }
        self._tapes = [tape(list(M.xreplace(known)), rotation) for M in matrices]

    def at(self, which: int, t: Array) -> Array:
        """A matrix at times [s], shape (t, n, n): 0 F, 1 G W G', 2 Phi, 3 Qd."""
        R = Rotation.from_rotvec(np.outer(t, [TURN] * 3)).as_matrix().reshape(len(t), 9)
        values = self._tapes[which].values(list(R.T))
        columns = [np.broadcast_to(v, t.shape) for v in values]
        return np.stack(columns, axis=1).reshape(len(t), self.n, self.n)

    def exact(self, t: Array, dt: float) -> tuple[Array, Array]:
        """Phi and Qd of short steps about times [s], by matrix exponentials."""
        n, F, W = self.n, self.at(0, t), self.at(1, t)
        below = np.concatenate([np.zeros_like(F), F.transpose(0, 2, 1)], axis=2)
        whole = expm(np.concatenate([np.concatenate([-F, W], axis=2), below], axis=1) * dt)
        T = whole[:, n:, n:].transpose(0, 2, 1)
        return T, T @ whole[:, :n, n:]


def _values(discrete: DiscreteModel) -> dict[str, float]:
    """Of every symbol but the attitude's, by name."""
    model = discrete.model
    values = dict(zip(discrete.nominal_names, discrete.start)) | {c.name: c.value for c in model.constants}
    for i in model.motion.inputs:
        values |= dict.fromkeys(i.channels, TURN if i.name == GYRO.name else 0.0)
    if ACCEL.name in [i.name for i in model.motion.inputs]:
        values |= dict(zip(ACCEL.channels, (0.0, 0.0, -STANDARD_GRAVITY)))
    return values | {str(DT): 1.0 / discrete.rate}
