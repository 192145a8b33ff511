"""When the samples of a log were taken, by the delays that a filter knows: they are fused there, between two samples of the log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME_TIME_PERIODS = 1e-3
"""Periods of the log up to which a time is that of one of its samples."""


@dataclass(frozen=True)
class LateSample:
    """A sample of a sensor with a delay.

    Parameters
    ----------
    name : str
        The sensor.
    row : int
        Of the log, where it stands.
    after : float
        By how much its own time is after that of the log's sample before it [s]; zero where it is that one's.
    """

    name: str
    row: int
    after: float


@dataclass(frozen=True)
class OwnTimes:
    """Late samples by the sample of the log at or before their own time; those taken outside of the log are left out.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the log [s].
    late : mapping of int to list of LateSample
        In the order of time.
    """

    t: Array
    late: Mapping[int, list[LateSample]] = field(default_factory=dict)

    @staticmethod
    def of(t: Array, dt: float, present: Mapping[str, Array], delays: Mapping[str, float]) -> OwnTimes:
        """From the samples that are to be used.

        Parameters
        ----------
        t : ndarray, shape (n,)
            Times of the log [s].
        dt : float
            Its period [s].
        present : mapping of str to ndarray, shape (n, rows)
            Samples by sensor, not numbers where there is none.
        delays : mapping of str to float
            By sensor [s]; negative where a sample is of a later time.
        """
        late: dict[int, list[LateSample]] = {}
        for name in (n for n in present if n in delays):
            for row in np.flatnonzero(np.isfinite(present[name]).all(axis=1)):
                own = float(t[row]) - delays[name]
                k = int(np.searchsorted(t, own + SAME_TIME_PERIODS * dt, side="right")) - 1
                if k < 0 or own > t[-1] + SAME_TIME_PERIODS * dt:
                    continue
                after = own - float(t[k])
                after = after if after > SAME_TIME_PERIODS * dt else 0.0
                late.setdefault(k, []).append(LateSample(name, int(row), after))
        return OwnTimes(t, {k: sorted(samples, key=lambda s: s.after) for k, samples in late.items()})

    def at(self, k: int) -> list[LateSample]:
        """Those of the time of a sample of the log."""
        return [s for s in self.late.get(k, ()) if not s.after]

    def between(self, k: int) -> list[tuple[float, list[LateSample]]]:
        """From a sample of the log to the next: lengths [s], and the samples at the end of each; at the last there are none."""
        if k + 1 >= self.t.size:
            return []
        out: list[tuple[float, list[LateSample]]] = []
        before = 0.0
        for s in self.late.get(k, ()):
            if s.after > before:
                out.append((s.after - before, [s]))
                before = s.after
            elif s.after:
                out[-1][1].append(s)
        return [*out, (float(self.t[k + 1] - self.t[k]) - before, [])]
