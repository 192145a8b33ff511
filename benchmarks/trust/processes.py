"""Every command that writes, as processes that can be killed or starved: words, inputs and outputs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

MARK = "made before"
"""What an output holds before a command runs over it."""
COMMANDS: dict[str, tuple[list[str], list[str]]] = {
    "identify": (["identify", "log.csv", "--effects", "white_noise", "-o", "n.toml", "--json", "a.json", "--report", "r.html"], ["n.toml", "a.json", "r.html"]),
    "plan": (["plan", "noise.toml", "--json", "a.json", "--report", "r.html"], ["a.json", "r.html"]),
    "convert": (["convert", "noise.toml", "--to", "kalibr", "--rate", "100", "-o", "imu.yaml", "--json", "a.json"], ["imu.yaml", "a.json"]),
    "gap": (["gap", "log.csv", "--model", "noise.toml", "-o", "n.toml", "--json", "a.json", "--report", "r.html"], ["n.toml", "a.json", "r.html"]),
    "derive": (["derive", "ahrs6", "--json", "a.json", "--report", "r.html"], ["a.json", "r.html"]),
    "audit": (["audit", "gyro-static", "--json", "a.json", "--report", "r.html"], ["a.json", "r.html"]),
    "simulate": (["simulate", "gyro-static", "--duration", "400", "-o", "s.csv", "--json", "a.json"], ["s.csv", "a.json"]),
    "simulate npz": (["simulate", "ahrs6", "--duration", "20", "-o", "s.npz"], ["s.npz"]),
    "emit": (["emit", "gyro-static", "--target", "c", "-o", "code", "--force", "--json", "a.json"], ["code/main.c", "code/selftest.c", "a.json"]),
    "run": (["run", "gyro-static", "log.csv", "--noise", "noise.toml", "-o", "e.csv", "--json", "a.json"], ["e.csv", "a.json"]),
    "denoise": (["denoise", "log.csv", "--filter", "kf", "-o", "d.csv", "--json", "a.json"], ["d.csv", "a.json"]),
    "calibrate": (["calibrate", "turned.csv", "--field", "48 uT", "-o", "c.toml", "--json", "a.json"], ["c.toml", "a.json"]),
    "fleet": (["fleet", "log*.csv", "--jobs", "2", "-o", "n.toml", "--json", "f.json", "--report", "r.html"], ["n.toml", "f.json", "r.html"]),
    "fleet --model": (["fleet", "log*.csv", "--model", "noise.toml", "--jobs", "2", "--json", "f.json"], ["f.json"]),
    "demo": (["demo", "--out", "out", "--json", "a.json"], ["a.json"]),
}  # fmt: skip
"""Commands with their outputs."""
LOGS, SAMPLES = 2, 3000


def prepared(folder: Path) -> None:
    """The inputs of every command, in a new folder."""
    folder.mkdir()
    for k in range(LOGS):
        y = 0.05 * np.random.default_rng(k).standard_normal(SAMPLES)
        rows = np.column_stack([np.arange(SAMPLES) / 100.0, y])
        name = folder / f"log{k or ''}.csv"
        np.savetxt(name, rows, delimiter=",", header="t [s],gyro_x [deg/s]", comments="", fmt="%.9g")
    text = 'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\neffects = [{effect="white_noise", N="0.006 deg/s/sqrt(Hz)"}]\n'
    accel = '[accel_x]\nunit = "m/s^2"\neffects = [{effect="white_noise", N=1e-3}]\n'
    (folder / "noise.toml").write_text(text + accel, encoding="utf-8")
    k = np.arange(SAMPLES)
    z, turn = np.cos(np.pi * k / SAMPLES), 20.0 * np.pi * k / SAMPLES
    unit = np.column_stack([np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z])
    m = 48.0 * unit + [3.0, -2.0, 1.0] + 0.3 * np.random.default_rng(0).standard_normal(unit.shape)
    head = "t [s]," + ",".join(f"mag_{a} [uT]" for a in "xyz")
    rows = np.column_stack([np.arange(SAMPLES) / 100.0, m])
    np.savetxt(folder / "turned.csv", rows, delimiter=",", header=head, comments="", fmt="%.9g")


def started(
    words: list[str], folder: Path, says: int = subprocess.DEVNULL, largest: int = 0
) -> subprocess.Popen[str]:
    """The command as a process of its own group; what it says on standard error goes to `says`.

    With a `largest` size [bytes] no file of the process grows beyond it.
    """
    limit = f"import resource as r; r.setrlimit(r.RLIMIT_FSIZE, ({largest}, {largest})); " if largest else ""
    program = [sys.executable, "-c", limit + "from kfgen.cli import main; main()", *words]
    same_day = os.environ | {"SOURCE_DATE_EPOCH": "0"}  # a page says when it was made
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        program, cwd=folder, stdout=quiet, stderr=says, start_new_session=True, text=True, env=same_day
    )


def contents(folder: Path, outputs: list[str]) -> list[bytes | None]:
    """The bytes of each output; None where it is gone."""
    return [(folder / one).read_bytes() if (folder / one).is_file() else None for one in outputs]


def temporary(folder: Path) -> list[str]:
    """Names in a folder that unfinished outputs have."""
    with os.scandir(folder) as entries:
        return [e.name for e in entries if e.name.startswith(".") and ".kfgen" in e.name]
