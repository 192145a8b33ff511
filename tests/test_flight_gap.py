"""The gap of a filter in flight, without a reference: laws of its likelihood, and flights that kfgen did not simulate.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen. Seeds are fixed; a name by chance has a
rate of about one in a hundred flights, a test of what is left one in a thousand.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.inertial.inertial_error import free
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.flight.flight_log import flight_log
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.path import flown
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.flight_words import outage_sentence
from kfgen.gap.result import GapResult
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.gap.scene.screen import basis, orthogonal_part
from kfgen.log.log import Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.run.run import program_over
from kfgen.simulate.simulate import simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
flight = pytest.importorskip("flight")
trial = pytest.importorskip("trial")

pytest.importorskip("numba")


@lru_cache
def model() -> FilterModel:
    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    return kf.build("ins15", options={"left_out": "false", "biases": "constant"}, sensors=sensors)


@lru_cache
def log_of(vehicle: str, seed: int, *effects: Any, duration: float = 40.0, unlisted: str = "") -> Log:
    made = [flight.Effect(name, where, dict(values)) for name, where, values in effects]
    case = trial.Case(vehicle, seed, duration, unlisted=unlisted)
    found = trial.log_of(case, made)
    assert isinstance(found, Log)
    return found


@lru_cache
def scene_of(vehicle: str = "quadrotor", seed: int = 1) -> FlightScene:
    found = flight_scene(log_of(vehicle, seed), model())
    assert found is not None
    return found


def at(scene: FlightScene, *placed: Placed) -> ScenePoint:
    return ScenePoint(placed, np.array([u.value for u in scene.unknowns]))


def log_likelihood(scene: FlightScene) -> float:
    return float(scene.path.linear.nats_of_readings.sum())


def test_the_path_is_where_the_vehicle_was() -> None:
    """Position to a third of what one fix has, attitude to two degrees after the first ten seconds."""
    _, _, known = flight.fly("quadrotor", 40.0, [], 1)
    path = scene_of().path
    names = path.equations.names
    p = path.x[:, [names.index(f"p_{a}") for a in "NED"]]
    q = path.x[:, [names.index(f"q_{a}") for a in "wxyz"]]
    assert np.sqrt(np.mean((p - known["p"]) ** 2)) < 0.5
    turn = np.abs(np.sum(q * known["q"], axis=1))
    assert np.degrees(2.0 * np.arccos(np.clip(turn, 0.0, 1.0)))[1000:].max() < 2.0


def test_innovations_are_white_and_of_unit_size() -> None:
    """Of 40 s, 200 to 1000 a channel: four standard deviations of the mean square of the smallest."""
    scene = scene_of()
    left = fitted(scene, at(scene)).residual  # with the field of the alignment corrected
    for part in map(Whitener.back, np.split(left, np.cumsum(scene.lengths)[:-1])):
        assert abs(np.mean(part**2) - 1.0) < 4.0 * np.sqrt(2.0 / part.size)
        assert abs(np.corrcoef(part[1:], part[:-1])[0, 1]) < 4.0 / np.sqrt(part.size)


def test_a_column_is_the_filter_with_a_state_for_it() -> None:
    """Friedland's two stages: logL of the augmented filter is that of the plain one and of the columns, to 1e-6."""
    scene, sd = scene_of(), 3e-6
    point = at(scene)
    units = [Placed(make("hard_iron", **{a: 1.0}), "mag") for a in "xyz"]
    found = scene.residuals([point, *(at(scene, u) for u in units)])
    V = found[:, :1] - found[:, 1:]
    d, J = V.T @ found[:, 0], V.T @ V
    gain = 0.5 * d @ np.linalg.solve(J + np.eye(3) / sd**2, d)
    gain -= 0.5 * np.linalg.slogdet(np.eye(3) + sd**2 * J)[1]
    options = {"left_out": "false", "biases": "constant", "hard_iron": "true", "hard_iron_sd": f"{sd} T"}
    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    states = kf.build("ins15", options=options, sensors=sensors)
    log = flight_log(log_of("quadrotor", 1), program_over(states, log_of("quadrotor", 1)))
    log = replace(log, constants=scene.path.log.constants)
    path = flown(log)
    names, own = path.equations.names, scene.path.equations.names
    x = np.zeros((log.t.size, len(names)))
    x[:, [names.index(n) for n in own]] = scene.path.x
    augmented = FlightScene(replace(path, x=x))
    assert log_likelihood(augmented) - log_likelihood(scene) == pytest.approx(gain, rel=1e-6)


