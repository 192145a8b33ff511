"""Proves that a receiver's delay is found where it turns the path aside: in real flights, larger than a line of it shows.

Flights are recordings of other people; fixes are moved by whole samples, which needs no model. A delay was there before,
of which its authors say 0.21 and 0.23 s (fixed wing) or nothing (walk).
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import kfgen as kf
from kfgen.effects import make
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.scene.addition import FittedAddition
from kfgen.gap.scene.explanation import SceneExplanation
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, start_of

pytest.importorskip("numba")
sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
recorded_flights = pytest.importorskip("recorded_flights")

FIXED_WING, WALK, REPLAY = "fixed wing (P. Riseborough)", "walk (T. Everett)", "replay (PX4-ECL)"


def flight_of(name: str, *, later: bool) -> tuple[kf.Log, kf.FilterModel]:
    flights = recorded_flights.flights()
    if name not in flights:
        pytest.skip(f"the recording of the {name} is not here")
    log, model = flights[name]
    return (recorded_flights.changed(log, recorded_flights.LATER) if later else log), model


def scene_of(name: str, *, later: bool) -> FlightScene:
    scene = flight_scene(*flight_of(name, later=later))
    assert scene is not None
    return scene


@pytest.mark.long
def test_a_delay_that_turns_the_path_aside_is_weighed_about_the_path_that_it_leaves() -> None:
    """About the path as it is a low-pass of the velocity fits better, by a line; about its own the delay of all fixes does."""
    scene = scene_of(FIXED_WING, later=True)
    trials = SceneExplanation(scene, fitted(scene, start_of(scene))).ranked()
    by_line: list[FittedAddition] = sorted(trials, key=lambda t: -t.fit.value)
    assert by_line[0].label == ("bandwidth", "gnss_v")
    assert trials[0].label == ("time_delay", "gnss")


def test_no_sensor_reads_what_comes_later() -> None:
    scene = scene_of(REPLAY, later=False)

    def said(place: str, delay: float, *, cautious: bool = True) -> str:
        return replace(scene, cautious=cautious).unreached(Placed(make("time_delay", delay=delay), place))

    assert "inertial sensor" in said("gyro", -0.01, cautious=False)
    assert "inertial sensor" in said("accel", -0.2)
    assert "receiver" in said("gnss", -0.1)
    assert "receiver" in said("gnss_v_N", -0.1)
    assert not said("gyro", 0.01)
    assert not said("gnss_p", 0.3)
    assert not said("gnss", -0.02)
    assert not said("gnss", -0.1, cautious=False)
    late = tuple(replace(a, delay=0.2) for a in scene.path.log.aiding)
    assumed = replace(
        scene, path=replace(scene.path, log=replace(scene.path.log, aiding=late)), cautious=True
    )
    for delay, is_early in ((-0.1, False), (-0.3, True)):
        assert bool(assumed.unreached(Placed(make("time_delay", delay=delay), "gnss"))) == is_early


def test_the_axes_of_an_inertial_sensor_are_read_at_once() -> None:
    scene = scene_of(REPLAY, later=False)
    delays = {c.where for starts in scene.candidates(()) for c in starts if c.effect.name == "time_delay"}
    assert {"gyro", "accel", "gnss", "gnss_p", "gnss_v"} <= delays
    assert not delays & set(scene.path.equations.channels)


@pytest.mark.long
@pytest.mark.parametrize(("name", "before"), [(FIXED_WING, 0.21), (WALK, 0.0)])
def test_fixes_that_come_later_are_named_with_what_they_were_late_before(name: str, before: float) -> None:
    """Within 0.08 s of what its author says and what was planted: the flight's own noise is coloured."""
    found = kf.find_gap(*flight_of(name, later=True))
    delays = [f for f in found.findings if (f.name, f.where) == ("time_delay", "gnss")]
    assert len(delays) == 1
    assert delays[0].effect.delay == pytest.approx(before + 0.1, abs=0.08)  # type: ignore[attr-defined]


@pytest.mark.long
def test_a_delay_in_a_climb_alone_is_named_or_nothing_is() -> None:
    """The replay hovers and climbs once; 0.26 s late it may stay unknown, and no other name stands for it."""
    found = kf.find_gap(*flight_of(REPLAY, later=True))
    assert {f.name for f in found.findings} <= {"time_delay"}
