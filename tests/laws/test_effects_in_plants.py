"""The law, in plants: an effect of a plant is named where the model file lacks it, and is no gap where it has it.

The effects are those that the catalogue declares for plants, each in a pendulum that is driven so that none looks like
another; logs are simulated from model files. Seeds are fixed; a wrong answer by chance has a rate of 0.1 % a test (the
family-wise rate of the tests of what is left).
"""

from __future__ import annotations

from pathlib import Path

import pytest
from in_part import in_part
from strong_effects import PLANT, PLANT_DURATION_S, PLANT_RATE_HZ, Strong

import kfgen as kf
from kfgen.effects import catalogue
from kfgen.effects.plant.terms import PlantEffect
from kfgen.gap.plant.updated_model import updated_model
from kfgen.gap.result import GapResult
from kfgen.gap.scene.scene import Placed
from kfgen.model.plant.file import model_text, parse_model

PENDULUM = """format = "kfgen-model-1"
name = "pendulum"
[parameters]
stiffness = "4 1/s^2"
gain = "3 rad/s^2/V"
[states]
v = { unit = "rad/s", initial = "0 rad/s", sd = "0.1 rad/s" }
angle = { unit = "rad", initial = "0 rad", sd = "0.1 rad" }
[inputs]
u = "V"
[dynamics]
angle = "v"
v = "-stiffness*sin(angle) - 0.4*v + gain*u"
[measurements.y]
unit = "rad"
expression = "angle"
effects = [ { effect = "white_noise", N = "1e-3 rad/sqrt(Hz)" } ]
"""
DRIVE = """format = "kfgen-manoeuvre-1"
name = "drive"
[[segment]]
duration = "20 s"
inputs = { u = "sin(0.9*t) + 0.6*sin(2.7*t + 1)*cos(0.13*t) + 0.3" }
"""
QUICK = {"parameter_error", "viscous_friction"}
QUICK_AND_LONG = [pytest.param(s, marks=[] if s.name in QUICK else pytest.mark.long) for s in PLANT]


def label(value: object) -> str:
    return value.name if isinstance(value, Strong) else str(value)


def compared(strong: Strong, folder: Path, *, known: bool) -> GapResult:
    """The gap between a log with an effect and a model file with or without it."""
    model = parse_model(PENDULUM, "pendulum.toml")
    has = updated_model(model, [Placed(strong.effect, strong.where[0])])
    lacking, having, drive = (folder / f"{n}.toml" for n in ("lacking", "having", "drive"))
    lacking.write_text(PENDULUM, encoding="utf-8")
    having.write_text(model_text(has), encoding="utf-8")
    drive.write_text(DRIVE, encoding="utf-8")
    log = kf.simulate(having, drive, PLANT_DURATION_S, PLANT_RATE_HZ, seed=1)
    return kf.find_gap(log, having if known else lacking)


def test_every_effect_of_plants_is_tried() -> None:
    assert {s.name for s in PLANT} == {n for n, c in catalogue().items() if issubclass(c, PlantEffect)}
    assert {s.name for s in PLANT} >= QUICK


@pytest.mark.parametrize("strong", in_part(QUICK_AND_LONG), ids=label)
def test_an_effect_that_the_model_file_lacks_is_named(strong: Strong, tmp_path: Path) -> None:
    """Alone, and its first number to four of its own standard deviations (6e-5 of the seeds for each)."""
    found = compared(strong, tmp_path, known=False)
    assert found.verdict == "effects_found"
    (finding,) = found.findings
    assert (finding.name, finding.where) == (strong.name, strong.where[0])
    first = strong.effect.estimated()[0].name
    lo, hi = finding.ci95[first]
    assert abs(getattr(strong.effect, first) - 0.5 * (lo + hi)) < 4.0 * (hi - lo) / 3.92


@pytest.mark.parametrize("strong", in_part(QUICK_AND_LONG), ids=label)
def test_an_effect_that_the_model_file_has_is_no_gap(strong: Strong, tmp_path: Path) -> None:
    found = compared(strong, tmp_path, known=True)
    assert (found.verdict, found.findings) == ("no_gap", ())
