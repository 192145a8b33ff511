"""A new effect in one place: a bias that follows the supply voltage squared.

Declared once, in `effects/supply_squared.py`, it simulates, is found in a record by the gap workflow, and becomes a filter
state. ``kfgen judge`` says of a log of yours whether such a declaration earns its place.
"""

import numpy as np
from effects.supply_squared import SupplySquared

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.words import finding_sentence
from kfgen.identify.evidence.record import Record
from kfgen.model.library import build

rng = np.random.default_rng(1)
t = np.arange(36_000) / 10.0
voltage = 3.3 + 0.2 * np.sin(2 * np.pi * t / 900.0) * np.exp(-t / 3000.0)
white, hidden = make("white_noise", N=1e-4), SupplySquared(coefficient=5e-3)
y = white.simulate(t, rng) + hidden.simulate(t, rng, {"voltage": voltage})

assumed = ChannelNoise("deg/s", (Term(white),))
gap = channel_gap("gyro_x", Record(t, y, {"voltage": voltage}), assumed)
for finding in gap.findings:
    print(finding_sentence(gap, finding))
assert [f.effect.name for f in gap.findings] == ["supply_squared"]

filter_model = build("gyro-static").augment("gyro_x", gap.findings[0].effect)
print("states:", ", ".join(f"{s.name} [{s.unit}]" for s in filter_model.states))
