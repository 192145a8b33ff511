"""Proves the emitted code: its arithmetic is the Kalman filter's, and its text is what firmware needs.

The interpreted routines are compared with dense numpy formulas, the filterpy module with the routines,
and the C header is compiled strictly, run by its own self-test, and altered to see that test fail.
"""

from __future__ import annotations

import compileall
import ctypes
import json
import math
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from in_part import in_part
from scipy.spatial.transform import Rotation

import kfgen
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.emit.folder import read_folder, write_folder
from kfgen.emit.ir.ir import STATUS, Bin, Expr, Num
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.scenario import scenario, split
from kfgen.emit.targets.c import files
from kfgen.emit.targets.filterpy import class_name
from kfgen.emit.targets.plain import module as numpy_module
from kfgen.emit.watch.parts import BIASES
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.plant.equations import filter_model
from kfgen.model.plant.file import parse_model
from kfgen.model.register import DT
from kfgen.run.run import load
from kfgen.verify.compare import verify
from kfgen.verify.host import Host

NAMES = ["gyro-static", "ahrs6", "ins15"]
STRICT = ["-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Wfloat-equal"]
STRICT += ["-Werror"]
CASES = [(n, order) for n in NAMES for order in (1, 3)] + [("ahrs6 loaded", 1), ("ins15 loaded", 2)]
CASES += [("ins23", 1), ("pendulum", 1)]
ERRORS = ["right-invariant", "local-quaternion"]
"""Conventions of the error of ins15: with noise of rank less than its states, and a transition in circles."""


FORMS = [("p", False), ("ud", False), ("p", True), ("ud", True)]
MOST_FORMS = [("p", False), ("ud", False), ("ud", True), pytest.param("p", True, marks=pytest.mark.long)]


@cache
def program(name: str, order: int = 1, form: str = "p", loops: bool = False) -> Program:
    """Of one model all forms share what does not depend on the form: the transition in symbols, which is slow.

    Without bounds of biases, which random states leave; they have tests of their own.
    """
    made = Program(discrete(name, order), form, loops=loops, q_interval=0.0, without=(BIASES,))
    if (form, loops) != FORMS[0]:
        first = program(name, order)
        first.covariance  # noqa: B018  computes it
        vars(made).update({k: vars(first)[k] for k in ("atoms", "transition")})
    return made


@cache
def discrete(name: str, order: int) -> DiscreteModel:
    if name == "pendulum":
        return DiscreteModel(pendulum(), order=order)
    if name in ERRORS:
        return DiscreteModel(build("ins15", None, {"attitude_error": name}), order=order)
    model = build(name.removesuffix(" loaded"))
    for channel in ("gyro_x", "accel_y", "mag_z", "gnss_v_N") if "loaded" in name else ():
        if channel in model.channel_units:
            for e in (
                make("gauss_markov", sigma=3e-3, tau=2.0),
                make("rate_random_walk", K=2e-4),
                make("rate_ramp", R=1e-5),
                make("temperature", coefficient=1e-4, reference=290.0),
            ):
                model = model.augment(channel, e)
    if name not in ("ahrs6", "ins15"):
        model = replace(model, limits={"mag": 10.0})  # random states of a field are of the order of one tesla
    return DiscreteModel(model, order=order)


def pendulum() -> FilterModel:
    """Two states that drive one another, and a bias: no order makes its transition triangular."""
    text = """
format = "kfgen-model-1"
name = "pendulum"
[parameters]
g_over_l = "19.6 1/s^2"
[states]
theta = { unit = "rad", initial = "0.1 rad", sd = "0.05 rad" }
omega = { unit = "rad/s", initial = "0 rad/s", sd = "0.3 rad/s" }
[inputs]
s = "N m"
[dynamics]
theta = "omega"
omega = "-g_over_l*sin(theta) - 0.5*omega + 25.0*s"
[measurements.angle]
unit = "deg"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" }, { effect = "gauss_markov", sigma = "0.5 deg", tau = "3 s" } ]
"""
    return filter_model(parse_model(text, "pendulum.toml"))


@cache
def compiled(name: str, order: int, what: str) -> tuple[list[str], Any]:
    """Phi and Qd, or h, H and R of a sensor, as a function of numbers."""
    d = program(name, order).discrete
    if what == "step":
        matrices: list[Any] = [d.Phi, d.Qd, sp.Matrix(d.step)]
    else:
        matrices = [d.model.expected(d.model.sensor(what)), d.model.H(d.model.sensor(what))]
    symbols = sorted(set().union(*(M.free_symbols for M in matrices)), key=str)
    return [s.name for s in symbols], sp.lambdify(symbols, matrices)


