"""The answer of ``convert``, and the table of what each consumer calls B."""

from __future__ import annotations

from collections.abc import Iterable

from kfgen.consumers import Conversion
from kfgen.consumers.table import MEANING_COLUMNS, meaning_rows
from kfgen.effects import Effect
from kfgen.report.page import Answer, Page, PagePart, code, columns, heading, source_words, table
from kfgen.report.page import text as paragraph


def convert_answer(made: Conversion, output: str = "") -> Answer:
    """The consumer's text, its parameters, and every meaning of B.

    Parameters
    ----------
    made : Conversion
    output : str
        The file that was written; the text itself is the answer where there is none.
    """
    head, rows = made.short_table()
    safety = "no safety factor" if made.safety == 1.0 else f"a safety factor of {made.safety:g}"
    parts = [
        table(head, rows),
        *([heading("What is to be known")] if made.warnings else []),
        *(paragraph(f"{w}.") for w in made.warnings),
        heading("The file"),
        code(made.text, f"Convention: {made.convention}."),
    ]
    for name, channel in made.noise.channels.items():
        found = meaning_parts(name, channel.effects, channel.unit, made.safety)
        parts += [heading(name), *found] if found else []
    lines = [f"{made.title} in {output}", columns(rows)] if output else [made.text]
    name = made.source.rsplit("/", 1)[-1]
    verdict = [f"The parameters of {name or 'the noise model'} for {made.title}, with {safety}."]
    if made.missing:
        verdict.append(f"It is not complete: {', '.join(made.missing)} were not identified.")
    facts = (("noise", source_words(made.source, made.sha256)),) if made.source else ()
    page = Page(
        f"Noise parameters for {made.consumer}",
        tuple(parts),
        tuple(verdict),
        None if not made.missing else False,
        facts,
    )
    return Answer("\n".join(lines), made.to_dict(), page, not made.missing, made.warnings)


def meaning_parts(channel: str, effects: Iterable[Effect], unit: str, safety: float = 1.0) -> list[PagePart]:
    """A table for each term of a channel whose size has several names: what each consumer calls B.

    Parameters
    ----------
    channel : str
        Its name.
    effects : iterable of Effect
        Its terms.
    unit : str
        The user's unit of the channel.
    safety : float
        Multiplies every size.
    """
    return [
        table(MEANING_COLUMNS, rows, f"What each consumer calls B of {channel}: {effect.title}.")
        for effect in effects
        if (rows := meaning_rows(effect, unit, safety))
    ]
