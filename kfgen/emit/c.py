"""C99: one self-contained header, and a self-test with vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import kfgen
from kfgen.emit.covariance import packed_size
from kfgen.emit.ir import STATUS, Ref, Routine
from kfgen.emit.printer import Printer
from kfgen.emit.routines import Program
from kfgen.emit.scenario import Call, scenario
from kfgen.emit.templates import render
from kfgen.errors import InputError

TARGET = "c"
TITLE = "C99 header in single precision, with a self-test"

WHOLE = "12582912.0f"
"""``1.5 2^23``: added and taken away, it rounds to the nearest whole number."""

_STRUCT = ("x", "P", "k", "innovation", "variance")


class CPrinter(Printer):
    """Single precision C."""

    def number(self, value: float) -> str:
        """A literal that reads back to the same float."""
        with np.errstate(over="ignore", under="ignore"):
            rounded = np.float32(value)
        if not np.isfinite(rounded) or (value != 0.0 and abs(rounded) < np.finfo(np.float32).tiny):
            raise InputError(
                f"the number {value:.3g} is beyond single precision",
                remedy="Check the sizes and units of the noise file",
            )
        text = f"{rounded:.9g}"
        return (text if "." in text or "e" in text else f"{text}.0") + "f"

    def ref(self, ref: Ref) -> str:
        """Arrays of the filter live in its struct."""
        text = super().ref(ref)
        return f"kf->{text}" if ref.name in _STRUCT else text

    def root(self, argument: str) -> str:
        """By a macro that firmware can replace."""
        return f"KF_SQRT({argument})"

    def magnitude(self, argument: str) -> str:
        """By a comparison."""
        return f"(({argument} < 0.0f) ? (-{argument}) : {argument})"

    def signum(self, argument: str) -> str:
        """By two comparisons."""
        return f"(float)(({argument} > 0.0f) - ({argument} < 0.0f))"

    def rounded(self, argument: str) -> str:
        """By a number so large that no digit is left behind the point."""
        return f"(({argument} + {WHOLE}) - {WHOLE})"

    def let(self, name: str, value: str) -> str:
        """A constant local."""
        return f"const float {name} = {value};"

    def store(self, target: str, value: str) -> str:
        """An assignment."""
        return f"{target} = {value};"

    def note(self, text: str) -> str:
        """A comment."""
        return f"/* {text} */"

    def flag(self, status: str) -> str:
        """The status is set."""
        return f"status = (status > KF_{status}) ? status : KF_{status};"

    def branch(self, condition: str, body: list[str], orelse: list[str]) -> list[str]:
        """``if`` with braces always."""
        return [f"if ({condition}) {{", *body, *(["} else {", *orelse] if orelse else []), "}"]


@dataclass(frozen=True)
class CFunction:
    """A routine as the template needs it."""

    name: str
    text: str
    operations: int
    parameters: tuple[tuple[str, str], ...]
    scratch: tuple[str, ...]
    body: str
    signature: str


def _function(program: Program, routine: Routine) -> CFunction:
    arguments = [
        f"const float {a.name}[{a.size}]" if a.size else f"float {a.name}" for a in routine.arguments
    ]
    signature = ", ".join([f"{program.name}_t *kf", *arguments])
    scratch = tuple(f"float {s.name}[{s.size}] = {{0.0f}};" for s in routine.scratch)
    return CFunction(
        routine.name,
        routine.text,
        routine.operations,
        tuple((a.name, a.text) for a in routine.arguments),
        scratch,
        CPrinter().body(routine),
        signature,
    )


def header(program: Program) -> str:
    """The header's text."""
    model, discrete = program.discrete.model, program.discrete
    return render(
        "c/filter.h.j2",
        name=program.name,
        guard=f"{program.name.upper()}_H",
        model=model,
        version=kfgen.__version__,
        hash=discrete.hash[:16],
        program=program,
        discrete=discrete,
        status=STATUS,
        nominal=list(enumerate(discrete.nominal_names)),
        states=list(enumerate(model.states)),
        constants=list(enumerate(program.constants)),
        nx=len(discrete.nominal_names),
        np=packed_size(program.n),
        functions=[_function(program, r) for r in program.routines],
    )


def files(program: Program) -> dict[str, str]:
    """The emitted files by name."""
    calls = scenario(program)
    return {
        f"{program.name}.h": header(program),
        "selftest.c": render("c/selftest.c.j2", name=program.name, calls=_listed(program, calls)),
        f"{program.name}_vectors.h": _vectors(program, calls),
    }


def _listed(program: Program, calls: Sequence[Call]) -> list[tuple[int, str, str]]:
    """For the self-test's switch: number, routine, arguments read from the vector."""
    listed = []
    for number, routine in enumerate(program.routines[1:]):
        texts, at = [], 0
        for a in routine.arguments:
            texts.append(f"&in[{at}]" if a.size else f"in[{at}]")
            at += a.size or 1
        listed.append((number, routine.name, ", ".join(["&kf", *texts])))
    return listed


def _vectors(program: Program, calls: Sequence[Call]) -> str:
    """Inputs and expected words of a short scenario, as exact bit patterns."""
    numbers = {r.name: i for i, r in enumerate(program.routines[1:])}
    short = calls[:SELFTEST_CALLS]
    width = max(len(c.inputs) for c in short)
    inputs = [[*c.inputs, *([0.0] * (width - len(c.inputs)))] for c in short]
    return render(
        "c/vectors.h.j2",
        name=program.name,
        count=len(short),
        width=width,
        words=short[-1].words.size,
        routine=[numbers[c.routine] for c in short],
        inputs=[_bits(row) for row in inputs],
        expected=_bits(short[-1].words),
    )


def _bits(values: Sequence[float] | np.ndarray) -> list[str]:
    return [f"0x{int(w):08x}u" for w in np.asarray(values, np.float32).view(np.uint32)]


SELFTEST_CALLS = 100
"""Calls in the self-test that goes with the header."""