class Filter:
    """A Machine at a random state with a random covariance, and the same in matrices."""

    def __init__(
        self, name: str, order: int, seed: int, real: type = np.float64, form: str = "p", loops: bool = False
    ) -> None:
        self.key = (name, order)
        self.program = program(name, order, form, loops)
        self.n = self.program.n
        self.names = self.program.discrete.nominal_names
        self.rng = np.random.default_rng(seed)
        self.machine = Machine(self.program, real)
        self.machine.call("init")
        prior = np.array([s.prior for s in self.program.discrete.model.states])
        prior = 0.03 * np.where(prior > 0, prior, 1e-3)
        self.P = random_spd(self.n, self.rng) * np.outer(prior, prior)
        self.x = self.rng.normal(size=len(self.names)) * 0.3
        self.dt = 0.04
        if "q_w" in self.names:
            at = self.names.index("q_w")
            self.x[at : at + 4] /= np.linalg.norm(self.x[at : at + 4])
        self.machine.arrays["x"][:] = self.x
        if form == "p":
            self.machine.arrays["P"][:] = self.P[np.triu_indices(self.n)]
        else:
            at = np.array(self.program.covariance.order)
            U, D = udu(self.P[np.ix_(at, at)])
            self.machine.arrays["UD"][:] = (U - np.eye(self.n) + np.diag(D))[np.triu_indices(self.n)]
        d = self.program.discrete
        self.given = {c: self.rng.normal() for i in d.model.motion.inputs for c in i.channels}
        self.given |= {"temperature": 301.0}

    def evaluate(self, what: str) -> list[np.ndarray]:
        values = dict(zip(self.names, self.x, strict=True)) | self.given | {str(DT): self.dt}
        values |= {c.name: c.value for c in self.program.constants}
        if "q_w" in self.names:
            R = self.rotation().as_matrix()
            values |= {f"R_nb_{i}{j}": R[i, j] for i in range(3) for j in range(3)}
        symbols, function = compiled(*self.key, what)
        return [np.array(M, float) for M in function(*(values[s] for s in symbols))]

    def rotation(self) -> Rotation:
        at = self.names.index("q_w")
        return Rotation.from_quat(self.x[at : at + 4], scalar_first=True)

    def arguments(self, routine: str, z: np.ndarray | None = None) -> list[Any]:
        """The values of a routine's arguments."""
        out: list[Any] = []
        for a in self.machine.routines[routine].required:
            if a.name == "z":
                out.append(z)
            elif a.size:
                out.append([self.given[f"{a.name}_{k}"] for k in "xyz"])
            else:
                out.append(self.dt if a.name == "dt" else self.given[a.name.removesuffix("_in")])
        return out

    def covariance(self) -> np.ndarray:
        """From the stored numbers, written out."""
        if "P" in self.machine.arrays:
            return unpacked(self.machine.arrays["P"], self.n)
        M = np.zeros((self.n, self.n))
        M[np.triu_indices(self.n)] = self.machine.arrays["UD"]
        U = np.triu(M, 1) + np.eye(self.n)
        back = np.argsort(self.program.covariance.order)
        return np.asarray((U @ np.diag(np.diag(M)) @ U.T)[np.ix_(back, back)])


def estimate(machine: Machine) -> bytes:
    """State and covariance to the last bit, without what the supervisor counts."""
    return machine.words()[: -len(machine.arrays["supervisor"])].tobytes()


