"""A magnetometer on a body that turns about the vertical alone: a wheeled robot, a turntable.

Expected values come from plain numpy: the field that was put in, and the smallest standard deviation that any
estimate of it can have (Cramer and Rao), ``s sqrt(1/k + 1/(n - k))`` for a step of k of n samples in noise of
standard deviation s.
"""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.effects import effect_named
from kfgen.effects.inertial.magnetic import HardIron, MagneticDisturbance, SoftIron
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.on_off_times import best_span
from kfgen.gap.scene.scene_gap import SceneGap, scene_gap
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

DT, N, SD = 0.02, 2000, 0.35
"""Period [s], samples, standard deviation of the noise [uT]."""
FIELD = np.array([21.0, 1.2, 43.0])
T = DT * np.arange(N)
PSI = 1.5 * np.sin(0.7 * T) + 0.9 * np.sin(0.31 * T + 1.0) + 0.2 * T


def turns() -> Array:
    """Navigation to body axes of a turn about the third axis, shape (N, 3, 3)."""
    c, s, o, i = np.cos(PSI), np.sin(PSI), np.zeros(N), np.ones(N)
    return np.array([[c, s, o], [-s, c, o], [o, o, i]]).transpose(2, 0, 1)


def answer(added: Array, seed: int) -> SceneGap:
    """The gap of a log whose readings [uT] hold what was `added` to the field."""
    rng = np.random.default_rng(seed)
    y = turns() @ FIELD + added + SD * rng.standard_normal((N, 3))
    q = {"w": np.cos(0.5 * PSI), "x": np.zeros(N), "y": np.zeros(N), "z": np.sin(0.5 * PSI)}
    channels = {f"mag_{a}": Channel(1e-6 * y[:, i], "uT") for i, a in enumerate("xyz")}
    channels |= {f"ref_q_{k}": Channel(v, "") for k, v in q.items()}
    log = Log(T, channels, "a turn about the vertical")
    white = ChannelNoise("uT", (Term(effect_named("white_noise")(1e-6 * SD * np.sqrt(DT))),))
    scene = motion_scene(log, NoiseModel({f"mag_{a}": white for a in "xyz"}))
    assert scene is not None
    return scene_gap(scene)


@pytest.mark.parametrize(("start", "stop"), in_part([(16.0, 24.0), (28.0, 40.0), (0.0, 11.0)]))
@pytest.mark.parametrize("in_body", in_part([True, False]))
def test_a_field_that_comes_and_goes_is_found_in_a_turn_about_the_vertical(
    start: float, stop: float, in_body: bool
) -> None:
    """False-alarm rate: one bound of four standard deviations for each of three components, 2e-4."""
    h, inside = np.array([0.25, 0.15, -0.09]), ((start <= T) & (stop > T)).astype(float)
    added = inside[:, None] * (h if in_body else turns() @ h)
    g = answer(added, 3)
    assert g.verdict == "effects_found"
    (found,) = g.findings
    effect = found.effect
    assert isinstance(effect, HardIron if in_body else MagneticDisturbance)
    got, k = 1e6 * np.array([effect.x, effect.y, effect.z], dtype=float), inside.sum()
    if not in_body and abs(effect.time - start) > 1.0:
        got = -got  # that it is there else, in another field, is the same
    # A field in space that is there at an end: what was before is as good a field as what comes after.
    assert got == pytest.approx(h, abs=4.0 * SD * np.sqrt(1.0 / k + 1.0 / (N - k)))


@pytest.mark.parametrize("seed", in_part([11, 12, 13, 14]))
def test_nothing_is_found_in_a_turn_about_the_vertical_where_nothing_is(seed: int) -> None:
    """False-alarm rate: that of the battery, 1e-3, of each of four seeds."""
    assert answer(np.zeros((N, 3)), seed).verdict == "no_gap"


def test_soft_iron_of_an_axis_that_stands_still_is_found() -> None:
    """What of the horizontal field is drawn into the vertical axis; false-alarm rate of four standard deviations 6e-5."""
    u = turns() @ FIELD
    added = np.zeros((N, 3))
    added[:, 2] = 0.004 * u[:, 0]
    (found,) = answer(added, 5).findings
    effect = found.effect
    assert isinstance(effect, SoftIron)
    u_x = u[:, 0] - u[:, 0].mean()
    assert effect.zx == pytest.approx(0.004, abs=4.0 * SD / float(np.linalg.norm(u_x)))


def test_the_span_of_a_field_along_the_axis_of_the_turn() -> None:
    """Along the vertical a field of the body and one in space are the same, and both are found."""
    inside = (T >= 10.0) & (T < 20.0)
    y = turns() @ FIELD + inside[:, None] * np.array([0.0, 0.0, 1.0])
    y = y + 0.05 * np.random.default_rng(0).standard_normal((N, 3))
    for in_body in (True, False):
        span = best_span(T, y, np.ones(N, dtype=bool), turns(), in_body)
        assert span is not None
        assert (span.start, span.stop) == (pytest.approx(10.0, abs=DT), pytest.approx(20.0, abs=DT))
        assert span.vector == pytest.approx((0.0, 0.0, 1.0), abs=0.01)


def test_a_part_of_a_field_that_cannot_be_seen_is_left_out_of_its_span() -> None:
    """Without a turn a field in space is the field that is there all the time, but for when it comes and goes."""
    inside = (T >= 10.0) & (T < 20.0)
    good = ~((T >= 8.0) & (T < 22.0))
    still = np.broadcast_to(np.eye(3), (N, 3, 3))
    y = np.broadcast_to(FIELD, (N, 3)) + inside[:, None] * np.array([0.0, 0.0, 1.0])
    span = best_span(T, y + 1e-3 * np.random.default_rng(0).standard_normal((N, 3)), good, still, True)
    assert span is None or np.abs(span.vector).max() < 0.01  # the field was there where nothing counts
