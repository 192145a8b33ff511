"""PX4-ECL's replay of a simulated multicopter (PX4/PX4-ECL, BSD-3), and the states that PX4-ECL itself had."""

from __future__ import annotations

import csv
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.wgs84 import local_metres

Array = NDArray[np.float64]
GAUSS = 1e-4


@dataclass(frozen=True)
class Replay:
    """Samples by sensor, rows of time [s] and values [SI], and the recorded answer.

    Parameters
    ----------
    imu : ndarray, shape (n, 7)
        Time, specific force, angular rate.
    mag : ndarray, shape (m, 4)
        Time, field.
    gps : ndarray, shape (k, 7)
        Time, position from the first fix in north, east, down, velocity.
    answer : ndarray, shape (j, 11)
        Time, quaternion, velocity, position.
    sd : ndarray, shape (j, 10)
        Standard deviations of quaternion, velocity and position.
    """

    imu: Array
    mag: Array
    gps: Array
    answer: Array
    sd: Array


def replay(folder: Path) -> Replay:
    """Read both files of a folder."""
    rows: dict[str, list[list[float]]] = defaultdict(list)
    with (folder / "ecl_iris_gps_replay.csv").open(newline="") as lines:
        for time, sensor, *values in csv.reader(lines):
            rows[sensor].append([1e-6 * float(time), *map(float, values)])
    mag = np.array(rows["mag"])
    mag[:, 1:] *= GAUSS
    found = np.genfromtxt(folder / "ecl_iris_gps_answer.csv", delimiter=",", skip_header=1)
    answer = np.column_stack([1e-6 * found[:, 0], found[:, 1:11]])
    return Replay(np.array(rows["imu"]), mag, _local(np.array(rows["gps"])), answer, np.sqrt(found[:, 25:35]))


def _local(gps: Array) -> Array:
    """Height [mm], longitude and latitude [1e-7 deg] as metres from the first fix."""
    height, longitude, latitude = 1e-3 * gps[:, 1], 1e-7 * gps[:, 2], 1e-7 * gps[:, 3]
    north, east, down = local_metres(np.radians(latitude), np.radians(longitude), height)
    return np.column_stack([gps[:, 0], north, east, down, gps[:, 4:]])
