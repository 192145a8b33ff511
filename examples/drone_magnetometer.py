"""The iron of a drone as states: an attitude filter learns the field that the body carries along.

With an attitude that were known, n samples of noise ``sigma`` would give each component to ``sigma / sqrt(n)``;
what the filter says is above that, for it learns attitude, gyro bias and the Earth's field from the same samples.
"""

import numpy as np

from kfgen.emit.routines import Program
from kfgen.log.log import Channel, Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.run.run import run
from kfgen.simulate.simulate import simulate

RATE, DURATION = 50.0, 60.0
IRON = np.array([4e-6, -3e-6, 2e-6])
plain = build("ahrs6", None, {"left_out": "false"})
learning = build("ahrs6", None, {"left_out": "false", "hard_iron": "true", "field": "state"})
log = simulate(DiscreteModel(plain, rate=RATE), "generic", DURATION, np.random.default_rng(3))
channels = dict(log.channels) | {
    f"mag_{a}": Channel(log.values(f"mag_{a}") + iron, "T") for a, iron in zip("xyz", IRON, strict=True)
}
log = Log(log.t, channels, source=log.source)

result = run(Program(DiscreteModel(learning, rate=RATE)), log)
states = [s.name for s in learning.states]
found = np.array([result.estimate[-1, result.names.index(f"b_mag_{a}")] for a in "xyz"])
assumed = np.array([result.deviation[-1, states.index(f"b_mag_{a}")] for a in "xyz"])
bound = learning.sensor("mag").sd / np.sqrt(log.n)
print(
    f"hard iron to {np.abs(found - IRON).max() * 1e9:.0f} nT at worst; the filter says {assumed.max() * 1e9:.0f} nT, "
    f"the bound for a known attitude is {bound * 1e9:.0f} nT"
)
