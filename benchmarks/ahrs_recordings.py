"""Attitude from nine axes against an optical reference: kfgen's ahrs6 beside the packages ahrs and imufusion.

Recordings: BROAD (Laidig et al., Data 6(7):72, 2021, CC BY 4.0). Every filter runs all of them with one setting.
kfgen: scale factors and misalignments of calibrated gyros (0.2 %) as states, gyro samples that stand for the interval before them,
and noise of the class of the situation: a body moved by hand accelerates by 0.2 m/s^2/sqrt(Hz), a room bends the field
by 2 uT/sqrt(Hz); samples of a field that is off by a tenth of its size are not used. ahrs: Madgwick with its defaults. imufusion: its defaults with the bias correction of its own example.

Errors are root mean squares over the samples in movement. No two of them agree where north is, so each one's constant
heading difference (its circular mean) is taken out. Needs ``pip install kfgen[peers]`` and the recordings.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from kfgen.discretise import DiscreteModel
from kfgen.effects import make
from kfgen.emit.routines import Program
from kfgen.log import Log
from kfgen.model.library import build
from kfgen.noise import ChannelNoise, NoiseModel, Term
from kfgen.readers import read_log
from kfgen.run import FilterRun, attitude_error, run

DATA = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
OPTIONS = {
    "scale_factors": "true",
    "misalignment": "full",
    "intrinsics_sd": "0.002",
    "samples": "before",
    "field_gate": "0.1",
}
MOVED = {"accel": ("m/s^2", 0.2), "mag": ("T", 2e-6)}
NOISE = NoiseModel(
    {
        f"{triad}_{a}": ChannelNoise(unit, (Term(make("white_noise", N=N)),))
        for triad, (unit, N) in MOVED.items()
        for a in "xyz"
    }
)


def triad(log: Log, name: str) -> np.ndarray:
    """Three channels side by side, shape (n, 3)."""
    return np.column_stack([log.channels[f"{name}_{a}"].values for a in "xyz"])


def by_kfgen(log: Log) -> np.ndarray:
    """The emitted filter, shape (n, 4)."""
    model = build("ahrs6", NOISE, OPTIONS)
    return run(Program(DiscreteModel(model, rate=1.0 / log.dt)), log).estimate[:, :4]


def by_ahrs(log: Log) -> np.ndarray:
    """Madgwick's filter; its vertical points up, so half a turn about north follows."""
    from ahrs.filters import Madgwick
    from scipy.spatial.transform import Rotation

    field = np.nan_to_num(triad(log, "mag")) * 1e9
    q = Madgwick(gyr=triad(log, "gyro"), acc=triad(log, "accel"), mag=field, frequency=1.0 / log.dt).Q
    half_turn = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    return (half_turn * Rotation.from_quat(q, scalar_first=True)).as_quat(scalar_first=True)


def by_imufusion(log: Log) -> np.ndarray:
    """Fusion's complementary filter in north-east-down."""
    import imufusion

    settings, at_rest = imufusion.AhrsSettings(), imufusion.BiasSettings()
    settings.convention = imufusion.CONVENTION_NED
    settings.sample_rate = at_rest.sample_rate = 1.0 / log.dt
    ahrs, bias = imufusion.Ahrs(), imufusion.Bias()
    ahrs.set_settings(settings)
    bias.set_settings(at_rest)
    q = np.empty((log.n, 4))
    samples = zip(np.degrees(triad(log, "gyro")), triad(log, "accel") / 9.80665, triad(log, "mag") * 1e6)
    for k, (gyro, accel, mag) in enumerate(samples):
        if np.isfinite(mag).all():
            ahrs.update(np.ravel(bias.update(gyro)), accel, mag)
        q[k] = np.ravel(ahrs.get_quaternion())
    return q


FILTERS: dict[str, Callable[[Log], np.ndarray]] = {
    "kfgen": by_kfgen,
    "ahrs Madgwick": by_ahrs,
    "imufusion": by_imufusion,
}


def result_of(log: Log, q: np.ndarray) -> Any:
    """Errors of a track of quaternions."""
    made = FilterRun("", log.t, ("q_w", "q_x", "q_y", "q_z"), q, np.zeros((log.n, 3)), {})
    return attitude_error(made, log)


def main() -> None:
    """All filters over all recordings."""
    paths = sorted((DATA / "dynamic").glob("broad_*.npz"))
    if not paths:
        print("skipped: the BROAD recordings are not here (set KFGEN_DATA)")
        return
    print(f"{'recording':44} {'filter':14} inclination  heading    total [deg]   seconds")
    for path in paths:
        log = read_log(path)
        for name, filtered in FILTERS.items():
            start = time.perf_counter()
            q = filtered(log)
            took = time.perf_counter() - start
            e = result_of(log, q)
            sizes = "  ".join(f"{np.degrees(v):8.3f}" for v in (e.inclination, e.heading, e.total))
            print(f"{path.stem:44} {name:14} {sizes}   {took:10.1f}", flush=True)


if __name__ == "__main__":
    main()
