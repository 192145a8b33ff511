"""Proves the process noise of a plant: in its filter, in a simulation, in the gap.

The filter about a path is compared with the Gaussian distribution of all samples at once, filters with the statistics that
they promise. Seeds are fixed; a log without a gap is falsely alarmed at 0.2 % by the battery, an interval misses at 5 %, a
course is falsely refused at 2 %.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from driven_cart import CART, RATE, SIGMA, N, gap_of
from in_part import in_part
from numpy.typing import NDArray
from scipy.linalg import expm

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.effects.plant.process_noise import ProcessNoise
from kfgen.gap.plant.noise.linear_path import LinearPath
from kfgen.gap.plant.noise.path_filter import PathFilter, Recursion, gains
from kfgen.gap.plant.updated_model import updated_model
from kfgen.gap.plant.wiring import plant_scene
from kfgen.gap.scene.scene import Placed
from kfgen.log.readers import log_of
from kfgen.model.plant.drawn_process_noise import with_drawn_process_noise
from kfgen.model.plant.file import model_text, parse_model
from kfgen.model.plant.plant import simulate

Array = NDArray[np.float64]
WALK = """format = "kfgen-model-1"
name = "walk"
[states]
place = { unit = "m", initial = "0 m", sd = "0.1 m" }
speed = { unit = "m/s", initial = "0 m/s", sd = "0.1 m/s" }
[dynamics]
place = "speed"
speed = "0"
[measurements.seen]
unit = "m"
expression = "place"
effects = [ { effect = "white_noise", N = "0.01 m/sqrt(Hz)" } ]
[dynamics_effects]
speed = [ { effect = "process_noise", N = "0.3 m/s^2/sqrt(Hz)" } ]
"""
SUBSTEPS = 20


def noisy_cart(
    rng: np.random.Generator, density: float, drag: float = 0.0, force: Array | None = None
) -> tuple[Array, Array]:
    """Held input and noisy place of the cart, white noise on its speed, by steps of a twentieth of a sample."""
    ends = np.cumsum(rng.exponential(30.0, N).astype(int) + 5)
    u = rng.uniform(-6.0, 6.0, N)[np.searchsorted(ends, np.arange(N), side="right")]
    h, seen = 1.0 / RATE / SUBSTEPS, np.empty(N)
    step = expm(np.array([[0.0, 1.0], [-20.0 / 1.5, -1.0 / 1.5]]) * h)
    q = v = 0.0
    w = density * np.sqrt(h) * rng.standard_normal((N, SUBSTEPS))
    acting = (u + (0.0 if force is None else force)) / 1.5 * h
    for k in range(N):
        seen[k] = q
        for kick in w[k]:
            q, v = step @ (q, v) + (0.0, acting[k] - drag * v * abs(v) * h + kick)
    return u, seen + SIGMA * rng.standard_normal(N)


def test_a_filter_has_it(tmp_path: Path) -> None:
    """Its normalised innovations over simulated logs are as large as they should be (chi2, 4 sd); without it they are not."""
    path, bare = tmp_path / "walk.toml", tmp_path / "bare.toml"
    path.write_text(WALK, encoding="utf-8")
    bare.write_text(WALK.split("[dynamics_effects]", maxsplit=1)[0], encoding="utf-8")
    (driven,) = kf.build(path).driven
    assert (driven.name, driven.driven) == ("speed", 0.3)
    log = kf.simulate(path, "static", 120.0, 20.0, seed=176136)
    has, lacks = (kf.run(m, log).sensors["seen"].nis for m in (path, bare))
    assert np.mean(has) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / has.size))
    assert np.mean(lacks) > 10.0


def test_a_simulation_has_it() -> None:
    """The variance of the speed grows with the square of the density, of the place with the cube of time (chi2, 4 sd)."""
    model, t, draws = parse_model(WALK, "walk.toml"), np.linspace(0.0, 2.0, 41), 400
    rng = np.random.default_rng(176130)
    ends = []
    for _ in range(draws):
        noisy, noises = with_drawn_process_noise(model, t, rng)
        ends.append(simulate(noisy, t, noises).states[-1, :, 0])
    place, speed = np.var(ends, axis=0)
    assert speed == pytest.approx(0.09 * 2.0, rel=4.0 * np.sqrt(2.0 / draws))
    assert place == pytest.approx(0.09 * 8.0 / 3.0, rel=4.0 * np.sqrt(2.0 / draws))


def path_of(rng: np.random.Generator, n: int = 12, k: int = 2, m: int = 2) -> LinearPath:
    """Some path, with samples that are missing."""
    there = rng.random((n, m)) < 0.8
    C = rng.standard_normal((n, m, k)) * there[:, :, None]
    y = rng.standard_normal((n, m)) * there
    A = np.eye(k) + 0.3 * rng.standard_normal((n - 1, k, k))
    R = rng.uniform(0.2, 1.0, (n, m))
    return LinearPath(
        rng.uniform(0.5, 1.5, n - 1), rng.standard_normal((n, k)), A, C, y, R, rng.standard_normal((n - 1, k))
    )


def test_a_start_of_which_nothing_is_known_leaves_what_the_first_sample_says() -> None:
    """Both states are seen a trillion times closer than they begin: after a sample their covariance is that of its noise."""
    n, R = 4, np.array([8e-7, 2e-3])
    A, C = np.array([[1.0, 0.003], [0.0, 1.0]]), np.eye(2)
    path = LinearPath(
        np.full(n - 1, 0.003),
        np.zeros((n, 2)),
        np.tile(A, (n - 1, 1, 1)),
        np.tile(C, (n, 1, 1)),
        np.zeros((n, 2)),
        np.tile(R, (n, 1)),
        np.zeros((n - 1, 2)),
    )
    P = [p for p, _, _ in gains(path, lambda _: np.zeros((2, 2)), 4e8 * np.eye(2))]
    assert P[1] == pytest.approx(A @ np.diag(R) @ A.T, rel=1e-6)
    assert all(np.linalg.eigvalsh(p).min() > 0.0 for p in P)


def test_the_filter_about_a_path_is_the_distribution_of_all_samples() -> None:
    rng = np.random.default_rng(176131)
    path = path_of(rng)
    n, m, k = path.C.shape
    P0, Q = np.diag([0.5, 2.0]), path.driving(np.array([0.0, 0.7]))
    there = PathFilter(path, Q, P0)
    # Every state is linear in where it begins and in what drives it.
    mean, cov = np.zeros(n * k), np.zeros((n * k, n * k))
    cov[:k, :k] = P0
    for i in range(n - 1):
        a, b = slice(i * k, i * k + k), slice(i * k + k, i * k + 2 * k)
        mean[b] = path.A[i] @ mean[a] + path.d[i]
        cov[b, : i * k + k] = path.A[i] @ cov[a, : i * k + k]
        cov[: i * k + k, b] = cov[b, : i * k + k].T
        cov[b, b] = path.A[i] @ cov[a, a] @ path.A[i].T + Q[i]
    H = np.zeros((n * m, n * k))
    for i in range(n):
        H[i * m : i * m + m, i * k : i * k + k] = path.C[i]
    S = H @ cov @ H.T + np.diag(path.R.ravel())
    left = path.y.ravel() - H @ mean
    z = there.innovations(path.y[:, :, None], path.d[:, :, None], np.zeros((k, 1)))
    assert np.sum(z**2) == pytest.approx(left @ np.linalg.solve(S, left), rel=1e-9)
    whole = 0.5 * (np.linalg.slogdet(S)[1] - np.log(path.R).sum())
    assert there.log_widths.sum() == pytest.approx(whole, rel=1e-9)
    smoothed = path.X + (mean + cov @ H.T @ np.linalg.solve(S, left)).reshape(n, k)
    np.testing.assert_allclose(there.smoothed(), smoothed, rtol=1e-8, atol=1e-9)


def test_a_recursion_in_blocks_is_the_recursion() -> None:
    rng = np.random.default_rng(176132)
    for n in (1, 2, 5, 30, 101):
        M, b, x = (
            0.5 * rng.standard_normal((n - 1, 3, 3)),
            rng.standard_normal((n - 1, 3, 2)),
            rng.standard_normal((3, 2)),
        )
        every = [x]
        for A, c in zip(M, b):
            every.append(A @ every[-1] + c)
        np.testing.assert_allclose(Recursion(M).solved(b, x), every, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("density", in_part([0.05, 0.5]))
def test_it_is_named_with_its_density(tmp_path: Path, density: float) -> None:
    """Before: an `unknown_effect`, or other effects; the updated model file has it, and no gap to the same log."""
    u, seen = noisy_cart(np.random.default_rng([176133, int(100 * density)]), density)
    found = gap_of(tmp_path, u, seen)
    assert found.verdict == "effects_found"
    (finding,) = found.findings
    assert (finding.name, finding.where) == ("process_noise", "v")
    assert finding.probability > 0.9
    lo, hi = finding.ci95["N"]
    assert lo < density < hi < 1.6 * lo
    assert kf.find_gap(tmp_path / "log.csv", found.updated).verdict == "no_gap"


@pytest.mark.long
def test_an_effect_beside_it_is_found(tmp_path: Path) -> None:
    u, seen = noisy_cart(np.random.default_rng(176134), 0.1, drag=0.5)
    found = gap_of(tmp_path, u, seen)
    assert {(f.name, f.where) for f in found.findings} == {("process_noise", "v"), ("quadratic_drag", "v")}
    drag = next(f for f in found.findings if f.name == "quadratic_drag")
    assert drag.ci95["coefficient"][0] < 0.5 < drag.ci95["coefficient"][1]


@pytest.mark.long
def test_a_force_that_nobody_modelled_is_no_process_noise(tmp_path: Path) -> None:
    """It leaves white innovations as well; its course is a square wave."""
    force = 0.3 * np.sign(np.sin(2.0 * np.pi * 0.11 * np.arange(N) / RATE))
    u, seen = noisy_cart(np.random.default_rng(176135), 0.0, force=force)
    found = gap_of(tmp_path, u, seen)
    assert found.verdict == "unknown_effect"
    assert "process_noise" not in {f.name for f in found.findings}
    refused = [r for c in found.comparisons for r in c.refused if r.effect == "process_noise"]
    assert refused[0].why.startswith("it is a spectral line at 0.1")


@pytest.mark.long
def test_noise_on_an_undamped_pendulum_is_no_input_that_was_logged_late(tmp_path: Path) -> None:
    """It is out of phase after a while, which an input that is moved by half a period makes up for: `bad_data` before."""
    rng, h = np.random.default_rng(12), 1.0 / RATE / SUBSTEPS
    ends = np.cumsum(rng.exponential(30.0, N).astype(int) + 5)
    u = rng.uniform(-6.0, 6.0, N)[np.searchsorted(ends, np.arange(N), side="right")]
    u += 2.0 * np.sin(2.0 * np.pi * 0.9 * np.arange(N) / RATE)
    q = v = 0.0
    seen = np.empty(N)
    for k in range(N):
        seen[k] = q
        for _ in range(SUBSTEPS):
            w = 0.2 * rng.standard_normal() / np.sqrt(h)
            middle = v + 0.5 * h * ((u[k] - 20.0 * np.sin(q)) / 1.5 + w)
            v += h * ((u[k] - 20.0 * np.sin(q + 0.5 * h * v)) / 1.5 + w)
            q += h * middle
    table = np.column_stack([np.arange(N) / RATE, u, seen + SIGMA * rng.standard_normal(N)])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t [s],u [N],q_seen [m]", comments="")
    text = CART.replace("NOISE", f"{SIGMA / RATE**0.5:.10g}").replace("k*q - c*v", "k*sin(q)")
    scene = plant_scene(parse_model(text, "pendulum.toml"), log_of(tmp_path / "log.csv"))
    assert scene.spoilt == ()


def test_densities_of_one_state_add_up_as_independent_noises() -> None:
    model = parse_model(WALK, "walk.toml")
    more = updated_model(model, [Placed(ProcessNoise(0.4), "speed")])
    assert parse_model(model_text(more), "more.toml").process_noise["speed"] == pytest.approx(0.5)


def test_it_drives_no_input_and_no_channel(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    text = CART.replace("NOISE", "0.001")
    wrong.write_text(
        text + '[dynamics_effects]\nu = [ { effect = "process_noise", N = "1 N/sqrt(Hz)" } ]\n',
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="process_noise acts on no state 'u'"):
        kf.build(wrong)


def test_coloured_noise_of_a_channel_beside_it_is_refused(tmp_path: Path) -> None:
    """A filter has both; a comparison with a log, which filters white noise only, says so."""
    text = WALK.replace(
        '/sqrt(Hz)" } ]', '/sqrt(Hz)" }, { effect = "gauss_markov", sigma = "0.1 m", tau = "5 s" } ]', 1
    )
    model, log = tmp_path / "walk.toml", tmp_path / "log.csv"
    model.write_text(text, encoding="utf-8")
    t = np.arange(200) / 20.0
    np.savetxt(log, np.column_stack([t, np.sin(t)]), delimiter=",", header="t [s],seen [m]", comments="")
    assert len(kf.build(model).driven) == 1
    with pytest.raises(InputError, match="the noise of seen is not white"):
        kf.find_gap(log, model)
