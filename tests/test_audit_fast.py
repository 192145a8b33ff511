"""Proves the audit of what is faster than its samples: no division by nothing, and samples that count as what they are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import kfgen as kf
from kfgen.effects import Effect, make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.report.audit import audit_answer

N, RMS = 1e-4, 1e-3


def shaken(frequency: float, damping: float) -> NoiseModel:
    """A gyro axis with a resonance [Hz]."""
    effects: tuple[Effect, ...] = (
        make("white_noise", N=N),
        make("resonance", frequency=frequency, damping=damping, rms=RMS),
    )
    return NoiseModel({"gyro_x": ChannelNoise("rad/s", tuple(map(Term, effects)))})


@pytest.mark.parametrize(("frequency", "damping"), [(2000.0, 0.02), (20_000.0, 0.5)])
def test_a_fast_resonance_is_audited_without_a_warning(frequency: float, damping: float) -> None:
    """After a sample that meets it anew, a variance is P R / (P + R); warnings of numpy are errors here."""
    found = kf.audit("gyro-static", noise=shaken(frequency, damping))
    run = found.first.degree
    assert run is not None
    R, P = N**2 * 100.0, RMS**2
    at = [s.name for s in found.first.model.states].index("gyro_x_resonance")
    assert run.sigma[-1, at] == pytest.approx(np.sqrt(P * R / (P + R)), rel=0.01)
    text, data = audit_answer(found).text, json.dumps(found.to_dict(), allow_nan=False)
    assert "condition inf" not in text
    assert "gyro_x_resonance" in next(line for line in text.splitlines() if "weakest direction" in line)
    assert "Infinity" not in data


def test_what_is_gone_before_the_first_sample_is_said() -> None:
    found = kf.audit("gyro-static", noise=shaken(20_000.0, 0.5))
    assert found.first.degree is not None
    assert found.first.degree.condition == np.inf
    assert found.to_dict()["manoeuvres"]["static"]["condition"]["scaled"] is None
    assert "the samples tell nothing of how they started" in audit_answer(found).text


def test_fewer_samples_than_states() -> None:
    found = kf.audit("gyro-static", noise=shaken(2000.0, 0.02), duration=0.001)
    assert found.first.degree is not None
    assert found.first.degree.singular.size == 3


def test_a_stiff_plant(tmp_path: Path) -> None:
    path = tmp_path / "stiff.toml"
    path.write_text(
        'format = "kfgen-model-1"\nname = "stiff"\n[states]\ntheta = "rad"\nomega = "rad/s"\n'
        '[inputs]\nu = "rad/s^2"\n[dynamics]\ntheta = "omega"\nomega = "-1.6e8*theta - 500.0*omega + u"\n'
        '[measurements.angle]\nunit = "rad"\nexpression = "theta"\n'
        'effects = [ { effect = "white_noise", N = "1e-4 rad/sqrt(Hz)" } ]\n',
        encoding="utf-8",
    )
    text = audit_answer(kf.audit(path)).text
    assert "condition inf" not in text
    assert "rank 2 of 2" in text
