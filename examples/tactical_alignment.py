"""Gyrocompassing: how well a unit at rest finds north from the turning of the Earth.

A bias of the east gyro looks like a heading: however long it lasts, no alignment gets below
``sigma_bg / (Omega cos L)``, 0.054 deg for 0.01 deg/h at 45 degrees.
"""

import math

import numpy as np

from kfgen.core.units import parse_quantity
from kfgen.effects import Effect, make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.emit.routines import Program
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.parts.earth import EARTH_RATE
from kfgen.run.run import run
from kfgen.simulate.simulate import simulate

LATITUDE = math.radians(45.0)
bias_g = parse_quantity("0.01 deg/h", "rad/s")
bias_a = parse_quantity("100 ug", "m/s^2")


def channel(unit: str, *effects: Effect) -> ChannelNoise:
    """The noise of one channel."""
    return ChannelNoise(unit, tuple(Term(e) for e in effects))


walk = parse_quantity("5e-4 deg/sqrt(h)", "rad/sqrt(s)")
gyro = channel("rad/s", make("white_noise", N=walk), make("bias", sd=bias_g))
accel = channel("m/s^2", make("white_noise", N=1e-4), make("bias", sd=bias_a))
noise = NoiseModel({f"gyro_{a}": gyro for a in "xyz"} | {f"accel_{a}": accel for a in "xyz"})
model = build("ins15", noise, {"earth_rate": "true", "latitude": "45 deg", "sensors": "gnss_velocity"})
discrete = DiscreteModel(model, order=2, max_step=1.0, rate=1.0)
result = run(Program(discrete), simulate(discrete, "static", 3600.0, np.random.default_rng(1)))

names = [s.name for s in model.states]
heading = np.degrees(result.deviation[-1, names.index("phi_D")])
limit = math.degrees(bias_g / (EARTH_RATE * math.cos(LATITUDE)))
print(f"after an hour at rest the filter knows north to {heading:.4f} deg; the limit is {limit:.4f} deg")
assert limit < heading < 1.05 * limit
