"""A car loses GNSS for a minute: free inertial navigation beside wheels and the constraint that it does not slide.

With wheels the error at speed v is across the way: from where the outage began it grows by heading, gyro bias and
gyro noise as ``e_p + v T e_psi - v T^2 e_b / 2``, and by ``v^2 N^2 T^3 / 3`` in variance.
"""

import numpy as np

from kfgen.emit.routines import Program
from kfgen.log.log import Channel, Log
from kfgen.manoeuvre.motion import MotionProfile
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.parts.motion import GYRO
from kfgen.run.run import run
from kfgen.simulate.simulate import simulate_motion

SPEED, OUTAGE, RATE = 15.0, 60.0, 50.0
GNSS = "gnss_position,gnss_velocity"
t = np.arange(0.0, 180.0, 1.0 / RATE)
turning = 0.3 * np.sin(2 * np.pi * t / 20.0) * (t < t[-1] - OUTAGE)
course = np.concatenate([[0.0], np.cumsum(turning[:-1]) / RATE])
across = np.column_stack([-np.sin(course), np.cos(course), 0 * t]) * (SPEED * turning)[:, None]
motion = MotionProfile(t, np.outer(turning, [0.0, 0.0, 1.0]), across, np.eye(3), np.array([SPEED, 0.0, 0.0]))

wheels = build("ins15", None, {"sensors": f"{GNSS},non_holonomic,odometer", "left_out": "false"})
free = build("ins15", None, {"sensors": GNSS})
log = simulate_motion(DiscreteModel(wheels, order=2, rate=RATE), motion, np.random.default_rng(2))
lost = t >= t[-1] - OUTAGE
seldom = (np.arange(t.size) % int(RATE) != 0) | lost
channels = {
    n: Channel(np.where(seldom, np.nan, c.values), c.unit) if n.startswith("gnss") else c
    for n, c in log.channels.items()
}
log = Log(t, channels, source=log.source)

said = {}
for name, model in (("free", free), ("wheels", wheels)):
    program = Program(DiscreteModel(model, order=2, rate=RATE))
    result = run(program, log)
    east = result.estimate[-1, result.names.index("p_E")] - log.values("ref_p_E")[-1]
    said[name] = east, result.deviation[-1, [s.name for s in model.states].index("p_E")]

P = run(program, log.cut(0, int(np.argmax(lost)))).covariance
assert P is not None
states = [s.name for s in wheels.states]
at = [states.index(n) for n in ("p_E", "phi_D", "bg_z")]
a = np.array([1.0, SPEED * OUTAGE, -SPEED * OUTAGE**2 / 2])
theory = np.sqrt(a @ P[np.ix_(at, at)] @ a + SPEED**2 * GYRO.N**2 * OUTAGE**3 / 3)
print(
    f"{OUTAGE:g} s without GNSS, across the way: free {said['free'][0]:+.1f} m (filter says {said['free'][1]:.1f} m), "
    f"wheels {said['wheels'][0]:+.2f} m (filter says {said['wheels'][1]:.2f} m, theory {theory:.2f} m)"
)
