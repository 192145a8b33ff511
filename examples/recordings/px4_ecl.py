"""The emitted `ins23` in C beside PX4-ECL, over PX4-ECL's own replay of a multicopter that climbs and lands.

The filter aligns itself from the first second at rest (`align`); then samples come in the order of their times, fixes
with the age that PX4-ECL assumes, and are fused at their own times by the delayed horizon. What is printed: the largest
difference between the present state and PX4-ECL's, in standard deviations of `ins23`, from ten seconds on, when both have
settled. As it hits the ground the velocity down changes within three samples of the accelerometer. By how much is printed
too: their sum, GNSS, and what the two filters have. PX4-ECL has a quarter more than the samples say, and stays off.
Recording: PX4/PX4-ECL, BSD-3, `flights/ecl_iris_gps_replay.csv`.
"""

import os
import tempfile
from pathlib import Path

import numpy as np
from ecl_replay import Array, Replay, replay
from scipy.spatial.transform import Rotation

from kfgen.core.units import STANDARD_GRAVITY
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.emit.horizon.memory import MARGIN
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
RATES = {"gnss_position": 4.9, "gnss_velocity": 4.9, "mag": 200.0}
"""Of the others [Hz]."""
GPS_DELAY_S = 0.11
"""Age of a fix, as PX4-ECL has it by default."""
EKF_STEP_S = 0.008
NOISE = {
    "gyro": ("rad/s", 1.5e-2 * EKF_STEP_S**0.5),
    "accel": ("m/s^2", 0.35 * EKF_STEP_S**0.5),
    "gnss_p": ("m", 0.5 / RATES["gnss_position"] ** 0.5),
    "gnss_v": ("m/s", 0.3 / RATES["gnss_velocity"] ** 0.5),
    "mag": ("T", 5e-6 / RATES["mag"] ** 0.5),
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


SETTLED_S, TOUCH_DOWN_S, AT_REST_S, END_S = 10.0, 32.4, 32.7, 34.3
"""From which on, when it hits the ground, when it lies there, and until which both have samples."""


def flown(given: Replay) -> tuple[Array, Array, Array]:
    """Times [s], position, velocity and quaternion now, and standard deviations of the filter, after each fix."""
    discrete = DiscreteModel(model(), rate=RATE, rates=RATES)
    program = Program(discrete, "ud", horizon=MARGIN * GPS_DELAY_S)
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
    nx, size = len(program.discrete.nominal_names), program.covariance.size
    now = nx + size + len(program.supervisor.places)
    for t, kind, values in events:
        if kind == 2:
            field = values
        if kind == 0:
            dt, before = t - before, t
            if aligned:
                core.call("delayed_predict", [*values, dt])
            else:
                core.call("align", [*values, *field, dt])
                aligned = STATUS[core.status()] == "OK"
        elif aligned and kind == 1:
            for name, z in (("gnss_position", values[:3]), ("gnss_velocity", values[3:])):
                core.call(f"delayed_update_{name}", [*z.tolist(), before - t])
            words = core.words().view(program.type)
            rows.append([t, *words[now : now + 10], *words[nx : nx + size]])
        elif aligned:
            core.call("delayed_update_mag", [*values.tolist(), before - t])
    found = np.array(rows)
    return found[:, 0], found[:, 1:11], np.sqrt(program.covariance.variances(found[:, 11:]))


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


def landing(given: Replay) -> dict[str, float]:
    """Change of the velocity down [m/s] as it hits the ground: of the samples' sum, GNSS and both filters."""
    t, x, _ = flown(given)
    at, down = given.imu[:, 0], given.imu[:, 3] + STANDARD_GRAVITY
    hit = (at > TOUCH_DOWN_S) & (at < AT_REST_S)
    rows = {
        "gnss": given.gps[:, [0, 6]],
        "ins23": np.column_stack([t, x[:, 5]]),
        "px4-ecl": given.answer[:, [0, 7]],
    }
    rows["gnss"] = rows["gnss"] - [GPS_DELAY_S, 0.0]
    found = {"samples": float(down[hit] @ np.diff(at, prepend=0.0)[hit])}
    for name, row in rows.items():
        before = (row[:, 0] > TOUCH_DOWN_S - 1.0) & (row[:, 0] < TOUCH_DOWN_S)
        after = (row[:, 0] > AT_REST_S) & (row[:, 0] < AT_REST_S + 1.0)
        found[name] = float(row[after, 1].mean() - row[before, 1].mean())
    return found


if __name__ == "__main__":
    if not (DATA / "ecl_iris_gps_replay.csv").is_file():
        print("skipped: ecl_iris_gps_replay.csv is not here (set KFGEN_DATA)")
    else:
        given = replay(DATA)
        for words, until in (("until it lands", TOUCH_DOWN_S), ("with the landing", END_S)):
            found = ", ".join(f"{name} {share:.2g}" for name, share in differences(given, until).items())
            print(f"{words}, in standard deviations of ins23: {found}")
        jumps = ", ".join(f"{name} {jump:.2f}" for name, jump in landing(given).items())
        print(f"velocity down as it hits the ground, change in m/s: {jumps}")
