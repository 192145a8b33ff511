"""M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models, 2019, reproduced.

The recording (Xsens MTi, one hour) is not published: its tables are laid out on a simulated sensor of the same
Allan readings, and on any log at rest. Beside each filter stands what it does to a true rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import lfilter

from kfgen.arma.estimate import estimate
from kfgen.arma.process import Arma
from kfgen.effects import make
from kfgen.effects.process.stochastic import FLICKER_FLOOR_OVER_B
from kfgen.log.log import Log
from kfgen.report.page import columns
from kfgen.run.adaptive.denoise import Denoised, Settings, at_rest, denoise_samples
from kfgen.run.adaptive.rules import rules
from papers.row import Row, exact

Array = NDArray[np.float64]

DEGREE_PER_HOUR = 3600.0
"""Degrees per hour in a degree per second: the unit of the paper's tables."""
PHI, THETA, AIC = (-0.5422, -0.1204), 0.1382, -5.7612
PRINTED = {
    "X": ((165.11, 58.77, 51.758), (1.279, 0.690, 0.00038), (0.331, 0.421, 0.00012)),
    "Y": ((33.043, 74.729, 71.7587), (0.6570, 0.2653, 0.000562), (0.442, 0.150, 0.000312)),
    "Z": ((38.922, 29.810, 51.758), (1.2516, 0.832, 0.00028), (0.914, 0.542, 0.00014)),
}
"""Tables 4 to 6: ARW, BS, drift of raw data, after SHAFKF-P, after SHAFKF-R (in the text at hand their columns run
together, as "165.1158.7751.758")."""
SMOOTHED = 9
"""Samples over which a reference attitude is differenced."""


def innovation_gain(seed: int = 0, n: int = 50_000) -> float:
    """By how much Akaike's criterion of ARMA(1,1) exceeds that of ARMA(2,1) on a process of table 3.

    The largest over the conventions in which the signs of its coefficients may be meant.
    """
    found = []
    for sign, turn in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        true = Arma(tuple(sign * v for v in PHI), (turn * THETA,), 1.0)
        w = np.random.default_rng(seed).standard_normal(n + 100)
        y = np.asarray(lfilter(true.ma, true.ar, w))[100:]
        one, two = estimate(y, 1, 1, "least-squares"), estimate(y, 2, 1, "least-squares")
        found.append(float(np.log(one.sigma**2) - np.log(two.sigma**2) - 2.0 / n))
    return max(found)


def white_state_variance() -> tuple[float, float]:
    """Variance of the process of table 3 with unit noise, and with its noise's past taken for a new noise."""
    A, r, H = Arma(PHI, (THETA,), 1.0).state_space()
    true = H @ solve_discrete_lyapunov(A, np.outer(r, r)) @ H
    companion = np.array([[PHI[0], PHI[1]], [1.0, 0.0]])
    as_white = solve_discrete_lyapunov(companion, np.diag([1.0 + THETA**2, 0.0]))[0, 0]
    return float(true), float(as_white)


def printed_numbers() -> list[Row]:
    """What follows from the printed numbers alone."""
    true, as_white = white_state_variance()
    rows = [
        exact("floor of the Allan deviation of B", "0.668", FLICKER_FLOOR_OVER_B, "sqrt(2 ln 2 / pi)"),
        exact("kurtosis of normal samples", "1", 3.0),
        Row("unit of ARW", "deg/h", "deg/sqrt(h)", "exact", "an angle's random walk grows with the root of time"),
        Row("theta1 of table 3", "0.1382 and -0.1382", note="text and table differ in its sign"),
        exact("noise of table 3 from its AIC [U]", "-", float(np.exp(AIC / 2.0))),
        exact("AIC of ARMA(1,1) less that of (2,1)", "0.1886", innovation_gain(),
              "phi2 = -0.12 gains no more: the printed AICs are not of one record"),
        exact("variance of the state, W = [e_k, e_(k-1)] taken as white", "-", as_white / true,
              "of the true variance: e_(k-1) was e_k a sample before"),
    ]  # fmt: skip
    most = max(raw[0] / after[0] for raw, *filtered in PRINTED.values() for after in filtered)
    least = min(raw[0] / filtered[-1][0] for raw, *filtered in PRINTED.values())
    rows.append(
        Row("ARW is reduced by", "1000", f"{least:.0f} to {most:.0f}", "exact", "by its own tables 4 to 6")
    )
    return rows


