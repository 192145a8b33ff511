"""The examples on real recordings say what their sources, or an independent measurement, say."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part

import kfgen as kf

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples" / "recordings"
long = pytest.mark.long


@pytest.fixture
def said(recording: Callable[[str], Path], tmp_path: Path) -> Callable[..., str]:
    """What an example prints of one case of its."""

    def run(script: str, case: str, file: str) -> str:
        recording(file)
        words = [sys.executable, str(FOLDER / f"{script}.py"), case, "--pages", str(tmp_path)]
        env = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(words, capture_output=True, text=True, check=False, env=env)
        assert done.returncode == 0, done.stderr
        assert script == "vibration" or (tmp_path / f"{case}.html").stat().st_size > 10_000
        return done.stdout

    return run


def number(text: str, before: str) -> float:
    """The number after some words."""
    found = re.search(re.escape(before) + r"(-?[0-9.e+-]+)", text)
    assert found, f"'{before}' is not in {text}"
    return float(found.group(1))


def line_of(text: str, *parts: str) -> str:
    """The line that has all parts."""
    lines = [line for line in text.splitlines() if all(p in line for p in parts)]
    assert lines, f"no line with {parts} in {text}"
    return lines[0]


@pytest.mark.long
def test_a_ranger_whose_header_is_wrong(said: Callable[..., str]) -> None:
    """200 244 samples in the 3600 s of its header are 55.62 Hz, not 50."""
    text = said("ranger_rate", "ranger", "static/tof_vl53l0x_1h.npz")
    assert number(text, "was sampled ") == pytest.approx(200_244 / 3600.0 / 50.0, abs=0.005)


def test_poses_give_the_published_table(said: Callable[..., str]) -> None:
    """Bias to 3 mm/s^2; scale to 0.03 %, with the published table's g of 9.81 m/s^2."""
    text = said("poses", "poses-0", "effects/mpu9150_calib_imu0.npz")
    for axis, bias, scale in (("x", 0.103, 0.36), ("y", 0.097, 0.32), ("z", 0.345, 0.62)):
        assert number(line_of(text, f"accel_{axis}", "constant bias"), "value = ") == pytest.approx(
            bias, abs=3e-3
        )
        got = number(line_of(text, f"accel_{axis}", "scale factor"), "coefficient = ")
        assert got - 100.0 * (9.81 / 9.80665 - 1.0) == pytest.approx(scale, abs=0.03)


@pytest.mark.long
def test_turns_give_the_scale(said: Callable[..., str]) -> None:
    """Integrals of 370.0 and 353.7 deg over whole turns."""
    text = said("turns", "turns", "effects/imu_ferraris_session.npz")
    for axis, turned in (("x", 370.0), ("y", 353.7)):
        got = number(line_of(text, f"gyro_{axis}", "scale factor"), "coefficient = ")
        assert got == pytest.approx(100.0 * (turned / 360.0 - 1.0), abs=0.1)


@pytest.mark.long
def test_gps_is_late(said: Callable[..., str]) -> None:
    """230 ms by the author of the recording, 250 to 300 ms by cross-correlation of the same accelerations."""
    text = said("flight", "flight", "dynamic/inertialnav_swisslog1.npz")
    assert 0.2 < number(text, "in all ") < 0.35


AUTHOR_DELAYS_S = (0.23, 0.21)
"""Of velocity and of position, as the author of the fixed wing's log found them by hand, one receiver's."""
MAX_WIDTH_S = 0.1
"""Of an interval that still tells a delay: half the receiver's period of 0.2 s."""


@long
def test_a_receiver_is_late_without_a_reference(said: Callable[..., str]) -> None:
    """One delay for both is compared with its author's two, whose mean is uncertain by half of what they differ.

    The interval meets what they span; the distance from their mean is within 2.58 standard deviations of both together,
    false-alarm rate 1 %. Nothing, 0.12 s or 0.3 s fail.
    """
    text = said("fixed_wing_flight", "fixed-wing", "dynamic/inertialnav_swisslog1.npz")
    line = line_of(text, "model of gnss is missing", "time delay")
    lo, hi = (float(x) for x in re.findall(r"95 %: ([0-9.]+) to ([0-9.]+)", line)[0])
    assert hi - lo < MAX_WIDTH_S
    assert lo < max(AUTHOR_DELAYS_S)
    assert hi > min(AUTHOR_DELAYS_S)
    middle, half = 0.5 * sum(AUTHOR_DELAYS_S), 0.5 * (max(AUTHOR_DELAYS_S) - min(AUTHOR_DELAYS_S))
    sd = np.hypot((hi - lo) / (2.0 * 1.96), half)
    assert number(line, "delay = ") == pytest.approx(middle, abs=2.58 * sd)
    drift = re.findall(r"drifts ([0-9.]+) m as assumed and ([0-9.]+) m", text)[0]
    assert float(drift[1]) < 0.8 * float(drift[0])


@long
def test_a_walk_with_a_receiver_beside(said: Callable[..., str]) -> None:
    """The antenna is 0.05 m beside the sensor, by its author's ruler."""
    text = said("walk", "walk", "flights/rtk_walk_imu.csv")
    arm = line_of(text, "model of gnss is missing", "lever arm")
    assert abs(number(arm, "y = ")) == pytest.approx(0.05, abs=0.01)
    assert number(line_of(text, "gnss_v", "finite bandwidth"), "corner = ") == pytest.approx(1.4, abs=0.2)


