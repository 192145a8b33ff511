"""Proves that slow noise is named for certain only where the course that it took is one of its kind.

Courses are simulated by the effects' own laws, and by a logistic map (R. M. May, Nature 261, 1976), which is made by a
rule and not by chance though its spectrum is that of a resonance. One true course in a hundred fails by chance, at most:
of 200 with their true numbers (other seeds) none did.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstest

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core import course_law
from kfgen.gap.core.course_figure import strangest
from kfgen.gap.core.random_course import least_usual
from kfgen.gap.core.thresholds import MAX_PROBABILITY_OF_STAND_IN
from kfgen.gap.rest import course
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.course import none_of_their_kind
from kfgen.gap.words import finding_sentence
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT = 4096, 0.1
T = np.arange(N) * DT
WHITE = make("white_noise", N=np.sqrt(DT))
KINDS = {
    "gauss_markov": {"sigma": 0.3, "tau": 5.0},
    "rate_random_walk": {"K": 0.02},
    "bias_instability": {"B": 0.1},
    "power_law_noise": {"B": 0.1, "slope": 1.5},
    "random_telegraph": {"size": 0.6, "dwell": 8.0},
    "resonance": {"frequency": 0.3, "damping": 0.1, "rms": 0.3},
}


def chaos(n: int, held: int, size: float) -> Array:
    """A logistic map, each value held for some samples; its mean is about zero."""
    z = np.empty(n // held + 1)
    z[0] = 0.3
    for k in range(1, z.size):
        z[k] = 3.9 * z[k - 1] * (1.0 - z[k - 1])
    return np.asarray(size * (np.repeat(z, held)[:n] - 0.5))


@pytest.mark.parametrize("name", KINDS)
def test_a_course_of_its_kind_passes(name: str) -> None:
    effect, rng = make(name, **KINDS[name]), np.random.default_rng([17, len(name)])
    y = rng.standard_normal(N) + effect.simulate(T, rng)
    assert none_of_their_kind(Record(T, y), [WHITE], [effect]) == ""


def test_what_is_no_noise_has_no_course() -> None:
    y = np.random.default_rng(1).standard_normal(N)
    assert none_of_their_kind(Record(T, y), [WHITE], [make("rate_ramp", R=1e-3)]) == ""


def test_a_course_that_happens_once_is_none_of_a_stationary_process() -> None:
    """A door that stands open for twenty seconds."""
    y = np.random.default_rng(2).standard_normal(N) + 2.0 * np.exp(-0.5 * ((T - 200.0) / 8.0) ** 2)
    bias = make("gauss_markov", sigma=0.35, tau=10.0)
    assert (
        none_of_their_kind(Record(T, y), [WHITE], [bias]) == "it acts about 192 s alone"
    )  # the middle of a part


def test_a_course_that_follows_a_driver_is_no_noise() -> None:
    rng = np.random.default_rng(3)
    load = np.interp(T, T[::200], rng.standard_normal(T[::200].size))
    y = rng.standard_normal(N) + 0.4 * load
    record = Record(T, y, {"load": load})
    assert (
        none_of_their_kind(record, [WHITE], [make("gauss_markov", sigma=0.3, tau=12.0)]) == "it follows load"
    )


@pytest.mark.long
def test_chaos_is_a_stand_in_and_no_certain_resonance() -> None:
    """Once two resonances, more than 99.9 % each, verdict "effects_found"."""
    n = 8192
    t = DT * np.arange(n)
    y = np.random.default_rng([7010, 990]).standard_normal(n) + chaos(n, 20, 1.5)
    gap = channel_gap("gyro_x", Record(t, y), ChannelNoise("rad/s", (Term(WHITE),)))
    assert gap.verdict == "unknown_effect"
    assert gap.findings
    assert max(f.probability for f in gap.findings) <= MAX_PROBABILITY_OF_STAND_IN
    assert "stands in for something else" in finding_sentence(gap, gap.findings[0])


def pulses(rng: np.random.Generator, n: int, period: float) -> Array:
    """A thermostat: on for a quarter of cycles whose length drifts, seen through one pole."""
    from scipy.signal import lfilter

    drift = np.interp(np.arange(n), np.arange(0, n + 400, 400), rng.standard_normal(n // 400 + 2))
    phase = np.cumsum(1.0 + 0.1 * drift) / period
    return np.asarray(lfilter([1.0], [1.0, -0.9], 0.1 * (np.mod(phase, 1.0) < 0.25)))


def two_sides(n: int, turn: float) -> Array:
    """The first coordinate of the Lorenz system [SI of its own], scaled to a variance of one; `turn`: samples of a unit."""
    from scipy.integrate import solve_ivp

    def slope(_: float, s: Array) -> list[float]:
        return [10.0 * (s[1] - s[0]), s[0] * (28.0 - s[2]) - s[1], s[0] * s[1] - 8.0 / 3.0 * s[2]]

    at = 10.0 + np.arange(n) / turn
    x = solve_ivp(slope, (0.0, float(at[-1])), [1.0, 1.0, 20.0], t_eval=at, rtol=1e-7).y[0]
    return np.asarray(x / x.std())


def test_cycles_with_a_shape_are_no_resonance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three resonances have the spectrum of a heater's cycles, which do not keep time; their phases are not in step."""
    monkeypatch.setattr(course, "other_law", lambda *asked: ("", 0.0))  # it is a limit cycle, too
    rng = np.random.default_rng(5)
    y = rng.standard_normal(N) + 2.0 * pulses(rng, N, 100.0)
    lines = ((0.1, 0.52), (0.2, 0.3), (0.3, 0.12))
    added = [make("resonance", frequency=f, damping=0.1, rms=rms) for f, rms in lines]
    said = none_of_their_kind(Record(T, y), [WHITE], added)
    assert said == "its cycles have a shape: harmonic 2 keeps step with them"
    same = np.random.default_rng(8)
    y = same.standard_normal(N) + sum(e.simulate(T, same) for e in added)
    assert none_of_their_kind(Record(T, y), [WHITE], added) == ""


