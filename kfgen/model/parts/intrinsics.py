"""Options for errors of inertial triads that grow with what they measure: each attaches an effect as states.

To first order the truth is undone from what a triad shows beyond bias and noise, ``u = (I - M) s``, of the gyros
``omega = (I - M_g) s_g - D_g f``: M holds scale factors on its diagonal and misalignments beside it, D the
sensitivity of the gyros to specific force.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, eqs (4.16), (4.17).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from kfgen.core.channel_names import AXES
from kfgen.effects import make
from kfgen.model.option import Choice, Option, Quantity, YesNo
from kfgen.model.parts.attached_error import AttachedError, attached, unknown_state

NONE, TRIANGULAR, DIAGONAL, FULL = "none", "triangular", "diagonal", "full"
SIDE = tuple(f"{a}{b}" for a in AXES for b in AXES if a != b)
"""Entries beside the diagonal: output axis, input axis."""
ABOVE = ("xy", "xz", "yz")
SCALE = ("coefficient",)
G_SENSITIVITY_SD = 2e-4
"""Standard deviation of a gyro's sensitivity to specific force before a log [rad s/m]."""

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
    "intrinsics_sd",
    "standard deviation of scale factors and misalignments before the log",
    Quantity("1"),
    "0.005",
)


def intrinsic_errors(chosen: Mapping[str, Any], units: Mapping[str, str]) -> tuple[AttachedError, ...]:
    """The effects that the options attach, those of the gyros first.

    Parameters
    ----------
    chosen : mapping of str to value
        Of the options above.
    units : mapping of str to str
        SI unit by triad (``gyro``, ``accel``), in the order of the states.
    """
    out: list[AttachedError] = []
    sd = float(chosen["intrinsics_sd"])
    if chosen["scale_factors"]:
        out += [
            attached(f"{t}_{a}", make("scale_factor", coefficient=0.0), u, unknown_state(sd, SCALE), SCALE)
            for t, u in units.items()
            for a in AXES
        ]
    if chosen["misalignment"] != NONE:
        above = {"accel"} if chosen["misalignment"] == TRIANGULAR else set()
        out += [_matrix(t, "misalignment", u, sd, ABOVE if t in above else SIDE) for t, u in units.items()]
    if chosen.get("g_sensitivity", NONE) != NONE:
        full = tuple(f"{a}{b}" for a in AXES for b in AXES)
        entries = tuple(f"{a}{a}" for a in AXES) if chosen["g_sensitivity"] == DIAGONAL else full
        out.append(_matrix("gyro", "g_sensitivity", units["gyro"], G_SENSITIVITY_SD, entries))
    return tuple(out)


def _matrix(triad: str, name: str, unit: str, sd: float, entries: Sequence[str]) -> AttachedError:
    return attached(triad, make(name), unit, unknown_state(sd, entries), entries)
