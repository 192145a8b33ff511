"""Proves that what a thermometer drives is named after it, and nothing where the thermometer says nothing.

Records are plain numpy: white noise of one per sample, and a temperature. Each effect is worth over 30 nats: its name
is missed in fewer than 1e-6 of the seeds; coefficients are held to 2.5 half-widths of their 95 % intervals (1e-6 each).
Seeds are fixed.
"""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.effects import Effect, make
from kfgen.effects.driven.history import hysteresis, rate_of
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.drivers import drivers_of
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.even_record import regular
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.smoothed import smoothed
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

N, DT = 8192, 0.1
T = np.arange(N) * DT
HEAT = 300.0 + 3.0 * np.sin(T / 40.0) + 0.5 * np.cos(T / 97.0)
RATE = 3.0 / 40.0 * np.cos(T / 40.0) - 0.5 / 97.0 * np.sin(T / 97.0)
DRIVEN = {"temperature", "temperature_rate", "thermal_hysteresis"}


def assumed() -> ChannelNoise:
    return ChannelNoise("rad/s", (Term(make("white_noise", N=np.sqrt(DT))),))


def noise(seed: int) -> Array:
    return np.random.default_rng([seed, 41]).standard_normal(N)


def names(gap: ChannelGap) -> list[str]:
    return [f.effect.name for f in gap.findings]


def stayed(K: Array, width: float) -> Array:
    """A needle that is pushed by the edges of a slot, sample by sample."""
    out, h = [], K[0]
    for x in K:
        if x - h > width:
            h = x - width
        elif h - x > width:
            h = x + width
        out.append(h)
    return np.array(out)


SPAN = float(np.quantile(HEAT, 0.995) - np.quantile(HEAT, 0.005))
CASES: dict[str, tuple[Array, float]] = {
    "temperature": (0.15 * (HEAT - 298.15), 0.15),
    "temperature_rate": (4.0 * RATE, 4.0),
    "thermal_hysteresis": (0.25 * stayed(HEAT, 0.2 * SPAN), 0.25),
}


@pytest.mark.long
@pytest.mark.parametrize("name", in_part(CASES))
def test_an_effect_of_the_temperature_is_named_with_its_coefficient(name: str) -> None:
    """Its proof is the third of the record where it is warmest, which the coefficient did not see."""
    part, coefficient = CASES[name]
    gap = channel_gap("gyro_x", Record(T, noise(1) + part, {"temperature": HEAT}), assumed())
    assert names(gap) == [name]
    assert gap.verdict == "effects_found"
    assert not any(t.significant for t in gap.after)
    (found,) = gap.findings
    lo, hi = found.ci95["coefficient"]
    assert abs(coefficient - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    assert gap.gap.held_out == "the third of the record where temperature is highest"
    assert gap.gap.closed > 0.8
    if name == "thermal_hysteresis":  # looked for on a grid of a twentieth of the range
        assert found.effect.width == pytest.approx(0.2 * SPAN, abs=0.026 * SPAN)  # type: ignore[attr-defined]


def test_a_hysteresis_by_hand() -> None:
    T_ = np.array([0.0, 1.0, 2.0, 1.5, 0.0, -1.0, 0.2, 0.2])
    np.testing.assert_allclose(hysteresis(T_, 0.5), [0.0, 0.5, 1.5, 1.5, 0.5, -0.5, -0.3, -0.3], atol=1e-15)
    np.testing.assert_array_equal(hysteresis(T_, 0.0), T_)
    np.testing.assert_array_equal(hysteresis(T_, 5.0), 0.0)
    np.testing.assert_allclose(hysteresis(HEAT, 0.7), stayed(HEAT, 0.7), atol=1e-12)


@pytest.mark.parametrize("noisy", [0.0, 0.02])
def test_the_rate_of_a_thermometer(noisy: float) -> None:
    """To a tenth of its size, which is what the smoothing promises, and half as much again at the ends."""
    K = HEAT + noisy * noise(2)
    error = rate_of(T, K) - RATE
    assert np.std(error) < (0.15 if noisy else 0.01) * np.std(RATE)


def test_a_noisy_thermometer_is_smoothed_and_no_further() -> None:
    """White noise of 0.1 K is reduced at least threefold; without noise nothing changes by 1e-3 K."""
    clean = smoothed(HEAT)
    assert np.abs(clean - HEAT).max() < 1e-3
    error = smoothed(HEAT + 0.1 * noise(3)) - HEAT
    assert np.std(error) < 0.1 / 3.0


def log_of(y: Array, temperature: Array) -> Log:
    return Log(T, {"gyro_x": Channel.of(y, "rad/s"), "temperature": Channel.of(temperature, "K")})


@pytest.mark.long
def test_a_noisy_thermometer_names_the_same_effect() -> None:
    """With a tenth of a kelvin of its own, and samples that are missing."""
    K = HEAT + 0.1 * noise(4)
    K[::7] = np.nan
    log = log_of(noise(1) + CASES["temperature"][0], K)
    drive, said = drivers_of(log)
    record, _, words = regular(log, "gyro_x", drive=drive)
    assert [*said, *words] == []
    gap = channel_gap("gyro_x", record, assumed())
    assert names(gap) == ["temperature"]
    lo, hi = gap.findings[0].ci95["coefficient"]
    assert abs(0.15 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)


@pytest.mark.parametrize(
    ("temperature", "words"),
    in_part([(np.full(N, 300.0), "never changes"), (np.full(N, np.nan), "holds no number")]),
    ids=["constant", "nan"],
)
def test_a_thermometer_without_numbers_is_said_and_not_blamed(temperature: Array, words: str) -> None:
    log = log_of(noise(1) + CASES["temperature"][0], temperature)
    drive, said = drivers_of(log)
    assert "temperature" not in drive
    assert [words in s and "temperature" in s for s in said] == [True]
    log = log_of(noise(5) + 2e-3 * T, temperature)
    drive, said = drivers_of(log)
    assert any(words in s for s in said)
    record, _, _ = regular(log, "gyro_x", drive=drive)
    gap = channel_gap("gyro_x", record, assumed())
    assert names(gap) == ["rate_ramp"]
    assert not DRIVEN & {n for f in gap.findings for n, _, _ in f.alternatives}
    assert not DRIVEN & {m.effect.name for m in gap.limits}


def test_an_assumed_effect_without_its_channel_is_refused() -> None:
    """What is assumed cannot be compared; it is not silently left out."""
    from kfgen.core.errors import InputError

    wrong: list[Effect] = [make("temperature", coefficient=0.1), make("temperature_rate", coefficient=4.0)]
    for effect in wrong:
        noise_ = ChannelNoise("rad/s", (*assumed().terms, Term(effect)))
        with pytest.raises(InputError, match="no channel 'temperature'"):
            channel_gap("gyro_x", Record(T, noise(6)), noise_)


@pytest.mark.parametrize("name", CASES)
def test_an_assumed_effect_of_the_temperature_is_no_gap(name: str) -> None:
    part, coefficient = CASES[name]
    more = {"width": 0.2 * SPAN} if name == "thermal_hysteresis" else {}
    effect = make(name, coefficient=coefficient, **more)
    noise_ = ChannelNoise("rad/s", (*assumed().terms, Term(effect)))
    gap = channel_gap("gyro_x", Record(T, noise(7) + part, {"temperature": HEAT}), noise_)
    assert (gap.verdict, gap.findings) == ("no_gap", ())
