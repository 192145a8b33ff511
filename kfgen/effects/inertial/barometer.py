"""Effects on a barometer that moves.

References
----------
.. [1] PX4-Autopilot, EKF2: ``EKF2_PCOEF_*``, static pressure position error over dynamic pressure (read in its documents).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from kfgen.effects.effect import parameter
from kfgen.effects.inertial.felt import Felt
from kfgen.effects.inertial.inertial_error import InertialError


@dataclass(frozen=True)
class StaticPressureError(InertialError):
    """The air that flows past the port is not at rest there: a height that grows with the square of the speed, without wind."""

    coefficient: Any = parameter("U*s^2/m^2", "signed")

    name: ClassVar[str] = "static_pressure_error"
    title: ClassVar[str] = "static pressure error of the airflow"
    separating_experiment: ClassVar[str] = "level flight at two speeds"
    sentence_template: ClassVar[str] = "reads too high by {coefficient} times the square of the speed"
    sensors: ClassVar[tuple[str, ...]] = ("baro",)
    needs: ClassVar[tuple[str, ...]] = ("speed_squared",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``c v^2``: a barometer has one axis."""
        return self.coefficient * felt.squared_speed
