"""Proves that identification is as exact, as sharp and as modest as statistics allow.

Exactness: the sine transform diagonalises white noise with a random walk (matrices, no chance). Sharpness: the
Cramer-Rao bounds of docs/identification.md, 2.1. Modesty: Monte Carlo with records made in plain numpy and fixed
seeds. The accepted counts hold at least 99 % of the binomial at the nominal rate: N of white noise in 200 records,
95 % intervals (two-sided, 0.2 % outside); N, sigma and tau in 30 records, each at least 25 of 30 (0.3 % below) and
at least 80 of all 90 (0.8 % below, as if independent); a resolved Gauss-Markov process in at most 3 of 16
records of N and K alone, nominally 5 % (0.7 % above).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from in_part import in_part
from numpy.typing import NDArray
from scipy.fft import dst
from scipy.signal import lfilter
from scipy.stats import binom, chi2

from kfgen.core.errors import InputError
from kfgen.effects import Effect, make
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import block_means, density_of_differences, ordinates, transform
from kfgen.identify.fit.bounds import relative_bound, seconds_for
from kfgen.identify.identify import Identified, identify

Array = NDArray[np.float64]


def white(seed: int, n: int, dt: float, N: float) -> Array:
    return N / np.sqrt(dt) * np.random.default_rng([seed, 0]).standard_normal(n)


def walk(seed: int, n: int, dt: float, K: float) -> Array:
    return np.cumsum(K * np.sqrt(dt) * np.random.default_rng([seed, 1]).standard_normal(n))


def gauss_markov(seed: int, n: int, dt: float, sigma: float, tau: float) -> Array:
    """Exact discretisation from a stationary start."""
    e = np.exp(-dt / tau)
    w = sigma * np.random.default_rng([seed, 2]).standard_normal(n)
    w[1:] *= np.sqrt(1 - e * e)
    return np.asarray(lfilter([1.0], [1.0, -e], w))


def record(y: Array, dt: float) -> Record:
    return Record(np.arange(y.size) * dt, y)


def shown(found: Identified) -> list[str]:
    """The effects that the answer prints: those whose kind is resolved."""
    return [e.name for i, e in enumerate(found.fit.effects) if i not in found.unresolved]


# The transform.


def white_and_walk(n: int, dt: float, N: float, K: float) -> Array:
    walks = np.minimum.outer(np.arange(n), np.arange(n)) * K**2 * dt
    return N**2 / dt * np.eye(n) + walks


@pytest.mark.parametrize("block", [1, 4])
@pytest.mark.parametrize("K", [0.0, 0.05, 3.0])
def test_sine_transform_is_exact_for_white_and_walk(K: float, block: int) -> None:
    """Covariance of the transform: nothing off the diagonal, the density of the differences on it."""
    n, dt, N = 240, 0.1, 0.3
    mean = np.kron(np.eye(n // block), np.full(block, 1.0 / block))
    difference = np.diff(np.eye(n // block), axis=0)
    transform = dst(np.eye(n // block - 1), type=1, norm="ortho")
    T = transform @ difference @ mean
    C = T @ white_and_walk(n, dt, N, K) @ T.T
    omega = np.pi * np.arange(1, n // block) / (n // block)
    S = density_of_differences([make("white_noise", N=N), make("rate_random_walk", K=K)], omega, dt, block)
    off = C - np.diag(np.diag(C))
    assert np.abs(off).max() < 1e-12 * np.diag(C).max()
    np.testing.assert_allclose(np.diag(C), S, rtol=1e-9)


def test_ordinates_are_that_transform() -> None:
    n, dt, block = 6000, 0.01, 3
    y, r = white(0, n, dt, 1.0), walk(0, n, dt, 1.0)
    data = ordinates([transform(block_means(v, block)) for v in (y, r)], dt, block)
    means = [v.reshape(-1, block).mean(axis=1) for v in (y, r)]
    X = np.array([dst(np.diff(m), type=1, norm="ortho") for m in means])
    assert data.n == n // block - 1
    np.testing.assert_allclose(data.omega[:50], np.pi * np.arange(1, 51) / (n // block), rtol=1e-12)
    np.testing.assert_allclose(data.gram[:50, 0, 1], (X[0] * X[1])[:50], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(data.gram.sum(axis=0), X @ X.T, rtol=1e-9)


# The Cramer-Rao bound.

N0, B0, K0, TAU0 = 5.75e-2, 1.55e-2, 9e-4, 100.0
SAINI = B0 * np.sqrt(1 / (2 * TAU0))


def effects(N: float, sigma: float, K: float, tau: float) -> list[Effect]:
    out = [
        make("white_noise", N=N),
        make("gauss_markov", sigma=sigma, tau=tau),
        make("rate_random_walk", K=K),
    ]
    return [e for e in out if e.name != "gauss_markov" or sigma]


TABLE = [
    # sigma, samples, rate, printed (docs/identification.md, 2.1, exact); tau has the bound of beta
    (B0, 10**6, 100.0, {"N": ".0007", "sigma": ".214", "K": ".289", "tau": ".509"}),
    (B0, 10**7, 100.0, {"N": ".0002", "sigma": ".066", "K": ".089", "tau": ".158"}),
    (B0, 10**6, 10.0, {"N": ".00071", "sigma": ".0663", "K": ".0887", "tau": ".158"}),
    (B0, 10**5, 1.0, {"sigma": ".066", "K": ".089", "tau": ".159"}),
    (SAINI, 10**6, 100.0, {"N": ".0007", "K": ".23", "tau": "52"}),
    (SAINI, 10**7, 100.0, {"N": ".0002", "K": ".073", "tau": "16"}),
    (0.0, 10**5, 100.0, {"K": ".385"}),
    (0.0, 10**6, 100.0, {"K": ".1145"}),
    (0.0, 10**7, 100.0, {"K": ".037"}),
]


@pytest.mark.parametrize(("sigma", "n", "rate", "printed"), TABLE)
def test_bound_of_the_table(sigma: float, n: int, rate: float, printed: dict[str, str]) -> None:
    """Within half of the last printed digit and 2.5 %, by which Whittle's bound differs from the exact one."""
    got = {k[1]: v for k, v in relative_bound(effects(N0, sigma, K0, TAU0), 1 / rate, n).items()}
    for name, text in printed.items():
        half_digit = 0.5 * 10.0 ** -len(text.partition(".")[2])
        assert got[name] == pytest.approx(float(text), abs=half_digit + 0.025 * float(text))


