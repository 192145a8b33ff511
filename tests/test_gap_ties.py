"""Proves that of two names that a record cannot distinguish the one that physics suggests comes first, the other beside it.

A tank ``h' = 2e-3 u - 0.01 h - q`` in closed form; its level is always positive, so that a constant outflow and dry
friction of the level are the same.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from kfgen.gap.plant.candidates import additions
from kfgen.model.plant.file import parse_model

Cli = Callable[..., Result]

TANK = """format = "kfgen-model-1"
name = "tank"
[parameters]
c = "0.01 1/s"
[states]
h = "m"
[inputs]
pump = "V"
[dynamics]
h = "2e-3*pump - c*h"
[measurements.level]
unit = "cm"
expression = "h"
effects = [ { effect = "white_noise", N = "0.2 cm/sqrt(Hz)" } ]
"""
ARM = """format = "kfgen-model-1"
name = "arm"
[states]
x = "mm"
v = "mm/s"
turn = "deg/s"
i = "A"
p = "Pa"
fast = "Pa/s"
[inputs]
u = "V"
[dynamics]
x = "v"
v = "u - x"
turn = "u - turn"
i = "u - i"
p = "fast"
fast = "u - p"
[measurements.i]
unit = "A"
expression = "i"
effects = [ { effect = "white_noise", N = "1 A/sqrt(Hz)" } ]
"""


@pytest.mark.long
def test_a_constant_outflow_is_no_friction(kfgen: Cli, tmp_path: Path) -> None:
    rng, h, rows = np.random.default_rng(8), 0.5, []
    for k, u in enumerate(np.repeat(rng.uniform(2.0, 4.5, 20), 60)):
        rows.append([2.0 * k, u, 100.0 * h])
        rest = (2e-3 * u - 5e-4) / 0.01
        h = rest + (h - rest) * np.exp(-0.02)
    table = np.array(rows)
    assert table[:, 2].min() > 1.0
    table[:, 2] += 0.2 / np.sqrt(2.0) * rng.standard_normal(len(rows))
    path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
    np.savetxt(path, table, delimiter=",", header="t [s],pump [V],level [cm]", comments="", fmt="%.12g")
    model.write_text(TANK, encoding="utf-8")
    done = kfgen("gap", path, "--model", model, "--json", out)
    assert done.exit_code == 0, done.output
    (step,) = json.loads(out.read_text(encoding="utf-8"))["steps"]
    assert (step["effect"], step["channel"]) == ("constant_input", "h")
    assert step["indistinguishable"] == ["coulomb_friction"]
    lo, hi = step["parameters"]["value"]["ci95"]
    assert abs(-5e-4 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo) < 2e-5


def test_friction_is_rarer_where_nothing_moves() -> None:
    """A speed is one by its unit, or since it is the rate of another state; anything may lose in proportion."""
    model = parse_model(ARM, "arm.toml")
    found = additions(model, {}, dict.fromkeys(model.states, 1.0), {}, (0.01, 10.0, 0.0), [])
    for name, elsewhere in (("coulomb_friction", 2.0), ("quadratic_drag", 2.0), ("viscous_friction", 0.0)):
        rare = {c[0].where: c[0].prior_penalty_nats for c in found if c[0].effect.name == name}
        assert set(rare) == {"v", "turn", "i", "fast"}
        assert rare["v"] == rare["turn"] == rare["fast"]
        assert rare["i"] - rare["v"] == pytest.approx(elsewhere)
