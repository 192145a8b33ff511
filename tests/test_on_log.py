"""Proves the proof on a log: the calls of a real recording give the same words in C, an altered header is found, gaps are bridged.

What single precision does to the estimate is held to a share of the standard deviation that the filter states; the
other side is filterpy's matrix arithmetic in double precision, which shares no routine with the emitted C.
"""

from __future__ import annotations

import json
import os
import runpy
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.emit.folder import EmittedFilter, write_folder
from kfgen.emit.routines import Program
from kfgen.log.log import Channel, Log
from kfgen.log.readers import read_log
from kfgen.log.readers.arrays.npz import write
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.run.filter_calls import FilterCalls
from kfgen.run.run import run
from kfgen.simulate.rates import at_every_sample
from kfgen.simulate.simulate import simulate
from kfgen.verify.compare import verify
from kfgen.verify.replay import replay
from kfgen.verify.rounding import Rounding, over_log, rounding

Find = Callable[[str], Path]
FLIGHT = Path(__file__).parents[1] / "examples" / "recordings" / "fixed_wing.py"

WITHIN = 0.05
"""Of a standard deviation: what single precision may cost over a recording."""
ANGLE = 1e-4
"""[rad] of it, 0.006 deg; the recordings' optical reference is good to 0.1 deg."""


@pytest.fixture(autouse=True)
def _compiler() -> None:
    if shutil.which(os.environ.get("CC") or "cc") is None:
        pytest.skip("there is no C compiler on this machine")


def proven(program: Program, log: Log, start: dict[str, float], folder: Path, core: str = "host") -> Rounding:
    """No word differs on a core; what single precision costs."""
    played, found = over_log(program, log, start)
    write_folder(program, "c", None, folder)
    (verdict,) = verify(EmittedFilter(program, "c", folder), [core], played=played)
    assert verdict.calls == len(played.calls) == sum(found.calls.values())
    assert verdict.words == verdict.calls * program.word_count
    assert (verdict.differing, verdict.max_ulp) == (0, 0)
    assert found.refused == {}
    return found.rounding


TRIALS = [
    pytest.param("broad_01_undisturbed_slow_rotation_A", marks=pytest.mark.long),
    "broad_06_undisturbed_fast_rotation_A",
]
PARTS = [
    pytest.param(slice(8000, 14000), id="21 s"),
    pytest.param(slice(0, None), id="all", marks=pytest.mark.long),
]


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("form", [pytest.param("p", marks=pytest.mark.long), "ud"])
@pytest.mark.parametrize("trial", TRIALS)
def test_ahrs6_over_a_real_motion(
    trial: str, form: str, part: slice, recording: Find, tmp_path: Path
) -> None:
    log = read_log(recording(f"dynamic/{trial}.npz"))
    log = log.cut(part.start, part.stop or log.n)
    program = Program(DiscreteModel(build("ahrs6"), rate=1.0 / log.dt), form)
    found = proven(program, log, {}, tmp_path / "c")
    assert found.attitude is not None
    assert 1e-8 < found.attitude < ANGLE
    assert found.share < WITHIN
    assert found.spread < 1e-2


@cache
def flight(path: Path) -> tuple[Log, dict[str, float], FilterModel]:
    """A flight with uneven steps and a slow GPS, as the example has it."""
    example = runpy.run_path(str(FLIGHT))
    return (*example["flight"](path), example["model"]())


@pytest.mark.long
@pytest.mark.parametrize("form", [pytest.param("p", marks=pytest.mark.long), "ud"])
def test_ins15_over_a_real_flight(form: str, recording: Find, tmp_path: Path) -> None:
    """Steps of 5.5 to 18.2 ms as they came; a fix of 5 Hz, 0.22 s late."""
    log, start, model = flight(recording("dynamic/inertialnav_swisslog1.npz"))
    assert np.ptp(np.diff(log.t)) > 0.01
    found = proven(Program(DiscreteModel(model, rate=1.0 / log.dt), form), log, start, tmp_path / "c")
    assert found.attitude is not None
    assert 1e-8 < found.attitude < ANGLE
    assert found.share < WITHIN
    assert found.spread < 1e-2


@pytest.fixture
def short() -> tuple[Program, Log]:
    """Six seconds of a simulated flight at 50 Hz."""
    program = Program(DiscreteModel(build("ins15"), rate=50.0))
    every = at_every_sample(program.discrete)
    return program, simulate(program.discrete, "generic", 6.0, np.random.default_rng(3), rates=every)


