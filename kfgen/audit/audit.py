"""What a filter cannot know: its unobservable directions with names and units, the manoeuvres that show them, how well the rest shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.audit.degree import Degree, Horizon, degree
from kfgen.audit.exact.basis import NullVector, readable
from kfgen.audit.exact.chain import NullSpace, along
from kfgen.audit.exact.padic import PRIMES, Degenerate
from kfgen.audit.exact.plan import Plan
from kfgen.audit.exact.symbolic import at_rest, null_of
from kfgen.audit.exact.transport import carried
from kfgen.audit.exact.value_columns import in_numbers
from kfgen.audit.lint import lint
from kfgen.audit.result import Audit, Audited, Direction, ManoeuvreTable
from kfgen.audit.words import called, sentence, words
from kfgen.manoeuvre.library import LIBRARY
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.plant.equations import Equations

LOOKS = 1000
"""Times at which a manoeuvre is looked at before it is flown."""


def usual(model: FilterModel) -> Manoeuvre:
    """The manoeuvre at which a model is looked at first: a plant moves, anything else rests."""
    plant = isinstance(model.motion, Equations) and bool(model.motion.inputs)
    return LIBRARY["generic" if plant else "static"]


def candidates(plan: Plan) -> list[Manoeuvre]:
    """The manoeuvres that differ for a model."""
    if plan.control is not None:
        return list(LIBRARY.values())
    return [LIBRARY["static"], LIBRARY["generic"]] if plan.channels else []


def audit(
    model: FilterModel, manoeuvres: Sequence[Manoeuvre] = (), horizon: Horizon | None = None
) -> Audited:
    """Audit a model.

    Parameters
    ----------
    model : FilterModel
    manoeuvres : sequence of Manoeuvre, optional
        The first one's directions are held against the library; at rest when left out.
    horizon : Horizon, optional
        Run the covariance as well.
    """
    plan = Plan(model, tuple(model.sensors))
    flown = tuple(manoeuvres) or (usual(model),)
    length = horizon.duration if horizon else None
    for m in manoeuvres:
        m.values(np.linspace(0.0, m.length if length is None else length, LOOKS))
    generic, found = _null_spaces(plan, flown, length)
    nulls = [readable(plan, m, h, generic=generic) for m, h in zip(flown, found)]
    table = None
    shown_by: list[tuple[str, ...]] = [()] * found[0].nullity
    if found[0].nullity:
        others = [m for m in candidates(plan) if m.name not in {f.name for f in flown}]
        seen = [along(plan, [m], generic=generic)[0] for m in others] + found[1:]
        columns = (*others, *flown[1:])
        rows = tuple(
            tuple(_observable_along(h, carried(plan, v, flown[0], m)) for m, h in zip(columns, seen))
            for v in nulls[0]
        )
        table = ManoeuvreTable(columns, rows) if columns else None
        shown_by = [tuple(m.name for m, free in zip(columns, row) if free) for row in rows]
    audits = []
    for k, (m, h, vs) in enumerate(zip(flown, found, nulls)):
        directions = _directions(plan, m, vs, shown_by if k == 0 else [()] * len(vs), length, generic=generic)
        names = frozenset(s.name for i, s in enumerate(model.states) if any(v.residues[i] for v in vs))
        run, start = None, plan.numbers(generic=generic)
        if horizon is not None:
            run = degree(DiscreteModel.at_rate(model, horizon.rate), m, horizon, h.nullity, start)
        audits.append(Audit(model, m, directions, names, generic, start, run))
    return Audited(tuple(audits), table, notes(plan, horizon))


def in_log(model: FilterModel, name: str, t: NDArray[np.float64], deviation: NDArray[np.float64]) -> Audited:
    """What a log shows of a model, from a filter that has run over it.

    Parameters
    ----------
    model : FilterModel
        With the sensors that the log has.
    name : str
        Of the log.
    t : ndarray, shape (n,)
        [s]
    deviation : ndarray, shape (n, states)
        Standard deviations of the filter [SI].
    """
    # How a log starts is not asked: at no special attitude body axes keep their own names.
    motion = replace(LIBRARY["generic"], name=name, title="as recorded", attitude=(3.0, 1.0, -1.0, 2.0))
    any_motion = audit(model, (motion,))
    sigma = np.vstack([[s.prior for s in model.states], deviation])
    step = (t[-1] - t[0]) / max(t.size - 1, 1)
    run = Degree(np.concatenate([[0.0], t - t[0] + step]), sigma, np.zeros(0), ())
    return replace(any_motion, audits=(replace(any_motion.first, degree=run, recorded=True),), table=None)


def unobservable_directions(model: FilterModel) -> tuple[Direction, ...]:
    """What is unobservable at the usual manoeuvre of a model, in numbers, without asking which other one would show it."""
    plan, m = Plan(model, tuple(model.sensors)), usual(model)
    generic, (h,) = _null_spaces(plan, (m,), None)
    vs = readable(plan, m, h, generic=generic)
    return tuple(_directions(plan, m, vs, [()] * len(vs), None, generic=generic, symbolic=False))


def _observable_along(h: NullSpace, variants: Sequence[Sequence[Fraction]] | None) -> bool | None:
    """Whether another manoeuvre shows a direction in each of its variants; None where it is no fraction."""
    if variants is None:
        return None
    return not any(h.contains([h.ring.of(e) for e in v], h.ring) for v in variants)


def _null_spaces(
    plan: Plan, flown: Sequence[Manoeuvre], length: float | None
) -> tuple[bool, list[NullSpace]]:
    """Null spaces at the declared start where that is no special point, else at a generic one, and whether at that."""
    found = along(plan, flown, length, generic=True)
    if not plan.own:
        return False, found
    if isinstance(plan.model.motion, Equations) and any(map(plan.model.motion.starts_unknown, plan.own)):
        return True, found
    at_zero, declared = _declared(plan, flown, length, found[0].ring.p)
    same = at_zero and [h.nullity for h in declared] == [h.nullity for h in found]
    return (False, declared) if same else (True, found)


def _declared(
    plan: Plan, flown: Sequence[Manoeuvre], length: float | None = None, p: int = PRIMES[0]
) -> tuple[bool, list[NullSpace]]:
    """Null spaces at the declared start, and True; at a generic one, and False, where the model has no value there."""
    try:
        return True, along(plan, flown, length, generic=False, p=p)
    except Degenerate:
        return False, along(plan, flown, length, generic=True)


def notes(plan: Plan, horizon: Horizon | None) -> tuple[str, ...]:
    """What a model has too much of; errors of calibration are looked at where they are declared, around zero.

    Parameters
    ----------
    plan : Plan
    horizon : Horizon or None
        How long is measured; None where that is not known.
    """
    rich = LIBRARY["generic"]
    nulls: list[NullVector] = []
    if plan.channels:
        at_zero, (h,) = _declared(plan, [rich])
        nulls = readable(plan, rich, h, generic=not at_zero)
    names = [frozenset(plan.model.states[k].name for k in v.support) for v in nulls if not v.gauge]
    return lint(plan.model, horizon.duration if horizon else None, names)


def _directions(  # noqa: PLR0913 - what one audit of a manoeuvre has found, and how it is said
    plan: Plan,
    manoeuvre: Manoeuvre,
    nulls: Sequence[NullVector],
    shown_by: Sequence[tuple[str, ...]],
    length: float | None,
    *,
    generic: bool,
    symbolic: bool = True,
) -> tuple[Direction, ...]:
    model = plan.model
    constant = at_rest(model, manoeuvre) if nulls and symbolic and not generic else None
    out = []
    amounts = in_numbers(plan, manoeuvre, nulls, length, generic=generic)
    for v, free, (values, exact) in zip(nulls, shown_by, amounts):
        support = [k for k in v.support if values[k] != 0.0]
        parts = [(called(model, model.states[k], manoeuvre), model.states[k], values[k]) for k in support]
        formula = _formula(constant, v)
        out.append(
            Direction(
                {n: value for n, _, value in parts},
                {n: s.unit for n, s, _ in parts},
                sentence([(words(model, n, st, manoeuvre), st, a) for n, st, a in parts], v.gauge),
                {n: str(v.values[k]) for (n, _, _), k in zip(parts, support)} if exact else {},
                {n: formula[k] for (n, _, _), k in zip(parts, support)} if formula else {},
                free,
            )
        )
    return tuple(out)


def _formula(constant: Any, v: NullVector) -> Mapping[int, str]:
    """The amounts of a direction in symbols."""
    if constant is None:
        return {}
    F, H = constant
    found = null_of(F, H, v.support)
    if len(found) != 1:
        return {}
    return {k: sp.sstr(found[0][k]) for k in v.support}
