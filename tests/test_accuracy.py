"""Proves what a header says of the order of its transition and noise: by an integration of its own.

The reference is the matrix equation ``Phi' = F Phi`` and ``P' = F P + P F' + W`` along the same turn, by the classical
Runge-Kutta method with twenty steps in a period, with F written down here for `ins15`.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from scipy.spatial.transform import Rotation

from kfgen.emit.accuracy import step_accuracy
from kfgen.emit.routines import Program
from kfgen.emit.targets import plain
from kfgen.emit.targets.c import header
from kfgen.emit.targets.filterpy import class_name
from kfgen.emit.targets.loaded import loaded
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build

RATE = 100.0


def skew(a: Any) -> Any:
    return np.cross(np.eye(3), a)


def matrices(t: float) -> tuple[Any, Any]:
    """F and W of position, velocity, attitude error, accelerometer and gyro biases, turning at 1 rad/s about each axis."""
    R = Rotation.from_rotvec([t] * 3).as_matrix()
    F, W = np.zeros((15, 15)), np.zeros((15, 15))
    F[0:3, 3:6] = np.eye(3)
    F[3:6, 6:9] = -skew(R @ [0.0, 0.0, -9.80665])
    F[3:6, 9:12], F[6:9, 12:15] = -R, -R
    W[3:6, 3:6], W[6:9, 6:9] = 2e-3**2 * np.eye(3), 1.5e-4**2 * np.eye(3)
    W[9:12, 9:12], W[12:15, 12:15] = 3e-4**2 * np.eye(3), 2e-5**2 * np.eye(3)
    return F, W


def exact() -> tuple[Any, Any]:
    """Phi and the noise covariance after a second."""
    h, Phi, P = 1.0 / RATE / 20.0, np.eye(15), np.zeros((15, 15))

    def slope(t: float, Phi: Any, P: Any) -> tuple[Any, Any]:
        F, W = matrices(t)
        return F @ Phi, F @ P + P @ F.T + W

    for k in range(round(1.0 / h)):
        a = slope(k * h, Phi, P)
        b = slope((k + 0.5) * h, Phi + h / 2 * a[0], P + h / 2 * a[1])
        c = slope((k + 0.5) * h, Phi + h / 2 * b[0], P + h / 2 * b[1])
        d = slope((k + 1) * h, Phi + h * c[0], P + h * c[1])
        Phi, P = (m + h / 6 * (i + 2 * j + 2 * k_ + l) for m, i, j, k_, l in zip((Phi, P), a, b, c, d))
    return Phi, P


def predicted(order: int, P: Any) -> Any:
    """Covariance after a second of the emitted filter's predictions on that turn, from the upper triangle of P."""
    kf = filter_of(order)
    kf.init()
    kf.P[:] = P[np.triu_indices(15)]
    for _ in range(round(RATE)):
        assert kf.predict([0.0, 0.0, -9.80665], [1.0, 1.0, 1.0], 1.0 / RATE).name == "OK"
    return kf.covariance()


@cache
def filter_of(order: int) -> Any:
    program = Program(DiscreteModel(build("ins15"), order=order), "p", "double")
    return getattr(loaded(plain.module(program)), class_name(program))()


@pytest.mark.parametrize("order", in_part([1, 2]))
def test_the_header_says_how_far_phi_and_qd_are_off(order: int) -> None:
    """Phi from how P spreads from one state at a time, Qd from how it grows from nothing."""
    discrete = DiscreteModel(build("ins15"), order=order)
    phi, qd = step_accuracy(discrete)
    true_Phi, true_P = exact()
    noise = predicted(order, np.zeros((15, 15)))
    prior = np.array([s.prior for s in discrete.model.states])
    Phi = np.zeros((15, 15))
    for j in range(15):
        start = np.zeros((15, 15))
        start[j, j] = 1.0
        spread = predicted(order, start) - noise
        Phi[:, j] = spread[:, j] / np.sqrt(spread[j, j])
    off = (np.abs(Phi - true_Phi) * prior / prior[:, None]).max()
    said = float(re.search(r"its error is (\S+) prior", phi)[1])  # type: ignore[index]
    assert said == pytest.approx(off, rel=0.06), "the number has two digits"
    sd, true_sd = (np.sqrt(np.diag(m))[:9] for m in (noise, true_P))
    worst = (100.0 * (sd / true_sd - 1.0)).tolist()
    said = float(re.search(r"off by (\S+) %", qd)[1])  # type: ignore[index]
    assert said == pytest.approx(max(worst, key=abs), rel=0.5), "the number has one digit"
    assert ("That of one step is zero for p_N, p_E, p_D." in qd) == (order == 1)


def test_the_header_carries_it() -> None:
    program = Program(DiscreteModel(build("ins15")))
    text = " ".join(header(program).replace("\n *", "").split())
    for sentence in step_accuracy(program.discrete):
        assert sentence in text
    assert step_accuracy(DiscreteModel(build("gyro-static"))) == ()
