"""Proves that every effect of the catalogue obeys the laws that its declaration implies.

The parametrisation is the catalogue itself: a new effect is tested by being there. Its Allan variance must be
the integral of its own spectrum, its sampled spectrum must alias, sum to its variance and describe its simulation,
and its words and file entries must carry every parameter. Where docs/noise.md states a closed form it is compared
besides. Simulations are held to normal limits of 4.5 standard deviations of the statistic (7e-6 of the seeds
for each of about 30 checks), with the standard deviation computed from the spectrum; seeds are fixed.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import mpmath as mp
import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import derived_unit, parse_unit, to_si
from kfgen.effects import (
    Effect,
    LinearSystem,
    Look,
    Parameter,
    State,
    catalogue,
    effect_named,
    make,
    sampled_spectrum,
)
from kfgen.effects.effect import AddsNothingAtRest, LinearProcess, parameter
from kfgen.effects.linear_system import initial_covariance
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, parse_noise, read_noise, write_noise
from kfgen.effects.process.sensor_response import GAINS, SensorResponse
from kfgen.emit.routines import Program
from kfgen.emit.targets import c
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.evidence import additions, assumed, candidates, series_of
from kfgen.identify.evidence.record import Record
from kfgen.identify.identify import identify
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.simulate.simulate import simulate

Array = NDArray[np.float64]

LIMIT = 4.5
KINDS = {
    "size": 0.7,
    "time": 3.0,
    "signed": -0.4,
    "setting": 2.0,
    "frequency": 0.9,
    "corner": 0.9,
    "ratio": 0.3,
    "slope": 0.9,
    "width": 0.5,
    "place": 1.7,
    "solved": 0.6,
}
POSITIVE = ("size", "time", "frequency", "ratio", "slope", "width")


def example(cls: type[Effect]) -> Effect:
    """An effect with plain numbers, its settings as declared where they have a default."""
    if cls is SensorResponse:
        return SensorResponse.through(
            0.5, np.linspace(1.0, 5.0, GAINS).tolist(), np.geomspace(0.9, 0.2, GAINS).tolist()
        )
    settings = {p.name for p in cls.parameters() if p.kind == "setting" and hasattr(cls, p.name)}
    return cls(**{p.name: KINDS[p.kind] for p in cls.parameters() if p.name not in settings})


NAMES = list(catalogue())
EXAMPLES = {name: example(cls) for name, cls in catalogue().items()}
SAMPLED = ["sample_noise"]
"""White noise of samples, whatever their rate: no process in time."""
SILENT = [n for n, e in EXAMPLES.items() if e.form() == LinearSystem() and n not in SAMPLED]
"""Effects of an empty form: they filter or alter samples, or act in a plant, in motion, between channels."""
RANDOM = [n for n, e in EXAMPLES.items() if not e.form().deterministic and n not in (*SILENT, *SAMPLED)]
DETERMINISTIC = [n for n in NAMES if n not in (*RANDOM, *SILENT, *SAMPLED)]
ONE_OFF = ["bias_step"]
"""What happens at a time has no Allan variance: it depends on when one looks."""
TWO_LEVELS = ["random_telegraph"]
"""Random and not normal: their second moments have the law, the spread of these is another."""


def test_no_two_effects_have_one_name() -> None:
    catalogue()
    queue, names = list(Effect.__subclasses__()), []
    while queue:
        cls = queue.pop()
        queue += cls.__subclasses__()
        own = cls.__dict__.get("name", "")
        names += [own] if own and ":" not in own and cls.__module__.startswith("kfgen.") else []
    assert sorted(names) == sorted(set(names))


def test_the_catalogue_has_the_effects_of_the_interface() -> None:
    wanted = {"white_noise", "quantisation", "bias_instability", "gauss_markov", "rate_random_walk"}
    assert wanted | {"rate_ramp", "temperature", "bias"} <= set(NAMES)
    assert set(RANDOM) >= wanted
    assert set(DETERMINISTIC) >= {"bias", "rate_ramp", "temperature"}


def test_an_unknown_effect_is_refused() -> None:
    with pytest.raises(InputError, match="no effect 'pink_elephant'"):
        effect_named("pink_elephant")


# Closed forms of docs/noise.md, with the example's parameters.


def gauss_markov_avar(sigma: float, tc: float, tau: float) -> float:
    with mp.workdps(60):
        q2, T, t = 2 * mp.mpf(sigma) ** 2 / mp.mpf(tc), mp.mpf(tc), mp.mpf(tau)
        x = t / T
        return float(q2 * T**2 / t * (1 - T / (2 * t) * (3 - 4 * mp.exp(-x) + mp.exp(-2 * x))))


AVAR = {
    "white_noise": lambda e, tau: e.N**2 / tau,
    "quantisation": lambda e, tau: 3 * e.Q**2 / tau**2,
    "gauss_markov": lambda e, tau: gauss_markov_avar(e.sigma, e.tau, tau),
    "rate_random_walk": lambda e, tau: e.K**2 * tau / 3,
    "rate_ramp": lambda e, tau: e.R**2 * tau**2 / 2,
    "bias": lambda e, tau: 0.0,
}


@pytest.mark.parametrize("name", AVAR)
def test_allan_variance_has_its_closed_form(name: str) -> None:
    effect = EXAMPLES[name]
    tau = np.geomspace(1e-4, 1e6, 41)
    expected = [AVAR[name](effect, float(t)) for t in tau]
    np.testing.assert_allclose(effect.allan_variance(tau), expected, rtol=1e-10, atol=1e-300)


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1.0, 1.892618, 1e3, 1e6])
def test_gauss_markov_at_one_time_alone(ratio: float) -> None:
    """Far from its correlation time as well, where the closed form cancels in float64."""
    effect = make("gauss_markov", sigma=0.02, tau=100.0)
    got = effect.allan_variance(np.array([100.0 * ratio]))[0]
    assert got == pytest.approx(gauss_markov_avar(0.02, 100.0, 100.0 * ratio), rel=1e-11)


def test_gauss_markov_peak() -> None:
    """ADEV = 0.617364 sigma at tau = 1.892618 Tc, and no higher beside it."""
    effect = make("gauss_markov", sigma=2.0, tau=50.0)
    adev = np.sqrt(effect.allan_variance(50.0 * 1.892618 * np.array([0.98, 1.0, 1.02])))
    assert adev[1] == pytest.approx(2.0 * 0.617364, rel=1e-6)
    assert adev[1] > max(adev[0], adev[2])


def test_flicker_is_flat_inside_its_band() -> None:
    """AVAR = (2 ln 2 / pi) B^2 and density B^2 / (2 pi f), within 1 %."""
    effect = make("bias_instability", B=0.3, shortest=1e-3, longest=1e6)
    tau = np.geomspace(1.0, 1e3, 31)
    np.testing.assert_allclose(effect.allan_variance(tau), 2 * np.log(2) / np.pi * 0.09, rtol=0.01)
    f = np.geomspace(1e-3, 1.0, 31)
    np.testing.assert_allclose(effect.density(f), 0.09 / (2 * np.pi * f), rtol=0.01)


@pytest.mark.parametrize("slope", [0.3, 0.5, 0.8, 1.0, 1.2, 1.5, 1.8])
def test_noise_of_any_slope_has_it_over_all_that_a_record_shows(slope: float) -> None:
    """Density ``B^2 w^-slope`` within 2 % from the lowest ordinate of a record as long as the band to a hundredth of its rate."""
    effect = make("power_law_noise", B=0.3, slope=slope, shortest=0.01, longest=100.0)
    w = np.geomspace(np.pi / 100.0, 0.02 * np.pi / 0.01, 31)
    np.testing.assert_allclose(effect.density(w / (2.0 * np.pi)), 0.09 * w**-slope, rtol=0.02)


PSD = {
    "white_noise": lambda e, f: np.full_like(f, e.N**2),
    "gauss_markov": lambda e, f: 2 * e.sigma**2 / e.tau / ((2 * np.pi * f) ** 2 + 1 / e.tau**2),
    "rate_random_walk": lambda e, f: e.K**2 / (2 * np.pi * f) ** 2,
}


@pytest.mark.parametrize("name", PSD)
def test_density_has_its_closed_form(name: str) -> None:
    f = np.geomspace(1e-6, 1e4, 51)
    np.testing.assert_allclose(EXAMPLES[name].density(f), PSD[name](EXAMPLES[name], f), rtol=1e-12)


def test_quantisation_has_its_closed_form_where_it_is_sampled() -> None:
    """(2 pi f)^2 Q^2 T at small f; and 4 sin^2(pi f T) Q^2 / T at any."""
    effect, T = make("quantisation", Q=0.2), 0.01
    f = np.array([1e-3, 1.0, 50.0])
    S = T * effect.sampled_density(2 * np.pi * f * T, T)
    np.testing.assert_allclose(S, 4 * np.sin(np.pi * f * T) ** 2 * 0.04 / T, rtol=1e-9)
    assert S[0] == pytest.approx((2 * np.pi * 1e-3) ** 2 * 0.04 * T, rel=1e-6)


# Laws of all effects.


@pytest.mark.parametrize("name", NAMES)
def test_density_is_not_negative(name: str) -> None:
    f = np.geomspace(1e-7, 1e4, 101)
    S = EXAMPLES[name].density(f)
    assert S.shape == f.shape
    assert (S >= 0.0).all()
    D = EXAMPLES[name].sampled_density(np.linspace(1e-4, np.pi, 101), 0.1)
    assert (D >= 0.0).all()
    assert (D > 0.0).any() == (name in (*RANDOM, *SAMPLED))


@pytest.mark.parametrize("name", SILENT)
def test_an_effect_of_an_empty_form_adds_nothing_to_a_channel_at_rest(name: str) -> None:
    """Of its own: a filter, a fault, an effect of motion or of a plant acts on what others add."""
    cls, effect, t = catalogue()[name], EXAMPLES[name], np.arange(50) * 0.1
    assert issubclass(cls, AddsNothingAtRest)
    np.testing.assert_array_equal(effect.allan_variance(np.array([1.0, 9.0])), 0.0)
    np.testing.assert_array_equal(effect.simulate(t, np.random.default_rng(0), None), 0.0)
    np.testing.assert_array_equal(effect.mean(t), 0.0)


FILTERS = [
    *(replace(EXAMPLES["low_pass"], order=order) for order in (1, 2)),
    *(e for n, e in EXAMPLES.items() if e.is_filter and n != "low_pass"),
]


@pytest.mark.parametrize("effect", FILTERS, ids=lambda e: e.name)
def test_a_filter_does_to_samples_what_it_says_of_their_spectrum(effect: Effect) -> None:
    """The transform of its response to an impulse, squared; and a constant passes."""
    dt, n = 0.1, 4096
    t, rng = np.arange(n) * dt, np.random.default_rng(0)
    impulse = np.zeros(n)
    impulse[1 if effect.name == "low_pass" else n // 2] = (
        1.0  # the first sample sets the state of a causal one
    )
    power = np.abs(np.fft.rfft(effect.apply_to(impulse, t, rng))) ** 2
    omega = np.linspace(0.0, np.pi, power.size)
    factor = effect.response(omega, dt)
    assert factor is not None
    rtol = 1e-6 if effect.name == "low_pass" else 1e-3  # a response whose slope jumps goes on for ever
    np.testing.assert_allclose(factor, power, rtol=rtol, atol=1e-9)
    assert factor[0] == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(effect.apply_to(np.full(n, 3.0), t, rng), 3.0, rtol=1e-12)
    white = make("white_noise", N=2.0)
    np.testing.assert_allclose(
        sampled_spectrum([white, effect], omega[1:], dt), factor[1:] * 4.0 / dt, rtol=1e-12
    )
    np.testing.assert_allclose(sampled_spectrum([white], omega[1:], dt), 4.0 / dt, rtol=1e-12)


def avar_of_density(effect: Effect, tau: float) -> float:
    """4 int_0^inf S(f) sin^4(pi f tau) / (pi f tau)^2 df, the tail by its mean of sin^4."""
    end = 400.0 * np.pi
    u = np.concatenate([np.geomspace(1e-6, 0.1, 4000), np.linspace(0.1, end, 400001)[1:]])
    S = effect.density(u / (np.pi * tau))
    body = np.trapezoid(S * np.sin(u) ** 4 / u**2, u)
    v = np.geomspace(end, 1e6 * end, 2000)
    tail = np.trapezoid(0.375 * effect.density(v / (np.pi * tau)) / v**2, v)
    return float(4.0 / (np.pi * tau) * (body + tail))


@pytest.mark.parametrize("name", in_part(RANDOM))
@pytest.mark.parametrize("tau", in_part([0.3, 30.0]))
def test_allan_variance_is_the_integral_of_the_density(name: str, tau: float) -> None:
    effect = EXAMPLES[name]
    quantised = 3.0 * float(effect.form().Z) / tau**2  # a sequence on the integral has no continuous density
    expected = avar_of_density(effect, tau) + quantised
    assert effect.allan_variance(np.array([tau]))[0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", [n for n in DETERMINISTIC if n not in ONE_OFF])
def test_allan_variance_of_what_is_not_random_is_that_of_its_mean(name: str) -> None:
    """Half the squared difference of the averages over two adjoining intervals of its own output."""
    effect, tau = EXAMPLES[name], 7.0
    t = np.linspace(0.0, 2 * tau, 20001)
    y = effect.mean(t)
    first, second = (np.trapezoid(y[part], t[part]) / tau for part in (slice(0, 10001), slice(10000, None)))
    # of a line a thousandth of its square at this tau is left, and the trapezoids err by 1e-7 of the whole
    expected = pytest.approx(0.5 * (second - first) ** 2, rel=1e-6, abs=1e-9)
    assert effect.allan_variance(np.array([tau]))[0] == expected


VARIANCE = {
    "white_noise": lambda e, dt: e.N**2 / dt,
    "quantisation": lambda e, dt: 2 * e.Q**2 / dt**2,
    "gauss_markov": lambda e, dt: e.sigma**2,
}


@pytest.mark.parametrize("name", VARIANCE)
def test_sampled_density_integrates_to_the_closed_variance(name: str) -> None:
    dt, omega = 0.05, (np.arange(1 << 16) + 0.5) * np.pi / (1 << 16)
    got = EXAMPLES[name].sampled_density(omega, dt).mean()
    assert got == pytest.approx(VARIANCE[name](EXAMPLES[name], dt), rel=1e-5)


@pytest.mark.parametrize("name", RANDOM)
def test_sampled_density_integrates_to_the_sample_variance(name: str) -> None:
    """Of the samples where they have a variance, else of their first differences."""
    effect, dt = EXAMPLES[name], 0.05
    form = effect.form()
    omega = np.geomspace(1e-11, np.pi, 100_001)  # the slowest effects are narrow lines about zero
    S = effect.sampled_density(omega, dt)
    A = np.array(form.A, float).reshape(form.order, form.order)
    if form.order and np.linalg.eigvals(A).real.max() >= 0.0:
        assert name == "rate_random_walk", "state the variance of its steps here"
        steps = np.trapezoid(4 * np.sin(omega / 2) ** 2 * S, omega) / np.pi
        assert steps == pytest.approx(effect.K**2 * dt, rel=1e-6)
        return
    C = np.array(form.C, float)
    variance = float(form.V) / dt + 2 * float(form.Z) / dt**2
    variance += float(C @ initial_covariance(form) @ C) if form.order else 0.0
    assert np.trapezoid(S, omega) / np.pi == pytest.approx(variance, rel=1e-4)


@pytest.mark.parametrize("name", RANDOM)
@pytest.mark.parametrize("block", [2, 5, 16, 250])
def test_averages_of_blocks_alias(name: str, block: int) -> None:
    """S_D(w) = 1/D sum_k |H(l_k)|^2 S_1(l_k), l_k = (w + 2 pi k)/D, H the running mean of D samples."""
    effect, dt = EXAMPLES[name], 0.05
    omega = np.array([1e-3, 0.1, 1.0, 2.0, np.pi])
    folded = np.zeros(omega.size)
    for k in range(block):
        at = (omega + 2 * np.pi * k) / block
        H2 = (np.sin(block * at / 2) / (block * np.sin(at / 2))) ** 2
        folded += H2 * effect.sampled_density(np.minimum(at, 2 * np.pi - at), dt) / block
    np.testing.assert_allclose(effect.sampled_density(omega, dt, block), folded, rtol=1e-8)


@pytest.mark.parametrize("name", RANDOM)
def test_fast_sampling_shows_the_continuous_density(name: str) -> None:
    effect = EXAMPLES[name]
    if effect.form().Z:
        assert (effect.density(np.array([1.0])) == float(effect.form().V)).all()
        return
    dt, f = 1e-4, np.array([0.01, 0.1, 1.0])
    got = dt * effect.sampled_density(2 * np.pi * f * dt, dt)
    np.testing.assert_allclose(got, effect.density(f), rtol=1e-4)


@pytest.mark.parametrize("name", [n for n in RANDOM if n not in TWO_LEVELS])
@pytest.mark.parametrize("block", [1, 8, 64])
def test_simulation_has_the_expected_allan_variance(name: str, block: int) -> None:
    """Mean square difference of block means: its mean and its variance from their spectral density."""
    effect, dt, n = EXAMPLES[name], 0.1, 1 << 16
    y = effect.simulate(np.arange(n) * dt, np.random.default_rng(20261121), None)
    d = np.diff(y.reshape(-1, block).mean(axis=1))
    omega = (np.arange(1 << 16) + 0.5) * np.pi / (1 << 16)
    D = 4 * np.sin(omega / 2) ** 2 * effect.sampled_density(omega, dt, block)
    spread = np.sqrt(2.0 * np.mean(D**2) / d.size)
    assert y.shape == (n,)
    assert abs(np.mean(d**2) - D.mean()) < LIMIT * spread
    if block == 64:  # the Allan variance of the averages of many samples is that of continuous time
        assert 0.5 * D.mean() == pytest.approx(effect.allan_variance(np.array([block * dt]))[0], rel=0.01)


def test_a_telegraph_jumps_between_two_levels_as_often_as_its_spectrum_says() -> None:
    """Jumps between samples: binomial, of chance (1 - exp(-2 dt / dwell)) / 2."""
    effect, dt, n = make("random_telegraph", size=0.7, dwell=3.0), 0.1, 1 << 16
    y = effect.simulate(np.arange(n) * dt, np.random.default_rng(20261121), None)
    assert set(np.round(y, 12)) == {-0.35, 0.35}
    p = 0.5 * (1.0 - np.exp(-2.0 * dt / 3.0))
    jumps = np.count_nonzero(np.diff(y))
    assert abs(jumps - p * (n - 1)) < LIMIT * np.sqrt(p * (1 - p) * (n - 1))
    # half the mean square of a jump is the Allan variance of single samples
    omega = (np.arange(1 << 14) + 0.5) * np.pi / (1 << 14)
    D = 4 * np.sin(omega / 2) ** 2 * effect.sampled_density(omega, dt)
    assert D.mean() == pytest.approx(0.49 * p, rel=1e-3)


@pytest.mark.parametrize("name", DETERMINISTIC)
def test_what_is_not_random_is_simulated_as_its_mean(name: str) -> None:
    effect, t = EXAMPLES[name], np.arange(50) * 0.1
    drive = {effect.driver: 290.0 + np.sin(t)} if effect.driver else None
    a = effect.simulate(t, np.random.default_rng(1), drive)
    b = effect.simulate(t, np.random.default_rng(2), drive)
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(a, effect.mean(t, drive))


@pytest.mark.parametrize("name", NAMES)
def test_without_size_there_is_no_effect(name: str) -> None:
    cls = catalogue()[name]
    sizes = {p.name for p in cls.estimated() if p.kind in ("size", "signed", "solved")} | set(cls.sizes())
    off = replace(EXAMPLES[name], **dict.fromkeys(sizes, 0.0))
    t = np.arange(100) * 0.1
    drive = {cls.driver: 290.0 + np.sin(t)} if cls.driver else None
    np.testing.assert_array_equal(off.simulate(t, np.random.default_rng(0), drive), np.zeros(t.size))
    np.testing.assert_array_equal(off.allan_variance(np.array([1.0, 9.0])), 0.0)


def test_means_of_driven_and_drifting_effects() -> None:
    t = np.arange(5) * 0.5
    T = np.array([280.0, 290.0, 298.15, 300.0, 310.0])
    temperature = make("temperature", coefficient=0.2)
    np.testing.assert_allclose(temperature.mean(t, {"temperature": T}), 0.2 * (T - 298.15), rtol=1e-12)
    np.testing.assert_allclose(make("rate_ramp", R=0.3).mean(t), 0.3 * t, rtol=1e-12)
    np.testing.assert_allclose(make("bias", value=0.3).mean(t), 0.3, rtol=1e-15)


# Words and files.


def unit_of(p: Parameter, channel: str) -> str:
    return derived_unit(p.unit, channel)


UNSAID = {"sinusoid": ("phase",)}
"""The phase of a line says nothing without the time of the first sample."""


@pytest.mark.parametrize("name", NAMES)
def test_rows_and_sentences_say_every_parameter_with_its_unit(name: str) -> None:
    effect = EXAMPLES[name]
    for unit in ("deg/s", "mg", "uT", "g/16384"):
        row, words = effect.row(unit), effect.sentence("gyro_q", unit)
        assert list(row) == [p.name for p in effect.parameters()]
        assert words.startswith("gyro_q ")
        assert "{" not in words
        for p in effect.parameters():
            value, text = row[p.name]
            si = parse_unit(unit_of(p, parse_unit(unit).si))
            assert parse_unit(text).same_dimension(si)
            assert to_si(value, text) == pytest.approx(float(getattr(effect, p.name)), rel=1e-12)
            if p.kind != "setting" and p.name not in UNSAID.get(name, ()):
                assert f"{value:.3g} {text}".strip() in words


@pytest.mark.parametrize("name", NAMES)
def test_a_written_entry_is_read_back(name: str, tmp_path: Path) -> None:
    effect = EXAMPLES[name]
    sizes = {
        p.name: (0.5 * abs(v), 2.0 * abs(v)) for p in effect.estimated() if (v := getattr(effect, p.name))
    }
    path = tmp_path / "noise.toml"
    for unit in ("deg/s", "mg", "g/16384", "degC"):
        write_noise(NoiseModel({"ch": ChannelNoise(unit, (Term(effect, sizes),))}), path)
        channel = read_noise(path).channel("ch")
        (back,) = channel.terms
        assert type(back.effect) is type(effect)
        assert channel.unit == unit
        for p in effect.parameters():
            assert getattr(back.effect, p.name) == pytest.approx(getattr(effect, p.name), rel=1e-8)
        assert {k: pytest.approx(v, rel=1e-8) for k, v in back.ci95.items()} == sizes


@pytest.mark.parametrize("name", NAMES)
def test_entries_that_are_wrong_are_refused(name: str) -> None:
    cls = catalogue()[name]
    good = {p.name: KINDS[p.kind] * (k + 1) for k, p in enumerate(cls.parameters())}
    assert cls.read({"effect": name, **good}, "rad/s", "file")
    with pytest.raises(InputError, match="no parameter 'zzz'"):
        cls.read({**good, "zzz": 1.0}, "rad/s", "file")
    for p in cls.parameters():
        with pytest.raises(InputError, match=r"dimension|finite"):
            cls.read({**good, p.name: "1 kg"}, "rad/s", "file")
        if p.kind in POSITIVE:
            with pytest.raises(InputError, match="not positive"):
                cls.read({**good, p.name: -1.0}, "rad/s", "file")


@pytest.mark.parametrize("name", NAMES)
def test_starts_are_guesses_that_a_fit_can_use(name: str) -> None:
    tau = np.geomspace(0.1, 100.0, 20)
    look = Look(tau, 0.1 / np.sqrt(tau), 0.1, 300.0, {"temperature": 300.0})
    cls = catalogue()[name]
    for start in cls.starts(look):
        assert type(start) is cls
        for p in cls.estimated():
            value = float(getattr(start, p.name))
            assert np.isfinite(value)
            assert value > 0.0 or p.kind == "signed"
    if cls.driver:
        assert not cls.starts(replace(look, drive={}))


# A new effect is one class and nothing else.


@pytest.fixture
def hum() -> Iterator[type[Effect]]:
    """An effect that kfgen has never heard of: a damped resonance at 1 Hz, driven by white noise."""

    @dataclass(frozen=True)
    class Hum(LinearProcess):
        rms: Any = parameter("U")
        decay: Any = parameter("s", "time", 4.0)

        name: ClassVar[str] = "test_hum"
        title: ClassVar[str] = "hum of the test bench"
        sentence_template: ClassVar[str] = "hums by {rms}, decaying in {decay}"

        @classmethod
        def starts(cls, look: Look) -> list[Any]:
            return [cls(float(look.deviation[0]))]

        def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
            w = 2 * 3.141592653589793
            q = 2 * self.rms**2 / self.decay
            return LinearSystem(
                A=((-1 / self.decay, w), (-w, -1 / self.decay)),
                W=((q, 0), (0, q)),
                C=(1, 0),
                x0=(0, 0),
                states=(State("hum_in"), State("hum_out")),
            )

    yield Hum
    Hum.name = ""  # out of the catalogue at once, whoever still holds the class
    del Hum
    gc.collect()


@pytest.fixture
def swell() -> Iterator[type[Effect]]:
    """Another: white noise through two equal lags, of stationary standard deviation `rms`."""

    @dataclass(frozen=True)
    class Swell(LinearProcess):
        rms: Any = parameter("U")
        lag: Any = parameter("s", "time")

        name: ClassVar[str] = "test_swell"
        title: ClassVar[str] = "swell of the test bench"
        sentence_template: ClassVar[str] = "swells by {rms} with a lag of {lag}"

        def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
            return LinearSystem(
                A=((-1 / self.lag, 1), (0, -1 / self.lag)),
                W=((0, 0), (0, 4 * self.rms**2 / self.lag**3)),
                C=(1, 0),
                x0=(0, 0),
                states=(State("swell"), State("swell_rate", "U/s")),
            )

    yield Swell
    Swell.name = ""
    del Swell
    gc.collect()


def hum_record(n: int = 8192, dt: float = 0.1) -> Record:
    """White noise of N = 1 and a 1 Hz resonance of rms 2, 4 s, stepped in plain numpy."""
    rng = np.random.default_rng(5)
    pole = np.exp((-1 / 4.0 + 2j * np.pi) * dt)
    w = (rng.standard_normal(n) + 1j * rng.standard_normal(n)) * 2.0 * np.sqrt(1 - abs(pole) ** 2)
    z = np.zeros(n, complex)
    for k in range(1, n):
        z[k] = pole * z[k - 1] + w[k]
    return Record(np.arange(n) * dt, z.real + rng.standard_normal(n) / np.sqrt(dt))


def test_a_new_effect_has_laws(hum: Any) -> None:
    """Catalogue, Allan variance, spectrum and simulation."""
    assert catalogue()["test_hum"] is hum
    effect = make("test_hum", rms=2.0)
    f = np.array([0.1, 0.9, 1.0, 1.1])
    b, g = 2 * np.pi * f, 1 / 4.0  # variance 4, correlation 4 exp(-|t|/4) cos(2 pi t)
    lorentz = [4.0 * g / (g**2 + (b - s * 2 * np.pi) ** 2) for s in (-1, 1)]
    np.testing.assert_allclose(effect.density(f), sum(lorentz), rtol=1e-10)
    assert effect.allan_variance(np.array([0.3]))[0] == pytest.approx(avar_of_density(effect, 0.3), rel=1e-3)
    y = effect.simulate(np.arange(20000) * 0.1, np.random.default_rng(0), None)
    # Bartlett: var(mean y^2) = 2/n sum_k rho_k^2 sigma^4, sum_k rho_k^2 about tau/(2 dt) = 20
    assert abs(np.mean(y**2) - 4.0) < LIMIT * 4.0 * np.sqrt(2 * 20 / 20000)


def test_a_new_effect_goes_through_files(hum: Any, tmp_path: Path) -> None:
    effect = hum(rms=0.03, decay=7.0)
    write_noise(NoiseModel({"gyro_x": ChannelNoise("deg/s", (Term(effect),))}), tmp_path / "n.toml")
    (back,) = read_noise(tmp_path / "n.toml").channel("gyro_x").effects
    assert type(back) is hum
    assert (back.rms, back.decay) == (pytest.approx(0.03, rel=1e-8), pytest.approx(7.0, rel=1e-8))
    assert effect.sentence("gyro_x", "rad/s") == "gyro_x hums by 0.03 rad/s, decaying in 7 s"


def header_of(effect: Effect) -> tuple[str, list[str]]:
    """The emitted C header of the model gyro-static with one more effect, and its states' names."""
    more = build("gyro-static").augment("gyro_x", effect)
    text = c.files(Program(DiscreteModel(more, max_step=0.02)))["gyro_static.h"]
    return text, [s.name for s in more.states]


