"""The answer of `kfgen run`: errors against a reference, tracks, bands of innovations, decisions at the gate, pages."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from scipy.spatial.transform import Rotation
from scipy.stats import norm

import kfgen as kf
from kfgen.emit.targets.filterpy import class_name
from kfgen.log.log import Channel, Log
from kfgen.log.readers import write_log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter_equations import FilterEquations
from kfgen.report.figures.run_figures import run_parts
from kfgen.report.page import PagePart
from kfgen.run.against_reference import BAND_SIGMAS, CHANCE_OUTSIDE_PERCENT, state_errors
from kfgen.run.band import MIN_PART_SAMPLES, windows_outside
from kfgen.run.estimates import estimates
from kfgen.run.filter_calls import FilterCalls
from kfgen.run.run import FilterRun, load, program_over, run
from kfgen.simulate.simulate import simulate

RATE = 50.0
HIT, FAR_M = 6.0, 300.0
"""Time of a fix that is far off, and by how much."""


@cache
def flight(options: tuple[tuple[str, str], ...] = ()) -> Log:
    model = kf.build("ins15", options=dict(options))
    return simulate(DiscreteModel.at_rate(model, RATE), "generic", 12.0, np.random.default_rng(5))


def changed(log: Log, **values: np.ndarray) -> Log:
    new = {n: Channel(v, log.channels[n].unit if n in log.channels else "") for n, v in values.items()}
    return Log(log.t, dict(log.channels) | new, source=log.source)


def without(log: Log, *begins: str) -> Log:
    return Log(log.t, {n: c for n, c in log.channels.items() if not n.startswith(begins)}, source=log.source)


def by_title(result: FilterRun) -> dict[str, Any]:
    return {e.title: e for e in result.errors}


def figures(result: FilterRun) -> list[PagePart]:
    return [p for p in run_parts(result) if p.kind == "figure"]


def test_errors_of_position_and_velocity_are_reference_less_estimate_with_the_filters_deviations() -> None:
    result = run("ins15", flight())
    errors = by_title(result)
    assert list(errors) == ["position", "velocity", "attitude"]
    for title, letter in (("position", "p"), ("velocity", "v")):
        names = [f"{letter}_{a}" for a in "NED"]
        estimated = np.column_stack([result.estimate[:, result.names.index(n)] for n in names])
        true = np.column_stack([flight().values(f"ref_{n}") for n in names])
        np.testing.assert_allclose(errors[title].error, true - estimated, atol=1e-9)
        first = {"p": 0, "v": 3}[letter]
        np.testing.assert_array_equal(errors[title].deviation, result.deviation[:, first : first + 3])


@pytest.mark.parametrize(
    "options", in_part([{}, {"attitude_error": "local-quaternion"}, {"frame": "ecef"}]), ids=str
)
def test_errors_of_attitude_are_the_rotation_from_estimate_to_reference(options: dict[str, str]) -> None:
    log = flight(tuple(options.items()))
    result = run(kf.build("ins15", options=options), log)
    error = by_title(result)["attitude"]
    at = result.names.index("q_w")
    R = Rotation.from_quat(result.estimate[:, at : at + 4], scalar_first=True)
    true = Rotation.from_quat(np.column_stack([log.values(f"ref_q_{a}") for a in "wxyz"]), scalar_first=True)
    whole = R.inv() * true if "attitude_error" in options else true * R.inv()
    assert error.north == 0.0  # positions say where north is
    np.testing.assert_allclose(error.error, whole.as_rotvec(), atol=2e-4)


@pytest.mark.parametrize("convention", ["phi", "modified-phi", "right-invariant", "local-quaternion"])
def test_errors_are_those_of_the_filters_convention(convention: str) -> None:
    """Truths made by putting known errors into the estimates, as the filter puts its corrections in."""
    model = kf.build("ins15", options={"attitude_error": convention})
    equations = FilterEquations(DiscreteModel.at_rate(model, RATE))
    rng = np.random.default_rng(7)
    x = equations.normalised(rng.normal(0.0, 3.0, (200, len(equations.names))))
    put_in = np.hstack([rng.normal(0.0, s, (200, 3)) for s in (1.0, 0.2, 0.02, 0.0, 0.0)])
    truth = equations.injected(x, put_in)
    channels = {f"ref_{n}": Channel(truth[:, k], "") for k, n in enumerate(equations.names) if n[0] in "pvq"}
    found = state_errors(equations, x, np.ones_like(put_in), Log(np.arange(200) / RATE, channels))
    np.testing.assert_allclose(np.hstack([e.error for e in found]), put_in[:, :9], atol=1e-7)


def test_a_large_error_of_attitude_is_its_rotation() -> None:
    model = kf.build("ahrs6")
    equations = FilterEquations(DiscreteModel.at_rate(model, RATE))
    true = Rotation.random(50, random_state=np.random.default_rng(1))
    lean = Rotation.from_rotvec([2.5, 0.0, 0.0])
    x = np.zeros((50, len(equations.names)))
    x[:, :4] = (lean.inv() * true).as_quat(scalar_first=True)
    q = true.as_quat(scalar_first=True)
    log = Log(np.arange(50) / RATE, {f"ref_q_{a}": Channel(q[:, k], "") for k, a in enumerate("wxyz")})
    (error,) = state_errors(equations, x, np.ones((50, equations.n)), log)
    np.testing.assert_allclose(error.error, np.tile([2.5, 0.0, 0.0], (50, 1)), atol=1e-9)


@pytest.mark.parametrize("offset", [0.4, -2.8])
def test_an_attitude_alone_has_a_north_of_its_own(offset: float) -> None:
    model = kf.build("ahrs6")
    log = simulate(DiscreteModel.at_rate(model, RATE), "generic", 8.0, np.random.default_rng(8))
    log = without(log, "ref_p", "ref_v")
    q = Rotation.from_quat(np.column_stack([log.values(f"ref_q_{a}") for a in "wxyz"]), scalar_first=True)
    away = (Rotation.from_rotvec([0.0, 0.0, -offset]) * q).as_quat(scalar_first=True)
    turned = changed(log, **{f"ref_q_{a}": away[:, k] for k, a in enumerate("wxyz")})
    plain, other = (by_title(run("ahrs6", x))["attitude"] for x in (log, turned))
    assert abs(plain.north) < 0.1
    assert abs(other.north - plain.north - offset) < 1e-9
    np.testing.assert_allclose(other.error, plain.error, atol=1e-9)


def test_samples_without_a_reference_are_no_error() -> None:
    gaps = flight().values("ref_p_E").copy()
    gaps[::3] = np.nan
    result = run("ins15", changed(flight(), ref_p_E=gaps))
    errors = by_title(result)
    assert errors["position"].t.size == np.isfinite(gaps).sum()
    assert errors["velocity"].t.size == flight().n
    assert np.isfinite(errors["position"].error).all()


def test_the_share_of_errors_outside_by_chance_is_that_of_the_normal_distribution() -> None:
    assert pytest.approx(100.0 * 2.0 * norm.sf(BAND_SIGMAS), abs=0.005) == CHANCE_OUTSIDE_PERCENT


def test_the_sum_of_normalised_innovations_squared_is_the_nis() -> None:
    """Rows are fused one after the other: each innovation is that given the rows before it."""
    for s in run("ins15", flight()).updated.values():
        assert s.normalised is not None
        np.testing.assert_allclose((s.normalised**2).sum(axis=1), s.nis, rtol=1e-6, atol=1e-12)


@cache
def hit() -> tuple[Log, FilterRun]:
    """A flight with one fix that is far off."""
    east = flight().channel("gnss_p_E").values.copy()
    fixes = np.flatnonzero(np.isfinite(east))
    east[fixes[np.searchsorted(flight().t[fixes], HIT)]] += FAR_M
    log = changed(flight(), gnss_p_E=east)
    return log, run("ins15", log)


def test_the_decision_at_the_gate_is_that_of_the_emitted_filter() -> None:
    """The same call on the same filter with its own gate is refused where the run says so, and only there."""
    log, result = hit()
    program = program_over(kf.build("ins15"), log)
    emitted = getattr(load(program), class_name(program))
    gates = dict(emitted().gates)
    loose = emitted()
    calls = FilterCalls(program, log)
    loose.nominal[:], loose.constants[:] = calls.start, calls.constants
    decided: dict[str, list[bool]] = {n: [] for n in calls.present}
    for k in range(log.n):
        for call in [*calls.updates(k), *calls.steps(k)]:
            loose.gates = dict.fromkeys(gates, np.inf)
            if call.sensor:
                before, P, memory = list(loose.nominal), loose.P.copy(), list(loose.supervisor)
                loose.gates = dict(gates)
                status = getattr(loose, call.routine)(**call.given)
                decided[call.sensor].append(status.name != "GATED")
                loose.nominal[:], loose.P, loose.supervisor[:] = before, P, memory
                loose.gates = dict.fromkeys(gates, np.inf)
            getattr(loose, call.routine)(**call.given)
    for name, sensor in result.updated.items():
        assert sensor.is_accepted.tolist() == decided[name]
    assert result.sensors["gnss_position"].beyond_gate >= 1


def test_what_is_beyond_the_gate_is_said_everywhere(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    log, result = hit()
    count = result.sensors["gnss_position"].beyond_gate
    table = estimates(result, kf.build("ins15"))
    accepted = table.channel("accepted_gnss_position").values
    assert np.nansum(accepted == 0.0) == count
    at = int(np.flatnonzero(accepted == 0.0)[0])
    assert log.t[at] == pytest.approx(HIT, abs=0.2)
    over, nis = table.channel("nis_over_gate_gnss_position").values, table.channel("nis_gnss_position").values
    np.testing.assert_allclose(over, nis / 10.0**2)
    assert ((over > 1.0) == (accepted == 0.0)).all()
    words = f"{count} of 60 samples"
    assert words in result.consistency("gnss_position")
    assert "gate" not in result.consistency("gnss_velocity") or result.sensors["gnss_velocity"].beyond_gate
    assert result.to_dict()["sensors"]["gnss_position"]["beyond_gate"] == count
    write_log(log, tmp_path / "hit.npz")
    done = kfgen("run", "ins15", tmp_path / "hit.npz", "--report", tmp_path / "page.html")
    assert done.exit_code == 0, done.output
    assert words in " ".join(done.output.split())
    assert words in (tmp_path / "page.html").read_text()


def test_a_sample_that_the_filter_refuses_is_no_update() -> None:
    """A fix beyond the range of the filter's inputs was counted with the innovation of the sample before it."""
    north = flight().channel("gnss_p_N").values.copy()
    at = np.flatnonzero(np.isfinite(north))[20]
    north[at] = 1e9
    s = run("ins15", changed(flight(), gnss_p_N=north)).sensors["gnss_position"]
    assert s.t.size == np.isfinite(north).sum() - 1
    assert flight().t[at] not in s.t


