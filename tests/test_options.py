"""Options at the command line: each command takes them, what is emitted keeps them, what is wrong is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import NoiseModel, parse_noise
from kfgen.emit.folder import read_folder
from kfgen.emit.routines import Program
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import LIBRARY, build
from kfgen.model.option import read_pairs
from kfgen.model.parts.motion import LEFT_OUT
from kfgen.model.parts.sensors import sensors

Kfgen = Callable[..., Any]


def test_list_shows_every_option_with_its_values(kfgen: Kfgen) -> None:
    text = kfgen("list").output
    for entry in LIBRARY.values():
        for o in entry.options():
            assert o.name in text
            assert o.kind.words in text
    for s in sensors().values():
        assert all(o.name in text for o in s.options)


def test_what_is_left_out_can_be_left_out_of_every_sensor() -> None:
    for s in sensors().values():
        assert s.left_out == 0.0 or LEFT_OUT in s.options, s.name


def test_derive_says_convention_options_and_what_is_left_out(kfgen: Kfgen, tmp_path: Path) -> None:
    out = tmp_path / "d.json"
    done = kfgen("derive", "ahrs6", "--set", "attitude_error=local-quaternion", "--json", out)
    assert done.exit_code == 0, done.output
    data = json.loads(out.read_text())
    assert data["options"] == {"attitude_error": "local-quaternion"}
    assert "q_nb_hat dq(theta)" in data["equation"]
    assert [s["name"] for s in data["states"][:3]] == ["theta_x", "theta_y", "theta_z"]
    assert data["left_out"]["gyro"]["unit"] == "rad/s/sqrt(Hz)"
    assert data["left_out"]["gyro"]["value"] == 1e-3
    assert "0.001 rad/s/sqrt(Hz) is added" in done.output
    silent = kfgen("derive", "ahrs6", "--set", "left_out=false", "--json", out)
    assert json.loads(out.read_text())["left_out"] == {}
    assert "is added" not in silent.output


@pytest.mark.long
@pytest.mark.parametrize("form", ["latex", "mathml"])
def test_derive_prints_a_model_of_the_earth(kfgen: Kfgen, form: str) -> None:
    done = kfgen("derive", "ins9", "--set", "frame=ecef", "--sensor", "barometer", "--format", form)
    assert done.exit_code == 0, done.output
    assert "H barometer" in done.output


@pytest.mark.long
def test_an_emitted_filter_keeps_its_options(kfgen: Kfgen, tmp_path: Path) -> None:
    words = (
        "--set",
        "earth_rate=true",
        "--set",
        "delay=state",
        "--sensor",
        "gnss_position",
        "--sensor",
        "heading",
    )
    done = kfgen("emit", "ins15", "--target", "filterpy", "-o", tmp_path / "f", *words)
    assert done.exit_code == 0, done.output
    model = read_folder(tmp_path / "f").program.discrete.model
    assert [s.name for s in model.sensors] == ["gnss_position", "heading"]
    assert {c.name for c in model.constants} >= {"W_N", "W_D"}
    assert "td" in {s.name for s in model.states}
    assert kfgen("verify", tmp_path / "f").exit_code == 0


def walks(noise: NoiseModel | None = None, **options: str) -> dict[str, float]:
    """K of each channel [SI/sqrt(s)]; zero for a bias that is constant."""
    model = build("ins15", noise, {"sensors": "gnss_position,barometer", **options})
    return {
        c: sum(float(getattr(e, "K", 0.0)) for e in es)
        for c, es in model.noise.items()
        if any(e.name == "bias" for e in es)
    }


def test_biases_wander_unless_a_noise_file_or_an_option_says_otherwise() -> None:
    inertial = {f"accel_{a}": 3e-4 for a in "xyz"} | {f"gyro_{a}": 2e-5 for a in "xyz"}
    assert walks() == {**inertial, "baro": 0.02}
    assert walks(biases="constant") == dict.fromkeys([*inertial, "baro"], 0.0)
    assert walks(biases="none") == {"baro": 0.02}
    assert (walks(biases="true"), walks(biases="false")) == (walks(biases="constant"), walks(biases="none"))
    text = """format = "kfgen-noise-1"
    [gyro_x]
    unit = "rad/s"
    effects = [ { effect = "white_noise", N = 1e-4 } ]
    [gyro_y]
    unit = "rad/s"
    effects = [ { effect = "gauss_markov", sigma = 1e-4, tau = 100.0 } ]
    [gyro_z]
    unit = "rad/s"
    effects = [ { effect = "bias", sd = 1e-3 } ]
    [accel]
    unit = "m/s^2"
    effects = [ { effect = "white_noise", N = 1e-3 }, { effect = "rate_random_walk", K = 1e-4 } ]
    """
    measured = {"gyro_x": 0.0, "gyro_y": 0.0, "gyro_z": 2e-5} | {f"accel_{a}": 0.0 for a in "xyz"}
    assert walks(parse_noise(text, "n.toml")) == {**measured, "baro": 0.02}


@pytest.mark.parametrize(
    ("name", "walking"),
    [
        ("ahrs6", ["bg_x", "bg_y", "bg_z"]),
        ("ins15", [f"b{s}_{a}" for s in "ag" for a in "xyz"]),
        ("ins9", []),
    ],
)
def test_the_noise_of_every_bias_that_wanders_waits(name: str, walking: list[str]) -> None:
    program = Program(DiscreteModel(build(name)), "ud")
    states = [s.name for s in program.discrete.model.states]
    assert sorted(states[k] for k in program.slow) == walking


def test_a_walk_of_one_axis_is_the_setting_of_that_axis() -> None:
    model = build("ahrs6", None, {"biases": "constant"})
    model = model.augment("gyro_x", make("rate_random_walk", K=1e-4))
    settings = Program(DiscreteModel(model), "ud").settings
    assert [n for n in settings if n.startswith("K_")] == ["K_GYRO_X"]
    assert settings["K_GYRO_X"].value == pytest.approx(1e-4)


@pytest.mark.long
def test_simulate_and_run_take_the_same_options(kfgen: Kfgen, tmp_path: Path) -> None:
    words = (
        "--set",
        "frame=ecef",
        "--set",
        "latitude=-33 deg",
        "--sensor",
        "gnss_position",
        "--sensor",
        "heading",
    )
    log = tmp_path / "log.npz"
    rates = ("--rate", 50, "--rate", "gnss=50")
    done = kfgen("simulate", "ins15", "--manoeuvre", "generic", "--duration", 10, *rates, "-o", log, *words)
    assert done.exit_code == 0, done.output
    done = kfgen("run", "ins15", log, "--json", tmp_path / "run.json", *words)
    assert done.exit_code == 0, done.output
    data = json.loads((tmp_path / "run.json").read_text())
    assert set(data["sensors"]) == {"gnss_position", "heading"}
    # Three rows of 50 updates at 5 Hz: a standard deviation of 0.35.
    assert data["sensors"]["gnss_position"]["mean_nis"] == pytest.approx(3.0, abs=1.4)
    assert data["attitude_error"]["inclination_rmse"] < 0.1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "earth_rate"), "'earth_rate' is no option.*--set name=value"),
        (("--set", "earth_rate=1", "--set", "earth_rate=2"), "given twice"),
        (("--set", "wings=2"), "ins15 has no option 'wings'"),
        (("--sensor", "sonar"), "there is no 'sonar'.*Known are .*barometer"),
        (("--sensor", "heading", "--set", "sensors=mag"), "given twice"),
        (("--set", "latitude=45 kg"), "dimension"),
    ],
    ids=str,
)
@pytest.mark.parametrize(
    "command", [("derive",), ("audit",), ("emit", "--target", "c", "-o", "nowhere")], ids=str
)
def test_bad_options_are_refused(
    kfgen: Kfgen, command: tuple[str, ...], words: tuple[str, ...], said: str
) -> None:
    done = kfgen(command[0], "ins15", *command[1:], *words)
    assert done.exit_code == 2
    with pytest.raises(InputError, match=said):
        raise done.exception


def test_pairs_are_read() -> None:
    assert read_pairs(["a=1", "lever_arm = 1 2 3 m"]) == {"a": "1", "lever_arm": "1 2 3 m"}


def noise(text: str) -> Any:
    return parse_noise('format = "kfgen-noise-1"\n' + text, "noise.toml")


WHITE = '{ effect = "white_noise", N = "0.01 deg/s/sqrt(Hz)" }'


def test_any_channel_takes_any_set_of_effects_from_the_noise_file() -> None:
    text = "".join(
        f'[{c}]\nunit = "{u}"\neffects = [ {{ effect = "white_noise", N = "0.01 {u}/sqrt(Hz)" }}, '
        f'{{ effect = "gauss_markov", sigma = "0.01 {u}", tau = "100 s" }}, '
        f'{{ effect = "rate_random_walk", K = "1e-4 {u}/sqrt(s)" }} ]\n'
        for c, u in (("gyro_x", "deg/s"), ("accel_y", "m/s^2"), ("gnss_p_D", "m"), ("gnss_v_N", "m/s"))
    )
    names = [s.name for s in build("ins15", noise(text)).states]
    assert {"gyro_x_gm", "accel_y_gm", "gnss_p_D_gm", "b_gnss_p_D", "gnss_v_N_gm", "b_gnss_v_N"} <= set(names)
    assert len(names) == 15 + 6


def test_the_bias_of_the_noise_file_stands_for_the_default_one() -> None:
    text = f'[gyro_x]\nunit = "deg/s"\neffects = [ {WHITE}, {{ effect = "bias", sd = "0.5 deg/h" }} ]\n'
    found = {s.name: s.prior for s in build("ins15", noise(text)).states}
    assert found["bg_x"] == pytest.approx(0.5 * 3.14159265 / 180 / 3600, rel=1e-6)
    assert found["bg_y"] == 0.02


def test_a_noise_file_of_other_channels_is_refused() -> None:
    with pytest.raises(InputError, match=r"no channel of ins15.*It has pressure, the model accel_x"):
        build("ins15", noise('[pressure]\nunit = "Pa"\neffects = []\n'))


def test_a_noise_file_in_other_units_is_refused() -> None:
    with pytest.raises(InputError, match="gyro_x is in m in the noise file, ins15 needs rad/s"):
        build("ins15", noise('[gyro_x]\nunit = "m"\neffects = []\n'))


def test_a_state_that_can_never_change_is_refused() -> None:
    text = f'[gyro_x]\nunit = "deg/s"\neffects = [ {WHITE}, {{ effect = "bias", sd = "0 deg/s" }} ]\n'
    with pytest.raises(InputError, match=r"bg_x is exactly known .* P is singular.*sd of a bias"):
        build("ins15", noise(text))
