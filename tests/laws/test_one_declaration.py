"""One declaration: what the gap writes changes every layer, and options of models are spellings of effects."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from typer.testing import Result

import kfgen
import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.effects import catalogue, make
from kfgen.effects.inertial.felt import Signals
from kfgen.log.log import Channel, Log

ROOT = Path(kfgen.__file__).parent
RATE_TABLE = """
format = "kfgen-model-1"
name = "rate-table"
[parameters]
bg_z = { value = "0 rad/s", sd = "0.01 rad/s" }
[inputs]
ref_gyro_z = "rad/s"
[measurements.gyro_z]
unit = "rad/s"
expression = "ref_gyro_z + bg_z"
effects = [ { effect = "white_noise", N = "1e-4 rad/s/sqrt(Hz)" } ]
"""
IMPROVED = """
format = "kfgen-noise-1"
[gyro_x]
unit = "rad/s"
effects = [
  { effect = "white_noise", N = "1e-4 rad/s/sqrt(Hz)" },
  { effect = "scale_factor", coefficient = "2.00 %", coefficient_ci95 = ["1.98 %", "2.02 %"]AS },
]
"""


def written(tmp_path: Path, text: str, name: str = "model.toml") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_scale_factor_that_was_found_is_in_the_code(tmp_path: Path) -> None:
    """Before: the byte-identical header with and without a scale factor of 2 %."""
    known = written(tmp_path, IMPROVED.replace("AS", ""), "known.toml")
    state = written(tmp_path, IMPROVED.replace("AS", ', as = "state"'), "state.toml")
    bare = written(tmp_path, IMPROVED.replace('  { effect = "scale', '#  { effect = "scale'), "bare.toml")
    headers = []
    for noise in (bare, known, state):
        folder = tmp_path / noise.stem
        kf.emit("ahrs6", folder, noise=noise)
        headers.append((folder / "ahrs6.h").read_text(encoding="utf-8"))
    assert len(set(headers)) == 3
    assert "gyro_x_scale_factor" in headers[1]
    states = [s.name for s in kf.build("ahrs6", state).states]
    assert "sg_x" in states
    assert any("estimated: sg_x" in line for line in kf.derive("ahrs6", noise=state).assumptions)
    assert any("known and corrected" in line for line in kf.derive("ahrs6", noise=known).assumptions)


def test_the_default_is_known_where_the_interval_is_small_and_a_state_otherwise(tmp_path: Path) -> None:
    wide = IMPROVED.replace("AS", "").replace('["1.98 %", "2.02 %"]', '["0.5 %", "3.5 %"]')
    (error,) = kf.build("ahrs6", written(tmp_path, wide)).errors
    assert not error.known
    assert error.parameters[0].value == pytest.approx(0.02)
    assert error.parameters[0].sd == pytest.approx(0.015 / 1.96, rel=1e-3)
    (error,) = kf.build("ahrs6", written(tmp_path, IMPROVED.replace("AS", ""))).errors
    assert error.known


@pytest.mark.parametrize(
    ("model", "option", "value", "effect"),
    [
        ("ins15", "scale_factors", "true", "scale_factor"),
        ("ins15", "misalignment", "full", "misalignment"),
        ("ins15", "g_sensitivity", "diagonal", "g_sensitivity"),
        ("ins15", "lever_arm", "state", "lever_arm"),
        ("ins15", "delay", "state", "time_delay"),
    ],
)
def test_an_option_attaches_an_effect_of_the_catalogue(
    model: str, option: str, value: str, effect: str
) -> None:
    built = kf.build(model, options={option: value})
    assert {type(e.effect) for e in built.errors} == {catalogue()[effect]}


@pytest.mark.long
@pytest.mark.parametrize("name", in_part(["scale_factor", "scale_asymmetry", "bandwidth"]))
def test_a_rate_table_written_as_a_model_file_names_what_a_noise_file_does(tmp_path: Path, name: str) -> None:
    """Before: `unknown_effect`, with 2240 nats of a scale factor."""
    sizes = {
        "scale_factor": {"coefficient": 0.02},
        "scale_asymmetry": {"coefficient": 0.005},
        "bandwidth": {"corner": 20.0},
    }
    rng = np.random.default_rng(5)
    t = np.arange(6000) / 100.0
    u = 1.5 * np.sin(2 * np.pi * 0.1 * t) + 0.7 * np.sin(2 * np.pi * 0.43 * t + 1.0)
    felt = Signals(t, np.column_stack([0.0 * u, 0.0 * u, u]))
    y = u + 0.003 + 1e-3 * rng.standard_normal(t.size) + make(name, **sizes[name]).output(felt, 2)  # type: ignore[attr-defined]
    log = Log(t, {"ref_gyro_z": Channel(u, "rad/s"), "gyro_z": Channel(y, "rad/s")}, source="table")
    path = written(tmp_path, RATE_TABLE)
    found = kf.find_gap(log, path)
    assert [(f.name, f.where) for f in found.findings] == [(name, "gyro_z")]
    again = written(tmp_path, found.updated_text, "improved.toml")
    assert kf.find_gap(log, again).verdict == "no_gap"


@pytest.mark.long
def test_the_gap_of_a_filter_writes_a_filter_file_that_every_verb_takes(tmp_path: Path) -> None:
    model = kf.build("ahrs6").augment("gyro_x", make("scale_factor", coefficient=0.02))
    log = kf.simulate(model, "generic", duration=20.0, rate=50.0, seed=3)
    found = kf.find_gap(log, "ahrs6", channels="gyro_x,gyro_y,gyro_z")
    assert [(f.name, f.where) for f in found.findings] == [("scale_factor", "gyro_x")]
    path = tmp_path / "improved.toml"
    kf.save(found.improved, path)
    assert 'format = "kfgen-filter-1"' in path.read_text(encoding="utf-8")
    improved = kf.build(path)
    assert improved.hash != kf.build("ahrs6").hash
    assert kf.find_gap(log, path, channels="gyro_x,gyro_y,gyro_z").verdict == "no_gap"
    assert kf.derive(path).discrete.model.hash == improved.hash
    assert kf.run(path, log).to_dict()["sensors"]["mag"]["updates"] > 0
    assert kf.simulate(path, "generic", duration=2.0, rate=50.0, seed=3).n == 100
    assert kf.audit(path).to_dict()
    kf.emit(path, tmp_path / "code")
    assert "gyro_x_scale_factor" in (tmp_path / "code" / f"{improved.name}.h").read_text(encoding="utf-8")


@pytest.mark.long
def test_no_class_has_a_name_of_another() -> None:
    names: Counter[str] = Counter()
    for path in ROOT.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names.update(n.name for n in ast.walk(tree) if isinstance(n, ast.ClassDef))
    assert [n for n, count in names.items() if count > 1 and not n.startswith("_")] == []


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ('model = "ins99"', "no model 'ins99'"),
        ('model = "ahrs6"\ncolour = "red"', "'colour' is no part of a filter file"),
        ('model = "ahrs6"\n[initial]\nspeed = "1 m/s"', "stores no 'speed'"),
        ('model = "ahrs6"\nsensors = "mag"', "no list of names"),
        ('model = "ahrs6"\n[options]\nfancy = true', "fancy"),
        ('model = "ahrs6"\n[noise]\ngyro_x = 3', "no table"),
    ],
)
def test_a_filter_file_that_cannot_be_used_is_refused_in_words(tmp_path: Path, line: str, what: str) -> None:
    path = written(tmp_path, f'format = "kfgen-filter-1"\n{line}\n')
    with pytest.raises(InputError, match=what) as refused:
        kf.build(path)
    assert refused.value.remedy


def test_every_command_on_a_filter_says_what_is_not_in_it(
    tmp_path: Path, kfgen: Callable[..., Result]
) -> None:
    """A late gyro cannot be corrected by a filter that it drives."""
    late = IMPROVED.replace("scale_factor", "time_delay").replace('coefficient = "2.00 %"', 'delay = "5 ms"')
    late = re.sub(", coefficient_ci95.*AS", "", late)
    noise, log = str(written(tmp_path, late, "late.toml")), str(tmp_path / "log.npz")
    said = "time_delay of gyro_x is not in the filter"
    for command in (
        ["simulate", "ahrs6", "--manoeuvre", "generic", "--duration", "5", "-o", log],
        ["run", "ahrs6", log],
        ["derive", "ahrs6"],
        ["audit", "ahrs6"],
        ["emit", "ahrs6", "--target", "c", "-o", str(tmp_path / "code")],
    ):
        done = kfgen(*command, "--noise", noise)
        assert done.exit_code == 0, done.output
        assert said in done.stderr, command[0]


def test_a_state_is_simulated_with_a_value_from_its_prior(tmp_path: Path) -> None:
    """Known: the value of the file. A state: another one each time, which the log says."""
    state = written(tmp_path, IMPROVED.replace("AS", ', as = "state"'), "state.toml")
    model = kf.build("ahrs6", state)
    drawn = [
        kf.simulate(model, "generic", duration=1.0, rate=50.0, seed=k).values("ref_sg_x")[0] for k in range(8)
    ]
    assert len(set(drawn)) == 8
    assert np.allclose(drawn, 0.02, atol=4.5 * 0.0002 / 1.96)
