"""`Page`: a self-contained HTML document of a few kinds of parts; `Answer`: what a command says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import kfgen
from kfgen.core.whole_file import write_text
from kfgen.emit.targets.templates import render


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
    """

    kind: str
    content: Any
    head: tuple[str, ...] = ()
    caption: str = ""

    @property
    def drawn(self) -> Any:
        """Its content; a picture is drawn now."""
        return self.content() if callable(self.content) else self.content


@dataclass(frozen=True)
class Page:
    """A title and parts in order."""

    title: str
    parts: tuple[PagePart, ...] = ()

    def __add__(self, other: Page) -> Page:
        """The parts of both, under this title."""
        return Page(self.title, self.parts + other.parts)


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


def heading(text: str) -> PagePart:
    """A section's heading."""
    return PagePart("heading", text)


def sentence(text: str) -> PagePart:
    """An answer in words."""
    return PagePart("sentence", text)


def text(words: str) -> PagePart:
    """A paragraph."""
    return PagePart("text", words)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> PagePart:
    """A table of texts."""
    return PagePart("table", [list(r) for r in rows], tuple(head), caption)


def figure(svg: str | Callable[[], str], caption: str) -> PagePart:
    """A picture as inline SVG; given what draws it, it is drawn when the page is written, if ever."""
    return PagePart("figure", svg, caption=caption)


def math(markup: str, caption: str = "") -> PagePart:
    """An equation as MathML."""
    return PagePart("math", markup, caption=caption)


def code(words: str, caption: str = "") -> PagePart:
    """Preformatted text."""
    return PagePart("code", words, caption=caption)


def page_html(page: Page) -> str:
    """The document as text."""
    return render("report/page.html.j2", markup=True, page=page, version=kfgen.__version__)


def write_page(page: Page, path: str | Path) -> None:
    """Write the document, whole or not at all."""
    write_text(path, page_html(page))


def columns(rows: Sequence[Sequence[str]], indent: str = "  ") -> str:
    """Rows of texts in aligned columns, for a terminal."""
    if not rows:
        return ""
    widths = [max(len(r[i]) for r in rows if i < len(r)) for i in range(max(map(len, rows)))]
    return "\n".join((indent + "  ".join(c.ljust(w) for c, w in zip(r, widths))).rstrip() for r in rows)
