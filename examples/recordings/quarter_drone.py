"""A beam with one propeller whose published model is quadratic in the input, against a model that is linear in it.

Recordings: H. Ayala, sysid (public domain). The angle follows theta'' = c1 sin(theta) + c2 u^2 + c3 theta'.
"""

from pathlib import Path

import numpy as np
from common import Case, main, of_scene

from kfgen.gap.plant.scene import PlantScene
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model

EVERY = 5
MODEL = """
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
effects = [
  { effect = "white_noise", N = "0.0007 deg/sqrt(Hz)" },
  { effect = "gauss_markov", sigma = "3 deg", tau = "1 s" },
]
"""


def drone(file: Path) -> Case:
    """The gap, and how far one simulation over the whole record is off with and without what is found."""
    with np.load(file) as archive:
        table = archive["data"]
    t, y, u = (
        (table[:, 0] * 1e-3, table[:, 1], table[:, 2]) if "dados" in file.name else table[:, [0, 2, 3]].T
    )
    n = t.size // EVERY * EVERY
    held = u[:n].reshape(-1, EVERY).mean(axis=1)  # over the period that it acts
    channels = {"angle": Channel.of(y[:n:EVERY], "deg"), "u": Channel.of(held, "")}
    log = Log(t[:n:EVERY] - t[0], channels, source=file.name)
    scene = PlantScene.of(parse_model(MODEL, "drone.toml"), log)
    gap, said, answer = of_scene(log, scene, scene.unit)
    there = gap.scene
    assert isinstance(there, PlantScene)
    left = [
        there.simulated(f.point).channels["angle"][:, 0] - log.values("angle") for f in (gap.assumed, gap.fit)
    ]
    rms = [float(np.degrees(np.sqrt(np.mean(x**2)))) for x in left]
    return [*said, f"free run off by {rms[0]:.2f} deg, then by {rms[1]:.2f} deg"], answer


if __name__ == "__main__":
    files = {
        "steps": "sinal2_degraus_malha_fechada",
        "slow": "sinal1_semi_estatica_malha_fechada",
        "flight": "dados_14_drone",
    }
    main(str(__doc__), {k: (f"systems/quarter_drone_{f}.npz", drone) for k, f in files.items()})
