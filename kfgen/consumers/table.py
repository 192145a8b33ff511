"""A data sheet of any noise model: every parameter in its own and in the usual units, and every meaning of B.

The text is Markdown.
"""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.consumers.base import SENSORS, Converted, Imu, Value
from kfgen.core.errors import InputError
from kfgen.core.units import derived_unit, from_si, parse_unit
from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise, Term

NAME = "table"
TITLE = "a data sheet, every parameter in every usual unit"
SOURCE = "IEEE Std 952-1997, annex C"
RATE = ""
NEEDS = ()

USUAL_UNITS = (
    "deg/sqrt(h)",
    "deg/h",
    "deg/h/sqrt(h)",
    "m/s/sqrt(h)",
    "ug/sqrt(Hz)",
    "ug",
    "mGal",
    "ug/sqrt(s)",
)
PARAMETER_COLUMNS = ("parameter", "value", "also", "95 % interval")
MEANING_COLUMNS = ("name", "value", "what it is", "who calls it so")


def convert(imu: Imu) -> Converted:
    """The sheet."""
    values: dict[str, Value] = {}
    lines = ["# Noise, data sheet", "", *(f"{h[2:]}.  " for h in imu.header(TITLE, SOURCE, per_axis=True))]
    for name, channel in imu.noise.channels.items():
        rows = []
        for label, term in labelled(channel):
            rows += _rows(f"{name}.{label}", term, channel.unit, imu.safety, values)
        lines += ["", f"## {name}", "", *_markdown(PARAMETER_COLUMNS, rows)]
        for label, term in labelled(channel):
            named = meaning_rows(term.effect, channel.unit, imu.safety)
            if named:
                lines += ["", f"What each consumer calls B of {name} {label}:", ""]
                lines += _markdown(MEANING_COLUMNS, named)
    lines += _sensors(imu, values)
    return Converted("\n".join(lines), values)


def labelled(channel: ChannelNoise) -> list[tuple[str, Term]]:
    """The terms of a channel by name; a second one of a kind is numbered."""
    out: list[tuple[str, Term]] = []
    for term in channel.terms:
        again = sum(t.effect.name == term.effect.name for _, t in out)
        out.append((f"{term.effect.name}_{again + 1}" if again else term.effect.name, term))
    return out


def meaning_rows(effect: Effect, unit: str, safety: float = 1.0) -> list[list[str]]:
    """A row for each name under which programs and papers write the sizes of an effect.

    Parameters
    ----------
    effect : Effect
    unit : str
        The unit of the channel.
    safety : float
        Multiplies every size.

    Returns
    -------
    list of list of str
        Name, value, definition, users; none for most effects.
    """
    titles = {m.name: m for m in effect.meanings}
    return [
        [name, f"{safety * value:.6g} {plain(text)}", titles[name].title, titles[name].users]
        for name, (value, text) in effect.called(unit).items()
    ]


def plain(unit: str) -> str:
    """A unit on one line."""
    return " ".join(unit.split())


def _rows(label: str, term: Term, unit: str, safety: float, values: dict[str, Value]) -> list[list[str]]:
    rows = []
    for p in term.effect.parameters():
        u = plain(derived_unit(p.unit, unit))
        scale = safety if p.kind == "size" else 1.0
        si = scale * float(getattr(term.effect, p.name))
        others = [o for o in USUAL_UNITS if o != u and parse_unit(o).same_dimension(parse_unit(u))]
        also = "; ".join(f"{from_si(si, o):.6g} {o}" for o in others)
        pair = term.ci95.get(p.name)
        interval = " to ".join(f"{from_si(scale * v, u):.4g}" for v in pair) if pair else ""
        words = f"{p.name} of the noise file{f', times safety {safety:g}' if scale != 1.0 else ''}"
        values[f"{label}.{p.name}"] = Value((from_si(si, u),), u, words)
        rows.append([f"{label.partition('.')[2]} {p.name}", f"{from_si(si, u):.6g} {u}", also, interval])
    return rows


def _sensors(imu: Imu, values: dict[str, Value]) -> list[str]:
    """The worst and the mean axis of each sensor, in SI."""
    rows = []
    for sensor, (title, unit) in SENSORS.items():
        for letter, per in (("N", "sqrt(Hz)"), ("K", "sqrt(s)")):
            try:
                v = imu.scalar(sensor, letter, f"{unit}/{per}")
            except InputError:  # a channel called after a sensor that is none: no sheet of that sensor
                continue
            if v.numbers:
                values[f"{sensor}.{letter}"] = v
                rows.append([f"{title} {letter}", f"{v.numbers[0]:.6g} {v.unit}", v.words])
    return ["", "## Worst axis", "", *_markdown(("parameter", "value", "from"), rows)] if rows else []


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    if not rows:
        return ["Nothing."]
    return [f"| {' | '.join(r)} |" for r in (head, ["---"] * len(head), *rows)]
