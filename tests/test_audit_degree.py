"""Proves what an audit says in numbers and in words: limits of the literature, floating point beside the exact answer, lint."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from audit_models import DELAY, LEVER, With, antenna, flown, ins, late, model, part, plant
from in_part import in_part
from scipy.integrate import solve_ivp

from kfgen.audit.audit import audit, notes
from kfgen.audit.degree import Horizon, degree
from kfgen.audit.exact import chain, padic
from kfgen.audit.exact.chain import along, null_space
from kfgen.audit.exact.padic import MOST_PRIMES, PRIMES, NoRoot, Ring, primes
from kfgen.audit.exact.plan import Plan
from kfgen.audit.words import sentence
from kfgen.effects import make
from kfgen.manoeuvre.flight import Flight
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.parts.motion import AtRestMotion, Strapdown
from kfgen.model.parts.sensors import AtRest
from kfgen.model.symbols.convention import conventions

STATIC = LIBRARY["static"]
G = 9.80665
DEG_H = math.radians(1.0) / 3600.0


def navigation_grade() -> FilterModel:
    """0.01 deg/h and 100 ug of bias, 0.001 deg/sqrt(h) of random walk, at rest at 45 deg, velocity to 1 cm/s at 1 Hz."""
    m = build("ins15", None, {"earth_rate": "true", "sensors": "gnss_velocity", "latitude": "45 deg"})
    gyro = make("white_noise", N=1e-3 * math.radians(1.0) / 60.0), make("bias", sd=0.01 * DEG_H)
    accel = make("white_noise", N=1e-5), make("bias", sd=1e-4 * G)
    m = replace(m, noise={c: gyro if c.startswith("gyro") else accel for c in list(m.channel_units)[:6]})
    m.sensors[0].sd = 0.01
    return m


def test_row_23_limits_of_alignment() -> None:
    """Heading 0.0539 deg, tilt 20.63 arcsec; after an hour the down gyro still keeps 89 % of its prior."""
    m = navigation_grade()
    run = degree(DiscreteModel.at_rate(m, 1.0), STATIC, Horizon(3600.0, 1.0), 6)
    end = {s.name: sigma for s, sigma in zip(m.states, run.sigma[-1])}
    assert math.degrees(end["phi_D"]) == pytest.approx(0.0539, rel=0.02)
    assert math.degrees(end["phi_E"]) * 3600 == pytest.approx(20.63, rel=0.02)
    assert math.degrees(end["phi_N"]) * 3600 == pytest.approx(20.63, rel=0.02)
    assert end["bg_z"] / (0.01 * DEG_H) == pytest.approx(0.89, abs=0.01)


def test_covariance_of_a_constant_is_that_of_a_mean() -> None:
    """A bias in white noise: 1 / P = 1 / P0 + T / N^2, in closed form."""
    N, sd, T = 1e-3, 0.2, 40.0
    m = FilterModel(
        "one", "", AtRestMotion(), (AtRest(),), {"gyro_x": (make("white_noise", N=N), make("bias", sd=sd))}
    )
    run = degree(DiscreteModel.at_rate(m, 50.0), STATIC, Horizon(T, 50.0), 0)
    wanted = (1 / sd**2 + T / N**2) ** -0.5
    assert run.sigma[-1, 0] == pytest.approx(wanted, rel=1e-9)
    assert run.bits_per_minute[0] == pytest.approx(math.log2(sd / wanted) / (T / 60.0), rel=1e-9)
    reached = run.reaches(0, 1e-3)
    assert reached == pytest.approx(N**2 * (1e6 - 1 / sd**2), abs=T / 600)
    assert run.reaches(0, 1e-6) is None
    assert run.singular == pytest.approx([sd * math.sqrt(T) / N], rel=1e-9)


def test_verdicts_tell_exact_from_practical() -> None:
    """A Gauss-Markov bias of an hour below the noise of a minute is visible, but keeps its prior."""
    effects = make("white_noise", N=1e-2), make("gauss_markov", sigma=1e-5, tau=3600.0), make("bias", sd=1.0)
    m = FilterModel("one", "", AtRestMotion(), (AtRest(),), {"gyro_x": effects})
    answer = audit(m, (STATIC,), Horizon(60.0, 10.0)).first
    assert [answer.verdict(k) for k in range(2)] == ["practically_unobservable", "observable"]
    still = audit(build("ins15"), (STATIC,), Horizon(60.0)).first
    verdicts = {s.name: still.verdict(k) for k, s in enumerate(still.model.states)}
    assert {n for n, v in verdicts.items() if v == "unobservable"} == {
        *("phi_N", "phi_E", "phi_D"),
        *("ba_x", "ba_y", "bg_z"),
    }


def float_singular(m: FilterModel, manoeuvre: Any, T: float = 20.0, steps: int = 400) -> np.ndarray:
    """Singular values of H Phi, by an independent integration of the transition, columns in units of priors."""
    t = np.linspace(0.0, T, steps + 1)
    flight = Flight(m, manoeuvre, t, {})
    scale = np.array([s.prior for s in m.states])
    F = flight.matrix(m.F) * (scale / scale[:, None])
    H = np.concatenate([flight.matrix(m.H(s)) for s in m.sensors], axis=1) * scale
    n = len(scale)

    def rate(at: float, phi: np.ndarray) -> np.ndarray:
        x = min(at / T * steps, steps - 1e-9)
        k = int(x)
        return ((F[k] + (x - k) * (F[k + 1] - F[k])) @ phi.reshape(n, n)).ravel()

    found = solve_ivp(rate, (0.0, T), np.eye(n).ravel(), t_eval=t, rtol=1e-11, atol=1e-12, max_step=T / steps)
    O = np.vstack([h @ phi.reshape(n, n) for h, phi in zip(H, found.y.T)])
    return np.linalg.svd(O, compute_uv=False)


TURNS = ("accelerate", "two-position", "six-position", "s-turn", "hover")
MODELS: dict[str, Callable[[], FilterModel]] = {
    "ins": ins,
    "arm": lambda: model(With(Strapdown(), LEVER), antenna),
    "delay": lambda: model(With(Strapdown(), DELAY), late),
}


PAIRS = [("ins", n) for n in LIBRARY] + [(m, n) for m in ("arm", "delay") for n in TURNS]


@pytest.mark.parametrize(("which", "name"), in_part(PAIRS, 4))
def test_exact_count_is_where_singular_values_drop(which: str, name: str) -> None:
    """The transition in floating point has its gap, of two decades at least, where the exact rank says."""
    m = MODELS[which]()
    if which == "arm":  # an arm of zero is a special point: both look at the same one
        m = model(With(Strapdown(), replace(LEVER, initial=(0.7, -0.4, 0.5))), antenna)
    plan = Plan(m, m.sensors)
    (h,) = along(plan, [LIBRARY[name]], 20.0, generic=False)
    values = float_singular(m, LIBRARY[name])
    rank = len(values) - h.nullity
    assert values[rank - 1] > 1e-7 * values[0]
    if h.nullity:
        assert values[rank] < 1e-2 * values[rank - 1]


@pytest.mark.parametrize("name", ["static", "hover", "accelerate", "two-position", "drive"])
def test_every_convention_of_the_error_hides_the_same(name: str) -> None:
    """Attitude errors in other letters, axes and carriers: the same count, the same physical directions.

    A direction of one convention is the same motion of the truth as one of another: they are carried over by the
    derivative of the truth with respect to the error, at the start.
    """
    base = build("ins15")
    (reference,) = along(Plan(base, base.sensors), [LIBRARY[name]])
    for convention in conventions():
        m = build("ins15", None, {"attitude_error": convention})
        (h,) = along(Plan(m, m.sensors), [LIBRARY[name]])
        assert h.nullity == reference.nullity
        # At the start v = 0, p = 0 and R = I: attitude errors differ by a sign at most, the rest not at all.
        sign = attitude_sign(m)
        for column in reference.basis.T:
            vector = [int(e) * (sign if 6 <= k < 9 else 1) for k, e in enumerate(column)]
            assert h.contains(vector, h.ring)


def attitude_sign(m: FilterModel) -> int:
    """Of the error's rotation against the global one, read off the Jacobian of a heading of 1 radian about down."""
    import sympy as sp

    attitude = m.attitude
    assert attitude is not None
    at = dict(zip(attitude.nominal, sp.eye(3)))
    tangent = (
        m.error.truth["phi"][1, 0]
        .subs(at)
        .subs({s: 0 for b in m.blocks if b is not attitude for s in b.error})
    )
    return int(tangent.coeff(attitude.error[2]))


