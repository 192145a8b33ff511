"""Proves that an input which never changes is said, and that what it cannot have caused gets no name.

The motor is the exact solution of ``v' = (15 u - v) / 0.12``. A sound log is falsely alarmed at 0.2 % by the battery.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

Array = NDArray[np.float64]
Cli = Callable[..., Result]

MODEL = """format = "kfgen-model-1"
name = "motor"
[parameters]
tau = "0.12 s"
[states]
omega = "rad/s"
[inputs]
u = "V"
[dynamics]
omega = "(15*u - omega)/tau"
[measurements.speed]
unit = "rad/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.04 rad/s/sqrt(Hz)" } ]
"""


@pytest.fixture
def asked(kfgen: Cli, tmp_path: Path) -> Callable[..., tuple[dict[str, Any], str]]:
    def ask(u: Array, logged: Array, lost: float, v: float) -> tuple[dict[str, Any], str]:
        """Speed under `u` beside another torque `lost` against the motion; the log has `logged` in its place."""
        rows, rate, rng = [], 1.0 / 0.12 + lost, np.random.default_rng(6)
        for k in range(u.size):
            rows.append([0.01 * k, logged[k], v])
            rest = 15.0 * u[k] / 0.12 / rate
            v = rest + (v - rest) * np.exp(-0.01 * rate)
        table = np.array(rows)
        table[:, 2] += 0.4 * rng.standard_normal(u.size)
        path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
        np.savetxt(path, table, delimiter=",", header="t [s],u [V],speed [rad/s]", comments="", fmt="%.12g")
        model.write_text(MODEL, encoding="utf-8")
        done = kfgen("gap", path, "--model", model, "--json", out)
        assert done.exit_code == 0, done.output
        found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
        return found, done.output + done.stderr

    return ask


SAID = "the input u never changes: no effect of it can be seen"


@pytest.mark.long
def test_a_motion_that_a_constant_input_cannot_cause(asked: Any) -> None:
    u = np.repeat(np.random.default_rng(7).uniform(-6.0, 6.0, 10), 80)
    answer, words = asked(u, np.ones(u.size), 0.0, 0.0)
    assert (answer["verdict"], answer["steps"], answer["warnings"]) == ("bad_data", [], [SAID])
    assert "not driven by the input u, which never changes" in words
    assert SAID in words


@pytest.mark.long
def test_a_constant_input_is_no_fault_by_itself(asked: Any) -> None:
    """Running up under a constant voltage is what the model says; what slows it is found."""
    answer, words = asked(np.ones(800), np.ones(800), 0.0, -40.0)
    assert (answer["verdict"], answer["steps"]) == ("no_gap", [])
    assert SAID in words
    answer, _ = asked(np.ones(800), np.ones(800), 2.0, -40.0)
    assert answer["verdict"] == "effects_found"
    names = {answer["steps"][0]["effect"], *answer["steps"][0]["indistinguishable"]}
    assert "viscous_friction" in names
    assert answer["warnings"] == [SAID]
