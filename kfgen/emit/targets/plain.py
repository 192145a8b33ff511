"""Python: a class on numpy alone, equal to the C of the same model in every bit."""

from __future__ import annotations

from typing import Any

import kfgen
from kfgen.emit.covariance.packed import place
from kfgen.emit.geodetic.origin import Border
from kfgen.emit.ir.ir import STATUS, Routine, names_of
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name
from kfgen.emit.targets.printer import PythonPrinter
from kfgen.emit.targets.selftest import FILE, exactly, recorded, selftest
from kfgen.emit.targets.templates import render
from kfgen.emit.targets.words import beware, frames, omitted
from kfgen.emit.watch.quiet import REASONS

TARGET = "numpy"
TITLE = "Python class on numpy alone, equal to the C in every bit"


class NumpyPrinter(PythonPrinter):
    """Python on numpy's scalars: every number has the program's precision."""

    def number(self, value: float) -> str:
        """A literal in its precision."""
        return f"F({float(value)!r})"

    def root(self, argument: str) -> str:
        """Numpy's."""
        return f"np.sqrt({argument})"

    def signum(self, argument: str) -> str:
        """By two comparisons."""
        return f"F(int({argument} > F(0.0)) - int({argument} < F(0.0)))"

    def rounded(self, argument: str) -> str:
        """Numpy's."""
        return f"np.rint({argument})"


def _method(program: Program | Border, routine: Routine) -> dict[str, Any]:
    used, printer = names_of(routine.body), NumpyPrinter(program.n)
    return {
        "name": f"_{routine.name}" if routine.internal else routine.name,
        "text": routine.text,
        "internal": routine.internal,
        "arguments": routine.arguments,
        "defaults": {a.name: [printer.expression(e) for e in a.default] for a in routine.arguments},
        "arrays": [a for a in program.arrays if a in used],
        "scratch": [s for s in routine.scratch if s.name in used],
        "body": "\n".join(printer.statements(routine.body, 3)),
    }


def files(program: Program) -> dict[str, str]:
    """The emitted files by name."""
    calls = recorded(program)
    found = f"[{', '.join(f'*kf.{array}' for array in program.compared)}]"
    own = module(program) | geodetic(program, "x")
    return own | {FILE: selftest(program, class_name(program), calls, exactly(calls), found)}


def geodetic(program: Program, state: str) -> dict[str, str]:
    """The module of the border by name, where there is one.

    Parameters
    ----------
    program : Program
    state : str
        The attribute of a filter that has its stored state.
    """
    border = program.border
    if border is None:
        return {}
    text = render(
        "python/geodetic.py.j2",
        name=program.name,
        model=program.discrete.model,
        version=kfgen.__version__,
        hash=program.discrete.hash[:16],
        state=state,
        border_methods=[_method(border, r) for r in border.routines],
        **border.words,
    )
    return {f"{border.name}.py": text}


def module(program: Program) -> dict[str, str]:
    """The emitted module by name."""
    discrete, form = program.discrete, program.covariance
    text = render(
        "numpy/filter.py.j2",
        model=discrete.model,
        version=kfgen.__version__,
        frames=frames(discrete.model),
        omitted=omitted(discrete.model, len("    ")),
        beware=beware(program, len("    ")),
        hash=discrete.hash[:16],
        program=program,
        form=form,
        klass=class_name(program),
        type=program.type.__name__,
        n=program.n,
        nominal=discrete.nominal_names,
        states=discrete.model.states,
        constants=program.constants,
        settings=program.settings.values(),
        supervisor=program.supervisor.places,
        rows=[place(program.n, i, 0) for i in range(program.n)],
        status=STATUS,
        reasons=REASONS,
        methods=[_method(program, r) for r in (*program.routines, *program.helpers)],
    )
    return {f"{program.name}.py": text}
