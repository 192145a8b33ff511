"""Proves that a model which cannot be simulated over a log is refused with time and state, at once.

The times are those of the laws: ``x' = x^3`` from x0 ends at ``1 / (2 x0^2)``, ``x' = -sqrt(x)`` reaches zero at ``2 sqrt(x0)``.
"""

from __future__ import annotations

import re
import time

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.gap.plant.scene import PlantScene
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model
from kfgen.model.plant.plant import simulate

MODEL = """format = "kfgen-model-1"
name = "p"
[parameters]
tau = "0.1 s"
[states]
omega = { unit = "rad/s", initial = "2 rad/s" }
[inputs]
u = "V"
[dynamics]
omega = "(15*u - omega)/tau"
[measurements.speed]
unit = "rad/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.04 rad/s/sqrt(Hz)" } ]
"""
RIGHT = '"(15*u - omega)/tau"'
TIMES = np.arange(2000) * 0.01


def log() -> Log:
    """A motor of the first order, its input switched by turns."""
    u, x, speed = np.sign(np.sin(2.0 * TIMES + 0.1)), 0.0, np.empty(TIMES.size)
    for k in range(TIMES.size):
        speed[k] = x
        x = 15.0 * u[k] + (x - 15.0 * u[k]) * np.exp(-0.1)
    speed += 0.4 * np.random.default_rng(1).standard_normal(TIMES.size)
    return Log(TIMES, {"u": Channel.of(u, "V"), "speed": Channel.of(speed, "rad/s")})


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (RIGHT, '"15*u + omega**3"', r"(diverges|runs away:) at t = 0\.\d+ s"),
        (RIGHT, '"15*u - sqrt(omega)"', r"at t = \S+ s, with omega = -\S+ rad/s, the derivative of omega is no number"),
        ('tau = "0.1 s"', 'tau = "0 s"', r"at t = 0 s, with omega = \S+ rad/s, the derivative of omega is no number"),
        ('expression = "omega"', 'expression = "log(omega)"', r"at t = \S+ s, with omega = -\S+ rad/s, speed is no number"),
        (RIGHT, '"80*omega + 15*u"', r"runs away: at t = 0\.\d+ s omega = \S+ rad/s, far beyond the data"),
    ],
)  # fmt: skip
def test_a_model_that_cannot_be_simulated_over_the_log(old: str, new: str, what: str) -> None:
    begun = time.perf_counter()
    with pytest.raises(InputError, match=what) as error:
        PlantScene.of(parse_model(MODEL.replace(old, new), "p.toml"), log())
    assert time.perf_counter() - begun < 30.0
    assert error.value.exit_status == 2


def test_the_right_model_is_not_refused() -> None:
    assert PlantScene.of(parse_model(MODEL, "p.toml"), log()).starts == (0,)


@pytest.mark.parametrize(
    ("law", "end", "word"), [("omega**3", 0.125, "diverges"), ("-sqrt(omega)", 2.0 * np.sqrt(2.0), "cannot go on")]
)  # fmt: skip
def test_the_time_at_which_a_law_ends(law: str, end: float, word: str) -> None:
    """Within two samples: steps of a finite length go past a pole."""
    model = parse_model(MODEL.replace(RIGHT, f'"{law}"'), "p.toml")
    with pytest.raises(InputError, match=word) as error:
        simulate(model, TIMES, {"u": np.zeros(TIMES.size)})
    found = re.search(r"at t = ([\d.]+) s", str(error.value))
    assert found is not None
    assert float(found[1]) == pytest.approx(end, abs=0.0201)
