"""The verb `judge`: a declaration of an effect by anybody, tried by evidence, held-out data, recovery and confusions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.elapsed import counted
from kfgen.core.errors import InputError
from kfgen.core.time_budget import time_budget
from kfgen.effects import tried
from kfgen.effects.noise_model import ChannelNoise
from kfgen.gap.core.result import Comparison, Finding
from kfgen.gap.find_gap import Model, find_gap
from kfgen.gap.judge.declaration import declared_in
from kfgen.gap.judge.judgement import STAND_IN, WITH_IT, WITHOUT_IT, Judgement, Trials, stand_ins
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.checks import simulated
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.log.log import Log
from kfgen.log.readers import read_log

Array = NDArray[np.float64]

MAX_CASES = 1000


@dataclass(frozen=True)
class _Kind:
    """Of simulated records: what they hold, the channel whose times and drivers they have, and its true noise."""

    holding: str
    at: ChannelGap
    truth: ChannelNoise


def judge(
    declaration: str | Path,
    log: Log | str | Path,
    model: Model | str | Path,
    *,
    channels: Sequence[str] | str | None = None,
    cases: int = 8,
    seed: int = 0,
) -> Judgement:
    """Whether an effect that a file declares earns a place in the catalogue by a log.

    The log is compared with its model by the catalogue alone, and by the catalogue with the declaration. Where that is
    named in a channel at rest, records are simulated on the log's times and drivers: with it as it was found, without it,
    and with what the catalogue names in its place; in each the gap is looked for anew.

    Parameters
    ----------
    declaration : str or Path
        Python with one subclass of `kfgen.effects.Effect`; it is executed, and the effect stays out of the catalogue.
    log : Log or path
    model : NoiseModel, UserModel, FilterModel, str or Path
        What is assumed, as in `find_gap`.
    channels : sequence of str, or str with commas, optional
    cases : int
        Records that are simulated of each kind.
    seed : int
        Of the simulated noise.

    Returns
    -------
    Judgement

    Raises
    ------
    InputError
        As in `declared_in` and `find_gap`, or `cases` is not from 1 to 1000.
    """
    if not 1 <= cases <= MAX_CASES:
        raise InputError(
            f"{cases} simulated records are too few or too many", remedy=f"Give 1 to {MAX_CASES}"
        )
    data = log if isinstance(log, Log) else read_log(Path(log))
    cls = declared_in(declaration)
    without = find_gap(data, model, channels=channels)
    with tried(cls):
        found = find_gap(data, model, channels=channels)
        judged = Judgement(cls.name, without, found)
        if judged.shown is None or not isinstance(judged.shown[0], ChannelGap):
            return judged
        comparison, finding = judged.shown
        assert isinstance(comparison, ChannelGap)
        kinds = [
            _Kind(WITH_IT, comparison, comparison.updated),
            _Kind(WITHOUT_IT, comparison, _less(comparison, [cls.name])),
        ]
        if names := stand_ins(without, found):
            kinds += [_Kind(STAND_IN, c, c.updated) for c in _of(without.comparisons, comparison)]
        base = _less(comparison, [cls.name, *names])
        trials = [_tried(kind, base, finding, cases, seed + k * MAX_CASES) for k, kind in enumerate(kinds)]
    return replace(judged, trials=tuple(trials))


def _of(every: Sequence[Comparison], same: ChannelGap) -> list[ChannelGap]:
    return [c for c in every if isinstance(c, ChannelGap) and c.channel == same.channel]


def _less(c: ChannelGap, names: Sequence[str]) -> ChannelNoise:
    """The updated model of a channel without some effects."""
    return replace(c.updated, terms=tuple(t for t in c.updated.terms if t.effect.name not in names))


def _tried(kind: _Kind, assumed: ChannelNoise, finding: Finding, cases: int, seed: int) -> Trials:
    """Records of a model, each compared with what is assumed."""
    named, others, inside = 0, Counter[str](), list[bool]()
    for k in counted(range(cases), f"records {kind.holding}"):
        adding = [t.effect for t in kind.truth.terms if not t.effect.changes_samples]
        altering = [t.effect for t in kind.truth.terms if t.effect.changes_samples]
        y: Array = simulated(kind.at.record, adding, altering, seed + k)
        with time_budget():
            gap = channel_gap(kind.at.channel, replace(kind.at.record, y=y), assumed)
        mine = [f for f in gap.findings if f.name == finding.name]
        named += bool(mine)
        others.update({f.name for f in gap.findings} - {finding.name})
        if mine and kind.holding == WITH_IT:
            pairs = [(float(getattr(finding.effect, n)), interval) for n, interval in mine[0].ci95.items()]
            inside += [lo <= x <= hi for x, (lo, hi) in pairs]
    return Trials(kind.holding, cases, named, dict(others.most_common()), sum(inside), len(inside))
