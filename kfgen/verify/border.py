"""The border of a filter beside its reference, on the cores on which the filter is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from kfgen.emit.geodetic.calls import border_calls
from kfgen.emit.geodetic.origin import Border
from kfgen.emit.reference import Machine
from kfgen.emit.scenario import RecordedCall, split
from kfgen.emit.targets.loaded import beside
from kfgen.verify.core import CoreVerdict, InstructionCount
from kfgen.verify.replay import Replay


def border_replay(border: Border) -> Replay:
    """Its calls, as those of a filter."""
    return Replay({}, border_calls(border))


def together(filter_: CoreVerdict, border: CoreVerdict) -> CoreVerdict:
    """What was compared of both; stack and code of all calls are those of the filter, whose border may be left out.

    Parameters
    ----------
    filter_ : CoreVerdict
    border : CoreVerdict
        Of the same core.
    """
    cost, own = filter_.cost, border.cost
    parts = [
        a | {f"geodetic_{name}": v for name, v in b.items() if name != "init"}
        for a, b in (
            (cost.instructions, own.instructions),
            (cost.stacks, own.stacks),
            (cost.texts, own.texts),
            (cost.least, own.least),
        )
    ]
    return replace(
        filter_,
        words=filter_.words + border.words,
        differing=filter_.differing + border.differing,
        max_ulp=max(filter_.max_ulp, border.max_ulp),
        calls=filter_.calls + border.calls,
        cost=InstructionCount(parts[0], cost.stack_bytes, cost.text_bytes, *parts[1:]),
    )


def border_module(border: Border, folder: Path, name: str) -> CoreVerdict:
    """An emitted Python module of the border beside the reference, bit by bit.

    Parameters
    ----------
    border : Border
    folder : Path
        Of the module.
    name : str
        Of the target.
    """
    geodetic = beside(folder / f"{border.name}.py").Geodetic()
    calls: Sequence[RecordedCall] = border_calls(border)
    routines = Machine(border).routines
    words = differing = 0
    for call in calls:
        getattr(geodetic, call.routine)(*split(routines[call.routine], call.inputs))
        found = np.concatenate([getattr(geodetic, a) for a in border.compared])
        words += found.size
        differing += int((found.view("u8") != call.words.view("u8")).sum())
    return CoreVerdict(name, words, differing, 0, len(calls), InstructionCount())
