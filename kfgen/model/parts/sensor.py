"""`Sensor`: what a sensor declares; Jacobian, simulator, residual and code follow from its ``predict(x)``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.model.option import NOTHING, STATE, Configured
from kfgen.model.parts.attached_error import AttachedError
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import LEFT_OUT, NED
from kfgen.model.register import BacklashOperator
from kfgen.model.symbols.blocks import Vector

Views = Mapping[str, sp.Matrix]
Array = NDArray[np.float64]


class Sensor(Configured):
    """What a sensor declares.

    Parameters
    ----------
    chosen : mapping of str to value
        Values of its options.
    axes : tuple of str
        Of the navigation frame.

    Attributes
    ----------
    name, title, unit : str
        ``unit`` is SI.
    channels : tuple of str
        Channels of the log, one a row.
    sd : float
        Noise of each sample where no noise file says otherwise [SI].
    left_out : float
        What the model leaves out (a body that accelerates, a field that bends), as a density
        [SI/sqrt(Hz)]: it is slow against the samples, so it must not be averaged away faster at a
        higher rate. The filter adds it, the simulation does not.
    usual_rate : float
        At which such sensors sample [Hz]; zero for that of the inputs.
    needs : tuple of str
        State blocks and what a motion offers, that it looks at.
    blocks : tuple of Vector
        Constants that it does not know: states of the filter.
    biases : bool
        Each channel has a bias, a state, of standard deviation `bias_prior` [SI].
    K : float
        Random walk of that bias where no noise file says otherwise [SI/sqrt(s)].
    period : float
        Of a residual that is an angle [rad]; zero for none.
    shows : str
        The block whose first value is its first sample, where there is one.
    at_rest : str
        The level axis along which the triad points when nothing moves: ``up``, ``north``, or none.
    backlash : BacklashOperator, optional
        Between what `predict` says and its one channel.
    errors : tuple of AttachedError
        Effects that its options attach to its channels.
    rate_needs : tuple of str
        What `rate` looks at; it can be asked for a rate where there is any.
    min_length : float
        Smallest plausible length of a triad that is never zero [SI]; zero for others.
    arm_order : int
        Which derivative of a place it measures: 0 a position, 1 a velocity; -1 neither.
    has_vehicle_axes : bool
        It looks along axes of the vehicle (wheels, a baseline), so that a board that is turned to it shows.
    is_constraint : bool
        Its readings are zeros by what is known of the vehicle: they are not measured, and none of them is stuck.
    """

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""
    unit: str = ""
    channels: tuple[str, ...] = ()
    sd: float = 0.0
    left_out: float = 0.0
    usual_rate: float = 0.0
    needs: tuple[str, ...] = ()
    constants: tuple[Constant, ...] = ()
    blocks: tuple[Vector, ...] = ()
    biases: bool = False
    bias_prior: float = 0.0
    K: float = 0.0
    period: float = 0.0
    shows: str = ""
    at_rest: str = ""
    backlash: BacklashOperator | None = None
    errors: tuple[AttachedError, ...] = ()
    rate_needs: tuple[str, ...] = ()
    arm_order: int = -1
    has_vehicle_axes: ClassVar[bool] = False
    is_constraint: ClassVar[bool] = False
    min_length: float = 0.0
    axes: tuple[str, ...] = NED

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen)
        self.axes = axes
        if not self.chosen.get(LEFT_OUT.name, True):
            self.left_out = 0.0

    def predict(self, x: Views) -> sp.Matrix:
        """The expected measurement, shape (m, 1), from the blocks (``R_nb`` for an attitude) and offers."""
        raise NotImplementedError

    def rate(self, x: Views) -> sp.Matrix:
        """The time derivative of what `predict` says, shape (m, 1), where `rate_needs` says that there is one."""
        raise NotImplementedError

    def plausible(self, z: Array, known: Mapping[str, float]) -> NDArray[np.bool_]:
        """Which samples (n, m) of a log are to be used, shape (n,), by the start of constants and states by name."""
        return np.ones(len(z), dtype=bool)

    def gated_length(self) -> tuple[sp.Expr, float]:
        """Expected square of the length of a triad, and the share by which a length may differ; zero for no gate."""
        return sp.Integer(0), 0.0

    def handling(self) -> tuple[str, ...]:
        """What must be done with samples before a filter gets them, in sentences: what `plausible` does in a log."""
        return ()

    def calibrated(self, z_b: tuple[float, ...], up_b: tuple[float, ...]) -> dict[str, float]:
        """Constants and states by name that a first sample at rest tells, `up_b` being the vertical."""
        return {}


def triad(name: str, axes: str | tuple[str, ...] = "xyz") -> tuple[str, ...]:
    """Channels of a triad."""
    return tuple(f"{name}_{a}" for a in axes)


def unknown(option: str, sensor: Configured) -> bool:
    """Whether an option is to be a state."""
    return bool(sensor.chosen[option] == STATE)
