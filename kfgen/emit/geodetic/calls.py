"""The calls by which the border is proven: a way that leaves the origin, what is refused, places."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kfgen.emit.geodetic.origin import Border
from kfgen.emit.reference import Machine
from kfgen.emit.scenario import RecordedCall, split

FIXES = 60
STEP_RAD = 1e-4
"""Of latitude, and half as much of longitude, from fix to fix: 740 m."""
START = (0.82, -3.14, 300.0)
"""Latitude, longitude [rad], near where longitude wraps, and height [m]."""


def border_calls(border: Border) -> tuple[RecordedCall, ...]:
    """The calls of the proof, with all numbers after each."""
    machine = Machine(border)
    machine.call("init")
    calls = []
    for name, inputs in _given():
        machine.call(name, split(machine.routines[name], inputs))
        calls.append(RecordedCall(name, inputs, machine.words()))
    return tuple(calls)


def _given() -> Iterator[tuple[str, tuple[float, ...]]]:
    rng = np.random.default_rng(3)
    yield "to_place", (1.0, 2.0, 3.0)
    at = np.array(START)
    for k in range(FIXES):
        if k % 20 == 19:
            yield "fix", (2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            yield "fix", (-at[0], 0.0, at[2], 0.0, 0.0, 0.0)
        at += np.array([STEP_RAD, -0.5 * STEP_RAD, rng.normal()])
        p = rng.normal(size=3) + np.array([600.0, -300.0, 0.0]) * (k % 20)
        yield "fix", (*at.tolist(), *p.tolist())
        yield "to_place", tuple(p.tolist())
    yield "set_origin", START