def test_an_effect_of_size_zero_changes_nothing() -> None:
    scene = scene_of()
    nothing = [
        Placed(make("scale_factor", coefficient=0.0), "gyro_z"),
        Placed(make("time_delay", delay=0.0), "gnss"),
    ]
    found = scene.residuals([at(scene), *(at(scene, p) for p in nothing)])
    assert np.abs(found - found[:, :1]).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "where", "values"),
    [
        ("scale_factor", "gyro_z", {"coefficient": 2e-3}),
        ("lever_arm", "gnss", {"x": 0.1, "y": 0.05, "z": -0.1}),
        ("time_delay", "gnss_v", {"delay": 0.01}),
        ("hard_iron", "mag", {"x": 1e-7, "y": 0.0, "z": 0.0}),
    ],
)
def test_a_response_is_what_the_filter_about_the_updated_path_says(
    name: str, where: str, values: dict[str, float]
) -> None:
    """Linear about one path, and about the path that is smoothed with the effect subtracted: 4 % of what it does."""
    scene = scene_of()
    point = at(scene, Placed(make(name, **values), where))
    here, plain = scene.residuals([point, at(scene)]).T
    there = scene.about(point).residuals([point])[:, 0]
    assert np.linalg.norm(here - there) < 0.04 * np.linalg.norm(here - plain) + 1e-3


def test_a_field_is_unknown_even_where_the_alignment_finds_that_of_the_model() -> None:
    """What is measured from the first samples is unknown by what it is, and not by its value."""
    scene = scene_of()
    nominal = {c.name: float(c.value) for c in model().constants}
    same = replace(scene, path=replace(scene.path, log=replace(scene.path.log, constants=nominal)), memory={})
    assert [u.name for u in same.unknowns] == [u.name for u in scene.unknowns] == ["mag_N", "mag_D"]


def test_products_are_those_of_the_columns() -> None:
    """The backward pass and the forward pass of errors of single readings say the same, to rounding."""
    linear, rng = scene_of().path.linear, np.random.default_rng(5)
    n, inputs = scene_of().path.log.u.shape
    series = rng.standard_normal(linear.y.size)
    of_inputs, of_readings = linear.products(series)
    du, dz = np.zeros((n, inputs, 4)), np.zeros((linear.y.size, 4))
    du[700, 1, 0] = du[3000:, 4, 1] = 1.0
    dz[40, 2] = dz[300:, 3] = 1.0
    expected = series @ linear.columns(du, dz)
    found = [of_inputs[700, 1], of_inputs[3000:, 4].sum(), of_readings[40], of_readings[300:].sum()]
    assert found == pytest.approx(expected, rel=1e-9)


def test_the_energy_of_a_step_is_that_of_its_column() -> None:
    """Between the times of the grid to 5 %, at them to rounding."""
    scene = scene_of()
    steps = scene._energies
    Q = basis(scene.of_constants)
    for channel, t in (("gyro_y", steps.t[11]), ("baro", steps.t[4])):
        step = Placed(make("bias_step", size=1.0, time=float(t - scene.path.log.t[0])), channel)
        found = scene.residuals([at(scene), at(scene, step)])
        column = orthogonal_part(found[:, 0] - found[:, 1], Q)
        assert steps.energy[scene.compared.index(channel), steps.t == t] == pytest.approx(column @ column)


def test_soft_iron_beside_a_field_that_nobody_knows() -> None:
    """Its common scale is that of the field: the two do the same, so no interval may bound both; zz is left at zero."""
    scene = scene_of("wing", 3)
    every = Placed(make("soft_iron", xx=1e-4, yy=1e-4, zz=1e-4), "mag")
    wide = fitted(scene, at(scene, every))
    assert (np.sqrt(np.diag(wide.covariance)[:3]) > 1.0).all()
    offered = [p for starts in scene.candidates(()) for p in starts if p.effect.name == "soft_iron"]
    most = max(offered, key=lambda p: len(free(p.effect)))
    fit = fitted(scene, at(scene, most))
    names = [n for _, n in fit.keys]
    assert "zz" not in names
    assert len(names) == 8
    sd = np.sqrt(np.diag(fit.covariance)[: len(names)])
    assert (sd < 0.01).all()
    assert (
        np.abs([getattr(fit.point.placed[0].effect, n) for n in names]) < 3.5 * sd
    ).all()  # 1 of 250 flights


