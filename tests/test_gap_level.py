"""Noise whose level follows a channel is named with its slope; without, nothing is.

Records are plain numpy: white noise of one per sample times the exponential of a slope times what the channel is away
from a reference. The standard deviation of a slope is that of its Fisher information, ``1 / sqrt(2 sum (s - mean
s)^2)``; slopes are held to 4.5 of them (7e-6 a check). A Bayes factor exceeds e^x by chance in at most e^-x of the
seeds. Seeds are fixed.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import catalogue, effect_named, make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, read_noise, write_noise
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.evidence import assumed, series_of
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT = 8192, 0.1
T = np.arange(N) * DT
HEAT = 300.0 + 5.0 * np.sin(T / 60.0) + T / 300.0
LOAD = 2.0 + np.cos(T / 37.0)
WHITE = make("white_noise", N=np.sqrt(DT))
SLOPES = {"noise_temperature": (HEAT, 0.03), "noise_level:load": (LOAD, -0.15)}


def record_of(name: str, seed: int) -> Record:
    z = np.random.default_rng([seed, 71]).standard_normal(N)
    s, slope = SLOPES.get(name, (HEAT, 0.0))
    return Record(T, z * np.exp(slope * (s - s.mean())), {"temperature": HEAT, "load": LOAD})


def gap_of(record: Record, *more: object) -> ChannelGap:
    effects = (WHITE, *more)
    return channel_gap("gyro_x", record, ChannelNoise("rad/s", tuple(Term(e) for e in effects)))  # type: ignore[arg-type]


@pytest.mark.long
@pytest.mark.parametrize("name", in_part(SLOPES))
def test_noise_that_follows_a_channel_is_named(name: str) -> None:
    s, slope = SLOPES[name]
    gap = gap_of(record_of(name, 1))
    (found,) = gap.findings
    assert (gap.verdict, found.effect.name) == ("effects_found", name)
    deviation = 1.0 / np.sqrt(2.0 * np.sum((s - s.mean()) ** 2))
    assert abs(found.effect.slope - slope) < 4.5 * deviation  # type: ignore[attr-defined]
    lo, hi = found.ci95["slope"]
    assert hi - lo == pytest.approx(2 * 1.96 * deviation, rel=0.1)
    assert not any(t.significant for t in gap.after)


@pytest.mark.parametrize("name", SLOPES)
def test_noise_that_is_assumed_to_follow_a_channel_is_no_gap(name: str, tmp_path: Path) -> None:
    """Also after a way through a file."""
    s, slope = SLOPES[name]
    effect = effect_named(name)(slope, float(s.mean()))  # type: ignore[call-arg]
    path = tmp_path / "noise.toml"
    write_noise(NoiseModel({"gyro_x": ChannelNoise("rad/s", (Term(WHITE), Term(effect)))}), path)
    (_, read) = read_noise(path).channels["gyro_x"].effects
    assert read.name == name
    gap = gap_of(record_of(name, 2), read)
    assert (gap.verdict, gap.findings) == ("no_gap", ())


def test_a_log_without_the_channel_is_refused() -> None:
    with pytest.raises(InputError, match="noise_temperature, but the log has no channel 'temperature'"):
        gap_of(Record(T, record_of("", 1).y), make("noise_temperature", slope=0.03, reference=300.0))


def test_even_noise_follows_nothing() -> None:
    for seed in range(20):
        series = series_of(assumed(record_of("", seed), (WHITE,), {}))
        for name in ("noise_temperature", "noise_level"):
            found = [x.evidence for x in catalogue()[name].detect(series)]
            assert all(e is not None and e < 8.0 for e in found), (seed, name, found)


def test_what_is_simulated_follows_its_channel() -> None:
    """Power of eighths of the record by their temperature: a line in the logarithm, of twice the slope."""
    effect = make("noise_temperature", slope=0.05, reference=float(HEAT.min()))
    y = effect.apply_to(
        np.random.default_rng(3).standard_normal(N), T, np.random.default_rng(4), {"temperature": HEAT}
    )
    edges = np.quantile(HEAT, np.linspace(0.0, 1.0, 9))
    parts = [(a <= HEAT) & (b >= HEAT) for a, b in pairwise(edges)]
    powers, heats = ([float(np.mean(x[p])) for p in parts] for x in (y**2, HEAT))
    slope = np.polyfit(heats, np.log(powers), 1)[0]
    assert slope == pytest.approx(0.1, abs=4.5 / np.sqrt(0.5 * N) / np.std(heats))
