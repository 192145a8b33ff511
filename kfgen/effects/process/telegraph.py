"""Random telegraph (popcorn) noise: a bias that jumps between two levels.

Its spectrum is that of a Gauss-Markov process of half its dwell time, so nothing of second order
distinguishes them; the likelihood of a level that switches does, also beside slow noise, see
`kfgen.effects.process.switching_level`.

References
----------
.. [1] S. Machlup, Noise in semiconductors: spectrum of a two-parameter random signal, J. Appl. Phys. 25, 1954.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import LinearProcess, parameter
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.process.population_monte_carlo import integral
from kfgen.effects.process.switching_level import Slow, Switching, SwitchingParameters
from kfgen.effects.series import DECADES, Detection, WhiteSeries

Array = NDArray[np.float64]

MAX_CELLS = 2048
"""Cells into whose means a record is gathered, at most."""
MIN_START_GAIN_NATS = 3.0
"""Gain of log-likelihood [nats] of the best first point below which the search for levels ends."""
MIN_JUMPS_IN_RECORD = 8.0
"""Mean number of jumps in the record at least: a single one is a step."""
SMOOTHING_WIDTHS_CELLS = (4, 16, 64)
"""Cells over which means are smoothed to guess the distance of the levels."""
SIZE_FACTORS = (0.6, 1.0, 1.6)
"""Distances of the levels at the first points, over the one guessed."""
DWELL_START_COUNT = 9
"""Dwell times at the first points."""
MAX_SLOW_STATES = 2
"""States of the slow noise beside which levels are looked for: more of them can imitate levels."""
MIDDLE_SD_OVER_SIZE = 0.15
"""Standard deviation of the middle of the levels about the record's mean, over their distance."""
MAX_WHITE_AMPLITUDE_RATIO = 1.15
"""Ratio of the largest to the smallest noise amplitude in a band beyond which it is not white."""
MIN_SHARE_OF_RIVAL_GAIN = 0.5
"""Gain of the best first point over the gain of slow noise of the same spectrum, at least."""
MIN_RIVAL_GAIN_NATS = 1.0
"""Gain of slow noise of the same spectrum [nats] below which no levels are looked for: they would show in it, too."""
MAX_LOSS_TO_RIVAL_NATS = 3.0
"""Nats by which levels may be worse than slow noise of the same spectrum half-way through the search."""
RIVAL_GRID_POINTS = 16
"""Sizes, and as many times, at which slow noise of the same spectrum is tried."""
NOISE_START_COUNT = 64
"""First points of the search for the noise without levels."""


