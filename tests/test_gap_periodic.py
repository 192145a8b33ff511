"""Proves that lines, resonances and an internal low-pass are named with their numbers.

Records are plain numpy: white noise of one per sample, a line by its sine, a resonance by the exact recursion of an
oscillator, a low-pass by its recursion. Every effect is worth over 30 nats: its name is missed in fewer than 1e-6 of the
seeds. Numbers are held to 2.5 half-widths of their 95 % intervals (1e-6 each), those of a line to 4.5 standard
deviations of the Cramér-Rao bound (7e-6 each). Seeds are fixed.
"""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from kfgen.effects import Effect, make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT = 8192, 0.1
T = np.arange(N) * DT
WHITE = make("white_noise", N=np.sqrt(DT))


def noise(seed: int, n: int = N) -> Array:
    return np.random.default_rng([seed, 17]).standard_normal(n)


def line(amplitude: float, frequency: float, phase: float) -> Array:
    return amplitude * np.sin(2 * np.pi * frequency * T + phase)


def gap_of(y: Array, *more: Effect) -> ChannelGap:
    return channel_gap("gyro_x", Record(T, y), ChannelNoise("rad/s", tuple(Term(e) for e in (WHITE, *more))))


def bound(amplitude: float) -> dict[str, float]:
    """Standard deviations of a line's numbers in unit white noise, phase at the first sample: Rife and Boorstyn, 1974."""
    snr = 0.5 * amplitude**2
    return {
        "amplitude": np.sqrt(2.0 / N),
        "frequency": np.sqrt(12.0 / (snr * N**3)) / (2 * np.pi * DT),
        "phase": np.sqrt(4.0 / (snr * N)),
    }


@pytest.mark.long
@pytest.mark.parametrize("frequency", in_part([0.7321, 0.0321, 4.2]))
def test_a_line_is_named_with_its_numbers(frequency: float) -> None:
    gap = gap_of(noise(1) + line(0.2, frequency, 1.0))
    assert [f.effect.name for f in gap.findings] == ["sinusoid"]
    assert gap.verdict == "effects_found"
    assert not any(t.significant for t in gap.after)
    (found,) = gap.findings
    sd = bound(0.2)
    for name, value in {"amplitude": 0.2, "frequency": frequency, "phase": 1.0}.items():
        assert abs(float(getattr(found.effect, name)) - value) < 4.5 * sd[name], name
    for name in ("amplitude", "frequency"):
        lo, hi = found.ci95[name]
        assert 0.5 * (hi - lo) == pytest.approx(1.96 * sd[name], rel=0.1)


@pytest.mark.long  # in every run: an assumed line beside one that is not
def test_two_lines_are_two() -> None:
    gap = gap_of(noise(2) + line(0.2, 0.7321, 1.0) + line(0.15, 1.9, -2.0))
    found = sorted((f.effect for f in gap.findings), key=lambda e: e.frequency)  # type: ignore[attr-defined]
    assert [e.name for e in found] == ["sinusoid", "sinusoid"]
    for effect, amplitude, frequency in zip(found, (0.2, 0.15), (0.7321, 1.9)):
        sd = bound(amplitude)
        assert abs(effect.amplitude - amplitude) < 4.5 * sd["amplitude"]  # type: ignore[attr-defined]
        assert abs(effect.frequency - frequency) < 4.5 * sd["frequency"]  # type: ignore[attr-defined]
    assert not any(t.significant for t in gap.after)


@pytest.mark.long
def test_an_assumed_line_is_no_gap() -> None:
    """A third of its amplitude beside it is one: what is left of it is named."""
    y = noise(3) + line(0.2, 0.7321, 1.0)
    assumed = make("sinusoid", amplitude=0.2, frequency=0.7321, phase=1.0)
    assert gap_of(y, assumed).verdict == "no_gap"
    more = gap_of(y + line(0.15, 1.3, 0.0), assumed)
    assert [f.effect.name for f in more.findings] == ["sinusoid"]
    assert len([e for e in more.updated.effects if e.name == "sinusoid"]) == 2


def resonant(frequency: float, damping: float, rms: float, seed: int) -> Array:
    """``x'' + 2 zeta w x' + w^2 x = n``, stationary covariance diag(rms^2, (w rms)^2), stepped exactly."""
    w, rng = 2 * np.pi * frequency, np.random.default_rng([seed, 23])
    Phi = expm(np.array([[0.0, 1.0], [-(w**2), -2 * damping * w]]) * DT)
    P = np.diag([rms**2, (w * rms) ** 2])
    L = np.linalg.cholesky(P - Phi @ P @ Phi.T)
    x, out = np.sqrt(P) @ rng.standard_normal(2), np.empty(N)
    for k in range(N):
        out[k] = x[0]
        x = Phi @ x + L @ rng.standard_normal(2)
    return out


@pytest.mark.long  # in every run: tests/laws/test_effects_at_rest.py
@pytest.mark.parametrize(("frequency", "damping", "rms"), [(1.0, 0.02, 0.5), (2.2, 0.1, 0.7)])
def test_a_resonance_is_named_with_its_numbers(frequency: float, damping: float, rms: float) -> None:
    gap = gap_of(noise(4) + resonant(frequency, damping, rms, 1))
    assert [f.effect.name for f in gap.findings] == ["resonance"]
    assert gap.verdict == "effects_found"
    (found,) = gap.findings
    for name, value in {"frequency": frequency, "damping": damping, "rms": rms}.items():
        lo, hi = np.log(found.ci95[name])
        assert abs(np.log(value) - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo), name
    assert gap.gap.closed > 0.8


@pytest.mark.long
def test_a_low_pass_is_named_with_its_corner() -> None:
    """One pole ``exp(-2 pi f dt)`` on all that is measured; its order is read from the fall above the corner."""
    a = np.exp(-2 * np.pi * 1.5 * DT)
    gap = gap_of(lfilter([1.0 - a], [1.0, -a], noise(5, N + 200))[200:])
    assert [f.effect.name for f in gap.findings] == ["low_pass"]
    assert gap.verdict == "effects_found"
    (found,) = gap.findings
    assert found.effect.order == 1  # type: ignore[attr-defined]
    lo, hi = np.log(found.ci95["corner"])
    assert abs(np.log(1.5) - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    assert gap.gap.closed > 0.8


def test_an_assumed_low_pass_is_no_gap() -> None:
    a = np.exp(-2 * np.pi * 1.5 * DT)
    y = lfilter([1.0 - a], [1.0, -a], noise(6, N + 200))[200:]
    gap = gap_of(y, make("low_pass", corner=1.5, order=1))
    assert (gap.verdict, gap.findings) == ("no_gap", ())
