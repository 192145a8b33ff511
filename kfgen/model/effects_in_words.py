"""How the effects of a filter's channels are used, in words."""

from __future__ import annotations

from kfgen.model.filter import FilterModel
from kfgen.model.parts.attached_error import AttachedError


def effects_in_words(model: FilterModel) -> list[str]:
    """A sentence for every error of a reading: corrected by its value, or estimated as states; then what is left out.

    Parameters
    ----------
    model : FilterModel
    """
    return [_how_used(e) for e in model.errors] + [o.sentence.rstrip(".") for o in model.omitted]


def _how_used(error: AttachedError) -> str:
    """One error of a reading."""
    what = f"{error.effect.name} of {error.where}"
    if not error.known:
        return f"{what} is estimated: {', '.join(p.name for p in error.parameters)}"
    values = ", ".join(
        f"{p.name} = {p.value:.4g}{'' if p.unit == '1' else ' ' + p.unit}" for p in error.parameters
    )
    return f"{what} is known and corrected by its value: {values}"
