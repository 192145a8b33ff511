"""Proves `kfgen calibrate`: simulated triads within their intervals, real recordings as their authors published them.

Readings are made by plain numpy, ``y = A u + b`` with noise. Of 20 logs an interval of 95 % misses more than 4 times
with a probability of 0.3 %; seeds are fixed.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.calibrate.calibrate import calibrate
from kfgen.calibrate.coverage import covered_share, sphere
from kfgen.calibrate.ellipsoid import ellipsoid
from kfgen.core.errors import InputError
from kfgen.effects.noise_model import read_noise
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
Find = Callable[[str], Path]
Cli = Callable[..., Any]
G, RATE = 9.80665, 50.0
AXES = "xyz"
A = np.array([[1.01, 0.004, -0.006], [0.0, 0.985, 0.003], [0.0, 0.0, 1.02]])
B = np.array([0.12, -0.2, 0.3])


def triad(sensor: str, y: Array, unit: str) -> Log:
    channels = {f"{sensor}_{a}": Channel.of(y[:, i], unit) for i, a in enumerate(AXES)}
    return Log(np.arange(len(y)) / RATE, channels, "bench.csv")


def directions(rng: np.random.Generator, count: int) -> Array:
    v = rng.standard_normal((count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def posed(seed: int, count: int = 18) -> Log:
    """Rests of four seconds in random poses, a second of swinging between them."""
    rng = np.random.default_rng(seed)
    u = []
    for e in directions(rng, count):
        u += [np.tile(G * e, (200, 1)), G * e + 3.0 * np.sin(np.linspace(0, 20, 50))[:, None]]
    true = np.concatenate(u)
    return triad("accel", true @ A.T + B + 0.02 * rng.standard_normal(true.shape), "m/s^2")


def swung(seed: int, field: float = 48.0) -> Log:
    """A magnetometer in all directions [uT]: a path over the sphere."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / RATE
    e = np.column_stack([np.cos(t) * np.cos(0.31 * t), np.sin(t) * np.cos(0.31 * t), np.sin(0.31 * t)])
    W = A / A[2, 2]
    return triad("mag", field * e @ W.T + 40.0 * B + 0.3 * rng.standard_normal(e.shape), "uT")


def turned(seed: int, scales: Array, degrees: float = 360.0) -> Log:
    """Each axis by that angle and back, to half a degree, with rests between [deg/s]."""
    rng = np.random.default_rng(seed)
    parts = [np.zeros((200, 3))]
    for axis in (0, 0, 1, 1, 2, 2):
        sign = 1.0 if len(parts) % 4 == 1 else -1.0
        rate = np.zeros((200, 3))
        shape = np.sin(np.linspace(0, np.pi, 200)) ** 2
        rate[:, axis] = sign * (degrees + 0.5 * rng.standard_normal()) * shape / shape.sum() * RATE
        parts += [rate, np.zeros((200, 3))]
    y = np.concatenate(parts)
    return triad(
        "gyro", y * (1.0 + scales) + np.array([0.3, -0.2, 0.1]) + 0.05 * rng.standard_normal(y.shape), "deg/s"
    )


def values(found: Any) -> dict[str, tuple[float, float, float]]:
    (sensor,) = found.sensors
    ends = zip(sensor.entries, sensor.fit.values, sensor.fit.half_widths)
    return {f"{e.where} {e.parameter}": (float(v), float(v - h), float(v + h)) for e, v, h in ends}


def test_an_ellipsoid_of_exact_readings_is_that_of_the_readings() -> None:
    y = directions(np.random.default_rng(1), 12) @ (3.0 * A).T + B
    b, U = ellipsoid(y)
    np.testing.assert_allclose(b, B, atol=1e-9)
    np.testing.assert_allclose(U, 3.0 * A, atol=1e-9)
    with pytest.raises(InputError, match="no ellipsoid"):
        ellipsoid(np.column_stack([np.linspace(-1, 1, 40), np.linspace(-1, 1, 40) ** 2, np.zeros(40)]) + 1e-3)


def test_coverage_of_directions() -> None:
    assert covered_share(sphere()) == 1.0
    assert covered_share(np.array([[0.0, 0.0, 1.0]])) == pytest.approx(
        0.5 * (1.0 - np.cos(np.pi / 6)), abs=0.01
    )


def covered(make: Callable[[int], Log], truth: dict[str, float]) -> None:
    """Every number lies within its interval in at least 16 of 20 logs, and the intervals are no wider than they must."""
    inside = dict.fromkeys(truth, 0)
    for seed in range(20):
        found = values(calibrate(make(seed)))
        for name, true in truth.items():
            _, lo, hi = found[name]
            inside[name] += lo <= true <= hi
    assert min(inside.values()) >= 16, inside


