"""Several recordings of one sensor: what lasts is named from all of them, what happened once is said of its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray
from scipy.fft import dct

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.rest.several_recordings import JointGap, Recording, joint_gap
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT, COUNT = 4000, 0.1, 3
T = np.arange(N) * DT


def together(kind: str, seed: int) -> JointGap:
    """Three recordings of white noise of standard deviation one and something else."""
    rng, parts = np.random.default_rng(seed), []
    for k in range(COUNT):
        y = rng.standard_normal(N)
        if kind == "walk":
            y += 0.5 * np.cumsum(rng.standard_normal(N)) / np.sqrt(N)
        elif kind == "ramp":
            y += 0.4 * T / T[-1]
        elif kind == "step" and k == 1:
            y += 0.6 * (T > 170.0)
        parts.append(Recording(f"log {k}", Record(T, y)))
    return joint_gap("gyro_x", parts, ChannelNoise("rad/s", (Term(make("white_noise", N=np.sqrt(DT))),)))


@pytest.mark.long
def test_a_walk_that_goes_another_way_each_time_is_a_walk() -> None:
    """Of one realisation a ramp or a step may be named; K is 0.5 / sqrt(400 s), held to 2.5 half-widths."""
    found = together("walk", 1)
    assert [f.effect.name for f in found.gap.findings] == ["rate_random_walk"]
    lo, hi = np.log(found.gap.findings[0].ci95["K"])
    assert abs(np.log(0.5 / np.sqrt(N * DT)) - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    assert found.gap.gap.held_out == "each recording in turn"
    assert found.gap.gap.closed > 0.8


def slope_beside_walks(parts: list[Array]) -> float:
    """Standard deviation of one slope in white noise of one per sample, averaged over random walks of all sizes.

    Generalised least squares on cosine ordinates: a walk of steps of variance q has the variance ``q / 4 sin^2(w / 2)`` in
    the ordinate at w. Every size is as likely before, and weighed by its likelihood.
    """
    x, Y = dct(T, norm="ortho")[1:], np.array([dct(y, norm="ortho")[1:] for y in parts])
    of_walk = 0.25 / np.sin(0.5 * np.pi * np.arange(1, N) / N) ** 2
    logs, slopes, variances = [], [], []
    for root_q in np.linspace(0.0, 0.03, 301):
        S = 1.0 + root_q**2 * of_walk
        information = COUNT * float(np.sum(x**2 / S))
        slope = float(np.sum(x * Y / S)) / information
        logs.append(-0.5 * float(np.sum((Y - slope * x) ** 2 / S) + COUNT * np.sum(np.log(S))))
        slopes.append(slope)
        variances.append(1.0 / information)
    weight = np.exp(np.array(logs) - max(logs))
    spread = np.array(variances) + (np.array(slopes) - slopes[0]) ** 2
    return float(np.sqrt(weight @ spread / weight.sum()))


@pytest.mark.long
def test_a_ramp_comes_again_with_one_slope() -> None:
    """A straight line through all three is known to sqrt(12 / (3 N)) over the length of one, and worse beside walks.

    A walk that is too weak to be named moves a slope, so that all sizes of it are averaged (`slope_beside_walks`).
    """
    found = together("ramp", 2)
    assert [f.effect.name for f in found.gap.findings] == ["rate_ramp"]
    lo, hi = found.gap.findings[0].ci95["R"]
    assert abs(0.4 / T[-1] - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    rng = np.random.default_rng(2)
    sd = slope_beside_walks([rng.standard_normal(N) + 0.4 * T / T[-1] for _ in range(COUNT)])
    assert hi - lo == pytest.approx(2.0 * 1.96 * sd, rel=0.1)
    assert sd > 1.1 * np.sqrt(12.0 / (COUNT * N)) / (N * DT)


@pytest.mark.long
def test_a_step_in_one_is_said_of_that_one() -> None:
    """And is no part of the model."""
    found = together("step", 3)
    assert found.gap.findings == ()
    assert found.gap.updated.terms == (found.gap.updated.terms[0],)
    assert [(n, f.name) for n, g in found.alone for f in g.findings if f.once] == [("log 1", "bias_step")]


def files(folder: Path, unit: str = "rad/s") -> tuple[list[Path], Path]:
    """Two recordings, the second with a step, and the noise that is assumed about them."""
    rng, paths = np.random.default_rng(4), []
    for k in range(2):
        y = rng.standard_normal(N) + 0.7 * k * (T > 200.0)
        paths.append(folder / f"log{k}.csv")
        header = f"t [s],gyro_x [{unit if k else 'rad/s'}]"
        np.savetxt(paths[-1], np.column_stack([T, y]), delimiter=",", header=header, comments="")
    noise = folder / "noise.toml"
    effects = f'[ {{ effect = "white_noise", N = "{np.sqrt(DT)} rad/s/sqrt(Hz)" }} ]'
    noise.write_text(f'format = "kfgen-noise-1"\n[gyro_x]\nunit = "rad/s"\neffects = {effects}\n')
    return paths, noise


@pytest.mark.long
def test_the_command_says_what_happened_once(kfgen: Callable[..., Result], tmp_path: Path) -> None:
    paths, noise = files(tmp_path)
    result = kfgen(
        "gap", *paths, "--model", noise, "--json", tmp_path / "gap.json", "--report", tmp_path / "gap.html"
    )
    assert result.exit_code == 0, result.output
    answer = json.loads((tmp_path / "gap.json").read_text())
    assert answer["verdict"] == "effects_found"
    assert [(s["effect"], s["recording"]) for s in answer["steps"]] == [("bias_step", str(paths[1]))]
    assert [r["verdicts"]["gyro_x"] for r in answer["recordings"]] == ["no_gap", "effects_found"]
    assert f"Once, in {paths[1]} only" in result.output
    assert "Each recording by itself" in (tmp_path / "gap.html").read_text()


@pytest.mark.parametrize("wrong", ["twice", "proof", "unit"])
def test_what_cannot_be_compared_together_is_refused(
    kfgen: Callable[..., Result], tmp_path: Path, wrong: str
) -> None:
    paths, noise = files(tmp_path, "m/s^2" if wrong == "unit" else "rad/s")
    more = {"twice": [paths[0]], "proof": [paths[1], "--proof", paths[1]], "unit": [paths[1]]}[wrong]
    result = kfgen("gap", paths[0], *more, "--model", noise)
    assert result.exit_code != 0
    assert {"twice": "twice", "proof": "--proof", "unit": "m/s^2"}[wrong] in str(result.exception)
