"""What a plant's log can show and physics allows of an effect with its values: a limit within the inputs, friction that brakes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant.sensor import Backlash
from kfgen.effects.plant.terms import InputDeadZone, Saturation
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]


def unreached(placed: Placed, inputs: Mapping[str, Array], channels: Mapping[str, Array]) -> str:
    """Why an effect is nothing that can be there or be seen; empty where it is.

    Parameters
    ----------
    placed : Placed
    inputs, channels : mapping of str to ndarray, shape (n,)
        What drives the plant and what it shows [SI].
    """
    effect, where = placed.effect, placed.where
    if isinstance(effect, Saturation) and float(effect.limit) >= _largest(inputs[where]):
        return f"{where} never reaches its limit"
    if isinstance(effect, InputDeadZone) and float(effect.width) >= _largest(inputs[where]):
        return f"{where} never leaves its width"
    if isinstance(effect, Backlash) and float(effect.width) >= float(np.ptp(channels[where])):
        return f"{where} never crosses its width"
    return ""


def rms(x: Array) -> float:
    """Root mean square of what is finite; zero of nothing."""
    good = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(good**2))) if good.size else 0.0


def _largest(u: Array) -> float:
    return float(np.abs(u).max(initial=0.0))