def static_sensor(seconds: float, rate: float = 100.0, seed: int = 0) -> Array:
    """A simulated X axis [deg/s] with the raw readings of table 4: white noise, and a floor."""
    N, B = (v / DEGREE_PER_HOUR for v in PRINTED["X"][0][:2])
    t = np.asarray(np.arange(int(seconds * rate)) / rate, dtype=np.float64)
    parts = make("white_noise", N=N), make("bias_instability", B=B, shortest=1.0, longest=seconds)
    return np.asarray(
        np.sum([e.simulate(t, np.random.default_rng([seed, i])) for i, e in enumerate(parts)], axis=0)
    )


@dataclass(frozen=True)
class Static:
    """All filters over one channel at rest."""

    by_filter: dict[str, Denoised]

    @staticmethod
    def of(y: Array, dt: float, names: Sequence[str] = ()) -> Static:
        """The filters by name (all when left out) on samples [U], shape (n,), `dt` [s] apart."""
        rest = at_rest(y, Settings())
        return Static({n: denoise_samples(y, dt, Settings(n), rest) for n in names or rules()})

    def table(self, scale: float = 1.0, unit: str = "") -> str:
        """Tables 4 to 6: N, B and drift before and after, each filter's share of a true rate beside."""
        one = next(iter(self.by_filter.values()))
        head = [
            f"[{unit}]",
            "ARW (1 s)",
            "BS",
            "drift",
            "share of ARW",
            "a rate of 20 dev.",
            "of 0.5 dev.",
            "step",
            "-3 dB",
        ]
        raw = [f"{scale * v:.4g}" for v in (one.before.N, one.before.B, one.before.drift)]
        rows = [head, ["raw data", *raw, "1", "1", "1", "", ""]]
        for name, d in self.by_filter.items():
            after = [f"{scale * v:.4g}" for v in (d.after.N, d.after.B, d.after.drift)]
            c = d.cost
            rows.append([name, *after, f"{d.after.N / d.before.N:.3g}", f"{c.dc:.3g}", f"{c.hidden:.3g}", f"{c.delay:.3g} s",
                         f"{c.bandwidth:.3g} Hz"])  # fmt: skip
        return columns(rows)

    def words(self) -> list[str]:
        """What each filter is."""
        return [f"  {n}: {d.cost.words}" for n, d in self.by_filter.items()]


def printed_tables() -> str:
    """Tables 4 to 6 as read, as shares of the raw data."""
    rows = [["axis, filter", "ARW", "BS", "drift"]]
    for axis, (raw, *filtered) in PRINTED.items():
        for name, after in zip(("shafkf-p", "shafkf-r"), filtered):
            rows.append([f"{axis} {name}", *(f"{a / r:.3g}" for a, r in zip(after, raw))])
    return columns(rows)


def reference_rate(log: Log) -> Array:
    """Body rates [rad/s] of a reference attitude, shape (n, 3), differenced over `SMOOTHED` samples; NaN without."""
    from scipy.spatial.transform import Rotation

    q = np.column_stack([log.channel(f"ref_q_{a}").values for a in "wxyz"])
    rate, half = np.full((log.n, 3), np.nan), SMOOTHED // 2
    good = np.asarray(np.isfinite(q).all(axis=1))
    both = np.flatnonzero(good[2 * half :] & good[: -2 * half])
    first, last = (Rotation.from_quat(q[both + k], scalar_first=True) for k in (0, 2 * half))
    rate[both + half] = (first.inv() * last).as_rotvec() / (log.t[both + 2 * half] - log.t[both])[:, None]
    return rate


def under_motion(log: Log, still: Log, names: Sequence[str] = ()) -> str:
    """Each filter's error on a moving log with a reference, its noise known from a stretch at rest.

    Parameters
    ----------
    log : Log
        With gyro_x and ref_q.
    still : Log
        The same sensor at rest.
    """
    rate = reference_rate(log)[:, 0]
    raw, dt, seen = log.values("gyro_x"), log.dt, np.flatnonzero(np.isfinite(rate))
    rest = at_rest(still.values("gyro_x"), Settings())
    size = float(np.sqrt(np.mean(rate[seen] ** 2)))

    def error(y: Array) -> float:
        return float(np.sqrt(np.mean((y - rest.level - rate)[seen] ** 2)))

    rows = [["", "RMS error of the rate [deg/s]", "of the motion"]]
    rows.append(["the motion itself", f"{np.degrees(size):.4g}", "1"])
    rows.append(["raw gyro", f"{np.degrees(error(raw)):.4g}", f"{error(raw) / size:.3g}"])
    for name in names or rules():
        e = error(denoise_samples(raw, dt, Settings(name), rest).values)
        rows.append([name, f"{np.degrees(e):.4g}", f"{e / size:.3g}"])
    return columns(rows)
