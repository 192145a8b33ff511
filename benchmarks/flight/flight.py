"""A flight as its logger would see it: continuous truth, inertial samples that are means over their intervals.

Every sensor has its own rate; effects are written down here once more, in plain numpy, from their textbook definitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from vehicle import Motion, motion

Array = NDArray[np.float64]

IMU_HZ, FINE_HZ = 100.0, 800.0
RATES_HZ = {"gnss": 5.0, "mag": 25.0, "baro": 20.0, "current": 5.0, "throttle": 20.0, "vibration": 1.0}
GYRO_N, ACCEL_N = 1.5e-4, 2e-3
"""Densities of white noise [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]."""
SD = {"gnss_p": 1.5, "gnss_v": 0.1, "mag": 2e-7, "baro": 0.3}
FIELD_NED_T = np.array([2.0e-5, 0.0, 4.4e-5])
AXES = "xyz"
RANDOM = ("rate_random_walk", "gauss_markov")
SHAKEN = "noise_level:vibration"
"""Noise of an inertial sensor that follows the vibration, by the slope of its logarithm [s^2/m]."""
DRIVEN = {"temperature": "temperature", "supply_current": "current", "coupling:throttle": "throttle"}
"""What follows a recorded quantity, and which."""
LEVEL = {"temperature": 293.15, "current": 8.0, "throttle": 0.45, "vibration": 2.0}
"""About which the recorded quantities vary, and what follows them [SI]."""


@dataclass(frozen=True)
class Effect:
    """An effect at a place with its numbers [SI]."""

    name: str
    where: str
    values: Mapping[str, float] = field(default_factory=dict)


def _matrix(values: Mapping[str, float]) -> Array:
    M = np.zeros((3, 3))
    for entry, value in values.items():
        M[AXES.index(entry[0]), AXES.index(entry[1])] = value
    return M


def _drive(truth: Motion, seed: int) -> dict[str, Array]:
    """Temperature [K], throttle, current [A] and vibration [m/s^2] at the fine times, about their means.

    A motor works against the force that it makes, and against what is in no log: wind, slopes, a battery that sinks. It
    shakes the board with its throttle, more or less as speeds meet resonances.
    """
    rng = np.random.default_rng([seed, 4])
    t = truth.t
    warm = 15.0 * (1.0 - np.exp(-t / 60.0)) + 2.0 * np.sin(t / 17.0)
    every_s = 4.0
    knots = np.arange(0.0, t[-1] + 2.0 * every_s, every_s)
    wind = np.interp(t, knots, rng.standard_normal(knots.size))
    force = np.linalg.norm(truth.f_b, axis=1) / 9.80665 - 1.0
    throttle = np.clip(0.45 + 0.3 * force + 0.12 * wind, 0.05, 1.0)
    current = 25.0 * throttle**1.5 * (1.0 + 0.002 * t)
    resonance = np.interp(t, knots, np.random.default_rng([seed, 5]).standard_normal(knots.size))
    shake = 5.0 * throttle * np.exp(0.4 * resonance)
    return {
        "temperature": warm,
        "throttle": throttle - throttle.mean(),
        "current": current - current.mean(),
    } | {"vibration": shake - shake.mean()}


def _means(x: Array) -> Array:
    k = int(FINE_HZ / IMU_HZ)
    n = x.shape[0] // k
    return np.asarray(x[: n * k].reshape(n, k, -1).mean(axis=1))


def _inertial(
    truth: Motion, effects: list[Effect], drive: Mapping[str, Array], rng: np.random.Generator
) -> Array:
    """Samples of accelerometers and gyros, shape (n, 6)."""
    omega, f = truth.omega_b, truth.f_b
    w, a = omega.copy(), f.copy()
    for e in (e for e in effects if e.name != SHAKEN):
        if e.where.startswith("gyro"):
            k = AXES.index(e.where[-1])
            if e.name == "scale_factor":
                w[:, k] += e.values["coefficient"] * omega[:, k]
            elif e.name == "misalignment":
                w[:, k] += omega @ _matrix(e.values)[k]
            elif e.name == "g_sensitivity":
                w[:, k] += f @ _matrix(e.values)[k]
            elif e.name == "rate_ramp":
                w[:, k] += e.values["R"] * truth.t
        elif e.where.startswith("accel"):
            k = AXES.index(e.where[-1])
            if e.name == "scale_factor":
                a[:, k] += e.values["coefficient"] * f[:, k]
            elif e.name == "misalignment":
                a[:, k] += f @ _matrix(e.values)[k]
    for k, axis in enumerate(AXES):
        w[:, k] += _added(effects, f"gyro_{axis}", truth.t, drive)
        a[:, k] += _added(effects, f"accel_{axis}", truth.t, drive)
    both = np.hstack([_means(a), _means(w)])
    noise = rng.standard_normal(both.shape) * np.sqrt(IMU_HZ) * np.repeat([ACCEL_N, GYRO_N], 3)
    shake = _means(drive["vibration"])
    for k, sensor in enumerate(("accel", "gyro")):
        noise[:, 3 * k : 3 * k + 3] *= np.exp(_sum(effects, SHAKEN, (sensor,), "slope") * shake)
    return np.asarray(both + noise)


def _late(truth: Motion, times: Array, late_s: float | Array) -> NDArray[np.intp]:
    fine = FINE_HZ
    return np.clip(np.rint((times - late_s) * fine), 0, truth.t.size - 1).astype(np.intp)


def _sum(effects: list[Effect], name: str, places: tuple[str, ...], key: str) -> float:
    return sum(e.values[key] for e in effects if e.name == name and e.where in places)


def _added(effects: list[Effect], channel: str, t: Array, drive: Mapping[str, Array]) -> Array:
    """Steps, and what follows recorded quantities, on a channel at times [s] at which these are given."""
    out = np.zeros(t.size)
    for e in (e for e in effects if e.where == channel):
        if e.name == "bias_step":
            out += e.values["size"] * (t >= e.values["time"])
        elif e.name in DRIVEN:
            out += e.values["coefficient"] * drive[DRIVEN[e.name]]
    return out


def _gnss(truth: Motion, times: Array, effects: list[Effect]) -> tuple[Array, Array]:
    arm = np.array([_sum(effects, "lever_arm", ("gnss",), a) for a in AXES])
    out = []
    for order, sensor in enumerate(("gnss_p", "gnss_v")):
        drift = _sum(effects, "clock_drift", ("gnss",), "rate") * (times - times[0])
        at = _late(truth, times, _sum(effects, "time_delay", ("gnss", sensor), "delay") + drift)
        R = truth.R_nb[at]
        if order == 0:
            out.append(truth.p[at] + R.apply(arm))
        else:
            out.append(truth.v[at] + R.apply(np.cross(truth.omega_b[at], arm)))
    return out[0], out[1]


def _mag(truth: Motion, times: Array, effects: list[Effect]) -> Array:
    at = _late(truth, times, _sum(effects, "time_delay", ("mag",), "delay"))
    east = _sum(effects, "declination", ("mag",), "angle")
    turn = np.array([[np.cos(east), -np.sin(east), 0.0], [np.sin(east), np.cos(east), 0.0], [0.0, 0.0, 1.0]])
    m = truth.R_nb[at].inv().apply(turn @ FIELD_NED_T)
    board = [_sum(effects, "mounting", ("mag",), a) for a in AXES]
    m = Rotation.from_rotvec(board).inv().apply(m)
    out = m.copy()
    for e in effects:
        if e.where == "mag" and e.name == "hard_iron":
            out += [e.values.get(a, 0.0) for a in AXES]
        elif e.where == "mag" and e.name == "soft_iron":
            out += m @ _matrix(e.values).T
    return np.asarray(out)


def random_course(e: Effect, n: int, seed: int) -> Array:
    """A random walk from zero or a stationary first-order Gauss-Markov process at the rate of the inertial sensors, shape (n,)."""
    rng = np.random.default_rng([seed, 3])
    w, dt = rng.standard_normal(n), 1.0 / IMU_HZ
    if e.name == "rate_random_walk":
        return np.asarray(e.values["K"] * np.sqrt(dt) * np.cumsum(w))
    phi = np.exp(-dt / e.values["tau"])
    out = np.empty(n)
    x = w[0]
    for k in range(n):
        x = phi * x + np.sqrt(1.0 - phi**2) * w[k]
        out[k] = x
    return np.asarray(e.values["sigma"] * out)


def fly(
    vehicle: str,
    duration_s: float,
    effects: list[Effect],
    seed: int,
    *,
    unlisted: str = "",
    bias: float = 1.0,
) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """A log: times, channels [SI] with NaN where a sensor has no sample, and the truth.

    Parameters
    ----------
    vehicle : str
    duration_s : float
    effects : list of Effect
    seed : int
    unlisted : str
        Something that no catalogue has: ``"magnet"``, ``"sine_baro"``, ``"smoothed_gnss"``.
    bias : float
        Size of the constant biases of the inertial sensors.
    """
    rng = np.random.default_rng(seed)
    truth = motion(vehicle, duration_s, FINE_HZ, np.random.default_rng([seed, 1]))
    n = int(duration_s * IMU_HZ)
    drive = _drive(truth, seed)
    imu = _inertial(truth, effects, drive, rng)[:n]
    imu += bias * np.concatenate([0.05 * rng.standard_normal(3), 0.003 * rng.standard_normal(3)])
    t = np.arange(n) / IMU_HZ
    channels = {f"accel_{a}": imu[:, k] for k, a in enumerate(AXES)}
    channels |= {f"gyro_{a}": imu[:, 3 + k] for k, a in enumerate(AXES)}
    rows = {s: np.arange(0, n, int(IMU_HZ / r)) for s, r in RATES_HZ.items()}
    p, v = _gnss(truth, t[rows["gnss"]], effects)
    if unlisted == "smoothed_gnss":
        lag = 0.3
        v = v.copy()
        for k in range(1, len(v)):
            v[k] = v[k - 1] + (v[k] - v[k - 1]) * (1.0 - np.exp(-1.0 / (RATES_HZ["gnss"] * lag)))
    m = _mag(truth, t[rows["mag"]], effects)
    if unlisted == "magnet":
        there = np.abs(t[rows["mag"]] - 0.5 * duration_s) < 4.0
        m = m + 6e-6 * there[:, None] * np.array([1.0, -0.6, 0.3]) * np.sin(t[rows["mag"]])[:, None]
    late = _sum(effects, "time_delay", ("baro",), "delay")
    height = -truth.p[_late(truth, t[rows["baro"]], late), 2]
    height = height * (1.0 + _sum(effects, "scale_factor", ("baro",), "coefficient"))
    speed2 = np.sum(truth.v[_late(truth, t[rows["baro"]], late)] ** 2, axis=1)
    height = height + _sum(effects, "static_pressure_error", ("baro",), "coefficient") * speed2
    if unlisted == "sine_baro":
        height = height + 1.5 * np.sin(2.0 * np.pi * t[rows["baro"]] / 7.0)
    height = height + 3.0 * rng.standard_normal()
    parts = {
        "gnss_p": (rows["gnss"], p, "NED"),
        "gnss_v": (rows["gnss"], v, "NED"),
        "mag": (rows["mag"], m, AXES),
    }
    fine = slice(None, None, int(FINE_HZ / IMU_HZ))
    shown = {name: course[fine][:n] for name, course in drive.items()}
    for sensor, (at, values, axes) in parts.items():
        noisy = values + SD[sensor] * rng.standard_normal(values.shape)
        there = {name: course[at] for name, course in shown.items()}
        for k, a in enumerate(axes):
            name = f"{sensor}_{a}"
            channels[name] = np.full(n, np.nan)
            channels[name][at] = noisy[:, k] + _added(effects, name, t[at], there)
    at = rows["baro"]
    height = height + _added(effects, "baro", t[at], {name: course[at] for name, course in shown.items()})
    channels["baro"] = np.full(n, np.nan)
    channels["baro"][rows["baro"]] = height + SD["baro"] * rng.standard_normal(height.size)
    for e in effects:
        if e.name in RANDOM:
            channels[e.where] = channels[e.where] + random_course(e, n, seed)
    for name, sd in (("temperature", 0.02), ("current", 0.1), ("throttle", 0.0), ("vibration", 0.0)):
        at = rows.get(name, np.arange(n))
        channels[name] = np.full(n, np.nan)
        channels[name][at] = (LEVEL[name] + shown[name] + sd * rng.standard_normal(n))[at]
    known = {
        "p": truth.p[fine][:n],
        "v": truth.v[fine][:n],
        "q": truth.R_nb[fine].as_quat(scalar_first=True)[:n],
    }
    return t, channels, known
