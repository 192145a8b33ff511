"""What an ideal analyst makes of a bias that jumps now and then: that, or a random walk.

Usage: python benchmarks/gap/ideal_jumps.py [--count K] [--nulls N] [--seed S] [--strength 100] [--jobs 2] [--docs]

The staircases are those of the unknown effects of the benchmark for this count and seed, of sensors of white noise, with as
many random walks of the same strength. He knows the sensor, that it is one or the other, each as likely, how often a
staircase jumps (8 to 20 times in a record, normal sizes), and nothing of sizes. The likelihood of jumps is that of a hidden
Markov chain on a grid of levels, the walk's that of a Kalman filter. Nothing of kfgen is asked.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
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

CELLS = 1000
"""Means of samples, in which a record is looked at."""
LEVELS = 240
"""Of the grid, over the range of what is slow."""
SLOW_CELLS = 16
"""Whose means show that range."""
SIGMAS_BEYOND = 4.0
"""Standard deviations of such a mean, by which the range is wider."""
RATES = np.geomspace(8.0, 20.0, 4)
"""Jumps in a record."""
JUMPS = np.geomspace(0.02, 2.0, 12)
"""Their standard deviation, over that of a sample; a walk goes as far as the mean number of such jumps."""
HEAD = ["| hidden | named right | median odds of jumps [nats] |", "|---|---|---|"]


def log_jumps(cells: Array, R: float, levels: Array, size: float) -> Array:
    """Log-likelihood of jumps of this size for each rate, the first level anywhere on the grid; shape (rates,)."""
    m, step = cells.size, float(levels[1] - levels[0])
    log_e = -0.5 * (cells[:, None] - levels) ** 2 / R - 0.5 * np.log(2.0 * np.pi * R)
    top = log_e.max(axis=1)
    seen = np.exp(log_e - top[:, None])
    jump = np.exp(-0.5 * ((levels[:, None] - levels) / size) ** 2)
    jump *= (
        1.0 / jump.sum(axis=1, keepdims=True) if size < 2.0 * step else step / (size * np.sqrt(2.0 * np.pi))
    )
    chance = (RATES / m)[:, None]
    p = np.full((RATES.size, levels.size), 1.0 / levels.size)
    total = np.full(RATES.size, top.sum())
    for k in range(m):
        if k:
            p = (1.0 - chance) * p + chance * (p @ jump)
        p = p * seen[k]
        whole = p.sum(axis=1)
        total += np.log(whole)
        p /= whole[:, None]
    return np.asarray(total)


def log_walk(cells: Array, R: float, span: float, step: float) -> float:
    """Log-likelihood of a walk of this step between cells, the first level anywhere in the span."""
    x, P = float(cells[0]), R
    total = -float(np.log(span))
    for y in cells[1:].tolist():
        P += step**2
        S, left = P + R, y - x
        total -= 0.5 * (left**2 / S + float(np.log(2.0 * np.pi * S)))
        x, P = x + P / S * left, P * R / S
    return total


def odds(request: Request) -> float:
    """Of jumps over a walk [nats]."""
    case = static.make(request)
    sensor = sensor_of(request)
    y = case.channels[sensor.channel][0] - sensor.offset
    block = max(1, y.size // CELLS)
    cells = y[: y.size // block * block].reshape(-1, block).mean(axis=1)
    R = sensor.white**2 / block
    slow = cells[: cells.size // SLOW_CELLS * SLOW_CELLS].reshape(-1, SLOW_CELLS).mean(axis=1)
    beyond = SIGMAS_BEYOND * np.sqrt(R / SLOW_CELLS)
    levels = np.linspace(slow.min() - beyond, slow.max() + beyond, LEVELS)
    span = float(np.ptp(levels))
    jumps = np.array([log_jumps(cells, R, levels, size) for size in sensor.white * JUMPS])
    steps = sensor.white * JUMPS * np.sqrt(float(np.mean(RATES)) / cells.size)
    walks = np.array([log_walk(cells, R, span, step) for step in steps.tolist()])
    return float(logsumexp(jumps) - np.log(jumps.size) - logsumexp(walks) + np.log(walks.size))


def sensor_of(request: Request) -> Sensor:
    """By which the benchmark makes a record."""
    return SENSORS[request.index % len(SENSORS)]


def requests(count: int, nulls: int, seed: int, X: float) -> list[Request]:
    """The staircases of the benchmark, and a walk for each."""
    drawn = static.requests(count, (100.0, 30.0, 10.0), nulls, np.random.default_rng([seed, 0]))
    steps = [replace(r, strength=X) for r in drawn if r.effects == ("staircase",) and not sensor_of(r).sigma]
    walks = [replace(r, kind="single", effects=("rate_random_walk",), seed=r.seed + 1) for r in steps]
    return [*steps, *walks]


def rows(found: Sequence[tuple[Request, float]]) -> list[str]:
    """Of each kind."""
    out = []
    for name, sign in (("staircase", 1.0), ("rate_random_walk", -1.0)):
        own = [value for r, value in found if r.effects == (name,)]
        right = share(sign * value > 0.0 for value in own)
        out.append(f"| {name} | {right} | {np.median(own):.1f} |")
    return out


def main() -> None:
    """Judge the staircases of the benchmark."""
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
