"""An attitude filter over a real motion with an optical reference.

BROAD trial 1 (Laidig et al., Data 6(7):72, 2021, CC BY 4.0): slow rotations, 285.7 Hz. The filter that
runs is the emitted filterpy module.
"""

import os
from pathlib import Path

import numpy as np

from kfgen.emit.routines import Program
from kfgen.log.readers import read_log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.run.run import attitude_error, run

data = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
recording = data / "dynamic" / "broad_01_undisturbed_slow_rotation_A.npz"
if not recording.is_file():
    print(f"skipped: {recording.name} is not here (set KFGEN_DATA)")
    raise SystemExit

log = read_log(recording)
result = run(Program(DiscreteModel(build("ahrs6"), rate=1.0 / log.dt)), log)
error = attitude_error(result, log)
assert error is not None
print(
    f"inclination RMSE {np.degrees(error.inclination):.2f} deg, heading RMSE {np.degrees(error.heading):.2f} deg"
)