def test_a_clean_flight_has_no_gap() -> None:
    """What could not have been seen is said."""
    found = kf.find_gap(log_of("quadrotor", 1), model())
    assert (found.verdict, [f.name for f in found.findings]) == ("no_gap", [])
    assert found.comparisons[0].limits


@pytest.mark.long
def test_outages_show_what_an_effect_costs() -> None:
    """A yaw gyro that reads 5 % too much in a fixed wing that circles: a heading error, that is five times an inertial drift.

    Of that drift two draws of one size each: their ratio alone exceeds two in one of thirty seeds.
    """
    wide = ("scale_factor", "gyro_z", (("coefficient", 0.05),))
    scene = flight_scene(log_of("wing", 2, wide, duration=80.0), model())
    assert scene is not None
    known = scene.about(at(scene, Placed(make("scale_factor", coefficient=0.05), "gyro_z")))
    (before, *_), (after, *_) = scene.drifts(0.6), known.drifts(0.6)
    assert (before.seconds, before.count) == (10.0, 2)
    assert before.metres > 2.0 * after.metres
    assert outage_sentence(before, after).startswith("Without GNSS for 10 s the filter drifts")
    assert flight_scene(log_of("quadrotor", 1), model()).drifts(0.2) == ()  # type: ignore[union-attr]


@pytest.mark.long
def test_a_parked_log_names_nothing() -> None:
    """The library's own simulation of a body at rest, with a lever arm that nothing can show."""
    arm = kf.build("ins15").augment("gnss", make("lever_arm", x=1.0, y=0.0, z=0.0))
    log = simulate(DiscreteModel.at_rate(arm, 50.0), "static", 40.0, np.random.default_rng(2))
    bare = Log(
        log.t, {n: c for n, c in log.channels.items() if not n.startswith("ref_")}, samples=log.samples
    )
    found = kf.find_gap(bare, kf.build("ins15"))
    assert (found.verdict, list(found.findings)) == ("no_gap", [])


@pytest.mark.long
def test_an_arm_is_in_body_axes_whatever_the_navigation_axes_are() -> None:
    """A filter in Earth-fixed axes, whose receiver's readings are Earth-fixed as well; four standard deviations."""
    model = kf.build("ins15", options={"frame": "ecef"})
    arm = {"x": 0.6, "y": -0.3, "z": 0.4}
    truth = DiscreteModel.at_rate(model.augment("gnss", make("lever_arm", **arm)), 50.0)
    log = simulate(truth, "generic", 40.0, np.random.default_rng(1))
    bare = Log(
        log.t, {n: c for n, c in log.channels.items() if not n.startswith("ref_")}, samples=log.samples
    )
    (finding,) = kf.find_gap(bare, model).findings
    assert (finding.name, finding.where) == ("lever_arm", "gnss")
    for axis, value in arm.items():
        lo, hi = finding.ci95[axis]
        assert abs(value - 0.5 * (lo + hi)) < 4.0 / 1.96 * 0.5 * (hi - lo)


def test_a_log_that_cannot_tell_is_refused_in_words() -> None:
    """Point samples of a logger at 10 Hz, and a log of 8 s."""
    log = log_of("quadrotor", 1)
    slow = Log(log.t[::10], {n: replace(c, values=c.values[::10]) for n, c in log.channels.items()})
    short = Log(log.t[:800], {n: replace(c, values=c.values[:800]) for n, c in log.channels.items()})
    for cut, says in ((slow, "inertial sensors have 10 Hz"), (short, "the log lasts 7.99 s")):
        with pytest.raises(InputError, match=says):
            kf.find_gap(cut, model())


