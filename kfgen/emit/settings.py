"""What firmware sets before it compiles: limits of inputs, noise of samples, priors, the supervisor's times.

Each is a macro of the C header and a variable of a Python module, with a default from here or from the model.
"""

from __future__ import annotations

from kfgen.emit.align import Alignment
from kfgen.emit.targets.names import identifier
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.constant import Constant

MAX_BY_UNIT = {"rad/s": 100.0, "m/s^2": 1000.0, "T": 1e-3, "m": 1e7, "m/s": 1e4, "rad": 1e3}
"""Largest plausible magnitude of a channel by its unit [SI], where the model declares no range of its sensor.

5700 deg/s and 100 g are beyond every gyro and accelerometer of a strapdown system, 10 gauss is 15 times the Earth's
field, 1e7 m beyond its radius.
"""
RANGE_MARGIN = 1.01
"""Of a declared range: a sensor at its end gives the range times its scale factor."""
MAX_OTHER = 1e15
"""The same for other units: what keeps squares in single precision."""

SUPERVISION = (
    Constant("RESET_AFTER", "s", 2.0, "a sensor whose samples are rejected for so long widens its states"),
    Constant("RESET_COUNT", "1", 20.0, "so many samples rejected in a row do so as well"),
    Constant("ESCALATE_WITHIN", "s", 10.0, "a second reset within this time widens all states"),
    Constant("NIS_WEIGHT", "1", 0.1, "weight of a new sample in the mean squared innovation of a sensor"),
    Constant(
        "NIS_SHARE", "1", 0.025, "share of the gate, for each row, beyond which that mean widens all states"
    ),
    Constant("RESYNC_AFTER", "s", 0.2, "predictions missed for so long widen all states"),
    Constant("RESET_ATTITUDE", "rad", 0.6, "least standard deviation of the attitude where all is widened"),
    Constant("DEGRADED_COUNT", "1", 2.0, "so many samples of a sensor rejected in a row: DEGRADED"),
    Constant("SETTLE_TIME", "s", 3.0, "the filter is DEGRADED for so long after a reset"),
    Constant("STUCK_TIME", "s", 0.5, "a triad of inputs without any change for so long: DEGRADED"),
    Constant("LOST_AFTER", "s", 10.0, "no sample of any sensor accepted for so long: LOST"),
)
"""When the supervisor acts; `docs/emit.md` says why these are the defaults."""


def settings(discrete: DiscreteModel) -> dict[str, Constant]:
    """Every setting of a filter by name."""
    model = discrete.model
    found = [*SUPERVISION, *Alignment(model).constants()]
    for i in model.motion.inputs:
        found.append(_limit(i.name, i.unit, i.title, model.limits.get(i.name)))
    units = {n: i.unit for i in model.motion.inputs for n in (i.name, *i.channels)}
    for name, (_, density) in discrete.named_noise[1].items():
        text = f"density of the noise of {name} and of what the model leaves out"
        unit = f"({units[name]})^2/Hz"
        found.append(Constant(f"Q_{identifier(name).upper()}", unit, float(density), text))
    for s in model.sensors:
        found.append(_limit(f"{s.name}_sample", s.unit, s.title, model.limits.get(s.name)))
        if s.min_length:
            text = f"smallest plausible length: {s.title}"
            found.append(Constant(f"MIN_{identifier(s.name).upper()}", s.unit, s.min_length, text))
        for channel in s.channels:
            variance = discrete.measurement_variance(s, channel)
            text = f"variance of a sample of {channel}, {variance**0.5:.4g} {s.unit} squared"
            found.append(Constant(f"R_{identifier(channel).upper()}", f"({s.unit})^2", variance, text))
    for state in model.states:
        text = f"standard deviation at the start: {state.title}"
        found.append(Constant(f"PRIOR_{identifier(state.name).upper()}", state.unit, state.prior, text))
    return {c.name: c for c in found}


def _limit(name: str, unit: str, title: str, declared: float | None) -> Constant:
    value = MAX_BY_UNIT.get(unit, MAX_OTHER) if declared is None else RANGE_MARGIN * declared
    return Constant(f"MAX_{identifier(name).upper()}", unit, value, f"largest plausible magnitude: {title}")
