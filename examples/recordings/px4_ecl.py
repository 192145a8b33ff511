"""The emitted `ins23` in C beside PX4-ECL, over PX4-ECL's own replay of a multicopter that climbs and lands.

The filter aligns itself from the first second at rest (`align`), then gets the samples in the order of their times. What
is printed: the largest difference to PX4-ECL's states, in standard deviations of `ins23`, from ten seconds on, when both
have settled. As it hits the ground the velocity jumps by 0.9 m/s within a few samples of the IMU, of which the two filters
keep different shares; GNSS then is between them.
Recording: PX4/PX4-ECL, BSD-3, `flights/ecl_iris_gps_replay.csv`.
"""

import os
import tempfile
from pathlib import Path

import numpy as np
from ecl_replay import Array, Replay, replay
from scipy.spatial.transform import Rotation

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.emit.ir.ir import STATUS
from kfgen.emit.routines import Program
from kfgen.emit.targets.c import header
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.verify.host import Host

DATA = (
    Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data") / "flights"
)
RATE = 1.0 / 0.00487
"""Mean rate of the inertial samples [Hz]."""
GPS_DELAY_S = 0.11
"""Age of a fix, as PX4-ECL has it by default."""
EKF_STEP_S = 0.008
NOISE = {
    "gyro": ("rad/s", 1.5e-2 * EKF_STEP_S**0.5),
    "accel": ("m/s^2", 0.35 * EKF_STEP_S**0.5),
    "gnss_p": ("m", 0.5 / RATE**0.5),
    "gnss_v": ("m/s", 0.3 / RATE**0.5),
    "mag": ("T", 5e-6 / RATE**0.5),
}
"""Densities per sqrt(Hz) of PX4-ECL's defaults: EKF2_GYR_NOISE and EKF2_ACC_NOISE are of a step of its filter, the others of
a sample."""


def model() -> FilterModel:
    """`ins23` with PX4-ECL's noise."""
    channels = {
        f"{name}_{a}": ChannelNoise(unit, (Term(make("white_noise", N=N)),))
        for name, (unit, N) in NOISE.items()
        for a in ("NED" if "gnss" in name else "xyz")
    }
    return build("ins23", NoiseModel(channels), {"delay": f"{GPS_DELAY_S} s"})


SETTLED_S, TOUCH_DOWN_S, END_S = 10.0, 32.4, 34.3
"""From which on, when it hits the ground, and until which both have samples."""


def flown(given: Replay) -> tuple[Array, Array, Array]:
    """Times [s], stored states and standard deviations of the emitted filter after each fix."""
    program = Program(DiscreteModel(model(), rate=RATE), "ud")
    gps = [(row[0], 1, row[1:]) for row in given.gps]
    mag = [(row[0], 2, row[1:]) for row in given.mag]
    imu = [(row[0], 0, row[1:]) for row in given.imu]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "ins23.h").write_text(header(program), encoding="utf-8")
        core = Host(program, folder, folder)
        core.call("init", ())
        return _run(program, core, sorted([*imu, *gps, *mag], key=lambda e: e[:2]))


def _run(program: Program, core: Host, events: list[tuple[float, int, Array]]) -> tuple[Array, Array, Array]:
    aligned, before, rows = False, 0.0, []
    field = next(values for _, kind, values in events if kind == 2)
    takes = {r.name: [a.name for a in r.required[1:]] for r in program.routines}
    imu = np.zeros(6)
    nx, size = len(program.discrete.nominal_names), program.covariance.size
    for t, kind, values in events:
        if kind == 2:
            field = values
        if kind == 0:
            dt, before, imu = t - before, t, values
            if aligned:
                core.call("predict", [*values, dt])
            else:
                core.call("align", [*values, *field, dt])
                aligned = STATUS[core.status()] == "OK"
        elif aligned and kind == 1:
            given = {"accel": imu[:3], "gyro": imu[3:]}
            for name, z in (("update_gnss_position", values[:3]), ("update_gnss_velocity", values[3:])):
                core.call(name, np.hstack([z, *(given[a] for a in takes[name])]).tolist())
            rows.append([t, *core.words().view(program.type)[: nx + size]])
        elif aligned:
            core.call("update_mag", values.tolist())
    found = np.array(rows)
    sd = np.sqrt(program.covariance.variances(found[:, 1 + nx :]))
    return found[:, 0], found[:, 1 : 1 + nx], sd


def differences(given: Replay, until: float = END_S) -> dict[str, float]:
    """Largest difference in standard deviations of `ins23`: of position, velocity and attitude.

    Parameters
    ----------
    given : Replay
    until : float
        Up to this time [s].

    PX4-ECL's states are there every tenth of a second: what lies between two of them is no difference.
    """
    t, x, sd = flown(given)
    keep = (t > SETTLED_S) & (t < until)
    after = np.searchsorted(given.answer[:, 0], t[keep])
    rows = np.stack([given.answer[after - 1], given.answer[after]])
    low, high = rows[:, :, 5:11].min(axis=0), rows[:, :, 5:11].max(axis=0)
    found = np.hstack([x[keep, 3:6], x[keep, :3]])
    off = np.maximum(np.maximum(low - found, found - high), 0.0) / np.hstack([sd[keep, 3:6], sd[keep, :3]])
    estimate = Rotation.from_quat(x[keep, 6:10], scalar_first=True)
    turns = [(Rotation.from_quat(r[:, 1:5], scalar_first=True) * estimate.inv()).as_rotvec() for r in rows]
    turned = np.abs(turns).min(axis=0) / sd[keep, 6:9]
    return {
        "position": float(off[:, 3:].max()),
        "velocity": float(off[:, :3].max()),
        "attitude": float(turned.max()),
    }


if __name__ == "__main__":
    if not (DATA / "ecl_iris_gps_replay.csv").is_file():
        print("skipped: ecl_iris_gps_replay.csv is not here (set KFGEN_DATA)")
    else:
        given = replay(DATA)
        for words, until in (("until it lands", TOUCH_DOWN_S), ("with the landing", END_S)):
            found = ", ".join(f"{name} {share:.2g}" for name, share in differences(given, until).items())
            print(f"{words}, in standard deviations of ins23: {found}")
