"""The answer of ``run --tune``: the sizes of a filter's noises that a log asks for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.gap.flight.noise.tune import Tuning, tune
from kfgen.log.log import Log
from kfgen.model.files import save
from kfgen.model.filter import FilterModel
from kfgen.report.page import Answer, Page, PagePart, columns, heading, sentence, table


def tune_answer(
    model: FilterModel, log: Log, output: Path | None, beside: Mapping[str, object] | None = None
) -> Answer:
    """Text, JSON and page; the tuned filter is written where a file is given.

    Parameters
    ----------
    model : FilterModel
    log : Log
    output : Path, optional
        Of the filter file (.toml).
    beside : mapping of str to object, optional
        Other options of the command, with their values: none of them goes with ``--tune``.

    Raises
    ------
    InputError
        One of them was given, or as in `kfgen.gap.flight.tune.tune`.
    """
    for option in (o for o, given in (beside or {}).items() if given):
        raise InputError(
            f"--tune estimates noise and does not go with {option}", remedy="Leave out one of them"
        )
    found = tune(model, log)
    if output is not None:
        save(found.improved, output)
    first, *_ = found.summary()
    head, rows = found.short_table()
    nis_head = ("channel", "mean squared innovation over its variance, assumed", "tuned")
    nis = [[c, f"{a:.3g}", f"{b:.3g}"] for c, (a, b) in found.nis.items()]
    text = "\n".join(
        [first, columns([head, *rows]), "  normalised innovations squared, 1 is right:", columns(nis)]
    )
    parts = (
        sentence(f"{first}."),
        table(head, rows),
        heading("Innovations"),
        table(nis_head, nis),
        *_hints(found),
    )
    return Answer(text, found.to_dict(), Page(f"Noise of {found.model} in motion", parts))


def _hints(found: Tuning) -> tuple[PagePart, ...]:
    """What a size far from one may hide."""
    if not any(s.is_shown and s.times > 2.0 for s in found.sizes):
        return ()
    return (
        sentence(
            "A size far above one is mostly no noise: kfgen gap LOG --model FILTER names delays, lever arms, scale "
            "factors and other effects that look like it."
        ),
    )
