"""Biases that come behind what drives them, bend with it, or follow two channels at once.

White noise and courses by plain numpy; a pole is integrated by scipy. Each effect is worth over 60 nats: its name is
missed in fewer than 1e-6 of the seeds. Seeds are fixed.
"""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, noise_text, parse_noise
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]
N, DT = 8192, 0.1
T = np.arange(N) * DT
CYCLE = 3.0 * np.sin(2.0 * np.pi * T / 300.0) + 1.5 * np.sin(2.0 * np.pi * T / 110.0 + 1.0)
LOAD = np.where((T // 45.0).astype(int) % 3 == 0, 1.0, 0.0) + 0.3 * (T > 400.0)


def behind(x: Array, lag: float) -> Array:
    """``lag dy/dt = x - y``, integrated by an adaptive method."""
    solved = solve_ivp(
        lambda t, y: (np.interp(t, T, x) - y) / lag, (0.0, T[-1]), [x[0]], t_eval=T, rtol=1e-8, max_step=0.5
    )
    return np.asarray(solved.y[0])


def worth(shape: Array, nats: float) -> Array:
    away = shape - shape.mean()
    return away * float(np.sqrt(2.0 * nats / (away @ away)))


def gap_of(part: Array, seed: int, **drive: Array) -> ChannelGap:
    y = np.random.default_rng([seed, 43]).standard_normal(N) + part
    assumed = ChannelNoise("rad/s", (Term(make("white_noise", N=np.sqrt(DT))),))
    return channel_gap("gyro_x", Record(T, y, drive), assumed)


@pytest.mark.long
@pytest.mark.parametrize(
    ("channel", "name", "course"),
    in_part([("temperature", "thermal_lag", 300.0 + CYCLE), ("load", "lagged:load", LOAD)]),
)
def test_a_lag_behind_a_driver_is_named_with_its_time(channel: str, name: str, course: Array) -> None:
    gap = gap_of(worth(behind(course, 25.0), 150.0), 1, **{channel: course})
    assert [f.effect.name for f in gap.findings] == [name]
    assert gap.verdict == "effects_found"
    lo, hi = gap.findings[0].ci95["lag"]
    assert lo < 25.0 < hi
    assert hi / lo < 2.5
    model = NoiseModel({"gyro_x": gap.updated})
    read = parse_noise(noise_text(model), "improved.toml").channel("gyro_x").effects
    assert [type(e) for e in read] == [type(e) for e in gap.updated.effects]
    assert read[-1].lag == pytest.approx(gap.updated.effects[-1].lag, rel=1e-6)  # type: ignore[attr-defined]


@pytest.mark.long
@pytest.mark.parametrize("channel", in_part(["temperature", "load"]))
def test_without_a_lag_none_is_named(channel: str) -> None:
    course = 300.0 + CYCLE if channel == "temperature" else LOAD
    gap = gap_of(worth(course, 60.0), 2, **{channel: course})
    assert [f.effect.name for f in gap.findings] == [
        "temperature" if channel == "temperature" else "coupling:load"
    ]


@pytest.mark.long
def test_a_bias_that_bends_with_the_temperature() -> None:
    gap = gap_of(worth((CYCLE - CYCLE.mean()) ** 2, 100.0), 3, temperature=300.0 + CYCLE)
    assert [f.effect.name for f in gap.findings] == ["temperature_squared"]


@pytest.mark.long
def test_two_drivers_are_not_confused_with_a_random_walk() -> None:
    """60 and 60 nats; a random walk explains nearly as much, and each of them alone much less."""
    part = worth(CYCLE, 60.0) + worth(LOAD, 60.0)
    gap = gap_of(part, 5, temperature=300.0 + CYCLE, load=LOAD)
    assert {f.effect.name.removeprefix("lagged:").removeprefix("coupling:") for f in gap.findings} == {
        "temperature",
        "load",
    }
