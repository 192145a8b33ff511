"""KF-GINS's ``imunoise``: N in navigation units, Gauss-Markov biases by sigma and one common time.

Its bias is ``Qc = 2 std^2 / corrtime`` with one `corrtime` for all; the geometric mean of the terms' own times is
taken, and the stationary standard deviations are kept. A random walk K beside them is given as the sigma whose
driving density at that time is K: ``sqrt(sum sigma^2 + K^2 corrtime / 2)``. K alone has no correlation time and is left out.

References
----------
.. [1] github.com/i2Nav-WHU/KF-GINS, ``config/kf-gins.yaml`` (names, units), ``src/kf_gins.cpp`` (conversions),
   ``src/kf-gins/gi_engine.cpp`` (``Qc``) (all read).
"""

from __future__ import annotations

import math

from kfgen.consumers.base import AXES, SENSORS, AxisValue, Converted, Imu, Value, by_axis, root_sum, unused
from kfgen.consumers.yaml_text import yaml_lines
from kfgen.core.units import from_si

NAME = "kfgins"
TITLE = "KF-GINS imunoise"
SOURCE = "read in i2Nav-WHU/KF-GINS: config/kf-gins.yaml, src/kf_gins.cpp, src/kf-gins/gi_engine.cpp"
RATE = ""
NEEDS = ("gyro", "accel")


def convert(imu: Imu) -> Converted:
    """The block for its configuration file."""
    taus = [e.tau for s in SENSORS for r in imu.readings(s) for e in r.drifts]
    common = math.exp(sum(map(math.log, taus)) / len(taus)) if taus else None
    values = {
        "arw": imu.vector("gyro", "N", "deg/sqrt(h)"),
        "vrw": imu.vector("accel", "N", "m/s/sqrt(h)"),
        "gbstd": _deviation(imu, "gyro", "deg/h", common),
        "abstd": _deviation(imu, "accel", "mGal", common),
        "corrtime": _time(taus, common),
    }
    lines = [*imu.header(TITLE, SOURCE, per_axis=True), "imunoise:", *yaml_lines(values, "  ")]
    lines += ["  # gsstd, asstd: scale factors show in motion only; keep your own [ppm]"]
    return Converted("\n".join(lines), values, _warnings(imu, taus))


def _time(taus: list[float], common: float | None) -> Value:
    if common is None:
        return Value((), "h", "not identified, left out: no gauss_markov in any channel")
    words = (
        f"tau of {'the term' if len(taus) == 1 else f'{len(taus)} terms, geometric mean'}; no safety factor"
    )
    return Value((from_si(common, "h"),), "h", words)


def _deviation(imu: Imu, sensor: str, unit: str, common: float | None) -> Value:
    readings = imu.readings(sensor)
    names = ", ".join(r.channel for r in readings)
    if common is None:
        words = f"not identified, left out: no gauss_markov in {names}"
        if any(r.K for r in readings):
            words += "; K alone has no correlation time (choose corrtime T, then K sqrt(T/2))"
        return Value((), unit, words)
    known = {r.channel: d for r in readings if (d := _stationary(r, common)) is not None}
    if not known:
        return Value((), unit, f"not identified, left out: no gauss_markov or rate_random_walk in {names}")
    worst = max(known.values())
    axes = [f"{sensor}_{a}" for a in AXES]
    numbers = tuple(from_si(imu.safety * known.get(name, worst), unit) for name in axes)
    words = "sqrt(sigma^2 + K^2 corrtime/2)" if any(r.K for r in readings) else "sigma of Gauss-Markov"
    return Value(numbers, unit, words + by_axis(axes, known) + imu.safely())


def _stationary(reading: AxisValue, common: float) -> float | None:
    return root_sum([*(e.sigma for e in reading.drifts), (reading.K or 0.0) * math.sqrt(common / 2.0)])


def _warnings(imu: Imu, taus: list[float]) -> tuple[str, ...]:
    said = []
    if taus and max(taus) > 1.01 * min(taus):
        said.append(
            f"one corrtime for correlation times from {min(taus):.3g} to {max(taus):.3g} s: the standard "
            "deviations are kept, the driving densities are not"
        )
    for sensor in SENSORS:
        for r in imu.readings(sensor):
            if taus and r.K:
                said.append(
                    f"{r.channel}: K is given as a Gauss-Markov of corrtime, equal over shorter times only"
                )
            said += unused(r, TITLE)
    return tuple(said)
