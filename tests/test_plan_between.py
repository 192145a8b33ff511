"""`kfgen plan --between`: the manoeuvre that distinguishes two effects; what it predicts against simulated flights."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import kfgen as kf
from kfgen.cli import main
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.emit.routines import Program
from kfgen.gap.flight.distinguish import after_memory, expected_nats
from kfgen.gap.flight.expected_flight import ExpectedFlights
from kfgen.gap.flight.flight_log import flight_log
from kfgen.gap.flight.named_effect import placed_effect
from kfgen.gap.flight.path import flown
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.plan_between import WANTED_NATS, BetweenPlan, ManoeuvreNats
from kfgen.gap.scene.addition import relinearised
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, ScenePoint, keys_of
from kfgen.log.log import Log
from kfgen.manoeuvre.composed import at_speed, course, followed_by
from kfgen.manoeuvre.flight import ManoeuvreMotion
from kfgen.manoeuvre.library import LIBRARY
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.simulate.simulate import simulate_motion

pytest.importorskip("numba")

RATE_HZ = 50.0


@lru_cache
def model() -> FilterModel:
    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    return kf.build("ins15", options={"left_out": "false"}, sensors=sensors)


@lru_cache
def flights() -> ExpectedFlights:
    return ExpectedFlights(model(), RATE_HZ)


@lru_cache
def program() -> Program:
    return Program(flights().discrete)


def effect(text: str) -> Placed:
    return placed_effect(text, model(), "test")


def simulated(true: Placed, manoeuvre: Manoeuvre, seed: int) -> FlightScene:
    """A flight in which an effect is there, its filter started beside the truth by what the filter assumes of its start."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(manoeuvre.length * RATE_HZ)) / RATE_HZ
    with_it = DiscreteModel.at_rate(model().augment(true.where, true.effect), RATE_HZ)
    log: Log = simulate_motion(with_it, ManoeuvreMotion(manoeuvre, t, manoeuvre.length), rng)
    found, equations = flight_log(log, program()), flights().equations
    moving = [s.name.startswith(("p_", "v_", "phi_")) for s in model().states]
    off = np.array([s.prior for s in model().states]) * rng.standard_normal(len(moving)) * moving
    first = found.start.copy()
    for k, name in enumerate(equations.names):
        if f"ref_{name}" in log.channels:
            first[k] = log.values(f"ref_{name}")[0]
    start = equations.injected(first[None, :], off[None, :])[0]
    value = {c.name: float(c.value) for c in model().constants}
    measured = {n: v if v == found.constants[n] else 1.001 * v for n, v in value.items()}  # as if at rest
    return FlightScene(flown(replace(found, start=start, constants=measured)))


def nats_of(scene: FlightScene, placed: Placed) -> float:
    """Log-likelihood of the innovations about the path with the effect fitted and subtracted, up to a constant.

    That is how `kfgen gap` fits, which knows nothing of what was predicted.
    """
    start = ScenePoint((placed,), np.array([u.start for u in scene.unknowns]))
    there, fit = relinearised(scene, fitted(scene, start))
    about = there.about(fit.point)
    assert isinstance(about, FlightScene)
    return about.path.linear.log_likelihood


def nats(manoeuvre: str, true: Placed, other: Placed) -> float:
    """Predicted of a manoeuvre of the library, as the plan has it."""
    scene = after_memory(flights().scene(LIBRARY[manoeuvre]), (true, other))
    return expected_nats(scene, true, other)


def simulated_against_predicted(
    true: str, other: str, manoeuvre: str, seeds: int
) -> tuple[float, float, float]:
    """Mean of the simulated nats, its standard deviation by theory, and what was predicted."""
    there, instead = effect(true), effect(other)
    predicted = nats(manoeuvre, there, instead)
    found = []
    for seed in range(seeds):
        scene = after_memory(simulated(there, LIBRARY[manoeuvre], seed), (there, instead))
        found.append(nats_of(scene, there) - nats_of(scene, instead))
    # Of every further free number noise alone makes half a nat.
    by_chance = 0.5 * (len(keys_of([there])) - len(keys_of([instead])))
    return float(np.mean(found)) - by_chance, float(np.sqrt(2.0 * predicted / seeds)), predicted


@pytest.mark.parametrize(
    ("true", "other", "manoeuvre", "seeds"),
    [
        pytest.param("time_delay@gnss_v=0.4 s", "time_delay@gnss_p", "s-turn", 5, marks=pytest.mark.long),
        pytest.param(
            "hard_iron@mag:y=0.45 uT", "misalignment@accel_y:yx=3 mrad", "s-turn", 5, marks=pytest.mark.long
        ),
        pytest.param("time_delay@gnss=0.18 s", "lever_arm@gnss", "drive", 16, marks=pytest.mark.long),
        pytest.param("lever_arm@gnss=0.7 m", "time_delay@gnss", "figure-8", 16, marks=pytest.mark.long),
        pytest.param(
            "time_delay@gnss_v=0.4 s", "bandwidth@gnss_v=0.4 Hz", "figure-8", 16, marks=pytest.mark.long
        ),
    ],
)
def test_predicted_nats_are_those_of_simulated_flights(
    true: str, other: str, manoeuvre: str, seeds: int
) -> None:
    """Within 20 %, which is three to eight standard deviations of the mean: false alarms at most 1 in 300, for all five."""
    mean, sd, predicted = simulated_against_predicted(true, other, manoeuvre, seeds)
    assert 0.2 * predicted > 3.0 * sd  # the test is as sharp as it says
    assert abs(mean - predicted) < 0.2 * predicted


