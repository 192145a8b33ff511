"""Sensors that pass less than half their rate: what is found in a record where nothing is missing.

Usage: python benchmarks/gap/low_passes.py [--count K] [--seed S] [--without M] [--samples N] [--jobs 2] [--docs]

White noise of a gyro and its random walk go through a filter of scipy (first order, fourth order, a decimator's finite
impulse response, a mean of five samples), and are rounded to a tenth of the noise; behind a filter of eighth order, to
a ten-thousandth. `kfgen identify` sees one record, `kfgen gap` the next; for M of the records of each filter beside it
stands the same file without `sensor_response`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, firwin, lfilter

sys.path.append(str(Path(__file__).resolve().parents[1]))

from docs_table import write_table
from tables import share

import kfgen as kf
from kfgen.effects.noise_model import NoiseModel

Array = NDArray[np.float64]

RATE_HZ = 100.0
WHITE = 0.1
"""Density of the white noise [deg/s/sqrt(Hz)]."""
WALK_STEP = 0.01
"""Standard deviation of what the random walk goes from sample to sample [deg/s]: K = 0.1 deg/s/sqrt(s)."""
SETTLING_SAMPLES = 1000
FILTERS = {
    "first order, 10 Hz": butter(1, 10.0, fs=RATE_HZ),
    "fourth order, 20 Hz": butter(4, 20.0, fs=RATE_HZ),
    "decimator, 31 taps, 25 Hz": (firwin(31, 25.0, fs=RATE_HZ), [1.0]),
    "mean of five samples": (np.ones(5) / 5.0, [1.0]),
    "eighth order, 8 Hz, hardly rounded": butter(8, 8.0, fs=RATE_HZ),
}
STEP = {"eighth order, 8 Hz, hardly rounded": 1e-4}
"""Step of the converter over the standard deviation of the white noise, of others a tenth."""
HEAD = [
    "| low-pass of the sensor | no gap | a name above 90 % | without `sensor_response`: no gap | a name above 90 % |",
    "|---|---|---|---|---|",
]


@dataclass(frozen=True)
class Trial:
    """One sensor, two records."""

    filter: str
    seed: int
    samples: int
    compared: bool


@dataclass(frozen=True)
class Found:
    """Verdict and whether a name stands above 90 %."""

    quiet: bool
    claimed: bool


def record(trial: Trial, rng: np.random.Generator) -> Array:
    """What the sensor's log holds [deg/s]."""
    sd = WHITE * RATE_HZ**0.5
    white = sd * rng.standard_normal(trial.samples + SETTLING_SAMPLES)
    fast = lfilter(*FILTERS[trial.filter], white)[SETTLING_SAMPLES:]
    y = fast + np.cumsum(WALK_STEP * rng.standard_normal(trial.samples))
    step = STEP.get(trial.filter, 0.1) * sd
    return np.asarray(np.round(y / step) * step)


def without_response(noise: NoiseModel) -> NoiseModel:
    """The file as it would be without the description of the low-pass."""
    channels = {
        name: replace(c, terms=tuple(t for t in c.terms if t.effect.name != "sensor_response"))
        for name, c in noise.channels.items()
    }
    return replace(noise, channels=channels)


def done(trial: Trial) -> tuple[str, list[Found]]:
    """What is found with the description and, where that is compared, without."""
    rng = np.random.default_rng([trial.seed, list(FILTERS).index(trial.filter)])
    t = np.arange(trial.samples) / RATE_HZ
    with tempfile.TemporaryDirectory() as folder:
        paths = [f"{folder}/{k}.csv" for k in range(2)]
        for path in paths:
            np.savetxt(
                path,
                np.column_stack([t, record(trial, rng)]),
                delimiter=",",
                header="t [s],gyro_x [deg/s]",
                comments="",
            )
        noise = kf.identify(paths[0]).noise
        files = [noise, without_response(noise)] if trial.compared else [noise]
        answers = [kf.find_gap(paths[1], n) for n in files]
    found = [Found(a.verdict == "no_gap", any(f.probability > 0.9 for f in a.findings)) for a in answers]
    return trial.filter, found


def lines(found: Sequence[tuple[str, list[Found]]]) -> list[str]:
    """The table."""
    out = list(HEAD)
    for name in FILTERS:
        of = [[f[k] for n, f in found if n == name and len(f) > k] for k in (0, 1)]
        cells = [share(getattr(f, what) for f in each) for each in of for what in ("quiet", "claimed")]
        out.append(f"| {' | '.join([name, *cells])} |")
    return out


def main() -> None:
    """Draw the records, and compare."""
    parser = argparse.ArgumentParser(prog="benchmarks/gap/low_passes.py")
    parser.add_argument("--count", type=int, default=20, help="records of each filter")
    parser.add_argument("--seed", type=int, default=20260101)
    parser.add_argument(
        "--without", type=int, default=20, help="of these, compared without the description, too"
    )
    parser.add_argument("--samples", type=int, default=8000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--docs", action="store_true", help="write the table into the documentation")
    wanted = parser.parse_args()
    seeds = np.random.default_rng(wanted.seed).integers(2**47, size=wanted.count)
    trials = [
        Trial(n, int(s), wanted.samples, k < wanted.without) for k, s in enumerate(seeds) for n in FILTERS
    ]
    with ProcessPoolExecutor(wanted.jobs, mp_context=get_context("spawn")) as pool:
        table = lines(list(pool.map(done, trials)))
    print("\n".join(table))
    if wanted.docs:
        command = (
            f"`python benchmarks/gap/low_passes.py --count {wanted.count} --seed {wanted.seed} "
            f"--without {wanted.without} --samples {wanted.samples} --docs`"
        )
        write_table("benchmarks.md", "gap low-passes", "\n".join([*table, "", f"Drawn by\n{command}."]))


if __name__ == "__main__":
    main()
