"""Proves the error models: F, G and H are the derivatives of the equations of motion, and states are right.

The equations are written here a second time, with numpy and scipy rotations: one Euler step forwards and
one backwards on the manifold, for a truth and for an estimate, whose error grows as F and G say.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.filter_role import Use
from kfgen.effects.noise_model import read_noise
from kfgen.emit.folder import EmittedFilter, write_folder
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.parts.motion import Strapdown
from kfgen.model.parts.sensors import GnssPosition, Sensor, sensors
from kfgen.simulate.simulate import simulate

G = 9.80665
TAU, REFERENCE = 7.0, 290.0
TAUS = {"gyro-static": {"gyro_x_gm": 300.0}}
"""Correlation times of the states that a model has before it is loaded."""
TINY = 1e-4
Values = dict[str, Any]

LOADED = {
    "gyro-static": ("gyro_x",),
    "ahrs6": ("gyro_y", "mag_x"),
    "ins15": ("gyro_z", "accel_x", "gnss_v_E"),
}
MODELS = [(n, False) for n in LOADED] + [(n, True) for n in LOADED]
SENSORS = [
    ("gyro-static", "rest"),
    ("ahrs6", "accel"),
    ("ahrs6", "mag"),
    ("ins15", "gnss_position"),
    ("ins15", "gnss_velocity"),
]


def model_of(name: str, loaded: bool) -> FilterModel:
    model = build(name)
    for channel in LOADED[name] if loaded else ():
        for effect in (
            make("gauss_markov", sigma=3e-4, tau=TAU),
            make("rate_random_walk", K=2e-5),
            make("rate_ramp", R=1e-6),
            make("temperature", coefficient=1e-5, reference=REFERENCE),
        ):
            model = model.augment(channel, effect, Use(known=False))
    return model


def bias_name(channel: str, model: str) -> str:
    triad, axis = channel.rsplit("_", 1)
    letters = {"ahrs6": {"gyro": "bg"}, "ins15": {"gyro": "bg", "accel": "ba"}}.get(model, {})
    return f"{letters[triad]}_{axis}" if triad in letters else f"b_{channel}"


def shown(x: Values, channel: str, model: str) -> float:
    """What the effects of a channel add to it."""
    total = sum(x.get(n, 0.0) for n in (bias_name(channel, model), f"{channel}_gm", f"{channel}_gm2"))
    return float(total + x.get(f"{channel}_temperature", 0.0) * (x["temperature"] - REFERENCE))


def random_values(model: FilterModel, rng: np.random.Generator) -> Values:
    x: Values = {s.name: rng.normal() for s in model.states} | {"R": Rotation.random(random_state=rng)}
    x |= {c: rng.normal() for c in model.channel_units} | {"temperature": 300.0 + rng.normal()}
    return x | {"mag_N": 0.8, "mag_D": 1.7, "g": G}


def moved(model: FilterModel, x: Values, w: Mapping[str, float], h: float) -> Values:
    """The state after an Euler step of h seconds; `w` are the noises."""
    name = model.name

    def true(triad: str) -> np.ndarray:
        channels = [f"{triad}_{a}" for a in "xyz"]
        return np.array([x[c] - shown(x, c, name) - w.get(f"n_{c}", 0.0) for c in channels])

    new = dict(x)
    for s in model.states:
        rate = w.get(f"w_{s.name}", 0.0)
        if s.name.endswith(("_gm", "_gm2")):
            rate -= x[s.name] / TAUS.get(name, {}).get(s.name, TAU)
        for channel in LOADED[name]:
            if s.name == bias_name(channel, name):
                rate += x.get(f"{channel}_ramp", 0.0)
        if not s.name.startswith(("p_", "v_", "phi_")):
            new[s.name] = x[s.name] + h * rate
    if name in ("ahrs6", "ins15"):
        new["R"] = x["R"] * Rotation.from_rotvec(h * true("gyro"))
    if name == "ins15":
        acceleration = x["R"].apply(true("accel")) + np.array([0.0, 0.0, x["g"]])
        for k, a in enumerate("NED"):
            new[f"p_{a}"] = x[f"p_{a}"] + h * x[f"v_{a}"]
            new[f"v_{a}"] = x[f"v_{a}"] + h * acceleration[k]
    return new


def plus(x: Values, error: Mapping[str, float]) -> Values:
    phi = [error.get(f"phi_{a}", 0.0) for a in "NED"]
    return {k: v + error.get(k, 0.0) if k != "R" else Rotation.from_rotvec(phi) * v for k, v in x.items()}


def minus(model: FilterModel, true: Values, estimate: Values) -> np.ndarray:
    phi = (true["R"] * estimate["R"].inv()).as_rotvec()
    rows = [phi["NED".index(s.name[-1])] if s.name.startswith("phi_") else None for s in model.states]
    return np.array(
        [true[s.name] - estimate[s.name] if r is None else r for s, r in zip(model.states, rows, strict=True)]
    )


def measured(model: FilterModel, sensor: str, x: Values) -> np.ndarray:
    clean = {
        "rest": lambda: np.zeros(1),
        "accel": lambda: x["R"].inv().apply([0.0, 0.0, -x["g"]]),
        "mag": lambda: x["R"].inv().apply([x["mag_N"], 0.0, x["mag_D"]]),
        "gnss_position": lambda: np.array([x[f"p_{a}"] for a in "NED"]),
        "gnss_velocity": lambda: np.array([x[f"v_{a}"] for a in "NED"]),
    }[sensor]()
    return clean + [shown(x, c, model.name) for c in model.sensor(sensor).channels]


def numbers(matrix: sp.Matrix, x: Values) -> np.ndarray:
    R = x["R"].as_matrix()
    known = x | {f"R_nb_{i}{j}": R[i, j] for i in range(3) for j in range(3)}
    symbols = sorted(matrix.free_symbols, key=str)
    return np.array(sp.lambdify(symbols, matrix)(*(known[s.name] for s in symbols)), float)


def growth(model: FilterModel, x: Values, error: Mapping[str, float], w: Mapping[str, float]) -> np.ndarray:
    """Rate of the error of a truth that is off by `error` and driven by `w`, from steps both ways."""
    e = [minus(model, moved(model, plus(x, error), w, h), moved(model, x, {}, h)) for h in (TINY, -TINY)]
    return np.asarray((e[0] - e[1]) / (2.0 * TINY))


@pytest.mark.parametrize(("name", "loaded"), MODELS)
@pytest.mark.parametrize("seed", range(3))
def test_dynamics_are_the_derivative_of_the_motion(name: str, loaded: bool, seed: int) -> None:
    model = model_of(name, loaded)
    x = random_values(model, np.random.default_rng(seed))
    columns = [
        (growth(model, x, {s.name: TINY}, {}) - growth(model, x, {s.name: -TINY}, {})) / (2 * TINY)
        for s in model.states
    ]
    np.testing.assert_allclose(numbers(model.F, x), np.column_stack(columns), rtol=0, atol=3e-6)


@pytest.mark.parametrize(("name", "loaded"), MODELS)
@pytest.mark.parametrize("seed", range(3))
def test_noise_input_is_the_derivative_by_the_noise(name: str, loaded: bool, seed: int) -> None:
    model = model_of(name, loaded)
    x = random_values(model, np.random.default_rng(seed))
    columns = [
        (growth(model, x, {}, {str(n): TINY}) - growth(model, x, {}, {str(n): -TINY})) / (2 * TINY)
        for n in model.noise_symbols
    ]
    np.testing.assert_allclose(numbers(model.G, x), np.column_stack(columns), rtol=0, atol=3e-6)


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize(("name", "sensor"), SENSORS)
@pytest.mark.parametrize("seed", range(3))
def test_measurement_matrix_is_the_derivative(name: str, sensor: str, loaded: bool, seed: int) -> None:
    model = model_of(name, loaded)
    x = random_values(model, np.random.default_rng(seed))
    columns = [
        (measured(model, sensor, plus(x, {s.name: TINY})) - measured(model, sensor, plus(x, {s.name: -TINY})))
        / (2 * TINY)
        for s in model.states
    ]
    found = model.sensor(sensor)
    np.testing.assert_allclose(numbers(model.H(found), x), np.column_stack(columns), rtol=0, atol=1e-6)
    expected = numbers(model.expected(found), x).ravel()
    np.testing.assert_allclose(expected, measured(model, sensor, x), rtol=1e-12)


@pytest.mark.parametrize("name", LOADED)
def test_loading_a_channel_brings_these_states(name: str) -> None:
    plain, loaded = model_of(name, False), model_of(name, True)
    brought = {s.name for s in loaded.states} - {s.name for s in plain.states}
    wanted = set()
    for channel in LOADED[name]:
        wanted |= {f"{channel}_{e}" for e in ("gm", "ramp", "temperature")} | {bias_name(channel, name)}
    if name == "gyro-static":
        wanted = wanted - {"gyro_x_gm"} | {"gyro_x_gm2"}
    assert brought == wanted - {s.name for s in plain.states}
    assert len({s.name for s in loaded.states}) == len(loaded.states)


@pytest.mark.parametrize("name", LOADED)
def test_augment_leaves_the_dynamics_of_the_others(name: str) -> None:
    plain = build(name)
    loaded = plain.augment(LOADED[name][0], make("gauss_markov", sigma=1e-3, tau=TAU))
    assert len(loaded.states) == len(plain.states) + 1
    places = [[s.name for s in loaded.states].index(s.name) for s in plain.states]
    assert loaded.F.extract(places, places) == plain.F
    assert plain.F == build(name).F


def test_integrators_of_one_channel_share_a_state_and_their_densities_add() -> None:
    walks = (3e-5, 4e-5)
    model = build("ahrs6", None, {"biases": "constant"})
    for K in walks:
        model = model.augment("gyro_y", make("rate_random_walk", K=K))
    assert [s.name for s in model.states] == [s.name for s in build("ahrs6").states]
    A, W = model.effect_dynamics
    at = [s.name for s in model.states].index("bg_y") - 3
    assert A.is_zero_matrix
    assert float(W[at, at]) == pytest.approx((5e-5) ** 2, rel=1e-12)
    assert sum(abs(e) for e in W) == W[at, at]


def test_gauss_markov_states_of_one_channel_stay_separate() -> None:
    model = build("ahrs6")
    for tau in (10.0, 20.0, 30.0):
        model = model.augment("gyro_x", make("gauss_markov", sigma=1e-4, tau=tau))
    names = [s.name for s in model.states]
    assert len(set(names)) == len(names) == 9


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_start_of_a_shared_bias_is_the_sum_of_its_effects_in_any_order(order: tuple[int, int]) -> None:
    effects = (make("rate_random_walk", K=1e-5), make("bias", value=0.25, sd=0.1))
    model = FilterModel("one", "one", Strapdown(), (GnssPosition(),))
    for k in order:
        model = model.augment("gyro_x", effects[k])
    assert [s.start for s in model.states if s.name == "bg_x"] == [0.25]


@pytest.mark.parametrize("name", LOADED)
def test_noise_of_an_unknown_channel_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="no channel 'barometer'"):
        build(name).augment("barometer", make("white_noise", N=1.0))


CHANGES: list[tuple[str, Callable[[float], Any]]] = [
    ("gyro_x", lambda u: make("white_noise", N=1e-4 * u)),
    ("gyro_x", lambda u: make("rate_random_walk", K=1e-4 * u)),
    ("gyro_x", lambda u: make("gauss_markov", sigma=1e-4 * u, tau=5.0)),
    ("gyro_x", lambda u: make("gauss_markov", sigma=1e-4, tau=5.0 * u)),
    ("gyro_x", lambda u: make("bias", sd=0.5 * u)),
    ("gyro_x", lambda u: make("bias", value=0.5 * u)),
    ("gyro_x", lambda u: make("rate_ramp", R=1e-5 * u)),
    ("gyro_x", lambda u: make("temperature", coefficient=1e-5, reference=290.0 * u)),
    ("gyro_x", lambda u: make("temperature", coefficient=1e-5 * u, reference=290.0)),
    ("mag_x", lambda u: make("white_noise", N=1.1e-8 * u)),
    ("mag_x", lambda u: make("quantisation", Q=1.1e-8 * u)),
    ("mag_x", lambda u: make("gauss_markov", sigma=1e-7 * u, tau=5.0)),
]


@pytest.mark.parametrize("number", range(len(CHANGES)))
@pytest.mark.parametrize("factor", [1.5, 1.0 + 2.0**-50], ids=["visible", "last digits"])
def test_hash_changes_with_any_number_of_an_effect(number: int, factor: float) -> None:
    channel, effect = CHANGES[number]
    first, again, changed = (build("ahrs6").augment(channel, effect(u)).hash for u in (1.0, 1.0, factor))
    assert first == again
    assert first != changed


@pytest.mark.parametrize("field", ["sd", "left_out"])
def test_hash_changes_with_a_number_of_a_sensor(field: str) -> None:
    changed = build("ahrs6")
    before = changed.hash
    sensor = changed.sensors[0]
    setattr(sensor, field, getattr(sensor, field) * (1.0 + 2.0**-52))
    assert build("ahrs6").hash == before
    assert FilterModel("ahrs6", "", changed.motion, changed.sensors, changed.noise).hash != before


def test_hash_ignores_words_units_and_the_order_of_channels() -> None:
    a = build("ins15")
    noise = dict(reversed(list(a.noise.items())))
    b = FilterModel(a.name, "another title", a.motion, a.sensors, noise, {"gyro_x": "deg/s"})
    assert b.hash == a.hash


BEACON = np.array([30.0, -20.0, 10.0])


class Beacon(Sensor):
    """Range to a beacon, and the forward speed over ground: nothing of it is in the package."""

    title = "range to a beacon and forward speed"
    unit = "m"
    channels = ("beacon_range", "beacon_speed")
    sd = 0.3
    needs = ("p", "v", "phi")

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        away = x["p"] - sp.Matrix([30, -20, 10])
        return sp.Matrix([sp.sqrt(away.dot(away)), (x["phi"].T * x["v"])[0]])


class RangeRate(Sensor):
    """How fast the beacon comes nearer: a quotient with a root."""

    title = "range rate"
    unit = "m/s"
    channels = ("beacon_rate",)
    sd = 0.1
    needs = ("p", "v")

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        away = x["p"] - sp.Matrix([30, -20, 10])
        return sp.Matrix([away.dot(x["v"]) / sp.sqrt(away.dot(away))])


def beacon_h(x: Values) -> np.ndarray:
    p, v = (np.array([x[f"{b}_{a}"] for a in "NED"]) for b in "pv")
    return np.array([np.linalg.norm(p - BEACON), x["R"].inv().apply(v)[0]])


def rate_h(x: Values) -> np.ndarray:
    p, v = (np.array([x[f"{b}_{a}"] for a in "NED"]) for b in "pv")
    return np.array([(p - BEACON) @ v / np.linalg.norm(p - BEACON)])


@pytest.fixture(params=[(Beacon, beacon_h), (RangeRate, rate_h)], ids=["beacon", "rate"])
def invented(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A new sensor, by name only while the test runs; and its numpy twin."""
    cls, h = request.param
    monkeypatch.setattr(cls, "name", "beacon")
    return cls, h


