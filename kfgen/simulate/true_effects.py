"""The effects of every place with their true values: those of a noise file, and those that options attach as states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from kfgen.effects import Effect
from kfgen.model.filter import FilterModel


def true_effects(model: FilterModel, constants: Mapping[str, float]) -> dict[str, tuple[Effect, ...]]:
    """The effects by channel or sensor.

    Parameters
    ----------
    model : FilterModel
    constants : mapping of str to float
        Truth of its constant states by name [SI], those of effects that are states among them.
    """
    attached: dict[str, list[Effect]] = {}
    for e in model.errors:
        drawn = {p.parameter: constants.get(p.name, p.value) for p in e.parameters if not e.known}
        attached.setdefault(e.where, []).append(replace(e.effect, **drawn))
    names = {(where, e.name) for where, es in attached.items() for e in es}
    out = {w: [e for e in es if (w, e.name) not in names] for w, es in model.noise.items()}
    for where, es in attached.items():
        out[where] = [*out.get(where, []), *es]
    return {where: tuple(es) for where, es in out.items()}
