"""The law of a gap in flight: what is named is emitted, its code is proven on a core, and its innovations are consistent.

The flights are simulated by `benchmarks/flight`, plain numpy that shares no code with kfgen. The filter is updated from one
flight and judged by another of the same vehicle, whose noise, biases and turns are others. Of a right filter the sum of
a sensor's NIS is beyond its band once in a thousand seeds.
"""

from __future__ import annotations

import os
import shutil
import sys
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import kfgen as kf
from kfgen.emit.folder import read_folder
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel
from kfgen.run.run import program_over, run
from kfgen.verify.compare import verify

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
flight = pytest.importorskip("flight")
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

BAND = chi2(1).sf(3.29**2)
"""Of the NIS of a consistent filter, both sides together: once in a thousand."""
SETTLED_S = 5.0
"""What the start is given until innovations are judged."""
Values = tuple[tuple[str, float], ...]
EFFECTS: list[tuple[str, str, str, Values, str]] = [
    # vehicle, effect, place, size, the sensor whose innovations show it
    ("quadrotor", "lever_arm", "gnss", (("x", 1.2), ("y", -0.9), ("z", 0.8)), "gnss_velocity"),
    ("quadrotor", "time_delay", "gnss", (("delay", 0.25),), "gnss_velocity"),
    ("wing", "time_delay", "mag", (("delay", 0.05),), "mag"),
    ("wing", "scale_factor", "gyro_z", (("coefficient", 0.04),), "mag"),
    ("car", "misalignment", "accel_z", (("zx", 0.06),), "gnss_velocity"),
    ("quadrotor", "hard_iron", "mag", (("x", 2e-6), ("y", -1.6e-6), ("z", 1.2e-6)), "mag"),
    ("quadrotor", "soft_iron", "mag", (("xx", 0.05), ("xy", 0.03), ("yz", -0.03)), "mag"),
    ("wing", "mounting", "mag", (("x", 0.05), ("y", -0.04), ("z", 0.06)), "mag"),
    ("wing", "gauss_markov", "gnss_p_N", (("sigma", 2.0), ("tau", 8.0)), "gnss_position"),
]


@lru_cache
def model() -> FilterModel:
    """The field is a state: what one sample shows of it is no better than its noise, and heading stands on it."""
    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    options = {"left_out": "false", "biases": "constant", "field": "state"}
    return kf.build("ins15", options=options, sensors=sensors)


def log_of(vehicle: str, seed: int, name: str, where: str, values: Values) -> Log:
    found = trial.log_of(trial.Case(vehicle, seed, 60.0), [flight.Effect(name, where, dict(values))])
    assert isinstance(found, Log)
    return found


def compiler_missing() -> bool:
    return shutil.which(os.environ.get("CC") or "cc") is None


def chance(filter_: FilterModel, log: Log) -> dict[str, float]:
    """Of each sensor, how probable it is that the NIS of a consistent filter is as far from its mean."""
    found: dict[str, float] = {}
    for name, sensor in run(program_over(filter_, log), log).sensors.items():
        settled = sensor.t > log.t[0] + SETTLED_S
        total, count = float(np.sum(sensor.nis[settled])), sensor.innovation.shape[1] * int(settled.sum())
        found[name] = 2.0 * min(chi2.cdf(total, count), chi2.sf(total, count))
    return found


@pytest.mark.long
@pytest.mark.parametrize(("vehicle", "name", "where", "values", "shown_by"), EFFECTS)
def test_what_is_named_is_emitted_proven_and_consistent(
    vehicle: str, name: str, where: str, values: Values, shown_by: str, tmp_path: Path
) -> None:
    """Assumed and updated filter over a flight that neither has seen."""
    found = kf.find_gap(log_of(vehicle, 11, name, where, values), model())
    assert [(f.name, f.where) for f in found.findings] == [(name, where)]
    path = tmp_path / "updated.toml"
    path.write_text(found.updated_text, encoding="utf-8")
    unseen = log_of(vehicle, 12, name, where, values)
    before, after = chance(model(), unseen), chance(kf.build(str(path)), unseen)
    assert before[shown_by] < 1e-6
    assert min(after.values()) > BAND / len(after)
    kf.emit(path, tmp_path / "code")
    if compiler_missing() or find_spec("unicorn") is None or find_spec("ziglang") is None:
        pytest.skip("there is no C compiler on this machine, or no emulator (pip install 'kfgen[pil]')")
    cores = ["host", "m4f"]
    verdicts = verify(read_folder(tmp_path / "code"), cores).verdicts
    assert [(v.differing, v.max_ulp) for v in verdicts] == [(0, 0)] * len(cores)
    assert all(v.words > 1000 for v in verdicts)


@pytest.mark.long
def test_the_band_is_one_of_a_thousand() -> None:
    """And a flight without any effect is within it by the filter that is assumed."""
    assert pytest.approx(1e-3, rel=0.01) == BAND
    clean: Any = trial.log_of(trial.Case("wing", 13, 60.0), [])
    assert min(chance(model(), clean).values()) > BAND / 4
