"""`Machine`: a plant with one held input, simulated with or without a hidden effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from case import Array
from scipy.integrate import ode

Slope = Callable[[Sequence[float], float, Mapping[str, float]], list[float]]


@dataclass(frozen=True)
class Machine:
    """A plant.

    Parameters
    ----------
    parameters : mapping of str to (float, str)
        Value [SI] and unit.
    states : mapping of str to str
        Units. The speed is the state `speed`, its position `position`, where there is one.
    dynamics : mapping of str to str
        The expressions of the model file.
    slope : callable
        The same in Python: states, input, parameters to derivatives.
    output : int
        The state that is measured.
    noise : float
        Standard deviation of a sample, in `unit`; `factor` takes the unit to SI.
    drive : float
        Size of the input.
    same : mapping of str to str
        Effects that are nothing but a wrong number of this plant: which number.
    """

    name: str
    parameters: Mapping[str, tuple[float, str]]
    states: Mapping[str, str]
    input_unit: str
    dynamics: Mapping[str, str]
    slope: Slope
    output: int
    unit: str
    factor: float
    noise: float
    drive: float
    rate: float
    speed: int
    position: int = -1
    same: Mapping[str, str] = field(default_factory=dict)

    @property
    def channel(self) -> str:
        """The channel measured."""
        return f"measured_{list(self.states)[self.output]}"

    def text(self, numbers: Mapping[str, float]) -> str:
        """The model file."""
        N = self.noise * self.rate**-0.5
        names = list(self.states)
        lines = ['format = "kfgen-model-1"', f'name = "{self.name}"', "[parameters]"]
        lines += [f'{k} = "{numbers[k]:.10g} {unit}"' for k, (_, unit) in self.parameters.items()]
        lines += ["[states]"]
        lines += [
            f'{k} = {{ unit = "{u}", initial = "0 {u}", sd = "0.01 {u}" }}' for k, u in self.states.items()
        ]
        lines += ["[inputs]", f'u = "{self.input_unit}"', "[dynamics]"]
        lines += [f'{k} = "{v}"' for k, v in self.dynamics.items()]
        lines += [f"[measurements.{self.channel}]", f'unit = "{self.unit}"']
        lines += [f'expression = "{names[self.output]}"']
        lines += [f'effects = [ {{ effect = "white_noise", N = "{N:.10g} {self.unit}/sqrt(Hz)" }} ]']
        return "\n".join([*lines, ""])


@dataclass(frozen=True)
class Change:
    """What differs from the assumed plant; the names are those of the catalogue.

    Parameters
    ----------
    numbers : mapping
        True values of parameters that are assumed wrongly.
    """

    viscous_friction: float = 0.0
    coulomb_friction: float = 0.0
    quadratic_drag: float = 0.0
    spring: float = 0.0
    cubic_spring: float = 0.0
    constant_input: float = 0.0
    input_nonlinearity: float = 0.0
    saturation: float = np.inf
    input_delay: float = 0.0
    input_lag: float = 0.0
    sensor_lag: float = 0.0
    numbers: Mapping[str, float] = field(default_factory=dict)


SMOOTH = 0.02
"""Speed over which Coulomb friction turns [SI]."""


def respond(m: Machine, u: Array, start: Sequence[float], change: Change) -> Array:
    """The noise-free measured state [SI] at every sample, by Dormand and Prince's pair of orders 5 and 4.

    The input k acts from sample k to k + 1, later by the delay; the pieces between are integrated one by one.
    """
    size, dt = len(m.states), 1.0 / m.rate
    numbers = {k: v for k, (v, _) in m.parameters.items()} | dict(change.numbers)
    acting = np.clip(u, -change.saturation, change.saturation)
    acting = (acting + change.input_nonlinearity * acting**2 + change.constant_input).tolist()
    whole = int(change.input_delay / dt)
    part = change.input_delay - whole * dt
    solver = ode(_slope(m, change, numbers)).set_integrator("dopri5", rtol=1e-9, atol=1e-11, nsteps=5000)
    first = [*start, acting[0], start[m.output]]
    solver.set_initial_value(first, 0.0)
    column = size + 1 if change.sensor_lag else m.output
    out = [first[column]]
    for k in range(u.size - 1):
        if part > 1e-9 * dt:
            solver.set_f_params(acting[max(0, k - whole - 1)]).integrate(k * dt + part)
        solver.set_f_params(acting[max(0, k - whole)]).integrate((k + 1) * dt)
        out.append(float(solver.y[column]))
    return np.asarray(out)


def _slope(
    m: Machine, c: Change, numbers: Mapping[str, float]
) -> Callable[[float, Array, float], list[float]]:
    """Derivatives of the states, of the lagged input, and of the lagged sensor."""
    size = len(m.states)

    def slope(_: float, x: Array, u: float) -> list[float]:
        s = x.tolist()
        out = m.slope(s, s[size] if c.input_lag else u, numbers)
        v = s[m.speed]
        extra = -c.viscous_friction * v - c.quadratic_drag * v * abs(v)
        extra -= c.coulomb_friction * float(np.tanh(v / SMOOTH))
        if m.position >= 0:
            q = s[m.position]
            extra -= c.spring * q + c.cubic_spring * q**3
        out[m.speed] += extra
        lag = (u - s[size]) / c.input_lag if c.input_lag else 0.0
        late = (s[m.output] - s[size + 1]) / c.sensor_lag if c.sensor_lag else 0.0
        return [*out, lag, late]

    return slope


def excite(rng: np.random.Generator, m: Machine, n: int) -> Array:
    """Held levels of random length and size, and a small sine."""
    ends = np.cumsum(rng.exponential(0.6 * m.rate, n).astype(int) + 5)
    levels = rng.uniform(-1.0, 1.0, n)
    sine = 0.3 * np.sin(2.0 * np.pi * rng.uniform(0.2, 1.5) * np.arange(n) / m.rate)
    return np.asarray(m.drive * (levels[np.searchsorted(ends, np.arange(n), side="right")] + sine))
