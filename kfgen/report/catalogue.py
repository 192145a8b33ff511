"""The answers of `kfgen list`: everything that has a name, or what is inside a log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kfgen.log.contents import CHANNEL_HEAD, TOPIC_HEAD, Contents, contents
from kfgen.report.page import Answer, Page, PagePart, columns, heading, sentence, table


def listed_answer(log: Path | None, **how: Any) -> Answer:
    """Everything that has a name; or the contents of a log.

    Parameters
    ----------
    log : Path, optional
    how
        Of `kfgen.log.contents.contents`.

    Returns
    -------
    Answer
    """
    if log is not None:
        return contents_answer(contents(log, **how))
    from kfgen.catalogue import list_all  # heavy: every layer
    from kfgen.report.model import list_answer

    return list_answer(list_all())


def contents_answer(found: Contents) -> Answer:
    """What is inside a log, for a terminal and a page; a check failed where it cannot be used as it is."""
    groups = [("topics", TOPIC_HEAD, found.topic_rows()), ("channels", CHANNEL_HEAD, found.channel_rows())]
    lines, parts = list(found.summary()), list[PagePart](map(sentence, found.summary()))
    for name, head, rows in groups:
        if rows:
            lines += ["", name, columns([list(head), *rows])]
            parts += [heading(name), table(head, rows)]
    warnings = found.log.warnings if found.log is not None else ()
    parts += [heading("said by the reader"), *map(sentence, warnings)] if warnings else []
    page = Page(f"Contents of {Path(found.source).name}", tuple(parts))
    return Answer("\n".join(lines), found.to_dict(), page, ok=not found.problem, warnings=warnings)
