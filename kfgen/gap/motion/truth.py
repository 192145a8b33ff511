"""What the sensors should have read, from the references in a log.

A rate table (``ref_gyro_*``), a reference accelerometer or magnetometer say it at once. An attitude
(``ref_q_*``, body to navigation) says it by its rate, by gravity where the body is not accelerated, and by a
field that is constant in space. The rate is the logarithm of the turn from sample to sample [1]_, used up
to the frequency at which the noise of the attitude, whose derivative grows with frequency, drowns it.

References
----------
.. [1] J. Solà, Quaternion kinematics for the error-state Kalman filter, 2017, eq. (105).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES, sensor_and_axis
from kfgen.core.errors import InputError
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.vibration import vibration_power
from kfgen.effects.series import noise_of_differences
from kfgen.gap.motion.references.reference import long_holes
from kfgen.gap.motion.wiener import noiseless
from kfgen.log.log import Log

Array = NDArray[np.float64]

MIN_RATE_POWER_RATIO = 4.0
"""How far the power of a rate must stand above the attitude's noise to be taken."""
DIFFERENCE_ORDERS = (2, 4, 6, 8)
"""Differences of a turn that are looked at: noise survives them all, and fast motion the first alone."""
END_MARGIN_PERIODS = 4.0
"""Periods of the highest frequency of an attitude's rate that are left out at both ends."""
HOLE_MARGIN_PERIODS = 1.0
"""And beside its holes, where what bridges them is nearer to the truth than nothing."""
MIN_SPECTRUM_SAMPLES = 256
"""Samples below which a stretch is too short for a spectrum."""


@dataclass(frozen=True)
class Floor:
    """The noise of a rate that comes from an attitude: density of its samples ``level (f / at)^slope`` [rad^2/s^2].

    White noise of the attitude has a slope of two.
    """

    level: float = 0.0
    at: float = 1.0
    slope: float = 2.0

    def density(self, f: Array) -> Array:
        """At frequencies [Hz], shape (m,)."""
        return np.asarray(self.level * (f / self.at) ** self.slope)


@dataclass(frozen=True)
class Truth:
    """What a log's references say of its sensors.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    read : mapping of str to ndarray, shape (n, 3)
        What each triad should have read [U]; an axis without a reference is zero. A magnetometer under an
        attitude alone is not in it: its field in space is unknown.
    axes : mapping of str to tuple of int
        The axes of each sensor that have a reference.
    good : ndarray of bool, shape (n,)
        Where the references are there.
    omega_b, f_b, power, warmth, R_bn, down, speed_squared
        As in `Signals`: what drives effects.
    bandwidth : mapping of str to float
        Highest frequency [Hz] up to which a sensor's truth is known; infinite where not in it.
    angle : float
        Standard deviation [rad] of the white noise of the attitude's samples about each axis.
    floor : Floor
        The noise of the rate that was taken from it.
    words : tuple of str
        What was decided.
    places : mapping of str to (str, int)
        Sensor and axis of channels whose names do not say them.
    antennas : mapping of str to (int, ndarray of shape (n, 3, 3))
        Sensors of a place: 0 of a position, 1 of a velocity; its navigation to body axes.
    """

    t: Array
    read: Mapping[str, Array]
    axes: Mapping[str, tuple[int, ...]]
    good: NDArray[np.bool_]
    omega_b: Array | None = None
    f_b: Array | None = None
    power: Array | None = None
    warmth: Array | None = None
    R_bn: Array | None = None
    down: float = 1.0
    bandwidth: Mapping[str, float] = field(default_factory=dict)
    angle: float = 0.0
    floor: Floor = Floor()
    words: tuple[str, ...] = ()
    places: Mapping[str, tuple[str, int]] = field(default_factory=dict)
    antennas: Mapping[str, tuple[int, Array]] = field(default_factory=dict)
    speed_squared: Array | None = None

    def place(self, name: str) -> tuple[str, int]:
        """The sensor and the axis of a channel."""
        return self.places[name] if name in self.places else sensor_and_axis(name)

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float((self.t[-1] - self.t[0]) / (self.t.size - 1))

    def signals(self, sensor: str, m_n: Array | None = None) -> Signals:
        """What a triad should have felt; a magnetometer under an attitude needs its field in space."""
        if sensor in self.read:
            return self._known[sensor]
        assert self.R_bn is not None
        return self._felt_by(sensor, (self.R_bn.reshape(-1, 3) @ np.asarray(m_n)).reshape(-1, 3))

    @cached_property
    def _known(self) -> dict[str, Signals]:
        """Signals that no fit changes, with what is computed from them."""
        return {sensor: self._felt_by(sensor, y) for sensor, y in self.read.items()}

    def _felt_by(self, sensor: str, y: Array) -> Signals:
        order, R_bn = self.antennas.get(sensor, (2, self.R_bn))
        return Signals(
            self.t, y, self.omega_b, self.f_b, R_bn, self.down, self.power, self.warmth, order, self.speed_squared
        )  # fmt: skip