def test_a_new_effect_becomes_states_of_a_filter(swell: Any) -> None:
    model = build("gyro-static")
    more = model.augment("gyro_x", swell(rms=0.03, lag=7.0))
    assert [s.name for s in more.states][-2:] == ["gyro_x_swell", "gyro_x_swell_rate"]
    assert len(more.states) == len(model.states) + 2
    assert [s.unit for s in more.states][-1] == "rad/s/s"
    # stationary: rms, and rms / lag of the rate (two equal lags: var x = q lag^3 / 4, var x2 = q lag / 2)
    np.testing.assert_allclose(
        [s.prior for s in more.states][-2:], [0.03, 0.03 * np.sqrt(2) / 7.0], rtol=1e-9
    )
    assert list(more.H(more.sensors[0]))[-2:] == [1, 0]
    discrete = DiscreteModel(more)
    step = np.array(discrete.Phi[-2:, -2:].subs(dict.fromkeys(discrete.Phi.free_symbols, 0.1)), float)
    e = np.exp(-0.1 / 7.0)
    np.testing.assert_allclose(step, [[e, 0.1 * e], [0.0, e]], rtol=1e-7)


def test_a_new_effect_becomes_code(swell: Any) -> None:
    text, names = header_of(swell(rms=0.03, lag=7.0))
    assert all(name in text for name in names)
    assert swell.title in text
    assert "swell" not in c.files(Program(DiscreteModel(build("gyro-static"))))["gyro_static.h"]


