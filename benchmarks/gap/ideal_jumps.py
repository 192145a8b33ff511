"""What an ideal analyst makes of a bias that jumps: that, or the slow noise of the same spectrum.

Usage: python benchmarks/gap/ideal_jumps.py [--count K] [--nulls N] [--seed S] [--strength 100] [--jobs 2] [--docs]

Steps of any size (a staircase) and a random walk; a bias of many levels, or kicks that fade, and a Gauss-Markov bias. The
records are those of the benchmark for this count and seed, of sensors of white noise, with as many of the noise, of the
same strength. He knows the sensor, that it is one or the other, each as likely, and how their times are drawn, and nothing
of sizes. The likelihood of jumps is that of a hidden Markov chain on a grid of levels, the noise's that of a Kalman
filter, both averaged over times and sizes. Nothing of kfgen is asked.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

import static
from case import Array, Request
from docs_table import write_table
from scipy.special import logsumexp
from sensor import SENSORS, Sensor
from tables import share

CELLS = 2000
"""Means of samples, in which a record is looked at."""
LEVELS = 240
"""Of the grid, over the range of what is slow."""
SLOW_CELLS = 12
"""Whose means show that range."""
SIGMAS_BEYOND = 4.0
"""Standard deviations of such a mean, by which the range is wider."""
SIZES = np.geomspace(0.02, 2.0, 12)
"""Standard deviation of the jumps or of the bias, over that of a sample."""
KICKS_IN_A_TIME, KICK_LOG_SD = 0.3, 0.5
"""Of what fades: in its time, and the standard deviation of the logarithm of their sizes."""
HEAD = ["| hidden | named right | median odds of jumps [nats] |", "|---|---|---|"]


@dataclass(frozen=True)
class Jumps:
    """A bias that jumps, and the noise that has its spectrum.

    Parameters
    ----------
    times : pair of float
        Lengths of the record over its time, the least and the most.
    noise : str
        Effect of the same spectrum.
    moved : callable
        From levels of the grid [standard deviations of a jump] and the cells of a time: where the level is in the next
        cell, shape (levels, levels), each row a law.
    """

    times: tuple[float, float]
    noise: str
    moved: Callable[[Array, float], Array]

    def cells(self, m: int) -> Array:
        """Of a time, of m in the record: some, as likely as each other."""
        return m / np.linspace(*self.times, 4)


def _rows(law: Array) -> Array:
    return np.asarray(law / np.maximum(law.sum(axis=1, keepdims=True), 1e-300))


def _steps(x: Array, cells: float) -> Array:
    jump = _rows(np.exp(-0.5 * (x[:, None] - x) ** 2))
    return np.asarray((1.0 - 1.0 / cells) * np.eye(x.size) + jump / cells)


def _levels(x: Array, cells: float) -> Array:
    anywhere = _rows(np.broadcast_to(np.exp(-0.5 * x**2), (x.size, x.size)))
    return np.asarray((1.0 - 1.0 / cells) * np.eye(x.size) + anywhere / cells)


def _fading(x: Array, cells: float) -> Array:
    """Kicks of one sign about their mean; what lies between two levels of the grid is shared by them."""
    mean = KICKS_IN_A_TIME * np.exp(0.5 * KICK_LOG_SD**2)
    at = (x + mean) * np.exp(-1.0 / cells) - mean
    place = np.clip((at - x[0]) / (x[1] - x[0]), 0.0, x.size - 1.001)
    low, share_ = place.astype(int), place - place.astype(int)
    fades = np.zeros((x.size, x.size))
    fades[np.arange(x.size), low], fades[np.arange(x.size), low + 1] = 1.0 - share_, share_
    size = np.maximum(x - x[:, None], 1e-9)
    kick = np.where(x > x[:, None], np.exp(-0.5 * (np.log(size) / KICK_LOG_SD) ** 2) / size, 0.0)
    kick[-1, -1] = 1.0
    chance = KICKS_IN_A_TIME / cells
    return np.asarray(fades @ ((1.0 - chance) * np.eye(x.size) + chance * _rows(kick)))


KINDS: Mapping[str, Jumps] = {
    "staircase": Jumps((8.0, 20.0), "rate_random_walk", _steps),
    "levels": Jumps((30.0, 80.0), "gauss_markov", _levels),
    "relaxations": Jumps((100.0, 300.0), "gauss_markov", _fading),
}


def log_jumps(y: Array, R: float, levels: Array, moved: Array) -> float:
    """Log-likelihood of cells, the first level anywhere on the grid."""
    log_e = -0.5 * (y[:, None] - levels) ** 2 / R - 0.5 * np.log(2.0 * np.pi * R)
    top = log_e.max(axis=1)
    seen = np.exp(log_e - top[:, None])
    p, total = np.full(levels.size, 1.0 / levels.size), float(top.sum())
    for k, e in enumerate(seen):
        p = (p @ moved if k else p) * e
        whole = float(p.sum())
        total += float(np.log(whole))
        p = p / whole
    return total


def log_noise(y: Array, R: float, span: float, phi: float, q: float) -> float:
    """The same of ``x' = phi x + w``, ``w`` of variance q, the first anywhere in the span."""
    x, P = float(y[0]), R
    total = -float(np.log(span))
    for v in y[1:].tolist():
        x, P = phi * x, phi**2 * P + q
        S, left = P + R, v - x
        total -= 0.5 * (left**2 / S + float(np.log(2.0 * np.pi * S)))
        x, P = x + P / S * left, P * R / S
    return total


