"""Where no truth is known nothing is compared: before a delay, in holes of a reference, at an attitude's ends.

The motion goes on at the first and at the last sample, as in a piece cut from a longer log. Truths are sums of
sines in numpy; the attitude is integrated by Magnus' fourth-order step, four to a sample. The tests of what is left
fail falsely at a family-wise rate of 0.1 %; seeds are fixed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.completion import Completion
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.truth import body_rate
from kfgen.gap.scene.scene import ScenePoint
from kfgen.gap.scene.scene_gap import SceneGap, scene_gap
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

N, DT = 1e-4, 0.01
T = np.arange(4000) * DT
FREQUENCIES = ((0.31, 1.3), (0.23, 1.7), (0.41, 1.1))


def rate(t: Array) -> Array:
    """Body rates [rad/s], shape (n, 3)."""
    return np.array(
        [
            0.8 * np.sin(2 * np.pi * a * t + k) + 0.6 * np.cos(2 * np.pi * b * t)
            for k, (a, b) in enumerate(FREQUENCIES)
        ]
    ).T


def attitude() -> Array:
    """Body to navigation, scalar first, shape (n, 4)."""
    m = 4
    h = DT / m
    start = np.arange(T.size * m) * h
    w1, w2 = (rate(start + h * (0.5 + s * np.sqrt(3.0) / 6.0)) for s in (-1.0, 1.0))
    step = 0.5 * h * (w1 + w2) + np.sqrt(3.0) / 12.0 * h**2 * np.cross(w1, w2)
    q, out = np.array([1.0, 0.0, 0.0, 0.0]), np.empty((T.size, 4))
    steps = Rotation.from_rotvec(step).as_quat(scalar_first=True)
    for k in range(T.size):
        out[k] = q
        for w, x, y, z in steps[m * k : m * (k + 1)]:
            right = np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
            q = right @ q
        q = q / np.linalg.norm(q)
    return out


def gap_of(read: Array, references: dict[str, Channel], seed: int) -> SceneGap:
    """The gap of gyros of white noise that read `read`."""
    y = read + N / np.sqrt(DT) * np.random.default_rng(seed).standard_normal(read.shape)
    channels = {f"gyro_{a}": Channel(y[:, k], "rad/s") for k, a in enumerate("xyz")}
    noise = ChannelNoise("rad/s", (Term(make("white_noise", N=N)),))
    scene = motion_scene(Log(T, channels | references), NoiseModel({f"gyro_{a}": noise for a in "xyz"}))
    assert scene is not None
    return scene_gap(scene)


def table(x: Array) -> dict[str, Channel]:
    """The references of a rate table."""
    return {f"ref_gyro_{a}": Channel(x[:, k], "rad/s") for k, a in enumerate("xyz")}


def names(gap: SceneGap) -> list[str]:
    return [f.effect.name for f in gap.findings]


def test_white_noise_goes_on_about_its_mean_where_no_truth_is_known() -> None:
    """Whatever the samples beside do by chance: about their mean, few samples at the ends were a warm-up.

    That mean is one of N samples, here within five standard deviations of nothing.
    """
    q, rng = attitude(), np.random.default_rng(12)
    channels = {f"ref_q_{c}": Channel(q[:, k], "") for k, c in enumerate("wxyz")}
    y = rate(T) + N / np.sqrt(DT) * rng.standard_normal((T.size, 3))
    channels |= {f"gyro_{a}": Channel(y[:, k], "rad/s") for k, a in enumerate("xyz")}
    noise = ChannelNoise("rad/s", (Term(make("white_noise", N=N)),))
    scene = motion_scene(Log(T, channels), NoiseModel({f"gyro_{a}": noise for a in "xyz"}))
    assert scene is not None
    unknown = np.flatnonzero(~scene.good)
    assert 8 < unknown.size < 256
    at = ScenePoint((), np.array([u.value for u in scene.unknowns]))
    for left, drawn in zip(scene.left(at), scene.made_up):
        level = (left - drawn)[unknown]
        assert np.ptp(level) < 1e-6 * N / np.sqrt(DT)
        assert abs(level[0]) < 5.0 * np.sqrt(2.0 / T.size) * N / np.sqrt(DT)


@pytest.mark.parametrize("delay", in_part([0.012, -0.1]))
def test_a_delay_in_the_midst_of_motion_is_all(delay: float) -> None:
    gap = gap_of(rate(T - delay), table(rate(T)), 1)
    assert (gap.verdict, names(gap)) == ("effects_found", ["time_delay"])
    assert float(gap.findings[0].effect.delay) == pytest.approx(delay, abs=2e-5)  # type: ignore[attr-defined]


@pytest.mark.parametrize("share", in_part([0.0, 0.3]))
def test_holes_of_a_reference_are_no_gap(share: float) -> None:
    x = rate(T)
    x[np.random.default_rng(3).random(T.size) < share] = np.nan
    x[1500:1900] = np.nan
    gap = gap_of(rate(T), table(x), 2)
    assert (gap.verdict, names(gap)) == ("no_gap", [])


@pytest.mark.parametrize("hole", in_part([3, 150]))
def test_holes_of_an_attitude_are_no_gap(hole: int) -> None:
    """Every five seconds: what bridges them is no rate, and rings as far as the ends of a band do."""
    q = attitude()
    q[np.arange(T.size) % 500 < hole] = 0.0 if hole < 10 else np.nan
    gap = gap_of(rate(T), {f"ref_q_{c}": Channel(q[:, k], "") for k, c in enumerate("wxyz")}, 4)
    assert (gap.verdict, names(gap)) == ("no_gap", [])


def test_an_exact_attitude_in_fast_motion_is_no_gap() -> None:
    q = attitude()
    references = {f"ref_q_{c}": Channel(q[:, k], "") for k, c in enumerate("wxyz")}
    gap = gap_of(rate(T), references, 3)
    assert (gap.verdict, names(gap)) == ("no_gap", [])


def test_the_rate_of_an_exact_attitude() -> None:
    """Magnus' second term is 2e-4 rad/s here, and no more than 2e-6 may be left of it."""
    omega, _, angle, _ = body_rate(attitude(), DT)
    assert angle < 1e-8
    assert np.abs(omega - rate(T))[200:-200].max() < 2e-6


