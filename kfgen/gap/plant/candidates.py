"""Where the effects of a plant can act, and from which values a fit of them should start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import sensor_and_axis
from kfgen.core.expression import symbol
from kfgen.core.units import parse_unit
from kfgen.effects import catalogue
from kfgen.effects.plant.sensor import Backlash, SensorLag
from kfgen.effects.plant.terms import (
    ConstantInput,
    CoulombFriction,
    InputDeadZone,
    InputDelay,
    InputLag,
    InputNonlinearity,
    ParameterError,
    PlantEffect,
    QuadraticDrag,
    Saturation,
    SquareLaw,
    StateTerm,
)
from kfgen.gap.plant.sensor_errors import SENSORS
from kfgen.gap.scene.scene import Placed
from kfgen.model.plant.user import UserModel

Array = NDArray[np.float64]

SMOOTH = 0.01
"""Share of a speed's rms over which dry friction is smooth."""
TIMES = (0.05, 0.3, 1.0, 4.0, 16.0)
"""Start values of lags and delays, in sampling periods."""
LONGEST = 0.05
"""The longest of them, in records."""
LIMITS = (0.98, 0.94, 0.87, 0.75, 0.6, 0.4, 0.2)
"""Start values of a saturation, in largest inputs."""
DEAD = (0.003, 0.03, 0.1, 0.3)
"""Start values of a dead zone, in largest inputs."""
MAX_BACKLASH_FRACTION = 0.3
"""Widest start value of a backlash, in rms of the channel; the narrowest is a standard deviation of its noise."""
FINER = 2.5
"""Times by which its start values differ at most: what turns at a width is seen from nearby only."""
SPEEDS = ("m/s", "rad/s", "Hz")
NO_SPEED = 2.0
"""Nats by which dry friction and drag are rarer in the equation of a state that is no speed."""
SIMPLER = 0.05
"""Nats that settle a tie."""


def additions(
    model: UserModel,
    inputs: Mapping[str, Array],
    speeds: Mapping[str, float],
    seen: Mapping[str, tuple[float, float]],
    times: tuple[float, float, float],
    placed: Sequence[Placed],
) -> list[list[Placed]]:
    """The start values of every effect at every place, without those that are there already.

    Parameters
    ----------
    inputs : mapping of str to ndarray, shape (n,)
    speeds : mapping of str to float
        Rms of each state [SI].
    seen : mapping of str to (float, float)
        Rms of each channel about its mean, and standard deviation of its noise [SI].
    times : (float, float, float)
        Sampling period, length of the record, and how late the channels seem to be [s].
    """
    late = _late(times)
    found: list[list[tuple[str, PlantEffect]]] = []
    for name in moving(model):
        found += [[(name, e)] for e in _terms(model, name, speeds[name])]
    for name, u in inputs.items():
        found += [[(name, e) for e in starts] for starts in _changes(name, u, late)]
    for name, (size, noise) in seen.items():
        if sensor_and_axis(name)[0] not in SENSORS:  # where sensors move it is their bandwidth
            found.append([(name, SensorLag(t)) for t in late])
        found.append([(name, Backlash(width)) for width in _backlash_widths(size, noise)])
    found += [[(n, ParameterError(0.0))] for n, p in model.parameters.items() if p.sd == 0.0]
    known = {(p.where, p.effect.name) for p in placed} | _present(model)
    return [
        [Placed(e, where, _rare(model, where, e)) for where, e in starts]
        for starts in found
        if starts and (starts[0][0], starts[0][1].name) not in known
    ]


def _rare(model: UserModel, where: str, effect: PlantEffect) -> float:
    """Friction slows what moves: a level or a current has none, and what looks like it is mostly something else.

    A loss in proportion is no friction alone: a level leaks, a temperature falls to that about it, a charge drains.
    Where the record cannot tell, what is simpler comes first: a wrong number, a constant, then a new term.
    """
    if isinstance(effect, ParameterError):
        return 0.0
    if isinstance(effect, ConstantInput):
        return SIMPLER
    if not isinstance(effect, CoulombFriction | QuadraticDrag):
        return 2.0 * SIMPLER
    unit = parse_unit(model.states[where].unit)
    speed = any(unit.same_dimension(parse_unit(u)) for u in SPEEDS)
    return 2.0 * SIMPLER + (0.0 if speed or model.position_of(where) is not None else NO_SPEED)


def moving(model: UserModel) -> list[str]:
    """States on which forces act: those whose equation is neither another state nor a constant."""
    states = {symbol(n) for n in model.states}
    return [n for n, e in model.dynamics.items() if e.value not in states and e.value.free_symbols]


def _present(model: UserModel) -> set[tuple[str, str]]:
    """What the model has already and what does not add to itself."""
    acting = {(a.where, a.effect.name) for a in model.dynamics_effects if not isinstance(a.effect, StateTerm)}
    return acting | {(n, e.name) for n, m in model.measurements.items() for e in m.noise.effects}


def _late(times: tuple[float, float, float]) -> list[float]:
    dt, duration, seen = times
    usual = [k * dt for k in TIMES if k * dt <= LONGEST * duration] or [dt]
    return [*usual, seen] if seen > usual[-1] else usual


def _backlash_widths(size: float, noise: float) -> list[float]:
    """Widths from the noise of a channel up: at every reversal the narrowest matters as well as the widest."""
    if not size > 0.0:
        return []
    narrowest = min(noise, MAX_BACKLASH_FRACTION * size)
    count = 2 + int(np.log(MAX_BACKLASH_FRACTION * size / narrowest) / np.log(FINER))
    return [float(w) for w in np.geomspace(narrowest, MAX_BACKLASH_FRACTION * size, count)]


def _terms(model: UserModel, name: str, speed: float) -> list[PlantEffect]:
    """Every term that a state's equation may have."""
    out: list[PlantEffect] = []
    for cls in catalogue().values():
        if not issubclass(cls, StateTerm) or (cls.positional and model.position_of(name) is None):
            continue
        zero = {p.name: 0.0 for p in cls.estimated()}
        if issubclass(cls, CoulombFriction):
            own = [a.effect for a in model.dynamics_effects if a.where == name and isinstance(a.effect, cls)]
            v0 = own[0].v0 if own else SMOOTH * speed
            if v0 > 0.0:
                out.append(cls(**zero, v0=v0))
        else:
            out.append(cls(**zero))
    return out


def _changes(name: str, u: Array, late: Sequence[float]) -> list[list[PlantEffect]]:
    """What may happen to an input; nothing to one that never changes."""
    if not np.ptp(u) > 0.0:
        return []
    timing: list[list[PlantEffect]] = [[InputDelay(t) for t in late], [InputLag(t) for t in late]]
    if name.startswith("ref_"):
        return timing
    largest = float(np.abs(u).max())
    sizes: list[list[PlantEffect]] = [
        [InputNonlinearity(0.0, 0.0)],
        [Saturation(s * largest) for s in LIMITS],
    ]
    if np.unique(np.abs(u[u != 0.0])).size > 1:  # else a square is a wrong gain
        sizes.append([SquareLaw(0.0, largest)])
        if u.min() <= 0.0 <= u.max():  # else a dead zone is a constant
            sizes.append([InputDeadZone(s * largest) for s in DEAD])
    return [*timing, *sizes]
