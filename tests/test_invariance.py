"""Proves that an answer is of the sensor: not of the unit, the origin of time, the order of channels, the kind of number
or the threads. Where nothing but rounding can differ, answers agree to 1e-6; the same seed gives the same bytes.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from typer.testing import Result

from kfgen.audit.audit import audit
from kfgen.audit.degree import Horizon
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.find_gap import find_gap
from kfgen.identify.identify_log import identify
from kfgen.log.log import Channel, Log
from kfgen.log.readers import read_log
from kfgen.model.library import build

Cli = Callable[..., Result]
Numbers = dict[tuple[str, str, str], float]
N_SAMPLES, DT, SAME = 4000, 0.01, 1e-6
FACTORS = (1e-9, 1e-3, 1e9)
SIZES = {"N", "sigma", "amplitude", "rms", "size", "K", "Q", "B"}
"""Parameters that are in units of the channel."""


def samples(seed: int) -> np.ndarray:
    """White noise with a Gauss-Markov process of half a second [rad/s]."""
    rng = np.random.default_rng(seed)
    drive = 0.05 * np.sqrt(1.0 - np.exp(-2.0 * DT / 0.5)) * rng.standard_normal(N_SAMPLES)
    slow = np.zeros(N_SAMPLES)
    for k in range(1, N_SAMPLES):
        slow[k] = slow[k - 1] * np.exp(-DT / 0.5) + drive[k]
    return 0.1 * rng.standard_normal(N_SAMPLES) + slow


Y = {"gyro_x": samples(1), "gyro_y": samples(2)}


def log(
    factor: float = 1.0, since: float = 0.0, names: tuple[str, ...] = tuple(Y), kind: type = float
) -> Log:
    t = since + DT * np.arange(N_SAMPLES)
    return Log(t, {n: Channel((factor * Y[n]).astype(kind), "rad/s") for n in names})


def identified(record: Log) -> Numbers:
    found = identify(record, effects="white_noise,gauss_markov")
    return {
        (name, e.name, p): value
        for name, channel in found.channels.items()
        for e in channel.effects
        for p, value in e.values.items()
    }


HIDDEN_HZ, SHORT = 7.3, 1200


def with_a_line(
    factor: float = 1.0, since: float = 0.0, names: tuple[str, ...] = tuple(Y), kind: type = float
) -> dict[str, Any]:
    """What the gap says of white noise with a line in one of two channels: all without a unit."""
    rng, t = np.random.default_rng(1), DT * np.arange(SHORT)
    y = {n: 0.1 * rng.standard_normal(SHORT) for n in Y}
    y["gyro_x"] += 0.1 * np.sin(2.0 * np.pi * HIDDEN_HZ * t)
    white = (Term(make("white_noise", N=0.1 * np.sqrt(DT) * factor)),)
    record = Log(since + t, {n: Channel((factor * y[n]).astype(kind), "rad/s") for n in names})
    found = find_gap(record, NoiseModel({n: ChannelNoise("rad/s", white) for n in names}))
    numbers = [found.gap.before, found.gap.after, *(f.probability for f in found.findings)]
    return {"names": [(f.where, f.name) for f in found.findings], "numbers": numbers}


def scaled(numbers: Numbers, factor: float) -> Numbers:
    return {k: v * factor if k[2] in SIZES else v for k, v in numbers.items()}


def same(a: dict[str, Any], b: dict[str, Any], rel: float = SAME) -> bool:
    return bool(a["names"] == b["names"] and a["numbers"] == pytest.approx(b["numbers"], rel=rel))


@pytest.fixture(scope="module")
def numbers() -> Numbers:
    found = identified(log())
    assert {k[1:] for k in found} == {
        ("white_noise", "N"),
        ("gauss_markov", "sigma"),
        ("gauss_markov", "tau"),
    }
    return found


@pytest.fixture(scope="module")
def gap() -> dict[str, Any]:
    found = with_a_line()
    assert found["names"] == [("gyro_x", "sinusoid")]
    return found


@pytest.mark.parametrize("factor", FACTORS)
def test_identify_in_another_unit(numbers: Numbers, factor: float) -> None:
    assert identified(log(factor)) == pytest.approx(scaled(numbers, factor), rel=SAME)


@pytest.mark.parametrize("since", [-1e4, 3e5])
def test_identify_from_another_origin_of_time(numbers: Numbers, since: float) -> None:
    assert identified(log(since=since)) == pytest.approx(numbers, rel=SAME)


def test_identify_of_channels_in_another_order(numbers: Numbers) -> None:
    assert identified(log(names=("gyro_y", "gyro_x"))) == numbers


def test_identify_of_a_file_in_single_precision(numbers: Numbers, tmp_path: Path) -> None:
    """The same numbers, stored in four bytes or in eight; a sample rounded by 6e-8 of itself moves them little."""
    y = np.column_stack([v.astype(np.float32) for v in Y.values()])
    found = []
    for kind in (np.float32, np.float64):
        np.save(tmp_path / "log.npy", y.astype(kind))
        read = read_log(tmp_path / "log.npy", columns="gyro_x=#1 [rad/s], gyro_y=#2 [rad/s]", rate=1.0 / DT)
        found.append(identified(read))
    assert found[0] == pytest.approx(found[1], rel=SAME)
    assert found[0] == pytest.approx(numbers, rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("factor", in_part([1e-9, 1e9]))
def test_the_gap_in_another_unit(gap: dict[str, Any], factor: float) -> None:
    """At 1e-9 a telegraph was named before: its middle was drawn within 1e-4 SI."""
    assert same(with_a_line(factor), gap)


def test_the_gap_from_another_origin_of_time_and_in_another_order(gap: dict[str, Any]) -> None:
    assert same(with_a_line(since=-1e4, names=("gyro_y", "gyro_x")), gap)


def test_the_gap_of_single_precision(gap: dict[str, Any]) -> None:
    assert same(with_a_line(kind=np.float32), gap, 1e-4)


def test_an_audit_of_sensors_in_another_order() -> None:
    """Readings of one instant tell the same in whichever order they are taken."""

    def deviations(order: str) -> dict[str, list[float]]:
        model = build("ins15", options={"sensors": order})
        run = audit(model, horizon=Horizon(duration=5.0, rate=20.0)).audits[0].degree
        assert run is not None
        return {s.name: list(run.sigma[-1:, k]) for k, s in enumerate(model.states)}

    one, other = deviations("gnss_position,gnss_velocity,mag"), deviations("mag,gnss_velocity,gnss_position")
    assert other == {k: pytest.approx(v, rel=SAME) for k, v in one.items()}


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_the_same_seed_gives_the_same_bytes(suffix: str, tmp_path: Path, kfgen: Cli) -> None:
    made = []
    for k, seed in enumerate((7, 7, 8)):
        path = tmp_path / f"{k}.{suffix}"
        words = ["simulate", "ahrs6", "--duration", 2, "--manoeuvre", "yaw-turn", "--seed", seed, "-o", path]
        assert kfgen(*words).exit_code == 0
        made.append(path.read_bytes())
    assert made[0] == made[1]
    assert made[0] != made[2]


@pytest.mark.long
def test_threads_change_no_byte_of_an_answer(tmp_path: Path) -> None:
    y = log()
    table = np.column_stack([y.t, y.values("gyro_x")])
    np.savetxt(
        tmp_path / "log.csv", table, delimiter=",", header="t [s],gyro_x [rad/s]", comments="", fmt="%.17g"
    )
    words = ["identify", "log.csv", "--effects", "white_noise,gauss_markov", "--json", "-"]
    said = []
    for threads in ("1", "2"):
        use = {f"{library}_NUM_THREADS": threads for library in ("OMP", "OPENBLAS", "NUMBA")}
        done = subprocess.run(
            [sys.executable, "-m", "kfgen", *words],
            cwd=tmp_path,
            env=os.environ | use,
            capture_output=True,
            check=True,
        )
        said.append(done.stdout)
    assert said[0] == said[1]
    assert b"gauss_markov" in said[0]
