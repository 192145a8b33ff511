"""Does an addition to a channel at rest shrink the gap on data that its fit did not see.

A shape is predicted part by part as in `kfgen.gap.core.unseen`, white under the noise that was fitted with it. Of
noise, whose sizes are fitted to the rest of the record with and without the addition, the likelihood of each part
is compared; times are those of the whole record, for a part may be too short for them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kfgen.core.time_budget import search_is_over
from kfgen.effects.effect import Effect
from kfgen.gap.core.holdout import FOLDS
from kfgen.gap.core.unseen import MAX_UNSEEN_LOSS_NATS, LinearFit, parts_of, tail_of, unseen_gain
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.evidence import RETUNE, Candidate
from kfgen.gap.rest.words import loses_unseen
from kfgen.identify.evidence.joint import JointRecord, records_of
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.fit import maximise

MIN_PART_SAMPLES = 100
"""Samples of a part that has a spectrum."""
PROVEN_NATS = 100.0
"""Gain on parts of a record after which the others are not looked at."""


def unproven(base: Candidate, addition: Candidate, max_loss_nats: float = MAX_UNSEEN_LOSS_NATS) -> str:
    """What an addition loses on data that its fit did not see; empty where that is nothing, or cannot be shown.

    Parameters
    ----------
    base, addition : Candidate
        The model without and with it, fitted.
    max_loss_nats : float
        That may be chance.
    """
    if addition.changes_samples or addition.name == RETUNE or search_is_over():
        return ""
    gains = _of_shape(addition) if addition.effect.coefficients() else [_of_noise(base, addition)]
    loss = -min(gains, default=0.0)
    return loses_unseen(loss) if loss > max_loss_nats else ""


def _of_shape(addition: Candidate) -> list[float]:
    """Gains of a shape on all parts of a record, and on its tail; none of several records together."""
    records, effects = records_of(addition.problem.record), addition.fit.effects
    if len(records) > 1 or records[0].n < MIN_PART_SAMPLES:
        return []
    record = records[0]
    whitener = Whitener.on(record, effects)

    def fit(shapes: list[Effect]) -> LinearFit:
        columns = [x for e in shapes for x in record.regressors(e)]
        A = whitener.series(np.column_stack(columns)) if columns else np.zeros((record.n, 0))
        z = whitener.series(record.y)
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        theta = np.linalg.lstsq(A / scale, z, rcond=1e-12)[0]
        return LinearFit(z - A / scale @ theta, A / scale, A.T @ A / np.outer(scale, scale))

    shapes = [e for e in effects if e.coefficients()]
    before, after = fit(shapes[:-1]), fit(shapes)
    lengths = (record.n,)
    return [unseen_gain(before, after, parts) for parts in (parts_of(lengths), [tail_of(lengths)])]


def _of_noise(base: Candidate, addition: Candidate) -> float:
    """The gain of noise on every part of a record, or on every record."""
    records = records_of(addition.problem.record)
    if len(records) == 1:
        size = records[0].n // FOLDS
        records = tuple(records[0].cut(k * size, (k + 1) * size) for k in range(FOLDS))
    if min(r.n for r in records) < MIN_PART_SAMPLES:
        return 0.0
    gain = 0.0
    for k, part in enumerate(records):
        rest = records[:k] + records[k + 1 :]
        gain += _likelihood(addition, part, rest) - _likelihood(base, part, rest)
        if gain > PROVEN_NATS:
            break
    return gain


def _likelihood(model: Candidate, part: Record, rest: tuple[Record, ...]) -> float:
    """Of a part, under a model whose sizes are fitted to the rest."""
    problem = model.problem
    times = {
        (i, p.name) for i, e in enumerate(problem.effects) for p in e.parameters() if p.kind != "size"
    } & set(problem.free)
    record = rest[0] if len(rest) == 1 else JointRecord(rest)
    fit = maximise(replace(problem, record=record, fixed=problem.fixed | times).starting(model.fit.effects))
    return part.ordinates(fit.effects).log_likelihood(fit.effects, fit.likelihood.coefficients).value
