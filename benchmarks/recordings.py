"""What is found in real recordings, beside what is known of them: the examples of `examples/recordings`, one after the other.

Usage: python benchmarks/recordings.py [--docs]

Recordings are open data of other people in ``../shared/data`` (or KFGEN_DATA); what is absent is left out.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from pathlib import Path

from docs_table import ROOT, measured_at, write_table

CASES: tuple[tuple[str, str, str, str], ...] = (
    ("quarter_drone", "slow", "beam with a propeller (H. Ayala), slow", "the thrust goes with the square of the input"),
    ("quarter_drone", "flight", "the same, as it flew", "the same"),
    ("quarter_drone", "steps", "the same, steps", "the same"),
    ("pendulum", "swing_up", "pendulum on a motor (DFKI), without friction", "dry friction of the joint"),
    ("gyro_warm_up", "warm-up", "gyro of 8.75 mdps (S. Shrikanth), 1191 s", "it warms up: 0.42 to 0.45 deg/s, 109 to 128 s"),
    ("gyro_line", "line", "MPU-6050 at rest (T. Suarez)", "a line at 38.0 Hz in its spectrum"),
    ("ranger_rate", "ranger", "VL53L0X, one hour (T. Suarez)", "200 244 samples in 3600 s are 1.112 times its 50 Hz"),
    ("magnet", "magnet-33", "BROAD 33: a magnet 2 cm beside (D. Laidig et al.)", "(-2.9, -0.5, 26.8) uT for a minute"),
    ("magnet", "magnet-36", "BROAD 36: a magnet 5 cm beside", "(0.1, -0.2, -6.1) uT for a minute"),
    ("magnet", "no-magnet-01", "BROAD 01", "no magnet"),
    ("magnet", "no-magnet-06", "BROAD 06", "no magnet"),
    ("vibration", "tapping", "BROAD 25", "tapping"),
    ("vibration", "phone", "BROAD 27", "a phone that vibrates"),
    ("vibration", "quiet", "BROAD 01", "neither"),
    ("poses", "poses-0", "MPU-9150 in many poses (M. Kok)", "bias 0.103, 0.097, 0.345 m/s^2, scale 0.36, 0.32, 0.62 % by g = 9.81"),
    ("turns", "turns", "turns by 360 deg (MaD Lab FAU)", "integrals of 370.0 and 353.7 deg: +2.8 and -1.8 %"),
    ("flight", "flight", "a fixed wing's GPS against its inertial sensor (P. Riseborough)", "0.25 to 0.3 s late by cross-correlation"),
    ("fixed_wing_flight", "fixed-wing", "the same without a reference, `ins15`", "its author flies with 0.21 and 0.23 s"),
    ("walk", "walk", "a walk with a receiver in the hand (T. Everett), `ins15`", "the antenna is 5 cm beside"),
    ("px4_flights", "jammed", "PX4, GNSS jammed, `ins23` with barometer and magnetometer", "no fix, no reference"),
    ("px4_flights", "brown-out", "PX4, ends by a brown-out, the same filter", "no receiver, no reference"),
    ("climb", "climb", "PX4-ECL's replay of a simulated quadrotor, `ins15`", "not stated; an independent fit: 0.200 +- 0.016 s late, or a drift"),
)  # fmt: skip
"""Script, case, recording, and what its author or an independent measurement says."""
MAX_SAID = 4
"""Lines of an answer that the table shows."""


def found(script: str, case: str) -> tuple[list[str], float]:
    """What an example says of a case, and its seconds; nothing where the recording is absent."""
    words = [sys.executable, str(ROOT / "examples" / "recordings" / f"{script}.py"), case]
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    begun = time.perf_counter()
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=env)
    lines = [line.strip() for line in done.stdout.splitlines()[1:]]
    return lines, time.perf_counter() - begun


def shortened(line: str) -> str:
    """A sentence of an answer as a table has room for it."""
    line = re.sub(r"The model of (\S+) is missing an effect: ", r"\1: ", line)
    line = re.sub(
        r"The white noise of (\S+) is ([0-9.e+-]+) times as large as assumed", r"noise of \1 x \2", line
    )
    line = re.sub(r"; in a field of unknown size.*?(?= \(\d+ %\)|$)", "", line)
    return re.sub(r" \(95 %: ([^)]*)\)", r" (\1)", line).removeprefix("verdict ")


def main() -> None:
    """Run all, print the table, and write it where asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="write the table into docs/benchmarks.md")
    load = os.getloadavg()[0]
    rows = ["| recording | what is known | verdict and what is said | time |", "|---|---|---|---|"]
    wanted = parser.parse_args()
    for script, case, recording, known in CASES:
        lines, seconds = found(script, case)
        if not lines:
            print(f"{case}: left out, its recording is absent", file=sys.stderr)
            continue
        # Noises of another size are many and last of interest.
        said = sorted(map(shortened, lines), key=lambda s: s.startswith("noise of "))
        more = [f"and {len(said) - 1 - MAX_SAID} more lines"] if len(said) > 1 + MAX_SAID else []
        rows.append(
            f"| {recording} | {known} | {'; '.join([*said[: 1 + MAX_SAID], *more])} | {seconds:.0f} s |"
        )
        print(rows[-1], flush=True)
    text = "\n".join([*rows, "", f"{measured_at(load)},\n`python benchmarks/recordings.py --docs`."])
    if wanted.docs:
        print(f"written to {write_table('benchmarks.md', 'recordings', text).relative_to(Path(ROOT))}")


if __name__ == "__main__":
    main()
