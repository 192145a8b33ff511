"""A propeller whose thrust goes with the square of its input, under a model that is linear in it.

The truth is integrated by scipy. The assumed parameters are as uncertain as they are large, so that the record cannot be
followed from what is assumed, and the model in pieces would explain itself away.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from kfgen.gap.find_gap import find_gap
from kfgen.gap.plant.scene import PlantScene
from kfgen.gap.scene.scene import start_of
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model
from kfgen.model.plant.plant import Plant

EXAMPLES = Path(__file__).parents[1] / "examples" / "recordings"
RATE_HZ = 20.0


@pytest.fixture
def model(monkeypatch: pytest.MonkeyPatch) -> Plant:
    """That of the example with a recording, for an angle with more noise."""
    monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])
    text = str(runpy.run_path(str(EXAMPLES / "quarter_drone.py"))["MODEL"])
    for of_recording, of_simulation in (("0.0007 deg", "0.02 deg"), ("3 deg", "0.3 deg")):
        assert of_recording in text
        text = text.replace(f'"{of_recording}', f'"{of_simulation}')
    return parse_model(text, "beam.toml")


def beam(seed: int, duration_s: float = 60.0) -> Log:
    """Steps of the input between 5 and 45 every two seconds; the angle's noise is as assumed."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    levels = rng.uniform(5.0, 45.0, int(duration_s / 2.0) + 1)
    u = levels[(t / 2.0).astype(int)]

    def law(s: float, x: list[float]) -> list[float]:
        v = u[min(int(s * RATE_HZ + 1e-9), u.size - 1)]
        return [x[1], -8.0 * np.sin(x[0]) - x[1] + 0.004 * v**2]

    found = solve_ivp(law, (0.0, t[-1]), [0.0, 0.0], t_eval=t, max_step=1.0 / RATE_HZ, rtol=1e-8, atol=1e-10)
    slow, a = np.zeros(t.size), np.exp(-1.0 / RATE_HZ)
    for k in range(1, t.size):
        slow[k] = a * slow[k - 1] + 0.3 * np.sqrt(1.0 - a**2) * rng.standard_normal()
    angle = np.degrees(found.y[0]) + slow + 0.02 * np.sqrt(RATE_HZ) * rng.standard_normal(t.size)
    return Log(t, {"angle": Channel.of(angle, "deg"), "u": Channel.of(u, "")}, source="beam")


@pytest.mark.long
def test_one_piece_is_fitted_where_every_guess_from_what_is_assumed_diverges(model: Plant) -> None:
    """A linear thrust that is fitted to a square one leaves a tenth of the motion's variance, over the whole record."""
    log = beam(2)
    scene = PlantScene.of(model, log)
    assert len(scene.starts) > 1
    whole = scene.in_one_piece()
    assert whole is not None
    assert whole.starts == (0,)
    assert whole.in_one_piece() is None
    left = np.degrees(whole.simulated(start_of(whole)).channels["angle"][:, 0]) - np.degrees(
        log.values("angle")
    )
    assert np.var(left) < 0.2 * np.var(np.degrees(log.values("angle")))
    assert whole.free_run(start_of(whole)) < scene.free_run(start_of(scene))


@pytest.mark.long
def test_a_square_law_is_named_and_its_share_is_found(model: Plant) -> None:
    """The interval holds the truth in 95 % of records; the name's chance is that of the search."""
    found = find_gap(beam(1), model)
    (first,) = (f for f in found.findings if f.name == "square_law")
    assert first.where == "u"
    lo, hi = first.ci95["share"]
    assert lo < 1.0 < hi
    assert hi - lo < 0.2
    assert found.verdict == "effects_found"
    assert found.comparisons[0].gap.closed > 0.9
