"""Proves the supervisor in flight: emitted C, S-turns at 20 m/s with GNSS at 10 Hz, one fault at a time from 60 s on.

For each fault: it is said within a second, the position is within three standard deviations again within ten seconds
of the fault's end and stays there, no word is ever infinite or no number, and the filter is never wrong while it says
OK for longer than a second. `tests/flight/faults.c` flies; a flight takes a fifth of a second.
"""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from kfgen.emit.routines import Program
from kfgen.emit.targets.c import header
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build

SOURCE = Path(__file__).parent / "flight" / "faults.c"
FAULTS = {
    "1 s of a gyro that is no number": 1,
    "dt = 0 for 5 s": 2,
    "one dt of 10 s": 3,
    "30 s of a stuck accelerometer": 4,
    "30 s of frozen GNSS": 5,
    "heading 120 deg off": 6,
    "a permanent jump of 1 km": 7,
    "one gyro sample of 1e8 rad/s": 8,
    "one accelerometer sample of 1e10 m/s^2": 9,
    "0.5 s of an infinite accelerometer": 10,
    "5 s of GNSS that is no number": 11,
    "20 s without GNSS": 12,
    "10 s of spikes of 300 m and 300 m/s": 13,
    "1 s of a negative dt": 14,
    "5 s of a stuck gyro": 15,
    "0.5 s without a call": 16,
}
OUTAGE = "20 s without GNSS"
SAID_WITHIN_S = 1.0
RIGHT_WITHIN_S = 10.0


@dataclass(frozen=True)
class Flight:
    """What a flight prints: times [s], error [m], words that were not finite."""

    said: float
    right: float
    wrong_and_ok: float
    worst: float
    spoiled: int
    ok: float


@cache
def program(folder: Path, form: str, real: str) -> Path:
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    text = header(Program(DiscreteModel(build("ins15")), form, real))
    (folder / "ins15.h").write_text(text, encoding="utf-8")
    flags = ["-std=c99", "-O1", "-ffp-contract=off", "-D_GNU_SOURCE", f"-DREAL={real}", f"-I{folder}"]
    subprocess.run(["gcc", *flags, str(SOURCE), "-o", str(folder / "fly"), "-lm"], check=True)
    return folder / "fly"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flight")


def fly(folder: Path, fault: int, seed: int, form: str = "ud", real: str = "float") -> Flight:
    own = folder / f"{form}-{real}"
    own.mkdir(exist_ok=True)
    words = [str(program(own, form, real)), str(fault), str(seed)]
    said, right, wrong, worst, spoiled, ok = subprocess.run(
        words, check=True, capture_output=True, text=True
    ).stdout.split()
    return Flight(float(said), float(right), float(wrong), float(worst), int(spoiled), float(ok))


def judged(name: str, flight: Flight) -> None:
    assert flight.spoiled == 0
    assert flight.said >= 0.0
    if name != OUTAGE:  # samples that do not come are no fault until the age says so
        assert flight.said <= SAID_WITHIN_S
    assert flight.right <= RIGHT_WITHIN_S
    assert flight.wrong_and_ok <= SAID_WITHIN_S


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_said_and_the_filter_recovers(name: str, folder: Path) -> None:
    for seed in (1, 2):
        judged(name, fly(folder, FAULTS[name], seed))


def test_without_a_fault_nothing_is_said(folder: Path) -> None:
    for seed in range(1, 6):
        flight = fly(folder, 0, seed)
        assert (flight.said, flight.right, flight.wrong_and_ok, flight.spoiled) == (-1.0, 0.0, 0.0, 0)
        assert flight.worst < 5.0


@pytest.mark.long
@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize(
    ("form", "real"), [("ud", "float"), ("ud", "double"), ("p", "float"), ("p", "double")]
)
def test_in_every_form_over_many_seeds(name: str, form: str, real: str, folder: Path) -> None:
    for seed in range(1, 21):
        judged(name, fly(folder, FAULTS[name], seed, form, real))
