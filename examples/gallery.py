"""Every static recording and published curve of a folder of open data, identified: a table and pictures.

Sources: T. Suarez (MPU-6050, MS5611, VL53L0X; MIT), S. Shrikanth (gyro of 8.75 mdps; MIT), Gao W. (imu_utils; MIT).
Usage: python gallery.py [FOLDER for the pictures]
"""

import os
import sys
from pathlib import Path

from kfgen.core.files.whole_file import write_text
from kfgen.identify.identify_log import identify
from kfgen.log.readers import ColumnMap, read_log
from kfgen.report.identify import one_line, panel
from kfgen.report.plots import panels_picture

AXES = "xyz"
COUNTS = ", ".join(
    [f"gyro_{a} = gyr_counts_{a} [deg/s/131]" for a in AXES]
    + [f"accel_{a} = acc_counts_{a} [g/16384]" for a in AXES]
)
CURVES = ", ".join(
    ["tau = tau_s [s]"]
    + [f"gyro_{a} = gyr_{a} [deg/h]" for a in AXES]
    + [f"accel_{a} = acc_{a} [m/s^2]" for a in AXES]
)
FILES = {
    "static/mpu6050_static_450s.npz": (COUNTS, None),
    "static/gyro_875mdps_warmup.npz": ("gyro_x = gyr_counts [deg/s*0.00875]", 200.0),
    "static/baro_ms5611_400s.npz": ("altitude = alt [m], temperature = temp [degC]", None),
    "static/tof_vl53l0x_1h.npz": ("distance = dist_mm [mm]", 200244 / 3600),
    **{f"allan_curves/imu_utils_{name}.csv": (CURVES, None) for name in ("16448", "A3", "gx4", "xsens")},
}

data = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
for file, (columns, rate) in FILES.items():
    if not (data / file).is_file():
        print(f"skipped: {file} is not here (set KFGEN_DATA)")
        continue
    log = read_log(data / file, rate=rate, columns=ColumnMap.parse(columns))
    found = identify(log)
    for name, channel in found.channels.items():
        print(f"| {Path(file).stem} | {name} | {one_line(channel)} |")
    if len(sys.argv) > 1:
        panels = [panel(channel, name) for name, channel in found.channels.items()]
        write_text(Path(sys.argv[1]) / f"{Path(file).stem}.svg", panels_picture(panels, Path(file).stem).svg)
