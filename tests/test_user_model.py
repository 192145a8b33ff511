"""Proves that a model file says what its author wrote: units, unknowns, effects; and that it reads back the same.

Numbers are converted by hand in the test; every mistake that a file can hold is refused with its place.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from kfgen.core.errors import InputError
from kfgen.core.units import derived_unit, parse_unit
from kfgen.effects import catalogue, make
from kfgen.effects.noise_model import Term
from kfgen.effects.plant.terms import PlantEffect
from kfgen.model.plant.file import model_text, parse_model, write_model
from kfgen.model.plant.user import Acting, UserModel, read_model

PENDULUM = """
format = "kfgen-model-1"
name = "pendulum"
[parameters]
g_over_l = "19.6 1/s^2"
gain = { value = "1430 deg/s^2/(N m)", sd = "30 deg/s^2/(N m)" }
[states]
theta = { unit = "deg", initial = "10 deg", sd = "2 deg" }
omega = "rad/s"
bias = { unit = "deg", initial = "1 deg" }
[inputs]
u = "N m"
[dynamics]
theta = "omega"
omega = "-g_over_l*sin(theta) + gain*u"
bias = "0"
[measurements.angle]
unit = "deg"
expression = "theta + bias"
effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]
[measurements.gyro]
unit = "deg/s"
expression = "omega"
[[measurements.gyro.effects]]
effect = "white_noise"
N = "0.01 deg/s/sqrt(Hz)"
[[measurements.gyro.effects]]
effect = "sensor_lag"
tau = "5 ms"
[dynamics_effects]
omega = [ { effect = "viscous_friction", coefficient = "0.3 1/s" }, { effect = "coulomb_friction", level = "0.1 rad/s^2", v0 = "0.01 rad/s" } ]
u = [ { effect = "input_delay", delay = "50 ms" } ]
"""
DEG = math.pi / 180


def test_numbers_are_si_and_units_the_users() -> None:
    m = parse_model(PENDULUM, "p.toml")
    assert m.name == "pendulum"
    assert m.parameters["g_over_l"].value == 19.6
    assert m.parameters["g_over_l"].sd == 0.0
    assert m.parameters["gain"].value == pytest.approx(1430 * DEG, rel=1e-14)
    assert m.parameters["gain"].sd == pytest.approx(30 * DEG, rel=1e-14)
    theta, omega, bias = m.states.values()
    assert (theta.initial, theta.sd) == (pytest.approx(10 * DEG), pytest.approx(2 * DEG))
    assert (omega.initial, omega.sd) == (0.0, math.inf)
    assert (bias.initial, bias.sd) == (pytest.approx(DEG), math.inf)
    assert m.inputs == {"u": "N m"}
    assert m.dynamics["omega"].names == {"g_over_l", "theta", "gain", "u"}
    assert m.measurements["angle"].unit == "deg"
    assert pytest.approx(0.02 * DEG) == m.measurements["angle"].noise.effects[0].N
    assert [e.name for e in m.measurements["gyro"].noise.effects] == ["white_noise", "sensor_lag"]
    assert [(a.where, a.effect.name) for a in m.dynamics_effects] == [
        ("omega", "viscous_friction"),
        ("omega", "coulomb_friction"),
        ("u", "input_delay"),
    ]
    assert m.dynamics_effects[2].effect.delay == pytest.approx(0.05)
    assert m.position_of("omega") == "theta"
    assert m.position_of("theta") is None


def test_a_model_is_read_back_the_same(tmp_path: Path) -> None:
    m = parse_model(PENDULUM, "p.toml")
    assert parse_model(model_text(m), "x") == m
    write_model(m, tmp_path / "m.toml")
    assert read_model(tmp_path / "m.toml") == m
    assert [p.name for p in tmp_path.iterdir()] == ["m.toml"]
    assert model_text(read_model(tmp_path / "m.toml")) == model_text(m)


def test_tables_and_inline_effects_are_the_same() -> None:
    tables = PENDULUM.replace(
        'effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]\n', ""
    ).replace(
        "[measurements.gyro]",
        '[[measurements.angle.effects]]\neffect = "white_noise"\nN = "0.02 deg/sqrt(Hz)"\n[measurements.gyro]',
    )
    assert parse_model(tables, "x") == parse_model(PENDULUM, "x")


def test_without_states_or_without_inputs() -> None:
    text = """