def udu(P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Factors U, D of a covariance, by the Cholesky factor of the reversed matrix."""
    L = np.linalg.cholesky(P[::-1, ::-1])[::-1, ::-1]
    return L / np.diag(L), np.diag(L) ** 2


def random_spd(n: int, rng: np.random.Generator) -> np.ndarray:
    A = rng.normal(size=(n, 2 * n))
    return np.asarray(A @ A.T / (2 * n))


def unpacked(packed: Sequence[float] | np.ndarray, n: int) -> np.ndarray:
    P = np.zeros((n, n))
    P[np.triu_indices(n)] = packed
    return P + np.triu(P, 1).T


def assert_near(got: np.ndarray, wanted: np.ndarray, near: float = 1e-9) -> None:
    """Each element to `near` of the product of the two standard deviations."""
    sd = np.sqrt(np.diag(wanted))
    assert np.abs((got - wanted) / np.outer(sd, sd)).max() < near


def assert_same_state(f: Filter, wanted: np.ndarray) -> None:
    """The stored states, the quaternion as a rotation."""
    got = np.array(f.machine.arrays["x"])
    if "q_w" in f.names:
        at = f.names.index("q_w")
        q = slice(at, at + 4)
        assert np.linalg.norm(got[q]) == pytest.approx(1.0, abs=1e-15)
        assert abs(abs(got[q] @ wanted[q]) / np.linalg.norm(wanted[q]) - 1.0) < 1e-15
        assert np.linalg.norm(got[q] - wanted[q] * np.sign(got[q] @ wanted[q])) < 1e-9
        got, wanted = np.delete(got, range(at, at + 4)), np.delete(wanted, range(at, at + 4))
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize(("name", "order"), in_part([*CASES, *((e, 1) for e in ERRORS)]))
@pytest.mark.parametrize(("form", "loops"), in_part(MOST_FORMS))
def test_prediction_is_the_dense_formula(name: str, order: int, form: str, loops: bool) -> None:
    f = Filter(name, order, 3, form=form, loops=loops)
    Phi, Qd, step = f.evaluate("step")
    assert f.machine.call("predict", f.arguments("predict")) == "OK"
    assert_near(f.covariance(), Phi @ f.P @ Phi.T + Qd)
    wanted = step.ravel()
    if "q_w" in f.names:
        at = f.names.index("q_w")
        wanted[at : at + 4] /= np.linalg.norm(wanted[at : at + 4])
    assert_same_state(f, wanted)


@pytest.mark.parametrize(("name", "order"), CASES)
@pytest.mark.parametrize(("form", "loops"), FORMS)
@pytest.mark.parametrize("which", [0, 1])
def test_update_is_the_batch_kalman_update(name: str, order: int, form: str, loops: bool, which: int) -> None:
    f = Filter(name, order, 4, form=form, loops=loops)
    model = f.program.discrete.model
    sensor = model.sensors[which % len(model.sensors)]
    h, H = f.evaluate(sensor.name)
    R = np.diag([f.program.discrete.measurement_variance(sensor, c) for c in sensor.channels])
    S = H @ f.P @ H.T + R
    y = np.linalg.cholesky(S) @ f.rng.normal(size=len(S))
    z = h.ravel() + y
    assert f.machine.call(f"update_{sensor.name}", f.arguments(f"update_{sensor.name}", z)) == "OK"
    K = np.linalg.solve(S, H @ f.P).T
    wanted = f.P - K @ S @ K.T
    assert_near(f.covariance(), wanted)
    dx, x = K @ y, f.x.copy()
    places = {s.name: i for i, s in enumerate(model.states)}
    for i, n in enumerate(f.names):
        if n in places:
            x[i] += dx[places[n]]
    if "q_w" in f.names:
        at = f.names.index("q_w")
        phi = dx[[places[f"phi_{a}"] for a in "NED"]]
        assert 0.0 < np.linalg.norm(phi) < 0.05
        x[at : at + 4] = (Rotation.from_rotvec(phi) * f.rotation()).as_quat(scalar_first=True)
    assert_same_state(f, x)
    assert f.machine.arrays["innovation"][0] == pytest.approx(y[0], rel=1e-9)
    assert f.machine.arrays["variance"][0] == pytest.approx(S[0, 0], rel=1e-11)
    # rows of the sequence are whitened by a Cholesky factor: their squares add up to the batch's NIS
    assert f.machine.arrays["nis"][0] == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-7)


@pytest.mark.parametrize(("form", "loops"), FORMS)
@pytest.mark.parametrize("name", ["ins15", "ins23", "ahrs6 loaded"])
def test_held_states_are_considered(name: str, form: str, loops: bool) -> None:
    """Schmidt's filter: the gain's rows of held states are zero, P - K S K_o' - K_o S K' + K S K' by blocks."""
    f = Filter(name, 1, 5, form=form, loops=loops)
    model = f.program.discrete.model
    held = [f.n - 1, f.n - 4, 2]
    f.machine.arrays["held"][held] = 1.0
    f.machine.arrays["any_held"][0] = len(held)
    sensor = model.sensors[-1] if name != "ins15" else model.sensors[0]
    h, H = f.evaluate(sensor.name)
    P, dx, keep = f.P.copy(), np.zeros(f.n), np.ones(f.n)
    keep[held] = 0.0
    z = h.ravel() + 0.3 * np.sqrt(np.diag(H @ f.P @ H.T))
    for i, channel in enumerate(sensor.channels):
        R = f.program.discrete.measurement_variance(sensor, channel)
        S = H[i] @ P @ H[i] + R
        K = keep * (P @ H[i]) / S
        A = np.eye(f.n) - np.outer(K, H[i])
        dx += K * (z[i] - h.ravel()[i] - H[i] @ dx)
        P = A @ P @ A.T + R * np.outer(K, K)
    assert f.machine.call(f"update_{sensor.name}", f.arguments(f"update_{sensor.name}", z)) == "OK"
    assert_near(f.covariance(), P)
    np.testing.assert_allclose(f.covariance()[np.ix_(held, held)], f.P[np.ix_(held, held)], rtol=1e-9)
    for i, n in enumerate(f.names):
        if n in (names := [s.name for s in model.states]) and n not in ("q_w", "q_x", "q_y", "q_z"):
            wanted = f.x[i] + dx[names.index(n)]
            assert f.machine.arrays["x"][i] == pytest.approx(wanted, rel=1e-9, abs=1e-13)


@pytest.mark.parametrize(("form", "loops"), FORMS)
def test_health_is_the_smallest_pivot_over_its_variance(form: str, loops: bool) -> None:
    f = Filter("ins15", 1, 6, form=form, loops=loops)
    assert f.machine.call("check") == "OK"
    at = np.array(f.program.covariance.order)
    _, D = udu(f.P[np.ix_(at, at)])
    wanted = (D / np.diag(f.P)[at]).min()
    assert f.machine.arrays["health"][0] == pytest.approx(wanted, rel=1e-9)


def test_health_finds_a_covariance_that_is_none() -> None:
    f = Filter("ins15", 1, 6)
    w, V = np.linalg.eigh(f.P)
    f.machine.arrays["P"][:] = (V @ np.diag(w - 1.5 * w[0]) @ V.T)[np.triu_indices(15)]
    assert f.machine.call("check") == "NOT_POSITIVE"
    assert f.machine.arrays["health"][0] < 0.0


@pytest.mark.parametrize("where", ["predict", "update_gnss_position"])
@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("form", ["p", "ud"])
def test_an_input_that_is_no_number_is_said_and_changes_nothing(where: str, wrong: float, form: str) -> None:
    f = Filter("ins15", 1, 0, np.float32, form)
    before = estimate(f.machine)
    arguments = f.arguments(where, np.full(3, 0.1))
    for k, value in enumerate(arguments):
        if isinstance(value, list) or k == 0:
            changed = [*arguments[:k], [*list(value)[:2], wrong], *arguments[k + 1 :]]
            assert f.machine.call(where, changed) == "BAD_INPUT"
            assert estimate(f.machine) == before


@pytest.mark.parametrize("name", in_part([*NAMES, "ahrs6 loaded", "ins15 loaded"]))
def test_filterpy_module_is_the_routines(name: str) -> None:
    p = program(name)
    kf, machine = getattr(load(p), class_name(p))(), Machine(p, np.float64)
    machine.call("init")
    routines = {r.name: r for r in p.routines}
    for call in scenario(p)[:80]:
        routine = routines[call.routine]
        values = split(routine, call.inputs)
        wanted = machine.call(call.routine, values)
        named = {a.name: np.array(v) if a.size else v for a, v in zip(routine.required, values, strict=True)}
        assert getattr(kf, call.routine)(**named).name == wanted
    P = unpacked(machine.arrays["P"], p.n)
    sd = np.sqrt(np.diag(P))
    good = sd > 0
    off = np.abs(kf.P - P)[np.ix_(good, good)] / np.outer(sd[good], sd[good])
    assert off.max() < 1e-9
    np.testing.assert_allclose(kf.nominal, machine.arrays["x"], rtol=1e-8, atol=1e-8 * sd[good].min())


@pytest.mark.parametrize("name", in_part(NAMES))
def test_the_proofs_scenario_meets_every_branch_that_inputs_can_reach(name: str) -> None:
    """Mostly accepted calls, else it would prove nothing; some refused and gated, else branches stay unproven.

    Samples that jump are rejected until their states widen, twice: to the jump and back.
    """
    p = program(name)
    machine = Machine(p)
    machine.call("init")
    routines = {r.name: r for r in p.entries}
    calls = scenario(p)
    assert {c.routine for c in calls} == routines.keys() - {"init", "check", "supervise"}
    found = [machine.call(c.routine, split(routines[c.routine], c.inputs)) for c in calls]
    assert set(found) - {"ALIGNING"} == {"OK", "GATED", "BAD_STEP", "BAD_INPUT"}
    assert ("ALIGNING" in found) == bool(p.align)
    waiting = found.count("ALIGNING")
    assert found.count("OK") > 0.8 * (len(found) - waiting)
    counts = dict(zip((n for n, _ in p.supervisor.places), machine.arrays["supervisor"], strict=True))
    assert counts["RESETS"] >= 2


def test_a_rate_whose_period_is_longer_than_the_longest_step_is_refused() -> None:
    """Else every prediction at that rate is a bad step, and the proof compares filters that do not move."""
    with pytest.raises(InputError):
        _ = Program(DiscreteModel(build("ahrs6"), rate=5.0, max_step=0.1)).routines


BAD_STEPS = [0.0, -0.0, 8e-43, 9e-7, -0.01, math.nan, math.inf, -math.inf, 0.11]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dt", BAD_STEPS)
def test_bad_step_is_said_and_changes_nothing(name: str, dt: float) -> None:
    f = Filter(name, 1, 0, np.float32)
    before = f.machine.words().tobytes()
    f.dt = dt
    assert f.machine.call("predict", f.arguments("predict")) == "BAD_STEP"
    assert f.machine.words().tobytes() == before


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("z", "status"), [(50.0, "GATED"), (1e8, "BAD_INPUT"), (math.inf, "BAD_INPUT"), (math.nan, "BAD_INPUT")]
)
@pytest.mark.parametrize("seed", range(3))
def test_gated_sample_is_said_and_changes_nothing(name: str, z: float, status: str, seed: int) -> None:
    f = Filter(name, 1, seed, np.float32)
    before = estimate(f.machine)
    routine = f.program.routines[2].name
    rows = f.machine.routines[routine].arguments[0].size
    assert f.machine.call(routine, f.arguments(routine, np.full(rows, z))) == status
    assert estimate(f.machine) == before


