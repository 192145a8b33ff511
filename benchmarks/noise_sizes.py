"""Sizes of a flight's noises: the likelihood of the innovations beside the measurement difference method.

Usage: python benchmarks/noise_sizes.py [--count 6] [--seed S] [--duration 120] [--docs]

Flights of `benchmarks/flight` with noises that the filter assumes wrongly, each by a factor drawn between a half and two. Both
methods get the same smoothed path, the same matrices about it and the same readings: kfgen maximises the likelihood of the
innovations; the measurement difference method takes the readings of six seconds at a time, removes what any state at their
beginning could do to them, and fits the sizes to the second moments of what is left, by least squares without weights.

References: O. Kost, J. Dunik, O. Straka, Measurement difference method: a universal tool for noise identification, IEEE
Trans. Automatic Control 68(3), 2023; J. Dunik, O. Kost, O. Straka, E. Blasch, Covariance estimation and Gaussianity
assessment for state and measurement noise, J. Guidance, Control, and Dynamics 43(1), 2020.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent / "flight"))
from docs_table import measured_at, write_table
from flight import ACCEL_N, GYRO_N, SD
from trial import Case, log_of

Array = NDArray[np.float64]

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]
VEHICLES = ("quadrotor", "wing", "car")
MAX_LOG_FACTOR = float(np.log(2.0))
WINDOW_S = 6.0
MIN_SIZE_SQUARED = 1e-4
"""Of a least-squares fit, which knows no sign."""
UNITS = {"gyro": "rad/s", "accel": "m/s^2", "gnss_p": "m", "gnss_v": "m/s", "mag": "T", "baro": "m"}
AXES = {"gyro": "xyz", "accel": "xyz", "gnss_p": "NED", "gnss_v": "NED", "mag": "xyz", "baro": ("height",)}


def model_with(factors: dict[str, float]) -> Any:
    """A filter that assumes of every noise its true size over a factor."""
    import kfgen as kf
    from kfgen.effects import make
    from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term

    channels = {}
    for sensor, unit in UNITS.items():
        for axis in AXES[sensor]:
            f = factors[sensor]
            effect = (
                make("white_noise", N={"gyro": GYRO_N, "accel": ACCEL_N}[sensor] / f)
                if sensor in ("gyro", "accel")
                else make("sample_noise", sd=SD[sensor] / f)
            )
            channels["baro" if sensor == "baro" else f"{sensor}_{axis}"] = ChannelNoise(unit, (Term(effect),))
    return kf.build("ins15", noise=NoiseModel(channels), options={"left_out": "false"}, sensors=SENSORS)


def by_differences(path: Any) -> dict[str, float]:
    """Sizes by the measurement difference method, by input and channel."""
    from kfgen.gap.flight.noise.tuned import groups_of

    groups = groups_of(path)
    steps = max(1, round(WINDOW_S / path.log.dt))
    G, b = np.zeros((len(groups), len(groups))), np.zeros(len(groups))
    for window in windows(path, steps):
        left = window.without_state()
        r = left.T @ window.y
        parts = [left.T @ window.covariance(g) @ left for g in groups]
        b += [float(r @ P @ r) for P in parts]
        G += [[float(np.sum(P * Q)) for Q in parts] for P in parts]
    squares = np.linalg.lstsq(G, b, rcond=1e-12)[0]
    sizes = np.sqrt(np.maximum(squares, MIN_SIZE_SQUARED))
    return {g.where: float(s) for g, s in zip(groups, sizes)}


@dataclass
class Window:
    """Readings of some steps over their standard deviations, and what states and noises do to them.

    Parameters
    ----------
    y : ndarray, shape (m,)
        Less what the path's own motion does.
    H : ndarray, shape (m, n)
    step : ndarray of int, shape (m,)
        Of each reading.
    channels : list of str
        Of each reading.
    Phi : list of ndarray, shape (n, n)
    noise : mapping of str to list of ndarray, shape (n, n)
        Process noise of each step by each input.
    """

    y: Array
    H: Array
    step: NDArray[np.intp]
    channels: list[str]
    Phi: list[Array]
    noise: dict[str, list[Array]]

    def without_state(self) -> Array:
        """Orthonormal directions of the readings that no state at the beginning moves, shape (m, m - rank)."""
        O, whole = np.zeros_like(self.H), np.eye(self.H.shape[1])
        for k, Phi in enumerate(self.Phi):
            here = self.step == k
            O[here] = self.H[here] @ whole
            whole = Phi @ whole
        U, s, _ = np.linalg.svd(O, full_matrices=True)
        return np.asarray(U[:, int(np.sum(s > 1e-9 * s.max())) :])

    def covariance(self, group: Any) -> Array:
        """Of the readings by a noise of size one, shape (m, m)."""
        C = np.diag([float(c in group.channels) for c in self.channels])
        for name in group.inputs:
            back, columns = np.zeros_like(self.H), []
            for k in reversed(range(len(self.Phi))):
                values, vectors = np.linalg.eigh(self.noise[name][k])
                columns.append(back @ (vectors * np.sqrt(np.maximum(values, 0.0))))
                here = self.step == k
                back = back @ self.Phi[k]
                back[here] = self.H[here]
            A = np.hstack(columns)
            C = C + A @ A.T
        return np.asarray(C)


def windows(path: Any, steps: int) -> Iterator[Window]:
    """The whole windows of a flight."""
    from kfgen.gap.flight.linear.step_matrices import step_matrices

    linear, n = path.linear, path.linear.states
    names = list(path.equations.input_noise)
    matrices = step_matrices(path.equations, path.given, path.x.shape[0], dict.fromkeys(names, 1.0))
    block = next(iter(matrices.blocks()))

    def full(at: Any, entries: Array) -> Array:
        M = np.zeros((n, n))
        M[at] = entries
        return M

    for first in range(0, path.x.shape[0] - steps, steps):
        seen = np.flatnonzero((linear.rows.at >= first) & (linear.rows.at < first + steps))
        scale, own = np.sqrt(linear.R[seen]), range(first, first + steps)
        Phi = [full(matrices.Phi_at, block.Phi[k]) for k in own]
        noise = {i: [full(matrices.Qd_at, block.noise[i][k]) for k in own] for i in names}
        y, H, step = linear.y[seen] / scale, linear.H[seen] / scale[:, None], linear.rows.at[seen] - first
        x = np.zeros(n)
        for k in range(steps):
            y[step == k] -= H[step == k] @ x
            x = Phi[k] @ x + linear.c[first + k]
        yield Window(y, H, step, [linear.rows.channels[i] for i in linear.rows.index[seen]], Phi, noise)


def one(vehicle: str, seed: int, duration_s: float) -> list[tuple[str, float, float, float, float, float]]:
    """Noise, true factor, sizes by likelihood and by differences, and the seconds of each."""
    from kfgen.gap.flight.flight_log import flight_log
    from kfgen.gap.flight.noise.tuned import tuned
    from kfgen.gap.flight.path import flown
    from kfgen.gap.flight.scene import FlightScene
    from kfgen.gap.scene.addition import relinearised
    from kfgen.gap.scene.newton import fitted
    from kfgen.gap.scene.scene import start_of
    from kfgen.run.run import program_over

    rng = np.random.default_rng(seed)
    factors = {s: float(np.exp(rng.uniform(-MAX_LOG_FACTOR, MAX_LOG_FACTOR))) for s in UNITS}
    log = log_of(Case(vehicle, seed, duration_s), [])
    scene = FlightScene(flown(flight_log(log, program_over(model_with(factors), log))))
    path = relinearised(scene, fitted(scene, start_of(scene)))[0].path  # with the field that the flight shows
    begun = time.process_time()
    likely = {s.group.where: s.times for s in tuned(path).sizes}
    between = time.process_time()
    different = by_differences(path)
    ended = time.process_time()
    return [
        (
            where,
            next(f for s, f in factors.items() if where.startswith(s)),
            size,
            different[where],
            between - begun,
            ended - between,
        )
        for where, size in likely.items()
    ]


def _error_words(pairs: list[tuple[float, float]]) -> str:
    """Root mean square error of the logarithms of sizes that were found, and how many were not above zero."""
    found = [np.log(size / true) for size, true in pairs if size**2 > MIN_SIZE_SQUARED]
    words = f"{100.0 * float(np.sqrt(np.mean(np.square(found)))):.0f} %" if found else ""
    missed = len(pairs) - len(found)
    return ", ".join(w for w in (words, f"{missed} of {len(pairs)} not above zero" if missed else "") if w)


def main() -> None:
    """Fly, estimate by both, compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--seed", type=int, default=112621)
    parser.add_argument("--duration", type=float, default=120.0)
    parser.add_argument("--docs", action="store_true")
    wanted = parser.parse_args()
    warnings.simplefilter("ignore")
    load = os.getloadavg()[0]
    found = []
    for k in range(wanted.count):
        found += one(VEHICLES[k % len(VEHICLES)], wanted.seed + k, wanted.duration)
        print(f"{k + 1}/{wanted.count}", file=sys.stderr, flush=True)
    lines = [
        "| noise | innovation likelihood | measurement differences |",
        "|---|---|---|",
    ]
    for where in dict.fromkeys(f[0] for f in found):
        rows = [f for f in found if f[0] == where]
        cells = [_error_words([(f[i], f[1]) for f in rows]) for i in (2, 3)]
        lines.append(f"| {where} | {cells[0]} | {cells[1]} |")
    seconds = [float(np.median([f[i] for f in found])) for i in (4, 5)]
    lines += [
        f"| computing, median | {seconds[0]:.1f} s | {seconds[1]:.1f} s |",
        "",
        f"{wanted.count} flights of {wanted.duration:g} s, seed {wanted.seed}. {measured_at(load)}.",
    ]
    text = "\n".join(lines)
    print(text)
    if wanted.docs:
        write_table("benchmarks.md", "noise sizes", text)


if __name__ == "__main__":
    main()
