"""Samples that are no measurements are named as what they are, and leave the rest as it was."""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from scipy.signal import lfilter

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.series import RawSamples
from kfgen.gap.rest.bad_samples import invalid_samples
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.even_record import regular
from kfgen.log.log import Channel, Log

DT, N = 0.01, 12_000
T = np.arange(N) * DT
WHITE = make("white_noise", N=0.1 * np.sqrt(DT))


def gap_of(y: np.ndarray) -> tuple[ChannelGap, list[str]]:
    record, stamps, said = regular(Log(T, {"gyro_x": Channel.of(y, "rad/s")}), "gyro_x", (WHITE,))
    return channel_gap("gyro_x", record, ChannelNoise("rad/s", (Term(WHITE),)), stamps), said


def noise(seed: int) -> np.ndarray:
    return 0.8 + 0.1 * np.random.default_rng([seed, 29]).standard_normal(N)


@pytest.mark.parametrize("count", in_part([10, 50, 600]))
@pytest.mark.parametrize("value", in_part([None, 0.0]))
def test_a_stretch_that_stands_still_is_named(count: int, value: float | None) -> None:
    """At its last value, or at zero, eight standard deviations off: ten equal samples have a chance of 1e-30."""
    y = noise(count)
    y[5000 : 5000 + count] = y[5000] if value is None else value
    gap, said = gap_of(y)
    assert [f.effect.name for f in gap.findings] == ["stuck"]
    assert (gap.findings[0].effect.time, gap.findings[0].effect.lasting) == pytest.approx(
        (50.0, (count - 1) * DT)
    )  # type: ignore[attr-defined]
    assert gap.verdict == "effects_found"
    assert "between 50 and" in said[0]
    assert not any(t.significant for t in gap.after)


@pytest.mark.parametrize("size", in_part([12.0, 1e3, 1e6]))
def test_one_wild_sample_is_an_outlier(size: float) -> None:
    y = noise(int(size))
    y[7000] += 0.1 * size
    gap, _ = gap_of(y)
    assert [f.effect.name for f in gap.findings] == ["outliers"]
    assert gap.verdict == "effects_found"
    (white,) = (t.effect for t in gap.updated.terms if t.effect.name == "white_noise")
    assert pytest.approx(WHITE.N, rel=0.03) == white.N  # type: ignore[attr-defined]


def test_knocks_on_the_bench_are_left_out_with_their_times() -> None:
    """Two of 1.2 s, as `identify` knows them. Before: bursts of noise, certain."""
    y = noise(3)
    k = np.arange(120)
    for at in (4000, 9000):
        y[at : at + 120] += 3.0 * np.exp(-k / 40.0) * np.sin(1.3 * k)
    gap, said = gap_of(y)
    assert (gap.verdict, gap.findings) == ("no_gap", ())
    (words,) = [w for w in said if "shocks are left out" in w]
    assert words.startswith("gyro_x")
    times = [float(w.split()[0]) for w in words.split("at t = ")[1:]]
    assert times == pytest.approx([40.0, 90.0], abs=0.5)


def test_values_on_an_adc_grid_are_no_stretch() -> None:
    """Eight bits: a third of the samples equals the one before."""
    gap, said = gap_of(np.round(noise(1) / 0.08) * 0.08)
    assert not said
    assert "stuck" not in [f.effect.name for f in gap.findings]


def test_a_value_that_a_sensor_often_has_is_no_stretch() -> None:
    """Slow noise that is zero within 0.3 standard deviations: zeros come in rows, of which seven were stuck before.

    A channel that is stuck for 60 samples at another value is so once.
    """
    rng = np.random.default_rng(31)
    x = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], rng.standard_normal(N))
    y = np.where(np.abs(x) < 0.3, 0.0, x)
    assert not invalid_samples(RawSamples(T, y, 1.0))[0].any()
    y = y.copy()
    y[5000:5060] = 1.234
    invalid, (found,) = invalid_samples(RawSamples(T, y, 1.0))
    assert found.effect.name == "stuck"
    assert np.flatnonzero(invalid).tolist() == list(range(5000, 5060))


def test_a_model_whose_white_noise_is_hidden_is_compared() -> None:
    """`identify` writes N = 4e-10 where a Gauss-Markov bias hides it; it was refused as a log of another sensor."""
    rng = np.random.default_rng(32)
    a = np.exp(-DT / 0.15)
    x = 0.4 * lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], rng.standard_normal(N))
    hidden = (make("white_noise", N=4e-10), make("gauss_markov", sigma=0.4, tau=0.15))
    _, _, said = regular(Log(T, {"gyro_x": Channel.of(x, "rad/s")}), "gyro_x", hidden)
    assert said == []
    with pytest.raises(InputError, match="times what the model says"):
        regular(Log(T, {"gyro_x": Channel.of(1e8 * x, "rad/s")}), "gyro_x", hidden)


def test_noise_that_leans_is_unknown() -> None:
    """A gamma law of skewness 1/2, at its own level: no effect of the catalogue has one."""
    rng = np.random.default_rng(31)
    gap, _ = gap_of(0.1 * (rng.gamma(16.0, 0.25, N) - 4.0))
    assert gap.verdict == "unknown_effect"
    assert "skewness" in [t.name for t in gap.after if t.significant]


def test_a_quiet_spell_on_a_grid_wider_than_the_noise_is_no_stretch() -> None:
    """An eighth of the noise for three seconds: one value, as a sensor of 8 bits at rest has. The grid is what is said."""
    y = 0.13 + np.round((noise(5) - 0.8) * np.where(abs(T - 60.0) < 1.5, 0.125, 1.0) / 0.25) * 0.25
    gap, said = gap_of(y)
    assert said == []
    assert [f.effect.name for f in gap.findings] == ["coarse_quantisation"]