def test_a_new_effect_whose_states_drive_one_another_becomes_code(hum: Any) -> None:
    """Any resonance is such an effect."""
    text, names = header_of(hum(rms=0.03, decay=7.0))
    assert all(name in text for name in names)


@pytest.mark.long
def test_a_new_effect_is_identified_and_named_by_gap(hum: Any) -> None:
    record = hum_record()
    found = identify(record, ["white_noise", "test_hum"])
    lo, hi = found.intervals[1, "rms"]
    assert lo < 2.0 < hi < 3.0
    base = assumed(record, (make("white_noise", N=1.0),), {})
    assert any(type(starts[0].effect) is hum for starts in additions(base, series_of(base)))
    assert candidates(base)[0].name == "test_hum"
    gap = channel_gap("gyro_x", record, ChannelNoise("rad/s", (Term(make("white_noise", N=1.0)),)))
    assert [f.effect.name for f in gap.findings] == ["test_hum"]
    assert gap.verdict == "effects_found"


def test_the_new_effect_is_gone() -> None:
    assert not {"test_hum", "test_swell"} & set(catalogue())
    with pytest.raises(InputError, match="no effect"):
        parse_noise('format = "kfgen-noise-1"\n[a]\nunit = "rad"\neffects = [{effect = "test_hum"}]', "x")