def truth_of(log: Log, bandwidth: Mapping[str, float] | None = None) -> Truth | None:
    """The truth of a log with references; none without.

    Parameters
    ----------
    bandwidth : mapping of str to float, optional
        Highest frequency [Hz] up to which a reference is known, by sensor, where that is not all.

    Raises
    ------
    InputError
        Time is uneven, or a reference has no number in it.
    """
    found: dict[str, tuple[int, ...]] = {}
    for name in log.channels:
        if name.startswith("ref_") and not name.startswith("ref_q_"):
            sensor, axis = sensor_and_axis(name.removeprefix("ref_"))
            found[sensor] = (*found.get(sensor, ()), axis)
    attitude = all(f"ref_q_{c}" in log.channels for c in "wxyz")
    if not found and not attitude:
        return None
    log.uniform_dt()
    read, good = {}, np.ones(log.n, dtype=bool)
    for sensor, axes in found.items():
        u = _triad(log, f"ref_{sensor}", axes)
        good &= np.isfinite(u).all(axis=1)
        read[sensor] = _bridged(log.t, u)
    truth = Truth(np.asarray(log.t), read, dict(found), good, bandwidth=dict(bandwidth or {}))
    if attitude:
        truth = _with_attitude(truth, log)
    return _with_drivers(truth, log)


def held(log: Log) -> tuple[int, int]:
    """First and last+1 sample of the stretch of a log on which its references are there."""
    names = [n for n in log.channels if n.startswith("ref_")]
    there = np.isfinite(np.array([log.channels[n].values for n in names])).all(axis=0)
    at = np.flatnonzero(there)
    if at.size < 16:
        empty = ", ".join(n for n in names if np.isfinite(log.channels[n].values).sum() < 16) or "all at once"
        raise InputError(
            f"its references have no numbers: {empty}", where=log.source, remedy="Leave them out"
        )
    return int(at[0]), int(at[-1]) + 1


def _axes(log: Log, sensor: str) -> tuple[int, ...]:
    return tuple(i for i, a in enumerate(AXES) if f"{sensor}_{a}" in log.channels)


def _triad(log: Log, sensor: str, axes: tuple[int, ...]) -> Array:
    """A triad, shape (n, 3), zero where an axis is not recorded."""
    out = np.zeros((log.n, 3))
    for i in axes:
        name = f"{sensor}_{AXES[i]}"
        out[:, i] = log.channels[name if name in log.channels else sensor].values
    return out


def _bridged(t: Array, u: Array) -> Array:
    """Holes filled by straight lines, so that a spline or a filter can pass; they are left out later."""
    out = u.copy()
    for column in out.T:
        there = np.isfinite(column)
        if not there.any():
            raise InputError("a reference has no number in it", remedy="Leave it out")
        column[~there] = np.interp(t[~there], t[there], column[there])
    return out


