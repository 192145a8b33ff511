"""What firmware sets before it compiles: limits of inputs, noise of samples, priors, the supervisor's times.

Each is a macro of the C header and a variable of a Python module, with a default from here or from the model.
"""

from __future__ import annotations

from kfgen.emit.align import Alignment
from kfgen.emit.gather import GATHER_SAMPLES, gathered_inputs
from kfgen.emit.ir.ir import Expr, Num, add, mul
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.moving.places import SETTINGS as MOVING
from kfgen.emit.moving.places import alignable
from kfgen.emit.targets.names import identifier
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.sensors import Sensor

MAX_BY_UNIT = {"rad/s": 100.0, "m/s^2": 1000.0, "T": 1e-3, "m": 1e7, "m/s": 1e4, "rad": 1e3}
"""Largest plausible magnitude of a channel by its unit [SI], where the model declares no range of its sensor.

5700 deg/s and 100 g are beyond every gyro and accelerometer of a strapdown system, 10 gauss is 15 times the Earth's
field, 1e7 m beyond its radius.
"""
GATE_SIGMAS = 10.0
"""Samples that are merely unlikely count, faults do not."""
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
    found = [*SUPERVISION, *Alignment(model).constants(), *(MOVING if alignable(model) else ())]
    if gathered_inputs(model):
        found.append(GATHER_SAMPLES)
    for i in model.motion.inputs:
        found.append(_limit(i.name, i.unit, i.title, model.limits.get(i.name)))
    units = {n: i.unit for i in model.motion.inputs for n in (i.name, *i.channels)}
    for name, (_, density) in discrete.named_noise[1].items():
        left_out = left_out_of(discrete, name)
        N = max(float(density) - left_out**2, 0.0) ** 0.5
        unit, word = f"{units[name]}/sqrt(Hz)", identifier(name).upper()
        found.append(Constant(f"N_{word}", unit, N, f"white noise of {name}"))
        found.append(Constant(f"LEFT_OUT_{word}", unit, left_out, f"what the model leaves out of {name}"))
    units |= {n: s.unit for s in model.sensors for n in (s.name, *s.channels)}
    for name, (_, density) in discrete.named_walks.items():
        text = f"random walk of the bias of {name}"
        K = float(density) ** 0.5
        found.append(Constant(f"K_{identifier(name).upper()}", f"{units[name]}/sqrt(s)", K, text))
    for s in model.sensors:
        found.append(_limit(f"{s.name}_sample", s.unit, s.title, model.limits.get(s.name)))
        if s.min_length:
            text = f"smallest plausible length: {s.title}"
            found.append(Constant(f"MIN_{identifier(s.name).upper()}", s.unit, s.min_length, text))
        text = f"what the model leaves out: {s.title}"
        found.append(
            Constant(f"LEFT_OUT_{identifier(s.name).upper()}", f"{s.unit}/sqrt(Hz)", s.left_out, text)
        )
        for channel in s.channels:
            sd, text = (
                discrete.sample_variance(s, channel) ** 0.5,
                f"standard deviation of a sample of {channel}",
            )
            found.append(Constant(f"SD_{identifier(channel).upper()}", s.unit, sd, text))
    for state in model.states:
        text = f"standard deviation at the start: {state.title}"
        found.append(Constant(f"PRIOR_{identifier(state.name).upper()}", state.unit, state.prior, text))
    return {c.name: c for c in found}


def left_out_of(discrete: DiscreteModel, name: str) -> float:
    """What the model leaves out of an input or one channel of it, as a density [SI/sqrt(Hz)]."""
    return next(i.left_out for i in discrete.model.motion.inputs if name in (i.name, *i.channels))


def input_density(discrete: DiscreteModel, name: str) -> Expr:
    """Density of the noise of an input, ``N^2 + left_out^2``, by the names of its settings.

    Parameters
    ----------
    discrete : DiscreteModel
    name : str
        Of an input, or of one channel of it.
    """
    known, word = settings(discrete), identifier(name).upper()
    N, left_out = (Num(known[n].value, n) for n in (f"N_{word}", f"LEFT_OUT_{word}"))
    return add(mul(N, N), mul(left_out, left_out))


def walk_density(discrete: DiscreteModel, name: str) -> Expr:
    """Density of the random walk of a bias, ``K^2``, by the name of its setting.

    Parameters
    ----------
    discrete : DiscreteModel
    name : str
        Of an input or sensor, or of one channel of it.
    """
    word = f"K_{identifier(name).upper()}"
    K = Num(settings(discrete)[word].value, word)
    return mul(K, K)


def sample_variance(discrete: DiscreteModel, sensor: Sensor, channel: str) -> Expr:
    """Variance of a sample, ``sd^2 + left_out^2 rate``, by the names of its settings.

    Parameters
    ----------
    discrete : DiscreteModel
    sensor : Sensor
    channel : str
        One of its channels.
    """
    known = settings(discrete)
    names = f"SD_{identifier(channel).upper()}", f"LEFT_OUT_{identifier(sensor.name).upper()}"
    sd, left_out = (Num(known[n].value, n) for n in names)
    return add(mul(sd, sd), mul(mul(left_out, left_out), Num(discrete.rate_of(sensor))))


def gates(model: FilterModel) -> tuple[Constant, ...]:
    """The gate of each sensor, which may change in flight."""
    text = "gate: a sample is rejected beyond so many standard deviations"
    return tuple(Constant(f"gate_{s.name}", "1", GATE_SIGMAS, f"{text}, {s.title}") for s in model.sensors)


def squared_gate(lower: Lowering, sensor: Sensor) -> Expr:
    """The largest squared innovation of a sensor over its covariance."""
    gate = lower.places[f"gate_{sensor.name}"]
    return mul(gate, gate)


def field_name(setting: str) -> str:
    """The name of a setting in the struct of parameters: letters of noise are capitals there too.

    Parameters
    ----------
    setting : str
        In capitals.
    """
    letter, rest = setting.split("_", 1)
    return f"{letter}_{rest.lower()}" if len(letter) == 1 else setting.lower()


def _limit(name: str, unit: str, title: str, declared: float | None) -> Constant:
    value = MAX_BY_UNIT.get(unit, MAX_OTHER) if declared is None else RANGE_MARGIN * declared
    return Constant(f"MAX_{identifier(name).upper()}", unit, value, f"largest plausible magnitude: {title}")