@pytest.mark.parametrize(("form", "loops"), FORMS)
def test_one_far_row_rejects_the_whole_sample(form: str, loops: bool) -> None:
    """The gate is on ``y' S^-1 y``: a fix of which one coordinate is false is no fix."""
    f = Filter("ins15", 1, 0, form=form, loops=loops)
    before = estimate(f.machine)
    far = f.x[:3] + np.array([0.01, 1e4, 0.01])
    assert f.machine.call("update_gnss_position", [far]) == "GATED"
    assert estimate(f.machine) == before
    _, H = f.evaluate("gnss_position")
    S = H @ f.P @ H.T + 1.5**2 * np.eye(3)
    y = far - f.x[:3]
    assert f.machine.arrays["nis"][0] == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-9)
    np.testing.assert_allclose(f.machine.arrays["variance"], np.diag(S), rtol=1e-9)


@pytest.mark.parametrize(("form", "loops"), FORMS)
def test_a_fix_may_bring_its_own_variance(form: str, loops: bool) -> None:
    """As receivers report it; the Kalman update with that R, and a variance that is none is refused."""
    f = Filter("ins15", 1, 2, form=form, loops=loops)
    z, R = f.x[:3] + np.array([0.2, -0.1, 0.3]), np.array([0.04, 9.0, 25.0])
    for wrong in (math.nan, -1.0):
        assert f.machine.call("update_gnss_position", [z, [0.04, wrong, 25.0]]) == "BAD_INPUT"
    assert f.machine.call("update_gnss_position", [z, R]) == "OK"
    _, H = f.evaluate("gnss_position")
    S = H @ f.P @ H.T + np.diag(R)
    K = np.linalg.solve(S, H @ f.P).T
    assert_near(f.covariance(), f.P - K @ S @ K.T)


@pytest.mark.parametrize(("factor", "status"), [(0.99, "OK"), (1.01, "GATED")])
def test_gate_is_at_its_constant(factor: float, status: str) -> None:
    """The first row's squared innovation over its variance against the gate, here 3 standard deviations."""
    f = Filter("gyro-static", 1, 1)
    f.machine.arrays["k"][-1] = 3.0
    h, H = f.evaluate("rest")
    d = f.program.discrete
    S = float((H @ f.P @ H.T).item()) + d.measurement_variance(d.model.sensors[0], "gyro_x")
    z = h.ravel() + factor * 3.0 * math.sqrt(S)
    assert f.machine.call("update_rest", [z]) == status


def test_covariance_that_is_not_positive_is_said_and_changes_nothing() -> None:
    f = Filter("ins15", 1, 0, np.float32)
    f.machine.arrays["P"][:] = -100.0 * np.eye(15)[np.triu_indices(15)]
    before = f.machine.words().tobytes()
    assert f.machine.call("update_gnss_position", [np.zeros(3)]) == "NOT_POSITIVE"
    assert f.machine.words().tobytes() == before


def test_status_is_the_gravest_of_what_was_not_done() -> None:
    """As the header promises: the first row's covariance, not the last row's gate."""
    f = Filter("ins15", 1, 0)
    f.machine.arrays["P"][0] = -100.0
    z = f.x[:3] + np.array([0.0, 0.0, 1e6])
    assert f.machine.call("update_gnss_position", [z]) == "NOT_POSITIVE"


def compiler(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"there is no {name} on this machine")
    return found


def written(folder: Path, name: str, form: str = "p", loops: bool = False) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in files(program(name, 1, form, loops)).items():
        (folder / file).parent.mkdir(exist_ok=True)
        (folder / file).write_text(text, encoding="utf-8")
    return folder


def use_all(names: Sequence[str]) -> str:
    """A source that includes headers and calls every routine of each."""
    lines = [f'#include "{program(n).name}.h"' for n in names] + ["int main(void)", "{", "    int bad = 0;"]
    for n in names:
        p = program(n)
        lines.append(f"    static {p.name}_t {p.name}_kf;")
        for r in p.routines:
            values = [f"{p.name}_in" if a.size else "0.01f" for a in r.required]
            call = ", ".join([f"&{p.name}_kf", *values])
            lines.append(f"    bad += ({p.name}_{r.name}({call}) > KF_BAD_INPUT) ? 1 : 0;")
        lines.insert(len(names), f"static const float {p.name}_in[3] = {{0.1f, 0.2f, -0.3f}};")
        lines.append(f"    bad += ({p.name}_get_covariance(&{p.name}_kf, 1, 0) > 0.0f) ? 0 : 0;")
    return "\n".join([*lines, "    return bad;", "}", ""])


LANGUAGES = [("gcc", "-std=c99", "c"), ("gcc", "-std=c11", "c"), ("g++", "-std=c++11", "cpp")]


