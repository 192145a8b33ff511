"""Proves what generated code tells its reader: the units of its arguments, and the effects that it leaves out."""

from __future__ import annotations

import ast
from types import SimpleNamespace
from typing import Any

import pytest

from kfgen.effects.noise_model import NoiseModel, parse_noise
from kfgen.emit.cautions import cautions
from kfgen.emit.routines import Program
from kfgen.emit.targets import c, filterpy, plain
from kfgen.emit.targets.words import LINE_COLUMNS, omitted
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build

OMITTED = (
    (
        "gyro_x",
        "bandwidth",
        "a corner of 40 Hz is no state of this model",
        "filter the log, or sample faster",
    ),
    ("accel", "vibration_rectification", "the filter has no vibration channel " * 4 + '*/ \\ """', ""),
)


def program(effect: str) -> Program:
    noise = parse_noise(
        'format = "kfgen-noise-1"\n[gyro_x]\nunit = "rad/s"\n'
        f'effects = [ {{ effect = "white_noise", N = 1e-4 }}, {{ effect = "{effect}", coefficient = 1e-6 }} ]\n',
        "n.toml",
    )
    return Program(DiscreteModel(build("ahrs6", noise)))


@pytest.mark.parametrize(
    ("effect", "wanted"),
    [
        ("temperature", "temperature [K]"),
        ("air_pressure", "pressure [Pa]"),
        ("supply_voltage", "voltage [V]"),
        ("supply_current", "current [A]"),
        ("humidity", "humidity [1]"),
        ("coupling:rotor_speed", "rotor_speed [SI unit of the channel]"),
    ],
)
def test_a_driver_has_its_own_unit(effect: str, wanted: str) -> None:
    filter_ = program(effect)
    name = wanted.split(maxsplit=1)[0]
    assert f" * @param {name} {wanted}\n" in c.header(filter_)
    for target in (filterpy, plain):
        (text,) = target.module(filter_).values()
        assert wanted in text


def texts(filter_: Program) -> list[str]:
    return [c.header(filter_), *(next(iter(t.module(filter_).values())) for t in (filterpy, plain))]


def test_effects_that_are_left_out_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    filter_ = Program(DiscreteModel(build("gyro-static")))
    plain_texts = texts(filter_)
    monkeypatch.setattr(type(filter_.discrete.model), "omitted", OMITTED, raising=False)
    for without, text in zip(plain_texts, texts(filter_), strict=True):
        assert "Not in this filter" not in without
        begun = text.index("Not in this filter:")
        assert (
            "gyro_x bandwidth: a corner of 40 Hz is no state of this model. Instead: filter the log" in text
        )
        lines = text[begun:].split("vibration channel */")[0].splitlines()[:8]
        assert all(len(line) <= LINE_COLUMNS for line in lines)
    assert texts(filter_)[0].count("*/") == plain_texts[0].count("*/")
    for text in texts(filter_)[1:]:
        ast.parse(text)


def test_a_filter_that_has_everything_says_nothing() -> None:
    model: Any = SimpleNamespace(omitted=())
    assert omitted(model, 5) == ()


def said(options: dict[str, str], form: str = "ud", **choices: Any) -> str:
    found = Program(DiscreteModel(build("ins15", None, options)), form, **choices)
    lines = " ".join(" ".join(cautions(found)).split())
    for text in (c.header(found), next(iter(plain.module(found).values()))):
        assert lines in " ".join(text.replace("\n *", "\n").split())
    return lines


@pytest.mark.long
def test_choices_that_are_less_are_warned_of_with_their_remedy() -> None:
    assert "--form ud" in said({}, form="p")
    assert "--form ud" not in said({}) + said({}, form="p", real="double")
    late = {"delay": "0.1 s"}
    assert "gnss_position is 0.1 s late" in said(late)
    assert "--horizon 0.12" in said(late, horizon=0.05)
    assert "late" not in said(late, horizon=0.12) + said({})
    assert "--real double" in said({"frame": "ecef"})
    assert "--real double" not in said({"frame": "ecef"}, real="double") + said({})


def test_biases_that_keep_their_value_are_warned_of_and_those_that_walk_are_not() -> None:
    white = '{ effect = "white_noise", N = 1e-4 }'
    walk = f'{white}, {{ effect = "rate_random_walk", K = 1e-5 }}'

    def of(effects: str) -> NoiseModel:
        text = "".join(f'[gyro_{a}]\nunit = "rad/s"\neffects = [ {effects} ]\n' for a in "xyz")
        return parse_noise(f'format = "kfgen-noise-1"\n{text}', "n.toml")

    for noise in (None, of(walk)):
        assert cautions(Program(DiscreteModel(build("ahrs6", noise)), "ud")) == ()
    for model, remedy in (
        (build("ahrs6", of(white)), "emit with --noise"),
        (build("ahrs6", None, {"biases": "constant"}), "emit without --set biases=constant"),
    ):
        (text,) = cautions(Program(DiscreteModel(model), "ud"))
        assert text.startswith("bg_x, bg_y, bg_z are constants")
        assert remedy in text
