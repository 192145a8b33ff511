"""The faults that a filter is flown through, each declared once: what it does to a flight, and what must be reported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.watch.rest import ROUTINE as DETECT_REST
from kfgen.verify.flight import FIX_RATE, START_S, Motion, TrialFlight, parked, turning

Mask = NDArray[np.bool_]
NOTHING = ""
REPORTED_WITHIN_S, RIGHT_WITHIN_S, WRONG_WITHIN_S = 1.0, 10.0, 1.0
"""Floors: until a status says it, until the position is right after the fault's end, wrong while a status says OK."""


@dataclass(frozen=True)
class FlightFault:
    """A fault.

    Parameters
    ----------
    title : str
        In words.
    seconds : float
        How long it lasts [s].
    spoil : callable
        Changes the arrays of a flight: the flight, the steps and the fixes at which the fault is there.
    reported_within : float
        Within which time a status must say it [s]; infinite where it is none until it has lasted.
    event : str
        What happens to the filter itself at its beginning: ``turned``, ``restored``, or nothing.
    motion : callable
        The flight that it comes into.
    needs : str
        A routine without which a filter is not flown through it, or nothing.
    """

    title: str
    seconds: float
    spoil: Callable[[TrialFlight, Mask, Mask], None] = lambda flight, steps, fixes: None
    reported_within: float = REPORTED_WITHIN_S
    event: str = NOTHING
    motion: Motion = turning
    needs: str = NOTHING


ONCE = 0.001
"""Seconds of what happens in one sample."""


def _set(name: str, value: float) -> Callable[[TrialFlight, Mask, Mask], None]:
    """An array has one value during the fault."""

    def spoil(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
        array = getattr(flight, name)
        array[steps if len(array) == len(steps) else fixes] = value

    return spoil


def _off(name: str, by: float) -> Callable[[TrialFlight, Mask, Mask], None]:
    """The first axis of a triad is off by as much during the fault."""

    def spoil(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
        getattr(flight, name)[steps, 0] += by

    return spoil


def _kept(*names: str) -> Callable[[TrialFlight, Mask, Mask], None]:
    """Arrays keep their last value before it."""

    def spoil(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
        for name in names:
            array = getattr(flight, name)
            there = np.flatnonzero(steps if len(array) == len(steps) else fixes)
            array[there] = array[there[0] - 1]

    return spoil


def _jump(size: float, for_good: bool) -> Callable[[TrialFlight, Mask, Mask], None]:
    """The fixes are off by as much along the diagonal, and nothing else shows a position: theirs is to be followed."""

    def spoil(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
        first = int(np.flatnonzero(fixes)[0])
        where = np.arange(len(fixes)) >= first if for_good else fixes
        flight.position[where] += size / 3.0**0.5
        flight.truth[where] += size / 3.0**0.5

    return spoil


def _spikes(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
    third = np.flatnonzero(fixes)[::3]
    flight.position[third] += 300.0
    flight.velocity[third] += 300.0


def _no_fix(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
    flight.position[fixes] = flight.velocity[fixes] = np.nan


def _late(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
    """Without time stamps the place that a late fix shows is to be followed."""
    there = np.flatnonzero(fixes)
    for array in (flight.position, flight.velocity, flight.truth):
        array[there] = array[there - round(LATE_S * FIX_RATE)].copy()


LATE_S = 1.0


def _swapped(flight: TrialFlight, steps: Mask, fixes: Mask) -> None:
    there = np.flatnonzero(fixes)
    pairs = there[: there.size // 2 * 2].reshape(-1, 2)
    for array in (flight.position, flight.velocity):
        array[pairs] = array[pairs[:, ::-1]].copy()


NEVER = float("inf")
FAULTS: tuple[FlightFault, ...] = (
    FlightFault("1 s of a gyro that is no number", 1.0, _set("gyro", np.nan)),
    FlightFault("dt = 0 for 5 s", 5.0, _set("dt", 0.0)),
    FlightFault("one dt of 10 s", ONCE, _set("dt", 10.0)),
    FlightFault("30 s of a stuck accelerometer", 30.0, _kept("accel")),
    FlightFault("30 s of frozen GNSS", 30.0, _kept("position", "velocity")),
    FlightFault("heading 120 deg off", ONCE, event="turned"),
    FlightFault("a permanent jump of 1 km", ONCE, _jump(1000.0, True)),
    FlightFault("one gyro sample of 1e8 rad/s", ONCE, _set("gyro", 1e8)),
    FlightFault("one accelerometer sample of 1e10 m/s^2", ONCE, _set("accel", 1e10)),
    FlightFault("0.5 s of an infinite accelerometer", 0.5, _set("accel", np.inf)),
    FlightFault("5 s of GNSS that is no number", 5.0, _no_fix),
    FlightFault("20 s without GNSS", 20.0, _set("absent", True), NEVER),
    FlightFault("10 s of spikes of 300 m and 300 m/s", 10.0, _spikes),
    FlightFault("1 s of a negative dt", 1.0, _set("dt", -0.01)),
    FlightFault("5 s of a stuck gyro", 5.0, _kept("gyro")),
    FlightFault("0.5 s without a call", 0.5, _set("called", False)),
    FlightFault("5 s of a dead accelerometer", 5.0, _set("accel", 0.0)),
    FlightFault("a jump of 1 km for 10 s, and back", 10.0, _jump(1000.0, False)),
    FlightFault("20 s of GNSS that is 1 s late", 20.0, _late),
    FlightFault("10 s of fixes in the wrong order", 10.0, _swapped),
    FlightFault("a restart from what was stored 2 s before", ONCE, event="restored"),
    FlightFault("20 s of an accelerometer that is 4 m/s^2 off", 20.0, _off("accel", 4.0)),
    FlightFault(
        "30 s without GNSS, parked", 30.0, _set("absent", True), NEVER, motion=parked, needs=DETECT_REST
    ),
)
"""All of them; the flight without one comes with `SOUND`."""
SOUND = FlightFault("no fault", ONCE, reported_within=NEVER)


def spoiled(flight: TrialFlight, fault: FlightFault) -> TrialFlight:
    """A flight with a fault in it.

    Parameters
    ----------
    flight : TrialFlight
        Without one.
    fault : FlightFault
    """
    out = flight.copy()
    end = START_S + fault.seconds
    steps = (flight.t >= START_S - 1e-9) & (flight.t < end - 1e-9)
    at = flight.t[flight.fixes]
    fixes = (at >= START_S - 1e-9) & (at < max(end, START_S + 1.0 / FIX_RATE) - 1e-9)
    fault.spoil(out, steps, fixes)
    return out