@dataclass(frozen=True)
class RandomTelegraph(LinearProcess):
    """A bias that jumps by `size` between two levels, on each of which it stays for `dwell` on average."""

    size: Any = parameter("U")
    dwell: Any = parameter("s", "time")

    name: ClassVar[str] = "random_telegraph"
    title: ClassVar[str] = "random telegraph noise"
    separating_experiment: ClassVar[str] = "a record with more of its jumps"
    sentence_template: ClassVar[str] = "jumps between two levels {size} apart, staying for {dwell} on average"
    changes_samples: ClassVar[bool] = True

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """The Gauss-Markov process of the same spectrum: ``sigma = size / 2``, ``tau = dwell / 2`` [1]_."""
        return LinearSystem(
            A=((-2 / self.dwell,),),
            W=((self.size**2 / self.dwell,),),
            C=(1,),
            x0=(0,),
            states=(State("telegraph"),),
        )

    def simulate(self, t: Array, rng: np.random.Generator, drive: Mapping[str, Any] | None = None) -> Array:
        """Levels with exponential dwell times, shape (n,)."""
        t = np.asarray(t)
        dt = float(t[-1] - t[0]) / max(t.size - 1, 1)
        flips = rng.random(t.size) < -0.5 * np.expm1(-2.0 * dt / float(self.dwell))  # an odd number of jumps
        return np.asarray(0.5 * float(self.size) * (1.0 - 2.0 * ((np.cumsum(flips) + rng.integers(2)) % 2)))

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """The level that explains the means of short cells best, integrated over its numbers and the noise's."""
        cells = Cells.of(series)
        if cells.switching.slow.order > MAX_SLOW_STATES or not cells.even:
            return []
        rival = cells.gauss_markov_gain()
        if rival < MIN_RIVAL_GAIN_NATS:
            return []
        starts, quiet = cells.starts(), cells.noise_starts()
        still = cells.noise_gain(quiet)
        alone, gains = float(still.max()), cells.gain(starts)
        if starts.size == 0 or float(gains.max()) < alone + max(
            MIN_START_GAIN_NATS, MIN_SHARE_OF_RIVAL_GAIN * rival
        ):
            return []
        best = integral(
            cells.gain, starts, alone + max(MIN_START_GAIN_NATS, rival - MAX_LOSS_TO_RIVAL_NATS), values=gains
        )
        without = integral(cells.noise_gain, quiet, values=still) if best else None
        if best is None or without is None:
            return []
        size, dwell = np.exp(best.mean[:2]).tolist()
        spread = np.exp(1.96 * np.sqrt(np.diag(best.covariance)[:2]))
        evidence = best.log - without.log - float(np.log(DECADES * (cells.longest - cells.shortest)))
        ci95 = {
            name: (float(v / s), float(v * s)) for name, v, s in zip(("size", "dwell"), (size, dwell), spread)
        }
        return [Detection(cls(size, dwell), 0.0, evidence, ci95)]

    def removed_from(self, series: WhiteSeries) -> Array:
        """The samples that the model without levels would give for the same innovations, cell by cell."""
        cells = Cells.of(series)
        size, dwell = float(np.log(self.size)), float(np.log(self.dwell))

        def gain(noise: Array) -> Array:
            return cells.gain(np.column_stack([np.full((len(noise), 2), (size, dwell)), noise]))

        best = integral(gain, cells.noise_starts())
        assert best is not None
        at = cells.point(np.concatenate([[size, dwell], best.mean])[None])
        off = cells.switching.quiet(at, cells.switching.innovations(at)) - cells.switching.mean
        each = np.minimum(np.arange(series.n) // cells.block, off.size - 1)
        return np.asarray(series.y + off[each])


@dataclass(frozen=True)
class Cells:
    """A record gathered into cells, and the prior of its noise.

    Parameters
    ----------
    switching : Switching
        The means of the cells, their white and their slow noise.
    even : bool
        Whether the noise that is not slow is white in the band of the cells.
    block : int
        Samples of a cell.
    power, rest : float, int
        Sum of squares of the ordinates that are faster than the cells, and their number.
    density : ndarray, shape (m - 1,)
        What the model expects of the squares of the cosine ordinates of the cells' means [SI^2].
    still : float
        Standard deviation of the record's mean without levels [SI].
    level, wander : (mean, standard deviation)
        Priors of the logarithms of the levels of the white and of the slow noise, over those of the fit.
    """

    switching: Switching
    even: bool
    block: int
    power: float
    rest: int
    density: Array
    still: float
    level: tuple[float, float]
    wander: tuple[float, float]

    @staticmethod
    def of(series: WhiteSeries, most: int = MAX_CELLS) -> Cells:
        """The cells of a record.

        Parameters
        ----------
        series : WhiteSeries
            The record, white if its model is right.
        most : int
            Cells at most.

        Returns
        -------
        Cells
        """
        block = max(1, -(-series.n // most))
        m = series.n // block
        mean = series.y[: m * block].reshape(m, block).mean(axis=1)
        dt = series.dt * block
        band = np.maximum(series.weight[1:m], 1e-300) / np.sqrt(np.maximum(1.0 - series.slow[1:m], 1e-300))
        sd = 1.0 / float(np.mean(band)) / float(np.sqrt(block))
        even = float(band.max()) < MAX_WHITE_AMPLITUDE_RATIO * float(band.min())
        power = float(series.X[m:] @ series.X[m:]) if block > 1 else 0.0
        rest = int(np.count_nonzero(series.weight[m:])) if block > 1 else 0
        switching = Switching(mean - mean.mean(), dt, sd, Slow.of(series.forms, dt))
        passed = series.weight[1:][series.weight[1:] > 0.0]  # lines at the bottom are left out
        still = 1.0 / float(passed[0] * np.sqrt(series.n))
        density = 1.0 / (block * np.square(np.maximum(series.weight[1:m], 1e-150)))
        return Cells(switching, even, block, power, rest, density, still, series.level, series.wander)

    @property
    def shortest(self) -> float:
        """Logarithm of the shortest dwell time: a cell."""
        return float(np.log(self.switching.dt))

    @property
    def longest(self) -> float:
        """Logarithm of the longest: the record holds `MIN_JUMPS_IN_RECORD` of them."""
        return float(np.log(self.switching.mean.size * self.switching.dt / MIN_JUMPS_IN_RECORD))

    def starts(self) -> Array:
        """Points about the distances at which the smoothed means stand, shape (p, 4 or 5)."""
        from scipy.ndimage import uniform_filter1d

        mean, sd = self.switching.mean, self.switching.sd
        sizes = [
            2.0 * float(np.sqrt(max(np.var(uniform_filter1d(mean, w)) - sd**2 / w, 1e-2 * sd**2 / w)))
            for w in SMOOTHING_WIDTHS_CELLS
            if mean.size >= 8 * w
        ]
        dwells = np.linspace(self.shortest, self.longest, DWELL_START_COUNT + 1)[1:]
        levels = np.array([[np.log(a * f), d] for a in sizes for f in SIZE_FACTORS for d in dwells]).reshape(
            -1, 2
        )
        deviation = np.tile(self.deviation, (len(levels), 1))
        deviation[:, 0] = MIDDLE_SD_OVER_SIZE * np.exp(levels[:, 0]) / self.still
        drawn = np.random.default_rng(0).standard_normal(deviation.shape)
        return np.column_stack([levels, self.noise + deviation * drawn])

    @property
    def noise(self) -> Array:
        """About where the middle [`still`] and the logarithms of the levels of the noise are, shape (2,) or (3,)."""
        loud = 0.5 * float(np.log(self.power / self.rest)) if self.rest else 0.0
        return np.array([0.0, loud, 0.0])[: 2 + bool(self.switching.slow.order)]

    @property
    def deviation(self) -> Array:
        """Standard deviations of `noise` without levels, shape (2,) or (3,)."""
        free = 1.0 / float(np.sqrt(2.0 * (self.rest + self.switching.mean.size)))
        return np.array([1.0, free, self.wander[1]])[: 2 + bool(self.switching.slow.order)]

    def noise_starts(self) -> Array:
        """Points about the noise of the fast ordinates, and about that of a fit to all, shape (p, 2 or 3)."""
        drawn = np.random.default_rng(0).standard_normal((NOISE_START_COUNT, self.noise.size))
        middle = np.where(np.arange(NOISE_START_COUNT)[:, None] % 2, self.noise, 0.0)
        return np.asarray(middle + 2.0 * self.deviation * drawn)

    def gauss_markov_gain(self) -> float:
        """What the process of the same spectrum gains over no levels [nats], at its best."""
        from scipy.fft import dct

        m, dt = self.switching.mean.size, self.switching.dt
        power = np.square(dct(self.switching.mean, norm="ortho")[1:])
        omega = np.pi * np.arange(1, m) / m
        best = 0.0
        for phi in np.exp(-2.0 * dt / np.exp(np.linspace(self.shortest, self.longest, RIVAL_GRID_POINTS))):
            shape = (1.0 - phi**2) / (1.0 - 2.0 * phi * np.cos(omega) + phi**2)
            S = (
                self.density
                + np.geomspace(1e-3, 1e1, RIVAL_GRID_POINTS)[:, None] * np.var(self.switching.mean) * shape
            )
            gain = 0.5 * np.sum(np.log(self.density / S) + power * (1.0 / self.density - 1.0 / S), axis=1)
            best = max(best, float(gain.max()))
        return best

    def noise_gain(self, noise: Array) -> Array:
        """As `gain`, of no levels."""
        return self.gain(np.column_stack([np.full((len(noise), 2), (-np.inf, self.longest)), noise]))

    def point(self, x: Array) -> SwitchingParameters:
        """From log size, log dwell, middle [`still`], log of the white level and, where there is slow noise, of its level."""
        size, dwell, loud, wander = np.exp(
            [x[:, 0], x[:, 1], x[:, 3], x[:, 4] if x.shape[1] > 4 else 0.0 * x[:, 3]]
        )
        return SwitchingParameters(size, dwell, self.still * x[:, 2], loud, wander)

    def gain(self, x: Array) -> Array:
        """Log-likelihood and log prior of the noise's levels [nats], up to a constant, at points, shape (p, 4 or 5)."""
        at, loud = self.point(x), x[:, 3]
        value = self.switching.log_likelihood(at) - self.rest * loud - 0.5 * self.power * np.exp(-2.0 * loud)
        for x_k, (mean, deviation) in zip(x.T[3:], (self.level, self.wander)):
            value = value - 0.5 * ((x_k - mean) / deviation) ** 2
        inside = (x[:, 1] >= self.shortest) & (x[:, 1] <= self.longest)
        return np.asarray(np.where(inside, value, -1e6))
