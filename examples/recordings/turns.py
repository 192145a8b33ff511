"""A gyro turned by 360 deg about each axis by hand, to half a degree: its scale factors.

Recording: MaD Lab FAU, imucal (MIT); the integral of the rate over the turns is 370.0, 353.7 and 359.4 deg.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from common import AXES, Case, at_rest, main, of_scene

from kfgen.calibrate.known_turns import Turn, turn_scene
from kfgen.log.readers import read_log

BY_HAND = np.radians(0.5)


def turned(file: Path) -> Case:
    """Rests are turns by nothing, which bound the bias."""
    with np.load(file) as archive:
        sections: dict[str, Any] = json.loads(str(archive["meta"]))["sections"]
    log = read_log(file)
    spans = {k: (log.t[s["start"]], log.t[s["end"]]) for k, s in sections.items()}
    turns = [Turn(*spans[f"{a}_rot"], i, 2.0 * np.pi) for i, a in enumerate(AXES)]
    turns += [Turn(*s, i, 0.0) for k, s in spans.items() if not k.endswith("rot") for i in range(3)]
    rest = sections["x_p"]
    assumed = at_rest(log, [f"gyro_{a}" for a in AXES], rest["start"], rest["end"])
    _, said, answer = of_scene(log, turn_scene(log, assumed, turns, float(BY_HAND)))
    return said, answer


if __name__ == "__main__":
    main(str(__doc__), {"turns": ("effects/imu_ferraris_session.npz", turned)})
