"""Strapdown navigation in Earth axes.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, sec. 5.2, eqs (5.25), (5.35).
"""

from __future__ import annotations

import sympy as sp

from kfgen.core.wgs84 import EARTH_RATE
from kfgen.model.option import Option, YesNo
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.earth import geodetic, gravity_e, place
from kfgen.model.parts.motion import (
    COMMON,
    CONSTANT,
    GRAVITY_MODEL,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    NORMAL,
    Inertial,
    Strapdown,
    Views,
)


class EarthFixed(Inertial):
    """Strapdown navigation in Earth axes, ``p`` from an origin that is constant [1]_."""

    axes = ("x", "y", "z")
    options = (
        *COMMON,
        Option("earth_rate", "the Earth turns", YesNo(), "true"),
        Option(
            "gravity_model",
            "constant as at the origin, or normal gravity of the place",
            GRAVITY_MODEL,
            NORMAL,
        ),
        LATITUDE,
        LONGITUDE,
        HEIGHT,
    )

    @property
    def _origin(self) -> tuple[float, float, float]:
        return place(self.chosen["latitude"], self.chosen["longitude"], self.chosen["height"])

    @property
    def constants(self) -> tuple[Constant, ...]:  # type: ignore[override]
        """The origin, and gravity there where it is held."""
        names = ("o_x", "o_y", "o_z")
        out = [
            Constant(n, "m", v, f"{n[-1]} of the origin in Earth axes") for n, v in zip(names, self._origin)
        ]
        if self.chosen["gravity_model"] == CONSTANT:
            g = gravity_e(sp.Matrix(self._origin))
            out += [
                Constant(f"g_{a}", "m/s^2", float(v), f"gravity at the origin, {a}") for a, v in zip("xyz", g)
            ]
        return tuple(out)

    def _place(self, x: Views) -> sp.Matrix:
        return sp.Matrix([sp.Symbol(f"o_{a}", real=True) for a in "xyz"]) + x["p"]

    def _gravity(self, x: Views) -> sp.Matrix:
        if self.chosen["gravity_model"] == CONSTANT:
            return sp.Matrix([sp.Symbol(f"g_{a}", real=True) for a in "xyz"])
        return gravity_e(self._place(x))

    def rates(self, x: Views, u: Views) -> dict[str, sp.Matrix]:
        """``v' = R_eb f + g - 2 omega_ie x v``, ``omega_eb = omega_ib - R_be omega_ie``."""
        omega_ie = sp.Matrix([0, 0, EARTH_RATE if self.chosen["earth_rate"] else 0])
        v_rate = x["phi"] * u["accel"] + self._gravity(x) - 2 * omega_ie.cross(x["v"])
        return {"p": x["v"], "v": v_rate, "phi": u["gyro"] - x["phi"].T * omega_ie}

    def offers(self, x: Views, rates: Views) -> dict[str, sp.Matrix]:
        """North-east-down at the place, and the height above the origin's."""
        r = self._place(x)
        s, c, h = geodetic(r)
        rho = sp.sqrt(r[0] ** 2 + r[1] ** 2)
        a, b = r[0] / rho, r[1] / rho
        level = sp.Matrix([[-s * a, -s * b, c], [-b, a, 0], [-c * a, -c * b, -s]])
        return super().offers(x, rates) | {"level": level, "height": sp.Matrix([h - self.chosen["height"]])}


FRAMES: dict[str, type[Inertial]] = {"ned": Strapdown, "ecef": EarthFixed}
"""Navigation frames by name."""
