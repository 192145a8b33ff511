"""What the motion of a flight does not excite is said by name, with the manoeuvre that would; a parked log is said to be."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from in_part import in_part

import kfgen as kf
from kfgen.effects.inertial.lag import TimeDelay
from kfgen.effects.process.stochastic import WhiteNoise
from kfgen.gap.core.result import Comparison, DetectionLimit
from kfgen.gap.core.thresholds import DETECTION_LIMIT_NATS
from kfgen.gap.flight.distinguish import ExpectedResiduals
from kfgen.gap.flight.excitation import EXPECTED_RATE_HZ, MAX_USUAL_SIZES, aided_by, exciting, is_parked
from kfgen.gap.flight.expected_flight import ExpectedFlights
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.named_effect import placed_effect
from kfgen.gap.result import GapResult
from kfgen.gap.scene.screen import orthogonal_part
from kfgen.log.log import Channel, Log
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import Initial
from kfgen.report.gap import gap_answer
from kfgen.report.page import page_html
from kfgen.simulate.simulate import simulate

pytest.importorskip("numba")

RATE, SECONDS = 50.0, 40.0


@lru_cache
def model() -> FilterModel:
    built = kf.build("ins15", sensors=["gnss_position", "gnss_velocity", "barometer"])
    return replace(built, initial={"heading": Initial(0.0, np.radians(5.0))})


@lru_cache
def log_of(manoeuvre: str, shaking: float = 0.0) -> Log:
    made = simulate(DiscreteModel.at_rate(model(), RATE), manoeuvre, SECONDS, np.random.default_rng(4))
    channels = {n: c for n, c in made.channels.items() if not n.startswith("ref_")}
    noise = np.random.default_rng(5)
    for name in (n for n in channels if shaking and n.startswith("accel_")):
        values = channels[name].values + shaking * noise.standard_normal(made.n)
        channels[name] = Channel(values, channels[name].unit)
    return Log(made.t, channels, source=manoeuvre)


@lru_cache
def found(manoeuvre: str) -> GapResult:
    return kf.find_gap(log_of(manoeuvre), model())


def limits(result: GapResult) -> dict[tuple[str, str, str], DetectionLimit]:
    return {(m.effect.name, m.where, m.parameter): m for m in comparison(result).limits}


def comparison(result: GapResult) -> Comparison:
    (one,) = result.comparisons
    return one


@pytest.mark.parametrize(
    ("manoeuvre", "expected"),
    in_part(
        [
            pytest.param("static", True, marks=pytest.mark.long),
            ("cruise", False),
            ("hover", False),
            ("yaw-turn", False),
            ("accelerate", False),
        ]
    ),
)
def test_a_vehicle_that_never_moves_is_parked(manoeuvre: str, expected: bool) -> None:
    scene = flight_scene(log_of(manoeuvre), model())
    assert scene is not None
    assert is_parked(scene) is expected


def test_vibration_is_no_motion() -> None:
    """An engine that runs: 1 m/s^2 of white vibration."""
    scene = flight_scene(log_of("static", 1.0), model())
    assert scene is not None
    assert is_parked(scene)


@pytest.mark.long
def test_a_parked_log_is_said_in_words_json_and_page() -> None:
    answer = gap_answer(found("static"))
    assert "The vehicle is parked: it never moves in this log" in answer.text
    assert "The vehicle is parked" in page_html(answer.page)
    assert answer.data["parked"] is True
    assert gap_answer(found("generic")).data["parked"] is False
    assert "parked" not in gap_answer(found("generic")).text


def test_what_a_parked_log_cannot_show_is_named_with_the_manoeuvre() -> None:
    known = limits(found("static"))
    for what in (
        ("scale_factor", "gyro_x", "coefficient"),
        ("scale_factor", "gyro_z", "coefficient"),
        ("misalignment", "gyro_x", "xy"),
        ("lever_arm", "gnss", "x"),
        ("lever_arm", "gnss", "y"),
        ("lever_arm", "gnss", "z"),
        ("time_delay", "gnss", "delay"),
        ("scale_asymmetry", "accel_z", "coefficient"),
    ):
        assert not known[what].is_excited, what
        assert known[what].manoeuvre in LIBRARY
        assert known[what].manoeuvre != "static"
    # a body that never turns shows nothing of it, of whatever size: there is no candidate
    assert known["scale_asymmetry", "accel_z", "coefficient"].value == np.inf
    answer = gap_answer(found("static"))
    said = " ".join(answer.text.split())
    assert "The motion of this log does not excite" in said
    assert "lever_arm of gnss" in said
    assert "at no size" in said
    assert "Not excited by the motion of this log" in page_html(answer.page)
    data = {(m["effect"], m["channel"], m["parameter"]): m for m in answer.data["limits"]}
    assert data["lever_arm", "gnss", "x"]["excited"] is False
    assert data["lever_arm", "gnss", "x"]["excited_by"] == known["lever_arm", "gnss", "x"].manoeuvre
    assert data["scale_asymmetry", "accel_z", "coefficient"]["would_not_see_below"] is None
    detected, missed = answer.text.split("Not excited by the motion")
    assert "lever_arm x" not in detected.split("Detection limits")[1]
    assert "lever_arm x" in missed


@pytest.mark.long
def test_a_straight_flight_excites_the_delay_of_positions_and_no_turn() -> None:
    straight, generic = limits(found("cruise")), limits(found("generic"))
    assert straight["time_delay", "gnss_p_N", "delay"].is_excited
    assert not straight["time_delay", "gnss_p_E", "delay"].is_excited
    for what in (("lever_arm", "gnss", "x"), ("scale_factor", "gyro_z", "coefficient")):
        assert not straight[what].is_excited
        assert generic[what].is_excited
    excited = [m for m in generic.values() if m.is_excited]
    assert len(excited) > len([m for m in straight.values() if m.is_excited])


def test_excited_is_what_would_be_seen_of_a_size_that_vehicles_have() -> None:
    for m in limits(found("cruise")).values():
        usual = {"lever_arm": 0.3, "scale_factor": 0.01, "misalignment": 0.01, "clock_drift": 500e-6}
        if m.effect.name in usual:
            assert m.is_excited == (m.value <= MAX_USUAL_SIZES * usual[m.effect.name])


@pytest.mark.long
def test_the_manoeuvre_that_is_named_is_the_shortest_that_shows_the_effect() -> None:
    wanted = [
        placed_effect(x, model(), "")
        for x in ("lever_arm@gnss:x=0.3 m", "time_delay@gnss_v", "scale_factor@gyro_x")
    ]
    flights = ExpectedFlights(model(), EXPECTED_RATE_HZ)
    names = exciting(wanted, model())
    for effect, name in zip(wanted, names):
        shows = {}
        for m in LIBRARY.values():
            seen = ExpectedResiduals(flights.scene(m), effect)
            nats = 0.5 * float(np.sum(orthogonal_part(seen.seen[:, None], seen.nuisance) ** 2))
            shows[m.name] = nats >= DETECTION_LIMIT_NATS
        enough = [LIBRARY[n].length for n, s in shows.items() if s]
        assert shows[name]
        assert LIBRARY[name].length == min(enough)
    assert exciting([], model()) == []


def test_noise_of_a_sensor_that_a_log_lacks_leaves_with_it() -> None:
    """The filter states noise of the barometer; its log has GNSS alone, whose two sensors share an effect."""
    whole = replace(model(), noise={"baro": (WhiteNoise(0.5),), "gnss": (TimeDelay(0.1),)})
    without = aided_by(whole, {"gnss_velocity"})
    assert [s.name for s in without.sensors] == ["gnss_velocity"]
    assert dict(without.noise) == {"gnss": (TimeDelay(0.1),)}
