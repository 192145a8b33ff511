"""When a moving sensor is tapped, or a phone on its board vibrates: where its accelerometer is to be trusted less.

Recordings: D. Laidig et al., BROAD, Data 6(7):72, 2021 (CC BY 4.0).
"""

from pathlib import Path

import numpy as np
from common import AXES, Case, main

from kfgen.gap.motion.on_off_times import vibrations
from kfgen.log.readers import read_log

REST, CORNER, LEAST = 30.0, 40.0, 3.0


def shaken(file: Path) -> Case:
    """Spans in which the power above 40 Hz stands out of that of the first 30 s at rest."""
    log = read_log(file)
    f_b = np.array([log.values(f"accel_{a}") for a in AXES]).T
    noise = float(np.sqrt(0.5 * np.diff(f_b[log.t < REST], axis=0).var(axis=0).sum()))
    spans = vibrations(log.t, f_b, noise, CORNER, LEAST)
    return ["vibration " + (", ".join(f"{a:.0f} to {b:.0f} s" for a, b in spans) or "nowhere")], None


if __name__ == "__main__":
    files = {
        "tapping": "25_disturbed_tapping_B",
        "phone": "27_disturbed_phone_vibration_B",
        "quiet": "01_undisturbed_slow_rotation_A",
    }
    main(str(__doc__), {k: (f"dynamic/broad_{f}.npz", shaken) for k, f in files.items()})