@pytest.mark.long
def test_a_gap_is_gone_through_in_steps_that_the_filter_takes(
    short: tuple[Program, Log], tmp_path: Path
) -> None:
    """A gap of 0.52 s, the longest step 0.1 s: six steps of a sixth, and the state is the same in both precisions."""
    program, log = short
    keep = np.r_[0:100, 125:200]
    channels = {n: replace(c, values=c.values[keep]) for n, c in log.channels.items()}
    gappy = Log(log.t[keep], channels, source="gappy")
    steps = list(FilterCalls(program, gappy).steps(99))
    assert [call.given["dt"] for call in steps] == pytest.approx([0.52 / 6] * 6)
    assert proven(program, gappy, {}, tmp_path / "c").share < WITHIN
    # what the gap adds to the variance of position without a fix: at least sd_v^2 T^2
    result = run(program, gappy)
    v = [s.name for s in program.discrete.model.states].index("v_N")
    assert result.deviation[100, v] > result.deviation[99, v]


def test_samples_that_a_sensor_has_not_are_no_calls(short: tuple[Program, Log]) -> None:
    program, log = short
    seldom = np.arange(log.n) % 10 != 3
    channels = {
        n: Channel(np.where(seldom & n.startswith("gnss_p"), np.nan, c.values), c.unit)
        for n, c in log.channels.items()
    }
    played = replay(FilterCalls(program, Log(log.t, channels)))
    count = {r: sum(c.routine == r for c in played.calls) for r in ("predict", "update_gnss_position")}
    assert count == {"predict": log.n - 1, "update_gnss_position": int((~seldom).sum())}
    assert len(played.ends) == log.n


def test_rounding_finds_a_word_that_is_off(short: tuple[Program, Log]) -> None:
    """A position one standard deviation away, at one sample, is one standard deviation; a turn of 1 mrad is 1 mrad."""
    program, log = short
    played, double = replay(FilterCalls(program, log)), run(program, log)
    k, call = 150, played.ends[150] - 1
    words = played.calls[call].words.copy()
    words[0] = double.estimate[k, 0] + double.deviation[k, 0]
    changed = [*played.calls[:call], replace(played.calls[call], words=words), *played.calls[call + 1 :]]
    found = rounding(program, replace(played, calls=tuple(changed)), double)
    assert (found.state, found.t) == ("p_N", pytest.approx(log.t[k]))
    assert found.share == pytest.approx(1.0, rel=1e-3)
    q = double.estimate[k, 6:10]
    words[6:10] = q + 0.5e-3 * np.array([-q[1], q[0], q[3], -q[2]])
    found = rounding(program, replace(played, calls=tuple(changed)), double)
    assert found.attitude == pytest.approx(1e-3, rel=1e-2)


def test_a_start_that_is_no_state_is_refused(short: tuple[Program, Log]) -> None:
    program, log = short
    with pytest.raises(InputError, match="stores no 'q_v'"):
        FilterCalls(program, log, {"q_v": 1.0})
    assert FilterCalls(program, log, {"p_E": 7.0}).start[1] == 7.0


@pytest.mark.long
def test_the_command_line_proves_on_a_log(
    short: tuple[Program, Log], kfgen: Callable[..., Any], tmp_path: Path
) -> None:
    """C and numpy; an altered header is found; a rate that is not the filter's is said; filterpy has its own command."""
    _, log = short
    write(log, tmp_path / "log.npz")
    c, out = tmp_path / "c", tmp_path / "v.json"
    words = ["verify", c, "--log", tmp_path / "log.npz", "--json", out]
    assert kfgen("emit", "ins15", "--target", "c", "--form", "ud", "--rate", "50", "-o", c).exit_code == 0
    done = kfgen(*words)
    assert done.exit_code == 0
    assert "Over 6 s" in done.stdout
    assert "299 predict; none refused" in done.stdout
    data = json.loads(out.read_text())
    assert data["cores"]["host"]["differing"] == 0
    assert data["log"]["calls"] == {"update_gnss_position": 300, "update_gnss_velocity": 300, "predict": 299}
    assert 0.0 < data["log"]["beside_double"]["deviations"] < WITHIN
    header = c / "ins15.h"
    head, body = header.read_text().split("ins15_predict(", 1)
    assert "0.5f" in body
    header.write_text(f"{head}ins15_predict({body.replace('0.5f', '0.5001f', 1)}")
    assert kfgen(*words).exit_code == 1
    assert kfgen("emit", "ins15", "--target", "numpy", "-o", tmp_path / "n").exit_code == 0
    done = kfgen("verify", tmp_path / "n", "--log", tmp_path / "log.npz")
    assert done.exit_code == 0
    assert "emit --rate 50" in done.stderr
    assert kfgen("emit", "ins15", "--target", "filterpy", "-o", tmp_path / "f").exit_code == 0
    assert kfgen("verify", tmp_path / "f", "--log", tmp_path / "log.npz").exit_code == 2
