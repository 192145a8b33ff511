"""Proves the delayed horizon: every sample fused at its own time, and the present state near the truth.

The exact delayed filter is written down here: samples in a list, sorted by their stamps, predictions divided where they
were taken, on the same equations. Truth is the flight of `kfgen.verify.flight`, whose position and velocity are known at
any time. Seeds are fixed; the chance of a false alarm is stated where there is one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.emit.emit import emit
from kfgen.emit.horizon.memory import MARGIN
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.targets import filterpy, plain
from kfgen.emit.targets.c import header
from kfgen.emit.targets.loaded import loaded
from kfgen.model.discretise import DiscreteModel
from kfgen.model.known_delays import longest_delay
from kfgen.model.library import build
from kfgen.verify.compare import verify
from kfgen.verify.flight import flight, turning
from kfgen.verify.host import Host

RATE, HORIZON = 100.0, 0.25
DT = 1.0 / RATE


@cache
def program(name: str = "ins15", real: str = "double", **options: str) -> Program:
    return Program(DiscreteModel(build(name, None, options), max_step=0.1), "ud", real, horizon=HORIZON)


@cache
def module(tolerance: float, **options: str) -> Any:
    made = loaded(plain.module(program(**options)))
    made.STAMP_TOLERANCE = made.F(tolerance)
    return made


def started(tolerance: float = 0.0, **options: str) -> Any:
    return getattr(module(tolerance, **options), filterpy.class_name(program(**options)))()


@dataclass(frozen=True)
class Fix:
    """A position and a velocity, when they were taken and when they arrive [s]."""

    stamp: float
    arrives: float
    position: Any
    velocity: Any


def fixes(seconds: float, rng: np.random.Generator, latest: float = 0.24) -> list[Fix]:
    """Of the flight at ten times a second, taken at any time, after the filter's beginning; arriving out of order."""
    t = np.arange(0.3, seconds, 0.1) + rng.uniform(-0.04, 0.04, round((seconds - 0.3) / 0.1 + 0.499))
    fine = np.arange(0.0, seconds + 0.1, 1e-3)
    v = turning(fine)[1]
    p = np.vstack([np.zeros(3), np.cumsum((v[1:] + v[:-1]) / 2.0 * 1e-3, axis=0)])
    at = [np.array([np.interp(t, fine, c[:, k]) for k in range(3)]).T for c in (p, v)]
    noise = rng.normal(size=(2, t.size, 3))
    delays = rng.uniform(0.1, latest, t.size)
    return [
        Fix(float(a), float(a + d), p_a + 1.5 * n, v_a + 0.1 * m)
        for a, d, p_a, v_a, n, m in zip(t, delays, *at, *noise)
    ]


def flown(kf: Any, trial: Any, given: list[Fix]) -> Any:
    """The horizon over a flight: present states, filter states and variances of the filter after each step."""
    waiting = sorted(given, key=lambda f: f.arrives)
    rows = []
    for k in range(len(trial.t)):
        kf.delayed_predict(trial.accel[k], trial.gyro[k], DT)
        now = (k + 1) * DT
        while waiting and waiting[0].arrives <= now:
            fix = waiting.pop(0)
            for name, z in (("position", fix.position), ("velocity", fix.velocity)):
                said = getattr(kf, f"delayed_update_gnss_{name}")(z, now - fix.stamp).name
                assert said in ("OK", "OUT_OF_ORDER")
        rows.append([*kf.present, *kf.x])
    return np.array(rows)


def placed(kf: Any, trial: Any) -> Any:
    names = list(program().discrete.nominal_names)
    kf.x[names.index("q_w") : names.index("q_z") + 1] = trial.attitude
    kf.x[names.index("v_N") : names.index("v_D") + 1] = trial.start
    return kf


def test_the_filter_is_the_exact_delayed_one() -> None:
    """Every step over four seconds, fixes at any time within the steps, out of order."""
    rng = np.random.default_rng(4)
    trial, given = flight(RATE, 4.0, np.zeros(3), rng), fixes(4.0, rng)
    assert any(a.arrives > b.arrives for a, b in pairwise(given))
    found = flown(placed(started(), trial), trial, given)
    exact, waiting = placed(started(), trial), sorted(given, key=lambda f: f.stamp)
    nx, behind = len(program().discrete.nominal_names), program().delayed_memory.rows
    worst = 0.0
    for k in range(len(trial.t) - behind):
        begins, end = k * DT, (k + 1) * DT
        while waiting and waiting[0].stamp <= end:
            fix = waiting.pop(0)
            exact.predict(trial.accel[k], trial.gyro[k], fix.stamp - begins)
            begins = fix.stamp
            exact.update_gnss_position(fix.position)
            exact.update_gnss_velocity(fix.velocity)
        exact.predict(trial.accel[k], trial.gyro[k], end - begins)
        off = found[k + behind, -nx:] - exact.x
        worst = max(worst, float(np.abs(off).max()))
    assert worst < 1e-9
    assert len(waiting) < 4, "fixes were fused"


