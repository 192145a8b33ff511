"""References that are stuck, held, of another motion or convention; samples of a sensor that moves with faults.

Truths are sums of sines in numpy, attitudes are those of `tests/test_gap_edges.py`. A null is called a gap falsely
in at most 1 % of records, its tests at a family-wise rate of 0.1 %; seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from test_gap_edges import DT, N, T, attitude, names, rate, table

from kfgen.core.errors import InputError
from kfgen.core.recent_results import RecentResults
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.effects.series import noise_of
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.references.reference import heard
from kfgen.gap.rest.faults import spotted_moving
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.gap.scene.scene_gap import SceneGap, scene_gap
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

SIGMA = N / np.sqrt(DT)
WHITE = (make("white_noise", N=N),)


def log_of(read: Array, references: dict[str, Channel], seed: int) -> Log:
    y = read + SIGMA * np.random.default_rng(seed).standard_normal(read.shape)
    return Log(T, {f"gyro_{a}": Channel(y[:, k], "rad/s") for k, a in enumerate("xyz")} | references)


def gap_of(log: Log) -> SceneGap:
    noise = ChannelNoise("rad/s", (Term(WHITE[0]),))
    scene = motion_scene(log, NoiseModel({f"gyro_{a}": noise for a in "xyz"}))
    assert scene is not None
    return scene_gap(scene)


def quaternion(q: Array) -> dict[str, Channel]:
    return {f"ref_q_{c}": Channel(q[:, k], "") for k, c in enumerate("wxyz")}


def test_a_reference_of_another_motion_is_bad_data() -> None:
    other = rate(1.37 * T + 100.0)[:, [2, 0, 1]]
    gap = gap_of(log_of(rate(T), table(other), 1))
    assert (gap.verdict, names(gap)) == ("bad_data", ["other_motion"])


@pytest.mark.parametrize("delay", [0.25, 2.0])
def test_a_reference_that_is_late_is_of_the_same_motion(delay: float) -> None:
    scene = motion_scene(
        log_of(rate(T - delay), table(rate(T)), 2),
        NoiseModel({"gyro_x": ChannelNoise("rad/s", (Term(WHITE[0]),))}),
    )
    assert scene is not None
    assert scene.faults() == ()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda q: q * [1.0, -1.0, -1.0, -1.0], ["reversed_attitude"]),
        (lambda q: q[:, [1, 2, 3, 0]], ["scalar_last_attitude"]),
        (
            lambda q: (q * [1.0, -1.0, -1.0, -1.0])[:, [1, 2, 3, 0]],
            ["scalar_last_attitude", "reversed_attitude"],
        ),
    ],
    ids=["conjugate", "scalar last", "both"],
)
def test_another_convention_is_said(change: Callable[[Array], Array], expected: list[str]) -> None:
    gap = gap_of(log_of(rate(T), quaternion(change(attitude())), 3))
    assert (gap.verdict, names(gap)) == ("bad_data", expected)


def test_a_sensor_that_is_dead_has_no_bandwidth() -> None:
    """A corner below the lowest frequency of the log is none: it reads nothing of what it should."""
    gap = gap_of(log_of(rate(T) * [1.0, 0.0, 1.0], table(rate(T)), 15))
    assert [(f.effect.name, f.where) for f in gap.findings] == [("scale_factor", "gyro_y")]
    assert float(gap.findings[0].effect.coefficient) == pytest.approx(-1.0, abs=1e-3)  # type: ignore[attr-defined]


def test_some_columns_of_an_attitude_are_no_attitude() -> None:
    q = quaternion(attitude())
    del q["ref_q_w"]
    with pytest.raises(InputError, match="lacks ref_q_w"):
        gap_of(log_of(rate(T), q, 4))


def test_a_reference_that_never_changes_is_refused() -> None:
    with pytest.raises(InputError, match="never change, though gyro moves"):
        gap_of(log_of(rate(T), table(np.zeros((T.size, 3))), 5))


def test_a_stuck_reference_is_left_out() -> None:
    x = rate(T)
    x[1500:2100] = x[1500]
    gap = gap_of(log_of(rate(T), table(x), 6))
    assert names(gap) == ["stuck_reference"]
    assert float(gap.findings[0].effect.share) == pytest.approx(599 / 4000, abs=2e-3)  # type: ignore[attr-defined]


def test_a_table_that_rests_is_not_stuck() -> None:
    """Steps of ten seconds, which the sensor follows with a time constant of 20 ms."""
    steps = np.repeat(np.array([0.0, 1.0, -0.5, 0.0])[:, None], 1000, axis=0) * [1.0, 0.0, 0.5]
    y, a = np.empty_like(steps), np.exp(-DT / 0.02)
    y[0] = steps[0]
    for k in range(1, T.size):
        y[k] = a * y[k - 1] + (1 - a) * steps[k]
    log = log_of(y, table(steps), 7)
    assert heard(log).said == ()
    assert heard(log).log is log


@pytest.mark.parametrize("every", [10, 4])
def test_a_held_reference_is_interpolated(every: int) -> None:
    """Motion of up to 1.7 Hz at 10 Hz and more."""
    gap = gap_of(log_of(rate(T), table(np.repeat(rate(T)[::every], every, axis=0)[: T.size]), 8))
    assert names(gap) == ["held_reference"]
    assert float(gap.findings[0].effect.period) == pytest.approx(every * DT)  # type: ignore[attr-defined]
    assert gap.verdict == "effects_found"


def test_clipped_samples_are_named_and_left_out() -> None:
    y = rate(T) + SIGMA * np.random.default_rng(9).standard_normal((T.size, 3))
    y = np.clip(y, -0.9, 1.0)
    log = Log(T, {f"gyro_{a}": Channel(y[:, k], "rad/s") for k, a in enumerate("xyz")} | table(rate(T)))
    gap = gap_of(log)
    assert set(names(gap)) == {"clipping"}
    assert {(f.where, float(f.effect.limit)) for f in gap.findings} == {  # type: ignore[attr-defined]
        (f"gyro_{a}", limit) for a in "xyz" for limit in (-0.9, 1.0)
    }
    assert gap.verdict == "effects_found"


@pytest.mark.long
def test_beside_a_clipping_another_effect_is_found() -> None:
    y = rate(T) * [1.0, 1.02, 1.0] + SIGMA * np.random.default_rng(10).standard_normal((T.size, 3))
    y[:, 1] = np.clip(y[:, 1], -1.0, 1.0)
    log = Log(T, {f"gyro_{a}": Channel(y[:, k], "rad/s") for k, a in enumerate("xyz")} | table(rate(T)))
    gap = gap_of(log)
    assert names(gap) == ["clipping", "clipping", "scale_factor"]
    assert gap.findings[-1].ci95["coefficient"] == pytest.approx((0.02, 0.02), abs=5e-4)


def test_frozen_samples_are_named_and_left_out() -> None:
    """Six seconds of one value, and a second of zeros as of a lost line."""
    y = rate(T) + SIGMA * np.random.default_rng(16).standard_normal((T.size, 3))
    y[1500:2100, 0] = y[1500, 0]
    y[3000:3100, 0] = 0.0
    log = Log(T, {f"gyro_{a}": Channel(y[:, k], "rad/s") for k, a in enumerate("xyz")} | table(rate(T)))
    gap = gap_of(log)
    (found,) = gap.findings
    assert (gap.verdict, found.effect.name, found.where) == (
        "effects_found",
        "repeated_samples",
        "gyro_x",
    )
    assert float(found.effect.share) == pytest.approx(700 / 4000, abs=1e-6)  # type: ignore[attr-defined]


def repeated(y: Array) -> Array:
    y = y.copy()
    for k in np.flatnonzero(np.random.default_rng(11).random(y.size) < 0.1)[1:]:
        y[k] = y[k - 1]
    return y


SPOIL: dict[str, tuple[Callable[[Array], Array], str, float]] = {
    "repeated_samples": (repeated, "share", 0.1),
    "coarse_quantisation": (lambda y: 5e-3 * np.round(y / 5e-3), "step", 5e-3),
    "stuck_bit": (lambda y: 1e-3 * (np.round(y / 1e-3).astype(np.int64) & ~4), "bit", 2.0),
    "dead_zone": (lambda y: np.where(abs(y) < 0.1, 0.0, y), "width", 0.1),
}


@pytest.mark.parametrize("name", SPOIL)
def test_faults_of_samples_that_move(name: str) -> None:
    fault, parameter, value = SPOIL[name]
    y = rate(T)[:, 0] + SIGMA * np.random.default_rng(12).standard_normal(T.size)
    found = spotted_moving(T, fault(y), WHITE, DT)
    assert [f.effect.name for f in found] == [name]
    assert found[0].spoils
    assert float(getattr(found[0].effect, parameter)) == pytest.approx(value, rel=0.2)


MOVING: dict[str, Callable[[Array], Array]] = {
    "smooth": lambda y: y,
    "ADC grid": lambda y: 2e-4 * np.round(y / 2e-4),
    "wide ADC grid": lambda y: 1e-3 * np.round(y / 1e-3),
}


@pytest.mark.parametrize("name", MOVING)
def test_sound_samples_that_move_have_no_fault(name: str) -> None:
    for seed in range(20):
        slow = rate(0.2 * T) if seed % 2 else rate(T)
        y = slow[:, seed % 3] + SIGMA * np.random.default_rng([13, seed]).standard_normal(T.size)
        assert spotted_moving(T, MOVING[name](y), WHITE, DT) == [], seed


def test_the_noise_of_samples_that_move() -> None:
    """Of 4000 samples the median of differences of order eight gives it to 3 %."""
    y = rate(T)[:, 0] + SIGMA * np.random.default_rng(14).standard_normal(T.size)
    assert noise_of(y) == pytest.approx(SIGMA, rel=0.1)


def test_residuals_do_not_depend_on_what_was_asked_before() -> None:
    """Results are kept: white noise of the readings comes out again when effects and biases are the true ones."""
    y = rate(T) * [1.0, 1.02, 1.0]
    noise = ChannelNoise("rad/s", (Term(WHITE[0]),))
    model = NoiseModel({f"gyro_{a}": noise for a in "xyz"})
    scene = motion_scene(log_of(y, table(rate(T)), 18), model)
    assert scene is not None
    scale, late = (
        Placed(make(n, **v), "gyro_y")
        for n, v in (("scale_factor", {"coefficient": 0.02}), ("time_delay", {"delay": 0.01}))
    )
    points = [
        ScenePoint(p, np.full(3, b)) for p in ((), (scale,), (late,), (scale, late)) for b in (0.0, 0.1)
    ]
    together = scene.residuals([*points, *points[::-1]])
    for k, point in enumerate(points):
        alone = replace(scene).residuals([point])[:, 0]  # a scene that remembers nothing
        np.testing.assert_array_equal(together[:, k], alone)
        np.testing.assert_array_equal(together[:, -1 - k], alone)
    z = np.random.default_rng(18).standard_normal((T.size, 3))
    assert together[:, 2] @ together[:, 2] == pytest.approx(float((z**2).sum()), rel=1e-9)


def test_a_memory_forgets_what_was_not_asked_for_longest() -> None:
    asked: list[int] = []
    memory: RecentResults[int] = RecentResults(2)
    for k in (1, 2, 1, 3, 1, 2):
        assert memory.recalled(k, lambda k=k: asked.append(k) or -k) == -k  # type: ignore[func-returns-value, misc]
    assert asked == [1, 2, 3, 2]