@pytest.mark.parametrize("K", [0.02, 0.5])
def test_bound_is_the_information_of_the_gaussian(K: float) -> None:
    """J_ab = 1/2 tr(C^-1 dC_a C^-1 dC_b) of the differences of 300 samples, in ln N and ln K."""
    n, dt, N = 300, 0.1, 0.3
    D = np.diff(np.eye(n), axis=0)
    parts = [2 * D @ white_and_walk(n, dt, *p) @ D.T for p in ((N, 0.0), (0.0, K))]
    whitened = [np.linalg.solve(0.5 * (parts[0] + parts[1]), p) for p in parts]
    J = np.array([[0.5 * np.trace(a @ b) for b in whitened] for a in whitened])
    exact = np.sqrt(np.diag(np.linalg.inv(J)))
    got = relative_bound([make("white_noise", N=N), make("rate_random_walk", K=K)], dt, n)
    np.testing.assert_allclose([got[0, "N"], got[1, "K"]], exact, rtol=0.01)


def test_information_of_a_likelihood_is_fishers() -> None:
    """White noise and Gauss-Markov: 1/2 sum (d ln S / da) (d ln S / db) with S and its slopes in closed form, to 1 %."""
    n, dt, N, sigma, tau = 6000, 0.1, 1.0, 1.5, 8.0
    omega = np.pi * np.arange(1, n) / n
    e = np.exp(-dt / tau)
    below = 1 - 2 * e * np.cos(omega) + e * e
    white_part, markov = np.full(n - 1, N**2 / dt), sigma**2 * (1 - e * e) / below
    # d e / d ln tau = e dt / tau
    by_tau = markov * (e * dt / tau) * (-2 * e / (1 - e * e) - (2 * e - 2 * np.cos(omega)) / below)
    slopes = np.array([2 * white_part, 2 * markov, by_tau]) / (white_part + markov)
    model = (make("white_noise", N=N), make("gauss_markov", sigma=sigma, tau=tau))
    y = white(0, n, dt, N) + gauss_markov(0, n, dt, sigma, tau)
    keys = [(0, "N"), (1, "sigma"), (1, "tau")]
    got = record(y, dt).likelihood(model).information(model, keys)
    exact = 0.5 * slopes @ slopes.T
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    np.testing.assert_allclose(got / scale, exact / scale, atol=0.01)


