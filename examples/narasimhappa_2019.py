"""The tables of M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models (2019), and their price.

Usage: python narasimhappa_2019.py [SECONDS of the simulated sensor; 60 without, 3600 in the paper]
The real log at rest is an MPU-6050 (T. Suarez, MIT), the moving one BROAD trial 6 (Laidig et al. 2021, CC BY 4.0).
"""

import os
import sys
from pathlib import Path

import numpy as np
from papers.narasimhappa import (
    DEGREE_PER_HOUR,
    Static,
    printed_numbers,
    printed_tables,
    static_sensor,
    under_motion,
)
from papers.row import text_of

from kfgen.log.readers import ColumnMap, read_log

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
full = seconds >= 3600.0
print(text_of("What follows from the printed numbers", printed_numbers()))
print("Tables 4 to 6 as printed: after / raw\n" + printed_tables())

static = Static.of(static_sensor(seconds), 0.01)
print(f"\nTable 4 on a simulated sensor of its raw readings, {seconds:g} s at 100 Hz")
print(static.table(DEGREE_PER_HOUR, "deg/h"))
print("\n".join(static.words()))

data = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
resting, moving = (
    data / "static" / "mpu6050_static_450s.npz",
    data / "dynamic" / "broad_06_undisturbed_fast_rotation_A.npz",
)
if not (resting.is_file() and moving.is_file()):
    print("\nskipped: the recordings are not here (set KFGEN_DATA)")
    raise SystemExit

log = read_log(resting, columns=ColumnMap.parse("gyro_x = gyr_counts_x [deg/s/131]"))
y = np.degrees(log.values("gyro_x"))[300 : None if full else 6300]
print(f"\nThe same on an MPU-6050 at rest, {y.size * log.dt:g} s, gyro_x")
print(Static.of(y, log.dt).table(DEGREE_PER_HOUR, "deg/h"))

log = read_log(moving)
still = log.cut(0, round(20.0 / log.dt))
start = round(60.0 / log.dt)
stretch = log if full else log.cut(start, start + 6000)
print(f"\nUnder motion: BROAD trial 6, {stretch.duration:.3g} s, gyro_x against its optical reference")
print(under_motion(stretch, still))