def test_a_known_delay_is_served_by_the_stamp() -> None:
    """A file's delay of 0.1 s: a stamp of arrival and no delay in the equations gives the words of a stamp of the sample."""
    late = {"delay": "0.1 s"}
    kf, other = started(delay="0.1 s"), started()
    assert program(**late).delayed_memory.lags(program(**late).discrete.model.sensors[0]) == (1,)
    for k in range(60):
        for f in (kf, other):
            f.delayed_predict([0.1, 0.0, -9.8], [0.0, 0.01, 0.02], DT)
        if k == 20:
            kf.delayed_update_gnss_velocity([0.2, 0.1, 0.0], 0.013)
            other.delayed_update_gnss_velocity([0.2, 0.1, 0.0], 0.113)
    np.testing.assert_allclose(kf.x, other.x, rtol=0.0, atol=1e-12)
    assert abs(kf.x[3]) > 0.01
    assert kf.k[1] == pytest.approx(0.1)


def test_what_is_not_fused_is_said() -> None:
    machine = Machine(program())
    machine.call("init")
    z = [0.0, 0.0, 0.0]
    assert machine.call("delayed_update_gnss_position", [z, 0.0]) == "BAD_INPUT", "nothing has begun"
    for _ in range(40):
        assert machine.call("delayed_predict", [[0.0, 0.0, -9.8], z, DT]) == "OK"

    def said(age: float) -> str:
        return machine.call("delayed_update_gnss_position", [z, age])

    assert said(0.252) == "TOO_OLD"
    assert [said(0.12), said(0.12), said(0.15), said(0.1)] == ["OK", "DOUBLED", "OUT_OF_ORDER", "OK"]
    assert [said(-1.0), said(float("nan")), said(float("inf"))] == ["BAD_INPUT"] * 3
    room = program().delayed_memory.room(program().discrete.model.sensors[0])
    assert [said(0.09 - 0.002 * k) for k in range(room)][room - 3 :] == ["NO_ROOM"] * 3
    assert machine.call("delayed_predict", [z, z, 0.0]) == "BAD_STEP"
    assert machine.call("delayed_predict", [[1e9, 0.0, 0.0], z, DT]) == "BAD_INPUT"


def test_the_clock_begins_again_and_nothing_is_lost() -> None:
    """Fixes at rest until it has: the filter's clock stays below a second and a step, every fix is fused."""
    machine = Machine(program(real="float"))
    machine.call("init")
    ages = []
    supervisor = [n for n, _ in machine.program.supervisor.places].index("AGE_GNSS_POSITION")
    for k in range(160):
        machine.call("delayed_predict", [[0.0, 0.0, -9.8], [0.0, 0.0, 0.0], DT])
        if k % 10 == 0 and k > 20:
            assert machine.call("delayed_update_gnss_position", [[0.0, 0.0, 0.0], 0.1234]) == "OK"
        ages.append(float(machine.arrays["supervisor"][supervisor]))
        assert 0.0 <= machine.arrays["horizon"][2] < 1.02
    assert max(ages[60:]) < 0.101


EACH = 20
"""Steps from one look at the filter to the next."""


def truth(t: Any) -> Any:
    fine = np.arange(0.0, t[-1] + 0.1, 1e-3)
    v = turning(fine)[1]
    p = np.vstack([np.zeros(3), np.cumsum((v[1:] + v[:-1]) / 2.0 * 1e-3, axis=0)])
    return np.array([np.interp(t, fine, c) for c in np.hstack([p, v]).T]).T