@pytest.mark.parametrize("names", in_part([*([n] for n in NAMES), ["ahrs6", "ins15"]]), ids="+".join)
@pytest.mark.parametrize(("tool", "standard", "suffix"), in_part(LANGUAGES))
def test_header_compiles_without_a_warning(
    names: list[str], tool: str, standard: str, suffix: str, tmp_path: Path
) -> None:
    for n in names:
        written(tmp_path, n)
    source = tmp_path / f"use.{suffix}"
    source.write_text(use_all(names))
    extra = ["-Wold-style-cast"] if suffix == "cpp" else []
    words = [
        compiler(tool),
        standard,
        "-O1",
        *STRICT,
        *extra,
        str(source),
        "-lm",
        "-o",
        str(tmp_path / "use"),
    ]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    assert subprocess.run([tmp_path / "use"], check=False).returncode == 0


def self_test(folder: Path) -> subprocess.CompletedProcess[str]:
    out = str(folder / "selftest")
    words = [compiler("gcc"), "-std=c99", "-O2", "-ffp-contract=off", *STRICT]
    subprocess.run([*words, str(folder / "selftest.c"), "-lm", "-o", out], check=True)
    return subprocess.run([out], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", NAMES)
def test_self_test_passes(name: str, tmp_path: Path) -> None:
    done = self_test(written(tmp_path, name))
    assert done.returncode == 0
    assert re.fullmatch(r"\d+ values, 0 differing\n", done.stdout)


@pytest.mark.parametrize(("form", "loops"), in_part(MOST_FORMS))
@pytest.mark.parametrize("name", in_part(["pendulum", "ahrs6 loaded"]))
def test_self_test_passes_in_any_form(name: str, form: str, loops: bool, tmp_path: Path) -> None:
    done = self_test(written(tmp_path, name, form, loops))
    assert done.returncode == 0
    assert re.fullmatch(r"\d+ values, 0 differing\n", done.stdout)


LITERAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:e-?\d+)?|\d+e-?\d+)f\b")
ROUTINES = [
    ("gyro-static", "predict"),
    ("gyro-static", "update_rest"),
    ("ahrs6", "init"),
    ("ahrs6", "predict"),
    ("ahrs6", "update_accel"),
    ("ahrs6", "update_mag"),
    ("ins15", "predict"),
    ("ins15", "update_gnss_velocity"),
]


def idle(body: str, m: re.Match[str]) -> bool:
    """Constants that the scenario does not feel: guards, and a quaternion that is normalised anyway."""
    return bool(re.search(r"([<>]=? -?|kf->[xk]\[\d+\] = |supervisor\[\d+\] \+ )$", body[: m.start()]))


def first_setting(e: Expr) -> Num:
    """The first number of an expression."""
    while isinstance(e, Bin):
        e = e.a
    assert isinstance(e, Num)
    return e


@pytest.mark.parametrize(("name", "routine"), in_part(ROUTINES))
def test_self_test_fails_when_a_constant_is_altered(name: str, routine: str, tmp_path: Path) -> None:
    """The first constant of the routine's arithmetic, by one part in a thousand; of others the first setting."""
    p = program(name)
    path = written(tmp_path, name) / f"{p.name}.h"
    text = path.read_text()
    if routine != "predict":
        updated = p.routines[[r.name for r in p.routines].index(routine)]
        first = first_setting(updated.arguments[-1].default[0]) if updated.arguments else p.prior(0)
        macro = f"#define {p.name.upper()}_{first.name} "
        line = next(line for line in text.splitlines() if line.startswith(macro))
        path.write_text(text.replace(line, f"{macro}{np.float32(first.value * 1.001):.9g}f"))
        assert self_test(tmp_path).returncode == 1
        return
    start = text.index(f"{p.name}_{routine}({p.name}_t *kf")
    body = text[start : text.index("return status;", start)]
    found = [m for m in LITERAL.finditer(body) if float(m[1]) != 0.0 and not idle(body, m)]
    at = found[0]
    value = f"{np.float32(float(at[1]) * 1.001):.9g}"
    mutant = (
        body[: at.start()]
        + (value if "." in value or "e" in value else f"{value}.0")
        + "f"
        + body[at.end() :]
    )
    path.write_text(text.replace(body, mutant))
    done = self_test(tmp_path)
    assert done.returncode == 1, at[0]
    assert not done.stdout.endswith(" 0 differing\n")


@pytest.mark.parametrize("name", NAMES)
def test_header_needs_nothing(name: str) -> None:
    text = files(program(name))[f"{program(name).name}.h"]
    assert re.findall(r"#include (.*)", text) == ["<math.h>"]
    fallback = text[text.index("#ifndef KF_SQRT") : text.index("#ifndef KF_STATUS")]
    assert "#include <math.h>" in fallback.split("#else")[1]
    code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    assert not re.search(r"\b(malloc|calloc|free|printf|puts|double|memcpy|goto)\b", code)
    assert 'extern "C" {' in code


@pytest.mark.parametrize("name", NAMES)
def test_banner_says_what_it_is(name: str) -> None:
    p = program(name)
    model = p.discrete.model
    text = files(p)[f"{p.name}.h"]
    banner = text[: text.index("*/")]
    assert f"kfgen {kfgen.__version__}" in banner
    assert p.discrete.hash[:16] in banner
    assert f'{p.name.upper()}_MODEL_HASH "{p.discrete.hash[:16]}"' in text
    for i, s in enumerate(model.states):
        assert re.search(rf"^ \*   {i}  {s.name} \[{re.escape(s.unit)}\]", banner, re.MULTILINE)
    for i, c in enumerate(model.constants):
        assert re.search(rf"k\[{i}\]  {c.name} \[{re.escape(c.unit)}\]", banner)


def banner_of(**options: float) -> str:
    """The banner up to the operation counts."""
    d = DiscreteModel(build("ahrs6"), **options)  # type: ignore[arg-type]
    text = files(Program(d))["ahrs6.h"]
    return text[: text.index("Operations (")]


@pytest.mark.parametrize("options", [{"rate": 50.0}, {"max_step": 0.05}, {"order": 2}], ids=str)
def test_banner_distinguishes_headers_of_other_options(options: dict[str, float]) -> None:
    """Headers of one model at another rate, longest step or order are other filters: each must say so."""
    assert banner_of(**options) != banner_of()


