"""The states of a small autopilot: strapdown navigation with the magnetic field, in Earth and in the body, and wind.

References
----------
.. [1] PX4 Autopilot, EKF2 derivation (src/modules/ekf2/EKF/python/ekf_derivation), the 23 error states.
"""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from kfgen.model.blocks import Vector
from kfgen.model.motion import Strapdown
from kfgen.model.sensors import FIELD, Sensor


class StrapdownInWind(Strapdown):
    """Strapdown navigation; the field and the wind keep their values."""

    blocks = (
        *Strapdown.blocks,
        Vector(
            "m",
            ("N", "E", "D"),
            "T",
            "magnetic field of the Earth",
            5e-6,
            (FIELD[0].value, 0.0, FIELD[1].value),
        ),
        Vector("bm", ("x", "y", "z"), "T", "magnetic field of the body", 1e-5),
        Vector("w", ("N", "E"), "m/s", "wind", 3.0),
    )

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """Strapdown's, and none of field and wind."""
        kept = {b.name: sp.zeros(len(b.axes), 1) for b in self.blocks if b not in Strapdown.blocks}
        return {**super().rates(x, u), **kept}


class FieldVector(Sensor):
    """A magnetometer triad in an unknown field: ``m_b = R_bn m_n + bm``."""

    name = "field"
    title = "magnetic field vector, the field being a state"
    unit = "T"
    channels = ("mag_x", "mag_y", "mag_z")
    sd = 2e-7
    left_out = 5e-7
    needs = ("phi", "m", "bm")

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """The field in body axes with the body's own."""
        return x["phi"].T * x["m"] + x["bm"]


class Airspeed(Sensor):
    """The speed through the air: ``|v - w|``."""

    name = "airspeed"
    title = "true airspeed"
    unit = "m/s"
    channels = ("airspeed",)
    sd = 0.5
    left_out = 0.5
    needs = ("v", "w")

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """The length of velocity less wind; at least a little, where its slope would have no meaning."""
        north, east, down = x["v"][0] - x["w"][0], x["v"][1] - x["w"][1], x["v"][2]
        return sp.Matrix([sp.sqrt(north**2 + east**2 + down**2 + LEAST_SPEED**2)])


LEAST_SPEED = 0.1
"""[m/s]"""
