"""Proves that a fleet's population is what meta-analysis says it is, and that no log spoils the others.

Published: the vaccine trials of Colditz 1994 (13 trials; DerSimonian-Laird and Q-profile of logarithmic odds ratios
and risk ratios as metafor prints them), Rosner's 1983 example of three outliers in 54. Independent:
`statsmodels.stats.meta_analysis`. Limits: Student's law where errors vanish. Monte Carlo, fixed seeds: 95 %
intervals in 300 populations are accepted where the binomial at 95 % holds 99.9 % (at least 272); outliers named at a
nominal 5 % in 300 populations without one at most 31 times (binomial at 5 %: 0.02 % beyond, and Rosner's procedure
is nominal to a few tenths only for a dozen of sensors). The end-to-end fleet is one draw with a known spread: its
interval covers it with 95 %.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.stats import t as student
from typer.testing import Result

from kfgen.core.errors import InputError
from kfgen.effects.noise_model import read_noise
from kfgen.fleet import worker
from kfgen.fleet.answer import Estimated, FoundEffect, LogAnswer
from kfgen.fleet.pooling import pooled
from kfgen.fleet.population import NextSensor, outliers, population
from kfgen.fleet.result import Outcome

Array = NDArray[np.float64]
Cli = Callable[..., Result]

TRIALS = np.array(
    [
        [4, 119, 11, 128],
        [6, 300, 29, 274],
        [3, 228, 11, 209],
        [62, 13536, 248, 12619],
        [33, 5036, 47, 5761],
        [180, 1361, 372, 1079],
        [8, 2537, 10, 619],
        [505, 87886, 499, 87892],
        [29, 7470, 45, 7232],
        [17, 1699, 65, 1600],
        [186, 50448, 141, 27197],
        [5, 2493, 3, 2338],
        [27, 16886, 29, 17825],
    ],
    float,
)
"""Ill and well with the vaccine, ill and well without."""
ROSNER = (
    "-0.25 0.68 0.94 1.15 1.20 1.26 1.26 1.34 1.38 1.43 1.49 1.49 1.55 1.56 1.58 1.65 1.69 1.70 1.76 1.77 1.81 1.91 "
    "1.94 1.96 1.99 2.06 2.09 2.10 2.14 2.15 2.23 2.24 2.26 2.35 2.37 2.40 2.47 2.54 2.62 2.64 2.90 2.92 2.92 2.93 "
    "3.21 3.26 3.30 3.59 3.68 4.30 4.64 5.34 5.42 6.01"
)


def odds() -> tuple[Array, Array]:
    a, b, c, d = TRIALS.T
    return np.log(a * d / (b * c)), np.sqrt(1 / a + 1 / b + 1 / c + 1 / d)


def risks() -> tuple[Array, Array]:
    a, b, c, d = TRIALS.T
    return np.log(a / (a + b) / (c / (c + d))), np.sqrt(1 / a - 1 / (a + b) + 1 / c - 1 / (c + d))


@pytest.mark.parametrize(
    ("trials", "variance", "mean", "error", "variance95"),
    [
        (odds, 0.3663, -0.7474, 0.1923, (0.1302, 1.1812)),
        (risks, 0.3088, -0.7141, 0.1787, (0.1197, 1.1115)),
    ],
)
def test_published_trials(
    trials: Callable[[], tuple[Array, Array]],
    variance: float,
    mean: float,
    error: float,
    variance95: tuple[float, float],
) -> None:
    p = population(*trials())
    assert [p.spread**2, p.mean, p.error] == pytest.approx([variance, mean, error], abs=1e-4)
    assert [v**2 for v in p.spread95] == pytest.approx(variance95, abs=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_independent_tool(seed: int) -> None:
    """The interval of the mean is Knapp and Hartung's, but never narrower than without their factor."""
    meta = pytest.importorskip("statsmodels.stats.meta_analysis")
    rng = np.random.default_rng(seed)
    s = 0.1 * np.exp(rng.uniform(-1.0, 1.0, 6))
    y = 1.0 + 0.3 * rng.standard_normal(6) + s * rng.standard_normal(6)
    found = meta.combine_effects(y, s**2, method_re="chi2", use_t=True)
    p = population(y, s)
    assert p.spread**2 == pytest.approx(found.tau2, rel=1e-9)
    plain, scaled = (found.conf_int()[k] for k in (1, 3))
    assert p.mean95 == pytest.approx(max(plain, scaled, key=lambda ci: float(ci[1] - ci[0])), rel=1e-6)