def test_lint_finds_three_redundant_constants() -> None:
    """33 states with both matrices full: turning the body's axes is a misalignment of everything."""
    m = build("ins15", None, {"scale_factors": "true", "misalignment": "full"})
    assert len(m.states) == 33
    (note,) = notes(Plan(m, m.sensors), None)
    assert note.startswith("3 redundant among")
    assert "ma triangular" in note
    m = build("ins15", None, {"scale_factors": "true", "misalignment": "triangular"})
    assert notes(Plan(m, m.sensors), None) == ()


def test_what_no_motion_shows_no_manoeuvre_frees() -> None:
    """Turned axes of the body with their misalignments, and the heading of a car, stay hidden in every column."""
    m = build("ins15", None, {"scale_factors": "true", "misalignment": "full"})
    table = audit(m, (LIBRARY["generic"],)).table
    assert table is not None
    assert not any(free for row in table.observable for free in row)
    car = audit(build("ins15", None, {"sensors": "odometer,non_holonomic"}))
    assert car.table is not None
    rows = {tuple(d.vector): row for d, row in zip(car.first.directions, car.table.observable)}
    for never in ("p_N", "p_E", "p_D", "phi_D"):
        assert not any(rows[(never,)]), never


@pytest.mark.parametrize("seed", range(20))
def test_null_space_with_pivots_of_every_size(seed: int) -> None:
    """Matrices ``A D B`` with powers of p in D: what B hides from the rows kept is found, and nothing else."""
    rng = np.random.default_rng(seed)
    ring = Ring(PRIMES[0], 12)
    n, rank = 6, int(rng.integers(1, 6))
    A = [[int(e) for e in row] for row in rng.integers(-9, 10, (8, rank))]
    B = [[int(e) for e in row] for row in rng.integers(-9, 10, (rank, n))]
    powers = [ring.p ** int(k) for k in rng.integers(0, 4, rank)]
    rows = [[sum(a * d * b[j] for a, d, b in zip(line, powers, B)) for j in range(n)] for line in A]
    basis, left = null_space(rows, n, ring)
    assert basis.shape == (n, n - np.linalg.matrix_rank(np.array(B)))
    assert left.digits >= 6
    assert all(
        sum(b * int(x) for b, x in zip(line, column)) % left.m == 0 for line in B for column in basis.T
    )


