"""A log whose sensors moved, without a reference, is compared with a model of their noise where they were at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.find_gap import find_gap
from kfgen.identify.identify_log import identify
from kfgen.identify.screening.rests import longest_rest, rests
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

DT, N, GRAVITY = 0.02, 6000, 9.80665
T = DT * np.arange(N)
SD = 0.002
NOISE = NoiseModel(
    {f"gyro_{a}": ChannelNoise("rad/s", (Term(make("white_noise", N=SD * np.sqrt(DT))),)) for a in "xyz"}
)


def carried(rests: tuple[tuple[float, float], ...]) -> Log:
    """A body that is rocked by hand about x by up to 40 degrees, but for its rests [s]."""
    rng = np.random.default_rng(71)
    moves = np.ones(N)
    for begin, end in rests:
        moves[int(begin / DT) : int(end / DT)] = 0.0
    rate = moves * (0.7 * np.sin(1.1 * T) + 0.3 * np.sin(3.1 * T))
    angle = np.cumsum(rate) * DT
    turned = {"x": 0.0 * T, "y": -GRAVITY * np.sin(angle), "z": -GRAVITY * np.cos(angle)}
    gyro = {f"gyro_{a}": (rate if a == "x" else 0.0 * T) + SD * rng.standard_normal(N) for a in "xyz"}
    accel = {f"accel_{a}": turned[a] + 0.02 * rng.standard_normal(N) for a in "xyz"}
    channels = {n: Channel.of(y, "rad/s") for n, y in gyro.items()}
    return Log(T, channels | {n: Channel.of(y, "m/s^2") for n, y in accel.items()})


def test_the_longest_rest_is_compared() -> None:
    """All of a recording of such a motion gave intermittent noise, steps of its level, and noise that the axes share, at 90 to 99.9 %."""
    found = find_gap(carried(((0.0, 15.0), (60.0, 90.0))), NOISE)
    assert [c.verdict for c in found.comparisons] == ["no_gap"] * 3
    (words,) = [w for w in found.warnings if "longest rest" in w]
    begin, end = (float(x) for x in words.split("longest rest, ")[1].split(" s")[0].split(" to "))
    assert (begin, end) == pytest.approx((60.0, 90.0), abs=1.0)


def test_a_lost_row_and_a_hole_leave_the_rests() -> None:
    log = carried(((0.0, 15.0), (60.0, 90.0)))
    kept = np.ones(N, dtype=bool)
    kept[[500, 3500]] = False
    kept[1200:1700] = False
    part = Log(T[kept], {n: replace(c, values=c.values[kept]) for n, c in log.channels.items()})
    rest = longest_rest(part)
    assert rest is not None
    assert rest.t[[0, -1]] == pytest.approx([60.0, 90.0], abs=1.0)


def test_the_noise_of_a_moved_log_is_that_of_its_longest_rest() -> None:
    """Of a log that is rocked all the time the motion counts as noise, two hundred times as large, and that is said."""
    found = identify(carried(((0.0, 15.0), (60.0, 90.0))), channels="gyro_x", effects="white_noise")
    N_x = found.noise.channel("gyro_x").effects[0].N
    assert N_x == pytest.approx(SD * np.sqrt(DT), rel=0.08)  # three standard deviations of 1,500 samples
    assert any("identified is their longest rest" in w for w in found.warnings)
    rocked = identify(carried(((0.0, 5.0),)), channels="gyro_x", effects="white_noise")
    assert any("this motion counts as noise here" in w for w in rocked.warnings)
    assert 20.0 * N_x < rocked.noise.channel("gyro_x").effects[0].N


@pytest.mark.parametrize(("rate_deg_s", "is_rest"), [(0.45, False), (0.12, True)])
def test_a_hover_is_no_rest(rate_deg_s: float, is_rest: bool) -> None:
    """Rates that wander within two degrees a second, as of a quadrotor that holds its place; half of a quarter is a rest."""
    rng = np.random.default_rng(176150)
    log = carried(((60.0, 90.0),))
    wander = np.repeat(np.radians(rate_deg_s) * rng.uniform(-1.7, 1.7, N // 25), 25)
    gyro = {f"gyro_{a}": log.channels[f"gyro_{a}"] for a in "xyz"}
    moved = {n: replace(c, values=c.values + wander) for n, c in gyro.items()}
    rest = longest_rest(replace(log, channels={**log.channels, **moved}))
    assert (rest is not None) == is_rest


def test_a_log_that_is_mostly_bursts_has_the_rest_of_its_even_part() -> None:
    """Bursts of ten rows tell nothing of a rest; with as many of them the quietest tenth had been no number."""
    log = carried(((20.0, 40.0),))
    sparse = 1000.0 + (2.0 * np.arange(6_000)[:, None] + DT * np.arange(10)).ravel()
    t = np.concatenate([log.t, sparse])
    channels = {
        n: replace(c, values=np.concatenate([c.values, np.zeros(sparse.size)]))
        for n, c in log.channels.items()
    }
    found = [(a, b) for a, b in rests(Log(t, channels), "gyro") if t[b - 1] - t[a] > 10.0]
    assert [(t[a], t[b - 1]) for a, b in found] == [pytest.approx((20.0, 40.0), abs=1.0)]


def test_a_rest_of_too_few_samples_stands_for_nothing() -> None:
    log = carried(((20.0, 33.0),))  # 59 samples of it at 5 Hz
    slow = Log(T[::10], {n: replace(c, values=c.values[::10]) for n, c in log.channels.items()})
    assert longest_rest(slow) is not None
    found = identify(slow, channels="gyro_x", effects="white_noise")
    assert any("this motion counts as noise here" in w for w in found.warnings)


def test_motion_without_a_rest_is_refused() -> None:
    with pytest.raises(InputError, match="without a rest of 10 s") as refused:
        find_gap(carried(((0.0, 5.0),)), NOISE)
    assert "reference" in refused.value.remedy
