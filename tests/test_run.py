"""Proves the filter over a log: innovations and errors as large as it says, and errors measured rightly.

A filter is consistent when its normalised squares are chi-square distributed. Bands are two-sided at a
false alarm rate of `ALARM` for each test; the seeds are fixed.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from kfgen.core.errors import InputError
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name
from kfgen.log.log import Channel, Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.run.run import FilterRun, attitude_error, load, run
from kfgen.simulate.rates import at_every_sample
from kfgen.simulate.simulate import simulate

ALARM = 1e-3
SEEDS = range(12)
DURATION = 12.0
RATE = 50.0
SMALL = 0.05
"""Initial standard deviations over the priors: small enough for a linear filter."""


@cache
def program() -> Program:
    return Program(DiscreteModel(build("ins15"), order=2, rate=RATE))


@cache
def log_of(seed: int) -> Log:
    discrete = program().discrete
    return simulate(
        discrete, "generic", DURATION, np.random.default_rng(seed), rates=at_every_sample(discrete)
    )


def truth_at(log: Log, k: int) -> dict[str, Any]:
    x: dict[str, Any] = {f"{b}_{a}": log.values(f"ref_{b}_{a}")[k] for b in "pv" for a in "NED"}
    q = [log.values(f"ref_q_{a}")[k] for a in "wxyz"]
    return x | {"R": Rotation.from_quat(q, scalar_first=True)}


@cache
def biases(seed: int) -> tuple[np.ndarray, Log]:
    """Known small biases, and the log in which they replace the drawn ones."""
    rng = np.random.default_rng(1000 + seed)
    model = program().discrete.model
    bias = {s.name: SMALL * s.prior * rng.normal() for s in model.states[9:]}
    noise = {c: tuple(e for e in es if e.name != "bias") for c, es in model.noise.items()}
    silent = DiscreteModel(replace(model, noise=noise), order=2, rate=RATE)
    log = simulate(silent, "generic", DURATION, rng, rates=at_every_sample(silent))
    channels = dict(log.channels)
    for letter, triad in (("bg", "gyro"), ("ba", "accel")):
        for a in "xyz":
            old = channels[f"{triad}_{a}"]
            channels[f"{triad}_{a}"] = Channel(old.values + bias[f"{letter}_{a}"], old.unit)
    return np.array(list(bias.values())), Log(log.t, channels, source=log.source)


@cache
def consistent_run(seed: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """NEES of the whole state at the end, and the NIS of each update, from a start drawn from P."""
    p = program()
    model = p.discrete.model
    bias, log = biases(seed)
    kf = getattr(load(p), class_name(p))()
    rng = np.random.default_rng(2000 + seed)
    kf.P = kf.P * SMALL**2
    start = truth_at(log, 0)
    error = rng.multivariate_normal(np.zeros(9), kf.P[:9, :9])
    R = Rotation.from_rotvec(-error[6:9]) * start["R"]
    pv = np.array([start[f"{b}_{a}"] for b in "pv" for a in "NED"]) - error[:6]
    kf.nominal[:] = [*pv, *R.as_quat(scalar_first=True), *np.zeros(6)]
    triads = {t: np.column_stack([log.values(f"{t}_{a}") for a in "xyz"]) for t in ("gyro", "accel")}
    nis: dict[str, list[float]] = {s.name: [] for s in model.sensors}
    for k in range(log.n):
        for s in model.sensors:
            getattr(kf, f"update_{s.name}")(np.array([log.values(c)[k] for c in s.channels]))
            nis[s.name].append(kf.nis)
        if k < log.n - 1:
            kf.predict(gyro=triads["gyro"][k], accel=triads["accel"][k], dt=1.0 / RATE)
    true, x = truth_at(log, log.n - 1), np.array(kf.nominal)
    phi = (true["R"] * Rotation.from_quat(x[6:10], scalar_first=True).inv()).as_rotvec()
    pv = np.array([true[f"{b}_{a}"] for b in "pv" for a in "NED"])
    e = np.concatenate([pv - x[:6], phi, bias - x[10:16]])
    parts = [slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 15), slice(0, 15)]
    nees = [e[s] @ np.linalg.solve(kf.P[s, s], e[s]) for s in parts]
    return np.array(nees), {n: np.array(v) for n, v in nis.items()}


def in_band(total: float, freedom: int) -> bool:
    low, high = chi2.ppf([ALARM / 2, 1 - ALARM / 2], freedom)
    return bool(low < total < high)


@pytest.mark.long
@pytest.mark.parametrize(
    ("part", "rows"),
    [(0, 3), (1, 3), (2, 3), (3, 6), (4, 15)],
    ids=["position", "velocity", "attitude", "biases", "all"],
)
def test_errors_are_as_large_as_the_filter_says(part: int, rows: int) -> None:
    total = sum(consistent_run(s)[0][part] for s in SEEDS)
    assert in_band(total, rows * len(SEEDS)), total / (rows * len(SEEDS))


@pytest.mark.parametrize("sensor", ["gnss_position", "gnss_velocity"])
def test_innovations_are_as_large_as_the_filter_says(sensor: str) -> None:
    nis = np.concatenate([consistent_run(s)[1][sensor] for s in SEEDS])
    assert in_band(nis.sum(), 3 * nis.size), nis.mean()


@pytest.mark.parametrize("sensor", in_part(["gnss_position", "gnss_velocity"]))
def test_innovations_over_a_log_after_the_alignment(sensor: str) -> None:
    """`run` aligns by itself, roughly: after the first seconds its innovations are white and sized."""
    runs = [run(program(), log_of(s)).sensors[sensor] for s in (0, 1, 2)]
    nis = np.concatenate([r.nis[r.t > 6.0] for r in runs])
    assert in_band(nis.sum(), 3 * nis.size), nis.mean()
    y = np.concatenate([r.innovation[r.t > 6.0] for r in runs])
    lag = (y[1:] * y[:-1]).sum(axis=0) / (y**2).sum(axis=0)
    assert np.abs(lag).max() < 4.0 / np.sqrt(len(y))


def test_a_filter_that_assumes_too_small_a_noise_leaves_the_band() -> None:
    """The band can fail: GNSS 1.3 times as noisy as assumed."""
    nis = np.concatenate([consistent_run(s)[1]["gnss_position"] for s in SEEDS])
    assert not in_band(1.3**2 * nis.sum(), 3 * nis.size)


def made(tilt: np.ndarray, heading: np.ndarray, extra: dict[str, np.ndarray] | None = None) -> Any:
    """A run that is off by `tilt` about horizontal axes, then `heading` about down, from a random motion."""
    rng = np.random.default_rng(3)
    n = len(heading)
    reference = Rotation.random(n, random_state=rng)
    axis = rng.uniform(0, 2 * np.pi, n)
    lean = Rotation.from_rotvec(tilt[:, None] * np.column_stack([np.cos(axis), np.sin(axis), np.zeros(n)]))
    turn = Rotation.from_rotvec(np.outer(heading, [0.0, 0.0, 1.0]))
    q = (turn * lean * reference).as_quat(scalar_first=True) * rng.choice([-1.0, 1.0], (n, 1))
    ref = reference.as_quat(scalar_first=True)
    channels = {f"ref_q_{a}": Channel(ref[:, k], "") for k, a in enumerate("wxyz")}
    channels |= {k: Channel(v, "") for k, v in (extra or {}).items()}
    t = np.arange(n) * 0.01
    result = FilterRun("x", t, ("q_w", "q_x", "q_y", "q_z"), q, np.zeros((n, 3)), {})
    return result, Log(t, channels)


@pytest.mark.parametrize("offset", [0.0, 1.0, 3.1, -2.0])
def test_tilt_and_heading_errors_are_distinguished(offset: float) -> None:
    rng = np.random.default_rng(0)
    tilt, heading = rng.uniform(0.0, 0.6, 500), 0.2 * rng.normal(size=500)
    error = attitude_error(*made(tilt, heading + offset))
    assert error is not None
    assert error.samples == 500
    assert error.inclination == pytest.approx(np.sqrt(np.mean(tilt**2)), rel=1e-9)
    centred = heading - np.angle(np.mean(np.exp(1j * heading)))
    assert error.heading == pytest.approx(np.sqrt(np.mean(centred**2)), rel=1e-9)
    lean = Rotation.from_rotvec(np.outer(tilt, [1.0, 0.0, 0.0]))
    angle = (Rotation.from_rotvec(np.outer(centred, [0.0, 0.0, 1.0])) * lean).magnitude()
    assert error.total == pytest.approx(np.sqrt(np.mean(angle**2)), rel=1e-7)


def test_a_constant_heading_is_no_error_and_a_constant_tilt_is() -> None:
    error = attitude_error(*made(np.full(50, 0.3), np.full(50, 2.5)))
    assert error is not None
    assert error.heading == pytest.approx(0.0, abs=1e-7)
    assert error.inclination == pytest.approx(0.3, rel=1e-9)


def test_only_samples_in_movement_with_a_reference_count() -> None:
    tilt, moving = np.full(100, 0.1), np.repeat([1.0, 0.0], 50)
    tilt[50:] = 1.0
    result, log = made(tilt, np.zeros(100), {"movement": moving})
    broken = log.values("ref_q_w").copy()
    broken[:10] = np.nan
    log = Log(log.t, dict(log.channels) | {"ref_q_w": Channel(broken, "")})
    error = attitude_error(result, log)
    assert error is not None
    assert error.samples == 40
    assert error.inclination == pytest.approx(0.1, rel=1e-9)


def test_without_a_reference_there_is_no_error() -> None:
    result, log = made(np.zeros(5), np.zeros(5))
    rest = {k: v for k, v in log.channels.items() if k != "ref_q_z"}
    assert attitude_error(result, Log(log.t, rest)) is None


def test_where_no_sample_counts_there_is_no_error() -> None:
    result, log = made(np.zeros(5), np.zeros(5), {"movement": np.zeros(5)})
    assert attitude_error(result, log) is None


def test_a_log_without_sensors_or_inputs_is_refused_in_words() -> None:
    log = log_of(0)
    blind = {k: v for k, v in log.channels.items() if not k.startswith("gnss")}
    with pytest.raises(InputError, match="no sensor of ins15"):
        run(program(), Log(log.t, blind))
    with pytest.raises(InputError, match="gyro_x"):
        run(program(), Log(log.t, {k: v for k, v in log.channels.items() if k != "gyro_x"}))


def test_sensor_with_gaps_updates_where_it_has_samples() -> None:
    log = log_of(1)
    values = log.values("gnss_p_E").copy()
    values[np.arange(log.n) % 10 != 0] = np.nan
    result = run(program(), Log(log.t, dict(log.channels) | {"gnss_p_E": Channel(values, "m")}))
    assert result.sensors["gnss_position"].t.size == log.n // 10
    assert result.sensors["gnss_velocity"].t.size == log.n
    assert np.isfinite(result.estimate).all()


@pytest.mark.long
def test_real_recording_of_a_slow_rotation(
    kfgen: Callable[..., Any], recording: Callable[[str], Path], tmp_path: Path
) -> None:
    """BROAD trial 1: inclination within 2 degrees of the optical reference, by the command line."""
    path = recording("dynamic/broad_01_undisturbed_slow_rotation_A.npz")
    done = kfgen("run", "ahrs6", path, "--json", tmp_path / "run.json")
    assert done.exit_code == 0, done.output
    data = json.loads((tmp_path / "run.json").read_text())
    assert data["format"] == "kfgen-run-1"
    error = data["attitude_error"]
    assert error["unit"] == "rad"
    assert error["samples"] > 1000
    assert 0.0 < np.degrees(error["inclination_rmse"]) < 2.0


@cache
def turning() -> Log:
    model = build("ahrs6", None, {"left_out": "false"})
    return simulate(DiscreteModel(model, rate=RATE), "generic", 10.0, np.random.default_rng(8))


def shifted(log: Log, by: int) -> Log:
    channels = {
        n: Channel(np.roll(c.values, by), c.unit) if n.startswith("gyro") else c
        for n, c in log.channels.items()
    }
    return Log(log.t, channels, source=log.source)


def ahrs(log: Log, **options: str) -> FilterRun:
    return run(Program(DiscreteModel(build("ahrs6", None, options), rate=RATE)), log)


def test_a_sample_of_the_interval_before_acts_a_step_earlier() -> None:
    log = turning()
    usual, before = ahrs(log).estimate, ahrs(shifted(log, 1), samples="before").estimate
    np.testing.assert_allclose(before[:-1], usual[:-1], rtol=1e-12)
    middle = ahrs(log, samples="at").estimate
    assert 1e-4 < np.abs(middle - usual)[:, :4].max() < 0.02


def test_samples_of_a_disturbed_field_are_left_out() -> None:
    log = turning()
    values = log.values("mag_x").copy()
    values[200:300] += 60e-6
    bent = Log(log.t, dict(log.channels) | {"mag_x": Channel(values, "T")}, source=log.source)
    open_, gated = ahrs(bent), ahrs(bent, field_gate="0.1")
    assert open_.sensors["mag"].t.size == log.n
    assert gated.sensors["mag"].t.size == log.n - 100
    assert gated.sensors["accel"].t.size == log.n
    clean, off = attitude_error(gated, bent), attitude_error(open_, bent)
    assert clean is not None
    assert off is not None
    assert clean.total < 0.25 * off.total