def test_poses_of_an_accelerometer() -> None:
    covered(
        posed,
        {
            **{f"accel_{a} value": float(B[i]) for i, a in enumerate(AXES)},
            **{f"accel_{a} coefficient": float(A[i, i] - 1.0) for i, a in enumerate(AXES)},
            "accel_x xy": 0.004,
            "accel_x xz": -0.006,
            "accel_y yz": 0.003,
        },
    )
    v, lo, hi = values(calibrate(posed(0)))["accel_x value"]
    # Eighteen means of 200 samples of 0.02 m/s^2 each know a bias to 0.02 / sqrt(200 * 18 / 3) at best.
    assert 0.0005 < hi - lo < 0.01
    assert v == pytest.approx(0.12, abs=0.003)


@pytest.mark.long
def test_a_magnetometer_in_all_directions() -> None:
    W = A / A[2, 2]
    iron = {f"mag {a}": 40e-6 * float(B[i]) for i, a in enumerate(AXES)}
    soft = {
        f"mag {e}": float(W[AXES.index(e[0]), AXES.index(e[1])] - (e[0] == e[1]))
        for e in ("xx", "yy", "xy", "xz", "yz")
    }
    covered(swung, iron | soft)
    assert calibrate(swung(1)).sensors[0].length == pytest.approx(48e-6, rel=0.01)
    known = values(calibrate(swung(1), field="49 uT"))
    assert known["mag zz"][0] == pytest.approx(48.0 / 49.0 - 1.0, abs=0.002)


def test_turns_of_a_gyro() -> None:
    scales = np.array([0.028, -0.018, 0.004])
    covered(
        lambda seed: turned(seed, scales), {f"gyro_{a} coefficient": float(s) for a, s in zip(AXES, scales)}
    )
    half = values(calibrate(turned(3, scales, 180.0), turn="180 deg"))["gyro_x coefficient"]
    assert half[1] < 0.028 < half[2]


@pytest.mark.long
def test_it_is_a_noise_file_that_other_verbs_read(kfgen: Cli, tmp_path: Path) -> None:
    log = tmp_path / "poses.csv"
    data = posed(2)
    y = np.column_stack([data.t, *(data.values(f"accel_{a}") for a in AXES)])
    np.savetxt(
        log, y, "%.7g", ",", header="t [s]," + ",".join(f"accel_{a} [m/s^2]" for a in AXES), comments=""
    )
    out, js, page = tmp_path / "cal.toml", tmp_path / "cal.json", tmp_path / "cal.html"
    result = kfgen("calibrate", log, "-o", out, "--json", js, "--report", page)
    assert result.exit_code == 0, result.output
    effects = {e.name: e for e in read_noise(out).channel("accel_x").effects}
    assert set(effects) == {"white_noise", "bias", "scale_factor", "misalignment"}
    assert effects["bias"].value == pytest.approx(0.12, abs=0.005)  # type: ignore[attr-defined]
    answer = json.loads(js.read_text())
    assert answer["format"] == "kfgen-calibrate-1"
    assert answer["sensors"]["accel"]["error"]["after"] < 0.1 * answer["sensors"]["accel"]["error"]["before"]
    assert "scale_factor" in page.read_text()
    derived = kfgen("derive", "ins15", "--noise", out)
    assert derived.exit_code == 0
    assert "scale_factor of accel_x is known and corrected by its value" in derived.output


# What is refused, and what is said.


def in_a_plane(seed: int) -> Log:
    t = np.arange(3000) / RATE
    y = 48.0 * np.column_stack([np.cos(t), np.sin(t), 0.0 * t + 0.3])
    return triad("mag", y + 0.3 * np.random.default_rng(seed).standard_normal(y.shape), "uT")


