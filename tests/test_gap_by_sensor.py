"""Sensors that move together: each has an answer of its own, in the band of its motion, as far as a reference tells.

The motion is made by scipy's rotations, with other code than the world's. Seeds are fixed; what is drawn is judged within
4.5 standard deviations.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.spatial.transform import Rotation

from kfgen.core.errors import InputError
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.core.wgs84 import EARTH_RATE
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.find_gap import find_gap
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.scene import MotionScene
from kfgen.gap.motion.slower_scene import band_limited, slower_scene
from kfgen.gap.scene.scene import Placed, ScenePoint, start_of
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
AXES = "xyz"
SD = {"gyro": 2e-3, "accel": 0.02, "mag": 2e-7}
UNIT = {"gyro": "rad/s", "accel": "m/s^2", "mag": "T"}
FIELD_N = np.array([20e-6, 1e-6, 43e-6])


def turning(n: int, rate: float) -> tuple[Array, Rotation, Array]:
    """Times, attitude body to north-east-down, and body rates by differences over a thousandth of a second."""
    t = np.arange(n) / rate

    def at(s: Array) -> Rotation:
        angles = [1.2 * np.sin(0.7 * s), 0.9 * np.sin(1.1 * s + 0.4), 2.0 * np.sin(0.5 * s + 1.0)]
        return Rotation.from_euler("xyz", np.column_stack(angles))

    h = 1e-3
    return t, at(t), (at(t - h).inv() * at(t + h)).as_rotvec() / (2.0 * h)


def noise(rate: float, *sensors: str) -> NoiseModel:
    return NoiseModel(
        {
            f"{s}_{a}": ChannelNoise(UNIT[s], (Term(make("white_noise", N=SD[s] / np.sqrt(rate))),))
            for s in sensors
            for a in AXES
        }
    )


def recorded(
    n: int, rate: float, seed: int, *, moved: float = 0.0, iron: float = 0.0, scale: float = 0.0
) -> Log:
    """A log beside an attitude: the body accelerates [m/s^2], the magnetometer has an iron [T], gyro_x a scale factor."""
    t, nb, w = turning(n, rate)
    rng = np.random.default_rng(seed)
    push = moved * np.column_stack([np.sin(2.1 * t), np.cos(1.7 * t), np.sin(1.3 * t)])
    read = {
        "gyro": w * [1.0 + scale, 1.0, 1.0],
        "accel": nb.inv().apply(push - [0.0, 0.0, STANDARD_GRAVITY]),
        "mag": nb.inv().apply(FIELD_N) + np.array([iron, 0.0, 0.0]),
    }
    channels = {
        f"{s}_{a}": Channel(y[:, i] + SD[s] * rng.standard_normal(n), UNIT[s])
        for s, y in read.items()
        for i, a in enumerate(AXES)
    }
    q = nb.as_quat(scalar_first=True)
    channels |= {f"ref_q_{c}": Channel(q[:, i], "") for i, c in enumerate("wxyz")}
    return Log(t, channels, source="turned by hand")


@pytest.mark.long
def test_each_sensor_has_an_answer_of_its_own() -> None:
    """A gyro with a scale factor beside a magnetometer with iron: two comparisons, each with its own effect."""
    found = find_gap(recorded(3000, 50.0, 1, iron=2e-6, scale=0.01), noise(50.0, "gyro", "mag"))
    named = {c.channels[0].split("_")[0]: [f.name for f in c.findings] for c in found.comparisons}
    assert named == {"gyro": ["scale_factor"], "mag": ["hard_iron"]}
    iron = found.comparisons[1].findings[0]
    lo, hi = iron.ci95["x"]
    assert lo < 2e-6 < hi
    updated = found.updated.channels  # type: ignore[union-attr]
    assert [t.effect.name for t in updated["gyro_x"].terms] == ["white_noise", "scale_factor"]
    assert [t.effect.name for t in updated["mag_y"].terms] == ["white_noise", "hard_iron"]


def test_an_effect_of_one_of_two_sensors_is_rarer_by_that() -> None:
    scene = motion_scene(recorded(1000, 50.0, 2), noise(50.0, "gyro", "mag"))
    assert scene is not None
    alone = motion_scene(recorded(1000, 50.0, 2), noise(50.0, "gyro"))
    assert alone is not None
    (gyro, mag), (itself,) = scene.by_sensor(), alone.by_sensor()
    assert (gyro.channels, mag.channels) == (
        ("gyro_x", "gyro_y", "gyro_z"),
        ("mag_x", "mag_y", "mag_z"),
    )
    assert itself is alone
    pairs = list(zip(gyro.candidates(()), alone.candidates(())))
    assert len(pairs) > 10
    for one, other in pairs:
        assert one[0].prior_penalty_nats - other[0].prior_penalty_nats == pytest.approx(np.log(2.0))


def test_a_cosine_below_the_lower_half_rate_stays_one() -> None:
    n, m = 1200, 400
    wave = [np.cos(np.pi * 37 * (np.arange(k) + 0.5) / k) for k in (n, m)]
    np.testing.assert_allclose(band_limited(wave[0], m), wave[1], atol=1e-12)
    gone = np.cos(np.pi * 700 * (np.arange(n) + 0.5) / n)
    np.testing.assert_allclose(band_limited(gone, m), 0.0, atol=1e-12)


def test_a_long_log_at_a_high_rate_is_compared_in_the_band_of_its_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whitened residuals are those of the full rate, ordinate by ordinate; only delays by splines differ a little."""
    whole = motion_scene(recorded(12_000, 200.0, 3, scale=0.01, iron=1e-6), noise(200.0, "gyro", "mag"))
    assert whole is not None
    monkeypatch.setattr("kfgen.gap.motion.slower_scene.MAX_SAMPLES", 2000)
    slow = slower_scene(whole)
    assert slow.truth.t.size == 3600
    assert slow.truth.dt == pytest.approx(1.0 / 60.0, rel=1e-12)
    unknown = np.sqrt(
        2.0 * (1.0 - whole.good.mean())
    )  # noise that is made up at the ends, of which no rate is known
    placed = (Placed(make("scale_factor", coefficient=0.01), "gyro_x"),)
    for effects in ((), placed):
        parts = [
            np.split(
                s.residuals([ScenePoint(effects, start_of(whole).unknowns)])[:, 0], np.cumsum(s.lengths)[:-1]
            )
            for s in (whole, slow)
        ]
        for name, a, b in zip(whole.channels, *parts):
            k = np.arange(20, min(b.size, 1500))
            error = float(np.sqrt(np.mean((a[k] - b[k]) ** 2)))
            assert error < 0.05 + 2.0 * unknown, name