def test_nats_of_linear_effects_are_those_of_the_projection() -> None:
    """``1/2 ||(I - P_B) J_A a||^2`` by dense least squares on the columns of the gap's own scene."""
    scene = flights().scene(LIBRARY["figure-8"])
    true, other = effect("lever_arm@gnss"), effect("hard_iron@mag")

    def columns(placed: Placed) -> np.ndarray:
        """Of each number of an effect, per unit."""
        values = np.array([u.value for u in scene.unknowns])
        plain = scene.residuals([ScenePoint((), values)])
        names = [n for _, n in keys_of([placed])]
        bare = dict.fromkeys(names, 0.0)
        ones = [replace(placed, effect=replace(placed.effect, **{**bare, n: 1.0})) for n in names]
        return np.asarray(plain - scene.residuals([ScenePoint((p,), values) for p in ones]))

    seen = columns(true) @ np.full(
        3, 0.3
    )  # of level iron, upright iron is the field's own vertical component
    A = np.column_stack([columns(other)[:, :2], scene.of_constants])
    A = A / np.linalg.norm(A, axis=0)
    left = seen - A @ np.linalg.lstsq(A, seen, rcond=None)[0]
    assert expected_nats(scene, true, other) == pytest.approx(0.5 * float(left @ left), rel=1e-6)


def test_the_expected_flight_is_the_truth_of_the_filter() -> None:
    """Without noise the filter about the true path has no innovation: a thousandth of a standard deviation."""
    for name in ("figure-8", "accelerate", "coordinated-turn"):
        scene = flights().scene(LIBRARY[name])
        assert np.abs(scene.path.linear.normalised).max() < 1e-3
        assert [u.name for u in scene.unknowns] == ["mag_N", "mag_D"]


def said(found: BetweenPlan, name: str) -> ManoeuvreNats:
    return next(m for m in found.manoeuvres if m.name == name)


@pytest.mark.long
def test_a_delay_and_a_lever_arm_take_a_stop_and_go_and_a_turn() -> None:
    """Within 60 m no single manoeuvre of the library shows both; a steady turn hides both behind the accelerometer's bias."""
    found = kf.plan_between("time_delay@gnss,lever_arm@gnss", model(), RATE_HZ, room=60.0)
    assert said(found, "accelerate").if_first > WANTED_NATS
    assert said(found, "accelerate").if_second < 0.1
    assert said(found, "yaw-turn").if_second > WANTED_NATS
    assert said(found, "yaw-turn").if_first == 0.0
    assert found.shortest is not None
    assert found.shortest.name == "accelerate then yaw-turn"
    assert all(m.extent <= 60.0 for m in found.manoeuvres)
    assert {name for name, _ in found.too_wide} >= {"cruise", "figure-8", "generic"}
    pair = effect("lever_arm@gnss"), effect("time_delay@gnss")
    assert max(nats("coordinated-turn", *pair), nats("coordinated-turn", *reversed(pair))) < 0.01


def test_a_lag_and_a_delay_take_motion_at_two_frequencies() -> None:
    """A steady turn has one; two circles against each other have more, and no reading before the log says it instead."""
    pair = effect("time_delay@gnss_v=0.3 s"), effect("bandwidth@gnss_v=0.5 Hz")
    assert nats("coordinated-turn", *pair) < 0.1 * nats("figure-8", *pair)


def test_hard_and_soft_iron_take_a_bank() -> None:
    """Level at any heading three numbers of soft iron do what hard iron does; six positions and a tumble show it."""
    hard, soft = effect("hard_iron@mag"), effect("soft_iron@mag")
    assert max(nats(name, hard, soft) for name in ("yaw-turn", "s-turn")) < 1e-3
    assert min(nats("six-position", hard, soft), nats("six-position", soft, hard)) > WANTED_NATS


@pytest.mark.long
def test_where_no_manoeuvre_is_enough_its_repetition_is_said() -> None:
    found = kf.plan_between(["time_delay@gnss_p=0.1 s", "time_delay@gnss_v"], model(), RATE_HZ, room=30.0)
    assert found.shortest is None
    assert "would have to be repeated" in found.sentence
    best = min(found.manoeuvres, key=lambda m: m.seconds_for(WANTED_NATS))
    assert best.seconds_for(WANTED_NATS) == pytest.approx(best.length * WANTED_NATS / best.nats)
    assert found._repr_html_().startswith("<p>")


