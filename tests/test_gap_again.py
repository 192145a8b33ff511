"""What was found in one recording, held against another one of the same sensor."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

N, DT = 12_000, 0.1
NOISE = """format = "kfgen-noise-1"
[gyro_x]
unit = "deg/s"
effects = [ { effect = "white_noise", N = "0.0035 deg/s/sqrt(Hz)" } ]
"""


def recording_at(path: Path, seed: int, *, temperature: float, step: float) -> Path:
    """Noise, a temperature term, a line whose phase is another one each time, and a step."""
    rng, t = np.random.default_rng(seed), np.arange(N) * DT
    T = 25.0 + 5.0 * np.sin(t / (150.0 + 30.0 * seed)) + 0.02 * rng.standard_normal(N)
    y = 0.0035 / np.sqrt(DT) * rng.standard_normal(N) + temperature * (T - 25.0)
    y += 0.01 * np.sin(2.0 * np.pi * 1.7 * t + seed) + step * (t > 500.0)
    header = "t [s],gyro_x [deg/s],temperature [degC]"
    np.savetxt(path, np.column_stack([t, y, T]), delimiter=",", header=header, comments="")
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    ("coefficient", "least", "most"),
    [(0.002, 0.95, 1.0), pytest.param(-0.002, -1.0, 0.2, marks=pytest.mark.long)],
)
def test_what_comes_again_closes_and_what_does_not_opens(
    tmp_path: Path, kfgen: Callable[..., Result], coefficient: float, least: float, most: float
) -> None:
    """A temperature term of the other sign in the second recording makes the updated model the worse one."""
    first = recording_at(tmp_path / "first.csv", 0, temperature=0.002, step=0.008)
    second = recording_at(tmp_path / "second.csv", 1, temperature=coefficient, step=0.0)
    (tmp_path / "noise.toml").write_text(NOISE)
    to = tmp_path / "gap.json"
    done = kfgen("gap", first, "--model", tmp_path / "noise.toml", "--proof", second, "--json", to)
    assert done.exit_code == 0, done.output
    answer = json.loads(to.read_text())
    assert {s["effect"] for s in answer["steps"]} == {"temperature", "sinusoid", "bias_step"}
    (proof,) = answer["proofs"]
    assert proof["before"] > 0.01
    assert least <= proof["closed_fraction"] <= most
    assert "step of the bias: happened once" in done.output


def test_a_plant_has_no_other_recording(tmp_path: Path, kfgen: Callable[..., Result]) -> None:
    first = recording_at(tmp_path / "first.csv", 0, temperature=0.0, step=0.0)
    model = tmp_path / "plant.toml"
    text = 'format = "kfgen-model-1"\nname = "p"\n[states]\nx = "rad"\n[dynamics]\nx = "0"\n'
    text += '[measurements.gyro_x]\nunit = "deg/s"\nexpression = "x"\n'
    model.write_text(text + 'effects = [ { effect = "white_noise", N = "0.0035 deg/s/sqrt(Hz)" } ]\n')
    done = kfgen("gap", first, "--model", model, "--proof", first)
    assert done.exit_code == 2
    assert "at rest only" in str(done.exception) + done.output


def test_what_has_a_driver_comes_again() -> None:
    """A hysteresis of the temperature has a width that was looked for, and no time at which it happened."""
    from kfgen.effects import effect_named
    from kfgen.gap.rest.second_recording import happens_once

    once = {
        n
        for n in ("bias_step", "noise_change", "thermal_hysteresis", "temperature")
        if happens_once(effect_named(n))
    }
    assert once == {"bias_step", "noise_change"}
