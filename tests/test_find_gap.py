"""Proves `find_gap` from Python: whatever stands for the model, one result, which says itself in a few lines and in JSON.

Records are plain numpy; a temperature term of 0.2 per kelvin in unit white noise over 4000 samples is worth hundreds of nats.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, parse_noise, read_noise, write_noise
from kfgen.gap.find_gap import find_gap
from kfgen.gap.result import GapResult
from kfgen.log.log import Channel, Log
from kfgen.log.readers import write_log
from kfgen.model.plant.file import parse_model
from kfgen.model.plant.user import UserModel
from kfgen.report.gap import gap_answer

N, DT = 4000, 0.1
T = np.arange(N) * DT
HEAT = 300.0 + 4.0 * np.sin(T / 60.0) + T / 100.0
WHITE = Term(make("white_noise", N=np.sqrt(DT)))
MODEL = NoiseModel({a: ChannelNoise("rad/s", (WHITE,)) for a in ("gyro_x", "gyro_y", "gyro_z")})


def log_of(coefficient: float, seed: int = 1) -> Log:
    rng = np.random.default_rng(seed)
    y = rng.standard_normal((2, N))
    channels = {
        "gyro_x": Channel(y[0] + coefficient * (HEAT - 300.0), "rad/s"),
        "gyro_y": Channel(y[1], "rad/s"),
        "temperature": Channel(HEAT, "K"),
    }
    return Log(T, channels, "record")


@pytest.fixture(scope="module")
def warm() -> GapResult:
    return find_gap(log_of(0.2), MODEL)


@pytest.mark.long
def test_a_result_says_what_was_found(warm: GapResult) -> None:
    assert warm.verdict == "effects_found"
    (found,) = warm.findings
    assert (found.name, found.where, found.unit, found.once) == ("temperature", "gyro_x", "rad/s", False)
    lo, hi = found.ci95["coefficient"]
    assert abs(0.2 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    assert found.evidence_nats > 50.0
    assert found.test is not None
    assert found.test.channel == "gyro_x"
    lines = repr(warm).splitlines()
    assert 1 <= len(lines) <= 5
    assert lines[1].startswith("temperature of gyro_x (")
    assert "after none above chance" in lines[2]
    head, rows = warm.short_table()
    assert [len(r) for r in rows] == [len(head)]
    with pytest.raises(dataclasses.FrozenInstanceError):
        warm.warnings = ()  # type: ignore[misc]


def test_every_channel_that_both_have_is_compared(warm: GapResult) -> None:
    assert [c.channels for c in warm.comparisons] == [("gyro_x",), ("gyro_y",)]
    assert [c.verdict for c in warm.comparisons] == ["effects_found", "no_gap"]
    assert warm.warnings == ("gyro_z of the noise model cannot be compared: the log lacks it",)
    (alone,) = find_gap(log_of(0.2), MODEL, channels="gyro_y").comparisons
    assert alone.channels == ("gyro_y",)


def test_the_updated_model_is_a_model(warm: GapResult) -> None:
    assert isinstance(warm.improved, NoiseModel)
    assert [e.name for e in warm.improved.channel("gyro_x").effects] == ["white_noise", "temperature"]
    assert parse_noise(warm.updated_text, "updated").channel("gyro_x").effects
    (assumed,) = parse_noise(warm.assumed_text, "assumed").channel("gyro_x").effects
    assert assumed.name == "white_noise"
    again = find_gap(log_of(0.2), warm.improved, channels=["gyro_x"])
    assert (again.verdict, again.findings) == ("no_gap", ())


@pytest.mark.long
def test_the_command_line_only_presents(
    warm: GapResult, kfgen: Callable[..., Result], tmp_path: Path
) -> None:
    """A log and a model from files give the numbers that they give from memory, and the text of the report."""
    write_log(log_of(0.2), tmp_path / "log.npz")
    write_noise(MODEL, tmp_path / "noise.toml")
    done = kfgen(
        "gap", tmp_path / "log.npz", "--model", tmp_path / "noise.toml", "--json", tmp_path / "gap.json"
    )
    assert done.exit_code == 0, done.output
    data, mine = json.loads((tmp_path / "gap.json").read_text()), json.loads(json.dumps(warm.to_dict()))
    differing = {"log", "sha256", "warnings", "localised", "steps", "gap", "remaining", "checks", "limits"}
    assert {k: v for k, v in data.items() if k not in differing} == {
        k: v for k, v in mine.items() if k not in differing
    }
    assert data["steps"][0]["evidence_nats"] == pytest.approx(mine["steps"][0]["evidence_nats"], rel=1e-6)
    text = gap_answer(find_gap(tmp_path / "log.npz", tmp_path / "noise.toml")).text
    assert text in done.output
    assert read_noise(tmp_path / "noise.toml").channels


def test_the_answer_uses_one_vocabulary(warm: GapResult) -> None:
    text = gap_answer(warm).text
    for words in ("The model of gyro_x is missing an effect", "Detection limits", "held-out mismatch before"):
        assert words in text
    assert "--- assumed\n+++ updated" in text


def plant() -> UserModel:
    text = """format = "kfgen-model-1"