def _with_attitude(truth: Truth, log: Log) -> Truth:
    """The truth that an attitude adds."""
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation, RotationSpline, Slerp

    q = np.array([log.channels[f"ref_q_{c}"].values for c in "wxyz"]).T
    there = np.isfinite(q).all(axis=1) & (np.linalg.norm(q, axis=1) > 0.5)
    if there.sum() < 16:
        raise InputError("the reference attitude has no numbers", where=log.source)
    bridge = Slerp if there.all() else RotationSpline  # no jump of the rate at a hole, which would ring
    seen = bridge(truth.t[there], Rotation.from_quat(q[there], scalar_first=True))
    first, last = truth.t[there][0], truth.t[there][-1]
    nb = seen(np.clip(truth.t, first, last))
    step = int(np.median(np.diff(np.flatnonzero(there))))
    own = truth.t[::step]  # the reference may be slower than the log
    gyro = _axes(log, "gyro")
    felt = _bridged(truth.t, _triad(log, "gyro", gyro))[::step] if len(gyro) == 3 else None
    omega_b, corner, angle, floor = body_rate(
        seen(np.clip(own, first, last)).as_quat(scalar_first=True), step * truth.dt, felt, there[::step]
    )
    floor = replace(floor, level=floor.level * step)
    if step > 1:
        omega_b = np.asarray(CubicSpline(own, omega_b, axis=0)(truth.t))
    R_bn = np.asarray(nb.inv().as_matrix())
    down, word = _down(log, R_bn)
    read, axes, bandwidth = dict(truth.read), dict(truth.axes), dict(truth.bandwidth)
    period = 1.0 / (corner * truth.dt)
    good = truth.good & ~long_holes(
        ~there, max(step - 1, int(0.05 * period)), int(np.ceil(HOLE_MARGIN_PERIODS * period))
    )
    if "gyro" not in read:
        read["gyro"], axes["gyro"], bandwidth["gyro"] = omega_b, (0, 1, 2), corner
        ends = END_MARGIN_PERIODS / corner  # nobody knows what was before or comes after
        good &= (truth.t >= truth.t[0] + ends) & (truth.t <= truth.t[-1] - ends)
    if "accel" not in read:
        read["accel"], axes["accel"] = -R_bn[:, :, 2] * (down * STANDARD_GRAVITY), (0, 1, 2)
    if "mag" not in read:
        axes["mag"] = (0, 1, 2)
    words = (word, f"the rate of the attitude is known up to {corner:.3g} Hz")
    return replace(
        truth, read=read, axes=axes, bandwidth=bandwidth, good=good, omega_b=omega_b, R_bn=R_bn, down=down,
        angle=angle, floor=floor, words=words,
    )  # fmt: skip


def body_rate(
    q_nb: Array, dt: float, read: Array | None = None, there: NDArray[np.bool_] | None = None
) -> tuple[Array, float, float, Floor]:
    """The body rate of an attitude without holes.

    Central turns over two samples, in the cosine transform divided by their response ``sin(w)/w`` up to the
    highest frequency at which the rate stands above the noise of the attitude; beyond half as much again
    there is nothing.

    Parameters
    ----------
    q_nb : ndarray, shape (n, 4)
        Scalar first, body to navigation.
    dt : float
        Sampling period [s].
    read : ndarray, shape (n, 3), optional
        The rate that a gyro read: where it has much less power, the attitude has nothing but noise.
    there : ndarray of bool, shape (n,), optional
        Where the attitude was not bridged: spectra are taken from the stretch without holes that moves most.

    Returns
    -------
    omega_b : ndarray, shape (n, 3)
        [rad/s].
    corner : float
        That frequency [Hz].
    angle : float
        Standard deviation [rad] of the attitude's noise, taken to be white.
    floor : Floor
        The noise of the rate.
    """
    from scipy.fft import dct, idct
    from scipy.spatial.transform import Rotation

    nb = Rotation.from_quat(q_nb, scalar_first=True)
    turn = (nb[:-1].inv() * nb[1:]).as_rotvec()
    angle = min(noise_of_differences(np.diff(turn, n=n, axis=0), n + 1) for n in DIFFERENCE_ORDERS)
    rate = np.empty((turn.shape[0] + 1, 3))
    rate[1:-1] = 0.5 * (turn[1:] + turn[:-1]) / dt
    # Magnus' second term: a turn about an axis that moves holds dt^3 (w x dw/dt) / 12 beside the integral.
    rate[1:-1] -= np.cross(rate[1:-1], np.diff(turn, axis=0)) / 12.0
    rate[0], rate[-1] = (1.5 * turn[0] - 0.5 * turn[1]) / dt, (1.5 * turn[-1] - 0.5 * turn[-2]) / dt
    clean = slice(None) if there is None else _liveliest(there, (rate**2).sum(axis=1))
    corner, floor = _spectrum(rate[clean], None if read is None else read[clean], angle, dt)
    w = np.arange(rate.shape[0]) * (np.pi / rate.shape[0])
    share = np.clip((w / (2.0 * np.pi * corner * dt) - 1.0) / 0.5, 0.0, 1.0)
    kept = 0.5 * (1.0 + np.cos(np.pi * share)) / np.maximum(np.sinc(w / np.pi), 0.1)
    X = dct(rate, type=2, axis=0, norm="ortho") * kept[:, None]
    return np.asarray(idct(X, type=2, axis=0, norm="ortho")), corner, angle, floor