def test_rosners_example() -> None:
    y = np.array([float(v) for v in ROSNER.split()])
    found = outliers(y, np.full(y.size, 1e-6), 0.05)
    assert sorted(float(y[a.index]) for a in found) == [5.34, 5.42, 6.01]


def test_two_outliers_do_not_hide_each_other() -> None:
    y = np.array([0.0, 0.1, -0.1, 0.05, -0.05, 0.02, -0.08, 0.07, 3.0, 3.1])
    assert {a.index for a in outliers(y, np.full(10, 0.01), 0.01)} == {8, 9}


def test_ahead_is_students_law_without_errors() -> None:
    y = np.random.default_rng(1).standard_normal(7)
    wide = y.std(ddof=1) * np.sqrt(1 + 1 / 7)
    ahead = NextSensor.of(y, np.full(7, 1e-6))
    quantile = student.ppf(0.975, 6)
    assert ahead.interval() == pytest.approx(
        (y.mean() - quantile * wide, y.mean() + quantile * wide), rel=1e-3
    )
    for z in (1.0, 3.0, 10.0):
        assert ahead.p_value(y.mean() + z * wide, 0.0) == pytest.approx(2 * student.sf(z, 6), rel=3e-3)


@pytest.mark.long
@pytest.mark.parametrize(("k", "spread"), in_part([(12, 0.1), (5, 0.1), (12, 1.0)]))
def test_intervals_and_alarms(k: int, spread: float) -> None:
    """Sensors known to 4 to 27 %, a spread of 10 % or 100 %."""
    rng, hits = np.random.default_rng([k, int(10 * spread)]), np.zeros(4, int)
    for _ in range(300):
        s = 0.1 * np.exp(rng.uniform(-1.0, 1.0, k))
        y = 1.0 + spread * rng.standard_normal(k) + s * rng.standard_normal(k)
        following = 1.0 + spread * rng.standard_normal()
        p = population(y, s)
        hits += [
            p.mean95[0] <= 1.0 <= p.mean95[1],
            p.spread95[0] <= spread <= p.spread95[1],
            p.next95[0] <= following <= p.next95[1],
            bool(outliers(y, s, 0.05)),
        ]
    assert (hits[:3] >= 272).all(), hits
    assert hits[3] <= 31, hits


def test_few_sensors() -> None:
    """Of one sensor no spread is known, of two no outlier and no next."""
    one, two = population(np.array([2.0]), np.array([0.1])), population(np.array([1.0, 2.0]), np.full(2, 0.1))
    assert one.mean == 2.0
    assert one.spread95 == (0.0, np.inf)
    assert two.spread == pytest.approx(np.sqrt(0.5 - 0.01))
    assert two.next95 == (-np.inf, np.inf)
    assert outliers(np.array([0.0, 0.0, 9.0]), np.full(3, 0.1), 0.5) == []


# Answers put together.


def answer(
    value: float, unit: str = "rad/s", effect: str = "white_noise", channel: str = "gyro_x"
) -> LogAnswer:
    N = Estimated(value, value / 1.02, value * 1.02, f"{unit}/sqrt(Hz)")
    return LogAnswer((FoundEffect(channel, effect, {"N": N}),), {channel: unit})


def some(n: int = 6) -> list[Outcome]:
    return [Outcome(f"{k}.csv", f"sum{k}", answer(1e-4 * (1.0 + 0.05 * k))) for k in range(n)]


def test_order_does_not_matter() -> None:
    outcomes = [*some(), Outcome("bad.csv", error="no rows")]
    turned = pooled(outcomes[::-1])
    assert turned == pooled(outcomes)
    assert [o.log for o in turned.failed] == ["bad.csv"]


def test_other_unit_is_left_out() -> None:
    outcomes = [*some(), Outcome("a.csv", "x", answer(1.0, "m/s^2"))]
    made = pooled(outcomes)
    assert [o.log for o in made.failed] == ["a.csv"]
    assert "m/s^2" in made.failed[0].error
    with pytest.raises(InputError, match="not of one kind"):
        pooled([some()[0], outcomes[-1]])


def test_same_file_counts_once() -> None:
    made = pooled([*some(), replace(some()[0], log="copy.csv")])
    assert [o.error for o in made.failed] == ["the same file as 0.csv"]


def test_nothing_left() -> None:
    with pytest.raises(InputError, match="none of 1 logs"):
        pooled([Outcome("bad.csv", error="no rows")])


