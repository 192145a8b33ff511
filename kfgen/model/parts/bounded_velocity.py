"""The acceleration of a body whose velocity is bounded: what accelerometers show beside gravity.

A hand, a limb or a robot's arm does not fly away: its acceleration is the rate of a velocity that stays small. Its
spectrum therefore goes to zero with the frequency, which white noise and a Gauss-Markov acceleration, both largest
at zero, do not say: they make a filter wait for an average that the body has long taken. The velocity here
is a critically damped Markov process of second order [1]_, so that it has a derivative,

``v' = a``, ``a' = -2 beta a - beta^2 v + w``, ``beta = 1 / tau``, density of w ``q = 4 beta^3 sigma^2``,

stationary with standard deviations ``sigma`` of v and ``beta sigma`` of a. It lives in navigation axes: a body's
axes turn, and in them no velocity is bounded.

References
----------
.. [1] A. Gelb (ed.), Applied Optimal Estimation, MIT Press, 1974, table 2.2-1 (second-order Markov process).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from kfgen.model.option import Choice, Option, Quantity
from kfgen.model.symbols.blocks import Vector

WHITE, BOUNDED = "white", "bounded"
ACCELERATION = Option(
    "acceleration",
    "acceleration of the body seen by the accelerometers: white noise, or of a bounded velocity, as states",
    Choice((WHITE, BOUNDED)),
    WHITE,
)
# A hand or a limb moves by some tenths of a metre a second and changes its mind in a tenth of one: 3 m/s^2.
SPEED = Option("speed", "standard deviation of a bounded velocity", Quantity("m/s"), "0.3 m/s")
SPEED_TIME = Option("speed_time", "time constant of a bounded velocity", Quantity("s"), "0.1 s")


@dataclass(frozen=True)
class BoundedVelocity:
    """The states of a velocity that is bounded.

    Parameters
    ----------
    sigma : float
        Its standard deviation [m/s].
    tau : float
        Its time constant [s].
    """

    sigma: float
    tau: float

    @property
    def blocks(self) -> tuple[Vector, Vector]:
        """Velocity and acceleration in navigation axes, from their stationary standard deviations on."""
        beta, axes = 1.0 / self.tau, ("N", "E", "D")
        return (
            Vector("vl", axes, "m/s", "bounded velocity", self.sigma),
            Vector(
                "al",
                axes,
                "m/s^2",
                "acceleration",
                beta * self.sigma,
                driven=2.0 * beta**1.5 * self.sigma,
            ),
        )

    def rates(self, x: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """Of both blocks, without the noise."""
        beta = sp.Float(1.0 / self.tau)
        return {"vl": x["al"], "al": -2 * beta * x["al"] - beta**2 * x["vl"]}
