"""Identification against the Cramér-Rao bound: Monte Carlo over simulated logs.

Usage: python benchmarks/identify_monte_carlo.py [SEEDS] [SCENARIO ...]

Each log is simulated by plain numpy and scipy, not by kfgen: white noise, an exactly discretised
Gauss-Markov process and a random walk. Printed per scenario and parameter: the bound, the RMS error
in natural logarithms, their ratio, logs off by more than a factor of ten, and how many 95 % intervals
contain the truth; then how often the choice of terms was right.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from kfgen.effects import make
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.bounds import relative_bound
from kfgen.identify.identify import identify

FULL = ("white_noise", "gauss_markov", "rate_random_walk")


@dataclass(frozen=True)
class Scenario:
    """A sensor, a rate [Hz] and a number of samples; sigma or K of zero: not in the truth."""

    rate: float
    n: int
    N: float = 5.75e-2
    sigma: float = 1.55e-2
    tau: float = 100.0
    K: float = 9e-4


SCENARIOS = {
    "sigma-1000s": Scenario(100.0, 100_000),
    "sigma-2.8h": Scenario(100.0, 1_000_000),
    "sigma-27.8h": Scenario(10.0, 1_000_000),
    "saini-1000s": Scenario(100.0, 100_000, sigma=1.55e-2 * np.sqrt(0.01 / 2)),
    "NK-2.8h": Scenario(100.0, 1_000_000, sigma=0.0),
}


def simulate(s: Scenario, seed: int) -> np.ndarray:
    """One log."""
    rng = np.random.default_rng(seed)
    dt = 1.0 / s.rate
    y = rng.standard_normal(s.n) * s.N / np.sqrt(dt)
    if s.sigma:
        e = np.exp(-dt / s.tau)
        w = rng.standard_normal(s.n) * s.sigma * np.sqrt(1 - e * e)
        w[0] = rng.standard_normal() * s.sigma
        y += lfilter([1.0], [1.0, -e], w)
    if s.K:
        y += np.cumsum(rng.standard_normal(s.n)) * s.K * np.sqrt(dt)
    return y


def truth(s: Scenario) -> dict[str, float]:
    """The parameters that are not zero."""
    return {
        k: v for k, v in (("N", s.N), ("sigma", s.sigma), ("tau", s.tau if s.sigma else 0.0), ("K", s.K)) if v
    }


def one(job: tuple[str, int]) -> tuple[dict[str, tuple[float, float, float]], frozenset[str], bool, float]:
    """Estimates with intervals for the true set of terms; then the terms that are chosen."""
    name, seed = job
    s = SCENARIOS[name]
    record = Record(np.arange(s.n) / s.rate, simulate(s, seed))
    start = time.perf_counter()
    fixed = identify(record, FULL if s.sigma else ("white_noise", "rate_random_walk"))
    estimates = {p: (float(getattr(fixed.fit.effects[i], p)), *ci) for (i, p), ci in fixed.intervals.items()}
    chosen = identify(record)
    names = frozenset(e.name for i, e in enumerate(chosen.fit.effects) if i not in chosen.unresolved)
    fitted = any(e.name == "gauss_markov" for e in chosen.fit.effects)
    return estimates, names, fitted, time.perf_counter() - start


def report(name: str, seeds: int, pool: ProcessPoolExecutor) -> None:
    """Run a scenario and print its table."""
    s = SCENARIOS[name]
    results = list(pool.map(one, [(name, seed) for seed in range(seeds)]))
    effects = [make("white_noise", N=s.N)]
    effects += [make("gauss_markov", sigma=s.sigma, tau=s.tau)] if s.sigma else []
    effects += [make("rate_random_walk", K=s.K)]
    bound = {p: b for (_, p), b in relative_bound(effects, 1.0 / s.rate, s.n).items()}
    print(
        f"\n{name}: {s.n} samples at {s.rate:g} Hz, seeds 0 to {seeds - 1}, "
        f"{np.mean([r[3] for r in results]):.2f} s a log"
    )
    print(
        f"  {'':6} {'bound':>8} {'RMS ln':>8} {'ratio':>6} {'off x10':>8} {'covered':>8} {'limit only':>11}"
    )
    for p, true in truth(s).items():
        rows = [r[0][p] for r in results]
        errors = np.log([max(v, 1e-300) / true for v, _, _ in rows])
        covered = np.mean([lo <= true <= hi for _, lo, hi in rows])
        closed = np.array([lo > 0 for _, lo, _ in rows])
        rms = np.sqrt(np.mean(errors[closed] ** 2)) if closed.any() else np.nan
        print(
            f"  {p:6} {bound[p]:8.3g} {rms:8.3g} {rms / bound[p]:6.2f} {np.sum(np.abs(errors) > np.log(10)):8d} "
            f"{covered:8.2f} {np.sum(~closed):11d}"
        )
    sets: dict[str, int] = {}
    for _, names, _, _ in results:
        label = "+".join(sorted(n.split("_")[0] for n in names))
        sets[label] = sets.get(label, 0) + 1
    print(f"  chosen: {sets}; a Gauss-Markov term fitted in {np.mean([r[2] for r in results]):.2f}")


def main() -> None:
    """Run the scenarios named on the command line, all of them otherwise."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    with ProcessPoolExecutor(2) as pool:
        for name in sys.argv[2:] or SCENARIOS:
            report(name, seeds, pool)


if __name__ == "__main__":
    main()
