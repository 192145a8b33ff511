"""Proves the processes of a sensor at rest by their closed forms: variances, spectra, starts, meanings of their numbers.

References: IEEE Std 952-1997, annex C; the exact values of a first-order process and of its samples are in
docs/noise.md. Simulations are held to 4.5 standard deviations of what they estimate (7e-6 a case), seeds fixed.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.filter_role import FilterPlace
from kfgen.effects.linear_system import (
    LinearSystem,
    State,
    _resolvent,
    allan_variance,
    density,
    discretise,
    initial_covariance,
    mean,
    sampled_density,
    simulate,
)
from kfgen.effects.process.stochastic import FLICKER_FLOOR_OVER_B, gauss_markov_peak

SIGMA, TAU = 3.0, 5.0
GM = make("gauss_markov", sigma=SIGMA, tau=TAU)
WHITE = LinearSystem(V=4.0)
STEPS = LinearSystem(Z=0.25)
RAMP = LinearSystem(
    A=((0, 1), (0, 0)), W=((0, 0), (0, 0)), C=(1, 0), x0=(2.0, 0.5), states=(State("a"), State("b"))
)
"""``y = 2 + t / 2``."""
T = np.array([0.5, 2.0, 7.0, 40.0])


def two_rates() -> LinearSystem:
    """Two independent processes of standard deviations 1 and 2, times 2 s and 10 s, seen as ``3 a - b``."""
    return LinearSystem(
        A=((-0.5, 0), (0, -0.1)),
        W=((1.0, 0), (0, 0.8)),
        C=(3, -1),
        x0=(0, 0),
        states=(State("a"), State("b")),
    )


def gm_allan(sigma: float, tau: float, t: np.ndarray) -> np.ndarray:
    """IEEE Std 952, eq. (C.16): of a first-order process of that variance."""
    r = t / tau
    return 2.0 * sigma**2 / r**2 * (r - (3.0 - 4.0 * np.exp(-r) + np.exp(-2.0 * r)) / 2.0)


def test_allan_variances_in_closed_form() -> None:
    assert allan_variance(WHITE, T) == pytest.approx(4.0 / T)
    assert allan_variance(STEPS, T) == pytest.approx(3.0 * 0.25 / T**2)
    assert allan_variance(RAMP, T) == pytest.approx(0.5**2 * T**2 / 2.0)
    assert allan_variance(GM.form(), T) == pytest.approx(gm_allan(SIGMA, TAU, T), rel=1e-9)
    both = 9.0 * gm_allan(1.0, 2.0, T) + gm_allan(2.0, 10.0, T)
    assert allan_variance(two_rates(), T) == pytest.approx(both, rel=1e-9)
    assert allan_variance(make("rate_random_walk", K=0.7).form(), T) == pytest.approx(0.49 * T / 3.0)


def test_densities_in_closed_form() -> None:
    f = np.array([0.01, 0.1, 1.0])
    w2 = (2.0 * np.pi * f) ** 2
    assert density(WHITE, f) == pytest.approx(4.0)
    assert density(GM.form(), f) == pytest.approx(2.0 * SIGMA**2 / TAU / (w2 + TAU**-2))
    assert density(two_rates(), f) == pytest.approx(9.0 / (w2 + 0.25) + 0.8 / (w2 + 0.01))
    assert density(RAMP, f) == pytest.approx(0.0)
    coupled = LinearSystem(
        A=((0, 1), (-4.0, -0.4)), W=((0, 0), (0, 3.0)), C=(1, 0), x0=(0, 0), states=(State("a"), State("b"))
    )
    w = 2.0 * np.pi * f
    assert density(coupled, f) == pytest.approx(3.0 / ((4.0 - w**2) ** 2 + (0.4 * w) ** 2))


@pytest.mark.parametrize("block", [1, 3])
def test_densities_of_samples_and_of_their_averages(block: int) -> None:
    """White noise V / dt over the block; steps ``|1 - 1/z|^2 Z / (block dt)^2``; the first order of averages by its sums."""
    dt, w = 0.2, np.array([0.3, 1.0, 2.5])
    assert sampled_density(WHITE, w, dt, block) == pytest.approx(4.0 / dt / block)
    flat = (2.0 - 2.0 * np.cos(w)) * 0.25 / (block * dt) ** 2
    assert sampled_density(STEPS, w, dt, block) == pytest.approx(flat)
    assert sampled_density(RAMP, w, dt, block) == pytest.approx(0.0)
    a, found = math.exp(-dt / TAU), sampled_density(GM.form(), w, dt, block)
    lags = np.arange(-4000, 4001)
    inner = np.arange(block)
    distance = np.abs(block * lags[:, None, None] + inner[:, None] - inner)
    covariance = SIGMA**2 * np.power(a, distance).mean(axis=(1, 2))
    assert found == pytest.approx(np.cos(np.outer(w, lags)) @ covariance, rel=1e-8)


@pytest.mark.parametrize(
    "Phi",
    [
        np.diag([0.5, 0.9]),
        np.array([[0.5, 0.2], [-0.3, 0.8]]),
        np.array([[0.5, 0.2, 0.1], [0.0, 0.3, 0.4], [0.2, 0.0, 0.6]]),
        np.array([[0.7]]),
    ],
)
def test_resolvents_solve_their_equation(Phi: np.ndarray) -> None:
    z, row = np.exp(1j * np.array([0.2, 1.0, 3.0])), np.arange(2.0, Phi.shape[0] + 2.0)
    found = _resolvent(z, Phi, row)
    for k, one in enumerate(z):
        np.testing.assert_allclose((one * np.eye(row.size) - Phi.T) @ found[:, k], row, rtol=1e-12)


def test_the_covariance_at_the_start_is_the_stationary_one() -> None:
    assert initial_covariance(two_rates()) == pytest.approx(np.diag([1.0, 4.0]))
    assert initial_covariance(RAMP) == pytest.approx(np.zeros((2, 2)))
    Phi, Qd = discretise(GM.form(), 2.0)
    assert (Phi[0, 0], Qd[0, 0]) == pytest.approx((math.exp(-2.0 / TAU), SIGMA**2 * -math.expm1(-4.0 / TAU)))


def test_what_is_random_is_not_deterministic() -> None:
    assert RAMP.deterministic
    assert not GM.form().deterministic
    assert not WHITE.deterministic
    assert not STEPS.deterministic
    assert not LinearSystem().deterministic
    for part in ({"V": 1.0}, {"Z": 1.0}):
        assert not LinearSystem(RAMP.A, RAMP.W, RAMP.C, x0=RAMP.x0, states=RAMP.states, **part).deterministic


def test_means_since_the_start() -> None:
    t = 3.0 + 0.5 * np.arange(5)
    assert mean(RAMP, t) == pytest.approx(2.0 + 0.5 * t)
    assert mean(RAMP, t[:1]) == pytest.approx([3.5])
    assert mean(RAMP, t[:2]) == pytest.approx([3.5, 3.75])
    assert mean(WHITE, t) == pytest.approx(np.zeros(5))
    constant = LinearSystem(A=((0,),), W=((0,),), C=(3.0,), x0=(2.0,), states=(State("c"),))
    assert mean(constant, t) == pytest.approx(np.full(5, 6.0))
    driven = LinearSystem(
        A=((0, 0), (0, 0)), W=((0, 0), (0, 0)), C=(1.0, t), x0=(1.0, 4.0), states=(State("c"), State("d"))
    )
    assert mean(driven, t) == pytest.approx(1.0 + 4.0 * t)
    falling = LinearSystem(A=((-0.5,),), W=((0,),), C=(1,), states=(State("c"),))
    assert mean(falling, t) == pytest.approx(np.zeros(5))


def test_simulations_have_their_variance() -> None:
    """Of 20,000 samples: white, differences of steps (of lag one -1/2), and a process with its start."""
    n, dt, rng = 20_000, 0.2, np.random.default_rng(3)
    t = dt * np.arange(n)
    y = simulate(WHITE, t, rng)
    assert np.var(y) == pytest.approx(4.0 / dt, rel=4.5 * math.sqrt(2.0 / n))
    y = simulate(STEPS, t, rng)
    assert np.var(y) == pytest.approx(2.0 * 0.25 / dt**2, rel=4.5 * math.sqrt(3.0 / n))
    assert np.mean(y[1:] * y[:-1]) / np.var(y) == pytest.approx(-0.5, abs=4.5 / math.sqrt(n))
    a, y = math.exp(-dt / TAU), simulate(GM.form(), t, rng)
    effective = n * (1.0 - a**2) / (1.0 + a**2)
    assert np.var(y) == pytest.approx(SIGMA**2, rel=4.5 * math.sqrt(2.0 / effective))
    assert np.mean(y[1:] * y[:-1]) / np.var(y) == pytest.approx(a, abs=4.5 * math.sqrt((1.0 - a**2) / n))
    starts = [simulate(GM.form(), t[:2], rng)[0] for _ in range(400)]
    assert np.std(starts) == pytest.approx(SIGMA, rel=4.5 / math.sqrt(800))
    one = [simulate(WHITE, t[:1], rng)[0] for _ in range(400)]
    assert np.std(one) == pytest.approx(2.0, rel=4.5 / math.sqrt(800))
    assert simulate(RAMP, t, rng) == pytest.approx(2.0 + 0.5 * t)
    walk = [simulate(make("rate_random_walk", K=2.0).form(), t[:26], rng)[-1] for _ in range(400)]
    assert np.std(walk) == pytest.approx(2.0 * math.sqrt(25 * dt), rel=4.5 / math.sqrt(800) + 0.02)


def test_few_samples_of_noise_are_its_draws() -> None:
    """White noise of density 4 every half second: the draws times ``sqrt(8)``; of steps their differences over the time."""
    t = 3.0 + 0.5 * np.arange(5)
    w = np.random.default_rng(4).standard_normal(6)
    assert simulate(WHITE, t, np.random.default_rng(4)) == pytest.approx(math.sqrt(8.0) * w[:5])
    assert simulate(WHITE, t[:2], np.random.default_rng(4)) == pytest.approx(math.sqrt(8.0) * w[:2])
    assert simulate(STEPS, t, np.random.default_rng(4)) == pytest.approx(np.diff(0.5 * w) / 0.5)


def test_every_state_starts_from_its_stationary_spread() -> None:
    """``3 a - b`` of variances 1 and 4 has 13."""
    rng, t = np.random.default_rng(5), np.array([0.0, 0.1])
    found = np.std([simulate(two_rates(), t, rng)[0] for _ in range(800)])
    assert found == pytest.approx(math.sqrt(13.0), rel=4.5 / math.sqrt(1600))


LOOK = SimpleNamespace(
    tau=np.array([0.5, 2.0, 20.0]), deviation=np.array([3.0, 1.0, 2.0]), dt=0.25, duration=400.0
)


def test_starts_of_a_fit_are_read_off_the_allan_deviation() -> None:
    classes = {name: type(make(name, **size)) for name, size in EACH.items()}
    (white,) = classes["white_noise"].starts(LOOK)  # type: ignore[arg-type]
    assert pytest.approx(3.0 * math.sqrt(0.5)) == white.N  # type: ignore[attr-defined]
    (steps,) = classes["quantisation"].starts(LOOK)  # type: ignore[arg-type]
    assert pytest.approx(3.0 * 0.5 / math.sqrt(3.0)) == steps.Q  # type: ignore[attr-defined]
    (walk,) = classes["rate_random_walk"].starts(LOOK)  # type: ignore[arg-type]
    assert pytest.approx(2.0 * math.sqrt(3.0 / 20.0)) == walk.K  # type: ignore[attr-defined]
    (flicker,) = classes["bias_instability"].starts(LOOK)  # type: ignore[arg-type]
    assert (flicker.B, flicker.shortest, flicker.longest) == (1.0, 0.25, 400.0)  # type: ignore[attr-defined]
    slow = classes["gauss_markov"].starts(LOOK)  # type: ignore[arg-type]
    assert [e.tau for e in slow] == pytest.approx(5.0 * 8.0 ** (np.arange(4) / 3.0))  # type: ignore[attr-defined]
    assert slow[0].sigma == pytest.approx((1.0 + 3.0 / 18.0) / 0.6)  # type: ignore[attr-defined]
    long = SimpleNamespace(tau=LOOK.tau, deviation=LOOK.deviation, dt=0.25, duration=1e5)
    assert classes["gauss_markov"].starts(long)[0].tau == pytest.approx(100.0)  # type: ignore[arg-type, attr-defined]


EACH: dict[str, dict[str, float]] = {
    "white_noise": {"N": 1.0},
    "quantisation": {"Q": 1.0},
    "gauss_markov": {"sigma": 1.0, "tau": 1.0},
    "bias_instability": {"B": 1.0},
    "rate_random_walk": {"K": 1.0},
}


def test_forms_in_their_letters() -> None:
    assert make("white_noise", N=3.0).form().V == 9.0
    assert make("quantisation", Q=3.0).form().Z == 9.0
    walk = make("rate_random_walk", K=3.0).form()
    assert (walk.A, walk.W, walk.C, walk.x0) == (((0,),), ((9.0,),), (1,), (0,))
    assert walk.states[0].shared
    gm = GM.form()
    assert (gm.A[0][0], gm.W[0][0], gm.C, gm.x0) == (-0.2, 18.0 / 5.0, (1,), (0,))


def test_a_bank_of_flicker_in_closed_form() -> None:
    """From 2 s to 1000 s: ``log(500) / log(4) = 4.48``, so six times of the ratio ``500^(1/5)``; two where it is narrow."""
    form = make("bias_instability", B=3.0, shortest=2.0, longest=1000.0).form()
    A, W = np.array(form.A, float), np.array(form.W, float)
    ratio = 500.0**0.2
    assert -1.0 / np.diag(A) == pytest.approx(2.0 * ratio ** np.arange(6))
    assert np.diag(W) == pytest.approx(-2.0 * np.diag(A) * 9.0 * math.log(ratio) / math.pi)
    assert pytest.approx(np.diag(np.diag(A))) == A
    assert pytest.approx(np.diag(np.diag(W))) == W
    assert (form.C, form.x0) == ((1,) * 6, (0,) * 6)
    narrow = make("bias_instability", B=3.0, shortest=2.0, longest=3.0).form()
    assert -1.0 / np.diag(np.array(narrow.A, float)) == pytest.approx([2.0, 3.0])


def test_a_bank_of_any_slope_in_closed_form() -> None:
    """Of slope 1 the flicker of the same B, a slow process and white noise; of 1.5 variances go with the root of the time."""
    band = {"shortest": 2.0, "longest": 1000.0}
    flicker = make("bias_instability", B=3.0, **band).form()
    even = make("power_law_noise", B=3.0, slope=1.0, **band).form()
    W, A = np.array(even.W, float), np.array(even.A, float)
    assert W[:6, :6] == pytest.approx(np.array(flicker.W, float))
    assert A[:6, :6] == pytest.approx(np.array(flicker.A, float))
    assert -1.0 / A[6, 6] == pytest.approx(1e5)
    ratio = 500.0**0.2
    assert W[6, 6] == pytest.approx(2.0 * 9.0 / math.pi / (1000.0 * math.sqrt(ratio)))
    assert pytest.approx(2.0 * 9.0 / math.pi * 2.0 / math.sqrt(ratio)) == even.V
    assert [s.name for s in even.states] == [f"power_law{i}" for i in range(7)]
    steep = make("power_law_noise", B=2.0, slope=1.5, **band).form()
    variances = -0.5 * np.diag(np.array(steep.W, float)) / np.diag(np.array(steep.A, float))
    root = np.sqrt(2.0 * ratio ** np.arange(6))
    assert variances[:6] == pytest.approx(4.0 * math.log(ratio) * math.sqrt(0.5) / math.pi * root)


@pytest.mark.parametrize("slope", [0.0, -1.0, 2.0])
def test_a_slope_beyond_white_and_a_walk_is_refused(slope: float) -> None:
    with pytest.raises(InputError, match="Give a slope above 0 and below 2"):
        make("power_law_noise", B=1.0, slope=slope)


@pytest.mark.parametrize("name", ["bias_instability", "power_law_noise"])
@pytest.mark.parametrize(("shortest", "longest"), [(0.0, 1.0), (-1.0, 1.0), (1.0, 1.0), (2.0, 1.0)])
def test_an_empty_band_is_refused(name: str, shortest: float, longest: float) -> None:
    numbers = {"B": 1.0} if name == "bias_instability" else {"B": 1.0, "slope": 1.5}
    with pytest.raises(InputError, match=f"the band of {name} .* is empty"):
        make(name, **numbers, shortest=shortest, longest=longest)


def test_only_an_unstated_band_is_extended() -> None:
    stated = make("bias_instability", B=1.0, shortest=2.0, longest=50.0)
    assert stated.in_record(0.01, 1e6) is stated  # type: ignore[attr-defined]
    half = make("bias_instability", B=1.0, shortest=2.0)
    assert half.in_record(0.01, 1e6) is half  # type: ignore[attr-defined]


def test_noise_of_a_sample_has_the_density_of_white_noise_in_a_record() -> None:
    """White noise of density ``N^2`` has the variance ``N^2 / dt`` in samples of period dt: 0.3^2 = N^2 / 0.04 s."""
    assert make("sample_noise", sd=0.3).in_record(0.04, 100.0) == make("white_noise", N=0.06)


def test_the_peak_of_a_first_order_process() -> None:
    """IEEE Std 952: ``0.437 q sqrt(tau)`` at 1.89 tau, where ``q = sigma sqrt(2 / tau)``; flicker's floor is 0.664 B."""
    at, height = gauss_markov_peak()
    grid = np.linspace(1.8, 2.0, 200_001)
    curve = np.sqrt(gm_allan(1.0, 1.0, grid))
    assert (at, height) == pytest.approx((grid[np.argmax(curve)], curve.max()), rel=1e-5)
    assert (at, height) == pytest.approx((1.89, 0.437 * math.sqrt(2.0)), rel=2e-3)
    assert pytest.approx(0.66428, rel=1e-4) == FLICKER_FLOOR_OVER_B


