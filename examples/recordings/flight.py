"""Velocities of GPS against the accelerometers of a fixed wing: how late and how smooth they are.

Recording: P. Riseborough, InertialNav (BSD-3), who gives 230 ms; the autopilot's attitude is no independent
reference, so angles between the two are found as well.
"""

from pathlib import Path

import numpy as np
from common import AXES, Array, Case, main, of_scene
from scipy.spatial.transform import Rotation, Slerp

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.log.log import Channel, Log

GRAVITY_N = np.array([0.0, 0.0, 9.80665])
BAND = 0.3
NOISE = ChannelNoise(
    "m/s^2",
    (
        Term(make("white_noise", N=0.05)),
        Term(make("quantisation", Q=0.2)),  # of a velocity, seen in its differences
        Term(make("gauss_markov", sigma=0.5, tau=2.0)),  # gravity through errors of the attitude
    ),
)


def steps(a: dict[str, Array]) -> tuple[Array, Array, float]:
    """Changes of velocity from fix to fix by GPS and by the accelerometers [m/s^2], and the period [s]."""
    turn = Slerp(a["t_att"], Rotation.from_euler("ZYX", a["rpy"][:, ::-1], degrees=True))
    inside = (a["t_imu"] >= a["t_att"][0]) & (a["t_imu"] <= a["t_att"][-1])
    t, f_b = a["t_imu"][inside], a["acc"][inside]
    f_n = turn(t).apply(f_b) + GRAVITY_N
    gained = np.vstack([np.zeros(3), np.cumsum(0.5 * (f_n[1:] + f_n[:-1]) * np.diff(t)[:, None], axis=0)])
    fixes = np.linspace(a["t_gps"][0], a["t_gps"][-1], a["t_gps"].size)  # they were logged with jitter
    good = (fixes > t[0] + 1.0) & (fixes < t[-1] - 1.0)
    v = np.column_stack([np.cos(a["course"]) * a["gndspd"], np.sin(a["course"]) * a["gndspd"], a["vel_d"]])
    dt = float(np.mean(np.diff(fixes)))
    felt = np.array([np.interp(fixes[good], t, x) for x in gained.T]).T
    return np.diff(v[good], axis=0) / dt, np.diff(felt, axis=0) / dt, dt


def flight(file: Path) -> Case:
    """Delay and bandwidth together are what a cross-correlation calls the delay."""
    with np.load(file) as archive:
        a = {k: np.asarray(archive[k], float) for k in archive.files if k != "meta"}
    gps, felt, dt = steps(a)
    channels = {f"gps_{x}": Channel.of(gps[:, k], "m/s^2") for k, x in enumerate(AXES)}
    channels |= {f"ref_gps_{x}": Channel.of(felt[:, k], "m/s^2") for k, x in enumerate(AXES)}
    log = Log(np.arange(gps.shape[0]) * dt, channels, source=file.name)
    gap, said, answer = of_scene(log, motion_scene(log, NoiseModel({f"gps_{x}": NOISE for x in AXES})))
    lag = {f.effect.name: f.effect.row("") for f in gap.findings if f.where == "gps"}
    late = lag["time_delay"]["delay"][0] if "time_delay" in lag else 0.0
    if "bandwidth" in lag:
        late += np.arctan(BAND / lag["bandwidth"]["corner"][0]) / (2.0 * np.pi * BAND)
    return [*said, f"in all {late:.2f} s late at {BAND:g} Hz"], answer


if __name__ == "__main__":
    main(str(__doc__), {"flight": ("dynamic/inertialnav_swisslog1.npz", flight)})
