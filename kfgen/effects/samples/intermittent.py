"""Intermittent noise: bursts of louder noise that come and go.

Its spectrum is white, and the law of its samples is a mixture as that of outliers is; that loud samples
stand together tells it. The sums of squares of short cells are those of a hidden Markov chain, whose likelihood is
integrated over its numbers.

References
----------
.. [1] L. R. Rabiner, A tutorial on hidden Markov models, Proc. IEEE 77(2), 1989.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import AddsNothingAtRest, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, NoiseFactor
from kfgen.effects.process.markov_chain import drawn, history, log_likelihood, transitions
from kfgen.effects.process.population_monte_carlo import integral
from kfgen.effects.series import Detection, WhiteSeries

Array = NDArray[np.float64]

MAX_CELLS = 2048
"""Cells into whose sums of squares a record is gathered, at most."""
MAX_HISTORY_CELLS = 65536
"""The same where a history of the bursts is drawn."""
MIN_BURSTS_IN_RECORD = 8.0
"""Bursts of the longest mean length that the record must hold."""
MIN_BURSTS_SEEN = 1.5
"""Bursts that the record must hold: one alone, a knock on the bench, neither comes nor goes again."""
SCATTER_WIDTHS_CELLS = (1, 4, 16, 64)
"""Numbers of cells over which squares are summed to see whether their level changes at all."""
MIN_SCATTER_SIGMAS = 3.5
"""Standard deviations by which those sums must scatter more than sums of one level."""
MIN_START_GAIN_NATS = 3.0
"""Gain of log-likelihood [nats] of the best first point below which the search ends."""
MAX_SQUARE_OF_A_BEAT = 25.0
"""To which squares of the white series are cut where they are looked at for a period: five standard deviations."""
MIN_CYCLES_OF_A_BEAT = 16
"""In a record, of which bursts by chance show no line."""
FLOOR_ORDINATES = 101
"""Of which the median is the floor of the spectrum of squares."""
BESIDE_A_LINE = np.array([*range(-12, -2), *range(3, 13)])
"""Ordinates whose mean is its floor, too: where bursts are long it falls steeply."""
BEAT_FALSE_ALARM_RATE = 1e-4
"""Of records of bursts that come by chance, the share in which a period is seen."""
LOG_RATIO_RANGE = (float(np.log(1.05)), float(np.log(1e3)))
"""Range of the logarithm of the ratio of standard deviations: a uniform prior."""
LOG_ODDS_RANGE = (-8.0, 2.0)
"""Range of the logarithm of the odds of the share of time: a uniform prior."""


@dataclass(frozen=True)
class IntermittentNoise(AddsNothingAtRest):
    """White noise whose sigma is `ratio` times as large in a `share` of the time, for `lasting` at a stretch."""

    ratio: Any = parameter("", "ratio")
    share: Any = parameter("", "ratio")
    lasting: Any = parameter("s", "time")

    name: ClassVar[str] = "intermittent_noise"
    title: ClassVar[str] = "intermittent noise"
    separating_experiment: ClassVar[str] = "a longer record, with more of its bursts"
    sentence_template: ClassVar[str] = (
        "has noise that is {ratio} times as large in bursts of {lasting} on average, in a share of {share} of the time"
    )
    changes_samples: ClassVar[bool] = True

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The mean variance over bursts and pauses."""
        return NoiseFactor(1 + self.share * (self.ratio**2 - 1))

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """The chain that explains the squares of the white series best, integrated over its numbers."""
        cells = Squares.of(series)
        if not cells.uneven:
            return []
        starts, alone = cells.starts(), cells.one_level()
        gains = cells.gain(starts)
        if float(gains.max()) < alone + MIN_START_GAIN_NATS:
            return []
        best = integral(cells.gain, starts, alone + MIN_START_GAIN_NATS, values=gains)
        if best is None:
            return []
        prior = np.log(
            (LOG_RATIO_RANGE[1] - LOG_RATIO_RANGE[0])
            * (LOG_ODDS_RANGE[1] - LOG_ODDS_RANGE[0])
            * (cells.longest - cells.shortest)
        )
        spread = 1.96 * np.sqrt(np.diag(best.covariance))
        low, middle, high = (cls.at(best.mean + k * spread) for k in (-1.0, 0.0, 1.0))
        ci95 = {
            name: (float(getattr(low, name)), float(getattr(high, name)))
            for name in ("ratio", "share", "lasting")
        }
        if float(middle.share) * series.n * series.dt < MIN_BURSTS_SEEN * float(middle.lasting):
            return []
        return [Detection(middle, 0.0, best.log - alone - float(prior), ci95)]

    @classmethod
    def at(cls, x: Array) -> IntermittentNoise:
        """From log ratio, log odds of the share and log length."""
        share = 1.0 / (1.0 + np.exp(-x[1]))
        return cls(float(np.exp(x[0])), float(share), float(np.exp(x[2])))

    @staticmethod
    def beat(series: WhiteSeries) -> tuple[float, float]:
        """The period [s] by which noise is louder and less loud, and its log-likelihood ratio above that of chance.

        Bursts of the law come at random: the spectrum of the squares of the white series has no line.

        Parameters
        ----------
        series : WhiteSeries
        """
        from scipy.ndimage import median_filter

        squares = np.minimum(series.fast**2, MAX_SQUARE_OF_A_BEAT)
        power = np.abs(np.fft.rfft(squares)) ** 2
        at = np.arange(MIN_CYCLES_OF_A_BEAT, power.size + BESIDE_A_LINE[0])
        if at.size <= FLOOR_ORDINATES:
            return 0.0, -np.inf
        far = power[at] * np.log(2.0) / np.maximum(median_filter(power, FLOOR_ORDINATES)[at], 1e-300)
        m = BESIDE_A_LINE.size
        beside = power[at] / np.maximum(power[at[:, None] + BESIDE_A_LINE].mean(axis=1), 1e-300)
        # Against the law of an ordinate over its mean, and over the mean of m others.
        nats = np.minimum(far, m * np.log1p(beside / m))
        k = int(np.argmax(nats))
        return series.n * series.dt / float(at[k]), float(nats[k] - np.log(at.size / BEAT_FALSE_ALARM_RATE))

    def removed_from(self, series: WhiteSeries) -> Array:
        """The loud samples brought to the level of the others, where a history drawn from all says that they are."""
        z, ratio, share = series.fast, float(self.ratio), float(self.share)
        block = -(-series.n // MAX_HISTORY_CELLS)
        m = series.n // block
        squares = (z[: m * block] ** 2).reshape(m, block).sum(axis=1)
        quiet = float(np.mean(z**2)) / (1.0 + share * (ratio**2 - 1.0))
        log_odds = 0.5 * squares / quiet * (1.0 - ratio**-2) - block * np.log(ratio)
        T = transitions(np.array([share]), np.array([float(self.lasting)]), series.dt * block)[0]
        loud = history(log_odds, T, share, np.random.default_rng(series.n))
        each = loud[np.minimum(np.arange(series.n) // block, m - 1)]
        return np.where(each, series.y - series.noise * (1.0 - 1.0 / ratio), series.y)

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """Noise is added for a while, again and again."""
        dt = float(t[-1] - t[0]) / (y.size - 1)
        T = transitions(np.array([float(self.share)]), np.array([float(self.lasting)]), dt)[0]
        loud = drawn(y.size, T, float(self.share), rng)
        sd = float(np.sqrt(0.5 * np.mean(np.diff(y) ** 2)))
        more = sd * float(np.sqrt(max(self.ratio**2 - 1.0, 0.0))) * rng.standard_normal(y.size)
        return np.where(loud, y + more, y)


@dataclass(frozen=True)
class Squares:
    """Sums of squares of a white series, cell by cell.

    Parameters
    ----------
    sums : ndarray, shape (m,)
        Of `block` samples each, of unit variance if the model holds.
    block : int
        Samples of a cell.
    dt : float
        Length of a cell [s].
    level : (mean, standard deviation)
        Prior of the logarithm of the noise's level over that of the fit.
    """

    sums: Array
    block: int
    dt: float
    level: tuple[float, float]

    @staticmethod
    def of(series: WhiteSeries) -> Squares:
        """At most `MAX_CELLS` of them."""
        block = -(-series.n // MAX_CELLS)
        m = series.n // block
        sums = (series.fast[: m * block] ** 2).reshape(m, block).sum(axis=1)
        return Squares(sums, block, series.dt * block, series.level)

    @property
    def shortest(self) -> float:
        """Logarithm of the shortest mean length of a burst: two cells."""
        return float(np.log(2.0 * self.dt))

    @property
    def longest(self) -> float:
        """Logarithm of the longest: the record holds `MIN_BURSTS_IN_RECORD` of them."""
        return float(np.log(max(self.sums.size / MIN_BURSTS_IN_RECORD, 4.0) * self.dt))

    @property
    def uneven(self) -> bool:
        """Whether sums over some width scatter more than those of normal samples of one level."""
        for w in SCATTER_WIDTHS_CELLS:
            m = self.sums.size // w
            if m < 16:
                break
            sums = self.sums[: m * w].reshape(m, w).sum(axis=1) / float(np.mean(self.sums)) / w
            scatter = float(np.var(sums)) * 0.5 * self.block * w
            if (scatter - 1.0) * np.sqrt(0.5 * m) > MIN_SCATTER_SIGMAS:
                return True
        return False

    def starts(self) -> Array:
        """Log ratio, log odds of the share, log length, log of the level between bursts: shape (p, 4)."""
        ratio, odds, lasting = (
            a.ravel()
            for a in np.meshgrid(
                np.log([1.3, 1.8, 3.0, 6.0]),
                [-4.5, -2.5, -1.0, 0.0],
                np.linspace(self.shortest, self.longest, 5),
                indexing="ij",
            )
        )
        share = 1.0 / (1.0 + np.exp(-odds))
        whole = 0.5 * np.log(self.sums.sum() / (self.sums.size * self.block))
        quiet = whole - 0.5 * np.log1p(share * (np.exp(2.0 * ratio) - 1.0))
        return np.column_stack([ratio, odds, lasting, quiet])

    def gain(self, x: Array) -> Array:
        """Log-likelihood and log prior of the level [nats], up to a constant, at points of shape (p, 4)."""
        ratio, share, lasting = x[:, 0], 1.0 / (1.0 + np.exp(-x[:, 1])), np.exp(x[:, 2])
        levels = np.stack([x[:, 3], x[:, 3] + ratio], axis=-1)
        log_e = -0.5 * self.sums[:, None, None] * np.exp(-2.0 * levels) - self.block * levels
        value = log_likelihood(log_e, transitions(share, lasting, self.dt), share) + self._prior(x[:, 3])
        ranges = zip(x.T[:3], (LOG_RATIO_RANGE, LOG_ODDS_RANGE, (self.shortest, self.longest)))
        inside = np.all([(lo <= v) & (v <= hi) for v, (lo, hi) in ranges], axis=0)
        return np.asarray(np.where(inside, value, -1e9))

    def _prior(self, level: Array) -> Array:
        mean, sd = self.level
        return np.asarray(-0.5 * ((level - mean) / sd) ** 2 - np.log(sd * np.sqrt(2.0 * np.pi)))

    def one_level(self) -> float:
        """The same without bursts, integrated over the level by Laplace's method."""
        n, total = self.sums.size * self.block, float(self.sums.sum())
        mean, sd = self.level
        x = 0.5 * np.log(total / n)
        for _ in range(50):
            power = total * np.exp(-2.0 * x)
            x -= (n - power + (x - mean) / sd**2) / (2.0 * power + 1.0 / sd**2)
        power = total * float(np.exp(-2.0 * x))
        value = -n * x - 0.5 * power + float(self._prior(np.array(x)))
        return float(value + 0.5 * np.log(2.0 * np.pi / (2.0 * power + 1.0 / sd**2)))