@pytest.mark.parametrize("name", NAMES)
def test_operation_counts_are_those_of_the_text(name: str) -> None:
    p = program(name)
    text = files(p)[f"{p.name}.h"]
    said = dict(re.findall(rf"^ \*   {p.name}_(\w+): (\d+)$", text, re.MULTILINE))
    for r in p.routines[1:]:
        longer = "_with_variance" if len(r.required) < len(r.arguments) else ""
        start = text.index(f"{p.name}_{r.name}{longer}({p.name}_t *kf")
        body = text[start : text.index("return status;", start)]
        code = re.sub(r"/\*.*?\*/", "", body[body.index("{") :])
        counted = len(re.findall(r" [-+*/] ", code)) + code.count("KF_SQRT(")
        assert int(said[r.name]) == counted > 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "target"), [pytest.param("ins15", "c", marks=pytest.mark.long), ("ahrs6", "filterpy")]
)
def test_emission_is_the_same_byte_for_byte(name: str, target: str, tmp_path: Path) -> None:
    noise = tmp_path / "noise.toml"
    noise.write_text(
        'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\neffects = [\n'
        ' { effect = "white_noise", N = "0.0035 deg/s/sqrt(Hz)" },\n'
        ' { effect = "gauss_markov", sigma = "0.002 deg/s", tau = "100 s" },\n'
        ' { effect = "temperature", coefficient = "1e-3 deg/s/K" } ]\n'
    )
    folders = []
    for seed in ("1", "4242"):
        folder = tmp_path / seed
        words = [sys.executable, "-m", "kfgen", "emit", name, "--target", target, "-o", str(folder)]
        env = {**os.environ, "PYTHONHASHSEED": seed}
        subprocess.run([*words, "--noise", str(noise)], check=True, env=env, capture_output=True)
        folders.append(
            {f.relative_to(folder): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}
        )
    assert len(folders[0]) >= 3
    assert folders[0] == folders[1]


class OnHost:
    """A compiled filter whose state can be set and whose status can be read."""

    def __init__(self, name: str, tmp_path: Path) -> None:
        if shutil.which(os.environ.get("CC") or "cc") is None:
            pytest.skip("there is no C compiler on this machine")
        p = program(name)
        (tmp_path / "scratch").mkdir()
        write_folder(p, "c", None, tmp_path / "c")
        self.core = Host(p, tmp_path / "c", tmp_path / "scratch")
        self.status = ctypes.c_uint.in_dll(self.core._library, "last_status")
        self.core.call("init", ())
        self.p = p

    def call(self, routine: str, *inputs: float) -> int:
        self.core.call(routine, inputs)
        return self.status.value


@pytest.mark.parametrize("name", in_part(NAMES))
def test_c_refuses_bad_steps_and_gated_samples(name: str, tmp_path: Path) -> None:
    host = OnHost(name, tmp_path)
    inputs = [0.1] * (sum(a.size or 1 for a in host.p.routines[1].arguments) - 1)
    rows = host.p.routines[2].arguments[0].size
    update = host.p.routines[2].name
    for _ in range(5):
        assert host.call("predict", *inputs, 0.01) == 0
    before = host.core.words()
    for dt in BAD_STEPS:
        assert host.call("predict", *inputs, dt) == STATUS.index("BAD_STEP"), dt
        assert (host.core.words() == before).all()
    watched = len(host.p.supervisor.places)
    for z, status in ((90.0, "GATED"), (math.inf, "BAD_INPUT"), (math.nan, "BAD_INPUT")):
        assert host.call(update, *[z] * rows) == STATUS.index(status), z
        assert (host.core.words()[:-watched] == before[:-watched]).all()
    assert host.call("predict", *inputs, 0.1) == 0
    assert (host.core.words()[:-watched] != before[:-watched]).any()


def test_c_has_the_status_numbers_of_the_reference() -> None:
    text = files(program("ahrs6"))["ahrs6.h"]
    numbers = {k: int(v) for k, v in re.findall(r"KF_(?!REASON)(\w+) = (\d+)", text)}
    assert numbers == {name: k for k, name in enumerate(STATUS)}
    first = ["OK", "LIMITED", "GATED", "NOT_POSITIVE", "BAD_STEP", "BAD_INPUT"]
    assert list(numbers)[: len(first)] == first, "numbers are kept"


def emitted_c(folder: Path, name: str, form: str = "p") -> Path:
    write_folder(program(name, 1, form), "c", None, folder)
    return folder


@pytest.mark.parametrize(("name", "form"), in_part([("ahrs6", "p"), ("ins15", "ud"), ("gyro-static", "p")]))
def test_the_example_program_runs(name: str, form: str, tmp_path: Path) -> None:
    folder = emitted_c(tmp_path / "f", name, form)
    out = str(tmp_path / "main")
    words = [compiler("gcc"), "-std=c99", "-O1", *STRICT, str(folder / "main.c"), "-lm", "-o", out]
    subprocess.run(words, check=True)
    done = subprocess.run([out], capture_output=True, text=True, check=True)
    found = re.search(r"status (\d+), NIS (\S+), health (\S+)", done.stdout)
    assert found
    assert int(found[1]) <= STATUS.index("GATED"), (
        "the samples of one instant are no motion: a gate may close, no more"
    )
    assert 0.0 < float(found[3]) <= 1.0


def test_the_package_files_say_what_they_are(tmp_path: Path) -> None:
    folder = emitted_c(tmp_path / "f", "ahrs6")
    library = json.loads((folder / "library.json").read_text())
    assert (library["name"], library["headers"]) == ("ahrs6", ["ahrs6.h"])
    lines = (folder / "library.properties").read_text().splitlines()
    properties = dict(line.split("=", 1) for line in lines)
    # the keys that the Arduino library specification calls required
    assert properties.keys() >= {
        "name",
        "version",
        "author",
        "maintainer",
        "sentence",
        "paragraph",
        "category",
    }
    assert properties["includes"] == "ahrs6.h"
    assert "name: ahrs6\n" in (folder / "zephyr" / "module.yml").read_text()
    assert "add_library(ahrs6 INTERFACE)" in (folder / "CMakeLists.txt").read_text()


