"""Proves that what does not hold on data that its fit did not see is not added, and what no record can show is no finding.

The predictions are compared with Gaussian conditionals by dense linear algebra. The plants are simulated in plain numpy;
seeds are fixed. An effect that is there, at its detection limit of 8 nats, loses 3 nats in less than 1 % of records.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.core import time_budget
from kfgen.effects.effect import Effect
from kfgen.effects.inertial.errors import EarthRate
from kfgen.effects.plant.sensor import Backlash
from kfgen.effects.plant.terms import InputDeadZone, Saturation
from kfgen.gap.core.unseen import LinearFit, parts_of, tail_of, unseen_gain
from kfgen.gap.find_gap import find_gap
from kfgen.gap.plant.reach import unreached
from kfgen.gap.result import GapResult
from kfgen.gap.scene.scene import Placed
from kfgen.identify.evidence.long import Stream, condense
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model

Array = NDArray[np.float64]

MOTOR = """
format = "kfgen-model-1"
name = "motor"
[parameters]
a = "1.5 1/s"
b = "4 rad/s^2"
[states]
w = "rad/s"
[inputs]
u = ""
[dynamics]
w = "-a*w + b*u"
[measurements.speed]
unit = "rad/s"
expression = "w"
effects = [ { effect = "white_noise", N = "0.002 rad/s/sqrt(Hz)" } ]
"""


def linear_fit(y: Array, J: Array) -> LinearFit:
    """Least squares under a wide prior."""
    H = J.T @ J
    return LinearFit(y - J @ np.linalg.solve(H, J.T @ y), J, H)


def test_a_part_is_predicted_as_by_the_conditional_density() -> None:
    """``ln N(y_U; mean, C)`` without ``2 pi``, the mean and C those of Gauss's conditional on the rest."""
    rng, n = np.random.default_rng(2), 60
    J = np.column_stack([np.ones(n), rng.standard_normal(n), np.linspace(0.0, 1.0, n)])
    y = J @ [1.0, 2.0, -1.0] + rng.standard_normal(n)
    unseen = np.arange(n) >= 45
    rest = np.linalg.inv(J[~unseen].T @ J[~unseen])
    left = y[unseen] - J[unseen] @ (rest @ (J[~unseen].T @ y[~unseen]))
    C = np.eye(15) + J[unseen] @ rest @ J[unseen].T
    want = -0.5 * (left @ np.linalg.solve(C, left) + np.linalg.slogdet(C)[1])
    assert linear_fit(y, J).predicted(unseen) == pytest.approx(want, abs=0.02)  # the prior's share


def test_an_event_that_one_part_shows_is_looked_for_again_there() -> None:
    """Ten samples of size 3: 45 nats, less what it costs not to know their size from the rest."""
    y = np.random.default_rng(3).standard_normal(400)
    event = np.where(np.abs(np.arange(400) - 150) < 5, 1.0, 0.0)
    gain = unseen_gain(
        linear_fit(y + 3.0 * event, np.ones((400, 1))),
        linear_fit(y + 3.0 * event, np.column_stack([np.ones(400), event])),
        parts_of((400,)),
    )
    assert gain > 20.0


def test_a_slope_that_turns_is_no_slope() -> None:
    t = np.linspace(0.0, 1.0, 1000)
    y = 5.0 * np.minimum(t, 1.4 - t) + np.random.default_rng(4).standard_normal(1000)
    fits = [linear_fit(y, J) for J in (np.ones((1000, 1)), np.column_stack([np.ones(1000), t]))]
    assert fits[1].residual @ fits[1].residual < fits[0].residual @ fits[0].residual - 20.0
    assert unseen_gain(fits[0], fits[1], [tail_of((1000,))]) < -20.0


