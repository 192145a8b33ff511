"""The augmented filter of Hemerly as a library model: parameters of a sensor's noise as states.

Its equations stand in `kfgen.arma.state_space`; F and H follow by differentiation like those of every model, so that
``Phi`` to first order and ``H`` are ``A`` and ``C`` of eq. (22) of [1]_.

References
----------
.. [1] E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp

from kfgen.arma import state_space
from kfgen.effects import make
from kfgen.effects.noise_model import NoiseModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.motion import Input, MotionModel
from kfgen.model.parts.sensors import AtRest
from kfgen.model.symbols.blocks import Vector

TITLES = ("integrated noise", "noise", "bias instability", "random walk", "inverse correlation time")
UNITS = ("s^1.5", "s^0.5", "rad/s^0.5", "rad/s^1.5", "1/s")
USUAL = (1000.0, 7.0, float(np.deg2rad(1.55e-2)), float(np.deg2rad(9e-4)), 0.01)
"""Where the filter starts: B, K and beta of sec. 2.2 of [1]_, x1 and x2 about a standard deviation off zero."""
PRIORS = (1e3, 10.0, *USUAL[2:])
"""Standard deviations before the first sample: of the parameters as large as they are."""
N = float(np.deg2rad(5.75e-2))
"""White noise of sec. 2.2 [rad/s/sqrt(Hz)]."""
DRIVER = Input(
    "driver", "s^-0.5", "what drives x2 beside noise: zero", "bd", 0.0, 1.0, scalar=True, quiet=True
)


class Augmented(MotionModel):
    """States and parameters together, eqs (19) and (21)."""

    blocks = tuple(
        Vector(n, ("",), u, t, p, (v,))
        for n, u, t, p, v in zip(state_space.STATE_NAMES, UNITS, TITLES, PRIORS, USUAL)
    )
    inputs = (DRIVER,)

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """Of the continuous system; the driver acts on x2."""
        rates = state_space.rates()
        rates[1] += u[DRIVER.name][0]
        values = {s: x[s.name][0] for s in state_space.STATES}
        return {s.name: sp.Matrix([r.xreplace(values)]) for s, r in zip(state_space.STATES, rates)}


class AugmentedOutput(AtRest):
    """One sensor axis at rest, seen through the augmented state, eq. (20)."""

    title = "one axis at rest, its noise in states"
    needs = state_space.STATE_NAMES

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """The output."""
        return sp.Matrix([state_space.output().xreplace({s: x[s.name][0] for s in state_space.STATES})])


def hemerly(name: str, title: str, noise: NoiseModel | None) -> FilterModel:
    """The filter; of a noise file only the white noise of gyro_x is taken, the rest are states."""
    known = noise.channels["gyro_x"].effects if noise and "gyro_x" in noise.channels else ()
    white = tuple(e for e in known if e.name == "white_noise") or (make("white_noise", N=N),)
    effects = {DRIVER.name: (make("white_noise", N=DRIVER.N),), "gyro_x": white}
    sensor = AugmentedOutput("gyro_x", "rad/s")
    return FilterModel(name, title, Augmented(), (sensor,), effects, {"gyro_x": "rad/s"})
