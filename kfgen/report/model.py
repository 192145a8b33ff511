"""The answers of ``derive`` and ``list``."""

from __future__ import annotations

import re
from collections.abc import Callable

import sympy as sp

from kfgen.catalogue import Catalogue
from kfgen.core.errors import InputError
from kfgen.model.derive import Derivation
from kfgen.model.discretise import DiscreteModel
from kfgen.report.page import Answer, Page, PagePart, columns, heading, math, sentence, table


def mathml(expression: sp.Basic) -> str:
    """Presentation MathML of an expression, namespaced for a page."""
    return (
        f'<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">'
        f"{_fenced(sp.mathml(expression, printer='presentation'))}</math>"
    )


def _fenced(markup: str) -> str:
    """Browsers draw operators as fences, not the old element that sympy writes for them."""
    open_tags: list[str] = []

    def swap(match: re.Match[str]) -> str:
        if match.group(0) == "</mfenced>":
            return f'<mo fence="true">{open_tags.pop()}</mo></mrow>'
        left, right = (re.search(rf'{side}="(.)"', match.group(0)) for side in ("open", "close"))
        open_tags.append(right.group(1) if right else ")")
        return f'<mrow><mo fence="true">{left.group(1) if left else "("}</mo>'

    return re.sub(r"<mfenced[^>]*>|</mfenced>", swap, markup)


def equation_parts(derived: Derivation, letters: tuple[str, ...] = ()) -> list[PagePart]:
    """The matrices as MathML, each under its letter, with four digits.

    Parameters
    ----------
    derived : Derivation
    letters : tuple of str
        Only these matrices; all where empty.
    """
    return [
        math(mathml(_short(M)), f"{letter} ({M.rows} x {M.cols})")
        for letter, M in derived.matrices.items()
        if not letters or letter.split()[0] in letters
    ]


def _short(M: sp.Matrix) -> sp.Matrix:
    return M.applyfunc(lambda e: e.xreplace({f: sp.Float(f, 4) for f in e.atoms(sp.Float)}))


def state_rows(discrete: DiscreteModel) -> list[list[str]]:
    """The error states as rows."""
    return [[str(i), s.name, s.unit, s.title, f"{s.prior:.3g}"] for i, s in enumerate(discrete.model.states)]


STATE_HEAD = ("", "state", "unit", "meaning", "prior standard deviation")


def derive_answer(derived: Derivation, form: str) -> Answer:
    """A model's equations for a terminal and a page.

    Parameters
    ----------
    derived : Derivation
    form : str
        How the terminal shows matrices: ``text``, ``latex`` or ``mathml``.

    Raises
    ------
    InputError
        Another form.
    """
    printers: dict[str, Callable[[sp.Matrix], str]] = {
        "text": lambda M: sp.pretty(_short(M), wrap_line=False, use_unicode=True),
        "latex": lambda M: sp.latex(_short(M)),
        "mathml": lambda M: mathml(_short(M)),
    }
    if form not in printers:
        raise InputError(
            f"there is no format '{form}'", where="--format", remedy=f"Known are {', '.join(printers)}"
        )
    discrete, model = derived.discrete, derived.discrete.model
    body = [f"{model.name}: {model.title}", "", columns([list(STATE_HEAD), *state_rows(discrete)]), ""]
    body += [f"{line}." for line in derived.assumptions] + [""]
    body += [f"{letter} =\n{printers[form](M)}\n" for letter, M in derived.matrices.items()]
    page = Page(
        f"{model.name}: {model.title}",
        (
            heading("States"),
            table(STATE_HEAD, state_rows(discrete)),
            *(sentence(f"{line}.") for line in derived.assumptions),
            heading("Equations"),
            *equation_parts(derived),
        ),
    )
    return Answer("\n".join(body).rstrip(), derived.to_dict(), page)


def list_answer(found: Catalogue) -> Answer:
    """Everything that has a name, for a terminal and a page."""
    lines = []
    for group, entries in found.groups.items():
        lines += [group, columns([[n, t] for n, t in entries]), ""]
    tables = [
        (heading(group), table(("name", "meaning"), entries)) for group, entries in found.groups.items()
    ]
    page = Page("kfgen", tuple(part for parts in tables for part in parts))
    return Answer("\n".join(lines).rstrip(), found.to_dict(), page)