@pytest.mark.parametrize("skip", [((30.0, float("inf")),), ((0.0, 12.5), (25.0, 37.5)), ((20.0, 20.5),)])
def test_what_is_not_looked_at_gives_no_information(skip: tuple[tuple[float, float], ...]) -> None:
    """White noise alone: m ordinates know its ln N to 1 / sqrt(2 m); at 100 Hz they reach to 50 Hz."""
    n = 40_000
    left = n * (1.0 - sum(min(hi, 50.0) - lo for lo, hi in skip) / 50.0)
    bound = relative_bound([make("white_noise", N=0.1)], 0.01, n, skip=skip)
    assert bound[0, "N"] == pytest.approx(1 / np.sqrt(2 * left), rel=1e-3)


def test_hours_of_the_table() -> None:
    """Log for 20 %: B 3.1 h, K 5.5 h, beta 17 h; with the paper's B, K 3.7 h and beta 184,270 h."""
    model = effects(N0, B0, K0, TAU0)
    hours = {k: seconds_for(model, 0.01, k) / 3600 for k in ((1, "sigma"), (2, "K"), (1, "tau"))}
    assert list(hours.values()) == pytest.approx([3.1, 5.5, 17.0], rel=0.05)
    model = effects(N0, SAINI, K0, TAU0)
    assert seconds_for(model, 0.01, (2, "K")) / 3600 == pytest.approx(3.7, rel=0.05)
    assert seconds_for(model, 0.01, (1, "tau")) / 3600 == pytest.approx(184270, rel=0.06)


# Monte Carlo.


def held(found: Identified, truth: dict[tuple[int, str], float]) -> list[bool]:
    return [found.intervals[k][0] <= v <= found.intervals[k][1] for k, v in truth.items()]


def test_intervals_of_white_noise_cover() -> None:
    runs = 200
    found = [identify(record(white(s, 600, 0.1, 0.02), 0.1), ["white_noise"]) for s in range(runs)]
    inside = sum(held(f, {(0, "N"): 0.02})[0] for f in found)
    assert binom.ppf(0.001, runs, 0.95) <= inside <= binom.ppf(0.999, runs, 0.95)
    values = np.log([f.fit.effects[0].N / 0.02 for f in found])
    bound = np.sqrt(1 / (2 * 600))  # of the logarithm of a standard deviation from 600 samples
    assert abs(values.mean()) < 4 * bound / np.sqrt(runs)
    assert 0.8 < values.std() / bound < 1.2


@pytest.mark.long
def test_intervals_of_white_and_gauss_markov_cover() -> None:
    truth = {(0, "N"): 1.0, (1, "sigma"): 1.5, (1, "tau"): 8.0}
    names, counts, n, dt = ["white_noise", "gauss_markov"], np.zeros(3, int), 6000, 0.1
    estimates = []
    for seed in range(30):
        y = white(seed, n, dt, 1.0) + gauss_markov(seed, n, dt, 1.5, 8.0)
        found = identify(record(y, dt), names)
        counts += held(found, truth)
        e = found.fit.effects
        estimates.append([e[0].N, e[1].sigma, e[1].tau])
        assert all(lo > 0 and np.isfinite(hi) for lo, hi in found.intervals.values())
    assert counts.min() >= 25
    assert counts.sum() >= 80
    errors = np.log(np.array(estimates) / list(truth.values()))
    bounds = list(found.bounds.values())
    assert (np.sqrt((errors**2).mean(axis=0)) < 1.5 * np.array(bounds)).all()