def test_missing_samples_stay_missing() -> None:
    """A hole of 50 samples at 200 Hz stays one, with a sample more at either end at most."""
    log = recorded(24_000, 200.0, 4)
    values = log.channels["mag_x"].values.copy()
    values[9000:9050] = np.nan
    holed = Log(log.t, {**log.channels, "mag_x": Channel(values, "T")}, source="holed")
    whole = motion_scene(holed, noise(200.0, "mag"))
    assert whole is not None
    scene = slower_scene(whole)
    n = scene.truth.t.size
    missing = np.flatnonzero(~scene.compared[0].there)
    assert n < 24_000
    assert missing.min() == pytest.approx(9000 * n / 24_000, abs=1.5)
    assert missing.max() == pytest.approx(9050 * n / 24_000, abs=1.5)
    spectrum = dct(scene.compared[0].y, norm="ortho")
    assert np.abs(spectrum[n // 2 :]).max() < 6.0 * SD["mag"]  # nothing rings


def accelerated(moved: float, *sensors: str) -> MotionScene | None:
    return motion_scene(recorded(3000, 50.0, 5, moved=moved), noise(50.0, *sensors))


def test_an_attitude_does_not_tell_how_a_body_accelerates() -> None:
    """Where it only turns, an accelerometer is compared; where it accelerates, others alone, and that is said."""
    turned = accelerated(0.0, "gyro", "accel")
    assert turned is not None
    assert (len(turned.channels), turned.warnings) == (6, ())
    carried = accelerated(0.5, "gyro", "accel")
    assert carried is not None
    assert carried.channels == ("gyro_x", "gyro_y", "gyro_z")
    (said,) = carried.warnings
    assert said.startswith("accel is not compared: the body accelerates")
    assert "ref_accel_x" in said
    with pytest.raises(InputError, match="accel cannot be compared: the body accelerates"):
        accelerated(0.5, "accel")


def test_a_gyro_that_is_quiet_enough_feels_the_earth() -> None:
    """15 deg/h over two minutes under noise of 2e-5 rad/s a sample: every component is within four standard deviations."""
    n, rate, sd = 6000, 50.0, 2e-5
    t, nb, w = turning(n, rate)
    earth = EARTH_RATE * np.array([np.cos(0.8), 0.0, -np.sin(0.8)])
    y = w + nb.inv().apply(earth) + sd * np.random.default_rng(6).standard_normal((n, 3))
    channels = {f"gyro_{a}": Channel(y[:, i], "rad/s") for i, a in enumerate(AXES)}
    channels |= {f"ref_gyro_{a}": Channel(w[:, i], "rad/s") for i, a in enumerate(AXES)}
    q = nb.as_quat(scalar_first=True)
    channels |= {f"ref_q_{c}": Channel(q[:, i], "") for i, c in enumerate("wxyz")}
    white = ChannelNoise("rad/s", (Term(make("white_noise", N=sd / np.sqrt(rate))),))
    found = find_gap(Log(t, channels, source="gyro"), NoiseModel({f"gyro_{a}": white for a in AXES}))
    (finding,) = found.findings
    assert finding.name == "earth_rate"
    for axis, truth in zip(AXES, earth.tolist()):
        lo, hi = finding.ci95[axis]
        assert lo - 0.5 * (hi - lo) < truth < hi + 0.5 * (hi - lo)