def test_lint_of_effects() -> None:
    white, walk = make("white_noise", N=1e-3), make("bias", sd=0.1)
    twin = make("gauss_markov", sigma=3e-3, tau=20.0), make("gauss_markov", sigma=4e-3, tau=20.0)
    slow = make("gauss_markov", sigma=1e-3, tau=5e3)
    m = FilterModel("one", "", AtRestMotion(), (AtRest(),), {"gyro_x": (white, *twin, slow, walk)})
    notes = audit(m, (STATIC,), Horizon(100.0)).lint
    assert len(notes) == 2
    assert "same tau = 20 s" in notes[0]
    assert "sigma = 0.005" in notes[0]
    assert "tau = 5000 s" in notes[1]
    assert f"K = {1e-3 * math.sqrt(2 / 5e3):.3g}" in notes[1]
    assert len(audit(m).lint) == 1


IDLE = """
name = "idle"
[states]
level = "m"
spare = "m"
[dynamics]
level = "-level"
spare = "0"
[inputs]
u = "m"
[measurements.y]
unit = "m"
expression = "level"
effects = [ { effect = "white_noise", N = "0.01 m/sqrt(Hz)" } ]
"""


def test_state_that_nothing_shows_is_said() -> None:
    answer = audit(plant(IDLE))
    assert [d.sentence for d in answer.first.directions] == [
        "state spare is unobservable: no measurement depends on it"
    ]
    assert [n for n in answer.lint if n.startswith("spare has no noise")]


DRIFTING = """
name = "drifting"
[states]
place = "m"
speed = "m/s"
drift = "m/s^2"
[inputs]
u = "1"
[dynamics]
place = "u*speed"
speed = "(1 - u)*drift"
drift = "0"
[measurements.shown]
unit = "m"
expression = "place"
effects = [ { effect = "white_noise", N = "0.01 m/sqrt(Hz)" } ]
"""


def test_direction_that_depends_on_durations() -> None:
    """A speed that drifts for 3 s unseen, then is seen and drifts no more: hidden is drift = -speed / 3."""
    wait = flown(part("3", u="0"), part("2", u="1"))
    (d,) = audit(plant(DRIFTING), (wait,)).first.directions
    assert d.exact == {}
    assert d.vector == pytest.approx({"speed": 1.0, "drift": -1.0 / 3.0}, rel=1e-3)