def test_a_long_flight_is_flown_on_a_slower_grid_that_keeps_the_integrals(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Four times slower: between its steps the integral of what acts is that of the samples, and innovations stay white."""
    log = log_of("quadrotor", 1)
    program = program_over(model(), log)
    whole = flight_log(log, program)
    monkeypatch.setattr("kfgen.gap.flight.flight_log.MAX_STEPS", log.n // 4)
    monkeypatch.setattr("kfgen.gap.flight.flight_log.GRID_RATE_HZ", 25.0)
    slower = flight_log(log, program)
    assert slower.dt == pytest.approx(4.0 * whole.dt)
    assert slower.t.size == log.n // 4
    fine = np.cumsum(whole.u, axis=0)[3:-4:4] * whole.dt
    np.testing.assert_allclose(np.cumsum(slower.u, axis=0)[:-1] * slower.dt, fine, atol=1e-9)
    scene = flight_scene(log, model())
    assert scene is not None
    left = fitted(scene, at(scene)).residual
    for part in map(Whitener.back, np.split(left, np.cumsum(scene.lengths)[:-1])):
        assert abs(np.mean(part**2) - 1.0) < 4.0 * np.sqrt(2.0 / part.size)
    monkeypatch.setattr("kfgen.gap.flight.flight_log.MAX_STEPS", log.n // 5)
    with pytest.raises(InputError, match="more than the 800 that are held in memory") as caught:
        flight_log(log, program)
    assert caught.value.remedy == "Give a part of the log"


@pytest.mark.long
def test_a_flight_that_is_averaged_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    log = log_of("quadrotor", 1)
    monkeypatch.setattr("kfgen.gap.flight.flight_log.MAX_STEPS", log.n // 2)
    monkeypatch.setattr("kfgen.gap.flight.flight_log.GRID_RATE_HZ", 50.0)
    monkeypatch.setattr("kfgen.gap.flight.excitation.LIBRARY", {})  # its manoeuvres are longer than that
    found = kf.find_gap(log, model())
    assert found.verdict == "no_gap"
    assert any("compared at 50 Hz" in w for w in found.warnings)


HIDDEN = [
    ("quadrotor", "time_delay", "gnss", (("delay", 0.15),)),
    ("quadrotor", "lever_arm", "gnss", (("x", 0.6), ("y", -0.3), ("z", 0.4))),
    ("wing", "scale_factor", "gyro_z", (("coefficient", 0.01),)),
    ("car", "misalignment", "accel_z", (("zx", 0.03),)),
    ("quadrotor", "hard_iron", "mag", (("x", 1e-6), ("y", -8e-7), ("z", 6e-7))),
    ("wing", "g_sensitivity", "gyro_x", (("xx", 1e-3),)),
]
Values = tuple[tuple[str, float], ...]


@lru_cache
def gap_of(vehicle: str, name: str, where: str, values: Values) -> GapResult:
    return kf.find_gap(log_of(vehicle, 3, (name, where, values)), model())


@pytest.mark.parametrize(
    ("vehicle", "name", "where", "values"),
    [pytest.param(*h, marks=[] if h[1] == "lever_arm" else pytest.mark.long) for h in HIDDEN],
)
def test_what_a_flight_hides_is_named(vehicle: str, name: str, where: str, values: Values) -> None:
    """Twice its interval holds the truth (0.01 % of the seeds for each number); `benchmarks/flight` measures how often it does."""
    found = gap_of(vehicle, name, where, values)
    assert [(f.name, f.where) for f in found.findings] == [(name, where)]
    finding = found.findings[0]
    for n, value in values:
        lo, hi = finding.ci95[n]
        assert abs(value - 0.5 * (lo + hi)) < 2.0 * 0.5 * (hi - lo)
    assert found.gap.after < found.gap.before


@pytest.mark.long
def test_what_no_effect_of_the_catalogue_is_stays_unknown() -> None:
    """A barometer that swings by 1.5 m every 7 s."""
    found = kf.find_gap(log_of("quadrotor", 5, unlisted="sine_baro"), model())
    assert found.verdict == "unknown_effect"


@pytest.mark.long
def test_what_was_found_is_in_the_emitted_filter(tmp_path: Path) -> None:
    """The updated file is a filter file, and its code has the lever arm that the assumed one lacks."""
    found = gap_of(*HIDDEN[1])
    path = tmp_path / "improved.toml"
    path.write_text(found.updated_text, encoding="utf-8")
    texts = []
    for source in (model(), path):
        kf.emit(source, tmp_path / f"{len(texts)}")
        texts.append(next((tmp_path / f"{len(texts)}").rglob("ins15.h")).read_text(encoding="utf-8"))
    assert "lever" in texts[1]
    assert "lever" not in texts[0]