class InC:
    """The emitted C in single precision with the names of the Python module."""

    def __init__(self, folder: Path) -> None:
        own = program(real="float")
        (folder / "ins15.h").write_text(header(own), encoding="utf-8")
        self.core, self.own = Host(own, folder, folder), own
        self.core.call("init", ())

    def place(self, trial: Any) -> InC:
        names = list(self.own.discrete.nominal_names)
        x = [0.0] * len(names)
        x[names.index("q_w") : names.index("q_z") + 1] = trial.attitude.tolist()
        x[names.index("v_N") : names.index("v_D") + 1] = trial.start.tolist()
        self.core.put("x", x)
        return self

    def words(self) -> Any:
        return self.core.words().view(np.float32).astype(float)

    def fly(self, trial: Any, given: list[Fix]) -> tuple[Any, Any]:
        """Present position and velocity, and variances of the filter, now and then."""
        waiting, rows, sizes = sorted(given, key=lambda f: f.arrives), [], []
        form, nx = self.own.covariance, len(self.own.discrete.nominal_names)
        first = nx + form.size + len(self.own.supervisor.places)
        for k in range(len(trial.t)):
            self.core.call("delayed_predict", [*trial.accel[k], *trial.gyro[k], DT])
            now = (k + 1) * DT
            while waiting and waiting[0].arrives <= now:
                fix = waiting.pop(0)
                self.core.call("delayed_update_gnss_position", [*fix.position, now - fix.stamp])
                self.core.call("delayed_update_gnss_velocity", [*fix.velocity, now - fix.stamp])
            if k % EACH == EACH - 1:
                words = self.words()
                rows.append(words[first : first + 6])
                sizes.append(form.variances(words[None, nx : nx + form.size])[0, :6])
        return np.array(rows), np.array(sizes)


def shares(folder: Path, seconds: float, seed: int, stamped: bool = True) -> Any:
    """Errors of the present position and velocity from ten seconds on, over the filter's standard deviations."""
    rng = np.random.default_rng(seed)
    trial, given = flight(RATE, seconds, np.zeros(3), rng), fixes(seconds, rng)
    if not stamped:
        given = [replace(f, stamp=f.arrives) for f in given]
    found, variance = InC(folder).place(trial).fly(trial, given)
    error = found - truth((np.arange(len(found)) + 1) * EACH * DT)
    variance[:, :3] += HORIZON**2 * variance[:, 3:]
    return (error / np.sqrt(variance))[50:]


@pytest.mark.long
def test_the_present_state_is_near_the_truth(tmp_path: Path) -> None:
    """One flight of 20 s, the root mean square of six errors of a few independent values each."""
    assert 0.3 < np.sqrt(np.mean(shares(tmp_path, 20.0, 3) ** 2)) < 1.5


@pytest.mark.long
def test_the_present_state_is_near_the_truth_in_many_flights(tmp_path: Path) -> None:
    """Twenty flights of 60 s: of Gaussian errors 0.3 % are beyond three standard deviations, 1 % are allowed; without stamps it is far off."""
    assert np.sqrt(np.mean(shares(tmp_path, 20.0, 3, stamped=False) ** 2)) > 5.0
    assert np.mean([np.abs(shares(tmp_path, 60.0, seed)) > 3.0 for seed in range(20)]) < 0.01


def test_a_file_with_a_delay_has_a_horizon_and_one_at_rest_none(tmp_path: Path) -> None:
    """A fifth more than its delay of 0.1 s: twelve steps; no memory and no routine without one."""
    model = build("ins15", None, {"delay": "0.1 s"})
    made = emit(model, tmp_path / "late", "numpy").program
    assert (longest_delay(model), made.horizon) == (0.1, MARGIN * 0.1)
    assert made.delayed_memory.rows == 12
    assert longest_delay(build("ins15", None, {"delay": "state"})) == 0.0
    without = Program(DiscreteModel(model))
    assert without.delayed == ()
    assert not {"ring", "queue", "present"} & set(without.arrays)
    with pytest.raises(InputError, match="nothing of gyro-static moves"):
        Program(DiscreteModel(build("gyro-static")), horizon=0.1)
    with pytest.raises(InputError, match="200000 steps"):
        _ = Program(DiscreteModel(build("ahrs6")), horizon=2000.0).arrays


@pytest.mark.parametrize("target", ["numpy", pytest.param("filterpy", marks=pytest.mark.long)])
def test_python_has_the_same_horizon(target: str, tmp_path: Path) -> None:
    """numpy to the last bit, filterpy to 1e-6 standard deviations, over all calls of the proof."""
    emit("ahrs6", tmp_path, target, horizon=0.05)
    assert verify(tmp_path).ok