@pytest.mark.long
def test_a_day_of_all_three_is_at_the_bound() -> None:
    """1e5 samples at 1 Hz: the bounds of 27.8 h. 16 logs; each limit is passed by chance less than once in 500.

    The sum of squared errors over the squared bound is a chi-square of 16 degrees where the bound is
    reached; of 16 intervals each holds the truth with 95 %; the right set is chosen in 90 % at least.
    """
    n, runs = 100_000, 16
    truth = {(0, "N"): N0, (1, "sigma"): B0, (1, "tau"): TAU0, (2, "K"): K0}
    names, errors, inside, right = (
        ["white_noise", "gauss_markov", "rate_random_walk"],
        [],
        np.zeros(4, int),
        0,
    )
    for seed in range(runs):
        y = white(seed, n, 1.0, N0) + gauss_markov(seed, n, 1.0, B0, TAU0) + walk(seed, n, 1.0, K0)
        found = identify(record(y, 1.0), names)
        inside += held(found, truth)
        e = found.fit.effects
        errors.append(np.log([e[0].N / N0, e[1].sigma / B0, e[1].tau / TAU0, e[2].K / K0]))
        right += set(shown(identify(record(y, 1.0)))) == set(names)
    bound = np.array([0.00225, 0.066, 0.159, 0.089])  # docs/identification.md, 2.3
    assert (np.sum(np.square(errors) / bound**2, axis=0) < chi2.ppf(0.998, runs)).all()
    assert inside.min() >= binom.ppf(0.002, runs, 0.95)
    assert right >= binom.ppf(0.002, runs, 0.9)


@pytest.mark.long
def test_a_walk_alone_is_not_called_gauss_markov() -> None:
    n, dt = 4096, 0.1
    found = [identify(record(white(s, n, dt, 1.0) + walk(s, n, dt, 0.15), dt)) for s in range(16)]
    wrong = sum("gauss_markov" in shown(f) for f in found)
    assert wrong <= 3
    assert sum("rate_random_walk" in shown(f) for f in found) >= 8
    assert all("white_noise" in shown(f) for f in found)


@pytest.mark.parametrize("seed", in_part(range(3)))
def test_at_hemerlys_point_gauss_markov_is_not_identifiable(seed: int) -> None:
    """By physics: the bound on ln B is 183. The limit must hold the true sigma, and no B = 1.2e-2 be printed."""
    n, dt = 100_000, 0.01
    y = white(seed, n, dt, N0) + gauss_markov(seed, n, dt, SAINI, TAU0) + walk(seed, n, dt, K0)
    found = identify(record(y, dt))
    assert "gauss_markov" not in shown(found)
    (limit,) = (m for m in found.limits if m.effect.name == "gauss_markov")
    assert limit.parameter == "sigma"
    assert limit.upper95 > SAINI
    assert limit.hours > n * dt / 3600
    assert pytest.approx(N0, rel=4 * 0.0022) == found.fit.effects[0].N
    rows = [
        (e.name, v) for i, e in enumerate(found.fit.effects) if i not in found.unresolved for v in vars(e)
    ]
    assert {name for name, _ in rows} <= {"white_noise", "rate_random_walk"}


def test_a_strong_gauss_markov_is_resolved() -> None:
    """The rule that keeps weak ones out must not keep out one whose bound is 8 %."""
    n, dt = 40_000, 0.05
    y = white(1, n, dt, 0.1) + gauss_markov(1, n, dt, 0.3, 5.0)
    found = identify(record(y, dt))
    at = {e.name: i for i, e in enumerate(found.fit.effects)}
    assert "gauss_markov" in shown(found)
    e = found.fit.effects[at["gauss_markov"]]
    assert e.sigma == pytest.approx(0.3, rel=4 * found.bounds[at["gauss_markov"], "sigma"])
    assert e.tau == pytest.approx(5.0, rel=4 * found.bounds[at["gauss_markov"], "tau"])
    assert "gauss_markov" not in [m.effect.name for m in found.limits]


# Invariances.


@pytest.fixture(scope="module")
def plain() -> tuple[Array, Identified]:
    y = white(4, 4096, 0.1, 1.0) + gauss_markov(4, 4096, 0.1, 1.5, 8.0)
    return y, identify(record(y, 0.1), ["white_noise", "gauss_markov"])


def values(found: Identified) -> dict[tuple[int, str], float]:
    return {k: float(getattr(found.fit.effects[k[0]], k[1])) for k in found.fit.free}


