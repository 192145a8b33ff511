"""Noise that is louder by a clock is no noise that comes in bursts: the law of bursts is that they come by chance."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from in_part import in_part

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.samples.intermittent import IntermittentNoise
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.identify.evidence.record import Record

N, DT = 12_000, 0.01
WHITE = make("white_noise", N=np.sqrt(2.0 / 3.0 * DT))


@pytest.mark.parametrize(("ratio", "period_s"), in_part([(0.97, 1 / 3), (0.997, 10 / 3), (1.0013, 7.5)]))
def test_noise_of_an_interpolated_log_is_no_intermittent_noise(ratio: float, period_s: float) -> None:
    """`numpy.interp` to a rate that is 3, 0.3 or 0.13 % off: where two samples share a row it has half the power."""
    x = np.random.default_rng(7).standard_normal(14_000)
    y = np.interp(np.arange(N) * ratio, np.arange(x.size), x)
    gap = channel_gap("gyro_x", Record(np.arange(N) * DT, y), ChannelNoise("rad/s", (Term(WHITE),)))
    assert gap.verdict == "unknown_effect"
    (bursts,) = [f for f in gap.findings if f.effect.name == "intermittent_noise"]
    assert bursts.probability <= 0.2
    words, _, rest = bursts.objection.partition(" s, by a clock")
    assert float(words.rsplit(" ", 1)[1]) == pytest.approx(period_s, rel=0.01)
    assert "interpolated" in rest


@pytest.mark.long
def test_bursts_by_chance_have_no_period() -> None:
    """One false alarm in 10,000 records: none is expected in 300, of bursts of all kinds."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        n = int(rng.choice([2000, 8000, 30_000]))
        bursts = IntermittentNoise(
            ratio=np.exp(rng.uniform(0.05, 3.0)),
            share=rng.uniform(0.02, 0.8),
            lasting=np.exp(rng.uniform(np.log(0.03), np.log(n * DT / 20.0))),
        )
        y = bursts.apply_to(rng.standard_normal(n), np.arange(n) * DT, rng)
        assert IntermittentNoise.beat(SimpleNamespace(fast=y, n=n, dt=DT))[1] < 0.0  # type: ignore[arg-type]
