"""How well a state may be known: the range of its standard deviation."""

from __future__ import annotations

from typing import NamedTuple


class StateRange(NamedTuple):
    """Standard deviations of a state [SI]: where it is known best, before the first measurement, and where it is known least."""

    least: float
    prior: float
    most: float
