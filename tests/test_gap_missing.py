"""Rows that a log of sensors that move lacks: they become samples without numbers, and the rest is compared.

Expected values are from plain numpy: the scale that was put in, and the least standard deviation of its estimate,
that of the noise over the root of the power of what is left of the motion.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from kfgen.gap.motion.missing_rows import with_missing
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
Cli = Callable[..., Result]

DT, N, SD = 0.02, 2500, 0.002
MODEL = "format = 'kfgen-noise-1'\n" + "".join(
    f"[gyro_{a}]\nunit = 'rad/s'\neffects = [{{effect = 'white_noise', N = '{SD * DT**0.5!r} rad/s/sqrt(Hz)'}}]\n"
    for a in "xyz"
)


def columns() -> dict[str, Array]:
    """A rate table, a gyro whose second axis has a scale error of 0.2 %."""
    rng = np.random.default_rng(21)
    f, phase = rng.uniform(0.1, 2.0, (6, 3)), rng.uniform(0, 2 * np.pi, (6, 3))
    t = DT * np.arange(N)
    w = 0.4 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1)
    y = w * [1.0, 1.002, 1.0] + 0.01 + SD * rng.standard_normal((N, 3))
    found = {"t": t} | {f"gyro_{a}": y[:, i] for i, a in enumerate("xyz")}
    return found | {f"ref_gyro_{a}": w[:, i] for i, a in enumerate("xyz")}


def without(gone: list[tuple[int, int]]) -> dict[str, Array]:
    """The columns without some rows."""
    keep = np.ones(N, dtype=bool)
    for a, b in gone:
        keep[a:b] = False
    return {k: v[keep] for k, v in columns().items()}


def written(table: dict[str, Array], path: Path) -> Path:
    header = ",".join("t [s]" if k == "t" else f"{k} [rad/s]" for k in table)
    values = np.column_stack(list(table.values()))
    np.savetxt(path, values, delimiter=",", header=header, comments="", fmt="%.9f")
    return path


def test_a_scale_is_found_in_a_log_that_lacks_rows(kfgen: Cli, tmp_path: Path) -> None:
    """Three gaps of 1, 30 and 120 rows; false-alarm rate of four standard deviations 6e-5."""
    table = without([(300, 301), (900, 930), (1700, 1820)])
    log, model, out = written(table, tmp_path / "log.csv"), tmp_path / "noise.toml", tmp_path / "out.json"
    model.write_text(MODEL, encoding="utf-8")
    done = kfgen("gap", log, "--model", model, "--json", out)
    assert done.exit_code == 0, done.output
    assert "151 rows of the log are missing, in 3 gaps" in done.output
    answer = json.loads(out.read_text(encoding="utf-8"))
    assert answer["verdict"] == "effects_found"
    assert any("151 rows" in w for w in answer["warnings"])
    (step,) = answer["steps"]
    assert (step["effect"], step["channel"]) == ("scale_factor", "gyro_y")
    w = table["ref_gyro_y"]
    sd = SD / float(np.linalg.norm(w - w.mean()))
    assert step["parameters"]["coefficient"]["value"] == pytest.approx(0.002, abs=4.0 * sd)


def log_of(t: Array) -> Log:
    x = np.sin(t)
    return Log(t, {"gyro_x": Channel.of(x, "rad/s"), "temperature": Channel.of(20.0 + t, "degC")})


def test_rows_are_put_back_where_the_clock_says() -> None:
    """What was there stays; a channel has no number, a driver is interpolated; jitter of 3 % does not matter."""
    t = 0.1 * np.arange(400) + 0.003 * np.random.default_rng(2).uniform(-1, 1, 400)
    keep = np.ones(400, dtype=bool)
    keep[100:107] = keep[250] = False
    whole, said = with_missing(log_of(t[keep]))
    assert whole.n == 400
    assert whole.t[keep] == pytest.approx(t[keep], abs=1e-12)
    assert whole.t == pytest.approx(t, abs=0.007)
    assert np.isnan(whole.channels["gyro_x"].values[~keep]).all()
    assert whole.channels["gyro_x"].values[keep] == pytest.approx(np.sin(t[keep]))
    assert whole.channels["temperature"].values == pytest.approx(293.15 + t, abs=0.007)
    assert said[0].startswith("8 rows of the log are missing, in 2 gaps")


@pytest.mark.parametrize("gap", [3.4, 1.6, 900.0])
def test_a_gap_that_is_no_multiple_of_the_period_or_most_of_the_log_stays(gap: float) -> None:
    t = 0.1 * np.concatenate([np.arange(200), 199 + gap + np.arange(200)])
    log = log_of(t)
    assert with_missing(log) == (log, ())


def test_an_even_log_is_the_same() -> None:
    log = log_of(0.1 * np.arange(100))
    assert with_missing(log)[0] is log