def _spectrum(rate: Array, read: Array | None, angle: float, dt: float) -> tuple[float, Floor]:
    """The highest frequency [Hz] that counts, and the floor, of central turns without holes."""
    from scipy.fft import dct

    n = rate.shape[0]
    w, unit = np.arange(n) * (np.pi / n), 0.5 / (n * dt)
    edges = np.unique(np.geomspace(1, n // 2, 60).astype(int))
    taper = np.sqrt(8.0 / 3.0) * np.hanning(n)[:, None]  # of unit power; the ends do not leak
    X = dct(rate * taper, type=2, axis=0, norm="ortho") / np.maximum(np.sinc(w / np.pi), 0.1)[:, None]
    power = _by_band((X**2).mean(axis=1), edges)
    top = _highest(edges, power, _by_band((w * angle / dt) ** 2, edges))
    floor = Floor((np.pi * angle / dt) ** 2, 0.5 / dt)
    if read is not None:
        felt = _by_band((dct(read * taper, type=2, axis=0, norm="ortho") ** 2).mean(axis=1), edges)
        top, floor = _against_gyro(edges, power, felt, unit) or (top, floor)
    return top * unit, floor


def _by_band(x: Array, edges: NDArray[np.intp]) -> Array:
    """Means between edges."""
    return np.asarray(np.add.reduceat(x, edges)[:-1] / np.diff(edges))


def _highest(edges: NDArray[np.intp], power: Array, noise: Array) -> int:
    """The last ordinate, in the lower third, of a band that stands above the noise."""
    low = edges[1:] <= (2 * int(edges[-1])) // 3
    above = np.flatnonzero(low & (power > MIN_RATE_POWER_RATIO * noise))
    return int(edges[above[-1] + 1]) if above.size else int(edges[1:][low][-1])


def _against_gyro(
    edges: NDArray[np.intp], power: Array, felt: Array, unit: float
) -> tuple[int, Floor] | None:
    """The last ordinate that counts, and the floor, where a gyro shows that only noise is left.

    From the first band on at which all higher ones have at least twice the gyro's power, the law of the floor
    is fitted over a factor of two and a half in frequency.

    Parameters
    ----------
    unit : float
        Frequency of the first ordinate [Hz].
    """
    wide = np.diff(edges) >= 8
    quiet = np.flatnonzero(wide & (power < 2.0 * felt))
    first = int(quiet[-1]) + 1 if quiet.size else 0
    if first == 0 or first + 3 >= power.size:
        return None
    f = np.sqrt(edges[:-1] * edges[1:]) * unit
    band = slice(first, max(first + 3, int(np.searchsorted(f, 2.5 * f[first]))))
    left = np.log(power[band])
    slope = float(np.clip(np.polyfit(np.log(f[band]), left, 1)[0], 0.0, 2.0))
    level = float(np.exp(np.mean(left - slope * np.log(f[band] / f[first]))))
    return int(edges[first]), Floor(level, float(f[first]), slope)


def _down(log: Log, R_bn: Array) -> tuple[float, str]:
    """The sign of the third navigation axis that fits the accelerometer, and a sentence of it."""
    axes = _axes(log, "accel")
    if len(axes) < 3:
        return 1.0, "the navigation frame is taken to be north-east-down"
    up = np.nanmean(np.einsum("ni,ni->n", R_bn[:, :, 2], _triad(log, "accel", axes)))
    if up > 0.0:
        return -1.0, "the accelerometer says that the third navigation axis points up"
    return 1.0, "the accelerometer says that the third navigation axis points down"


def _with_drivers(truth: Truth, log: Log) -> Truth:
    """Force, its running variance and the rate, from references or else from the sensors themselves."""
    f_b = truth.read.get("accel") if "ref_accel_x" in log.channels else None
    felt = _axes(log, "accel")
    accel = _bridged(truth.t, _triad(log, "accel", felt)) if len(felt) == 3 else None
    if f_b is None:
        f_b = noiseless(accel) if accel is not None else truth.read.get("accel")
    omega_b = truth.read.get("gyro") if len(truth.axes.get("gyro", ())) == 3 else truth.omega_b
    turned = _axes(log, "gyro")
    if omega_b is None and len(turned) == 3:
        omega_b = noiseless(_bridged(truth.t, _triad(log, "gyro", turned)))
    shaken = accel if accel is not None else f_b
    power = None if shaken is None else vibration_power(shaken, truth.dt)
    return replace(truth, f_b=f_b, omega_b=omega_b, power=power)


def _liveliest(there: NDArray[np.bool_], power: Array) -> slice:
    """The stretch without a hole that holds most of the power, if it is long enough for a spectrum; else all."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    energy = np.concatenate([[0.0], np.cumsum(power)])
    k = int(np.argmax(energy[edges[1::2]] - energy[edges[::2]]))
    start, stop = int(edges[2 * k]), int(edges[2 * k + 1])
    return slice(start, stop) if stop - start >= MIN_SPECTRUM_SAMPLES else slice(None)