def test_tallies() -> None:
    made = pooled([*some(), Outcome("q.csv", "q", answer(1e-4, effect="quantisation"))])
    kinds = {t.effect: (t.kind, len(t.logs), t.of) for t in made.effects}
    assert kinds == {"white_noise": ("some", 6, 7), "quantisation": ("one-off", 1, 7)}
    assert {t.kind for t in pooled(some()).effects} == {"common"}


def test_what_belongs_to_a_record_has_no_population() -> None:
    def step(k: int) -> LogAnswer:
        given = {n: Estimated(1.0 + k, 0.9 + k, 1.1 + k, u) for n, u in (("size", "rad/s"), ("time", "s"))}
        return LogAnswer((FoundEffect("gyro_x", "bias_step", given),), verdict="effects_found")

    made = pooled([Outcome(f"{k}.csv", f"sum{k}", step(k)) for k in range(5)])
    assert [s.population for s in made.numbers] == [None, None]


# The command.

SPREAD, N = 0.2, 0.005


def write(path: Path, size: float, seed: int, unit: str = "deg/s") -> None:
    y = 0.3 + size * np.sqrt(100.0) * np.random.default_rng(seed).standard_normal(3000)
    rows = np.column_stack([np.arange(y.size) / 100.0, y])
    np.savetxt(path, rows, delimiter=",", header=f"t [s],gyro_x [{unit}]", comments="", fmt="%.9g")


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Nine sensors whose white noise spreads by `SPREAD` in its logarithm, and a tenth that is four times as loud."""
    sizes = N * np.exp(SPREAD * np.random.default_rng(11).standard_normal(9))
    for k, size in enumerate([*sizes, 4.0 * N]):
        write(tmp_path / f"s{k}.csv", float(size), k)
    return tmp_path


@pytest.mark.long
def test_fleet_of_logs(kfgen: Cli, logs: Path) -> None:
    page, data, noise = logs / "f.html", logs / "f.json", logs / "typical.toml"
    done = kfgen("fleet", logs / "s*.csv", "--jobs", 1, "--json", data, "--report", page, "-o", noise)
    assert done.exit_code == 0, done.output
    out = json.loads(data.read_text())
    assert out["format"] == "kfgen-fleet-1"
    number = next(n for n in out["numbers"] if n["parameter"] == "N")
    lo, hi = number["population"]["spread_ci95"]
    assert lo <= SPREAD <= hi
    si = np.pi / 180.0
    lo, hi = number["population"]["median_ci95"]
    assert lo <= N * si <= hi
    assert [Path(o["log"]).name for o in out["outliers"]] == ["s9.csv"]
    assert "s9.csv is not like the others" in done.stdout
    assert "<svg" in page.read_text()
    term = read_noise(noise).channel("gyro_x").terms[0]
    assert term.effect.name == "white_noise"
    lo, hi = term.ci95["N"]
    assert lo < N * si < hi
    assert hi / lo > np.exp(2 * 1.96 * 0.5 * SPREAD)  # the next sensor, and not the median


def test_the_table_of_a_fleet(kfgen: Cli, logs: Path) -> None:
    """Read back by pyarrow: every number of the JSON, and the log that failed with its reason."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow of the extra parquet is not installed")
    (logs / "s_bad.csv").write_text("t [s],gyro_x [deg/s]\n0,1\n1,x\n2,3\n")
    out, data = logs / "f.parquet", logs / "f.json"
    done = kfgen("fleet", logs / "s[0-1_]*.csv", "--jobs", 1, "--table", out, "--json", data)
    assert done.exit_code == 1, done.output  # a log failed
    rows = parquet.read_table(out).to_pylist()
    wanted = {
        (v["log"], n["parameter"], v["value"], v["outlier"])
        for n in json.loads(data.read_text())["numbers"]
        for v in n["values"]
    }
    assert {(r["log"], r["parameter"], r["value"], r["outlier"]) for r in rows if not r["error"]} == wanted
    (bad,) = (r for r in rows if r["error"])
    assert Path(bad["log"]).name == "s_bad.csv"
    assert "line 3" in bad["error"]


def test_a_cluster_of_two_workers(kfgen: Cli, logs: Path) -> None:
    """The same answer as that of this machine, every log once."""
    distributed = pytest.importorskip("distributed", reason="distributed of the extra fleet is not installed")
    names = sorted(logs.glob("s[0-1].csv"))
    here, far = logs / "here.json", logs / "far.json"
    how = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**how, protocol="tcp") as cluster:
        done = kfgen("fleet", *names, "--scheduler", cluster.scheduler_address, "--json", far)
    assert done.exit_code == 0, done.output
    assert kfgen("fleet", *names, "--jobs", 1, "--json", here).exit_code == 0
    assert far.read_text() == here.read_text()
    assert [Path(o["log"]).name for o in json.loads(far.read_text())["logs"]] == [n.name for n in names]


