"""Sensors and motions against equations written a second time, and against the geodesist's tables.

The Earth-fixed and the local level mechanisation share no line: what one says of a motion, the other must.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation

from kfgen.core.errors import InputError
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.parts.earth import geodetic, gravity_e, normal_gravity, place

OMEGA = 7.292115e-5
A, F = 6378137.0, 1 / 298.257223563
Values = dict[str, Any]


def number(expressions: sp.Matrix, x: Values) -> np.ndarray:
    R = {f"R_nb_{i}{j}": x["R"][i, j] for i in range(3) for j in range(3)}
    symbols = sorted(expressions.free_symbols, key=str)
    found = sp.lambdify(symbols, list(expressions))(*((x | R)[s.name] for s in symbols))
    return np.array(found, float)


def filled(m: FilterModel, rng: np.random.Generator) -> Values:
    x: Values = {c.name: c.value for c in m.constants} | {s.name: 0.1 * rng.normal() for s in m.states}
    x |= {c: rng.normal() for c in m.channel_units}
    for b in m.blocks:
        size = {"p": 50.0, "v": 10.0, "mag": 3e-5}.get(b.name, 0.2)
        x |= {n: size * rng.normal() for n in b.error_names}
    return x | {"R": Rotation.random(random_state=rng).as_matrix()}


def three(x: Values, stem: str, axes: str = "xyz") -> np.ndarray:
    return np.array([x[f"{stem}_{a}"] for a in axes])


def rate(x: Values) -> np.ndarray:
    return three(x, "gyro") - three(x, "bg")


def force(x: Values) -> np.ndarray:
    return three(x, "accel") - three(x, "ba")


def soft(x: Values) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = (x[f"si_{a}"] for a in ("xx", "yy", "zz", "xy", "xz", "yz"))
    return np.eye(3) + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def antenna_v(x: Values) -> np.ndarray:
    return np.asarray(three(x, "v", "NED") + x["R"] @ np.cross(rate(x), three(x, "l")))


def antenna_a(x: Values) -> np.ndarray:
    inward = np.cross(rate(x), np.cross(rate(x), three(x, "l")))
    return np.asarray(x["R"] @ (force(x) + inward) + [0.0, 0.0, x["g"]])


def axle(x: Values) -> np.ndarray:
    return np.asarray(x["R"].T @ three(x, "v", "NED") + np.cross(rate(x), three(x, "axle")))


def away(x: Values, point: str) -> np.ndarray:
    return three(x, point, "NED") - three(x, "p", "NED")


def bearing(x: Values) -> list[float]:
    d = x["R"].T @ away(x, "landmark")
    return [math.atan2(d[1], d[0]), math.asin(-d[2] / np.linalg.norm(d))]


ARM = {"lever_arm": "0.5 -0.2 1.1 m", "delay": "0.15 s"}
AXLE = {"axle_arm": "-1.2 0.1 0.4 m"}
TWINS: list[tuple[str, dict[str, str], Callable[[Values], Any]]] = [
    ("gnss_position", {}, lambda x: three(x, "p", "NED")),
    ("gnss_velocity", {}, lambda x: three(x, "v", "NED")),
    (
        "gnss_position",
        ARM,
        lambda x: three(x, "p", "NED") + x["R"] @ three(x, "l") - x["td"] * antenna_v(x),
    ),
    ("gnss_velocity", ARM, lambda x: antenna_v(x) - x["td"] * antenna_a(x)),
    (
        "gnss_velocity",
        {"lever_arm": "state", "delay": "state"},
        lambda x: antenna_v(x) - x["td"] * antenna_a(x),
    ),
    ("barometer", {}, lambda x: [-x["p_D"] + x["b_baro"]]),
    ("mag", {}, lambda x: x["R"].T @ [x["mag_N"], 0.0, x["mag_D"]]),
    (
        "mag",
        {"field": "vector", "soft_iron": "true", "hard_iron": "true"},
        lambda x: soft(x) @ x["R"].T @ three(x, "mag", "NED") + three(x, "b_mag"),
    ),
    ("zero_velocity", {}, lambda x: x["R"].T @ three(x, "v", "NED")),
    ("non_holonomic", AXLE, lambda x: axle(x)[1:]),
    ("odometer", AXLE | {"wheel_scale": "true"}, lambda x: [(1 + x["so"]) * axle(x)[0]]),
    ("heading", {}, lambda x: [math.atan2(x["R"][1, 0], x["R"][0, 0])]),
    (
        "heading",
        {"baseline": "0 2 0 m"},
        lambda x: [math.atan2(x["R"][1, 1], x["R"][0, 1])],
    ),
    ("beacon_range", {"beacon": "30 -20 10 m"}, lambda x: [np.linalg.norm(away(x, "beacon"))]),
    ("landmark_bearing", {}, bearing),
    (
        "airspeed",
        {},
        lambda x: [math.sqrt(np.sum((three(x, "v", "NED") - [x["w_N"], x["w_E"], 0.0]) ** 2) + 0.01)],
    ),
]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("name", "options", "twin"), TWINS, ids=[f"{n} {' '.join(o)}" for n, o, _ in TWINS])
def test_a_sensor_measures_what_its_equation_says(
    name: str, options: dict[str, str], twin: Callable[[Values], Any], seed: int
) -> None:
    model = build("ins15", None, options | {"sensors": name})
    x = filled(model, np.random.default_rng(seed))
    np.testing.assert_allclose(number(model.expected(model.sensor(name)), x), twin(x), rtol=1e-12, atol=1e-18)


def test_intrinsics_are_what_their_equation_says() -> None:
    model = build("ins33", None, {"g_sensitivity": "full", "misalignment": "full"})
    x = filled(model, np.random.default_rng(3))
    M = {
        t: np.array([[x[f"s{t}_{a}"] if a == b else x[f"m{t}_{a}{b}"] for b in "xyz"] for a in "xyz"])
        for t in "ga"
    }
    D = np.array([[x[f"dg_{a}{b}"] for b in "xyz"] for a in "xyz"])
    f = (np.eye(3) - M["a"]) @ force(x)
    omega = (np.eye(3) - M["g"]) @ rate(x) - D @ f
    rates = model.rates(False)
    np.testing.assert_allclose(number(rates["v"], x), x["R"] @ f + [0, 0, x["g"]], rtol=1e-12)
    np.testing.assert_allclose(number(rates["phi"], x), omega, rtol=1e-12)


@pytest.mark.parametrize(
    ("latitude", "gravity"),
    [(0.0, 9.7803253359), (90.0, 9.8321849378), (45.0, 9.8061977695)],
)
def test_normal_gravity_of_the_tables(latitude: float, gravity: float) -> None:
    """NIMA TR8350.2, table 3.4 (equator, pole); GRS 80 to 1e-8 at 45 degrees."""
    assert float(normal_gravity(sp.sin(math.radians(latitude)), 0)) == pytest.approx(gravity, abs=5e-7)


def test_gravity_falls_by_three_milligal_in_ten_metres() -> None:
    low, high = (float(normal_gravity(sp.sin(math.radians(45.0)), h)) for h in (0, 1000.0))
    assert (high - low) / 1000.0 == pytest.approx(-3.0855e-6, rel=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_gravity_in_earth_axes_is_normal_to_the_ellipsoid(seed: int) -> None:
    """Against Somigliana's formula; the harmonics above the second are left out: 1.1e-4 m/s^2 at most."""
    rng = np.random.default_rng(seed)
    L, lon, h = rng.uniform(-1.5, 1.5), rng.uniform(-3, 3), rng.uniform(-100, 5000)
    g = np.array(gravity_e(sp.Matrix(place(L, lon, h))), float).ravel()
    up = np.array([math.cos(L) * math.cos(lon), math.cos(L) * math.sin(lon), math.sin(L)])
    wanted = -float(normal_gravity(sp.sin(L), h)) * up
    np.testing.assert_allclose(g, wanted, rtol=0, atol=1.1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_geodetic_undoes_place(seed: int) -> None:
    rng = np.random.default_rng(seed)
    L, lon, h = rng.uniform(-1.55, 1.55), rng.uniform(-3, 3), rng.uniform(-100, 20000)
    s, c, height = (float(v) for v in geodetic(sp.Matrix(place(L, lon, h))))
    assert math.atan2(s, c) == pytest.approx(L, abs=1e-11)
    assert height == pytest.approx(h, abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_local_level_and_earth_fixed_say_the_same_of_a_motion(seed: int) -> None:
    """Velocity and attitude rates of both, from one specific force and one rate of turn, brought to Earth axes."""
    rng = np.random.default_rng(seed)
    L, h = rng.uniform(-1.2, 1.2), rng.uniform(0.0, 3000.0)
    where = {"latitude": f"{L} rad", "height": f"{h} m"}
    turning = {"earth_rate": "true", "transport_rate": "true", "gravity_model": "normal"}
    ned = build("ins9", None, where | turning)
    ecef = build("ins9", None, where | {"frame": "ecef"})
    x = filled(ned, rng) | {"p_N": 0.0, "p_E": 0.0, "p_D": 0.0}
    v_n = rng.normal(size=3) * 200.0
    x |= dict(zip(("v_N", "v_E", "v_D"), v_n, strict=True))
    C_en = np.array([[-math.sin(L), 0, -math.cos(L)], [0, 1, 0], [math.cos(L), 0, -math.sin(L)]])
    y = {c.name: c.value for c in ecef.constants} | {k: x[k] for k in x if k.startswith(("gyro", "accel"))}
    y |= dict(zip(("v_x", "v_y", "v_z"), C_en @ v_n, strict=True)) | {f"p_{a}": 0.0 for a in "xyz"}
    y["R"] = C_en @ x["R"]
    n, e = ned.rates(False), ecef.rates(False)
    e2 = F * (2 - F)
    w2 = 1 - e2 * math.sin(L) ** 2
    R_N, R_E = A * (1 - e2) / w2**1.5, A / math.sqrt(w2)
    omega_en = np.array([v_n[1] / (R_E + h), -v_n[0] / (R_N + h), -v_n[1] * math.tan(L) / (R_E + h)])
    p_n = number(n["p"], x)
    assert p_n[0] == pytest.approx(v_n[0] * x["r_N"] / (R_N + h), rel=1e-12)
    assert p_n[1] == pytest.approx(v_n[1] * x["r_E"] / (R_E + h) / math.cos(L), rel=1e-12)
    v_e = C_en @ (number(n["v"], x) + np.cross(omega_en, v_n))
    np.testing.assert_allclose(number(e["v"], y), v_e, rtol=0, atol=1.1e-4)
    omega_eb = number(n["phi"], x) + x["R"].T @ omega_en
    np.testing.assert_allclose(number(e["phi"], y), omega_eb, rtol=0, atol=1e-15)


def test_gyros_at_rest_feel_the_earth() -> None:
    L = math.radians(30.0)
    model = build("ins9", None, {"earth_rate": "true", "latitude": "30 deg"})
    x = filled(model, np.random.default_rng(0)) | {f"gyro_{a}": 0.0 for a in "xyz"}
    wanted = -x["R"].T @ [OMEGA * math.cos(L), 0.0, -OMEGA * math.sin(L)]
    np.testing.assert_allclose(number(model.rates(False)["phi"], x), wanted, rtol=1e-12)


BAD: list[tuple[str, dict[str, str], str]] = [
    ("ins15", {"speed": "1"}, r"--set speed: ins15 has no option 'speed'\. It has .*earth_rate"),
    ("ins15", {"earth_rate": "yes"}, r"--set earth_rate: 'yes' is neither true nor false"),
    ("ins15", {"attitude_error": "euler"}, r"--set attitude_error: .*Known are phi, psi, modified-phi"),
    ("ins15", {"latitude": "45 m"}, r"--set latitude: '45 m' has the dimension of m, not of deg"),
    ("ins15", {"lever_arm": "0.1 0.2 m"}, r"--set lever_arm: .*not 3 numbers.*0\.1 0\.1 0\.1 m"),
    ("ins15", {"lever_arm": "0.1 0.2 0.3 deg"}, r"--set lever_arm: .*dimension"),
    ("ins15", {"sensors": "gnss_position,radar"}, r"--set sensors: there is no 'radar'"),
    ("ins15", {"sensors": ""}, r"--set sensors: it names none"),
    ("ins15", {"frame": "enu"}, r"--set frame: there is no 'enu'\. Known are ned, ecef"),
    ("ins15", {"frame": "ecef", "transport_rate": "true"}, r"no option 'transport_rate'.*longitude"),
    (
        "ahrs6",
        {"sensors": "odometer"},
        r"the sensor odometer needs v, which ahrs6 does not have.*offers level, omega, phi",
    ),
    (
        "ins15",
        {"sensors": "accel"},
        r"input accel and the sensor accel of ins15 both read the channel accel_x",
    ),
    ("ins15", {"sensors": "heading", "baseline": "0 0 0 m"}, r"--set baseline: the baseline has no length"),
    ("gyro-static", {"earth_rate": "true"}, r"gyro-static has no option 'earth_rate'\. It has none"),
]


@pytest.mark.parametrize(("name", "options", "words"), BAD, ids=[f"{n} {o}" for n, o, _ in BAD])
def test_a_bad_option_is_refused_in_words(name: str, options: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        build(name, None, options)
