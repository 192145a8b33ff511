"""How long ``gap`` takes: a sensor at rest, a plant, a nine-axis sensor that moves.

Usage: python benchmarks/gap_speed.py [static|plant|motion ...]

Each log has one hidden effect and is made by numpy and scipy. Printed: samples, seconds of the call (importing
not counted, a compiled kernel from its cache), what was named, the largest memory of the process.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable

import numpy as np

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.log.log import Channel, Log


def static(n: int = 1_000_000) -> tuple[int, list[str], float]:
    """White noise and a Gauss-Markov bias, 100 Hz, a thermometer, a hidden temperature term and a line."""
    from scipy.signal import lfilter

    from kfgen.gap.core.drivers import drivers_of
    from kfgen.gap.rest.channel_gap import channel_gap
    from kfgen.gap.rest.even_record import regular

    rng = np.random.default_rng(1)
    t = np.arange(n) / 100.0
    a = np.exp(-0.01 / 100.0)
    slow = lfilter([1.0], [1.0, -a], 3e-5 * np.sqrt(1 - a * a) * rng.standard_normal(n))
    K = 295.0 + 8.0 * (1.0 - np.exp(-t / 1500.0)) + 2.0 * np.sin(t / 900.0)
    y = 6e-4 * rng.standard_normal(n) + slow + 1e-5 * (K - 298.0) + 8e-6 * np.sin(2 * np.pi * 17.3 * t)
    log = Log(
        t,
        {
            "gyro_x": Channel(y, "rad/s"),
            "temperature": Channel(K + 0.02 * rng.standard_normal(n), "K"),
        },
    )
    noise = ChannelNoise(
        "rad/s", (Term(make("white_noise", N=6e-5)), Term(make("gauss_markov", sigma=3e-5, tau=100.0)))
    )
    start = time.perf_counter()
    record, stamps, _ = regular(log, "gyro_x", drive=drivers_of(log)[0])
    found = channel_gap("gyro_x", record, noise, stamps)
    return n, [f.effect.name for f in found.findings], time.perf_counter() - start


PENDULUM = """format = "kfgen-model-1"
name = "pendulum"
[parameters]
g_over_l = "19.6 1/s^2"
[states]
theta = "rad"
omega = "rad/s"
[inputs]
u = "N m"
[dynamics]
theta = "omega"
omega = "-g_over_l*sin(theta) - 0.3*omega + 25.0*u"
[measurements.angle]
unit = "rad"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.0002 rad/sqrt(Hz)" } ]
"""


def plant(n: int = 20_000) -> tuple[int, list[str], float]:
    """A driven pendulum at 100 Hz with hidden dry friction."""
    from scipy.integrate import solve_ivp

    from kfgen.gap.plant.scene import PlantScene
    from kfgen.gap.scene.scene_gap import scene_gap
    from kfgen.model.plant.file import parse_model

    rng = np.random.default_rng(2)
    t = np.arange(n) / 100.0
    u = np.repeat(0.08 * rng.standard_normal(n // 50 + 1), 50)[:n]

    def rate(s: float, x: np.ndarray) -> list[float]:
        drive = float(u[min(int(s * 100.0), n - 1)])
        friction = 0.2 * float(np.tanh(x[1] / 0.01))
        return [x[1], -19.6 * float(np.sin(x[0])) - 0.3 * x[1] + 25.0 * drive - friction]

    theta = solve_ivp(rate, (0.0, t[-1]), [0.1, 0.0], t_eval=t, max_step=0.01, rtol=1e-6).y[0]
    log = Log(t, {"u": Channel(u, "N m"), "angle": Channel(theta + 2e-3 * rng.standard_normal(n), "rad")})
    model = parse_model(PENDULUM, "pendulum.toml")
    PlantScene.of(model, log.cut(0, 500))  # the kernel from its cache
    start = time.perf_counter()
    found = scene_gap(PlantScene.of(model, log))
    return n, [f.effect.name for f in found.findings], time.perf_counter() - start


def motion(n: int = 100_000) -> tuple[int, list[str], float]:
    """Gyros, accelerometers and magnetometers on a moving body at 100 Hz, references of each; a hidden misalignment."""
    from kfgen.gap.motion.motion_scene import motion_scene
    from kfgen.gap.scene.scene_gap import scene_gap

    rng = np.random.default_rng(3)
    t = np.arange(n) / 100.0
    sizes = {
        "gyro": (1.0, 5e-4, "rad/s"),
        "accel": (8.0, 2e-3, "m/s^2"),
        "mag": (4e-5, 5e-8, "T"),
    }
    channels: dict[str, Channel] = {}
    noise: dict[str, ChannelNoise] = {}
    for k, (sensor, (size, N, unit)) in enumerate(sizes.items()):
        truth = [size * np.sin(2 * np.pi * f * t + k) for f in (0.11 + 0.02 * k, 0.17, 0.23 + 0.03 * k)]
        for axis, x in zip("xyz", truth):
            y = x + N * 10.0 * rng.standard_normal(n)
            if sensor == "gyro" and axis == "x":
                y = y + 5e-4 * truth[1]
            channels[f"{sensor}_{axis}"] = Channel(y, unit)
            channels[f"ref_{sensor}_{axis}"] = Channel(x, unit)
            noise[f"{sensor}_{axis}"] = ChannelNoise(unit, (Term(make("white_noise", N=N)),))
    start = time.perf_counter()
    scene = motion_scene(Log(t, channels), NoiseModel(noise))
    assert scene is not None
    found = scene_gap(scene)
    return n, [f.effect.name for f in found.findings], time.perf_counter() - start


WORLDS: dict[str, Callable[[], tuple[int, list[str], float]]] = {
    "static": static,
    "plant": plant,
    "motion": motion,
}


def main() -> None:
    """Time the worlds that are asked for."""
    for name in sys.argv[1:] or WORLDS:
        n, found, seconds = WORLDS[name]()
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(
            f"{name}: {n} samples, {seconds:.1f} s, {', '.join(found) or 'nothing'} named, {memory:.0f} MiB"
        )


if __name__ == "__main__":
    main()
