"""Proves that Allan curves are read right: published ones without samples, and wavelet moments of logs.

Curves come from the formulas of IEEE Std 952, written down here; records from plain numpy with fixed seeds. Chance:
an estimate stays within 4 bounds (6e-5 each); the root mean square of 20 errors of N over their bound is below 1.4
(chi-square of 20 degrees above 39.2: 0.6 %); the probabilities of 40 misfits are uniform, Kolmogorov-Smirnov above
0.1 %; a variance of 1500 logarithms has an error of 3.7 %, so that 20 % never happens by chance.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import kstest

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.identify.evidence.published import Published
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.bounds import relative_bound
from kfgen.identify.fit.fit import Problem
from kfgen.identify.identify import identify
from kfgen.identify.methods.allan_curve import by_wavelet_covariance, fit_curve

Array = NDArray[np.float64]
TAU = np.geomspace(0.01, 3000.0, 92)


# Formulas of IEEE Std 952 (docs/noise.md): Allan variances.


def white(tau: Array, N: float) -> Array:
    return N**2 / tau


def quantised(tau: Array, Q: float) -> Array:
    return 3 * Q**2 / tau**2


def walk(tau: Array, K: float) -> Array:
    return K**2 * tau / 3


def markov(tau: Array, sigma: float, Tc: float) -> Array:
    x, q2 = tau / Tc, 2 * sigma**2 / Tc
    return np.asarray(q2 * Tc**2 / tau * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x)))


def flicker(tau: Array, B: float) -> Array:
    """Far inside its band."""
    return np.full(tau.size, 2 * np.log(2) / np.pi * B**2)


CASES: dict[str, tuple[Array, list[str], dict[str, float]]] = {
    "white": (white(TAU, 0.02), ["white_noise"], {"N": 0.02}),
    "white, walk": (
        white(TAU, 0.02) + walk(TAU, 1e-3),
        ["white_noise", "rate_random_walk"],
        {"N": 0.02, "K": 1e-3},
    ),
    "white, markov": (
        white(TAU, 0.02) + markov(TAU, 5e-3, 100.0),
        ["white_noise", "gauss_markov"],
        {"N": 0.02, "sigma": 5e-3, "tau": 100.0},
    ),
    "quantised, white, walk": (
        quantised(TAU, 1.5e-3) + white(TAU, 0.02) + walk(TAU, 1e-3),
        ["white_noise", "quantisation", "rate_random_walk"],
        {"N": 0.02, "Q": 1.5e-3, "K": 1e-3},
    ),
}


def parameters(found: Any) -> dict[str, float]:
    return {p.name: float(getattr(e, p.name)) for e in found.fit.effects for p in e.estimated()}


@pytest.mark.parametrize("chosen", in_part([True, False]))
@pytest.mark.parametrize("case", in_part(CASES))
def test_a_curve_of_theory_is_recovered(case: str, chosen: bool) -> None:
    """Within 1 %, whether the effects are named or chosen; the interval holds the truth."""
    avar, names, truth = CASES[case]
    found = identify(Published.of(TAU, np.sqrt(avar)), None if chosen else names, "allan")
    assert sorted(e.name for e in found.fit.effects) == sorted(names)
    assert parameters(found) == pytest.approx(truth, rel=0.01)
    for key, (lo, hi) in found.intervals.items():
        assert lo < truth[key[1]] < hi
    assert not any("do not explain" in w for w in found.warnings)


def curve_of(y: Array) -> Published:
    """The overlapping Allan deviation of a record at 10 Hz."""
    m = np.unique(np.round(np.geomspace(1, y.size // 2, 60)).astype(int))
    return Published.of(0.1 * m, np.sqrt([overlapping(y, k) for k in m.tolist()]))


def end_of(slow: str, seed: int) -> bool:
    """Whether the random walk at the end of a curve is fitted without doubt."""
    rng, n = np.random.default_rng([171_135, seed]), 2**16
    drift = 4e-4 * 0.1 * np.arange(n) if slow == "ramp" else np.cumsum(rng.standard_normal(n)) * 2e-3
    found = identify(curve_of(rng.standard_normal(n) + drift), None, "allan")
    doubt = any("ramp" in w for w in found.warnings)
    walks = [i for i, e in enumerate(found.fit.effects) if e.name == "rate_random_walk"]
    assert doubt == any(i in found.unresolved for i in walks if slow == "ramp")
    return not doubt


@pytest.mark.long
def test_the_end_of_a_curve_may_be_a_ramp() -> None:
    """A ramp rises by tau and a random walk by its root (IEEE Std 952): the curves of 3 records of each."""
    assert not any(end_of("ramp", seed) for seed in range(3))
    assert all(end_of("walk", seed) for seed in range(8, 11))


def test_a_flicker_of_theory_is_recovered() -> None:
    """White noise on the floor 0.664 B: B within 5 %, for the band of the bank ends at the curve's ends."""
    found = identify(
        Published.of(TAU, np.sqrt(white(TAU, 0.02) + flicker(TAU, 2e-3))),
        ["white_noise", "bias_instability"],
        "allan",
    )
    got = parameters(found)
    assert got["N"] == pytest.approx(0.02, rel=0.02)
    assert got["B"] == pytest.approx(2e-3, rel=0.05)


