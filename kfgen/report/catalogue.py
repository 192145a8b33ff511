"""The answers of `kfgen list`: everything that has a name, or what is inside a log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kfgen.log.contents import CHANNEL_HEAD, TOPIC_HEAD, Contents, contents
from kfgen.report.figures.channels import channel_parts
from kfgen.report.page import Answer, Page, PagePart, columns, heading, sentence, source_words, table


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
    topics, rows = found.topic_rows(), found.channel_rows()
    lines, parts = list(found.summary()), list[PagePart](map(sentence, found.summary()))
    for name, head, own in (("topics", TOPIC_HEAD, topics), ("channels", CHANNEL_HEAD, rows)):
        lines += ["", name, columns([list(head), *own])] if own else []
    warnings = found.log.warnings if found.log is not None else ()
    parts += [heading("channels"), table(CHANNEL_HEAD, rows)] if rows else []
    parts += [heading("what the reader says"), *map(sentence, warnings)] if warnings else []
    if found.log is not None:
        parts += channel_parts(found.log)
    if topics:
        title = f"The {len(topics)} topics of the recording"
        parts.append(table(TOPIC_HEAD, topics, title, folded=found.log is not None))
    facts = (("log", source_words(found.source, found.sha256)),)
    verdict = (found.problem or f"{len(found.clocks)} channels are read.",)
    page = Page(f"Contents of {Path(found.source).name}", tuple(parts), verdict, None, facts)
    return Answer("\n".join(lines), found.to_dict(), page, ok=not found.problem, warnings=warnings)
