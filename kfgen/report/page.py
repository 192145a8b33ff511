"""`Page`: a self-contained HTML document of a few kinds of parts; `Answer`: what a command says."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import kfgen
from kfgen.core.files.whole_file import write_text
from kfgen.core.terminal import command_line, painted, printable
from kfgen.emit.targets.templates import render
from kfgen.report.plots import Picture


@dataclass(frozen=True)
class PagePart:
    """One part of a page.

    Parameters
    ----------
    kind : str
        ``heading``, ``sentence`` (the answer in words), ``text``, ``table``, ``figure`` (SVG), ``math``
        (MathML) or ``code``.
    content : object
        Text; for a table its rows; markup for math; for a figure what draws it, or its markup.
    head : tuple of str
        Column heads of a table.
    caption : str
    folded : bool
        Whether it is shown when its caption is clicked, and in print.
    """

    kind: str
    content: Any
    head: tuple[str, ...] = ()
    caption: str = ""
    folded: bool = False

    @property
    def drawn(self) -> Any:
        """Its content; a picture is drawn now."""
        return self.picture.svg if self.kind == "figure" else self.content

    @property
    def picture(self) -> Picture:
        """The picture of a figure, made now where it was not yet."""
        made: Picture = self.content() if callable(self.content) else self.content
        return made


@dataclass(frozen=True)
class Page:
    """A title, the answer in a few words, and parts in order.

    Parameters
    ----------
    title : str
    parts : tuple of PagePart
    verdict : tuple of str
        Sentences that say what came out, the first things that are read.
    good : bool, optional
        Whether that is what was hoped for; None where nothing was.
    facts : tuple of (str, str)
        What it was made of, by name: logs, models, rates.
    """

    title: str
    parts: tuple[PagePart, ...] = ()
    verdict: tuple[str, ...] = ()
    good: bool | None = None
    facts: tuple[tuple[str, str], ...] = ()

    def __add__(self, other: Page) -> Page:
        """The parts of both, under this title."""
        return replace(self, parts=self.parts + other.parts)

    @property
    def contents(self) -> list[tuple[str, str]]:
        """Anchor and text of each heading, where there are so many that a list of them helps."""
        headings = [p.content for p in self.parts if p.kind == "heading"]
        found = [(anchor(k, text), text) for k, text in enumerate(headings, 1)]
        return found if len(found) >= LISTED_HEADINGS else []

    @property
    def anchored(self) -> list[tuple[str, PagePart]]:
        """The parts, headings with their anchors."""
        k, out = 0, []
        for part in self.parts:
            k += part.kind == "heading"
            out.append((anchor(k, part.content) if part.kind == "heading" else "", part))
        return out

    def signed(self) -> Page:
        """The page with the command that made it, and when."""
        command = command_line()
        when = datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", time.time())), UTC)
        made = [("command", command)] if command else []
        return replace(self, facts=(*self.facts, *made, ("written", f"{when:%Y-%m-%d %H:%M} UTC")))


LISTED_HEADINGS = 3


def anchor(k: int, words: str) -> str:
    """The anchor of the k-th heading.

    Parameters
    ----------
    k : int
        Counted from 1.
    words : str
        Of the heading.

    Returns
    -------
    str
    """
    return f"{k}-{re.sub(r'[^A-Za-z0-9]+', '-', words).strip('-')[:40].lower()}"


@dataclass(frozen=True)
class Answer:
    """What a command says: text for the terminal, data for programs, a page for people.

    Parameters
    ----------
    ok : bool
        False when a check failed.
    warnings : tuple of str
        For standard error.
    """

    text: str
    data: dict[str, Any]
    page: Page
    ok: bool = True
    warnings: tuple[str, ...] = field(default=())

    def shown(self) -> str:
        """The text as it is printed; on a terminal the verdict in green, or in yellow where it was not hoped for."""
        is_bad = self.page.good is False or not self.ok
        verdict = set() if self.page.good is None and self.ok else set(self.page.verdict)
        sense = "attention" if is_bad else "good"
        lines = [
            painted(printable(line), sense, sys.stdout) if line in verdict else printable(line)
            for line in self.text.split("\n")
        ]
        return "\n".join(lines)


def heading(text: str) -> PagePart:
    """A section's heading."""
    return PagePart("heading", text)


def sentence(text: str) -> PagePart:
    """An answer in words."""
    return PagePart("sentence", text)


def text(words: str) -> PagePart:
    """A paragraph."""
    return PagePart("text", words)


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", folded: bool = False
) -> PagePart:
    """A table of texts.

    Parameters
    ----------
    head : sequence of str
        Of the columns.
    rows : sequence of sequences of str
    caption : str
    folded : bool
        Whether it is shown when its caption is clicked.

    Returns
    -------
    PagePart
    """
    return PagePart("table", [list(r) for r in rows], tuple(head), caption, folded)


def figure(picture: Picture | Callable[[], Picture], caption: str) -> PagePart:
    """A picture, which is drawn when the page is written, if ever; so is what makes one."""
    return PagePart("figure", picture, caption=caption)


def math(markup: str, caption: str = "") -> PagePart:
    """An equation as MathML."""
    return PagePart("math", markup, caption=caption)


def code(words: str, caption: str = "", folded: bool = False) -> PagePart:
    """Preformatted text, ready to be copied.

    Parameters
    ----------
    words : str
    caption : str
    folded : bool
        Whether it is shown when its caption is clicked.

    Returns
    -------
    PagePart
    """
    return PagePart("code", words, caption=caption, folded=folded)


def page_html(page: Page) -> str:
    """The document as text."""
    return render("report/page.html.j2", markup=True, page=page, version=kfgen.__version__)


def write_page(page: Page, path: str | Path) -> None:
    """Write the document, whole or not at all."""
    write_text(path, page_html(page.signed()))


def source_words(path: str, sha256: str) -> str:
    """A file for the facts of a page.

    Parameters
    ----------
    path : str
    sha256 : str
        Hash of the file; empty where it is not known.

    Returns
    -------
    str
    """
    return f"{path.rsplit('/', 1)[-1]}{f', SHA-256 {sha256[:16]}...' if sha256 else ''}"


def columns(rows: Sequence[Sequence[str]], indent: str = "  ") -> str:
    """Rows of texts in aligned columns, for a terminal."""
    if not rows:
        return ""
    widths = [max(len(r[i]) for r in rows if i < len(r)) for i in range(max(map(len, rows)))]
    return "\n".join((indent + "  ".join(c.ljust(w) for c, w in zip(r, widths))).rstrip() for r in rows)