def test_chaos_that_changes_sides_is_no_telegraph(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a side it swings at 1.3 turns a unit of its time (Lorenz 1963): here 0.13 Hz. Its strength alone says so."""
    monkeypatch.setattr(course_law, "_swings", lambda points, span: [])
    y = np.random.default_rng(6).standard_normal(N) + 0.8 * two_sides(N, 100.0)
    telegraph = make("random_telegraph", size=1.5, dwell=12.0)
    said = none_of_their_kind(Record(T, y), [WHITE], [telegraph])
    assert said == "its strength comes and goes at 0.13 Hz"


def test_swings_that_keep_no_time_are_no_slow_noise() -> None:
    """Of a twentieth of the noise's power, with a period of 30 s that changes by a sixth: no line of the record is strong."""
    rng = np.random.default_rng(13)
    pace = np.interp(T, T[::600], 1.0 + 0.15 * rng.standard_normal(T[::600].size))
    y = rng.standard_normal(N) + 0.3 * np.sin(2.0 * np.pi * np.cumsum(pace) * DT / 30.0)
    said = none_of_their_kind(Record(T, y), [WHITE], [make("gauss_markov", sigma=0.22, tau=5.0)])
    assert said.startswith("it swings at about 0.03")  # a period is 30 s


def test_noise_that_is_faster_than_a_course_of_usual_length_has_a_longer_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A resonance at 3 Hz of 5 is in ordinate 9830 of 16384: its course has the most points that any has."""
    rng, n, sizes = np.random.default_rng(15), 4 * N, []
    t = DT * np.arange(n)
    monkeypatch.setattr(course, "other_law", lambda *asked: ("", 0.0))
    monkeypatch.setattr(
        course, "least_usual", lambda t, own, *rest, law: (sizes.append(own.size), ("", 1.0))[1]
    )
    for f, points in ((1.0, (2048, 6144)), (3.0, (8192, 8192))):
        fast = make("resonance", frequency=f, damping=0.02, rms=1.0)
        none_of_their_kind(Record(t, rng.standard_normal(n)), [WHITE], [fast])
        assert points[0] <= sizes[-1] <= points[1]


def test_chances_of_courses_are_what_they_say() -> None:
    """Of 150 courses of the law that is drawn they are even: a test of false-alarm rate 1e-3."""
    rng = np.random.default_rng(14)
    t = np.arange(128.0)
    own = np.cumsum(rng.standard_normal((128, 150)), axis=0)
    chances = [
        least_usual(t, x, np.cumsum(rng.standard_normal((128, 199)), axis=0), {"time": t}, law=True)[1]
        for x in own.T
    ]
    assert kstest(chances, "uniform").pvalue > 1e-3


def test_only_what_is_larger_counts_where_it_says_so() -> None:
    def of(w: Array) -> Array:
        return np.asarray(w)

    every = np.array([[3.0, 0.0, 1.0, 2.0], [-9.0, 0.0, 1.0, 2.0]])
    far, where = strangest(of)(every)
    larger, place = strangest(of, larger=True)(every)
    assert (int(where[0]), int(place[0])) == (1, 0)
    assert far[0] == pytest.approx(10.0 / np.std([0.0, 1.0, 2.0]))
    assert larger[0] == pytest.approx(2.0 / np.std([0.0, 1.0, 2.0]))


@pytest.mark.long
def test_a_heater_in_the_noise_of_the_model_is_no_number_of_it() -> None:
    """The bias of the model takes its pulses up: once "model structure confirmed; parameters re-estimated"."""
    rng, n = np.random.default_rng(11), 4 * N
    t, bias = DT * np.arange(n), {"sigma": 0.2, "tau": 5.0}
    assumed = ChannelNoise("rad/s", (Term(WHITE), Term(make("gauss_markov", **bias))))
    quiet = rng.standard_normal(n) + make("gauss_markov", **bias).simulate(t, rng)
    heated = channel_gap("gyro_x", Record(t, quiet + 0.4 * pulses(rng, n, 300.0)), assumed)
    assert (heated.verdict, heated.retuned, heated.findings) == ("unknown_effect", True, ())
    assert not any(test.significant for test in heated.after)
    assert " 0.03" in heated.own_noise_objection  # [Hz]: a cycle is 30 s
    y = rng.standard_normal(n) + make("gauss_markov", sigma=0.4, tau=5.0).simulate(t, rng)
    larger = channel_gap("gyro_x", Record(t, y), assumed)
    assert (larger.verdict, larger.retuned, larger.own_noise_objection) == ("effects_found", True, "")
