"""What generated code says about its frames, samples, drivers and effects, in every language alike."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from kfgen.effects.driven.proportional import DRIVERS
from kfgen.emit.accuracy import step_accuracy
from kfgen.emit.cautions import cautions
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.motion import AFTER, AT, BEFORE, INCREMENTS

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

AXES = {"N": "north", "E": "east", "S": "south", "W": "west", "U": "up", "D": "down"}


def frames(model: FilterModel) -> tuple[str, ...]:
    """Navigation axes, body axes, the quaternion, the convention of the error and its samples, a sentence each."""
    axes = ", ".join(AXES.get(a, a) for a in model.motion.axes)
    said = [f"Navigation axes: {axes}.", "Body axes: forward, right, down."]
    if model.attitude is not None:
        said += ["Quaternion: body to navigation axes, scalar first.", f"Error: {model.convention.title}."]
    return (*said, "SI units and radians.", *handling(model))


SAMPLE_OF_A_STEP = {
    AFTER: "the sample at its beginning",
    AT: "the mean of the samples at its beginning and its end",
    BEFORE: "the sample at its end",
    INCREMENTS: "the increments of angle and velocity over it, by gather (of a log the sample at its end)",
}
"""Inputs of a step, by what a sample stands for."""


def handling(model: FilterModel) -> tuple[str, ...]:
    """What is done with samples before the filter gets them: options that act on a log, for who has none."""
    steps = f"Inputs of a step: {SAMPLE_OF_A_STEP[model.motion.chosen.get('samples', AFTER)]}."
    remembered = [line.sentence for line in model.motion.late] + [
        s.backlash.sentence for s in model.sensors if s.backlash
    ]
    handled = [h for s in model.sensors for h in s.handling()]
    return (*((steps,) if model.motion.inputs else ()), *remembered, *handled)


def driver_text(name: str) -> str:
    """What a driver is, with its unit; of a channel that is no usual driver only that it is SI, as in the noise file."""
    return f"{name} [{DRIVERS[name].unit or '1'}]" if name in DRIVERS else f"{name} [SI unit of the channel]"


LINE_COLUMNS = 100
"""Columns of a line of generated comments [characters]."""


def accuracy(discrete: DiscreteModel, indent: int) -> tuple[str, ...]:
    """Lines on the order of Phi and Qd and their error at the rate; none where there is no attitude.

    Parameters
    ----------
    discrete : DiscreteModel
    indent : int
        Columns that the caller puts before each line.
    """
    lines: list[str] = []
    for sentence in step_accuracy(discrete):
        lines += textwrap.wrap(sentence, LINE_COLUMNS + 20 - indent)
    return tuple(lines)


def beware(program: Program, indent: int) -> tuple[str, ...]:
    """Lines of `cautions`: one begins at the left, what continues it does not.

    Parameters
    ----------
    program : Program
    indent : int
        Columns that the caller puts before each line.
    """
    lines: list[str] = []
    for sentence in cautions(program):
        lines += textwrap.wrap(sentence, LINE_COLUMNS - indent, subsequent_indent="  ")
    return tuple(lines)


def omitted(model: FilterModel, indent: int) -> tuple[str, ...]:
    """Lines on the effects that the filter leaves out: where, which, why, and what to do instead; none where all are in.

    Parameters
    ----------
    model : FilterModel
    indent : int
        Columns that the caller puts before each line.

    Returns
    -------
    tuple of str
        An effect begins at the left, what continues it does not.
    """
    lines: list[str] = []
    for where, effect, why, instead in model.omitted:
        text = f"{where} {effect}: {why.rstrip('.')}." + (
            f" Instead: {instead.rstrip('.')}." if instead else ""
        )
        for closing, harmless in (("*/", "* /"), ('"""', "'"), ("\\", "/")):
            text = text.replace(closing, harmless)
        lines += textwrap.wrap(text, LINE_COLUMNS - indent, subsequent_indent="  ")
    return tuple(lines)