@pytest.mark.long
def test_processes_and_order(kfgen: Cli, logs: Path) -> None:
    names = sorted(logs.glob("s[0-3].csv"))
    first, second = logs / "a.json", logs / "b.json"
    assert kfgen("fleet", *names, "--jobs", 1, "--json", first).exit_code == 0
    assert kfgen("fleet", *names[::-1], "--jobs", 2, "--json", second).exit_code == 0
    assert first.read_text() == second.read_text()


@pytest.mark.long
def test_gap_over_a_fleet(kfgen: Cli, tmp_path: Path) -> None:
    """A line in each of three sensors, of the same frequency; what is assumed is white noise."""
    for k in range(3):
        t = np.arange(6000) / 50.0
        y = 0.05 * np.random.default_rng(k).standard_normal(t.size) + 0.02 * np.sin(2 * np.pi * 3.3 * t + k)
        np.savetxt(
            tmp_path / f"{k}.csv",
            np.column_stack([t, y]),
            delimiter=",",
            header="t [s],gyro_x [deg/s]",
            comments="",
            fmt="%.9g",
        )
    (tmp_path / "model.toml").write_text(
        'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\n'
        f'effects = [ {{ effect = "white_noise", N = "{0.05 / np.sqrt(50.0)} deg/s/sqrt(Hz)" }} ]\n'
    )
    done = kfgen("fleet", tmp_path / "*.csv", "--model", tmp_path / "model.toml", "--jobs", 1, "--json", "-")
    out = json.loads(done.stdout)
    assert out["task"] == "gap"
    assert [o["verdict"] for o in out["logs"]] == ["effects_found"] * 3
    assert [(e["effect"], e["kind"], e["found_in"]) for e in out["effects"]] == [("sinusoid", "common", 3)]
    frequency = next(n for n in out["numbers"] if n["parameter"] == "frequency")
    assert frequency["population"]["median"] == pytest.approx(3.3, rel=1e-3)


@pytest.mark.long
def test_a_bad_log_does_not_stop_the_others(kfgen: Cli, logs: Path) -> None:
    (logs / "s5.csv").write_text("rubbish\n")
    write(logs / "s6.csv", 0.005, 99, "m/s^2")
    data = logs / "f.json"
    done = kfgen("fleet", logs / "s*.csv", "--jobs", 1, "--json", data)
    assert done.exit_code == 1
    assert "8 logs were identified; 2 could not be used" in done.stdout
    failed = {Path(o["log"]).name: o["error"] for o in json.loads(data.read_text())["logs"] if "error" in o}
    assert set(failed) == {"s5.csv", "s6.csv"}
    assert "m/s^2" in failed["s6.csv"]


def test_bad_input(kfgen: Cli, logs: Path) -> None:
    def refused(*words: object) -> str:
        done = kfgen("fleet", *words)
        assert done.exit_code == 2
        return str(done.exception)

    assert "no file matches" in refused(logs / "nothing*.csv")
    assert "no such" in refused(logs / "s*.csv", "--model", logs / "none.toml").lower()
    assert "typical" in refused(logs / "s0.csv", "--model", "gyro-static", "-o", logs / "x.toml")
    before = (logs / "s0.csv").read_bytes()
    assert "overwrite" in refused(logs / "s*.csv", "-o", logs / "s0.csv")
    assert "Name it .parquet" in refused(logs / "s0.csv", "--table", logs / "x.txt")
    assert (logs / "s0.csv").read_bytes() == before


def test_defect_in_one_log(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A defect of the program that one log meets is reported with that log."""

    def broken(task: worker.LogTask) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(worker, "_identified", broken)
    assert "ZeroDivisionError" in worker.work(worker.LogTask(str(logs / "s0.csv"))).error


def test_cluster_that_is_not_there(kfgen: Cli, logs: Path) -> None:
    """Without the extra it is said what to install, with it that nobody answers."""
    done = kfgen("fleet", logs / "s0.csv", "--scheduler", "tcp://127.0.0.1:9")
    assert done.exit_code == 2
    assert "kfgen[fleet]" in str(done.exception) or "no scheduler answers" in str(done.exception)
