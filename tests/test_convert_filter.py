"""Proves that a filter file becomes parameters by which the autopilot undoes what was found.

What an autopilot does with its parameters is written down here once more, from its source, and run on samples that the
effects of the file have spoiled.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from typer.testing import Result

from kfgen.consumers import convert
from kfgen.consumers.autopilots import ardupilot, px4
from kfgen.consumers.autopilots.settable_values import SettableValues
from kfgen.consumers.autopilots.settings import settled
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.model.filter_file import FilterFile, write_filter

Cli = Callable[..., Result]
GAUSS = 1e-4
OPTIONS = {"delay": "0.1 s", "lever_arm": "10 0 -5 cm"}
FIELD = np.array([0.2, 0.05, -0.4]) * GAUSS
HARD, PER_AMPERE = np.array([0.03, -0.02, 0.12]) * GAUSS, np.array([4.0, -1.0, 2.5]) * 1e-3 * GAUSS
SOFT = np.array([[0.03, 0.01, -0.02], [0.01, -0.04, 0.005], [-0.02, 0.005, 0.02]])


def file(channels: dict[str, list[object]], options: dict[str, str] | None = None) -> FilterFile:
    units = {"gyro": "rad/s", "accel": "m/s^2"}
    noise = {
        k: ChannelNoise(units.get(k.partition("_")[0], "1"), tuple(map(Term, v)))  # type: ignore[arg-type]
        for k, v in channels.items()
    }
    return FilterFile("quad", "ins15", options=options or {}, noise=NoiseModel(noise))


def magnetic() -> FilterFile:
    entries = {i + j: SOFT[k, m] for k, i in enumerate("xyz") for m, j in enumerate("xyz")}
    own = [make("hard_iron", **dict(zip("xyz", HARD, strict=True))), make("soft_iron", **entries)]
    current = {
        f"mag_{a}": [make("supply_current", coefficient=c)] for a, c in zip("xyz", PER_AMPERE, strict=True)
    }
    return file({"mag": own, **current})


def written(module: str, made: str) -> dict[str, float]:
    pattern = r"^param set (\w+) (\S+)$" if module == "px4" else r"^(\w+),(\S+)$"
    return {k: float(v) for k, v in re.findall(pattern, made, re.M)}


def axes(found: dict[str, float], name: str) -> np.ndarray:
    return np.array([found[name.format(a)] for a in "XYZ"])


def symmetric(diagonal: np.ndarray, off: np.ndarray) -> np.ndarray:
    xy, xz, yz = off
    return np.diag(diagonal) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])


AMPERES = 17.0


def sample(field: np.ndarray, current: float) -> np.ndarray:
    """What the effects of the file make of a field."""
    return (np.eye(3) + SOFT) @ field + HARD + PER_AMPERE * current


def test_px4_undoes_iron_and_current() -> None:
    """`Correct` of its Magnetometer.hpp: scale ((sample + power comp) - offset), gauss and kiloampere."""
    found = written("px4", convert(magnetic(), "px4").text)
    D = symmetric(axes(found, "CAL_MAG0_{}SCALE"), axes(found, "CAL_MAG0_{}ODIAG"))
    raw = sample(FIELD, AMPERES) / GAUSS
    corrected = D @ ((raw + 1e-3 * AMPERES * axes(found, "CAL_MAG0_{}COMP")) - axes(found, "CAL_MAG0_{}OFF"))
    assert corrected == pytest.approx(FIELD / GAUSS, abs=2e-6)
    assert found["CAL_MAG_COMP_TYP"] == 2


def test_ardupilot_undoes_iron_and_current() -> None:
    """`correct_field` of its AP_Compass_Backend.cpp: D (sample + offset + mot current), milligauss and ampere."""
    found = written("ardupilot", convert(magnetic(), "ardupilot").text)
    D = symmetric(axes(found, "COMPASS_DIA_{}"), axes(found, "COMPASS_ODI_{}"))
    raw = 1e3 * sample(FIELD, AMPERES) / GAUSS
    corrected = D @ (raw + axes(found, "COMPASS_OFS_{}") + axes(found, "COMPASS_MOT_{}") * AMPERES)
    assert corrected == pytest.approx(1e3 * FIELD / GAUSS, abs=2e-3)
    assert found["COMPASS_MOTCT"] == 2


def test_calibrated_samples_are_said() -> None:
    made = convert(magnetic(), "px4")
    assert any(
        "CAL_MAG0_XOFF" in w and "add these numbers to the values that flew" in w for w in made.warnings
    )


def test_what_was_found_is_added_to_what_was_assumed() -> None:
    arm = make("lever_arm", x=0.2, y=-0.1, z=0.0)
    own = file(
        {"gnss": [make("time_delay", delay=0.05), arm], "baro": [make("time_delay", delay=0.02)]}, OPTIONS
    )
    p = written("px4", convert(own, "px4").text)
    assert {k: v for k, v in p.items() if "DELAY" in k} == {"EKF2_GPS_DELAY": 150.0, "EKF2_BARO_DELAY": 20.0}
    assert axes(p, "EKF2_GPS_POS_{}") == pytest.approx([0.3, -0.1, -0.05])
    a = written("ardupilot", convert(own, "ardupilot").text)
    assert (a["GPS_DELAY_MS"], a["EK3_HGT_DELAY"]) == (150.0, 20.0)
    assert axes(a, "GPS_POS1_{}") == pytest.approx([0.3, -0.1, -0.05])


def test_two_delays_for_one_parameter_are_said() -> None:
    own = file({"gnss_p": [make("time_delay", delay=0.2)], "gnss_v": [make("time_delay", delay=0.1)]})
    made = convert(own, "px4")
    assert written("px4", made.text)["EKF2_GPS_DELAY"] == pytest.approx(150.0)
    assert any("200 ms late and velocity 100 ms" in w for w in made.warnings)


@pytest.mark.parametrize(
    ("to", "name", "most"), [("px4", "EKF2_GPS_DELAY", 300), ("ardupilot", "GPS_DELAY_MS", 250)]
)
def test_a_value_out_of_its_range_is_not_written(to: str, name: str, most: int) -> None:
    made = convert(file({"gnss": [make("time_delay", delay=0.4)]}), to)
    assert name not in written(to, made.text)
    assert any(f"{name} = 400 ms is outside the 0 to {most} of" in w for w in made.warnings)


def test_noise_of_samples_has_the_largest_axis() -> None:
    sizes = {f"gnss_p_{a}": [make("sample_noise", sd=s)] for a, s in zip("NED", (1.0, 2.0, 3.0), strict=True)}
    sizes |= {
        f"mag_{a}": [make("sample_noise", sd=s * GAUSS)]
        for a, s in zip("xyz", (0.02, 0.03, 0.01), strict=True)
    }
    p = written("px4", convert(file(sizes), "px4").text)
    a = written("ardupilot", convert(file(sizes), "ardupilot").text)
    assert (p["EKF2_GPS_P_NOISE"], p["EKF2_MAG_NOISE"]) == (3.0, 0.03)
    assert (a["EK3_POSNE_M_NSE"], a["EK3_MAG_M_NSE"]) == (2.0, 0.03)


def test_a_scale_is_its_inverse_and_the_rest_is_said() -> None:
    channels = {
        "accel_x": [make("scale_factor", coefficient=0.02)],
        "gyro_x": [make("scale_factor", coefficient=0.01)],
    }
    channels["gnss_p"] = [make("gauss_markov", sigma=1.0, tau=60.0)]
    for to, name in (("px4", "CAL_ACC0_XSCALE"), ("ardupilot", "INS_ACCSCAL_X")):
        made = convert(file(channels), to)
        assert written(to, made.text)[name] == pytest.approx(1.0 / 1.02, rel=1e-5)
        for left in ("scale_factor of gyro_x", "gauss_markov of gnss_p"):
            assert f"no parameter holds {left}" in made.warnings


def test_another_consumer_says_what_it_does_not_hold() -> None:
    white = [make("white_noise", N=1e-4), make("rate_random_walk", K=1e-6)]
    own = file({"gnss": [make("time_delay", delay=0.05)]})
    channels = {
        f"{s}_x": ChannelNoise(u, tuple(map(Term, white))) for s, u in (("gyro", "rad/s"), ("accel", "m/s^2"))
    }
    own = own.with_noise(NoiseModel(channels))
    made = convert(own, "kalibr", rate=100.0)
    assert any("no parameter of Kalibr imu.yaml holds time_delay of gnss" in w for w in made.warnings)


@dataclass(frozen=True)
class Pressure:
    """A static pressure error, as files may name it."""

    coefficient: float
    name: ClassVar[str] = "static_pressure_error"


def test_a_height_that_rises_with_airspeed_is_a_negative_coefficient() -> None:
    """PX4: static pressure error = K rho v^2 / 2, height + error / (rho g); "rises ... will be a negative number"."""
    v, c, g, rho = 20.0, 0.004, 9.80665, 1.2
    read = 100.0 + c * v**2
    for module, name in ((px4, "EKF2_PCOEF_XP"), (ardupilot, "BARO1_WCF_FWD")):
        findings = SettableValues.of(file({"baro_height": [Pressure(c)]}))
        values, _ = settled(findings, module.SETTINGS, "")
        (K,) = values[name].numbers
        assert K < 0.0
        assert read + K * 0.5 * rho * v**2 / (rho * g) == pytest.approx(100.0)


def test_the_command_takes_a_filter_file(tmp_path: Path, kfgen: Cli) -> None:
    channels = {"gyro_x": ChannelNoise("rad/s", (Term(make("white_noise", N=1e-4)),))}
    own = file({"gnss": [make("time_delay", delay=0.05)]}, OPTIONS).with_noise(NoiseModel(channels))
    write_filter(own, tmp_path / "improved.toml")
    answer = kfgen("convert", tmp_path / "improved.toml", "--to", "px4", "-o", tmp_path / "px4.params")
    assert answer.exit_code == 0
    assert "100 Hz are assumed" in answer.output
    found = written("px4", (tmp_path / "px4.params").read_text())
    assert found["EKF2_GPS_DELAY"] == 150.0
    assert found["EKF2_GYR_NOISE"] == pytest.approx(1e-4 * 10.0)
    assert "EKF2_GYR_NOISE is 1/15 of the default 0.015" in answer.output


def test_ranges_are_ranges() -> None:
    for module in (px4, ardupilot):
        for name, s in module.SETTINGS.items():
            assert s.low < s.high, name
            assert s.low <= s.base <= s.high or s.low > 0.0, name