def test_a_series_is_completed_by_what_is_most_probable() -> None:
    """Of a random walk between two samples that is the straight line; of white noise nothing."""
    known = np.ones(64, dtype=bool)
    known[20:24] = False
    x = np.where(known, np.arange(64.0), 0.0)
    w = np.arange(64) * (np.pi / 64)
    walk = Whitener(np.maximum(2.0 * np.sin(w / 2.0), 0.0))
    np.testing.assert_allclose(Completion.of(walk, known).completed(x), np.arange(64.0), atol=1e-3)
    np.testing.assert_allclose(
        Completion.of(Whitener(np.ones(64)), known).completed(x + 1.0 * ~known), x, atol=1e-9
    )


def test_completions_in_closed_form_and_by_gradients_agree() -> None:
    """Of a spectrum that rises, with a hole and single samples; the closed form minimises the squared white series."""
    n, rng = 200, np.random.default_rng(8)
    white = Whitener(np.linspace(0.5, 3.0, n))
    known = np.ones(n, dtype=bool)
    known[40:60] = known[::17] = False
    x = np.where(known, rng.standard_normal(n), 0.0)
    closed = Completion.of(white, known)
    z = closed.completed(x)
    np.testing.assert_allclose(replace(closed, factor=None).completed(x), z, atol=0.05)  # twelve steps
    assert np.abs(closed._slope(z)).max() < 1e-6
    np.testing.assert_array_equal(z[known], x[known])
