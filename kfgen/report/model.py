"""The answers of ``derive`` and ``list``."""

from __future__ import annotations

import re
from collections.abc import Callable

import sympy as sp

import kfgen
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.motion import Input
from kfgen.model.parts.sensor import Sensor
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


def equations(discrete: DiscreteModel) -> list[tuple[str, sp.Matrix]]:
    """The matrices of a filter by letter."""
    model = discrete.model
    return [
        ("F", model.F),
        ("G", model.G),
        ("W", model.W),
        *((f"H {s.name}", discrete.H(s)) for s in model.sensors),
        ("Phi", discrete.Phi),
        ("Qd", discrete.Qd),
    ]


def equation_parts(discrete: DiscreteModel, letters: tuple[str, ...] = ()) -> list[PagePart]:
    """The matrices as MathML, each under its letter; short of digits."""
    return [
        math(mathml(_short(M)), f"{letter} ({M.rows} x {M.cols})")
        for letter, M in equations(discrete)
        if not letters or letter.split()[0] in letters
    ]


def _short(M: sp.Matrix) -> sp.Matrix:
    return M.applyfunc(lambda e: e.xreplace({f: sp.Float(f, 4) for f in e.atoms(sp.Float)}))


def state_rows(discrete: DiscreteModel) -> list[list[str]]:
    """The error states as rows."""
    return [[str(i), s.name, s.unit, s.title, f"{s.prior:.3g}"] for i, s in enumerate(discrete.model.states)]


def _parts(discrete: DiscreteModel) -> list[Input | Sensor]:
    return [*discrete.model.motion.inputs, *discrete.model.sensors]


def assumptions(discrete: DiscreteModel) -> list[str]:
    """What a reader must know beside the matrices: frame, convention, and what is left out."""
    model, said = discrete.model, []
    if model.attitude is not None:
        axes = ", ".join(model.motion.axes)
        said.append(f"Navigation axes {axes}; R_nb takes body to navigation axes")
        said.append(f"Error: {model.convention.title}; {model.convention.equation}")
    for part in _parts(discrete):
        if part.left_out:
            said.append(
                f"{part.name}: {part.left_out:g} {part.unit}/sqrt(Hz) is added to its noise for what the model "
                "leaves out (off with --set left_out=false)"
            )
    return said


STATE_HEAD = ("", "state", "unit", "meaning", "prior deviation")


def derive_answer(discrete: DiscreteModel, form: str) -> Answer:
    """A model's equations as text, LaTeX or MathML."""
    printers: dict[str, Callable[[sp.Matrix], str]] = {
        "text": lambda M: sp.pretty(_short(M), wrap_line=False, use_unicode=True),
        "latex": lambda M: sp.latex(_short(M)),
        "mathml": lambda M: mathml(_short(M)),
    }
    model, pairs = discrete.model, equations(discrete)
    body = [f"{model.name}: {model.title}", "", columns([list(STATE_HEAD), *state_rows(discrete)]), ""]
    body += [f"{line}." for line in assumptions(discrete)] + [""]
    body += [f"{letter} =\n{printers[form](M)}\n" for letter, M in pairs]
    data = {
        "format": "kfgen-derive-1",
        "kfgen": kfgen.__version__,
        "model": model.name,
        "hash": model.hash,
        "states": [{"name": s.name, "unit": s.unit, "title": s.title} for s in model.states],
        "options": dict(model.options),
        "convention": model.convention.name if model.attitude else None,
        "equation": model.convention.equation if model.attitude else None,
        "left_out": {
            p.name: {"value": p.left_out, "unit": f"{p.unit}/sqrt(Hz)"}
            for p in _parts(discrete)
            if p.left_out
        },
        "matrices": {
            letter: [[str(M[i, j]) for j in range(M.cols)] for i in range(M.rows)] for letter, M in pairs
        },
    }
    page = Page(
        f"{model.name}: {model.title}",
        (
            heading("States"),
            table(STATE_HEAD, state_rows(discrete)),
            *(sentence(f"{line}.") for line in assumptions(discrete)),
            heading("Equations"),
            *equation_parts(discrete),
        ),
    )
    return Answer("\n".join(body).rstrip(), data, page)


def list_answer(groups: dict[str, list[tuple[str, str]]]) -> Answer:
    """Everything that has a name."""
    lines = []
    for group, entries in groups.items():
        lines += [group, columns([[n, t] for n, t in entries]), ""]
    data = {
        "format": "kfgen-list-1",
        "kfgen": kfgen.__version__,
        **{g.replace(" ", "_"): dict(entries) for g, entries in groups.items()},
    }
    page = Page(
        "kfgen",
        tuple(p for g, entries in groups.items() for p in (heading(g), table(("name", "meaning"), entries))),
    )
    return Answer("\n".join(lines).rstrip(), data, page)
