"""Proves that a wrong column of a plant's log is found before any fit, and never becomes a missing effect.

The plant is stepped by the exact transition of a held input (scipy's ``cont2discrete``); what is wrong with a column
is written into it by hand.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from scipy.signal import cont2discrete

from kfgen.gap.plant.wiring import plant_scene
from kfgen.gap.scene.scene_gap import scene_gap
from kfgen.identify.screening.stuck import by_chance, stuck_spans
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model

SERVO = """
format = "kfgen-model-1"
name = "servo"
[parameters]
a = "3 1/s"
k = "20 1/s^2"
b = "40 rad/s^2/V"
[states]
theta = "rad"
omega = "rad/s"
[inputs]
u = "V"
[dynamics]
theta = "omega"
omega = "-a*omega - k*theta + b*u"
[measurements.angle]
unit = "deg"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]
"""
N, DT = 3000, 0.01
T = np.arange(N) * DT

Columns = tuple[np.ndarray, np.ndarray]


def columns(seed: int = 0) -> Columns:
    """Held levels and a sine; the angle that answers to them [deg]."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, 200), 25)[:N] + 0.2 * np.sin(2 * np.pi * 0.7 * T)
    A, B = np.array([[0.0, 1.0], [-20.0, -3.0]]), np.array([[0.0], [40.0]])
    Phi, G = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), DT)[:2]
    x = np.zeros((N, 2))
    for k in range(N - 1):
        x[k + 1] = Phi @ x[k] + G[:, 0] * u[k]
    return u, np.rad2deg(x[:, 0]) + 0.2 * rng.standard_normal(N)


def log_of(u: np.ndarray, y: np.ndarray) -> Log:
    return Log(T[: u.size], {"u": Channel(u, "V"), "angle": Channel.of(y, "deg")}, source="servo.csv")


def held_from(x: np.ndarray, a: int, b: int = N) -> np.ndarray:
    out = x.copy()
    out[a:b] = out[a]
    return out


SPOILT: dict[str, tuple[Callable[[np.ndarray, np.ndarray], Columns], set[tuple[str, str]]]] = {
    "a wrong sign": (lambda u, y: (u, -y), {("sign_error", "angle"), ("sign_error", "u")}),
    "an input with a wrong sign": (lambda u, y: (-u, y), {("sign_error", "angle"), ("sign_error", "u")}),
    "radians for degrees": (lambda u, y: (u, np.deg2rad(y)), {("unit_error", "angle"), ("unit_error", "u")}),
    "thousandths": (lambda u, y: (u, 1e3 * y), {("unit_error", "angle"), ("unit_error", "u")}),
    "an input in millivolts": (lambda u, y: (1e3 * u, y), {("unit_error", "angle"), ("unit_error", "u")}),
    "an input that stands": (lambda u, y: (held_from(u, 1500), y), {("stuck", "u")}),
    "an input that stands for a while": (lambda u, y: (held_from(u, 800, 1400), y), {("stuck", "u")}),
    "an input that is logged late": (lambda u, y: (np.roll(u, 200), y), {("too_early", "u")}),
    "a channel that stands for most of the time": (lambda u, y: (u, held_from(y, 900)), {("stuck", "angle")}),
    "two levels": (
        lambda u, y: (u, np.clip(y, *np.quantile(y, [0.45, 0.55]))),
        {("clipping", "angle")},
    ),
}


@pytest.mark.parametrize("case", in_part(SPOILT))
@pytest.mark.parametrize("seed", in_part([1, 2]))
def test_a_wrong_column_is_said_and_nothing_else(case: str, seed: int) -> None:
    spoil, said = SPOILT[case]
    scene = plant_scene(parse_model(SERVO, "servo.toml"), log_of(*spoil(*columns(seed))))
    assert {(p.effect.name, p.where) for p in (*scene.spoilt, *scene.either)} == said
    gap = scene_gap(scene)
    assert gap.verdict == "bad_data"
    assert (gap.findings[0].effect.name, gap.findings[0].where) in said


def repeated(y: np.ndarray, share: float) -> np.ndarray:
    """Each sample with this chance what the one before was, or showed."""
    out, again = y.copy(), np.random.default_rng(4).random(y.size) < share
    for k in range(1, y.size):
        out[k] = out[k - 1] if again[k] else out[k]
    return out


LEFT_OUT: dict[str, tuple[Callable[[np.ndarray], np.ndarray], set[str]]] = {
    "stuck at the end": (lambda y: held_from(y, 1800), {"stuck"}),
    "stuck for a while": (lambda y: held_from(y, 1000, 1600), {"stuck"}),
    "stuck for a moment": (lambda y: held_from(y, 1000, 1040), {"stuck"}),
    "clipped": (lambda y: np.clip(y, *np.quantile(y, [0.08, 0.92])), {"clipping"}),
    "a fifth repeated at random": (lambda y: repeated(y, 0.2), {"repeated_samples"}),
    "every other one held, by a clock": (lambda y: np.repeat(y[::2], 2), set()),
}