def test_a_band_that_is_given_is_assumed() -> None:
    """A band twice as wide makes an interval twice as wide in the logarithm; a bad point's wide band lets it go."""
    deviation = np.sqrt(white(TAU, 0.02))
    widths = []
    for half in (0.05, 0.1):
        found = identify(
            Published.of(TAU, deviation, deviation * np.exp(-half), deviation * np.exp(half)),
            ["white_noise"],
            "allan",
        )
        assert parameters(found) == pytest.approx({"N": 0.02}, rel=1e-4)
        lo, hi = found.intervals[0, "N"]
        widths.append(np.log(hi / lo))
    assert widths[1] / widths[0] == pytest.approx(2.0, rel=0.01)
    # Points an octave apart, k of them, each of half width h: the mean of logarithms has h / sqrt(k).
    k = int(np.log2(TAU[-1] / TAU[0]) / np.log2(2.05)) + 1
    assert widths[0] == pytest.approx(2 * 0.05 / np.sqrt(k), rel=0.1)
    half = np.where(TAU > 300.0, 3.0, 0.02)
    bent = deviation * np.where(TAU > 300.0, 3.0, 1.0)
    found = identify(
        Published.of(TAU, bent, bent * np.exp(-half), bent * np.exp(half)), ["white_noise"], "allan"
    )
    assert parameters(found) == pytest.approx({"N": 0.02}, rel=0.005)


def test_a_curve_that_no_term_explains_is_said_so() -> None:
    """Narrow bands round a curve with a bump that is no noise."""
    deviation = np.sqrt(white(TAU, 0.02)) * (1 + 0.8 * np.exp(-0.5 * (np.log(TAU / 3.0) / 0.25) ** 2))
    found = identify(
        Published.of(TAU, deviation, 0.99 * deviation, 1.01 * deviation),
        ["white_noise", "rate_random_walk"],
        "allan",
    )
    assert any("do not explain the curve" in w for w in found.warnings)


# The command line.


def curve_file(path: Path, header: str, *columns: Array) -> Path:
    with path.open("w") as out:
        np.savetxt(out, np.column_stack(columns), "%.12g", ",", header=header, comments="")
    return path


DEG_H = np.pi / 180 / 3600


