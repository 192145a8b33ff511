"""MATLAB's ``imuSensor``: N and K of each axis in SI, by ``gyroparams`` and ``accelparams``.

A sample has the standard deviation ``N sqrt(rate)`` where ``NoiseType`` is single-sided; the default, double-sided, is
smaller by the root of two.

References
----------
.. [1] mathworks.com/help/nav/ref: ``imuSensor`` (algorithms), ``gyroparams``, ``accelparams``: names and units (read);
   the factor of ``NoiseType`` as documented there, not run.
"""

from __future__ import annotations

from kfgen.consumers.base import Converted, Imu, Value

NAME = "matlab"
TITLE = "MATLAB imuSensor"
SOURCE = "documentation of imuSensor, gyroparams and accelparams (mathworks.com/help/nav/ref); not run"
RATE = "the sampling rate of the simulated sensor (SampleRate)"
NEEDS = ("gyro", "accel")

_OBJECTS = {"Gyroscope": ("gyro", "gyroparams", "rad/s"), "Accelerometer": ("accel", "accelparams", "m/s^2")}


def convert(imu: Imu) -> Converted:
    """A script that makes the sensor."""
    values: dict[str, Value] = {"SampleRate": imu.given_rate("--rate, of the sensor")}
    lines = [line.replace("#", "%", 1) for line in imu.header(TITLE, SOURCE, per_axis=True)]
    lines.append(f"IMU = imuSensor('accel-gyro', 'SampleRate', {imu.rate:.7g});")
    for name, (sensor, maker, unit) in _OBJECTS.items():
        values[f"{name}.NoiseDensity"] = imu.vector(sensor, "N", f"{unit}/sqrt(Hz)")
        values[f"{name}.RandomWalk"] = imu.vector(sensor, "K", f"{unit}/sqrt(s)")
        lines.append(f"IMU.{name} = {maker}('NoiseType', 'single-sided');")
        lines += [_line(key, v) for key, v in values.items() if key.startswith(name)]
    return Converted("\n".join(lines), values, imu.warnings(TITLE))


def _line(key: str, v: Value) -> str:
    if not v.numbers:
        return f"% IMU.{key}: {v.words}"
    return f"IMU.{key} = [{' '.join(f'{n:.7g}' for n in v.numbers)}];  % [{v.unit}] {v.words}"