def odds(asked: tuple[Request, str]) -> float:
    """Of the jumps of a kind over the noise [nats]."""
    request, name = asked
    kind, sensor = KINDS[name], sensor_of(request)
    y = static.make(request).channels[sensor.channel][0]
    block = max(1, y.size // CELLS)
    cells = y[: y.size // block * block].reshape(-1, block).mean(axis=1)
    cells = cells - cells.mean()
    m, R = cells.size, sensor.white**2 / block
    slow = cells[: m // SLOW_CELLS * SLOW_CELLS].reshape(-1, SLOW_CELLS).mean(axis=1)
    beyond = SIGMAS_BEYOND * np.sqrt(R / SLOW_CELLS)
    levels = np.linspace(slow.min() - beyond, slow.max() + beyond, LEVELS)
    span, sizes, times = float(np.ptp(levels)), sensor.white * SIZES, kind.cells(m)
    jumps = [log_jumps(cells, R, levels, kind.moved(levels / s, t)) for s in sizes for t in times]
    if kind.noise == "rate_random_walk":
        noise = [log_noise(cells, R, span, 1.0, s**2 / t) for s in sizes for t in times]
    else:
        phis = np.exp(-1.0 / times)
        noise = [
            log_noise(cells, R, span, phi, s**2 * (1.0 - phi**2)) for s in sizes for phi in phis.tolist()
        ]
    return float(logsumexp(jumps) - logsumexp(noise))


def sensor_of(request: Request) -> Sensor:
    """By which the benchmark makes a record."""
    return SENSORS[request.index % len(SENSORS)]


def requests(count: int, nulls: int, seed: int, X: float) -> list[tuple[Request, str]]:
    """The records of the benchmark, each with the kind of jumps, and as many of the noise."""
    drawn = static.requests(count, (100.0, 30.0, 10.0), nulls, np.random.default_rng([seed, 0]))
    own = [
        (replace(r, strength=X), r.effects[0])
        for r in drawn
        if r.kind == "unknown" and r.effects[0] in KINDS and not sensor_of(r).sigma
    ]
    noise = [
        (replace(r, kind="single", effects=(KINDS[name].noise,), seed=r.seed + 1), name) for r, name in own
    ]
    return [*own, *noise]


def rows(found: Sequence[tuple[tuple[Request, str], float]]) -> list[str]:
    """Of each kind, and of the noise that it is compared with."""
    out = []
    for kind, jumps in KINDS.items():
        for name, sign in ((kind, 1.0), (jumps.noise, -1.0)):
            own = [value for (r, k), value in found if k == kind and r.effects == (name,)]
            said = name if sign > 0.0 else f"{name}, or {kind}"
            out.append(f"| {said} | {share(sign * v > 0.0 for v in own)} | {np.median(own):.1f} |")
    return out


def main() -> None:
    """Judge the records of the benchmark."""
    parser = argparse.ArgumentParser(prog="benchmarks/gap/ideal_jumps.py")
    parser.add_argument("--count", type=int, default=4, help="as for the benchmark: the seeds depend on it")
    parser.add_argument("--nulls", type=int, default=0, help="the same")
    parser.add_argument("--seed", type=int, default=20260101)
    parser.add_argument("--strength", type=float, default=100.0, help="nats")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--docs", action="store_true", help="write the table into the documentation")
    wanted = parser.parse_args()
    asked = requests(wanted.count, wanted.nulls, wanted.seed, wanted.strength)
    with ProcessPoolExecutor(wanted.jobs, mp_context=get_context("spawn")) as pool:
        found = list(zip(asked, pool.map(odds, asked)))
    lines = [*HEAD, *rows(found)]
    print("\n".join(lines))
    if wanted.docs:
        command = (
            f"`python benchmarks/gap/ideal_jumps.py --count {wanted.count} --nulls {wanted.nulls} "
            f"--seed {wanted.seed} --strength {wanted.strength:g} --docs`"
        )
        write_table("benchmarks.md", "ideal jumps", "\n".join([*lines, "", f"Drawn by\n{command}."]))


if __name__ == "__main__":
    main()