name = "motor"
[states]
omega = { unit = "rad/s", initial = "0 rad/s", sd = "0.1 rad/s" }
[inputs]
u = "V"
[dynamics]
omega = "(10*u - omega)/0.4"
[measurements.speed]
unit = "rad/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.05 rad/s/sqrt(Hz)" } ]
"""
    return parse_model(text, "motor.toml")


def test_a_plant_is_compared_by_its_model() -> None:
    """The exact response of a first-order lag to a held input."""
    rng, t = np.random.default_rng(4), np.arange(800) * 0.05
    u = np.repeat(rng.uniform(-3.0, 3.0, 40), 20)
    a, omega = np.exp(-0.05 / 0.4), np.zeros(800)
    for k in range(799):
        omega[k + 1] = a * omega[k] + (1.0 - a) * 10.0 * u[k]
    y = omega + 0.05 / np.sqrt(0.05) * rng.standard_normal(800)
    log = Log(t, {"u": Channel(u, "V"), "speed": Channel(y, "rad/s")}, "bench")
    found = find_gap(log, plant())
    assert (found.verdict, found.findings) == ("no_gap", ())
    assert isinstance(found.improved, UserModel)
    assert [c.channels for c in found.comparisons] == [("speed",)]
    with pytest.raises(InputError, match="at rest only"):
        find_gap(log, plant(), proof=[log])
    with pytest.raises(InputError, match="of a plant are not compared together"):
        find_gap([log, log], plant())


@pytest.mark.long
def test_recordings_in_memory_are_compared_together() -> None:
    logs = [log_of(0.2, seed) for seed in (1, 2)]
    logs = [dataclasses.replace(log, source=f"record {k}") for k, log in enumerate(logs)]
    found = find_gap(logs, MODEL, channels=["gyro_x"])
    assert [f.name for f in found.findings] == ["temperature"]
    assert [r.name for r in found.recordings] == ["record 0", "record 1"]
    assert [r["log"] for r in found.to_dict()["recordings"]] == ["record 0", "record 1"]
    assert found.gap.held_out == "each recording in turn"


def test_what_cannot_be_compared_is_refused() -> None:
    log = log_of(0.0)
    with pytest.raises(InputError, match="no log to compare"):
        find_gap([], MODEL)
    with pytest.raises(InputError, match="no channel of the noise model is in the log"):
        find_gap(log, NoiseModel({"accel_x": ChannelNoise("m/s^2", (WHITE,))}))
    with pytest.raises(InputError, match=r"gyro_x is in rad/s in the log, in m/s\^2"):
        find_gap(log, NoiseModel({"gyro_x": ChannelNoise("m/s^2", (WHITE,))}))
