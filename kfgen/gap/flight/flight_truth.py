"""What every sensor should have read along the smoothed path of a filter.

Rates and forces are means over some tenths of a second: what an effect makes of the noise of the inertial sensors is not
information about the effect, and would be taken for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.inertial.vibration import vibration_power
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.motion.model_truth import should_read
from kfgen.gap.motion.truth import Truth
from kfgen.model.parts.reading import speed_squared
from kfgen.simulate.scene import Part

Array = NDArray[np.float64]

MOTION_AVERAGE_S = 0.12
"""Over which rates and forces are averaged where they drive effects [s]."""


def flight_truth(path: FlownPath) -> Truth:
    """What every sensor should have read along a path.

    Parameters
    ----------
    path : FlownPath
        Of a model with an attitude.
    """
    log, model, eq = path.log, path.log.discrete.model, path.equations
    n = log.t.size
    inputs = averaged(eq.true_inputs.table(path.given), log.dt)
    rate, force = (_triad(path, inputs, name) for name in ("gyro", "accel"))
    R_nb = _attitude(path)
    parts: list[tuple[Part, Array]] = [(i, inputs[:, log.triads[i.name]]) for i in model.motion.inputs]
    parts += [(a.sensor, eq.clean(a.sensor).table(path.given)) for a in log.aiding]
    should = should_read(parts, np.swapaxes(R_nb, 1, 2))
    power = None if force is None else vibration_power(log.u[:, log.triads["accel"]], log.dt)
    return Truth(
        log.t, should.read, should.axes, np.ones(n, dtype=bool), omega_b=rate, f_b=force, power=power,
        warmth=log.drive.get("temperature"), R_bn=np.swapaxes(eq.level.at(path.given) @ R_nb, 1, 2),
        places=should.places, antennas=should.antennas,
        speed_squared=speed_squared(model, dict(zip(eq.names, path.x.T))),
        words=("the smoothed path of the filter says what every sensor should have read",),
    )  # fmt: skip


def averaged(values: Array, dt: float) -> Array:
    """Courses, shape (n, ...), as means over `MOTION_AVERAGE_S`."""
    from scipy.ndimage import uniform_filter1d

    width = max(1, round(MOTION_AVERAGE_S / dt))
    return np.asarray(uniform_filter1d(values, width + 1 - width % 2, axis=0, mode="nearest"))


def _triad(path: FlownPath, inputs: Array, name: str) -> Array | None:
    """A triad of body axes, from an input or from a sensor, shape (n, 3); None where the model has none."""
    if name in path.log.triads and path.log.triads[name].stop - path.log.triads[name].start == 3:
        return inputs[:, path.log.triads[name]]
    for a in path.log.aiding:
        if a.sensor.name == name and len(a.sensor.channels) == 3:
            found = path.equations.clean(a.sensor).table(path.given)
            return averaged(found, path.log.dt)
    return None


def _attitude(path: FlownPath) -> Array:
    """Body axes to the model's navigation axes along the path, shape (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    k = path.equations.quaternions[0]
    return np.asarray(Rotation.from_quat(path.x[:, k : k + 4], scalar_first=True).as_matrix())
