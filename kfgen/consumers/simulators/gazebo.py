"""Gazebo's inertial sensor in SDF: noise of samples, and a bias that is a Gauss-Markov process.

``stddev`` is that of a sample, ``N sqrt(rate)``. The bias has the driving density ``dynamic_bias_stddev`` and the time
``dynamic_bias_correlation_time``: one Gauss-Markov term is itself, a random walk is one whose time is much longer than any
simulation, and of both together the time is that of the walk.

References
----------
.. [1] github.com/gazebosim/gz-sensors, ``src/GaussianNoiseModel.cc``: ``sigma_b_d`` and ``phi_d`` (read in copies).
.. [2] sdformat.org/spec, ``sensor/imu``: names.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from kfgen.consumers.base import AXES, Converted, Imu, Value, by_axis

NAME = "gazebo"
TITLE = "Gazebo SDF sensor"
SOURCE = "gazebosim/gz-sensors: GaussianNoiseModel.cc, read in copies of it; sdformat.org/spec"
RATE = "the sampling rate of the simulated sensor (update_rate)"
NEEDS = ("gyro", "accel")

LONG_TIME_S = 1e6
"""Correlation time of a bias that walks."""
_ELEMENTS = {"angular_velocity": ("gyro", "rad/s"), "linear_acceleration": ("accel", "m/s^2")}


def convert(imu: Imu) -> Converted:
    """The element ``sensor`` for a link."""
    values: dict[str, Value] = {"update_rate": imu.given_rate("--rate, of the sensor")}
    for element, (sensor, unit) in _ELEMENTS.items():
        by = f" / sqrt(dt), dt = {1.0 / imu.rate:.6g} s" if imu.rate else ""
        values[f"{element}.stddev"] = imu.vector(sensor, "N", unit, 1, math.sqrt(imu.rate or 0.0), by)
        values |= {f"{element}.{k}": v for k, v in _bias(imu, sensor, unit).items()}
    lines = [f"<!-- {_comment(line[2:])} -->" for line in imu.header(TITLE, SOURCE, per_axis=True)]
    lines += ['<sensor name="imu" type="imu">', "  <always_on>1</always_on>"]
    lines += [f"  <update_rate>{imu.rate:.7g}</update_rate>", "  <imu>"]
    for element in _ELEMENTS:
        lines += [f"    <{element}>", *_axes(element, values), f"    </{element}>"]
    lines += ["  </imu>", "</sensor>"]
    walks = [w for w in imu.warnings(TITLE) if "Gauss-Markov" not in w or "added" in w]
    return Converted("\n".join(lines), values, tuple(walks))


def _bias(imu: Imu, sensor: str, unit: str) -> dict[str, Value]:
    """Driving density and correlation time of each axis; those of the worst axis where one has none."""
    known: dict[str, tuple[float, float]] = {}
    for q, reading in imu.known(sensor, "K"):
        alone = len(reading.drifts) == 1 and not reading.K
        known[reading.channel] = (q, reading.drifts[0].tau if alone else LONG_TIME_S)
    names = [f"{sensor}_{a}" for a in AXES]
    if not known:
        absent = imu.absence(sensor, "K")
        return {
            "dynamic_bias_stddev": Value((), f"{unit}/sqrt(s)", absent),
            "dynamic_bias_correlation_time": Value((), "s", absent),
        }
    worst = max(known.values())
    pairs = [known.get(n, worst) for n in names]
    order = by_axis(names, dict.fromkeys(known, 0.0))
    density = f"sigma sqrt(2/tau) of Gauss-Markov, K of a random walk{order}{imu.safely()}"
    time = f"tau of Gauss-Markov, {LONG_TIME_S:g} s for a random walk{order}"
    return {
        "dynamic_bias_stddev": Value(tuple(imu.safety * q for q, _ in pairs), f"{unit}/sqrt(s)", density),
        "dynamic_bias_correlation_time": Value(tuple(tau for _, tau in pairs), "s", time),
    }


def _axes(element: str, values: Mapping[str, Value]) -> list[str]:
    keys = ("stddev", "dynamic_bias_stddev", "dynamic_bias_correlation_time")
    own = {k: values[f"{element}.{k}"] for k in keys}
    lines = [f"      <!-- {k} [{v.unit}]: {_comment(v.words)} -->" for k, v in own.items()]
    for k, axis in enumerate(AXES):
        lines += [f"      <{axis}>", '        <noise type="gaussian">', "          <mean>0</mean>"]
        lines += [f"          <{key}>{v.numbers[k]:.7g}</{key}>" for key, v in own.items() if v.numbers]
        lines += ["        </noise>", f"      </{axis}>"]
    return lines


def _comment(words: str) -> str:
    """Words that may stand in a comment of XML."""
    return re.sub("-{2,}", "-", words).rstrip("-")