def test_what_cannot_be_calibrated_is_refused_with_what_is_missing() -> None:
    with pytest.raises(InputError, match=r"cover \d+ % of the directions and lie near one plane") as plane:
        calibrate(in_a_plane(1))
    assert "its z axis points up, down and sideways" in str(plane.value.remedy)
    with pytest.raises(InputError, match="accel rests in 1 pose,"):
        calibrate(
            triad(
                "accel",
                np.tile([0.0, 0.0, G], (500, 1)) + 0.01 * directions(np.random.default_rng(1), 500),
                "m/s^2",
            )
        )
    with pytest.raises(InputError, match="accel rests in 5 poses"):
        calibrate(posed(4, 5))
    with pytest.raises(InputError, match="no turn by 90 deg"):
        calibrate(turned(1, np.zeros(3), 40.0), turn="90 deg")
    with pytest.raises(InputError, match="which is no unit of such a sensor") as counts:
        calibrate(triad("accel", posed(1).values("accel_x")[:, None] * np.ones(3), "1"))
    assert "--columns" in str(counts.value.remedy)
    with pytest.raises(InputError, match="is not calibrated"):
        calibrate(posed(1), sensors="baro")
    with pytest.raises(InputError, match="the log has no mag_x"):
        calibrate(posed(1), sensors="mag")
    with pytest.raises(InputError, match="positive"):
        calibrate(posed(1), turn="0 deg")


def test_a_field_that_is_not_the_same_everywhere_is_said() -> None:
    data = swung(2)
    far = np.stack([data.values(f"mag_{a}") for a in AXES], axis=1)
    size = np.linalg.norm(far, axis=1, keepdims=True)
    bent = far * (1.0 + 0.05 * np.sin(np.arange(6000) / 400.0)[:, None]) * (48e-6 / size)
    found = calibrate(triad("mag", 1e6 * bent, "uT"))
    assert any("not the same in all places" in w for w in found.warnings)


# Real recordings.


@pytest.mark.parametrize(
    ("name", "bias", "scale"),
    [("imu0", (0.103, 0.097, 0.345), (0.36, 0.32, 0.62))],
)
def test_the_authors_table_of_two_sensors(
    recording: Find, name: str, bias: tuple[float, ...], scale: tuple[float, ...]
) -> None:
    """M. Kok's table, with g = 9.81 m/s^2; with standard gravity every scale is 0.03 % larger."""
    found = values(calibrate(recording(f"effects/mpu9150_calib_{name}.npz"), sensors="accel"))
    for a, b, s in zip(AXES, bias, scale):
        v, lo, hi = found[f"accel_{a} value"]
        assert lo - 0.001 < b < hi + 0.001
        v, lo, hi = found[f"accel_{a} coefficient"]
        assert v == pytest.approx(1e-2 * (s + 0.034), abs=4e-4)


def test_ten_poses_say_which_angle_they_do_not_tell(recording: Find, kfgen: Cli) -> None:
    """Its author: bias 711.5, -358.5, -1840.1 counts (of the other sign); no pose loads x and y together."""
    columns = ", ".join(f"accel_{a}=acc_counts_{a} [g/16384]" for a in AXES)
    result = kfgen(
        "calibrate", recording("effects/mpu6050_multipose_calib.npz"), "--columns", columns, "--json", "-"
    )
    assert result.exit_code == 0
    found = {
        (p["where"], p["parameter"]): p for p in json.loads(result.stdout)["sensors"]["accel"]["parameters"]
    }
    for a, counts in zip(AXES, (711.516, -358.505, -1840.128)):
        lo, hi = found[f"accel_{a}", "value"]["ci95"]
        assert lo < 1e3 * counts / 16384 < hi
    assert "accel_x misalignment xy: the poses do not tell it" in result.stderr


def test_the_iron_of_a_magnetometer(recording: Find, kfgen: Cli) -> None:
    """Manifest: centre about 6170, 252, 3450 counts, axis ratio 2.2."""
    columns = ", ".join(f"mag_{a}=mag_counts_{a} [uT/120]" for a in AXES)
    result = kfgen(
        "calibrate", recording("effects/qmc5883l_mag_calib_filtered.npz"), "--columns", columns, "--json", "-"
    )
    found = {p["parameter"]: p["value"] for p in json.loads(result.stdout)["sensors"]["mag"]["parameters"]}
    for a, counts in zip(AXES, (6170, 252, 3450)):
        assert found[a] * 120 == pytest.approx(counts, abs=30)
    assert 1.0 / (1.0 + 0.01 * found["yy"]) == pytest.approx(2.2, abs=0.1)


def test_the_turns_of_a_recording(recording: Find) -> None:
    """Manifest: the integrals of three turns by 360 deg give +2.8, -1.8 and -0.2 %."""
    found = values(calibrate(recording("effects/imu_ferraris_session.npz"), sensors="gyro"))
    for a, percent in zip(AXES, (2.8, -1.8, -0.2)):
        v, lo, hi = found[f"gyro_{a} coefficient"]
        assert v == pytest.approx(0.01 * percent, abs=0.001)
        assert lo < 0.01 * percent < hi
