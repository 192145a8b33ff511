"""Ctrl-C once: the best so far, written and said to be unfinished, exit status 130; twice: the end at once.

Signals are raised inside the search, so that nothing depends on how fast the machine is.
"""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from kfgen.core.time_budget import is_ended_by_user
from kfgen.effects.noise_model import read_noise
from kfgen.gap.rest import explanation
from kfgen.identify.fit import choice

Cli = Callable[..., Result]

NOISE = """
format = "kfgen-noise-1"
[gyro_x]
unit = "rad/s"
effects = [ { effect = "white_noise", N = "0.1 rad/s/sqrt(Hz)" } ]
[gyro_y]
unit = "rad/s"
effects = [ { effect = "white_noise", N = "0.1 rad/s/sqrt(Hz)" } ]
"""
CTRL_C = signal.SIGINT


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Two channels of white noise of one per sample at 100 Hz, each with two lines."""
    t, rng = np.arange(4000) / 100.0, np.random.default_rng(1)
    lines = 0.5 * np.sin(2 * np.pi * 7.3 * t) + 0.5 * np.sin(2 * np.pi * 17.1 * t)
    rows = np.column_stack([t, *(lines + rng.standard_normal(t.size) for _ in range(2))])
    head = "t [s],gyro_x [rad/s],gyro_y [rad/s]"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=head, comments="", fmt="%.9g")
    (tmp_path / "noise.toml").write_text(NOISE, encoding="utf-8")
    return tmp_path / "log.csv"


def pressing(monkeypatch: pytest.MonkeyPatch, where: Any, name: str, at: set[int]) -> list[int]:
    """Ctrl-C before some of the calls of a function; how often it was called."""
    own, calls = getattr(where, name), [0]

    def called(*words: Any, **named: Any) -> Any:
        calls[0] += 1
        if calls[0] in at:
            signal.raise_signal(CTRL_C)
        return own(*words, **named)

    monkeypatch.setattr(where, name, called)
    return calls


def gap(kfgen: Cli, log: Path) -> Result:
    files = ("-o", log.parent / "improved.toml", "--json", log.parent / "gap.json")
    return kfgen("gap", log, "--model", log.parent / "noise.toml", *files)


def test_one_ctrl_c_gives_the_best_so_far(kfgen: Cli, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pressed while the second effect of the first channel is looked for: what is complete finds four lines."""
    before = signal.getsignal(CTRL_C)
    calls = pressing(monkeypatch, explanation, "candidates", {2})
    done = gap(kfgen, log)
    assert done.exit_code == 130
    answer = json.loads((log.parent / "gap.json").read_text(encoding="utf-8"))
    assert any("unfinished" in w and "Ctrl-C" in w for w in answer["warnings"])
    improved = read_noise(log.parent / "improved.toml")
    assert set(improved.channels) == {"gyro_x", "gyro_y"}
    assert [e.name for e in improved.channel("gyro_x").effects][:2] == ["white_noise", "sinusoid"]
    assert calls[0] <= 3
    assert signal.getsignal(CTRL_C) is before


def test_a_second_one_ends_at_once(kfgen: Cli, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pressing(monkeypatch, explanation, "candidates", {1})
    pressing(monkeypatch, explanation, "unproven", {1})
    try:
        status = gap(kfgen, log).exit_code
    except KeyboardInterrupt:
        status = 130
    assert status == 130
    assert not (log.parent / "improved.toml").exists()


def test_an_identification_gives_what_it_has(kfgen: Cli, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pressing(monkeypatch, choice, "combined", {2})
    done = kfgen("identify", log, "-o", log.parent / "found.toml", "--json", log.parent / "found.json")
    assert done.exit_code == 130
    assert set(read_noise(log.parent / "found.toml").channels) == {"gyro_x", "gyro_y"}
    assert "the search is unfinished" in done.stderr


@pytest.mark.long
def test_the_next_command_is_complete(kfgen: Cli, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        pressing(patched, explanation, "candidates", {1})
        assert gap(kfgen, log).exit_code == 130
    assert not is_ended_by_user()
    assert gap(kfgen, log).exit_code == 0
    improved = read_noise(log.parent / "improved.toml")
    assert [e.name for e in improved.channel("gyro_x").effects].count("sinusoid") == 2


def test_outside_of_a_search_ctrl_c_ends_at_once(
    kfgen: Cli, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from kfgen.log import readers

    pressing(monkeypatch, readers, "read_long", {1})
    try:
        status = gap(kfgen, log).exit_code
    except KeyboardInterrupt:
        status = 130
    assert status == 130
    assert not (log.parent / "gap.json").exists()
