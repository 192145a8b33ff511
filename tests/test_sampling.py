"""Proves that times as they were logged become evidence: even, gappy or uneven, said in words, and never changed.

Records of white noise of standard deviation one are made in plain numpy with fixed seeds. An estimate is held to
four of its Cramer-Rao bounds, 1/sqrt(2 n) for one standard deviation (chance 6e-5 a case), or to its own 95 %
interval widened twofold (9e-5).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.kalman import Exact
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.sampling import evidence
from kfgen.identify.identify import Identified, identify

Array = NDArray[np.float64]
N_SAMPLES, DT = 6000, 0.01
T = np.arange(N_SAMPLES) * DT


def noise(seed: int, n: int = N_SAMPLES) -> Array:
    return np.random.default_rng([seed, 9]).standard_normal(n)


def N_of(found: Identified) -> float:
    first: Any = found.fit.effects[0]
    return float(first.N)


def holds(found: Identified, N: float, times: float = 2.0) -> bool:
    """Whether the interval, so many times as wide, holds N."""
    lo, hi = np.log(found.intervals[0, "N"])
    return bool(abs(np.log(N_of(found) / N)) < 0.5 * times * (hi - lo))


# What the evidence is.


@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_an_even_record_stays_a_record(start: float) -> None:
    y = noise(0)
    got, said = evidence(start + T, y)
    assert isinstance(got, Record)
    assert said == ()
    assert got.dt == pytest.approx(DT, rel=1e-6)
    np.testing.assert_array_equal(got.y, y)


def with_runs(y: Array) -> tuple[Array, Array]:
    y = y.copy()
    y[1000:1600] = np.nan
    y[7] = np.nan
    return T, y


def with_gap(y: Array) -> tuple[Array, Array]:
    keep = (T < 10.0) | (T >= 22.0)
    return T[keep], y[keep]


def with_drops(y: Array) -> tuple[Array, Array]:
    keep = np.random.default_rng(1).random(y.size) > 0.01
    return T[keep], y[keep]


MISSING: dict[str, tuple[Callable[[Array], tuple[Array, Array]], tuple[str, ...]]] = {
    "runs": (with_runs, ("601 samples are not a number", "2 runs", "longest of 600", "t = 10 s")),
    "gap": (with_gap, ("1200 samples missing", "t = 9.99 s")),
    "drops": (with_drops, ("gaps", "samples missing")),
}


@pytest.mark.parametrize("case", MISSING)
def test_what_is_missing_is_said_and_left_missing(case: str) -> None:
    made, words = MISSING[case]
    t, y = made(noise(1))
    got, said = evidence(t, y)
    assert isinstance(got, Exact)
    assert got.dt == pytest.approx(DT, rel=1e-9)
    assert all(w in " ".join(said) for w in words)
    there = np.isfinite(y)
    np.testing.assert_array_equal(got.t, t[there])
    np.testing.assert_array_equal(got.y, y[there])
    found = identify(got, ["white_noise"])
    assert abs(np.log(N_of(found) / 0.1)) < 4 / np.sqrt(2 * there.sum())
    assert holds(found, 0.1)


def test_the_count_of_dropped_samples_is_right() -> None:
    t, y = with_drops(noise(1))
    _, (said,) = evidence(t, y)
    assert f"{round((t[-1] - t[0]) / DT) + 1 - t.size} samples missing" in said


def test_the_effects_are_chosen_on_a_gappy_record_too() -> None:
    """White noise alone stays alone, and the answer counts its samples."""
    t, y = with_gap(noise(2))
    found = identify(evidence(t, y)[0])
    assert [e.name for e in found.fit.effects] == ["white_noise"]
    assert holds(found, 0.1)
    assert found.record.n == y.size


@pytest.mark.parametrize(("deviation", "is_said"), [(0.02, False), (0.07, True)])
def test_jitter_is_said_above_five_percent(deviation: float, is_said: bool) -> None:
    """Steps err by sqrt 2 of what each time does: 2.8 % and 9.9 %."""
    t = T + DT * deviation * np.random.default_rng(2).standard_normal(T.size)
    got, said = evidence(t, noise(3))
    assert isinstance(got, Record)
    assert [("jitter" in w and "9.9 %" in w) for w in said] == [True] * is_said
    assert abs(np.log(N_of(identify(got, ["white_noise"])) / 0.1)) < 4 / np.sqrt(2 * T.size)


@pytest.mark.parametrize("other", ["jitter", "nan"])
def test_gaps_are_said_beside_something_else(other: str) -> None:
    t, y = with_gap(noise(4))
    if other == "jitter":
        t = t + DT * 0.07 * np.random.default_rng(2).standard_normal(t.size)
    else:
        y = y.copy()
        y[100] = np.nan
    said = " ".join(evidence(t, y)[1])
    assert "gap" in said


@pytest.mark.parametrize(
    "n",
    [
        600,
        3000,
    ],
)
def test_random_times_keep_the_deviation_of_a_sample(n: int) -> None:
    """At Poisson times a sample has the variance N^2 over the period that is stated, whatever that period."""
    t = np.cumsum(np.random.default_rng(4).exponential(DT, n))
    got, said = evidence(t, noise(5, n))
    assert isinstance(got, Exact)
    assert any("jitter" in w for w in said)
    found = identify(got, ["white_noise"])
    assert abs(np.log(N_of(found) / np.sqrt(got.dt))) < 4 / np.sqrt(2 * n)
    assert not any("low-pass" in w for w in found.warnings)
    assert holds(found, float(np.sqrt(got.dt)))


# What is refused.


@pytest.mark.parametrize("ratio", [0.5, 0.8, 1.2, 2.0])
@pytest.mark.parametrize("share", [0.21, 0.5, 0.93])
@pytest.mark.parametrize("jitter", [0.0, 0.02])
def test_a_step_of_the_rate_is_refused(ratio: float, share: float, jitter: float) -> None:
    """Both rates and the time, each within 2 % (of the record for the time)."""
    m = int(share * T.size)
    t = np.concatenate([T[:m], T[m - 1] + DT * ratio * np.arange(1, T.size - m + 1)])
    t = t + DT * jitter * np.random.default_rng(3).standard_normal(t.size)
    with pytest.raises(InputError, match="sampling rate changes") as caught:
        evidence(t, noise(6))
    words = caught.value.what.replace("=", " ").split()
    numbers = [float(w) for w in words if w.replace(".", "").isdigit()]
    assert numbers[0] == pytest.approx(100.0, rel=0.02)
    assert numbers[1] == pytest.approx(100.0 / ratio, rel=0.02)
    assert numbers[2] == pytest.approx(T[m - 1], abs=0.02 * t[-1])
    assert "Cut the log" in str(caught.value.remedy)
    assert "--rate" in str(caught.value.remedy)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_rows_that_are_missing_are_no_change_of_the_rate(share: float) -> None:
    kept = np.random.default_rng(11).random(2000) > share
    got, said = evidence(T[:2000][kept], noise(12, 2000)[kept])
    assert got.dt == pytest.approx(DT, rel=1e-3)
    (sentence,) = said
    assert "of the samples are missing, all along the log, at a rate of 100 Hz" in sentence
    assert holds(identify(got, ["white_noise"]), 0.1)


def test_a_refusal_for_uneven_time_names_the_rate() -> None:
    t = np.cumsum(np.random.default_rng(13).exponential(DT, 12_000))
    with pytest.raises(InputError, match="uneven times") as caught:
        evidence(t, noise(14, 12_000))
    assert "--rate" in str(caught.value.remedy)


def sparse(y: Array) -> Array:
    y = y.copy()
    y[np.random.default_rng(6).random(y.size) < 0.95] = np.nan
    return y


REFUSED: dict[str, tuple[Array, Array, str]] = {
    "all missing": (T, np.full(T.size, np.nan), "6000 of 6000 samples are not a number"),
    "two samples": (T[:2], noise(7)[:2], "2 samples are too few"),
    "constant": (T, np.full(T.size, 3.0), "never changes"),
    "95 % missing": (T, sparse(noise(7)), "of 6000 samples are not a number"),
    "too few are left": (
        T[:200],
        np.where(np.arange(200) % 4, np.nan, noise(7)[:200]),
        "50 samples are too few",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_hopeless_records_are_refused_with_a_remedy(case: str) -> None:
    t, y, words = REFUSED[case]
    with pytest.raises(InputError, match=words) as caught:
        identify(evidence(t, y)[0])
    assert caught.value.remedy


def write(path: Path, t: Array, y: Array) -> Path:
    with path.open("w") as out:
        np.savetxt(out, np.column_stack([t, y]), "%.17g", ",", header="t [s],gyro_x [rad/s]", comments="")
    return path


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
        assert "Traceback" not in err
        assert err.startswith("kfgen: ")
        assert err.count("\n") == 1
        return err

    return call


@pytest.mark.parametrize("case", REFUSED)
def test_the_command_line_refuses_them_in_one_line(
    case: str, refused: Callable[..., str], tmp_path: Path
) -> None:
    t, y, words = REFUSED[case]
    said = refused("identify", write(tmp_path / "a.csv", t, y))
    assert words in said
    assert "gyro_x" in said


def test_the_command_line_refuses_a_step_of_the_rate(refused: Callable[..., str], tmp_path: Path) -> None:
    t = np.concatenate([T[:3000], T[2999] + 2 * DT * np.arange(1, 3001)])
    said = refused("identify", write(tmp_path / "a.csv", t, noise(6)))
    assert "from 100 Hz to 50 Hz" in said


# Several logs of one sensor.

NAMES = ["white_noise", "gauss_markov"]
TRUTH = (1.0, 1.5, 4.0)


def log_of(seed: int, offset: float = 0.0, n: int = 3000, dt: float = 0.1) -> Record:
    """White noise of N = 1 with a Gauss-Markov process from a stationary start."""
    rng = np.random.default_rng([seed, 21])
    e = np.exp(-dt / TRUTH[2])
    x = np.empty(n)
    x[0] = TRUTH[1] * rng.standard_normal()
    for i, w in enumerate(rng.standard_normal(n - 1)):
        x[i + 1] = e * x[i] + TRUTH[1] * np.sqrt(1 - e * e) * w
    return Record(np.arange(n) * dt, offset + x + TRUTH[0] / np.sqrt(dt) * rng.standard_normal(n))


def values(found: Identified) -> Array:
    e: Any = found.fit.effects
    return np.array([e[0].N, e[1].sigma, e[1].tau])


@pytest.fixture(scope="module")
def four() -> Identified:
    return identify(JointRecord(tuple(log_of(s) for s in range(4))), NAMES)


def test_four_logs_know_four_times_as_much(four: Identified) -> None:
    """At the same parameters the information adds up: every bound falls by two (and by sqrt 2 for two)."""
    from kfgen.identify.fit.bounds import relative_bound

    effects = [make("white_noise", N=1.0), make("gauss_markov", sigma=1.5, tau=4.0)]
    one, two, all4 = (np.array(list(relative_bound(effects, 0.1, *[3000] * k).values())) for k in (1, 2, 4))
    np.testing.assert_allclose(one / two, np.sqrt(2.0), rtol=1e-9)
    np.testing.assert_allclose(one / all4, 2.0, rtol=1e-9)
    # Of white noise alone it is 1/sqrt(2 (n - 1) k): of n - 1 differences.
    alone = relative_bound([make("white_noise", N=1.0)], 0.1, *[3000] * 4)[0, "N"]
    assert alone == pytest.approx(1 / np.sqrt(2 * 2999 * 4), rel=1e-3)
    widths = np.log([hi / lo for lo, hi in four.intervals.values()])
    single = np.log([hi / lo for lo, hi in identify(log_of(0), NAMES).intervals.values()])
    assert single[0] / widths[0] == pytest.approx(2.0, rel=0.15)
    assert (single[1:] / widths[1:] > 1.4).all()


def test_the_estimate_of_four_logs_is_that_much_better(four: Identified) -> None:
    """Within four bounds, each parameter; and its stated bound is the theory's."""
    bounds = np.array(list(four.bounds.values()))
    assert (np.abs(np.log(values(four) / TRUTH)) < 4 * bounds).all()
    assert bounds[0] < 0.0105  # 1 / sqrt(24000) = 0.0065 for white noise alone, and the other term's share


