"""Proves that a model file becomes a filter: its Jacobians, its code with the same words, its estimates.

Jacobians are differentiated by hand in the test, elementary functions compared with numpy's (the double ones to
1e-12, the single ones to some units in the last place), estimates with the simulated truth.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

from kfgen.core.errors import InputError
from kfgen.core.expression import read_expression
from kfgen.effects.noise_model import parse_noise
from kfgen.emit.folder import read_folder, write_folder
from kfgen.emit.ir.ir import Bin, Expr, Let, Num, Ref, Una
from kfgen.emit.ir.lower import FUNCTIONS, Lowering
from kfgen.emit.routines import Program
from kfgen.emit.targets.c import CPrinter
from kfgen.emit.targets.printer import PythonPrinter
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.plant.equations import filter_model
from kfgen.model.plant.file import parse_model
from kfgen.model.plant.user import read_model
from kfgen.run.run import run
from kfgen.simulate.simulate import simulate
from kfgen.verify.compare import verify

PENDULUM = """
format = "kfgen-model-1"
name = "two words"
[parameters]
g_over_l = "19.6 1/s^2"
[states]
theta = { unit = "deg", initial = "10 deg", sd = "5 deg" }
omega = "rad/s"
bias = { unit = "deg", initial = "0 deg", sd = "1 deg" }
[inputs]
u = "N m"
[dynamics]
theta = "omega"
omega = "-g_over_l*sin(theta) + 5*u"
bias = "0"
[measurements.angle]
unit = "deg"
expression = "theta + bias"
effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]
[measurements.gyro]
unit = "deg/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.05 deg/s/sqrt(Hz)" }, { effect = "gauss_markov", sigma = "0.1 deg/s", tau = "10 s" } ]
"""
EFFECTS = """
[dynamics_effects]
omega = [ { effect = "viscous_friction", coefficient = "0.3 1/s" }, { effect = "coulomb_friction", level = "0.2 rad/s^2", v0 = "0.1 rad/s" }, { effect = "quadratic_drag", coefficient = "0.1 1/rad" } ]
u = [ { effect = "saturation", limit = "0.8 N m" }, { effect = "input_lag", tau = "0.05 s" } ]
"""


def at(e: sp.Expr, **values: float) -> float:
    return float(e.subs({sp.Symbol(n, real=True): v for n, v in values.items()}))


def test_jacobians_are_those_by_hand() -> None:
    model = filter_model(parse_model(PENDULUM + EFFECTS, "p.toml"))
    names = [s.name for s in model.states]
    assert names == ["theta", "omega", "bias", "u_behind", "gyro_gm"]
    values = {c.name: c.value for c in model.constants} | {
        "theta": 0.4,
        "omega": -0.7,
        "u": 0.3,
        "u_behind": 0.1,
    }
    i = {n: k for k, n in enumerate(names)}
    F = model.F
    assert at(F[i["theta"], i["omega"]], **values) == 1.0
    assert at(F[i["omega"], i["theta"]], **values) == pytest.approx(-19.6 * np.cos(0.4), rel=1e-12)
    by_hand = -0.3 - 0.2 / 0.1 * (1 - np.tanh(-7.0) ** 2) - 2 * 0.1 * 0.7
    assert at(F[i["omega"], i["omega"]], **values) == pytest.approx(by_hand, rel=1e-9)
    assert at(F[i["omega"], i["u_behind"]], **values) == 5.0
    assert at(F[i["u_behind"], i["u_behind"]], **values) == pytest.approx(-20.0)
    assert all(e == 0 for e in F[i["bias"], :])
    H = model.H(model.sensor("angle"))
    assert [float(v) for v in H] == [1.0, 0.0, 1.0, 0.0, 0.0]
    prior = {s.name: s.prior for s in model.states}
    assert prior["theta"] == pytest.approx(np.deg2rad(5.0))
    assert DiscreteModel(model).start[0] == pytest.approx(np.deg2rad(10.0))


def test_a_saturation_stops_the_input() -> None:
    model = filter_model(parse_model(PENDULUM + EFFECTS, "p.toml"))
    rate = model.rates(False)["u_behind"][0]
    values = {c.name: c.value for c in model.constants} | {"u_behind": 0.1}
    for u in (-2.0, -0.8, 0.3, 5.0):
        assert at(rate, u=u, **values) == pytest.approx((np.clip(u, -0.8, 0.8) - 0.1) / 0.05)


def test_a_slow_sensor_is_a_state() -> None:
    text = PENDULUM.replace('tau = "10 s" }', 'tau = "10 s" }, { effect = "sensor_lag", tau = "0.02 s" }')
    model = filter_model(parse_model(text, "p.toml"))
    names = [s.name for s in model.states]
    assert "gyro_behind" in names
    values = {c.name: c.value for c in model.constants}
    row = model.F[names.index("gyro_behind"), :]
    assert at(row[names.index("omega")], **values) == pytest.approx(50.0)
    assert at(row[names.index("gyro_behind")], **values) == pytest.approx(-50.0)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (PENDULUM.replace('expression = "omega"', 'expression = "omega + u"'), "shows the input u"),
        (PENDULUM.replace('effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]', ""), "no white noise"),
        (PENDULUM.replace('u = "N m"', 'z = "N m"').replace("5*u", "5*z"), "needs the name 'z'"),
        (PENDULUM.replace('u = "N m"', 'float = "N m"').replace("5*u", "5*float"), "needs the name 'float'"),
    ],
)  # fmt: skip
def test_what_no_filter_carries_is_refused(text: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        filter_model(parse_model(text, "p.toml"))


def test_functions_that_no_code_has_are_refused() -> None:
    text = PENDULUM.replace("sin(theta)", "asin(theta)")
    program = Program(DiscreteModel(filter_model(parse_model(text, "p.toml"))))
    with pytest.raises(InputError, match="asin cannot be emitted"):
        _ = program.routines


NUMPY: dict[str, tuple[Callable[[Any], Any], float]] = {  # with the largest argument
    "sin": (np.sin, 60.0),
    "cos": (np.cos, 60.0),
    "tan": (np.tan, 1.3),
    "exp": (np.exp, 20.0),
    "tanh": (np.tanh, 12.0),
    "atan": (np.arctan, 50.0),
    "abs": (np.abs, 9.0),
    "sign": (np.sign, 9.0),
}


def interpreted(e: Expr, env: dict[str, Any], real: Any) -> Any:
    """The value of an expression, written anew."""
    if isinstance(e, Num):
        return real(e.value)
    if isinstance(e, Ref):
        return env[e.name]
    if isinstance(e, Bin):
        a, b = interpreted(e.a, env, real), interpreted(e.b, env, real)
        return {"+": a + b, "-": a - b, "*": a * b}[e.op] if e.op != "/" else a / b
    assert isinstance(e, Una)
    a = interpreted(e.a, env, real)
    return {"neg": np.negative, "sqrt": np.sqrt, "abs": np.abs, "sign": np.sign, "rint": np.rint}[e.op](a)


@pytest.mark.parametrize(("real", "tolerance"), [(np.float64, 1e-12), (np.float32, 4e-6)])
@pytest.mark.parametrize("name", sorted(FUNCTIONS.keys() - {"atan2"}))
def test_elementary_functions_are_those_of_numpy(name: str, real: Any, tolerance: float) -> None:
    wanted, largest = NUMPY[name]
    x = np.linspace(-largest, largest, 4001).astype(real)
    (value,), body = Lowering({"x": Ref("x")}).many([read_expression(f"{name}(x)", ["x"]).value])
    env: dict[str, Any] = {"x": x}
    for s in body:
        assert isinstance(s, Let)
        env[s.name] = interpreted(s.value, env, real)
    found = interpreted(value, env, real)
    exact = wanted(x.astype(np.float64))
    size = np.maximum(np.abs(exact), 1.0)
    assert np.abs(found - exact).max() <= np.max(tolerance * size * (8.0 if name == "exp" else 1.0))
    assert np.abs((found - exact) / size).max() <= tolerance * (8.0 if name == "exp" else 1.0)


def test_spellings() -> None:
    x = Ref("v")
    assert (
        CPrinter(Program(DiscreteModel(build("gyro-static")))).expression(Una("abs", x))
        == "((v < 0.0f) ? (-v) : v)"
    )
    assert PythonPrinter(1).expression(Una("rint", x)) == "float(round(v))"
    for value in (-2.5, -0.0, 0.0, 1.5):
        text = PythonPrinter(1).expression(Una("sign", x))
        assert eval(text, {"v": value}) == np.sign(value)  # text of the code under test


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "two-words.toml"
    path.write_text(PENDULUM + EFFECTS, encoding="utf-8")
    return path


@pytest.mark.parametrize("target", ["c", "filterpy"])
def test_an_emitted_plant_has_the_words_of_its_reference(written: Path, tmp_path: Path, target: str) -> None:
    program = Program(DiscreteModel(build(str(written)), rate=100.0))
    write_folder(program, target, None, tmp_path / "out")
    emitted = read_folder(tmp_path / "out")
    assert emitted.program.discrete.hash == program.discrete.hash
    verdicts = verify(emitted, ["host"])
    assert all(v.differing == 0 and v.words > 0 for v in verdicts)
    assert read_model(tmp_path / "out" / "model.toml").states.keys() == read_model(written).states.keys()


@pytest.mark.long
def test_a_filter_follows_its_plant(written: Path) -> None:
    discrete = DiscreteModel(build(str(written)), rate=100.0)
    log = simulate(discrete, "generic", 60.0, np.random.default_rng(1))
    result = run(Program(discrete), log)
    for k, name in enumerate(("theta", "omega")):
        off = result.estimate[500:, k] - log.channels[f"ref_{name}"].values[500:]
        assert np.sqrt(np.mean(off**2)) < 0.02
    for sensor in result.sensors.values():
        n = sensor.nis.size - 500
        assert abs(np.mean(sensor.nis[500:]) - 1.0) < 0.2 + 4.5 * np.sqrt(2.0 / n)


def test_a_noise_file_gives_noise_to_inputs_and_measurements(written: Path) -> None:
    noise = parse_noise(
        'format = "kfgen-noise-1"\n[u]\nunit = "N m"\neffects = [ { effect = "white_noise", N = 0.1 } ]\n'
        '[angle]\nunit = "rad"\neffects = [ { effect = "white_noise", N = 0.01 } ]\n[other]\nunit = "m"',
        "n.toml",
    )
    model = build(str(written), noise)
    assert float(model.white("u")[0]) == pytest.approx(0.01)
    assert float(model.white("angle")[0]) == pytest.approx(1e-4)
    wrong = parse_noise('format = "kfgen-noise-1"\n[u]\nunit = "m"\n', "n.toml")
    with pytest.raises(InputError, match="u is in m in the noise file"):
        build(str(written), wrong)


def test_a_state_that_starts_unknown_starts_where_a_sensor_shows_it(written: Path, tmp_path: Path) -> None:
    away = PENDULUM.replace('initial = "10 deg", sd = "5 deg"', 'initial = "150 deg", sd = "5 deg"')
    (tmp_path / "away.toml").write_text(away.replace("theta + bias", "theta"), encoding="utf-8")
    unknown = away.replace('{ unit = "deg", initial = "150 deg", sd = "5 deg" }', '"deg"').replace("theta + bias", "theta")  # fmt: skip
    (tmp_path / "unknown.toml").write_text(unknown, encoding="utf-8")
    log = simulate(
        DiscreteModel(build(str(tmp_path / "away.toml"))), "generic", 20.0, np.random.default_rng(2)
    )
    result = run(Program(DiscreteModel(build(str(tmp_path / "unknown.toml")))), log)
    assert result.estimate[0, 0] == pytest.approx(np.deg2rad(150.0), abs=0.05)
    off = result.estimate[500:, 0] - log.channels["ref_theta"].values[500:]
    assert np.sqrt(np.mean(off**2)) < 0.02


@pytest.mark.parametrize("name", ["2 dof", "ü */ x", "ü", "two words"])
def test_any_name_becomes_an_identifier(name: str) -> None:
    model = filter_model(parse_model(PENDULUM.replace("two words", name), "p.toml"))
    assert model.name.isidentifier()
    assert model.name.isascii()
    assert "*/" not in model.title
