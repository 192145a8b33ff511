"""`NoiseSizes`: how large the noises of a flight are, over what its filter assumes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.rows import Rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseSizes:
    """Standard deviations of noises over those that a filter assumes; one of what is not named.

    Parameters
    ----------
    inputs : mapping of str to float
        Of the white noise of inputs, by sensor, or by channel where these differ.
    channels : mapping of str to float
        Of the samples of aiding sensors, by channel.
    courses : mapping of str to ndarray, shape (n,)
        Of inputs whose noise follows a driver: its standard deviation at each time over that at the driver's reference.
    """

    inputs: Mapping[str, float] = field(default_factory=dict)
    channels: Mapping[str, float] = field(default_factory=dict)
    courses: Mapping[str, Array] = field(default_factory=dict)

    @property
    def of_inputs(self) -> dict[str, float | Array]:
        """Of the white noise of inputs, at all times or at each, shape (n,)."""
        named = {**self.inputs, **self.courses}
        return {n: self.inputs.get(n, 1.0) * self.courses.get(n, np.float64(1.0)) for n in named}

    def of_rows(self, rows: Rows) -> Array:
        """Of every reading, shape (rows,).

        Parameters
        ----------
        rows : Rows
        """
        return np.array([self.channels.get(c, 1.0) for c in rows.channels])[rows.index]
