"""The noise of a filter by its innovations: `kf.tune`, `kfgen run --tune`. Flights are plain numpy (`benchmarks/flight`), seeds fixed."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import kfgen as kf
from kfgen.cli.app import app
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.result import NoiseScale
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.noise.noise_file import with_sizes
from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
from kfgen.gap.flight.noise.tune import Tuning
from kfgen.gap.flight.noise.tuned import _SizeLikelihood, _sizes, groups_of
from kfgen.log.log import Channel, Log
from kfgen.model.filter import FilterModel

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
trial = pytest.importorskip("trial")
pytest.importorskip("numba")

LOUDER = {"gnss_p_N": 2.0, "gnss_p_E": 2.0, "gnss_v_D": 3.0}
"""Standard deviations of what is added, in those of the sensor's own noise."""
SD = {"gnss_p": 1.5, "gnss_v": 0.1}


@lru_cache
def model() -> FilterModel:
    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    return kf.build("ins15", options={"left_out": "false"}, sensors=sensors)


@lru_cache
def clean() -> Log:
    found: Any = trial.log_of(trial.Case("quadrotor", 5, 40.0), [])
    assert isinstance(found, Log)
    return found


@lru_cache
def loud() -> Log:
    """The clean flight with noise added to three channels."""
    rng = np.random.default_rng(11)
    channels = dict(clean().channels)
    for c, times in LOUDER.items():
        old = channels[c]
        more = np.sqrt(times**2 - 1.0) * SD[c[:6]] * rng.standard_normal(old.values.size)
        channels[c] = Channel.of(old.values + more, old.unit)
    return replace(clean(), channels=channels)


@lru_cache
def tuned(which: str) -> Tuning:
    found = kf.tune(model(), loud() if which == "loud" else clean())
    assert isinstance(found, Tuning)
    return found


@pytest.mark.long
def test_scores_are_derivatives_of_the_likelihood() -> None:
    """Of every noise, against central differences, to 1e-4."""
    scene = flight_scene(clean(), model())
    assert scene is not None
    groups = groups_of(scene.path)
    likelihood, x = _SizeLikelihood(scene.path, groups), np.full(len(groups), 0.1)
    slope = likelihood(x)[1]
    for k, step in enumerate(1e-4 * np.eye(x.size)):
        difference = (likelihood(x + step)[0] - likelihood(x - step)[0]) / 2e-4
        assert slope[k] == pytest.approx(difference, rel=1e-4, abs=1e-3)
    assert set(_sizes(groups, x, NoiseSizes()).channels) == set(scene.path.rows.channels)


@pytest.mark.long
def test_noise_as_assumed_keeps_its_size() -> None:
    """Every interval of 99.9 % holds one (eight sizes: by chance not in one of 125 seeds)."""
    for s in tuned("clean").sizes:
        lo, hi = np.log(s.ci95)
        middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
        assert abs(middle) < 3.29 / 1.96 * half, s


@pytest.mark.long
def test_louder_noise_is_found_where_it_is() -> None:
    """Sizes 2 and 3 within 99.9 % of their intervals, the others as before; the unseen part is more likely."""
    found = tuned("loud")
    for s in found.sizes:
        true = LOUDER.get(s.group.where.split(",")[0], 1.0)
        half = 0.5 * float(np.diff(np.log(s.ci95))[0])
        assert abs(np.log(s.times / true)) < 3.29 / 1.96 * half, s
    before, after = found.unseen_nats
    assert after > before + 0.1
    assert found.nis["gnss_v_D"][0] > 3.0
    assert found.nis["gnss_v_D"][1] < 1.3


@pytest.mark.long
def test_the_tuned_filter_needs_no_tuning() -> None:
    again = kf.tune(kf.build(tuned("loud").improved), loud())
    assert [s.group.where for s in again.sizes if s.is_shown and abs(np.log(s.times)) > 0.15] == []


@pytest.mark.long
def test_the_command_writes_a_filter_that_differs_in_its_noise(tmp_path: Path) -> None:
    kf.write_log(loud(), tmp_path / "log.npz")
    args = ["run", "ins15", str(tmp_path / "log.npz"), "--tune", "-o", str(tmp_path / "tuned.toml")]
    done = CliRunner().invoke(app, [*args, "--report", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "tuned.toml").read_text(encoding="utf-8")
    assert "[noise.gnss_v_D]" in text
    assert "white noise of" in done.output


def test_noise_of_a_whole_sensor_is_split_where_one_axis_changes() -> None:
    """The vertical twice as loud: its channels have their own noise, and the sensor's walk stays."""
    whole = ChannelNoise("m", (Term(make("sample_noise", sd=2.0)), Term(make("rate_random_walk", K=1e-3))))
    found = with_sizes(
        NoiseModel({"gnss_p": whole}), model(), [NoiseScale("gnss_p_D", 2.0, (1.9, 2.1), True)]
    )
    white = {
        c: [vars(e)["sd"] for e in n.effects if e.name == "sample_noise"] for c, n in found.channels.items()
    }
    assert white == {"gnss_p": [], "gnss_p_N": [2.0], "gnss_p_E": [2.0], "gnss_p_D": [4.0]}
    assert [e.name for e in found.channels["gnss_p"].effects] == ["rate_random_walk"]


def test_a_log_without_aiding_is_refused_in_words() -> None:
    inertial = {n: c for n, c in clean().channels.items() if n.startswith(("gyro", "accel"))}
    with pytest.raises(InputError, match="no samples of an aiding sensor of ins15"):
        kf.tune(model(), replace(clean(), channels=inertial))