ROOTS = """
name = "roots"
[states]
gain = "1"
level = "1"
[inputs]
u = "1"
[dynamics]
gain = "0"
level = "0"
[measurements.shown]
unit = "1"
expression = "sqrt(1 + gain**2)*exp(sin(level))"
effects = [ { effect = "white_noise", N = "0.01 1/sqrt(Hz)" } ]
"""


def test_direction_at_a_point_of_roots_and_sines() -> None:
    """Only one product is seen: ``gain / (1 + gain^2)`` of gain against ``cos(level)`` of level."""
    answer = audit(plant(ROOTS)).first
    (d,) = answer.directions
    start = Plan(answer.model, answer.model.sensors).numbers(generic=answer.generic)
    slope = start["gain"] / (1.0 + start["gain"] ** 2)
    assert d.vector == pytest.approx({"gain": 1.0, "level": -slope / math.cos(start["level"])}, rel=1e-6)


TWICE = """
name = "twice"
[states]
angle = "rad"
first = "1"
second = "1"
[inputs]
u = "rad/s"
[dynamics]
angle = "u"
first = "0"
second = "0"
[measurements.shown]
unit = "1"
expression = "first*sin(2*angle) + 2*second*sin(angle)*cos(angle) + angle"
effects = [ { effect = "white_noise", N = "0.01 1/sqrt(Hz)" } ]
"""


def test_sines_of_related_angles_stay_related() -> None:
    """``sin 2a = 2 sin a cos a``: only the sum of the two amplitudes is seen."""
    (d,) = audit(plant(TWICE)).first.directions
    assert d.vector == pytest.approx({"first": 1.0, "second": -1.0}, rel=1e-9)


PENDULUM = """
format = "kfgen-model-1"
name = "pendulum"
[states]
theta = "rad"
omega = "rad/s"
stiff = "1/s^2"
b = "rad/s^2"
[inputs]
u = "rad/s^2"
[dynamics]
theta = "omega"
omega = "-stiff*sin(theta) + u + b"
stiff = "0"
b = "0"
[measurements.angle]
unit = "rad"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.001 rad/sqrt(Hz)" } ]
"""