@long
@pytest.mark.parametrize(
    ("case", "file"), [("jammed", "gps_interference"), ("brown-out", "battery_brownout")]
)
def test_flights_that_nothing_places_get_no_certain_name(
    said: Callable[..., str], case: str, file: str
) -> None:
    """Nobody knows what is wrong with these; without a fix no more than a stand-in can be named, and none beyond 100 %."""
    text = said("px4_flights", case, f"flights/px4_{file}.ulg")
    assert "verdict unknown_effect" in text
    assert max((float(p) for p in re.findall(r"\((\d+) %\)", text)), default=0.0) <= 90.0
    shares = re.findall(r"(?:coefficient|[xyz]{2}) = (-?[0-9.e+]+) %", text)
    assert all(abs(float(x)) <= 100.0 for x in shares)


@pytest.mark.parametrize(
    ("case", "file", "inside"),
    in_part(
        [
            ("tapping", "25_disturbed_tapping_B", (50.0, 100.0)),
            ("phone", "27_disturbed_phone_vibration_B", (70.0, 160.0)),
            pytest.param("quiet", "01_undisturbed_slow_rotation_A", None, marks=pytest.mark.long),
        ]
    ),
)
def test_vibration_has_its_time(
    said: Callable[..., str], case: str, file: str, inside: tuple[float, float] | None
) -> None:
    text = said("vibration", case, f"dynamic/broad_{file}.npz")
    spans = [(float(a), float(b)) for a, b in re.findall(r"(\d+) to (\d+) s", text)]
    if inside is None:
        assert spans == []
    else:
        assert any(a <= inside[0] and inside[1] <= b for a, b in spans)


@long
def test_a_gyro_warms_up(said: Callable[..., str]) -> None:
    """Least squares of one exponential through the record: 0.42 to 0.45 deg/s, 21 700 to 25 500 samples at 200 Hz."""
    text = line_of(said("gyro_warm_up", "warm-up", "static/gyro_875mdps_warmup.npz"), "warm-up after")
    assert 0.40 < number(text, "size = ") * 0.00875 < 0.48
    assert 100.0 < number(text, "tau = ") < 135.0


@long
def test_a_line_in_a_gyro(said: Callable[..., str]) -> None:
    """It is 0.03 Hz wide in 450 s, and is called a line or a resonance without damping."""
    text = line_of(said("gyro_line", "line", "static/mpu6050_static_450s.npz"), "gyro_y", "frequency = ")
    assert number(text, "frequency = ") == pytest.approx(38.0, abs=0.05)


@long
@pytest.mark.parametrize(
    ("case", "file", "iron"),
    [
        ("magnet-33", "33_disturbed_attached_magnet_2cm", (-2.9, -0.5, 26.8)),
        ("magnet-36", "36_disturbed_attached_magnet_5cm", (0.1, -0.2, -6.1)),
    ],
)
def test_a_magnet_on_a_magnetometer(
    said: Callable[..., str], case: str, file: str, iron: tuple[float, float, float]
) -> None:
    """Within 1 uT of what the sensor's difference to the undisturbed field over the minute gives."""
    text = line_of(said("magnet", case, f"dynamic/broad_{file}.npz"), "hard iron")
    found = [number(text, f"{a} = ") for a in "xyz"]
    assert found == pytest.approx(iron, abs=1.0)


@long
@pytest.mark.parametrize(
    ("case", "file"),
    [("no-magnet-01", "01_undisturbed_slow_rotation_A"), ("no-magnet-06", "06_undisturbed_fast_rotation_A")],
)
def test_no_magnet(said: Callable[..., str], case: str, file: str) -> None:
    assert "hard iron" not in said("magnet", case, f"dynamic/broad_{file}.npz")


@long
@pytest.mark.parametrize(
    ("case", "file"),
    [
        ("steps", "sinal2_degraus_malha_fechada"),
        ("slow", "sinal1_semi_estatica_malha_fechada"),
        ("flight", "dados_14_drone"),
    ],
)
def test_a_propeller_is_quadratic(said: Callable[..., str], case: str, file: str) -> None:
    """The published model with its square comes to 4.1 deg in a free run over the steps, one without to 11.5.

    A least-squares fit of free runs cannot decide between the square and a dead zone of 17.4 beside dry friction: 2.3 and 2.1
    deg in flight, 2.7 and 3.2 over the steps, 1.9 and 2.0 in the slow one.
    """
    text = said("quarter_drone", case, f"systems/quarter_drone_{file}.npz")
    named = re.search(r"square law of an actuator, share = ([\d.]+)", text)
    if named:
        assert 0.5 < float(named[1]) < 1.5
    else:
        assert "does not rule out square_law" in line_of(text, "dead zone of an actuator")
    assert number(text, "deg, then by ") < 4.1


@long
def test_a_joint_has_dry_friction(said: Callable[..., str]) -> None:
    """A linear fit of the smoothed acceleration has 0.158 N m beside an inertia of 0.215 kg m^2: 0.73 rad/s^2.

    The clock ends the search, so what stands beside it differs, and with it the level, to a third.
    """
    text = said("pendulum", "swing_up", "systems/dfki_simple_pendulum.npz")
    assert 0.5 < number(line_of(text, "dry (Coulomb) friction"), "level = ") < 1.0
    assert number(text.splitlines()[-1], "  ") > 90.0


@long
def test_a_climb_shows_that_the_receiver_is_late(recording: Callable[[str], Path]) -> None:
    """PX4-ECL's replay of a simulated quadrotor that moves up and down; an independent fit has 0.200 s with 0.016 s."""
    found = kf.find_gap(recording("flights/ecl_iris_gps_replay.csv"), "ins15")
    assert {f.name for f in found.findings} == {"time_delay"}
    assert all(f.where.startswith("gnss") for f in found.findings)
    delays = [float(f.effect.row("")["delay"][0]) for f in found.findings]
    assert all(0.14 < d < 0.25 for d in delays)