# What acts on samples is simulated too.


def test_a_simulated_channel_is_altered_and_filtered_as_its_model_says() -> None:
    """The noise's spectrum through a low-pass; a change of its level after a time; a share of outliers.

    Variances of m ordinates or samples within 4.5 sqrt(2 / m) of theirs (for outliers: of their fourth moment).
    """
    n, dt = 1 << 15, 0.01

    def log_of(*effects: Effect) -> NDArray[np.float64]:
        terms = tuple(Term(e) for e in (make("white_noise", N=0.1), *effects))
        model = build("gyro-static", NoiseModel({"gyro_x": ChannelNoise("rad/s", terms)}))
        log = simulate(DiscreteModel(model), "static", n * dt, np.random.default_rng(7))
        return log.values("gyro_x")[:n]

    low = make("low_pass", corner=10.0, order=1)
    y = log_of(low)
    X2 = np.abs(np.fft.rfft(y - y.mean())[1:-1]) ** 2 / y.size
    ratio = X2 / sampled_spectrum(
        [make("white_noise", N=0.1), low], np.arange(1, X2.size + 1) * 2 * np.pi / y.size, dt
    )
    assert abs(ratio.mean() - 1.0) < LIMIT / np.sqrt(ratio.size)
    y = log_of(make("noise_change", ratio=2.0, time=100.0))
    for part, variance in ((y[:10_000], 1.0), (y[10_000:], 4.0)):
        # the simulated growth itself is relative to the level of all steps, which is 1 to 1 %
        assert abs(part.var() / variance - 1.0) < LIMIT * np.sqrt(2.0 / part.size) + 0.02
    y = log_of(make("outliers", share=0.05, sigma=10.0))
    # variance 1 + 0.05 x 100; fourth moment 3 (0.95 + 0.05 x 101^2)
    spread = np.sqrt((3.0 * (0.95 + 0.05 * 101.0**2) - 36.0) / y.size)
    assert abs(y.var() - 6.0) < LIMIT * spread
