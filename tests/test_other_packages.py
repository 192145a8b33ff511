"""A package beside kfgen brings an effect, a sensor, a reader, a target and a consumer by its entry points."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from kfgen.consumers.base import Converted
from kfgen.effects.effect import LinearProcess, parameter
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.log.readers.arrays.named_arrays import Named, table_of
from kfgen.model.parts.aiding import Barometer


@dataclass(frozen=True)
class Tide(LinearProcess):
    coefficient: Any = parameter("U/V", "signed")
    name: ClassVar[str] = "tide"
    title: ClassVar[str] = "bias that follows the tide"
    sentence_template: ClassVar[str] = "follows the tide by {coefficient}"
    driver: ClassVar[str] = "voltage"

    def form(self, drive=None):
        away = drive["voltage"] if drive else 0.0
        return LinearSystem(((0,),), ((0,),), (away,), x0=(self.coefficient,), states=(State("tide", "U/V"),))

    @classmethod
    def starts(cls, look):
        return []


class TideGauge(Barometer):
    name, title, channels = "tide_gauge", "height by a tide gauge", ("tide",)


SUFFIXES = (".tide",)


def read(path: Path):
    import numpy as np
import pytest
    rows = np.loadtxt(path)
    return table_of(str(path), {"t": Named(rows[:, 0]), "baro_height [m]": Named(rows[:, 1])})


TARGET = TITLE = "tides"
NAME, SOURCE, RATE, NEEDS = "tides", "the tests", "", ()


def files(program):
    return {}


def convert(imu):
    return Converted("low and high", {})
"""
ASKED = """
from kfgen.consumers import consumers
from kfgen.effects import make
from kfgen.emit import targets
from kfgen.log.readers import read_log
from kfgen.model.parts.sensors import sensors
print(make("tide", coefficient=1.0).title)
print(sensors()["tide_gauge"].title)
print(read_log("x.tide").values("baro_height").tolist())
print("tides" in targets(), consumers()["tides"].convert(None).text)
"""
KINDS = ("effects", "sensors", "readers", "targets", "consumers")


def installed(folder: Path, module: str) -> dict[str, str]:
    """A package with that module in a folder, and the environment in which Python finds it."""
    (folder / "tides.py").write_text(module)
    info = folder / "tides-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tides\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("".join(f"[kfgen.{k}]\ntides = tides\n" for k in KINDS))
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])}


def asked(folder: Path, environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.long
def test_what_a_package_brings_is_known(tmp_path: Path) -> None:
    (tmp_path / "x.tide").write_text("".join(f"{k * 0.1:.1f} {k}\n" for k in range(4)))
    done = asked(tmp_path, installed(tmp_path, MODULE), "-c", ASKED)
    assert done.stdout.splitlines() == [
        "bias that follows the tide",
        "height by a tide gauge",
        "[0.0, 1.0, 2.0, 3.0]",
        "True low and high",
    ], done.stderr


def test_a_package_that_fails_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("t [s],x [1]\n0,1\n1,2\n")
    environment = installed(tmp_path, "import nothing_of_that_name\n")
    done = asked(tmp_path, environment, "-m", "kfgen", "list", "x.csv")
    assert done.returncode == 2
    assert "the readers 'tides' of the package tides cannot be imported" in done.stderr
    assert "Update tides, or uninstall it" in done.stderr