def test_meanings_of_a_gauss_markov_go_there_and_back() -> None:
    """Of sigma = 3 and tau = 5 each by its formula; what is read in gives the same number out."""
    v = {"sigma": SIGMA, "tau": TAU}
    height = gauss_markov_peak()[1]
    expected = {
        "beta": 0.2,
        "sigma": 3.0,
        "q": 3.0 * math.sqrt(0.4),
        "B_ieee": 3.0 * height / FLICKER_FLOOR_OVER_B,
        "adev_min": 3.0 * height,
        "B_saini": 3.0 * math.sqrt(10.0),
    }
    own = {m.name: m for m in type(GM).meanings}
    assert set(own) == set(expected)
    for letter, number in expected.items():
        meaning = own[letter]
        assert meaning.back(GM) == pytest.approx(number), letter
        back = TAU if letter == "beta" else SIGMA
        assert meaning.to(number, v) == pytest.approx(back), letter


def test_noise_of_samples_is_the_same_at_every_rate() -> None:
    noise = make("sample_noise", sd=3.0)
    for dt in (0.01, 1.0):
        assert noise.sampled_density(np.array([0.1, 3.0]), dt) == pytest.approx([9.0, 9.0])
        assert noise.sampled_density(np.array([0.1]), dt, 4) == pytest.approx([2.25])
    y = noise.simulate(np.arange(10_000) * 0.01, np.random.default_rng(1))
    assert np.std(y) == pytest.approx(3.0, rel=4.5 / math.sqrt(20_000))
    role = noise.in_filter(FilterPlace.__new__(FilterPlace))
    assert (role.variance, role.alone) == (9.0, True)  # type: ignore[union-attr]
    assert type(noise).sizes() == ("sd",)


def test_a_grid_bounds_the_quantisation() -> None:
    cls = type(make("quantisation", Q=1.0))
    assert cls.ceiling("Q", SimpleNamespace(adc_step=6.0, dt=0.5)) == pytest.approx(3.0 / math.sqrt(12.0))
    assert cls.ceiling("Q", SimpleNamespace(adc_step=0.0, dt=0.5)) == math.inf