def test_the_banner_names_what_no_measurement_shows() -> None:
    """A level body at rest cannot tell a tilt from a bias: g (9.80665 m/s^2) to the radian."""
    text = files(program("ins15"))["ins15.h"]
    banner = text[: text.index("*/")]
    assert "1 mrad of north tilt is hidden by 9.807 mm/s^2 of east accelerometer bias" in banner
    assert "Heading is unobservable: no measurement depends on it" in banner


BAD_MODELS = [
    ('omega = "rad/s"\n', 'int = "rad/s"\n', "needs the name 'int'"),
    ('omega = "rad/s"\n', 'Theta = "rad/s"\n', "differ by case only"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD_MODELS)
def test_names_that_no_code_can_carry_are_refused(
    old: str, new: str, message: str, kfgen: Any, tmp_path: Path
) -> None:
    text = """
format = "kfgen-model-1"
name = "swing"
[states]
theta = "rad"
omega = "rad/s"
[dynamics]
theta = "omega"
omega = "-9.8*theta"
[measurements.angle]
unit = "rad"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]
"""
    word = new.split(" =", maxsplit=1)[0]
    changed = (
        text.replace(old, new).replace('omega = "-9.8', f'{word} = "-9.8').replace('"omega"', f'"{word}"')
    )
    (tmp_path / "swing.toml").write_text(changed)
    out = tmp_path / "out"
    with pytest.raises(InputError, match=message):
        Program(DiscreteModel(build(str(tmp_path / "swing.toml"))))
    assert kfgen("emit", tmp_path / "swing.toml", "--target", "c", "-o", out).exit_code == 2
    assert not out.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["swing.toml"]


def test_a_measurement_that_shows_no_state_is_refused(kfgen: Any, tmp_path: Path) -> None:
    text = """
format = "kfgen-model-1"
name = "blind"
[states]
theta = "rad"
[inputs]
u = "rad/s"
[dynamics]
theta = "u"
[measurements.angle]
unit = "rad/s"
expression = "2.0*u"
effects = [ { effect = "white_noise", N = "0.02 rad/s/sqrt(Hz)" } ]
"""
    (tmp_path / "blind.toml").write_text(text)
    done = kfgen("emit", tmp_path / "blind.toml", "--target", "c", "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert [p.name for p in tmp_path.iterdir()] == ["blind.toml"]


@pytest.mark.parametrize(
    "options",
    [["--form", "qr"], ["--real", "half"], ["--rate", "0"], ["--target", "ada"], ["--order", "9"]],
    ids=" ".join,
)
def test_a_wrong_option_is_said_and_nothing_is_written(
    options: list[str], kfgen: Any, tmp_path: Path
) -> None:
    words = ["emit", "ahrs6", *([] if "--target" in options else ["--target", "c"]), *options]
    assert kfgen(*words, "-o", tmp_path / "out").exit_code == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", [["--form", "ud"], ["--loops"]], ids=" ".join)
def test_filterpy_has_no_factors_and_no_loops(option: list[str], kfgen: Any, tmp_path: Path) -> None:
    assert kfgen("emit", "ahrs6", "--target", "filterpy", *option, "-o", tmp_path / "out").exit_code == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("form", "loops"), FORMS)
@pytest.mark.parametrize("name", ["ins15", "pendulum", "ahrs6 loaded"])
def test_numpy_module_of_any_form_is_python_with_the_words_of_the_reference(
    name: str, form: str, loops: bool, tmp_path: Path
) -> None:
    p = program(name, 1, form, loops)
    ((file, text),) = numpy_module(p).items()
    (tmp_path / file).write_text(text)
    kf = runpy.run_path(str(tmp_path / file))[class_name(p)]()
    machine = Machine(p)
    machine.call("init")
    routines = {r.name: r for r in p.routines}
    for call in scenario(p, 30):
        routine = routines[call.routine]
        values = split(routine, call.inputs)
        status = getattr(kf, call.routine)(*values)
        assert status.name == machine.call(call.routine, values)
    words = np.concatenate([getattr(kf, array) for array in p.compared])
    assert words.tobytes() == machine.words().tobytes()
    assert kf.check().name == machine.call("check")


@pytest.mark.parametrize(("form", "real", "loops"), [("p", "float", False), ("ud", "double", True)])
def test_numpy_module_has_the_words_of_the_reference(
    form: str, real: str, loops: bool, kfgen: Any, tmp_path: Path
) -> None:
    """And a changed gain in it is found."""
    words = ["--form", form, "--real", real, *(["--loops"] if loops else [])]
    folder = tmp_path / "n"
    assert kfgen("emit", "gyro-static", "--target", "numpy", *words, "-o", folder).exit_code == 0
    assert kfgen("verify", folder).exit_code == 0
    path = folder / "gyro_static.py"
    text = path.read_text()
    head, body = text.split("def update_rest", 1)
    assert "F(1.0) / " in body
    path.write_text(head + "def update_rest" + body.replace("F(1.0) / ", "F(1.001) / ", 1))
    assert kfgen("verify", folder).exit_code == 1


def test_a_folder_with_other_files_below_is_left_alone(kfgen: Any, tmp_path: Path) -> None:
    folder = emitted_c(tmp_path / "f", "gyro-static")
    (folder / "zephyr" / "mine.txt").write_text("mine")
    assert kfgen("emit", "gyro-static", "--target", "c", "-o", folder).exit_code == 2
    assert (folder / "zephyr" / "mine.txt").read_text() == "mine"


def test_noise_of_less_rank_than_states_leaves_the_factors_whole() -> None:
    """At the origin at rest, the right-invariant error's noise has exact zeros on its way to factors."""
    f = Filter("right-invariant", 1, 3, form="ud")
    f.x[:6] = 0.0
    f.machine.arrays["x"][:] = f.x
    Phi, Qd, _ = f.evaluate("step")
    assert np.linalg.matrix_rank(Qd) < np.count_nonzero(np.diag(Qd)) or (np.diag(Qd)[:3] == 0).all()
    assert f.machine.call("predict", f.arguments("predict")) == "OK"
    assert_near(f.covariance(), Phi @ f.P @ Phi.T + Qd)


def test_noise_of_constant_states_may_wait() -> None:
    """Biases that walk: nothing of their noise for four steps of 0.04 s, then that of one of them at each step."""
    constant = build("ins15", None, {"biases": "constant"})
    model = constant
    for axis in "xyz":
        model = model.augment(f"gyro_{axis}", make("rate_random_walk", K=1e-3))
    f = Filter("ins15", 1, 7, form="ud")
    d = DiscreteModel(model)
    deferred = Machine(Program(d, "ud", q_interval=0.1), np.float64)
    prompt = Machine(Program(d, "p"), np.float64)
    still = Machine(Program(DiscreteModel(constant), "p"), np.float64)
    for machine in (deferred, prompt, still):
        machine.call("init")
        machine.arrays["x"][:] = f.x
    deferred.arrays["UD"][:] = f.machine.arrays["UD"]
    for machine in (prompt, still):
        machine.arrays["P"][:] = f.P[np.triu_indices(15)]
    come: set[int] = set()
    for step in range(1, 8):
        arguments = f.arguments("predict")
        assert {m.call("predict", arguments) for m in (deferred, prompt, still)} == {"OK"}
        if step <= 4:
            assert_near(deferred.covariance(), still.covariance())
            continue
        # Biases keep their covariance; K^2 by the second of the gyros' comes in for the four steps before.
        grown = (deferred.covariance() - still.covariance())[12:, 12:]
        walked = {k for k in range(3) if grown[k, k] > 0.5e-6 * 0.16}
        assert len(walked) == step - 4 > len(come)
        assert walked > come
        np.testing.assert_allclose(
            grown, np.diag([1e-6 * 0.16 * (k in walked) for k in range(3)]), atol=1e-13
        )
        come = walked
    assert deferred.arrays["waiting"].tolist() == pytest.approx([0.12, 0.16, 3.0])
    still_to_come = np.diag([0.0] * 12 + [1e-6 * 0.12] * 3)
    sd = np.sqrt(np.diag(prompt.covariance()))
    assert np.abs(np.sqrt(np.diag(deferred.covariance() + still_to_come)) / sd - 1.0).max() < 1e-2
    few, many = (Program(d, "ud", q_interval=s).predict.operations for s in (0.1, 0.0))
    assert few < 0.6 * many


def test_noise_waits_with_factors_only(kfgen: Any, tmp_path: Path) -> None:
    assert (
        kfgen(
            "emit", "ins15", "--target", "c", "--form", "p", "--q-interval", "0.2", "-o", tmp_path / "f"
        ).exit_code
        == 2
    )
    assert list(tmp_path.iterdir()) == []


def test_a_folder_whose_python_was_run_is_emitted_again(kfgen: Any, tmp_path: Path) -> None:
    """Running the self-test leaves Python's cache, which is no file of the user's."""
    folder = tmp_path / "f"
    assert kfgen("emit", "gyro-static", "--target", "numpy", "-o", folder).exit_code == 0
    compileall.compile_dir(folder, quiet=1)
    assert any((folder / "__pycache__").iterdir())
    assert kfgen("emit", "gyro-static", "--target", "numpy", "-o", folder).exit_code == 0


TURNED = """
format = "kfgen-model-1"
name = "{name}"
[states]
{state} = {{ unit = "rad", initial = "0 rad", sd = "0.1 rad" }}
[inputs]
{given} = "rad/s"
[dynamics]
{state} = "{given}"
[measurements.angle]
unit = "rad"
expression = "{state}"
effects = [ {{ effect = "white_noise", N = "0.02 rad/sqrt(Hz)" }} ]
"""


@pytest.mark.parametrize("name", ["friend", "nullptr", "alignas"])
def test_an_input_with_a_word_of_another_language_compiles_in_it(name: str, tmp_path: Path) -> None:
    """C++ has words that C has not."""
    compiler("g++")
    file = tmp_path / "m.toml"
    file.write_text(TURNED.format(name="turned", state="theta", given=name))
    write_folder(Program(DiscreteModel(build(str(file)))), "c", None, tmp_path / "c")
    (verdict,) = verify(read_folder(tmp_path / "c"), ["hostcpp"])
    assert verdict.differing == 0


@pytest.mark.parametrize("state", ["state", "nis", "covariance"])
def test_a_state_with_the_name_of_a_getter_is_refused(state: str, kfgen: Any, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(TURNED.format(name="turned", state=state, given="u"))
    assert kfgen("emit", tmp_path / "m.toml", "--target", "c", "-o", tmp_path / "out").exit_code == 2
    assert [p.name for p in tmp_path.iterdir()] == ["m.toml"]


@pytest.mark.parametrize("name", ["selftest", "numpy", "status", "F"])
def test_a_model_that_hides_a_module_is_refused(name: str, kfgen: Any, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(TURNED.format(name=name, state="theta", given="u"))
    done = kfgen("emit", tmp_path / "m.toml", "--target", "numpy", "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert [p.name for p in tmp_path.iterdir()] == ["m.toml"]


SAMPLES = [
    ({}, "Inputs of a step: the sample at its beginning."),
    ({"samples": "before"}, "Inputs of a step: the sample at its end."),
]


@pytest.mark.parametrize("target", in_part(["c", "numpy", "filterpy"]))
@pytest.mark.parametrize(("options", "sentence"), in_part(SAMPLES))
def test_what_acts_on_a_log_is_said_to_who_has_none(
    options: dict[str, str], sentence: str, target: str, tmp_path: Path
) -> None:
    """Options that choose among the samples of a log are not in the filter: its text says what is left to do."""
    write_folder(Program(DiscreteModel(build("ahrs6", None, options))), target, None, tmp_path / "f")
    (text,) = (p.read_text() for p in (tmp_path / "f").glob("ahrs6.*"))
    assert sentence in text
    write_folder(Program(DiscreteModel(build("ahrs6"))), target, None, tmp_path / "g")
    (text,) = (p.read_text() for p in (tmp_path / "g").glob("ahrs6.*"))
    assert (sentence in text) == (options == {})
