"""A receiver whose stamps are of another epoch than those of the inertial sensor is refused by name, not left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.log.log import Channel, Log
from kfgen.log.readers.tables.streams import LogRecording, LogStream
from kfgen.log.readers.tables.table import TableColumn
from kfgen.model.discretise import DiscreteModel
from kfgen.run.run import run
from kfgen.simulate.simulate import simulate

RATE, SECONDS = 50.0, 20.0


def replay(path: Path, late_s: float) -> Path:
    """A log of PX4-ECL's replay format: the inertial sensor from zero on, the receiver by so much later."""
    model = kf.build("ins15")
    log = simulate(DiscreteModel.at_rate(model, RATE), "generic", SECONDS, np.random.default_rng(2))
    of = {n: c.values for n, c in log.channels.items()}
    rows = []
    for k, t in enumerate(log.t):
        imu = [of[f"{s}_{a}"][k] for s in ("gyro", "accel") for a in "xyz"]
        rows.append((t, "imu", imu[3:] + imu[:3]))
        if k % 10 == 0:
            north, east, down = (of[f"gnss_p_{a}"][k] for a in "NED")
            fix = [488000.0 - 1e3 * down, 85456073.0 + 130.0 * east, 473977508.0 + 90.0 * north]
            rows.append((t + late_s, "gps", [*fix, *(of[f"gnss_v_{a}"][k] for a in "NED")]))
    rows.sort(key=lambda row: row[0])
    lines = [f"{round(1e6 * t)},{name},{','.join(f'{x:.9g}' for x in v)}" for t, name, v in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("command", ["run", "gap"])
def test_a_receiver_of_another_epoch_is_refused_by_name(
    command: str, kfgen: Callable[..., Any], tmp_path: Path
) -> None:
    path = replay(tmp_path / "log.csv", 1.4e6)
    words = ["run", "ins15", path] if command == "run" else ["gap", path, "--model", "ins15"]
    done = kfgen(*words)
    assert done.exit_code == 2
    said = f"{done.exception} {done.stderr}"
    assert "gnss_position is of another epoch: the stamps of gps are from 1400000" in said
    assert "those of imu from 0 to 19.98 s, and none is between" in said
    assert "Log both by one clock" in said


def test_a_receiver_that_begins_late_is_used(tmp_path: Path) -> None:
    log = kf.read_log(replay(tmp_path / "log.csv", SECONDS - 5.0))
    assert log.unplaced == {}
    assert 20 <= run("ins15", log).sensors["gnss_position"].t.size <= 26


def test_what_a_filter_does_not_read_may_be_of_any_epoch(tmp_path: Path) -> None:
    log = kf.read_log(replay(tmp_path / "log.csv", 1.4e6))
    assert set(log.unplaced) == {f"gnss_{x}_{a}" for x in "pv" for a in "NED"}
    still = {"baro": Channel(np.zeros(log.n), "m")}
    with_baro = replace(log, channels=dict(log.channels) | still)
    assert run(kf.build("ins15", sensors=["barometer"]), with_baro).sensors["barometer"].t.size == log.n


def test_a_sensor_under_the_filters_own_name_is_refused_too() -> None:
    t = np.arange(200) / 100.0
    imu = {
        f"{s}_{a}": TableColumn(np.full(200, 9.8 * (s == "accel")), None)
        for s in ("gyro", "accel")
        for a in "xyz"
    }
    baro = LogStream("altitude", t + 1e5, {"baro_height": TableColumn(np.zeros(200), "m")})
    table = LogRecording("log", [LogStream("imu", t, imu), baro]).table()
    channels = {
        n: Channel(c.values, "m" if n == "baro_height" else "") for n, c in table.columns.items() if n != "t"
    }
    log = Log(t, channels, unplaced=table.unplaced)
    with pytest.raises(InputError, match="barometer is of another epoch: the stamps of altitude"):
        run(kf.build("ins15", sensors=["barometer"]), log)
