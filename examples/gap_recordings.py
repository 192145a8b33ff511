"""What a believed model misses of real recordings by other people: a line each, and a page each where wanted.

What is believed comes from the recordings too: a noise file identified on a quiet stretch or on another half, a
plant's published physics with a thrust that is linear in the input.

Sources: H. Ayala (quarter drone; public domain), S. Shrikanth (gyro of 8.75 mdps; MIT), T. Suarez (MPU-6050, VL53L0X;
MIT), D. Laidig et al., Data 6(7):72, 2021 (BROAD; CC BY 4.0), M. Kok (MPU-9150; MIT), MaD Lab FAU (Ferraris; MIT),
P. Riseborough (InertialNav; BSD-3).
Usage: python gap_recordings.py [NAME ...] [--pages DIR]
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import make
from kfgen.gap.finding import ChannelGap
from kfgen.gap.motion import motion_scene
from kfgen.gap.norm import norm_scene, poses
from kfgen.gap.outcome import SceneGap, find_scene_gap
from kfgen.gap.plant import PlantScene
from kfgen.gap.regular import regular
from kfgen.gap.scene import Placed, Point, Scene
from kfgen.gap.spans import vibrations
from kfgen.gap.turns import Turn, turn_scene
from kfgen.gap.workflow import find_gap
from kfgen.identify.channel import identify
from kfgen.identify.record import Record
from kfgen.log import Channel, Log
from kfgen.model.file import parse_model
from kfgen.noise import ChannelNoise, NoiseModel, Term
from kfgen.readers import ColumnMap, read_log
from kfgen.report.gap import finding_sentence, gap_answer
from kfgen.report.page import Answer, write_page
from kfgen.report.scene import UnitOf, finding_words, scene_answer, units_of_channels

AXES = "xyz"
GRAVITY_N = np.array([0.0, 0.0, 9.80665])
Array = NDArray[np.float64]
Case = tuple[str, Answer | None]
data = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")

DRONE = """
format = "kfgen-model-1"
name = "quarter-drone"
[parameters]
c1 = { value = "-8 1/s^2", sd = "8 1/s^2" }
c2 = { value = "0.3 rad/s^2", sd = "0.3 rad/s^2" }
c3 = { value = "-1 1/s", sd = "1 1/s" }
[states]
theta = "rad"
omega = "rad/s"
[inputs]
u = ""
[dynamics]
theta = "omega"
omega = "c1*sin(theta) + c2*u + c3*omega"
[measurements.angle]
unit = "deg"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.0007 deg/sqrt(Hz)" }, { effect = "gauss_markov", sigma = "3 deg", tau = "1 s" } ]
"""


def identified(unit: str, t: Array, y: Array) -> ChannelNoise:
    """What a stretch at rest has beside a constant."""
    found = identify(Record(t - t[0], y)).fit.effects
    return ChannelNoise(unit, tuple(Term(e) for e in found if not e.coefficients()))


def at_rest(log: Log, names: list[str], start: int, stop: int) -> NoiseModel:
    """A noise model from samples `start` to `stop`."""
    part = log.cut(start, stop)
    return NoiseModel({n: identified(log.channels[n].unit, part.t, part.values(n)) for n in names})


def thinned(log: Log, every: int) -> Log:
    """One sample of `every`."""
    kept = {n: replace(c, values=c.values[::every]) for n, c in log.channels.items()}
    return replace(log, t=log.t[::every], channels=kept)


def of_channel(log: Log, name: str, believed: NoiseModel) -> Case:
    """The gap of one channel at rest."""
    record, stamps, _ = regular(log, name)
    gap: ChannelGap = find_gap(name, record, believed.channel(name), stamps, log.stated)
    said = "; ".join(finding_sentence(gap, f) for f in gap.findings)
    shut = f"gap {gap.gap.before:.3g} -> {gap.gap.after:.3g}"
    return f"{gap.verdict}: {said or 'nothing'}; {shut}", gap_answer(log, believed, {name: gap})


def of_scene(
    log: Log, scene: Scene | None, unit: UnitOf, words: Callable[[SceneGap], str] | None = None
) -> Case:
    """The gap of a world."""
    assert scene is not None
    gap = find_scene_gap(scene)
    said = [finding_words(f, unit).split(". ")[0] + f" ({100 * f.probability:.0f} %)" for f in gap.findings]
    shut = f"gap {gap.gap.before:.3g} -> {gap.gap.after:.3g}"
    more = f"; {words(gap)}" if words else ""
    return f"{gap.verdict}: {'; '.join(said) or 'nothing'}; {shut}{more}", scene_answer(
        log, gap, unit, ("", "")
    )


def drone(file: Path, every: int = 5) -> Case:
    """Thrust that is linear in the input: the real one has a square. Inputs are means over the period they are held."""
    with np.load(file) as archive:
        table = archive["data"]
    t, y, u = (
        (table[:, 0] * 1e-3, table[:, 1], table[:, 2]) if "dados" in file.name else table[:, [0, 2, 3]].T
    )
    n = t.size // every * every
    channels = {
        "angle": Channel.of(y[:n:every], "deg"),
        "u": Channel.of(u[:n].reshape(-1, every).mean(axis=1), ""),
    }
    log = Log(t[:n:every] - t[0], channels, source=file.name)
    scene = PlantScene.of(parse_model(DRONE, "drone.toml"), log)

    def free_run(gap: SceneGap) -> str:
        """Root mean square error of one simulation over the whole record."""
        angle = log.values("angle")
        sizes = []
        for point in (gap.believed.point, gap.fit.point):
            left = scene.simulated(point).channels["angle"][:, 0] - angle
            sizes.append(np.degrees(np.sqrt(np.mean(left**2))))
        return f"free run of {len(scene.starts)} segments off by {sizes[0]:.2f} -> {sizes[1]:.2f} deg"

    return of_scene(log, scene, scene.unit, free_run)


def warm_up(file: Path) -> Case:
    """The second half, warm, is what is believed; 200 Hz is a guess, for the source states none."""
    log = read_log(file, rate=200.0, columns=ColumnMap.parse("gyro_x = gyr_counts [deg/s*0.00875]"))
    return of_channel(log, "gyro_x", at_rest(log, ["gyro_x"], log.n // 2, log.n))


def line(file: Path) -> Case:
    """The first half is what is believed: its periodic line is not part of a noise file."""
    log = read_log(file, columns=ColumnMap.parse("gyro_y = gyr_counts_y [deg/s/131]"))
    log = log.cut(300, log.n)  # it was still being laid down
    return of_channel(log, "gyro_y", at_rest(log, ["gyro_y"], 0, log.n // 2))


def ranger(file: Path) -> Case:
    """The header says 50 Hz and an hour; the samples are 55.6 a second."""
    log = read_log(file, columns=ColumnMap.parse("distance = dist_mm [mm]"))
    return of_channel(log, "distance", at_rest(log, ["distance"], log.n // 2, log.n))


def undisturbed(every: int) -> NoiseModel:
    """Noise of a magnetometer that moves in a real room: what BROAD trial 1 leaves after its delay."""
    log = thinned(read_log(data / "dynamic" / "broad_01_undisturbed_slow_rotation_A.npz"), every)
    first = {f"mag_{a}": ChannelNoise("uT", (Term(make("white_noise", N=1e-7)),)) for a in AXES}
    scene = motion_scene(log, NoiseModel(first))
    assert scene is not None
    start = np.array([u.start for u in scene.unknowns])
    left = scene.left(Point((Placed(make("time_delay", delay=0.015), "mag"),), start))
    names = [c.name for c in scene.compared]
    return NoiseModel({n: identified("uT", scene.truth.t, np.asarray(x)) for n, x in zip(names, left)})


def magnet(file: Path, every: int = 8) -> Case:
    """A magnetometer against an optical attitude; a magnet is put on the board for a minute, or none is."""
    log = thinned(read_log(file), every)
    return of_scene(log, motion_scene(log, undisturbed(every)), units_of_channels(log))


def shaken(file: Path) -> Case:
    """Spans of vibration: not a gap yet, but where the accelerometer is to be believed less."""
    log = read_log(file)
    f_b = np.array([log.values(f"accel_{a}") for a in AXES]).T
    noise = float(np.sqrt(0.5 * np.diff(f_b[log.t < 30.0], axis=0).var(axis=0).sum()))
    spans = vibrations(log.t, f_b, noise, 40.0, 3.0)
    return "vibration " + (", ".join(f"{a:.0f} to {b:.0f} s" for a, b in spans) or "none"), None


def posed(file: Path) -> Case:
    """An accelerometer at rest in many poses, believed to be as quiet as in the first."""
    log = read_log(file)
    names = [f"accel_{a}" for a in AXES]
    log = log.select(names)
    start, stop = max(poses(log, "accel"), key=lambda p: p[1] - p[0])
    return of_scene(log, norm_scene(log, at_rest(log, names, start, stop)), units_of_channels(log))


def turned(file: Path) -> Case:
    """A gyro turned by 360 deg about each axis by hand, to half a degree."""
    with np.load(file) as archive:
        sections: dict[str, Any] = json.loads(str(archive["meta"]))["sections"]
    log = read_log(file)
    names = [f"gyro_{a}" for a in AXES]
    rest = sections["x_p"]
    spans = {k: (log.t[s["start"]], log.t[s["end"]]) for k, s in sections.items()}
    turns = [Turn(*spans[f"{a}_rot"], i, 2.0 * np.pi) for i, a in enumerate(AXES)]
    turns += [Turn(*s, i, 0.0) for k, s in spans.items() if not k.endswith("rot") for i in range(3)]
    believed = at_rest(log, names, rest["start"], rest["end"])
    return of_scene(log, turn_scene(log, believed, turns, float(np.radians(0.5))), units_of_channels(log))


def flight(file: Path) -> Case:
    """Accelerations of GPS velocities against those of the IMU in the attitude of the autopilot, at 5 Hz."""
    from scipy.spatial.transform import Rotation, Slerp

    with np.load(file) as f:
        a = {k: np.asarray(f[k], float) for k in f.files if k != "meta"}
    attitude = Slerp(a["t_att"], Rotation.from_euler("ZYX", a["rpy"][:, ::-1], degrees=True))
    inside = (a["t_imu"] > a["t_att"][0]) & (a["t_imu"] < a["t_att"][-1])
    t = a["t_imu"][inside]
    force = attitude(t).apply(a["acc"][inside]) + GRAVITY_N
    grid = np.arange(max(t[0], a["t_gps"][0]) + 1.0, min(t[-1], a["t_gps"][-1]) - 1.0, 0.2)
    speed = np.array([np.cos(a["course"]), np.sin(a["course"])]) * a["gndspd"]
    channels = {}
    for axis, v, sum_ in zip("xy", speed, np.cumsum(force[1:] * np.diff(t)[:, None], axis=0).T):
        gained = np.diff(np.interp(grid, a["t_gps"], v)) / 0.2
        felt = np.diff(np.interp(grid, t[1:], sum_)) / 0.2
        channels |= {f"gps_{axis}": Channel.of(gained, "m/s^2"), f"ref_gps_{axis}": Channel.of(felt, "m/s^2")}
    log = Log(grid[:-1] - grid[0], channels, source=file.name)
    noise = ChannelNoise(
        "m/s^2", (Term(make("white_noise", N=0.2)), Term(make("gauss_markov", sigma=0.3, tau=3.0)))
    )
    believed = NoiseModel({f"gps_{axis}": noise for axis in "xy"})
    return of_scene(log, motion_scene(log, believed), units_of_channels(log))


CASES: dict[str, tuple[str, Callable[[Path], Case]]] = {
    "drone-steps": ("systems/quarter_drone_sinal2_degraus_malha_fechada.npz", drone),
    "drone-slow": ("systems/quarter_drone_sinal1_semi_estatica_malha_fechada.npz", drone),
    "drone-14": ("systems/quarter_drone_dados_14_drone.npz", drone),
    "warm-up": ("static/gyro_875mdps_warmup.npz", warm_up),
    "line": ("static/mpu6050_static_450s.npz", line),
    "ranger": ("static/tof_vl53l0x_1h.npz", ranger),
    "magnet-33": ("dynamic/broad_33_disturbed_attached_magnet_2cm.npz", magnet),
    "magnet-36": ("dynamic/broad_36_disturbed_attached_magnet_5cm.npz", magnet),
    "no-magnet-01": ("dynamic/broad_01_undisturbed_slow_rotation_A.npz", magnet),
    "no-magnet-06": ("dynamic/broad_06_undisturbed_fast_rotation_A.npz", magnet),
    "tapping": ("dynamic/broad_25_disturbed_tapping_B.npz", shaken),
    "phone": ("dynamic/broad_27_disturbed_phone_vibration_B.npz", shaken),
    "poses-0": ("effects/mpu9150_calib_imu0.npz", posed),
    "poses-1": ("effects/mpu9150_calib_imu1.npz", posed),
    "turns": ("effects/imu_ferraris_session.npz", turned),
    "flight": ("dynamic/inertialnav_swisslog1.npz", flight),
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="What a believed model misses of real recordings.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(CASES))
    parser.add_argument("--pages", type=Path, help="folder of the reports")
    given = parser.parse_args()
    if unknown := set(given.names) - set(CASES):
        parser.error(f"there is no {', '.join(sorted(unknown))}; known are {', '.join(CASES)}")
    for name, (file, case) in CASES.items():
        if given.names and name not in given.names:
            continue
        if not (data / file).is_file():
            print(f"{name}: skipped: {file} is not here (set KFGEN_DATA)")
            continue
        begun = time.monotonic()
        words, answer = case(data / file)
        print(f"{name}: {words} [{time.monotonic() - begun:.0f} s]", flush=True)
        if given.pages and answer is not None:
            write_page(answer.page, given.pages / f"{name}.html")
