"""What a flight can show and physics allows of an effect with its values: no sensor errs by more than there is to read."""

from __future__ import annotations

import numpy as np

from kfgen.core.channel_names import acts_on
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.effects import Effect
from kfgen.effects.inertial.barometer import StaticPressureError
from kfgen.effects.inertial.errors import Nonlinearity
from kfgen.effects.inertial.lag import TimeDelay
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed

EXCEEDS_SIGNAL = "it adds more to the reading than there is to read: no sensor errs so far"
"""Why an error in proportion to a reading is no finding beyond 100 %: units, signs and axes are asked for by themselves."""
EXCEEDS_PRESSURE = "it is more than the whole dynamic pressure of the airflow"
"""Why an error of the static port is no finding beyond the pressure where the air is brought to rest."""
READS_AHEAD = "an inertial sensor does not read what comes later"
"""Why a negative delay of one is no finding: that the other sensors are late is one."""
KNOWS_AHEAD = "a receiver does not know what comes later"
"""Why a fix of a later time than its stamp says is doubted: clocks that were never set do that."""
MAX_AHEAD_S = 0.05
"""By which a fix may be ahead [s]: inertial sensors are late themselves, by their low-passes."""
DYNAMIC_PRESSURE_HEIGHT = 0.5 / STANDARD_GRAVITY
"""Height of air that weighs as much as the dynamic pressure, over the square of the speed [s^2/m]."""


def unreached(placed: Placed, path: FlownPath, truth: Truth, *, cautious: bool) -> str:
    """Why an effect is nothing that can be there; empty where it may be.

    Parameters
    ----------
    placed : Placed
    path : FlownPath
    truth : Truth
        What every sensor should have read along it.
    cautious : bool
        Whether something else is still there.
    """
    effect = placed.effect
    if _largest_share(effect) > 1.0 or _largest_nonlinear_share(placed, truth) > 1.0:
        return EXCEEDS_SIGNAL
    if isinstance(effect, StaticPressureError) and abs(float(effect.coefficient)) > DYNAMIC_PRESSURE_HEIGHT:
        return EXCEEDS_PRESSURE
    if _is_early(placed) and any(acts_on(placed.where, c) for c in path.equations.channels):
        return READS_AHEAD
    late = [
        a.delay
        for a in path.log.aiding
        for c in a.sensor.channels
        if acts_on(placed.where, c) and truth.place(c)[0] in truth.antennas
    ]
    early = late and _is_early(placed, min(late) + MAX_AHEAD_S)
    return KNOWS_AHEAD if cautious and early else ""


def _is_early(placed: Placed, allowed_s: float = 0.0) -> bool:
    """Whether an effect makes a sensor read what comes later, by more than is allowed."""
    return isinstance(placed.effect, TimeDelay) and float(placed.effect.delay) < -allowed_s


def _largest_share(effect: Effect) -> float:
    """The largest share of what its sensor feels that an effect adds to a reading; zero of one that adds none."""
    shares = [p.name for p in effect.parameters() if p.unit == "%" and p.kind == "signed"]
    return max((abs(float(getattr(effect, n))) for n in shares), default=0.0)


def _largest_nonlinear_share(placed: Placed, truth: Truth) -> float:
    """The same of squares and cubes, where the reading was largest: ``|k2 u + k3 u^2|``."""
    if not isinstance(placed.effect, Nonlinearity):
        return 0.0
    sensor, axis = truth.place(placed.where)
    u = np.abs(truth.read[sensor][:, axis]).max(initial=0.0)
    return abs(float(placed.effect.k2)) * float(u) + abs(float(placed.effect.k3)) * float(u) ** 2