def test_the_constants_of_logs_are_their_own(four: Identified) -> None:
    """Each was switched on anew: a turn-on bias in each is no drift."""
    shifted = identify(JointRecord(tuple(log_of(s, 1e3 * s * (-1) ** s) for s in range(4))), NAMES)
    np.testing.assert_allclose(values(shifted), values(four), rtol=1e-3)
    white = [Record(T, 40.0 * s + noise(30 + s)) for s in range(3)]
    found = identify(JointRecord(tuple(white)))
    assert [e.name for e in found.fit.effects] == ["white_noise"]
    assert abs(np.log(N_of(found) / 0.1)) < 4 / np.sqrt(2 * 3 * T.size)


def test_logs_of_different_rates_are_refused_together() -> None:
    with pytest.raises(InputError, match="50 to 100 Hz") as caught:
        JointRecord((Record(T, noise(0)), Record(2 * T, noise(1))))
    assert "separately" in str(caught.value.remedy)


def test_one_log_whose_time_stamps_drift_is_no_several_logs() -> None:
    """A period that grows by 4 % along one log: 0.67 and 3.33 % in the middles of its first and last thirds."""
    n = 1500
    t = np.cumsum(DT * (1.0 + 0.04 * np.linspace(0.0, 1.0, n)))
    whole = Record(t, noise(3, n))
    with pytest.raises(
        InputError, match=r"drifts along the log, from part to part 96\.77 to 99\.34 Hz"
    ) as caught:
        JointRecord((whole.cut(0, n // 3), whole.cut(2 * n // 3, n)))
    assert "--rate HZ" in str(caught.value.remedy)


def test_logs_of_different_lengths_are_fitted_together() -> None:
    records = tuple(Record(T[:n], noise(50 + n, n)) for n in (700, 2400, 6000))
    found = identify(JointRecord(records), ["white_noise"])
    assert abs(np.log(N_of(found) / 0.1)) < 4 / np.sqrt(2 * 9100)
    assert found.bounds[0, "N"] == pytest.approx(1 / np.sqrt(2 * 9097), rel=1e-3)


def test_the_command_line_takes_several_logs(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    logs = [write(tmp_path / f"{s}.csv", T, 5.0 * s + noise(60 + s)) for s in range(2)]
    out = tmp_path / "id.json"
    result = kfgen("identify", *logs, "--effects", "white_noise", "--json", out)
    assert result.exit_code == 0, result.output
    answer = json.loads(out.read_text())
    assert [d["log"] for d in answer["logs"]] == [str(p) for p in logs]
    assert len({d["sha256"] for d in answer["logs"]}) == 2
    channel = answer["channels"]["gyro_x"]
    (term,) = channel["effects"]
    assert term["parameters"]["N"]["value"] == pytest.approx(0.1, rel=4 / np.sqrt(4 * T.size))
    assert channel["duration_s"] == pytest.approx(2 * T.size * DT, rel=1e-6)
    assert "2 records" in result.output


def test_the_command_line_refuses_logs_that_do_not_go_together(
    refused: Callable[..., str], tmp_path: Path
) -> None:
    even = write(tmp_path / "even.csv", T, noise(1))
    slow = write(tmp_path / "slow.csv", 2 * T, noise(1))
    gappy = write(tmp_path / "gap.csv", *with_gap(noise(1)))
    assert "50 to 100 Hz" in refused("identify", even, slow)
    assert "gaps" in refused("identify", even, gappy)


def test_the_exact_likelihood_takes_one_log() -> None:
    """It must not fall back to another method in silence."""
    records = tuple(Record(T, noise(seed)) for seed in range(2))
    with pytest.raises(InputError, match="one log"):
        identify(JointRecord(records), ["white_noise"], "kalman")


def test_logs_of_different_noise_are_said_and_have_no_lines() -> None:
    """Beside the pooled spectrum the louder of two white records would be full of lines."""
    found = identify(JointRecord((Record(T, noise(1)), Record(T, 3.0 * noise(2)))), ["white_noise"])
    assert not found.lines
    said = next(w for w in found.warnings if "differ in their noise by a factor of" in w)
    assert float(said.split("factor of ")[1].split(";")[0]) == pytest.approx(3.0, rel=0.05)
