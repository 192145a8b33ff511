"""What the updates of one sensor showed: innovations, their standard deviations, and the gate of the emitted filter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.run.band import outside_share, windows_outside

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorRun:
    """One sensor's updates.

    Parameters
    ----------
    t : ndarray, shape (m,)
        Times of its samples in the log [s].
    innovation : ndarray, shape (m, rows)
        Of each row, with the rows before it fused [SI].
    nis : ndarray, shape (m,)
        Squared innovation of the whole sample over its covariance.
    channels : tuple of str
        Names of the rows.
    deviation : ndarray, shape (m, rows), optional
        Standard deviations of the innovations by the filter [SI].
    gate : float
        Standard deviations beyond which the emitted filter rejects a sample; the run fuses it all the same.
    """

    t: Array
    innovation: Array
    nis: Array
    channels: tuple[str, ...]
    deviation: Array | None = None
    gate: float = float("inf")

    @property
    def expected_nis95(self) -> tuple[float, float]:
        """Between which ends the mean NIS of a consistent filter is with 95 %: a chi-square of all rows, over the updates."""
        from scipy.stats import chi2

        m, rows = self.innovation.shape
        lo, hi = chi2.ppf([0.025, 0.975], m * rows) / m
        return float(lo), float(hi)

    @property
    def over_gate(self) -> Array:
        """The NIS of each sample over the square of the gate, shape (m,): above one the emitted filter rejects it."""
        return self.nis / self.gate**2

    @property
    def is_accepted(self) -> NDArray[np.bool_]:
        """Which samples the emitted filter accepts at its gate, shape (m,)."""
        return np.asarray(self.nis <= self.gate**2)

    @property
    def beyond_gate(self) -> int:
        """How many samples the emitted filter would reject at its gate."""
        return int(np.count_nonzero(~self.is_accepted))

    @cached_property
    def normalised(self) -> Array | None:
        """Innovations in their standard deviations, shape (m, rows); none where these are not known."""
        if self.deviation is None:
            return None
        return np.asarray(self.innovation / self.deviation)

    def to_dict(self) -> dict[str, Any]:
        """Updates, mean NIS, the gate and what is beyond it, and when each channel leaves its band."""
        data: dict[str, Any] = {"updates": int(self.t.size), "mean_nis": float(self.nis.mean())}
        if np.isfinite(self.gate):
            data |= {"gate_standard_deviations": self.gate, "beyond_gate": self.beyond_gate}
        if self.normalised is not None:
            data["bands"] = {
                channel: {
                    "outside_2_sigma_share": outside_share(x),
                    "windows_s": [list(w) for w in windows_outside(x, self.t)],
                }
                for channel, x in zip(self.channels, self.normalised.T)
            }
        return data