def test_command_on_a_nonlinear_plant(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    path, report = tmp_path / "pendulum.toml", tmp_path / "page.html"
    path.write_text(PENDULUM)
    force = tmp_path / "push.toml"
    force.write_text(
        'format = "kfgen-manoeuvre-1"\n[[segment]]\nduration = 5\ninputs = { u = "sin(3*t)" }\n'
        "[[segment]]\nduration = 5\n"
    )
    done = kfgen(
        *("audit", path, "--manoeuvre", force, "--report", report, "--json", tmp_path / "a.json"),
        *("--rate", 50, "--want", "theta=0.1 deg", "--want", "b=1e-9"),
    )
    assert done.exit_code == 0, done.output
    assert "rank 4 of 4, 0 hidden" in done.stdout
    assert "theta reaches 0.1 deg after" in done.stdout
    assert "b does not reach 1e-9" in done.stdout
    page = report.read_text()
    assert page.count("<svg") == 1
    data = json.loads((tmp_path / "a.json").read_text())
    assert {str(path), str(force)} == set(data["inputs"])
    assert all(len(v) == 64 for v in data["inputs"].values())
    assert data["manoeuvres"]["push"]["duration_s"] == pytest.approx(10.0)


def test_json_has_every_promised_key(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    out = tmp_path / "a.json"
    done = kfgen(
        "audit", "ins15", "--manoeuvre", "static", "--manoeuvre", "s-turn", "--duration", 30, "--json", out
    )
    assert done.exit_code == 0, done.output
    data = json.loads(out.read_text())
    assert set(data["manoeuvres"]) == {"static", "s-turn"}
    static = data["manoeuvres"]["static"]
    assert set(static["condition"]) == {"raw", "scaled"}
    assert static["condition"]["scaled"] > 1.0
    for state in static["state"].values():
        assert state.keys() >= {"verdict", "sigma_prior", "sigma_end", "unit", "bits_per_minute"}
    assert static["state"]["phi_D"]["verdict"] == "unobservable"
    tilt = next(d for d in static["directions"] if "phi_E" in d["vector"])
    assert tilt["vector"] == {"phi_E": 1.0, "ba_N": -G}
    assert "s-turn" in tilt["freed_by"]
    assert data["table"]["shortest"] == "s-turn"
    assert data["manoeuvres"]["s-turn"]["nullity"] == 0


BAD = {
    "no state": (["--want", "speed=3"], "--want"),
    "no size": (["--want", "phi_D"], "--want"),
    "unit": (["--want", "phi_D=3 m"], "dimension"),
    "negative": (["--want", "phi_D=-1 deg"], "positive"),
    "duration": (["--duration", "0"], "--duration"),
    "rate": (["--rate", "nan"], "--rate"),
    "file": (["--manoeuvre", "gone.toml"], "no such file"),
}


def test_log_says_what_its_motion_has_shown(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    """At rest heading keeps its prior; in turns it does not; gravity alone never shows it."""
    verdicts = {}
    for name in ("static", "s-turn"):
        log, out = tmp_path / f"{name}.npz", tmp_path / f"{name}.json"
        words = ("--manoeuvre", name, "--duration", 20, "--rate", 10, "-o", log)
        assert kfgen("simulate", "ins15", *words).exit_code == 0
        assert kfgen("audit", "ins15", "--log", log, "--json", out).exit_code == 0
        data = json.loads(out.read_text())
        (found,) = data["manoeuvres"].values()
        assert found["recorded"]
        assert len(data["inputs"][str(log)]) == 64
        verdicts[name] = {n: s["verdict"] for n, s in found["state"].items()}
    assert verdicts["static"]["phi_D"] == "practically_unobservable"
    assert verdicts["s-turn"]["phi_D"] == "observable"
    assert {"ba_x", "bg_z"} < set(verdicts["s-turn"])
    done = kfgen("audit", "ahrs6", "--sensor", "accel", "--log", tmp_path / "s-turn.npz")
    assert "1 of 6 hidden whatever is flown" in done.stdout
    assert "Heading is unobservable: no measurement depends on it" in done.stdout
    assert kfgen("audit", "ahrs6", "--log", tmp_path / "gone.npz").exit_code == 2
    assert kfgen("audit", "ahrs6", "--log", log, "--manoeuvre", "static").exit_code == 2


def test_manoeuvre_without_a_value_says_when(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "pole.toml"
    path.write_text('format = "kfgen-manoeuvre-1"\n[[segment]]\nduration = 9\nrate = [0, 0, "1/t"]\n')
    done = kfgen("audit", "ahrs6", "--manoeuvre", path)
    assert done.exit_code == 2
    assert "0 s after the start" in str(done.exception)


@pytest.mark.parametrize(("words", "said"), BAD.values(), ids=BAD)
def test_bad_options_say_what(words: list[str], said: str, kfgen: Callable[..., Any]) -> None:
    done = kfgen("audit", "ahrs6", *words)
    assert done.exit_code == 2
    assert said in str(done.exception)


def test_there_are_enough_primes_for_a_model_with_many_roots() -> None:
    """All different, prime, and below 2^29."""
    found = list(primes())
    assert len(set(found)) == MOST_PRIMES
    assert max(found) < 2**29
    assert all(pow(2, p - 1, p) == 1 for p in found)
    assert list(primes(3)) == found[3:]


def test_a_prime_without_a_root_is_no_reason_to_refuse(monkeypatch: pytest.MonkeyPatch) -> None:
    """A speed is a root: half of the primes have it, however many of them come first that do not."""
    m = build("ins15", None, {"sensors": "gnss_velocity,airspeed"})
    plan = Plan(m, m.sensors)
    still = [LIBRARY["cruise"]]

    def fails(p: int) -> bool:
        try:
            along(plan, still, p=p)
        except NoRoot:
            return True
        return False

    without = next(p for p in PRIMES if fails(p))
    found = along(plan, still)[0].nullity
    monkeypatch.setattr(chain, "PRIMES", (without,))
    monkeypatch.setattr(padic, "PRIMES", (without,))
    monkeypatch.setattr(padic, "MOST_PRIMES", 17)
    assert along(plan, still)[0].nullity == found


def test_a_share_is_said_in_percent() -> None:
    """A scale factor of one for a turn of one radian is a percent for ten milliradians."""
    m = build("ins33")
    state = next(s for s in m.states if s.name == "sg_x")
    turn = next(s for s in m.states if s.name == "mg_xz")
    said = sentence([("gyro scale factor x", state, 1.0), ("gyro misalignment xz", turn, 1.0)])
    assert said == "1 % of gyro scale factor x is hidden by 10 mrad of gyro misalignment xz"
