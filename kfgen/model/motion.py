"""Motion models: what drives the state blocks, as time derivatives in symbols.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, sec. 5.3 (local level mechanisation).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import sympy as sp

from kfgen.model.blocks import Attitude, Block, Vector
from kfgen.units import STANDARD_GRAVITY

NED = ("N", "E", "D")


@dataclass(frozen=True)
class Constant:
    """A number of the model that firmware may set: name, SI unit, default, meaning."""

    name: str
    unit: str
    value: float
    title: str

    @property
    def symbol(self) -> sp.Symbol:
        """Its symbol."""
        return sp.Symbol(self.name, real=True)


@dataclass(frozen=True)
class Input:
    """What drives the motion: a triad of channels ``name_x``, ``name_y``, ``name_z``, or one channel.

    Parameters
    ----------
    name, unit, title : str
    bias : str
        Letter of its bias states.
    bias_prior : float
        Deviation of the turn-on bias [SI].
    N : float
        White noise density where no noise file says otherwise [SI].
    left_out : float
        What the model leaves out, as a density [SI/sqrt(Hz)]: the filter adds it to the noise of the
        input, the simulation does not.
    scalar : bool
        One channel of the input's own name.
    """

    name: str
    unit: str
    title: str
    bias: str
    bias_prior: float
    N: float
    left_out: float = 0.0
    scalar: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """The channel names."""
        return (self.name,) if self.scalar else tuple(f"{self.name}_{axis}" for axis in "xyz")


GYRO = Input("gyro", "rad/s", "angular rate", "bg", 0.02, 1.5e-4)
ACCEL = Input("accel", "m/s^2", "specific force", "ba", 0.2, 2e-3)
GRAVITY = Constant("g", "m/s^2", STANDARD_GRAVITY, "gravity, positive")


class Motion:
    """What a motion model declares: its blocks, its inputs, its constants and their rates."""

    blocks: tuple[Block, ...] = ()
    inputs: tuple[Input, ...] = ()
    constants: tuple[Constant, ...] = ()

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """Time derivative of each block; of an attitude, the body rate ``omega_nb_b`` [rad/s].

        Parameters
        ----------
        x : mapping
            By block name: a vector, or ``R_nb`` of an attitude.
        u : mapping
            By input name: the true triad.
        """
        return {}


class Rest(Motion):
    """A sensor at rest: nothing moves, every state belongs to an effect."""


class Rotating(Motion):
    """Attitude driven by gyros: ``dR_nb/dt = R_nb [omega x]``.

    Scale errors and misalignments of turning gyros, which are no states here, are left out by
    about one part in a thousand of a radian per second in a second.
    """

    blocks = (Attitude(),)
    inputs = (replace(GYRO, left_out=1e-3),)

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """The body rate is the gyros'."""
        return {"phi": u["gyro"]}


class Strapdown(Motion):
    """Strapdown navigation in a local level frame without Earth rate (MEMS grade)."""

    blocks: tuple[Block, ...] = (
        Vector("p", NED, "m", "position", 10.0),
        Vector("v", NED, "m/s", "velocity", 1.0),
        Attitude(),
    )
    inputs = (ACCEL, GYRO)
    constants = (GRAVITY,)

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """``p' = v``, ``v' = R_nb f + g``, body rate from the gyros (eqs (5.45), (5.54) of [1]_)."""
        gravity_n = sp.Matrix([0, 0, GRAVITY.symbol])
        return {"p": x["v"], "v": x["phi"] * u["accel"] + gravity_n, "phi": u["gyro"]}