def test_tracks_are_the_estimates_the_reference_and_the_fixes() -> None:
    result = run("ins15", flight())
    tracks = {k.label: k for k in result.tracks}
    assert list(tracks) == ["filter", "reference", "GNSS"]
    true = np.column_stack([flight().values(f"ref_p_{a}") for a in "NED"]) * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(tracks["reference"].position, true, atol=1e-9)
    q = Rotation.from_quat(
        np.column_stack([flight().values(f"ref_q_{a}") for a in "wxyz"]), scalar_first=True
    )
    attitude = tracks["reference"].attitude
    assert attitude is not None
    again = Rotation.from_euler("ZYX", attitude[:, ::-1])
    assert (again.inv() * q).magnitude().max() < 1e-7
    fixes = np.isfinite(flight().channel("gnss_p_N").values)
    assert tracks["GNSS"].position is not None
    np.testing.assert_allclose(tracks["GNSS"].position[:, 0], flight().channel("gnss_p_N").values[fixes])


def test_a_track_in_earth_axes_is_shown_level_at_the_start() -> None:
    """At the start down is towards the Earth's axis and centre: a level motion has no height over a kilometre."""
    log = flight((("frame", "ecef"),))
    tracks = {k.label: k for k in run(kf.build("ins15", options={"frame": "ecef"}), log).tracks}
    level = {k.label: k for k in run("ins15", flight()).tracks}
    here, there = (x["reference"].position for x in (tracks, level))
    assert here is not None
    assert there is not None
    np.testing.assert_allclose(here - here[0], there - there[0], atol=0.05)
    turned, flat = (x["reference"].attitude for x in (tracks, level))
    assert turned is not None
    assert flat is not None
    away = Rotation.from_euler("ZYX", turned[:, ::-1]).inv() * Rotation.from_euler("ZYX", flat[:, ::-1])
    assert away.magnitude().max() < 1e-3


