"""What is assumed is compared as it is written: numbers, coefficients, a constant.

Records are plain numpy. A null is falsely found at the battery's family-wise rate of 1 %; seeds are fixed.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from in_part import in_part

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.result import Checks, Finding
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.even_record import regular
from kfgen.gap.words import check_sentences
from kfgen.identify.evidence.record import Record
from kfgen.log.log import Channel, Log
from kfgen.report.gap import sentences
from kfgen.report.page import Page, figure, page_html
from kfgen.report.plots import bars_picture

RATE = 20.0
T = np.arange(24_000) / RATE
N = 1e-4
HEAT = 300.0 + 5.0 * np.sin(2 * np.pi * T / 150.0)


def answer(y: np.ndarray, *effects: object) -> ChannelGap:
    noise = ChannelNoise("deg/s", tuple(Term(e) for e in effects))  # type: ignore[arg-type]
    return channel_gap("gyro_x", Record(T, y, {"temperature": HEAT}), noise)


def noise(seed: int, scale: float = 1.0) -> np.ndarray:
    return scale * N * np.sqrt(RATE) * np.random.default_rng(seed).standard_normal(T.size)


@pytest.mark.parametrize("factor", in_part([1.3, 0.7]))
def test_a_number_that_is_wrong_by_a_third_is_found(factor: float) -> None:
    g = answer(noise(1, factor), make("white_noise", N=N))
    assert (g.verdict, g.retuned, g.findings) == ("effects_found", True, ())
    assert pytest.approx(factor * N, rel=0.03) == g.updated.effects[0].N  # type: ignore[attr-defined]
    assert g.gap.before > 0.02
    assert g.gap.closed > 0.95


@pytest.mark.long
@pytest.mark.parametrize("factor", [1.2, pytest.param(0.8, marks=pytest.mark.long)])
def test_a_number_that_does_not_hold_is_said_old_and_new(factor: float) -> None:
    """Alone, and beside a step of ten times the standard deviation of its mean."""
    step = np.where(T > 700.0, 3e-5, 0.0)
    for y, found in ((noise(21, factor), []), (noise(21, factor) + step, ["bias_step"])):
        g = answer(y, make("white_noise", N=N))
        assert [f.effect.name for f in g.findings] == found
        (said,) = (s for s in sentences(g) if " instead of " in s)
        number, was = map(float, re.findall(r"(?:N = |instead of )([-+.e0-9]+)", said))
        assert number / was == pytest.approx(factor, rel=0.03)


def test_numbers_that_hold_are_not_said_anew() -> None:
    assert not any(" instead of " in s for s in sentences(answer(noise(22), make("white_noise", N=N))))


def test_an_assumed_time_longer_than_half_the_record_stays() -> None:
    """Of 2000 s in 1200: the record cannot say it, and does not contradict it."""
    truth = make("gauss_markov", sigma=3e-5, tau=2000.0)
    y = noise(23) + truth.simulate(T, np.random.default_rng(24))
    g = answer(y, make("white_noise", N=N), truth)
    assert (g.verdict, g.findings, g.retuned) == ("no_gap", (), False)
    (updated,) = (e for e in g.updated.effects if e.name == "gauss_markov")
    assert 1000.0 < updated.tau < 4000.0  # type: ignore[attr-defined]


@pytest.mark.long
def test_noise_that_is_louder_where_it_is_warm_fails_the_test_of_its_level() -> None:
    """A fifth up and down with the temperature: of 24 000 samples the test's deviate is 0.4 / 2 sqrt(24 000) = 31."""
    g = answer(noise(25) * (1.0 + 0.2 * (HEAT - 300.0) / 5.0), make("white_noise", N=N))
    (test,) = (t for t in g.before if t.name == "noise level on temperature")
    assert test.significant
    assert np.sqrt(test.ratio - 1.0) == pytest.approx(0.4 * np.sqrt(T.size) / 2.0, rel=0.15)
    assert g.verdict != "no_gap"
    g = answer(noise(26), make("white_noise", N=N))
    assert not any(t.significant for t in g.before)


def test_checks_that_fail_say_so() -> None:
    sound = check_sentences(Checks(0.0, {"bias_step": True}, ("bias_step",), ("bias_step",)))
    assert all(s.startswith("Check passed") for s in sound)
    other = check_sentences(Checks(1.5, {"bias_step": False}, ("rate_ramp",), ("bias_step",)))
    assert all(s.startswith("Check failed") for s in other)
    assert "changes the likelihood by 1.5 nats" in other[0]
    assert "does not bound the size of bias_step" in other[1]
    assert "finds rate_ramp, not bias_step" in other[2]
    assert "finds nothing" in check_sentences(Checks(0.0, {}, (), ("bias_step",)))[2]


