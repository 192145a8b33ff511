"""Attitude from nine axes against an optical reference: kfgen's models beside the packages ahrs, imufusion and vqf.

Recordings: BROAD (Laidig et al., Data 6(7):72, 2021, CC BY 4.0). Every filter runs all of them with its defaults: kfgen's ahrs25
and ahrs6 as ``kfgen run`` runs them, without a noise file; Madgwick of ahrs; imufusion with the bias correction of its own
example; VQF (Laidig, Seel, Information Fusion 91, 2023). ``--set NAME=VALUE`` changes options of ahrs25 (how much do they matter?),
``--only kfgen`` leaves out what does not begin so, ``--trials 01,06`` takes some.

Errors are root mean squares over the samples in movement. No two of them agree where north is, so each one's constant
heading difference (its circular mean) is removed. Needs ``pip install kfgen[peers]`` and the recordings.
"""

import argparse
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kfgen.emit.routines import Program
from kfgen.log.log import Log
from kfgen.log.readers import read_log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.option import NOTHING, read_pairs
from kfgen.run.run import FilterRun, attitude_error, run

DATA = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")


def triad(log: Log, name: str) -> np.ndarray:
    """Three channels side by side, shape (n, 3)."""
    return np.column_stack([log.channels[f"{name}_{a}"].values for a in "xyz"])


def by_kfgen(log: Log, name: str = "ahrs25", options: Mapping[str, str] = NOTHING) -> np.ndarray:
    """The emitted filter, shape (n, 4)."""
    model = build(name, None, options)
    longest = max(0.1, 1.001 * float(np.diff(log.t).max()))
    return run(Program(DiscreteModel.at_rate(model, 1.0 / log.dt, max_step=longest)), log).estimate[:, :4]


def by_vqf(log: Log) -> np.ndarray:
    """VQF; its east-north-up is turned into north-east-down."""
    import vqf
    from scipy.spatial.transform import Rotation

    samples = [np.ascontiguousarray(triad(log, n)) for n in ("gyro", "accel", "mag")]
    q = vqf.VQF(log.dt).updateBatch(*samples)["quat9D"]
    ned_of_enu = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    return (ned_of_enu * Rotation.from_quat(q, scalar_first=True)).as_quat(scalar_first=True)


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
    "kfgen ahrs25": by_kfgen,
    "kfgen ahrs6": lambda log: by_kfgen(log, "ahrs6"),
    "ahrs Madgwick": by_ahrs,
    "imufusion": by_imufusion,
    "vqf": by_vqf,
}


def result_of(log: Log, q: np.ndarray) -> Any:
    """Errors of a track of quaternions."""
    made = FilterRun("", log.t, ("q_w", "q_x", "q_y", "q_z"), q, np.zeros((log.n, 3)), {})
    return attitude_error(made, log)


def main() -> None:
    """All filters over all recordings."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--set", action="append", default=[], help="an option of ahrs25, name=value")
    parser.add_argument("--only", default="", help="filters whose name begins so")
    parser.add_argument("--trials", default="", help="numbers of recordings, separated by commas")
    asked = parser.parse_args()
    filters = {n: f for n, f in FILTERS.items() if n.startswith(asked.only)}
    if asked.set:
        options = read_pairs(asked.set)
        filters = {f"kfgen {' '.join(asked.set)}": lambda log: by_kfgen(log, "ahrs25", options)}
    wanted = [t for t in asked.trials.split(",") if t]
    paths = sorted((DATA / "dynamic").glob("broad_*.npz"))
    if not paths:
        print("skipped: the BROAD recordings are not here (set KFGEN_DATA)")
        return
    print(f"{'recording':44} {'filter':14} inclination  heading    total [deg]   seconds")
    for path in paths:
        if wanted and path.stem.split("_")[1] not in wanted:
            continue
        log = read_log(path)
        for name, filtered in filters.items():
            start = time.perf_counter()
            q = filtered(log)
            took = time.perf_counter() - start
            e = result_of(log, q)
            sizes = "  ".join(f"{np.degrees(v):8.3f}" for v in (e.inclination, e.heading, e.total))
            print(f"{path.stem:44} {name:14} {sizes}   {took:10.1f}", flush=True)


if __name__ == "__main__":
    main()