format = "kfgen-model-1"
name = "n"
{}
[measurements.y]
unit = "V"
expression = "{}"
effects = [ {{ effect = "white_noise", N = "1 mV/sqrt(Hz)" }} ]
"""
    assert not parse_model(text.format('[inputs]\nu = "A"\n[parameters]\nR = "2 V/A"', "R*u"), "x").states
    assert not parse_model(text.format('[states]\nb = "V"\n[dynamics]\nb = 0', "b"), "x").inputs


@pytest.mark.parametrize(
    ("old", "new", "where", "what"),
    [
        ('format = "kfgen-model-1"', 'format = "kfgen-noise-1"', "p.toml", "begins with format"),
        ('name = "pendulum"', "", "p.toml", "no name"),
        ("[states]", "[states", "p.toml", "no TOML"),
        ("[parameters]", "[params]", "p.toml", "'params' is no part"),
        ('omega = "-g', 'omeg = "-g', "[dynamics]", "'omeg' is no state"),
        ('bias = "0"\n', "", "[dynamics]", "'bias' has no equation"),
        ("sin(theta)", "sin(thet)", "[dynamics] omega, column 15", "'thet' is not known. Known are theta"),
        ("sin(theta)", "sinh(theta)", "[dynamics] omega, column 11", "'sinh' is not known"),
        ("sin(theta)", "sin theta", "[dynamics] omega, column 15", "expected '(' after sin"),
        ('bias = "0"', "bias = true", "[dynamics] bias", "expected an expression"),
        ('"19.6 1/s^2"', '"19.6 1/parsec"', "[parameters] g_over_l", "unknown part 'parsec'"),
        ('"19.6 1/s^2"', '"fast"', "[parameters] g_over_l", "does not begin with a number"),
        ('sd = "30 deg/s^2/(N m)"', 'sd = "30 deg/s"', "[parameters] gain sd", "dimension"),
        ('sd = "30 deg/s^2/(N m)"', "sd = -1", "[parameters] gain", "not positive"),
        ("value =", "valu =", "[parameters] gain", "'valu' is not known here"),
        ('initial = "10 deg"', 'initial = "10 m"', "[states] theta initial", "dimension"),
        ('sd = "2 deg"', "sd = 0", "[states] theta", "not positive"),
        ('initial = "10 deg", ', "", "[states] theta", "no initial value"),
        ('omega = "rad/s"', "omega = 3", "[states] omega", "expected a unit"),
        ('u = "N m"', 'u = "Newton"', "[inputs] u", "unknown part"),
        ('u = "N m"', 'theta = "N m"', "[inputs] theta", "stands under [states] too"),
        ('u = "N m"', 'sin = "N m"', "[inputs] sin", "taken"),
        ('u = "N m"', '"u 1" = "N m"', "[inputs] u 1", "no name"),
        ('unit = "deg"\nexpression', "expression", "[measurements.angle]", "unit is missing"),
        ('expression = "omega"', "", "[measurements.gyro]", "no expression"),
        ('expression = "omega"', 'expression = "omega+"', "[measurements.gyro] expression", "found the end"),
        ('"0.02 deg/sqrt(Hz)"', '"0.02 m/sqrt(Hz)"', "[measurements.angle] white_noise.N", "dimension"),
        ('"sensor_lag"', '"sensor_lg"', "[measurements.gyro]", "no effect 'sensor_lg'"),
        ('"sensor_lag"\ntau', '"input_lag"\ntau', "[measurements.gyro]", "does not act on a measurement"),
        ('"viscous_friction", coefficient', '"white_noise", N', "[dynamics_effects] omega", "dimension"),
        ('"0.3 1/s"', '"0.3 1/s^2"', "[dynamics_effects] omega viscous_friction.coefficient", "dimension"),
        ("u = [ {", "theta_dot = [ {", "[dynamics_effects] theta_dot", "neither a state nor an input"),
        ("omega = [ {", "u = [ {}]\nomega = [ {", "p.toml", "no TOML"),
        ('"input_delay", delay', '"viscous_friction", coefficient', "[dynamics_effects] u", "dimension"),
        ('"input_delay", delay = "50 ms"', '"sensor_lag", tau = "50 ms"', "[dynamics_effects] u", "does not act"),
        (
            '"input_delay", delay = "50 ms"',
            '"viscous_friction", coefficient = 1.0',
            "[dynamics_effects] u",
            "acts on no state 'u'",
        ),
    ],
)  # fmt: skip
def test_a_mistake_is_refused_with_its_place(old: str, new: str, where: str, what: str) -> None:
    assert old in PENDULUM
    with pytest.raises(InputError) as caught:
        parse_model(PENDULUM.replace(old, new, 1), "p.toml")
    assert where in caught.value.where
    assert what in str(caught.value)


def test_a_spring_needs_a_position() -> None:
    text = PENDULUM.replace('theta = "omega"', 'theta = "2*omega"').replace(
        '"viscous_friction", coefficient = "0.3 1/s"', '"spring", coefficient = "0.3 1/s^2"'
    )
    with pytest.raises(InputError, match="needs a state whose derivative is 'omega'"):
        parse_model(text, "p.toml")


def test_no_measurement_no_file_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no measurement"):
        parse_model('format = "kfgen-model-1"\nname = "x"', "p.toml")
    with pytest.raises(InputError, match="no such file"):
        read_model(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="no text"):
        read_model(tmp_path / "b.toml")
    with pytest.raises(InputError, match="TOML"):
        parse_model("a = " + "[" * 100000, "p.toml")


PLANT = {n: c for n, c in catalogue().items() if issubclass(c, PlantEffect)}
UNITS = {  # by hand: what a coefficient must be measured in, for a state in m/s and an input in N m
    "viscous_friction": {"coefficient": "1/s"},
    "coulomb_friction": {"level": "m/s^2", "v0": "m/s"},
    "quadratic_drag": {"coefficient": "1/m"},
    "constant_input": {"value": "m/s^2"},
    "process_noise": {"N": "m/s^2/sqrt(Hz)"},
    "spring": {"coefficient": "1/s^2"},
    "cubic_spring": {"coefficient": "1/m^2/s^2"},
    "input_delay": {"delay": "s"},
    "input_lag": {"tau": "s"},
    "input_nonlinearity": {"k2": "1/(N m)", "k3": "1/(N m)^2"},
    "square_law": {"share": "", "full": "N m"},
    "saturation": {"limit": "N m"},
    "input_dead_zone": {"width": "N m"},
}
CART = """
format = "kfgen-model-1"
name = "cart"
[states]
x = "m"
v = "m/s"
[inputs]
u = "N m"
[dynamics]
x = "v"
v = "u"
[measurements.x]
unit = "mm"
expression = "x"
"""


def cart(name: str) -> tuple[UserModel, str]:
    return parse_model(CART, "cart"), "v" if PLANT[name].acts == "state" else "u"


@pytest.mark.parametrize("name", list(UNITS))
def test_units_of_an_effect_follow_from_its_place(name: str) -> None:
    m, where = cart(name)
    for p in PLANT[name].parameters():
        found = parse_unit(derived_unit(p.unit, m.unit_at(where, PLANT[name])))
        assert found.same_dimension(parse_unit(UNITS[name][p.name]))
        assert found.factor == pytest.approx(parse_unit(UNITS[name][p.name]).factor)


@pytest.mark.parametrize("name", list(UNITS))
def test_every_effect_is_written_and_read_back(name: str) -> None:
    m, where = cart(name)
    effect = make(name, **{p.name: 0.375 + k for k, p in enumerate(PLANT[name].parameters())})
    full = replace(m, dynamics_effects=(Acting(where, Term(effect)),))
    assert parse_model(model_text(full), "x") == full


def test_effects_of_a_place_are_all_there() -> None:
    assert set(UNITS) | {"sensor_lag", "backlash", "parameter_error"} == set(PLANT)