@pytest.mark.parametrize("offset", [100.0, -1e5])
def test_a_constant_offset_changes_nothing(plain: tuple[Array, Identified], offset: float) -> None:
    y, before = plain
    after = identify(record(y + offset, 0.1), ["white_noise", "gauss_markov"])
    assert values(after) == {k: pytest.approx(v, rel=1e-3) for k, v in values(before).items()}


@pytest.mark.parametrize("factor", [10.0, 1e-6])
def test_scale_goes_to_the_sizes(plain: tuple[Array, Identified], factor: float) -> None:
    y, before = plain
    after = identify(record(y * factor, 0.1), ["white_noise", "gauss_markov"])
    scale = {"N": factor, "sigma": factor, "tau": 1.0}
    assert values(after) == {k: pytest.approx(v * scale[k[1]], rel=1e-3) for k, v in values(before).items()}
    for key, (lo, hi) in before.intervals.items():
        expected = np.array([lo, hi]) * scale[key[1]]
        np.testing.assert_allclose(after.intervals[key], expected, rtol=1e-2)


def test_time_scales_too(plain: tuple[Array, Identified]) -> None:
    """The same samples ten times slower: tau times 10, N times sqrt(10), sigma as it was."""
    y, before = plain
    after = identify(record(y, 1.0), ["white_noise", "gauss_markov"])
    scale = {"N": np.sqrt(10.0), "sigma": 1.0, "tau": 10.0}
    assert values(after) == {k: pytest.approx(v * scale[k[1]], rel=1e-3) for k, v in values(before).items()}


@pytest.mark.parametrize(
    ("y", "match"), [(np.zeros(1000) + 3.0, "never changes"), (np.arange(20.0), "too few")]
)
def test_what_cannot_be_fitted_is_refused(y: Array, match: str) -> None:
    with pytest.raises(InputError, match=match):
        identify(record(y, 0.1))


def test_an_effect_that_needs_a_driver_is_refused_without_it() -> None:
    with pytest.raises(InputError, match="temperature"):
        identify(record(white(0, 500, 0.1, 1.0), 0.1), ["white_noise", "temperature"])


# A real record.

REAL = {
    "gyro_x": ("gx [deg/s/131]", 0.0075 * np.pi / 180),
    "gyro_y": ("gy [deg/s/131]", 0.0112 * np.pi / 180),
    "gyro_z": ("gz [deg/s/131]", 0.0093 * np.pi / 180),
    "accel_x": ("ax [g/16384]", 0.32e-3 * 9.80665),
    "accel_y": ("ay [g/16384]", 0.30e-3 * 9.80665),
    "accel_z": ("az [g/16384]", 0.45e-3 * 9.80665),
}


def _entry(entries: Sequence[dict[str, object]], name: str) -> dict[str, object]:
    (entry,) = (e for e in entries if e["effect"] == name)
    return entry


@pytest.mark.long
def test_real_mpu6050(recording: Callable[[str], Path], kfgen: Callable[..., Result], tmp_path: Path) -> None:
    """450 s at rest: N within 5 % of the Allan reading, and neither K nor a Gauss-Markov process claimed."""
    log, out = recording("native/mpu6050_static.csv"), tmp_path / "id.json"
    columns = ",".join(f"{name}={column}" for name, (column, _) in REAL.items())
    result = kfgen("identify", log, "--rate", 100, "--columns", columns, "--json", out)
    assert result.exit_code == 0, result.output
    answer = json.loads(out.read_text())
    assert answer["format"] == "kfgen-identify-1"
    assert list(answer["channels"]) == list(REAL)
    for name, (_, N) in REAL.items():
        channel = answer["channels"][name]
        found = _entry(channel["effects"], "white_noise")["parameters"]["N"]
        lo, hi = found["ci95"]
        assert found["value"] == pytest.approx(N, rel=0.05)
        assert lo < found["value"] < hi < 1.05 * lo
        assert [e["effect"] for e in channel["effects"]] == ["white_noise"]
        for effect, parameter in (("rate_random_walk", "K"), ("gauss_markov", "sigma")):
            limit = _entry(channel["not_identifiable"], effect)
            assert limit["parameter"] == parameter
            assert 0.0 < limit["upper95"] < 100 * N
            assert channel["duration_s"] / 3600 < limit["log_hours_for_20_percent"] < 1e6
