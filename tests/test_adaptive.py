"""Proves that the adaptive filters adapt, stay positive definite, and that their price is said.

Oracles: filterpy's Kalman filter, the exponential smoother in closed form, the filter of one channel against the
emitted one. NIS is tested by the 95 % band of the mean of 1000 chi-squares (rate 5 %, seeds fixed), which the
conventional filter must leave.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from filterpy.kalman import KalmanFilter
from in_part import in_part
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import chi2

from kfgen.arma.process import Arma
from kfgen.core.errors import InputError
from kfgen.core.linear import van_loan
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.emit.routines import Program
from kfgen.log.log import Channel, Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.run.adaptive.cost import bandwidth, cost_of, response
from kfgen.run.adaptive.denoise import Settings, at_rest, denoise_samples
from kfgen.run.adaptive.loop import WINDOW, ScalarModel, run_filter
from kfgen.run.adaptive.rules import Bounds, Factors, Seen, bounded, rule_named, rules
from kfgen.run.adaptive.wrapper import adapted
from kfgen.run.run import run

Array = NDArray[np.float64]
Call = Callable[..., Result]

PAPER = Arma((0.5422, 0.1204), (-0.1382,), np.exp(-5.7612 / 2))
"""Table 3 and AIC of Narasimhappa 2019, in the sign convention in which it is a drift."""
FIRST = ScalarModel(np.array([[0.95]]), np.array([[0.05]]), np.array([1.0]), 1.0)
R_RULES = ["iae", "sage-husa", "shafkf-p", "shafkf-r"]
BAND = chi2.ppf([0.025, 0.975], 1000) / 1000


def first_order(seed: int, level: Array, drive: Array | float = 1.0) -> Array:
    """A first-order process with the noise of `FIRST`, times `level` and `drive`."""
    rng = np.random.default_rng(seed)
    x = lfilter([1.0], [1.0, -0.95], np.sqrt(0.05) * drive * rng.standard_normal(level.size))
    return np.asarray(x + level * rng.standard_normal(level.size))


def test_the_conventional_filter_is_filterpys() -> None:
    model = ScalarModel.of(PAPER)
    z = PAPER.sigma * np.random.default_rng(1).standard_normal(60)
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.F, kf.Q, kf.H, kf.R = model.A, model.Q, model.H[None, :], np.array([[model.R]])
    kf.P = np.eye(2) * (np.trace(model.Q) + model.R)
    estimates, nis = [], []
    for value in z:
        kf.predict()
        kf.update(value)
        estimates.append(float(kf.x[0, 0]))
        nis.append((kf.y.T @ kf.SI @ kf.y).item())
    found = run_filter(z, model, rule_named("kf"))
    assert found.estimate == pytest.approx(estimates, rel=1e-9)
    assert found.nis == pytest.approx(nis, rel=1e-9)


# Positive definite, whatever comes.


def jumps(n: int) -> Array:
    """White noise whose size goes tenfold up and down every 5000 samples, with outliers and holes."""
    rng = np.random.default_rng(3)
    z = np.where(np.arange(n) // 5000 % 2, 10.0, 1.0) * rng.standard_normal(n)
    z[rng.integers(0, n, n // 1000)] *= 1e3
    z[rng.integers(0, n, n // 1000)] = np.nan
    return z


@pytest.mark.parametrize("n", in_part([20_000, pytest.param(1_000_000, marks=pytest.mark.long)]))
@pytest.mark.parametrize("name", in_part(rules()))
def test_covariances_stay_positive_definite(name: str, n: int) -> None:
    """Through jumps, outliers and holes; R and Q stay inside their bounds, P has positive pivots all along."""
    found = run_filter(jumps(n), ScalarModel.of(Arma(PAPER.phi, PAPER.theta, 1.0)), rule_named(name))
    bounds = Bounds()
    assert found.least > 1e-12
    assert np.isfinite(found.estimate).all()
    assert found.r.min() >= bounds.least_r
    assert found.r.max() <= bounds.most_r**2
    assert found.q.min() >= bounds.least_q
    assert found.q.max() <= bounds.most_q


@pytest.mark.parametrize("name", rules())
def test_bounds_hold_for_any_innovation(name: str) -> None:
    before = Factors(1.0, 1e-4, 1.0, 1e-4)
    for mean in (0.0, 1e-30, 1.0, 1e12):
        f = bounded(rule_named(name).adapt(Seen(3.0, mean, mean, 2.0, 1.0, 1.5), before, 0.97), Bounds())
        assert all(np.isfinite(f))
        assert f.fade >= 1.0
        assert min(f.r, f.once, f.q) > 0.0


# Adaptation.


@pytest.mark.parametrize("name", R_RULES)
def test_nis_returns_to_its_band(name: str) -> None:
    """Noise ten times as large from the middle on; the last 1000 samples, and the 1000 before the jump."""
    level = np.where(np.arange(6000) < 3000, 1.0, 10.0)
    found = run_filter(first_order(11, level), FIRST, rule_named(name))
    assert BAND[0] < found.nis[2000:3000].mean() < BAND[1]
    assert BAND[0] < found.nis[-1000:].mean() < BAND[1]
    plain = run_filter(first_order(11, level), FIRST, rule_named("kf"))
    assert BAND[0] < plain.nis[2000:3000].mean() < BAND[1]
    assert plain.nis[-1000:].mean() > 50.0
    assert np.median(found.r[-1000:]) == pytest.approx(100.0, rel=0.35)


def test_q_follows_a_livelier_state() -> None:
    """Drive ten times as large: Q ends near a hundredfold, the error near that of the filter that knows."""
    drive = np.where(np.arange(12000) < 6000, 1.0, 10.0)
    z = first_order(5, np.ones(12000), drive)
    found, plain = (run_filter(z, FIRST, rule_named(n)) for n in ("iae-q", "kf"))
    assert plain.nis[-1000:].mean() > 2.0
    assert found.nis[-1000:].mean() == pytest.approx(1.0, abs=0.15)
    assert np.median(found.q[-3000:]) == pytest.approx(100.0, rel=0.6)


def test_a_filter_that_knows_is_best() -> None:
    """After the jump Sage-Husa and IAE are within a fifth of the error of the filter that knows R."""
    level = np.full(8000, 10.0)
    x = first_order(2, np.zeros(8000))
    z = x + level * np.random.default_rng(9).standard_normal(8000)
    informed = run_filter(z, ScalarModel(FIRST.A, FIRST.Q, FIRST.H, 100.0), rule_named("kf"))
    best = np.std((informed.estimate - x)[1000:])
    for name in ("iae", "sage-husa"):
        assert np.std((run_filter(z, FIRST, rule_named(name)).estimate - x)[1000:]) < 1.2 * best
    assert np.std((run_filter(z, FIRST, rule_named("kf")).estimate - x)[1000:]) > 1.5 * best


# The price.


def smoother(K: float) -> ScalarModel:
    """A level in random walk whose steady gain is K: ``Q = K^2 / (1 - K)``."""
    return ScalarModel(np.eye(1), np.array([[K**2 / (1 - K)]]), np.ones(1), 1.0)


@pytest.mark.long
def test_the_price_of_an_exponential_smoother() -> None:
    """In closed form: unit response at zero, half of a step after ln 2 / K samples, a known -3 dB point."""
    K, dt = 0.05, 0.01
    z = np.random.default_rng(0).standard_normal(20_000)
    model = smoother(K)
    found = run_filter(z, model, rule_named("kf"))
    assert found.gain == pytest.approx([K], rel=1e-9)
    cost = cost_of(z, dt, model, rule_named("kf"), WINDOW, found)
    assert cost.dc == pytest.approx(1.0, abs=1e-3)
    assert cost.delay == pytest.approx(np.log(0.5) / np.log(1 - K) * dt, abs=1.5 * dt)
    corner = np.arccos(1 - K**2 / (2 * (1 - K))) / (2 * np.pi * dt)
    assert cost.bandwidth == pytest.approx(corner, rel=0.01)
    assert "only low-passes" in cost.words


@pytest.mark.long
def test_the_paper_s_filter_scales_everything() -> None:
    """ARMA(2,1) as the state and R = 980 Q: a constant rate falls to the share to which the noise falls."""
    z = 0.1 * np.random.default_rng(4).standard_normal(20_000)
    model = ScalarModel.of(PAPER)
    found = run_filter(z, model, rule_named("kf"))
    cost = cost_of(z, 0.01, model, rule_named("kf"), WINDOW, found)
    assert cost.dc < 0.01
    assert cost.dc == pytest.approx(abs(response(model, found.gain, np.zeros(1))[0]), rel=0.05)
    assert cost.attenuation == pytest.approx(cost.dc, rel=0.1)
    assert "do not use it as a denoiser" in cost.words
    assert bandwidth(model, found.gain, 0.01) <= 50.0


# The emitted filter.


def emitted(dt: float, N: float) -> tuple[Program, ScalarModel]:
    """A Gauss-Markov bias under white noise, as an emitted filter and as a filter of one channel."""
    effects = make("white_noise", N=N), make("gauss_markov", sigma=0.02, tau=1.0)
    noise = NoiseModel({"gyro_x": ChannelNoise("rad/s", tuple(Term(e) for e in effects))})
    discrete = DiscreteModel(build("gyro-static", noise), rate=1.0 / dt)
    A, Q = van_loan(np.array([[-1.0]]), np.array([[2 * 0.02**2]]), dt)
    return Program(discrete), ScalarModel(A, Q, np.ones(1), N**2 / dt)


def noisy_log(seed: int, n: int, dt: float, N: float) -> Log:
    """A log whose noise is ten times as large from its middle on."""
    rng = np.random.default_rng(seed)
    level = np.where(np.arange(n) < n // 2, 1.0, 10.0) * N / np.sqrt(dt)
    bias = make("gauss_markov", sigma=0.02, tau=1.0).simulate(np.arange(n) * dt, rng)
    return Log(np.arange(n) * dt, {"gyro_x": Channel(bias + level * rng.standard_normal(n), "rad/s")})


@pytest.mark.long
def test_the_emitted_filter_returns_to_its_band() -> None:
    dt, N = 0.01, 1e-3
    program, _ = emitted(dt, N)
    log = noisy_log(7, 5000, dt, N)
    plain = run(program, log).sensors["rest"].nis
    same = run(program, log, wrap=lambda c: adapted(c, rule_named("kf"))).sensors["rest"].nis
    assert same == pytest.approx(plain, rel=1e-12)
    assert BAND[0] < plain[1500:2500].mean() < BAND[1]
    assert plain[-1000:].mean() > 50.0
    for name in R_RULES:
        nis = run(program, log, wrap=lambda c, n=name: adapted(c, rule_named(n))).sensors["rest"].nis
        assert BAND[0] < nis[-1000:].mean() < BAND[1], name


@pytest.mark.parametrize("name", ["iae", "shafkf-r", "iae-q"])
def test_both_filters_adapt_alike(name: str) -> None:
    """The emitted filter has a constant bias beside: known to be zero it leaves the filter of one channel."""
    dt, N = 0.01, 1e-3
    program, model = emitted(dt, N)
    log = noisy_log(1, 400, dt, N)

    def wrap(c: type) -> type:
        wrapped = adapted(c, rule_named(name))
        start = wrapped.__init__

        def known(self: object) -> None:
            start(self)
            self.P = np.diag([trace if "gm" in s else 1e-18 for s in states])  # type: ignore[attr-defined]

        wrapped.__init__ = known  # type: ignore[misc]
        return wrapped

    trace = float(model.A[0, 0] ** 2 * (model.Q[0, 0] + model.R) + model.Q[0, 0])
    states = [s.name for s in program.discrete.model.states]
    ours = run_filter(log.values("gyro_x"), model, rule_named(name))
    theirs = run(program, log, wrap=wrap).sensors["rest"].nis
    assert theirs == pytest.approx(ours.nis, rel=1e-3, abs=1e-6)


# Bad input, and the command line.


@pytest.mark.parametrize(("z", "window", "words"), [
    (np.ones(10), 15, "does not fit"), (np.full(20, np.nan), 5, "does not fit"), (np.ones(20), 0, "does not fit"),
    (np.full(30, 1e200), 5, "beyond|bounds"),
])  # fmt: skip
def test_bad_records(z: Array, window: int, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run_filter(z, FIRST, rule_named("iae"), window)


def test_bad_models() -> None:
    with pytest.raises(InputError, match="singular"):
        ScalarModel(FIRST.A, FIRST.Q, FIRST.H, 0.0)
    with pytest.raises(InputError, match="no covariance"):
        ScalarModel(FIRST.A, -FIRST.Q, FIRST.H, 1.0)
    with pytest.raises(InputError, match="Known are kf, iae"):
        rule_named("magic")


def test_holes_leave_no_holes() -> None:
    y = np.random.default_rng(0).standard_normal(3000)
    y[100:130] = np.nan
    found = denoise_samples(y, 0.01, Settings("sage-husa"))
    assert np.isfinite(found.values).all()


def test_what_wanders_is_refused_and_what_swells_is_said() -> None:
    w = np.random.default_rng(6).standard_normal(5000)
    with pytest.raises(InputError, match="unit root"):
        at_rest(np.cumsum(w), Settings())
    swelling = at_rest(w * np.linspace(1.0, 3.0, 5000), Settings()).warnings
    assert any("not stationary" in s for s in swelling)
    (said,) = at_rest(w, Settings()).warnings
    assert "nothing to predict" in said
    assert not at_rest(np.asarray(lfilter([1.0], [1.0, -0.5], w)), Settings()).warnings


def write(path: Path, y: Array) -> Path:
    text = "\n".join(f"{k / 100:.2f},{v:.7g}" for k, v in enumerate(y))
    path.write_text(f"t [s],gyro_x [deg/s]\n{text}\n", encoding="utf-8")
    return path


def test_denoise_from_the_command_line(kfgen: Call, tmp_path: Path) -> None:
    y = 0.3 + 0.1 * np.random.default_rng(1).standard_normal(4000)
    log, out, js = write(tmp_path / "log.csv", y), tmp_path / "out.csv", tmp_path / "a.json"
    result = kfgen("denoise", log, "--filter", "kf", "-o", out, "--json", js, "--report", tmp_path / "p.html")
    assert result.exit_code == 0, result.output
    assert "do not use it as a denoiser" in result.stdout
    answer = json.loads(js.read_text())["channels"]["gyro_x"]
    assert answer["cost"]["dc"] < 0.01
    assert np.rad2deg(answer["level"]) == pytest.approx(0.3, abs=0.01)
    filtered = np.loadtxt(out, delimiter=",", skiprows=1)
    assert filtered.shape == (4000, 2)
    assert filtered[:, 1].std() < 0.01 * y.std()
    assert "svg" in (tmp_path / "p.html").read_text()


def test_a_moving_log_takes_its_noise_from_rest(kfgen: Call, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rest = write(tmp_path / "rest.csv", 0.1 * rng.standard_normal(2000))
    moving = write(tmp_path / "m.csv", np.cumsum(rng.standard_normal(2000)))
    refused = kfgen("denoise", moving)
    assert refused.exit_code == 2
    assert "--at-rest" in str(refused.exception)
    assert kfgen("denoise", moving, "--at-rest", rest, "--filter", "iae").exit_code == 0


@pytest.mark.parametrize("words", [
    ("--filter", "magic"), ("--window", 100000), ("--order", "2"), ("--order", "0,0"), ("--ratio", -1),
    ("--estimator", "burg"), ("--channels", "gyro_z"),
])  # fmt: skip
def test_options_that_cannot_be(kfgen: Call, tmp_path: Path, words: tuple[str, object]) -> None:
    log = write(tmp_path / "log.csv", np.random.default_rng(1).standard_normal(1000))
    result = kfgen("denoise", log, *words, "-o", tmp_path / "out.csv")
    assert result.exit_code == 2, result.output
    assert not (tmp_path / "out.csv").exists()
    assert kfgen("denoise", log, "-o", log).exit_code == 2


def test_run_adapts_from_the_command_line(kfgen: Call, tmp_path: Path) -> None:
    noise = tmp_path / "n.toml"
    noise.write_text(
        'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\neffects = [{effect="white_noise", N="0.01 deg/s/sqrt(Hz)"}]\n'
    )
    log = write(tmp_path / "log.csv", np.random.default_rng(0).standard_normal(2000))  # ten times that noise
    mean = {}
    for name in ("kf", "iae"):
        js = tmp_path / f"{name}.json"
        result = kfgen("run", "gyro-static", log, "--noise", noise, "--adaptive", name, "--json", js)
        assert result.exit_code == 0, result.output
        mean[name] = json.loads(js.read_text())["sensors"]["rest"]["mean_nis"]
    assert mean["kf"] > 50.0
    assert mean["iae"] == pytest.approx(1.0, abs=0.1)
    assert kfgen("run", "gyro-static", log, "--adaptive", "magic").exit_code == 2


@pytest.mark.long
def test_the_order_is_chosen_by_akaike(kfgen: Call, tmp_path: Path) -> None:
    """An AR(2) far from an AR(1): every order that has it in it is better than those that lack it."""
    y = lfilter([1.0], [1.0, -0.5, 0.4], np.random.default_rng(3).standard_normal(3000))
    js = tmp_path / "a.json"
    result = kfgen("denoise", write(tmp_path / "log.csv", y), "--filter", "kf", "--order", "auto", "--json", js,
                   "--report", tmp_path / "p.html")  # fmt: skip
    assert result.exit_code == 0, result.output
    answer = json.loads(js.read_text())["channels"]["gyro_x"]
    assert answer["aic"]["2,0"] < answer["aic"]["1,0"] - 0.1
    assert min(answer["aic"].values()) > answer["aic"]["2,0"] - 10.0 / 3000
    assert "partial autocorrelation" in (tmp_path / "p.html").read_text()
