"""Errors of inertial triads that grow with what they measure, as states.

What a triad shows beyond bias and noise is ``s``; the truth is ``u = (I - M) s``, of the gyros
``omega = (I - M_g) s_g - D_g f``: M holds scale factors on its diagonal and misalignments beside it, D the
sensitivity of the gyros to specific force. To first order this is ``s = (I + M) u``.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, eqs (4.16), (4.17).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from kfgen.model.option import Choice, Option, Quantity, YesNo
from kfgen.model.symbols.blocks import Vector

NONE, TRIANGULAR, DIAGONAL, FULL = "none", "triangular", "diagonal", "full"
AXES = "xyz"
SIDE = tuple(f"{a}{b}" for a in AXES for b in AXES if a != b)
"""Entries beside the diagonal: output axis, input axis."""
ABOVE = ("xy", "xz", "yz")

SCALE_FACTORS = Option(
    "scale_factors", "scale factors of gyros and accelerometers as states", YesNo(), "false"
)
MISALIGNMENT = Option(
    "misalignment",
    "misalignments as states: six of the gyros with three (triangular) or six (full) of the accelerometers",
    Choice((NONE, TRIANGULAR, FULL)),
    NONE,
)
G_SENSITIVITY = Option(
    "g_sensitivity",
    "sensitivity of the gyros to specific force as states: three or nine",
    Choice((NONE, DIAGONAL, FULL)),
    NONE,
)

INTRINSICS_SD = Option(
    "intrinsics_sd", "deviation of scale factors and misalignments before the log", Quantity("1"), "0.005"
)


@dataclass(frozen=True)
class Intrinsics:
    """The states of a choice, and what they do to the triads.

    Parameters
    ----------
    chosen : mapping of str to value
        Of the options above.
    triads : tuple of str
        Whose they are.
    """

    chosen: Mapping[str, object]
    triads: tuple[str, ...] = ("gyro", "accel")

    @property
    def blocks(self) -> tuple[Vector, ...]:
        """Constant states, gyros first."""
        out: list[Vector] = []
        sd = float(str(self.chosen["intrinsics_sd"]))
        words = {"gyro": "gyro", "accel": "accelerometer"}
        if self.chosen["scale_factors"]:
            out += [Vector(f"s{t[0]}", tuple(AXES), "1", f"{words[t]} scale factor", sd) for t in self.triads]
        if self.chosen["misalignment"] != NONE:
            above = {"accel"} if self.chosen["misalignment"] == TRIANGULAR else set()
            for t in self.triads:
                beside = ABOVE if t in above else SIDE
                out.append(Vector(f"m{t[0]}", beside, "rad", f"{words[t]} misalignment", sd))
        if self.chosen.get("g_sensitivity", NONE) != NONE:
            entries = tuple(f"{a}{a}" for a in AXES) if self.chosen["g_sensitivity"] == DIAGONAL else ()
            entries = entries or tuple(f"{a}{b}" for a in AXES for b in AXES)
            out.append(Vector("dg", entries, "rad*s/m", "gyro g-sensitivity", 2e-4))
        return tuple(out)

    def _matrix(self, x: Mapping[str, sp.Matrix], name: str) -> sp.Matrix:
        """The matrix of a block's entries, shape (3, 3); zero where it has none."""
        M = sp.zeros(3, 3)
        for b in self.blocks:
            if b.name == name:
                for entry, value in zip(b.axes, x[name]):
                    M[AXES.index(entry[0]), AXES.index(entry[-1])] = value
        return M

    def true_inputs(self, x: Mapping[str, sp.Matrix], shown: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """The true triads from what they show."""
        out = {}
        for t in self.triads:
            M = self._matrix(x, f"s{t[0]}") + self._matrix(x, f"m{t[0]}")
            out[t] = shown[t] - M * shown[t]
        if "accel" in out:
            out["gyro"] -= self._matrix(x, "dg") * out["accel"]
        return out