@pytest.mark.long
def test_a_page_shows_what_the_log_has() -> None:
    headings = [p.content for p in run_parts(run("ins15", flight())) if p.kind == "heading"]
    assert headings == ["Track", "Attitude", "Errors against the reference", "Innovations"]
    blind = run("ins15", without(flight(), "ref_"))
    assert [p.content for p in run_parts(blind) if p.kind == "heading"] == [
        "Track",
        "Attitude",
        "Innovations",
    ]
    turning = simulate(
        DiscreteModel.at_rate(kf.build("ahrs6"), RATE), "generic", 4.0, np.random.default_rng(8)
    )
    still = run("ahrs6", without(turning, "ref_"))
    assert [p.content for p in run_parts(still) if p.kind == "heading"] == ["Attitude", "Innovations"]
    for result in (blind, still):
        assert all("<svg" in p.drawn for p in figures(result))


def test_a_smoothed_run_shows_the_filter_beside() -> None:
    result = run("ins15", flight(), smooth=True)
    assert result.forward is not None
    labels = [k.label for k in result.tracks]
    assert labels == ["smoothed", "filter", "reference", "GNSS"]
    assert not np.array_equal(result.tracks[0].position, result.tracks[1].position)
    drawn = " ".join(p.drawn for p in figures(result))
    assert "3 standard deviations, smoothed" in drawn
    assert "3 standard deviations, filter" in drawn


def test_an_adapting_filter_has_no_band() -> None:
    result = run("ins15", flight(), adaptive="sage-husa")
    said = " ".join(p.caption for p in figures(result))
    assert "there is no band" in said
    assert "bands" not in result.to_dict()["sensors"]["gnss_position"]


def test_short_series_leave_their_band_for_a_time_by_chance_never() -> None:
    """Once in ten thousand parts: of 2000 series of 200 samples, 8 parts each, a few at most."""
    rng = np.random.default_rng(11)
    t = np.arange(200.0)
    alarms = sum(bool(windows_outside(rng.standard_normal(200), t)) for _ in range(2000))
    assert alarms <= 10
    x = rng.standard_normal(200)
    x[100:150] = 5.0
    ((lo, hi),) = windows_outside(x, t)
    assert abs(lo - 100.0) <= MIN_PART_SAMPLES
    assert abs(hi - 150.0) <= MIN_PART_SAMPLES