def test_the_command_line_reads_a_curve(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    avar, _, truth = CASES["white, walk"]
    path = curve_file(tmp_path / "c.csv", "tau [s],gyro_x [deg/h]", TAU, np.sqrt(avar) / DEG_H)
    out = tmp_path / "id.json"
    result = kfgen("identify", path, "--json", out)
    assert result.exit_code == 0, result.output
    channel = json.loads(out.read_text())["channels"]["gyro_x"]
    assert channel["unit"] == "rad/s"
    assert channel["duration_s"] is None
    got = {k: v["value"] for e in channel["effects"] for k, v in e["parameters"].items()}
    assert got == pytest.approx(truth, rel=0.01)


def test_the_command_line_reads_a_band(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    """Columns gyro_x_lo and gyro_x_hi are the band of gyro_x, and no channels of their own."""
    d = np.sqrt(CASES["white"][0]) / DEG_H
    names = ",".join(f"gyro_x{e} [deg/h]" for e in ("", "_lo", "_hi"))
    found = []
    for half in (0.05, 0.2):
        path = curve_file(tmp_path / "c.csv", "tau [s]," + names, TAU, d, d * np.exp(-half), d * np.exp(half))
        result = kfgen("identify", path, "--effects", "white_noise", "--json", tmp_path / "id.json")
        assert result.exit_code == 0, result.output
        channels = json.loads((tmp_path / "id.json").read_text())["channels"]
        assert list(channels) == ["gyro_x"]
        found.append(channels["gyro_x"]["effects"][0]["parameters"]["N"]["ci95"])
    assert np.log(found[1][1] / found[1][0]) == pytest.approx(4 * np.log(found[0][1] / found[0][0]), rel=0.02)


@pytest.mark.long
def test_the_values_of_a_curve_are_no_motion(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    """Allan deviations of three accelerometers fall along the curve, each in its own way: gravity does not turn."""
    d = np.sqrt(white(TAU, 0.02) + walk(TAU, 1e-3))
    axes = ",".join(f"accel_{a} [m/s^2]" for a in "xyz")
    path = curve_file(
        tmp_path / "c.csv", "tau [s]," + axes, TAU, d, 2 * np.sqrt(white(TAU, 0.02)), 3 * d**0.9
    )
    result = kfgen("identify", path)
    assert result.exit_code == 0, result.output
    assert "moved" not in result.output


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs the command line as a shell does; gives the one line of its error."""
    from kfgen.cli import main

    def call(*words: object) -> str:
        monkeypatch.setattr(sys, "argv", ["kfgen", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            main()
        out, err = capsys.readouterr()
        assert left.value.code == 2
        assert out == ""
        assert err.startswith("kfgen: ")
        assert err.count("\n") == 1
        return err

    return call


def test_bad_curves_are_refused_in_one_line(refused: Callable[..., str], tmp_path: Path) -> None:
    header, d = "tau [s],gyro_x [deg/h]", np.sqrt(CASES["white"][0]) / DEG_H
    good = curve_file(tmp_path / "good.csv", header, TAU, d)
    assert "7 points are too few" in refused(
        "identify", curve_file(tmp_path / "few.csv", header, TAU[:7], d[:7])
    )
    negative = np.where(np.arange(TAU.size) == 30, -d, d)
    assert "not positive" in refused("identify", curve_file(tmp_path / "neg.csv", header, TAU, negative))
    rising = curve_file(tmp_path / "rise.csv", header, TAU, d[::-1])
    assert "falls nowhere" in refused("identify", rising)
    for method in ("ml", "kalman"):
        assert "--method allan" in refused("identify", good, "--method", method)
    assert "Allan curve" in refused("gap", good, "--model", "ahrs6")
    assert "Allan curve" in refused("run", "ahrs6", good)
    assert "alone" in refused("identify", good, good)


@pytest.mark.parametrize(
    "bad",
    [
        np.nan,
        np.inf,
        0.0,
    ],
)
def test_a_deviation_that_is_none_is_refused(bad: float) -> None:
    d = np.sqrt(CASES["white"][0])
    d[40] = bad
    with pytest.raises(InputError):
        identify(Published.of(TAU, d), ["white_noise"], "allan")


@pytest.mark.filterwarnings("ignore:divide by zero")
@pytest.mark.parametrize(("low", "high"), [(1.1, 0.9), (0.0, 1.1)])
def test_a_band_that_does_not_hold_its_curve_is_refused(
    low: float, high: float, refused: Callable[..., str], tmp_path: Path
) -> None:
    """Low and high exchanged, or zero: no logarithm of it may be taken."""
    d = np.sqrt(CASES["white"][0]) / DEG_H
    names = ",".join(f"gyro_x{e} [deg/h]" for e in ("", "_lo", "_hi"))
    path = curve_file(tmp_path / "c.csv", "tau [s]," + names, TAU, d, low * d, high * d)
    assert "gyro_x" in refused("identify", path, "--effects", "white_noise")


# Wavelet moments.

N_SAMPLES, DT = 6000, 0.1
TRUTH = {"N": 1.0, "sigma": 1.5, "tau": 8.0}
NAMES = ["white_noise", "gauss_markov"]


def log_of(seed: int, n: int = N_SAMPLES) -> Record:
    """White noise with an exact Gauss-Markov process from a stationary start."""
    rng = np.random.default_rng([seed, 31])
    e = np.exp(-DT / TRUTH["tau"])
    w = TRUTH["sigma"] * rng.standard_normal(n)
    w[1:] *= np.sqrt(1 - e * e)
    x = lfilter([1.0], [1.0, -e], w)
    return Record(np.arange(n) * DT, x + TRUTH["N"] / np.sqrt(DT) * rng.standard_normal(n))


def test_wavelet_moments_are_near_the_bound() -> None:
    """Every estimate of 20 within 4 bounds and the root mean square of N's errors within 1.4 of its bound."""
    effects = [make("white_noise", N=1.0), make("gauss_markov", sigma=1.5, tau=8.0)]
    bounds = np.array(list(relative_bound(effects, DT, N_SAMPLES).values()))
    errors = []
    for seed in range(20):
        got = parameters(identify(log_of(seed), NAMES, "gmwm"))
        errors.append([np.log(got[k] / TRUTH[k]) for k in ("N", "sigma", "tau")])
    z = np.array(errors) / bounds
    assert (np.abs(z) < 4).all()
    rms = np.sqrt((z**2).mean(axis=0))
    assert rms[0] < 1.4
    assert (rms[1:] < 2.0).all()


def overlapping(y: Array, m: int) -> float:
    """The definition: half the mean square of the differences of adjoining means."""
    means = np.convolve(y, np.ones(m) / m, "valid")
    return 0.5 * float(np.mean((means[m:] - means[:-m]) ** 2))


def test_the_covariance_of_the_variances_is_that_of_monte_carlo() -> None:
    """White noise at octaves: standard deviations within 10 %, correlations within 0.1 (0.026 by chance)."""
    n, scales, rng = 2048, 2 ** np.arange(6), np.random.default_rng(8)
    logs = np.array(
        [[np.log(overlapping(y, int(m))) for m in scales] for y in rng.standard_normal((1500, n))]
    )
    record = Record(np.arange(n) * 1.0, rng.standard_normal(n))
    whiten = by_wavelet_covariance(record, [make("white_noise", N=1.0)])
    C = np.linalg.inv(whiten.T @ whiten)[:6, :6]
    seen = np.cov(logs.T)
    np.testing.assert_allclose(np.diag(C), np.diag(seen), rtol=0.2)
    d, s = np.sqrt(np.diag(C)), np.sqrt(np.diag(seen))
    np.testing.assert_allclose(C / np.outer(d, d), seen / np.outer(s, s), atol=0.1)


def test_the_chance_of_a_misfit_is_uniform_under_the_right_model() -> None:
    chances = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 41])
        record = Record(np.arange(8192) * DT, rng.standard_normal(8192))
        problem = Problem(record, (make("white_noise", N=0.3),))
        chances.append(fit_curve(problem, by_wavelet_covariance).chance)
    assert kstest(chances, "uniform").pvalue > 1e-3
    assert min(chances) > 1e-5


# Curves that others published.

CURVES = [f"imu_utils_{name}.csv" for name in ("16448", "A3", "gx4", "xsens")]
COLUMNS = [f"{s}_{a}" for s in ("gyr", "acc") for a in "xyz"]
NEAR = 10.0
"""Seconds beyond which a slope of -1/2 is no white noise but a vibration's far side."""


def cases() -> list[Any]:
    found = []
    for name in CURVES:
        for column in COLUMNS:
            sensor = name[10:-4]
            marks: list[Any] = []
            if not column.endswith("_x"):
                marks.append(pytest.mark.long)
            found.append(pytest.param(name, column, marks=marks, id=f"{sensor}-{column}"))
    return found


def published(path: Path, column: str) -> tuple[Array, Array]:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    names = lines[0].replace("gyro", "gyr").split(",")
    data = np.array([[float(c) for c in line.split(",")] for line in lines[1:]])
    return data[:, 0], data[:, names.index(column)]


@pytest.mark.parametrize(("name", "column"), in_part(cases()))
def test_white_noise_of_a_published_curve(name: str, column: str, recording: Callable[[str], Path]) -> None:
    """Where an octave falls as white noise does, by -1/2 within 0.03: N is the Allan deviation there, within 5 %."""
    tau, d = published(recording(f"allan_curves/{name}"), column)
    at = [0]
    for i in range(tau.size):
        if tau[i] >= 1.9 * tau[at[-1]] and tau[i] < NEAR:
            at.append(i)
    slope = np.diff(np.log(d[at])) / np.diff(np.log(tau[at]))
    k = int(np.argmin(np.abs(slope + 0.5)))
    if abs(slope[k] + 0.5) > 0.03:
        pytest.skip(f"no octave of {name} {column} falls as white noise")
    pair = [at[k], at[k + 1]]
    expected = float(np.exp(np.mean(np.log(d[pair] * np.sqrt(tau[pair])))))
    found = identify(Published.of(tau, d), None, "allan")
    assert parameters(found)["N"] == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("column", ["gyr_x", "gyr_y", "gyr_z"])
def test_quantisation_of_a_published_curve(column: str, recording: Callable[[str], Path]) -> None:
    """What N leaves at 4 and 8 ms is 3 Q^2 / tau^2, within 5 %."""
    tau, d = published(recording("allan_curves/imu_utils_gx4.csv"), column)
    got = parameters(identify(Published.of(tau, d), None, "allan"))
    at = [int(np.argmin(np.abs(tau - 0.002 * 2.0**k))) for k in (1, 2)]
    expected = np.sqrt((d[at] ** 2 - got["N"] ** 2 / tau[at]) * tau[at] ** 2 / 3)
    assert got["Q"] == pytest.approx(float(np.mean(expected)), rel=0.05)
