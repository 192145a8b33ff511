"""Random telegraph (popcorn) noise: a bias that jumps between two levels.

Its spectrum is that of a Gauss-Markov process of half its dwell time, so nothing of second order can tell
them apart; the likelihood of a hidden Markov chain can.

References
----------
.. [1] L. R. Rabiner, A tutorial on hidden Markov models, Proc. IEEE 77(2), 1989 (forward recursion).
.. [2] S. Machlup, Noise in semiconductors: spectrum of a two-parameter random signal, J. Appl. Phys. 25, 1954.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.base import Effect, parameter
from kfgen.effects.form import Form, State
from kfgen.effects.series import DECADES, Series, Sought

Array = NDArray[np.float64]

CELLS = 2048
"""Means into which a record is gathered."""
PROMISING = 4.0
"""Nats that a slow wandering must be worth before levels are looked for."""
SEVERAL = 8.0
"""Jumps that a record holds on average at least: a single one is a step."""
UNEVEN = 1.15
"""Ratio of the largest to the smallest noise amplitude in the band of the cells beyond which they are not white."""
SLOW = 0.5
"""Share of the density that is not white above which the record wanders by itself."""


@dataclass(frozen=True)
class RandomTelegraph(Effect):
    """A bias that jumps by `size` between two levels, on each of which it stays for `dwell` on average."""

    size: Any = parameter("U")
    dwell: Any = parameter("s", "time")

    name: ClassVar[str] = "random_telegraph"
    title: ClassVar[str] = "random telegraph noise"
    separator: ClassVar[str] = "a record with more of its jumps"
    saying: ClassVar[str] = "jumps between two levels {size} apart, staying for {dwell} on average"
    alters: ClassVar[bool] = True

    def form(self, drive: Mapping[str, Any] | None = None) -> Form:
        """The Gauss-Markov process of the same spectrum: ``sigma = size / 2``, ``tau = dwell / 2`` [2]_."""
        return Form(
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
    def sought(cls, series: Series) -> list[Sought]:
        """The hidden Markov chain that explains the means of short cells best."""
        from scipy.optimize import minimize

        cells = Cells.of(series)
        band = series.weight[1 : cells.mean.size + 1]
        if float(np.max(series.slow[1:])) > SLOW or float(band.max()) > UNEVEN * float(band.min()):
            return []
        starts = cells.starts()
        best = None
        for start in starts:
            found = minimize(
                cells.loss,
                start,
                method="Nelder-Mead",
                options={"xatol": 1e-3, "fatol": 1e-3, "maxiter": 400},
            )
            if best is None or found.fun < best.fun:
                best = found
        if best is None or -best.fun < PROMISING:
            return []
        size, dwell = (float(np.exp(v)) for v in best.x[:2])
        H = _second(cells.loss, best.x)
        values = np.maximum(np.linalg.eigvalsh(H), 1e-3)
        evidence = -float(best.fun) + 1.5 * float(np.log(2.0 * np.pi)) - 0.5 * float(np.log(values).sum())
        # The level of the noise is free in either model.
        evidence += 0.5 * float(np.log(2.0 * series.n + 1.0 / series.level[1] ** 2))
        # The constant is a nuisance of either model: what it leaves open without levels is taken off.
        evidence -= 0.5 * float(np.log(2.0 * np.pi)) + float(np.log(cells.sd / np.sqrt(cells.mean.size)))
        evidence -= float(np.log(DECADES)) + float(np.log(np.log(cells.mean.size / SEVERAL)))
        deviation = np.sqrt(np.abs(np.diag(np.linalg.pinv(H, hermitian=True))))
        spread = np.exp(np.minimum(1.96 * deviation, 300.0))
        ci95 = {
            "size": (size / float(spread[0]), size * float(spread[0])),
            "dwell": (dwell / float(spread[1]), dwell * float(spread[1])),
        }
        return [Sought(cls(size, dwell), 0.0, evidence, ci95)]

    def taken(self, series: Series) -> Array:
        """The samples less the level that each is most likely on, smoothed both ways."""
        cells = Cells.of(series)
        up = cells.smoothed(float(self.size), float(self.dwell))
        at = (np.arange(cells.mean.size) + 0.5) * cells.block
        level = np.interp(np.arange(series.n) + 0.5, at, up)
        return np.asarray(series.y - float(self.size) * (level - 0.5))


@dataclass(frozen=True)
class Cells:
    """Means of cells of a record [SI], their white deviation, their length.

    Parameters
    ----------
    power : float
        Sum of squares of the faster ordinates, of which there are `rest`.
    level : (mean, deviation)
        What is believed of the logarithm of the noise's level over that of the fit.
    """

    mean: Array
    sd: float
    block: int
    dt: float
    power: float
    rest: int
    level: tuple[float, float]

    @staticmethod
    def of(series: Series) -> Cells:
        """At most `CELLS` of them."""
        block = max(1, -(-series.n // CELLS))
        m = series.n // block
        mean = series.y[: m * block].reshape(m, block).mean(axis=1)
        level = 1.0 / float(np.mean(series.weight[1 : m + 1]))
        power = float(series.X[m:] @ series.X[m:]) if block > 1 else 0.0
        rest = series.n - m if block > 1 else 0
        sd = level / float(np.sqrt(block))
        return Cells(mean - mean.mean(), sd, block, series.dt * block, power, rest, series.level)

    def starts(self) -> list[Array]:
        """Size, dwell (logarithms), middle, level from where the means stand, smoothed over several widths."""
        from scipy.ndimage import uniform_filter1d

        out = []
        loud = 0.5 * float(np.log(self.power / self.rest)) if self.rest else 0.0
        for width in (4, 16, 64):
            if self.mean.size < 8 * width:
                continue
            smooth = uniform_filter1d(self.mean, width, mode="nearest")
            excess = max(float(np.var(smooth)) - self.sd**2 / width, 1e-2 * self.sd**2 / width)
            out.append(np.array([np.log(2.0 * np.sqrt(excess)), np.log(3.0 * width * self.dt), 0.0, loud]))
        return out

    def loss(self, point: Array) -> float:
        """Minus the gain of log-likelihood over no levels [nats], at log size, log dwell, middle, log level."""
        size, dwell, middle = float(np.exp(point[0])), float(np.exp(point[1])), float(point[2])
        loud, (mean, deviation) = float(point[3]), self.level
        if (
            not 1e-4 * self.sd < size < 1e4 * self.sd
            or not self.dt < dwell < self.mean.size * self.dt / SEVERAL
        ):
            return 1e6 + abs(float(point[0])) + abs(float(point[1]))
        none = -0.5 * (self.mean / self.sd) ** 2
        gain = _log_forward(self._emission(size, middle, loud), self._stay(dwell)) - float(none.sum())
        gain -= (self.mean.size + self.rest) * loud + 0.5 * self.power * float(np.expm1(-2.0 * loud))
        return -gain + 0.5 * (((loud - mean) / deviation) ** 2 - (mean / deviation) ** 2)

    def _emission(self, size: float, middle: float, loud: float) -> Array:
        levels = middle + size * np.array([-0.5, 0.5])
        return np.asarray(-0.5 * ((self.mean[:, None] - levels) / (self.sd * float(np.exp(loud)))) ** 2)

    def _stay(self, dwell: float) -> float:
        return 0.5 + 0.5 * float(np.exp(-2.0 * self.dt / dwell))

    def smoothed(self, size: float, dwell: float) -> Array:
        """Probability of the upper level in each cell, given all, shape (m,)."""
        from scipy.optimize import minimize

        def off(x: Array) -> float:
            return self.loss(np.array([np.log(size), np.log(dwell), size * x[0], x[1]]))

        loud = 0.5 * float(np.log(self.power / self.rest)) if self.rest else 0.0
        best = minimize(off, [0.0, loud], method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-2}).x
        e, stay = self._emission(size, size * float(best[0]), float(best[1])), self._stay(dwell)
        e = np.exp(e - e.max(axis=1, keepdims=True))
        forward, backward = _pass(e, stay), _pass(e[::-1], stay)[::-1]
        both = forward * backward / np.maximum(e, 1e-300)
        return np.asarray(both[:, 1] / both.sum(axis=1))


def _pass(e: Array, stay: float) -> Array:
    """Normalised forward probabilities, shape (m, 2)."""
    out = np.empty_like(e)
    p = 0.5
    for k, (a, b) in enumerate(e.tolist()):
        p = p * stay + (1.0 - p) * (1.0 - stay)
        down, up = (1.0 - p) * a, p * b
        p = up / (down + up) if down + up > 0.0 else 0.5
        out[k] = 1.0 - p, p
    return out


def _log_forward(e: Array, stay: float) -> float:
    """Log-likelihood of a two-state chain from log emissions, shape (m, 2), by products of pairs [1]_."""
    top = e.max(axis=1)
    w = np.exp(e - top[:, None])
    M = np.array([[stay, 1.0 - stay], [1.0 - stay, stay]])[None] * w[:, None, :]
    total = float(top.sum())
    while M.shape[0] > 1:
        if M.shape[0] % 2:
            M = np.concatenate([M, np.eye(2)[None]])
        M = M[0::2] @ M[1::2]
        scale = M.max(axis=(1, 2))
        total += float(np.log(scale).sum())
        M = M / scale[:, None, None]
    return total + float(np.log(0.5 * M[0].sum()))


def _second(f: Any, x: Array) -> Array:
    """Second derivatives by central differences, shape (4, 4)."""
    steps = np.diag([0.02, 0.02, 0.02 * float(np.exp(x[0])), 0.005])
    H = np.zeros((4, 4))
    for i in range(4):
        for j in range(i + 1):
            a, b = steps[i], steps[j]
            H[i, j] = H[j, i] = (f(x + a + b) - f(x + a - b) - f(x - a + b) + f(x - a - b)) / (
                4.0 * a[i] * b[j]
            )
    return H
