"""The true motion of a manoeuvre, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

GRAVITY_N = np.array([0.0, 0.0, STANDARD_GRAVITY])


@dataclass(frozen=True)
class Truth:
    """The true motion: `R_nb` (n, 3, 3); `v_n`, `p_n`, `a_n`, `omega_b`, `f_b` (n, 3)."""

    t: Array
    R_nb: Array
    v_n: Array
    p_n: Array
    a_n: Array
    omega_b: Array
    f_b: Array


def truth(manoeuvre: Manoeuvre, t: Array) -> Truth:
    """Integrate a manoeuvre from its start at the origin; rates and accelerations are held over a sample.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    """
    from scipy.spatial.transform import Rotation

    dt = float(t[1] - t[0]) if t.size > 1 else 1.0
    omega, a, a_b = manoeuvre.values(t)
    steps = Rotation.from_rotvec(omega * dt)
    q = Rotation.from_quat(manoeuvre.attitude, scalar_first=True)
    matrices = np.empty((t.size, 3, 3))
    for k, step in enumerate(steps):
        matrices[k] = q.as_matrix()
        q = q * step
    a = a + np.einsum("kij,kj->ki", matrices, a_b)
    v = np.array(manoeuvre.velocity) + np.vstack([np.zeros(3), np.cumsum(a[:-1] * dt, axis=0)])
    p = np.vstack([np.zeros(3), np.cumsum(v[:-1] * dt + 0.5 * a[:-1] * dt**2, axis=0)])
    return Truth(t, matrices, v, p, a, omega, np.einsum("kij,ki->kj", matrices, a - GRAVITY_N))