def test_new_sensor_needs_one_class_and_nothing_else(invented: Any, tmp_path: Path) -> None:
    cls, h = invented
    assert sensors()["beacon"] is cls
    base = build("ins15")
    model = FilterModel("beacons", "with a beacon", base.motion, (*base.sensors, cls()), base.noise)
    rng = np.random.default_rng(5)
    x = random_values(model, rng)
    columns = [(h(plus(x, {s.name: TINY})) - h(plus(x, {s.name: -TINY}))) / (2 * TINY) for s in model.states]
    np.testing.assert_allclose(numbers(model.H(cls()), x), np.column_stack(columns), rtol=0, atol=1e-6)

    discrete = DiscreteModel(model)
    log = simulate(discrete, "generic", 20.0, rng)
    true = {f"{b}_{a}": log.values(f"ref_{b}_{a}") for b in "pv" for a in "NED"}
    q = np.column_stack([log.values(f"ref_q_{a}") for a in "wxyz"])
    wanted = np.array(
        [
            h({k: v[i] for k, v in true.items()} | {"R": Rotation.from_quat(q[i], scalar_first=True)})
            for i in range(log.n)
        ]
    )
    noise = np.column_stack([log.values(c) for c in cls.channels]) - wanted
    assert noise.std() == pytest.approx(cls.sd, rel=5 * math.sqrt(0.5 / noise.size))

    program = Program(discrete)
    machine = Machine(program, np.float64)
    machine.call("init")
    names = list(discrete.nominal_names)
    machine.arrays["x"][: len(names)] = [
        x[n] if n in x else x["R"].as_quat(scalar_first=True)["wxyz".index(n[-1])] for n in names
    ]
    machine.call("update_beacon", [h(x) + 0.01 * cls.sd])
    channels = [shown(x, c, "ins15") for c in cls.channels]
    assert channels == [0.0] * len(channels)
    assert machine.arrays["innovation"][: len(channels)][0] == pytest.approx(0.01 * cls.sd, rel=1e-9)

    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) to run the emitted sensor with")
    from kfgen.verify.compare import verify

    write_folder(program, "c", None, tmp_path / "c")
    (verdict,) = verify(EmittedFilter(program, "c", tmp_path / "c"), ["host"])
    assert verdict.differing == 0
    assert verdict.words > 10_000


def test_invented_sensors_are_gone() -> None:
    assert "beacon" not in sensors()


def test_every_axis_at_rest_is_a_sensor_of_its_own(tmp_path: Path) -> None:
    """imu-static has the channels of the noise file, each with its bias; they do not touch one another."""
    text = 'format = "kfgen-noise-1"\n' + "".join(
        f'[{c}]\nunit = "{u}"\neffects = [{{ effect = "white_noise", N = "{n}" }}]\n'
        for c, u, n in (("gyro_x", "deg/s", "0.01 deg/s/sqrt(Hz)"), ("pressure", "Pa", "2 Pa/sqrt(Hz)"))
    )
    (tmp_path / "noise.toml").write_text(text)
    model = build("imu-static", read_noise(tmp_path / "noise.toml"))
    assert [s.name for s in model.sensors] == ["rest_gyro_x", "rest_pressure"]
    assert [s.name for s in model.states] == ["b_gyro_x", "b_pressure"]
    assert sp.Matrix.vstack(*(model.H(s) for s in model.sensors)) == sp.eye(2)
    assert len(build("imu-static").sensors) == 6
