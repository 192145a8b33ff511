"""Noise of a real MPU-6050 at rest, from raw counts to a noise file.

The recording (T. Suarez, ImuCalibration, MIT) has four header lines of its own and integer
counts: 131 per deg/s, 16384 per g, 100 Hz.
"""

import os
from pathlib import Path

from kfgen.effects.noise_model import noise_text
from kfgen.identify.identify_log import identify
from kfgen.log.readers import ColumnMap, read_log
from kfgen.report.identify import identify_answer

data = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
recording = data / "native" / "mpu6050_static.csv"
if not recording.is_file():
    print(f"skipped: {recording.name} is not here (set KFGEN_DATA)")
    raise SystemExit

columns = ",".join(f"gyro_{a}=g{a} [deg/s/131], accel_{a}=a{a} [g/16384]" for a in "xyz")
log = read_log(recording, rate=100.0, columns=ColumnMap.parse(columns))
found = identify(log)
print(identify_answer(found).text)
print(noise_text(found.noise))
