"""Proves that a sensor with another clock than its log says is named, and no other.

A log whose rate is stated too low by k has frequencies too low by k and N too high by the root of k. Fleets are drawn by
numpy with fixed seeds: N differs by 5 % between sensors, a corner by 3 %, a line not at all.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from kfgen.fleet.answer import Estimated, FoundEffect, Frequencies, LogAnswer
from kfgen.fleet.clock import clock_factors
from kfgen.fleet.fleet import fleet
from kfgen.fleet.journal import entry_of, outcome_of
from kfgen.fleet.result import Outcome
from kfgen.log.log import Channel, Log
from kfgen.report.fleet import fleet_answer

AXES = ("gyro_x", "gyro_y", "gyro_z")


def answer(
    rng: np.random.Generator, factor: float = 1.0, noise: float = 1.0, lines: bool = True
) -> LogAnswer:
    """A sensor of three axes, of which the first has a line."""
    effects, frequencies = [], {}
    for k, axis in enumerate(AXES):
        N = 1e-4 * noise * np.sqrt(factor) * np.exp(0.05 * rng.standard_normal())
        effects.append(
            FoundEffect(axis, "white_noise", {"N": Estimated(N, 0.99 * N, 1.01 * N, "rad/s/sqrt(Hz)")})
        )
        corner = 30.0 * np.exp(0.03 * rng.standard_normal()) / factor
        frequencies[axis] = Frequencies((21.3 / factor,) if lines and k == 0 else (), float(corner))
    return LogAnswer(tuple(effects), dict.fromkeys(AXES, "rad/s"), frequencies=frequencies)


@pytest.mark.parametrize("factor", [0.85, 1.15, 1.2])
def test_one_of_six_is_named_with_its_factor(factor: float) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        answers = {f"log{k}": answer(rng, factor if k == 3 else 1.0) for k in range(6)}
        (found,) = clock_factors(answers)
        assert found.log == "log3"
        assert found.factor == pytest.approx(factor, rel=0.05)
        assert "lines" in found.by
        assert "faster" in found.sentence if factor > 1 else "slower" in found.sentence


def test_sensors_of_one_clock_are_not_named() -> None:
    """200 fleets, with and without a line: none is named."""
    for seed in range(200):
        rng = np.random.default_rng(1000 + seed)
        assert clock_factors({f"log{k}": answer(rng, lines=bool(seed % 2)) for k in range(6)}) == ()


def test_noise_alone_or_too_few_sensors_are_no_clock() -> None:
    rng = np.random.default_rng(5)
    loud = {f"log{k}": answer(rng, noise=1.3 if k == 2 else 1.0) for k in range(6)}
    assert clock_factors(loud) == ()
    assert clock_factors({f"log{k}": answer(rng, 1.2 if k else 1.0) for k in range(3)}) == ()


def changed(own: LogAnswer, corners: tuple[float, ...], noises: tuple[float, ...]) -> LogAnswer:
    """A sensor with other corners and N, axis by axis, by factors."""
    effects = tuple(
        replace(e, parameters={"N": replace(N, value=k * N.value)})
        for e, k in zip(own.effects, noises)
        for N in e.parameters.values()
    )
    frequencies = {
        axis: replace(f, corner=k * f.corner) for (axis, f), k in zip(own.frequencies.items(), corners)
    }
    return replace(own, effects=effects, frequencies=frequencies)


def test_a_corner_that_is_far_off_is_no_clock() -> None:
    """As of a body-worn sensor of an older series: one corner four times as high, another one and N off both ways."""
    for seed in range(20):
        rng = np.random.default_rng(2000 + seed)
        answers = {f"log{k}": answer(rng, lines=False) for k in range(6)}
        answers["log2"] = changed(answers["log2"], (4.0, 1.35, 0.6), (0.75, 1.1, 0.8))
        assert clock_factors(answers) == ()


def test_a_line_in_its_place_refutes_a_clock() -> None:
    """Corners a third higher and N lower by the root of that, as of a clock; the line of all others is where theirs is."""
    for seed in range(20):
        rng = np.random.default_rng(3000 + seed)
        answers = {f"log{k}": answer(rng) for k in range(6)}
        answers["log2"] = changed(answers["log2"], (1.35,) * 3, (1.35**-0.5,) * 3)
        assert clock_factors(answers) == ()


def log(seed: int, rate: float, stated: float = 100.0) -> Log:
    """White noise behind a low-pass of 30 Hz, and a line at 4.3 Hz, sampled at `rate` and stated at another."""
    rng = np.random.default_rng(seed)
    n = 12_000
    b, a = butter(2, 30.0 / (rate / 2.0))
    y = lfilter(b, a, 0.01 * np.sqrt(rate) * rng.standard_normal(n))
    y = y + 0.02 * np.sin(2 * np.pi * 4.3 * np.arange(n) / rate)
    return Log(np.arange(n) / stated, {"gyro_x": Channel.of(y, "deg/s")}, f"unit{seed}.csv")


@pytest.mark.long
def test_a_fleet_of_logs_names_the_fast_one() -> None:
    found = fleet([log(k, 117.0 if k == 4 else 100.0) for k in range(6)], jobs=1)
    (clock,) = found.clocks
    assert clock.log == "unit4.csv"
    assert clock.ci95[0] < 1.17 < clock.ci95[1]
    assert set(clock.by) >= {"lines", "N"}
    said = fleet_answer(found)
    assert "unit4.csv: lines" in said.text
    assert "faster than its log says" in said.text
    assert "--rate" in said.text
    assert json.loads(json.dumps(found.to_dict()))["clocks"][0]["log"] == "unit4.csv"


def test_an_outcome_that_was_written_down_keeps_its_frequencies(tmp_path: Path) -> None:
    given = Outcome("a.csv", "0" * 64, answer(np.random.default_rng(1)))
    again = outcome_of(json.loads(json.dumps(entry_of(given))))
    assert again.answer is not None
    assert given.answer is not None
    assert again.answer.frequencies == given.answer.frequencies