def test_courses_of_manoeuvres() -> None:
    """Circles of radius v / omega; 1 m/s^2 for 5 s and against it for 5 s makes 25 m; a bank turns at v^2 / (0.75 g)."""
    circle, bank = LIBRARY["figure-8"], LIBRARY["coordinated-turn"]
    assert course(circle).extent == pytest.approx(4.0 * 10.0 / (4.0 * np.pi / 40.0), rel=1e-3)
    assert course(at_speed(circle, 20.0)).extent == pytest.approx(8.0 * 10.0 / (4.0 * np.pi / 40.0), rel=1e-3)
    assert course(LIBRARY["accelerate"]).extent == pytest.approx(25.0, rel=1e-3)
    for speed in (15.0, 29.41995):
        found = course(at_speed(bank, speed))
        assert found.extent == pytest.approx(2.0 * speed**2 / (0.75 * 9.80665), rel=1e-2)
        assert np.abs(found.p[:, 2]).max() < 1e-2
        np.testing.assert_allclose(np.linalg.norm(found.v, axis=1), speed, rtol=1e-4)
    assert at_speed(LIBRARY["hover"], 20.0) is LIBRARY["hover"]


def test_two_manoeuvres_one_after_the_other() -> None:
    turn, circle = LIBRARY["s-turn"], LIBRARY["figure-8"]
    both = followed_by(turn, circle)
    assert both.length == pytest.approx(60.0)
    whole, first, second = course(both), course(turn), course(circle)
    assert first.leads_into(second)
    np.testing.assert_allclose(whole.p[-1], first.p[-1] + second.p[-1], atol=1e-3)
    assert not first.leads_into(course(LIBRARY["hover"]))  # which begins at rest
    assert not course(LIBRARY["coordinated-turn"]).leads_into(second)  # which begins level
    assert course(LIBRARY["yaw-turn"]).leads_into(course(LIBRARY["accelerate"]))


@pytest.mark.parametrize(
    ("between", "says"),
    [
        ("time_delay@gnss", "between two effects, and 1 were named"),
        ("time_delay,lever_arm@gnss", "names no effect at a place"),
        ("delay@gnss,lever_arm@gnss", "Did you mean .*time_delay"),
        ("time_delay@radar,lever_arm@gnss", "no channel or sensor 'radar'"),
        ("white_noise@gnss_p,lever_arm@gnss", "no course of white_noise can be expected"),
        ("viscous_friction@gyro_x,lever_arm@gnss", "no course of viscous_friction can be expected"),
        ("coupling:wind@baro=1 m,lever_arm@gnss", "no course of wind can be expected"),
        ("hard_iron@gyro,lever_arm@gnss", "hard_iron is no effect of gyro"),
        ("time_delay@gnss=5 m,lever_arm@gnss", "has the dimension of m"),
        ("time_delay@gnss=0 s,lever_arm@gnss", "has the size zero"),
        ("hard_iron@mag:x,lever_arm@gnss", "is no number of an effect"),
        ("rate_ramp@gyro_z,lever_arm@gnss", "no typical size at gyro_z"),
        ("time_delay@gnss,time_delay@gnss=0.2 s", "is both effects"),
    ],
)
def test_what_is_no_pair_of_effects_is_refused_in_words(between: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        kf.plan_between(between, model())


def test_what_cannot_be_flown_is_refused_in_words() -> None:
    pair = "time_delay@gnss,lever_arm@gnss"
    for options, says in (
        ({"rate": 10.0}, "40 Hz or more"),
        ({"speed": 0.0}, "--speed must be positive"),
        ({"room": float("nan")}, "--room must be positive"),
    ):
        with pytest.raises(InputError, match=says):
            kf.plan_between(pair, model(), **options)
    with pytest.raises(InputError, match="no manoeuvre moves it"):
        kf.plan_between("scale_factor@gyro_z,misalignment@gyro_z", "ahrs6")


def test_numbers_of_a_place() -> None:
    """Of a matrix the rows of its place; of one number the others are not there."""
    assert [n for _, n in keys_of([effect("misalignment@gyro_z")])] == ["zx", "zy"]
    assert [n for _, n in keys_of([effect("hard_iron@mag_x")])] == ["x"]
    assert [n for _, n in keys_of([effect("lever_arm@gnss:y=0.2 m")])] == ["y"]
    assert effect("time_delay@baro").effect == make("time_delay", delay=0.2)


@pytest.mark.long
def test_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page, answer = tmp_path / "plan.html", tmp_path / "plan.json"
    words = ["plan", "--between", "time_delay@gnss,lever_arm@gnss", "--model", "ins15", "--room", "1"]
    monkeypatch.setattr("sys.argv", ["kfgen", *words, "--report", str(page), "--json", str(answer)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert "none of them shows both effects, however long" in capsys.readouterr().out
    data = json.loads(answer.read_text(encoding="utf-8"))
    assert (data["format"], data["shortest"]) == ("kfgen-plan-between-1", None)
    assert data["manoeuvres"][0]["repeated_for_s"] is None
    assert "yaw-turn" in page.read_text(encoding="utf-8")
    for wrong, says in (
        (words[:3], "lacks --model FILTER"),
        (["plan"], "nothing says what is to be planned"),
    ):
        monkeypatch.setattr("sys.argv", ["kfgen", *wrong])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2
        assert says in capsys.readouterr().err
