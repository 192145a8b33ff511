"""Whether the parts of a filter fit together, and the hash of what it is."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import sympy as sp

from kfgen.core.errors import InputError

if TYPE_CHECKING:
    from kfgen.model.filter import FilterModel


def check_channels(model: FilterModel) -> None:
    """Raise `InputError` where two parts read one channel, or a place of the noise is none of the filter's."""
    readers: dict[str, str] = {}
    parts = [
        *((f"the input {i.name}", i.channels) for i in model.motion.inputs),
        *((f"the sensor {s.name}", s.channels) for s in model.sensors),
    ]
    for name, channels in parts:
        for c in channels:
            if readers.setdefault(c, name) != name:
                raise InputError(
                    f"{readers[c]} and {name} of {model.name} both read the channel {c}",
                    where=model.name,
                    remedy=f"Leave out {name}",
                )
    for place in model.noise:
        if not model.channels_of(place):
            raise InputError(
                f"{model.name} has no channel '{place}'", remedy=f"It has {', '.join(model.channel_units)}"
            )


def check_needs(model: FilterModel, offered: set[str]) -> None:
    """Raise `InputError` where a sensor needs what neither the motion nor a sensor has.

    Parameters
    ----------
    model : FilterModel
    offered : set of str
        Names of blocks and offers.
    """
    for s in model.sensors:
        missing = [n for n in s.needs if n not in offered]
        if missing:
            raise InputError(
                f"the sensor {s.name} needs {', '.join(missing)}, which {model.name} does not have",
                where=model.name,
                remedy=f"Leave it out, or take a model with it; {model.name} offers {', '.join(sorted(offered))}",
            )


def content_hash(model: FilterModel) -> str:
    """SHA-256 over the content of a filter: equations, numbers, order of states (hexadecimal)."""
    parts = [
        model.name,
        *(repr(s) for s in model.states),
        sp.srepr(model.F),
        sp.srepr(model.G),
        sp.srepr(model.W),
        *(repr(c) for c in model.constants),
        *(f"{name} {sp.srepr(rate)}" for name, rate in model.rates(False).items()),
    ]
    for s in model.sensors:
        white = [sp.srepr(sp.Tuple(*model.white(c))) for c in s.channels]
        parts.append(f"{s.name} {s.sd!r} {s.left_out!r} {sp.srepr(model.expected(s))} {white}")
    changes = {c: model.noise_change(c) for c in model.channel_units}
    parts += [f"{c} {f} {v}" for c, (f, v) in changes.items() if (f, v) != (1, 0)]
    parts += [f"{r.name} {sp.srepr(r.after)}" for r in model.registers]
    parts += [f"limit {name} {value!r}" for name, value in sorted(model.limits.items())]
    parts += [repr(line) for line in model.motion.late]
    parts += [
        f"{s.backlash.channel} {sp.srepr(sp.sympify(s.backlash.width, strict=True))}"
        for s in model.sensors
        if s.backlash
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def described(model: FilterModel) -> str:
    """A model in three lines: its title, its states, its sensors."""
    states, sensors = (", ".join(part.name for part in own) for own in (model.states, model.sensors))
    return f"{model.name}: {model.title}\n{len(model.states)} states: {states}\nsensors: {sensors}"
