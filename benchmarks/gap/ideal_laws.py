"""`Laws`: what an analyst supposes of the parameters of what is hidden, before he sees the record."""

from __future__ import annotations

from dataclasses import dataclass

from case import Array
from effects import SLOPES
from noise import middles

Between = tuple[float, float]


@dataclass(frozen=True)
class Laws:
    """Ranges, log-uniform unless said otherwise, and how finely they are divided. The defaults are those of the benchmark.

    Parameters
    ----------
    warm_up : pair of float
        Time constant over the length of the record.
    width : tuple of float
        Widths of a thermal hysteresis over the range of temperature, equally likely.
    place : pair of float
        Of a step or change of noise, over the record, uniform.
    line : pair of float
        Fewest periods in the record, and highest frequency over the sampling rate.
    correlation : pair of float or None
        Times of a Gauss-Markov bias [samples] and over the record; None: as the benchmark hides it beside the sensor's own.
    slope : tuple of pair of float
        Of power-law noise, uniform in each.
    frequency, damping : pair of float
        Of a resonance, over the sampling rate, and over the critical one.
    outlier : pair of float
        Standard deviation over that of the white noise, uniform.
    dwell, lasting : pair of float
        Of a telegraph and of bursts, over the record.
    share : pair of float
        Of bursts, uniform.
    finer : int
        Times as many values as for the defaults.
    """

    warm_up: Between = (0.02, 0.2)
    width: tuple[float, ...] = (0.2,)
    place: Between = (0.2, 0.8)
    line: Between = (10.0, 0.4)
    correlation: Between | None = None
    slope: tuple[Between, ...] = SLOPES
    frequency: Between = (0.02, 0.3)
    damping: Between = (0.01, 0.08)
    outlier: Between = (2.5, 6.0)
    dwell: Between = (0.005, 0.03)
    lasting: Between = (0.003, 0.03)
    share: Between = (0.05, 0.4)
    finer: int = 1

    def taus(self, dt: float, duration: float, own: float) -> Array:
        """Correlation times of a Gauss-Markov bias [s].

        Parameters
        ----------
        dt, duration : float
            Of the record [s].
        own : float
            Correlation time of the sensor's own bias [s]; 0 without one.
        """
        if self.correlation is None:
            return middles(5.0 * dt, own / 10.0 if own else duration / 25.0, 40 * self.finer)
        return middles(self.correlation[0] * dt, self.correlation[1] * duration, 40 * self.finer)


DRAWN = Laws()
"""Those by which the benchmark draws."""
WIDE = Laws(
    warm_up=(1e-3, 1.0),
    width=(0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
    place=(0.01, 0.99),
    line=(1.0, 0.5),
    correlation=(1.0, 1.0 / 3.0),
    slope=((0.3, 0.9), (1.1, 1.9)),
    frequency=(0.002, 0.45),
    damping=(2e-3, 0.3),
    outlier=(2.0, 30.0),
    dwell=(1e-3, 0.3),
    lasting=(1e-3, 0.3),
    share=(0.02, 0.5),
    finer=2,
)
"""What can be seen in a record at all: all that somebody knows who met the sensor today."""
LAWS = {"drawn": DRAWN, "wide": WIDE}