def motor(seed: int, change: float, friction: float = 0.0) -> GapResult:
    """The gap of a motor whose gain falls by twice a share after seven tenths of the log, and that may have dry friction."""
    rng, n, dt = np.random.default_rng(seed), 1500, 0.04
    u, w = np.repeat(rng.uniform(-1.0 if friction else 0.0, 1.0, n // 25), 25), np.zeros(n)
    for k in range(n - 1):
        b, x = 4.0 * (1.0 + (change if k < 0.7 * n else -change)), w[k]
        for _ in range(10):
            x += 0.1 * dt * (-1.5 * x + b * u[k] - friction * np.tanh(x / 0.02))
        w[k + 1] = x
    channels = {"u": Channel.of(u, ""), "speed": Channel.of(w + 0.01 * rng.standard_normal(n), "rad/s")}
    return find_gap(Log(dt * np.arange(n), channels), parse_model(MOTOR, "motor.toml"))


@pytest.mark.long
def test_what_makes_it_worse_is_not_added() -> None:
    """A gain that changes is no effect of the catalogue: four were added once, and the held-out gap grew by 75 %."""
    found = motor(1, 0.05)
    assert found.verdict == "unknown_effect"
    assert found.gap.after <= found.gap.before
    assert "Not added" in " ".join(found.warnings)
    assert found.to_dict()["refused"]


@pytest.mark.long
def test_what_is_there_is_added() -> None:
    found = motor(2, 0.0, friction=0.3)
    assert [f.name for f in found.findings][:1] == ["coulomb_friction"]
    assert found.gap.closed > 0.9


@pytest.mark.parametrize(
    ("effect", "where", "why"),
    [
        (Saturation(9.79), "u", "reaches"),
        (InputDeadZone(6.5), "u", "leaves"),
        (Backlash(4.0), "speed", "crosses"),
        (Saturation(6.0), "u", ""),
        (InputDeadZone(1.0), "u", ""),
        (Backlash(0.1), "speed", ""),
    ],
)
def test_what_signals_do_not_reach_is_no_finding(effect: Effect, where: str, why: str) -> None:
    said = unreached(Placed(effect, where), {"u": np.array([-6.47, 3.0])}, {"speed": np.array([0.0, 3.0])})
    assert (why in said) if why else said == ""


def test_a_search_without_time_ends_with_what_it_has_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_budget, "SEARCH_SECONDS", 0.0)
    monkeypatch.setattr(time_budget, "FIT_SECONDS", 0.0)
    found = motor(2, 0.0, friction=0.3)
    assert found.findings == ()
    assert "ended" in found.warnings[-1]


def test_searches_share_what_is_left_of_the_time() -> None:
    with time_budget.time_budget() as outer:
        with time_budget.time_budget(parts=3) as inner:
            assert inner.search_s == pytest.approx(outer.search_s / 3.0, rel=0.05)
            inner.ended_early = True
        assert outer.ended_early
    assert not time_budget.search_is_over()


@pytest.mark.parametrize(
    ("effect", "why"),
    [
        (EarthRate(5e-5, 0.0, -5.3e-5), ""),
        (EarthRate(-1e-3, -4e-3, -1e-3), "so fast"),
    ],
)
def test_what_physics_forbids_is_no_finding(effect: Effect, why: str) -> None:
    """Of the Earth 7.29e-5 rad/s, which noise may make somewhat more."""
    assert (why in effect.forbidden()) if why else effect.forbidden() == ""


def test_a_pass_over_a_long_log_takes_nothing_of_the_time_of_a_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 100 s that passed 80 were reading: the search has spent 20, and one that began after 85 s its own 15."""
    now = [0.0]
    for clock in ("monotonic", "process_time"):
        monkeypatch.setattr(f"kfgen.core.time_budget.time.{clock}", lambda: now[0])
    budget = time_budget.TimeBudget(_clock=now[0], _process=now[0])
    now[0] += 5.0
    with time_budget.not_counted():
        now[0] += 80.0
    later = time_budget.TimeBudget(_clock=now[0], _process=now[0])
    now[0] += 15.0
    assert (budget.spent_s, later.spent_s) == pytest.approx((20.0, 15.0))


def test_a_long_record_is_condensed_beside_the_time_of_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a log of 10 GB the pass took all of the time, and its random walk was not found."""
    now = [0.0]
    for clock in ("monotonic", "process_time"):
        monkeypatch.setattr(f"kfgen.core.time_budget.time.{clock}", lambda: now[0])
    budget = time_budget.TimeBudget(_clock=0.0, _process=0.0)

    def chunks() -> Iterator[NDArray[np.float64]]:
        now[0] += 1000.0
        yield np.random.default_rng(0).standard_normal(1 << 12)

    condense(Stream(chunks, 1 << 12, 0.01))
    assert budget.spent_s == pytest.approx(0.0, abs=1e-6)