@pytest.mark.parametrize("case", LEFT_OUT)
def test_samples_at_fault_are_left_out_and_said(case: str) -> None:
    u, y = columns(3)
    scene = plant_scene(parse_model(SERVO, "servo.toml"), log_of(u, LEFT_OUT[case][0](y)))
    assert {p.effect.name for p in scene.said} == LEFT_OUT[case][1]
    assert not scene.spoilt
    rest = scene.recorded["angle"]
    assert rest.values.size < N
    near = np.interp(T[rest.at], T, np.deg2rad(y))
    assert np.abs(rest.values - near).max() == 0.0  # nothing but true samples is left


def test_a_stuck_span_is_where_it_is_and_is_no_effect() -> None:
    u, y = columns(4)
    gap = scene_gap(plant_scene(parse_model(SERVO, "servo.toml"), log_of(u, held_from(y, 1000, 1600))))
    (found,) = gap.findings
    assert (found.effect.time, found.effect.lasting) == pytest.approx((10.0, 5.99))  # type: ignore[attr-defined]
    assert gap.verdict == "effects_found"  # the tests of what is left find nothing more


@pytest.mark.long
@pytest.mark.parametrize("samples", [30, pytest.param(200, marks=pytest.mark.long)])
def test_a_long_delay_is_looked_for_where_the_channels_are_late(samples: int) -> None:
    u, y = columns(5)
    late = np.concatenate([np.zeros(samples), y[:-samples]])
    late[:samples] = 0.2 * np.random.default_rng(0).standard_normal(samples)
    scene = plant_scene(parse_model(SERVO, "servo.toml"), log_of(u, late))
    assert scene.faults() == ()
    starts = [
        p.effect.delay for found in scene.candidates(()) for p in found if p.effect.name == "input_delay"
    ]  # type: ignore[attr-defined]
    assert min(abs(d - samples * DT) for d in starts) < 3 * DT
    assert abs(int(scene.recorded["angle"].at[0]) - samples) < 4  # nobody knows what was given before the log


def test_sound_columns_are_left_alone() -> None:
    for seed in range(10, 14):
        log = log_of(*columns(seed))
        scene = plant_scene(parse_model(SERVO, "servo.toml"), log)
        assert (scene.said, scene.spoilt, scene.recorded["angle"].values.size) == ((), (), N)


@pytest.mark.long
def test_a_model_that_is_far_off_is_no_wrong_column() -> None:
    """A gain of a quarter, a resonance at another place: neither is a sign or a unit."""
    log = log_of(*columns(6))
    for old, new in (('"40 rad', '"10 rad'), ('"20 1/s^2"', '"200 1/s^2"'), ('"3 1/s"', '"30 1/s"')):
        scene = plant_scene(parse_model(SERVO.replace(old, new), "servo.toml"), log)
        assert scene.spoilt == ()


def test_an_input_may_stand_where_the_plant_rests() -> None:
    u, _ = columns(7)
    u[1500:] = 0.0
    A, B = np.array([[0.0, 1.0], [-20.0, -3.0]]), np.array([[0.0], [40.0]])
    Phi, G = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), DT)[:2]
    x = np.zeros((N, 2))
    for k in range(N - 1):
        x[k + 1] = Phi @ x[k] + G[:, 0] * u[k]
    y = np.rad2deg(x[:, 0]) + 0.2 * np.random.default_rng(8).standard_normal(N)
    assert plant_scene(parse_model(SERVO, "servo.toml"), log_of(u, y)).spoilt == ()


def test_steps_of_a_converter_are_no_standstill() -> None:
    """Of rounded normal deviates two neighbours are equal with probability q / (2 sqrt(pi) sigma), for q well below sigma."""
    y = np.random.default_rng(9).standard_normal(20000)
    rounded = np.round(y / 0.3) * 0.3
    assert by_chance(rounded, 1.0) == pytest.approx(float(np.mean(np.diff(rounded) == 0.0)), rel=0.1)
    assert stuck_spans(rounded, 1.0) == []
    assert stuck_spans(np.round(y / 3.0) * 3.0, 1.0) == []


def test_the_command_says_which_column(
    kfgen: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    u, y = columns(1)
    np.savetxt(
        "servo.csv",
        np.column_stack([T, u, -y]),
        delimiter=",",
        header="t [s],u [V],angle [deg]",
        comments="",
        fmt="%.5f",
    )
    Path("servo.toml").write_text(SERVO, encoding="utf-8")
    kfgen("gap", "servo.csv", "--model", "servo.toml", "--json", "gap.json", "-o", "better.toml")
    answer = json.loads(Path("gap.json").read_text(encoding="utf-8"))
    assert answer["verdict"] == "bad_data"
    assert answer["steps"][0]["effect"] == "sign_error"
    assert answer["steps"][0]["probability"] == 0.5
    assert "Just as well it is sign_error of " in answer["steps"][0]["sentence"]
