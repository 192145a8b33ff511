"""The page for people who come from another program: its commands are ours, and each of them runs."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import typer.main
from written_logs import triad, write_bag, write_ulog

import kfgen as kf
from kfgen.cli.app import app
from kfgen.consumers import consumers
from kfgen.effects import catalogue

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/coming_from.md"
SECTIONS = re.split(r"(?m)^## ", PAGE.read_text(encoding="utf-8"))[1:]


def commands(section: str) -> list[str]:
    """The command lines of a section."""
    blocks = re.findall(r"```sh\n(.*?)```", section, re.S)
    return [line for block in blocks for line in block.splitlines()]


def test_every_command_and_option_is_one_of_ours() -> None:
    known = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    lines = [line for section in SECTIONS for line in commands(section)]
    assert len(lines) >= 14
    for line in lines:
        program, name, *words = shlex.split(line)
        assert program == "kfgen"
        options = {o for p in known[name].params for o in (*p.opts, *p.secondary_opts)}
        assert {w for w in words if w.startswith("-")} <= options, line
    text = PAGE.read_text(encoding="utf-8")
    assert set(re.findall(r"--to (\w+)", text)) <= set(consumers())
    for name in ("hard_iron", "soft_iron", "supply_current", "time_delay", "rate_random_walk"):
        assert name in text
        assert name in catalogue()


def rest() -> kf.Log:
    """A simulated IMU at rest: 600 s at 100 Hz, of the noise of a MEMS data sheet."""
    rng = np.random.default_rng(5)
    n, rate = 60000, 100.0
    sizes = {"gyro": (6e-5, 4e-6), "accel": (1e-3, 1e-4)}  # N [U/sqrt(Hz)], K [U/sqrt(s)]
    channels = {}
    for sensor, (N, K) in sizes.items():
        for axis in "xyz":
            walk = np.cumsum(K / np.sqrt(rate) * rng.standard_normal(n))
            offset = -9.80665 if (sensor, axis) == ("accel", "z") else 0.0
            y = offset + walk + N * np.sqrt(rate) * rng.standard_normal(n)
            channels[f"{sensor}_{axis}"] = kf.Channel(y, "rad/s" if sensor == "gyro" else "m/s^2")
    return kf.Log(np.arange(n) / rate, channels, "rest")


def flight() -> kf.Log:
    """A minute of figures of eight: GNSS is 0.2 s old, 0.1 s more than quad.toml says."""
    truth = kf.build("ins15", options={"delay": "0.2 s", "lever_arm": "0.1 0 -0.05 m"})
    return kf.simulate(truth, "figure-8", duration=60.0, rate=50.0, seed=3, rates={"gnss": 5.0})


@pytest.mark.long
@pytest.mark.parametrize("section", SECTIONS, ids=lambda s: s.split("\n")[0])
def test_commands_run(section: str, tmp_path: Path) -> None:
    """As they are printed; statuses 0, and the file that each writes is there."""
    shutil.copy(ROOT / "examples" / "files" / "quad.toml", tmp_path / "quad.toml")
    if "rest.bag" in section:
        pytest.importorskip("rosbags")
        write_bag(rest(), tmp_path / "rest.bag")
    if "rest.mat" in section:
        log = rest()
        scipy.io.savemat(tmp_path / "rest.mat", {s: triad(log, s) for s in ("gyro", "accel")} | {"fs": 100.0})
    if "flight.ulg" in section:
        pytest.importorskip("pyulog")
        write_ulog(flight(), tmp_path / "flight.ulg")
    for line in commands(section):
        words = shlex.split(line)
        done = subprocess.run(
            [sys.executable, "-m", *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{line}: {done.stderr}"
        if "-o" in words:
            assert (tmp_path / words[words.index("-o") + 1]).exists(), line
    if "improved.params" in section:
        text = (tmp_path / "improved.params").read_text(encoding="utf-8")
        (delay,) = re.findall(r"param set EKF2_GPS_DELAY ([\d.]+)", text)
        assert float(delay) == pytest.approx(200.0, abs=26.2)  # [ms]; three standard deviations