@pytest.mark.parametrize(
    ("checks", "probability"),
    [
        (Checks(0.0, {"bias_step": True}, ("bias_step",), ("bias_step",)), 0.99),
        (Checks(0.0, {"bias_step": True}, None, ("bias_step",)), 0.99),
        (Checks(0.0, {}, ("rate_ramp", "bias_step"), ("bias_step",)), 0.99),
        (Checks(0.0, {"bias_step": True}, ("rate_ramp",), ("bias_step",)), 0.9),
        (Checks(0.0, {"bias_step": False}, ("bias_step",), ("bias_step",)), 0.9),
    ],
)
def test_what_a_check_does_not_bear_out_is_not_certain(checks: Checks, probability: float) -> None:
    """Where none could be simulated there is nothing to find again."""
    found = Finding(make("bias_step", size=1.0, time=5.0), "gyro_x", "rad/s", probability=0.99)
    assert [f.probability for f in checks.tempered([found])] == [probability]


@pytest.mark.long
@pytest.mark.parametrize("assumed", [0.0, *(pytest.param(a, marks=pytest.mark.long) for a in (2e-3, -2e-3))])
def test_a_coefficient_that_is_wrong_is_corrected(assumed: float) -> None:
    y = noise(2) + 2e-4 * (HEAT - 300.0)
    g = answer(y, make("white_noise", N=N), make("temperature", coefficient=assumed, reference=300.0))
    assert [f.effect.name for f in g.findings] == ["temperature"]
    (updated,) = (e for e in g.updated.effects if e.name == "temperature")
    assert updated.coefficient == pytest.approx(2e-4, rel=0.05)  # type: ignore[attr-defined]


def test_a_coefficient_that_is_right_is_no_gap() -> None:
    y = noise(3) + 2e-4 * (HEAT - 300.0)
    g = answer(y, make("white_noise", N=N), make("temperature", coefficient=2e-4, reference=300.0))
    assert (g.verdict, g.findings) == ("no_gap", ())


def test_an_assumed_constant_is_no_gap() -> None:
    g = answer(noise(4) + 0.01, make("white_noise", N=N), make("bias", value=0.02))
    assert (g.verdict, g.findings) == ("no_gap", ())


@pytest.mark.parametrize("holes", ["one of a tenth", "a third, anywhere"])
def test_missing_samples_are_no_effect(holes: str) -> None:
    y = noise(8)
    y[10_000:12_400] = np.nan
    if holes != "one of a tenth":
        y[np.random.default_rng(9).random(T.size) < 0.25] = np.nan
    effects = (make("white_noise", N=N),)
    record, _, said = regular(Log(T, {"gyro_x": Channel(y, "deg/s")}), "gyro_x", effects)
    g = channel_gap("gyro_x", record, ChannelNoise("deg/s", tuple(Term(e) for e in effects)))
    assert (g.verdict, g.findings) == ("no_gap", ())
    assert any("are missing" in words for words in said)


def flicker(seed: int, B: float) -> np.ndarray:
    """Noise of two-sided density ``B^2 / (2 pi f)`` from the transform, with no shortest time but a sample."""
    rng, m = np.random.default_rng(seed), 4 * T.size
    f = np.fft.rfftfreq(m, 1.0 / RATE)
    f[0] = np.inf
    z = rng.standard_normal((2, f.size)) * np.sqrt(B**2 / (2 * np.pi * f) * m * RATE / 2.0)
    return np.asarray(np.fft.irfft(z[0] + 1j * z[1], m)[: T.size])


@pytest.mark.parametrize("seed", in_part([5, 6]))
def test_a_flicker_of_which_only_B_is_stated_reaches_to_the_samples(seed: int) -> None:
    g = answer(
        noise(seed) + flicker(seed + 100, 2 * N), make("white_noise", N=N), make("bias_instability", B=2 * N)
    )
    assert (g.verdict, g.findings) == ("no_gap", ())


def test_a_stated_band_of_flicker_is_assumed() -> None:
    stated = make("bias_instability", B=2 * N, shortest=1.0, longest=1000.0)
    assert stated.in_record(0.05, 1e5) is stated
    open_band = make("bias_instability", B=2 * N).in_record(0.05, 1e5)
    assert open_band == make("bias_instability", B=2 * N, shortest=0.05, longest=1e5)


def test_a_channel_of_any_name_puts_no_script_on_a_page() -> None:
    key = 'x"><script>alert(1)</script>\\d'
    page = page_html(Page(key, (figure(bars_picture(["a"], [1.0], "p", key), key),)))
    assert page.count("<script>") == page_html(Page("a")).count("<script>")  # the one that copies text
