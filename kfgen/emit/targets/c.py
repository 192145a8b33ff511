"""C99: one self-contained header, and a self-test with vectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import kfgen
from kfgen.audit.audit import unobservable_directions
from kfgen.core.errors import InputError
from kfgen.emit.covariance.forms import HELD
from kfgen.emit.covariance.packed import place
from kfgen.emit.geodetic.origin import Border
from kfgen.emit.ir.ir import STATUS, Argument, Compare, Ref, Routine, names_of
from kfgen.emit.routines import Program
from kfgen.emit.scenario import RecordedCall, split
from kfgen.emit.settings import field_name
from kfgen.emit.targets.names import identifier
from kfgen.emit.targets.printer import Printer
from kfgen.emit.targets.selftest import recorded
from kfgen.emit.targets.templates import render
from kfgen.emit.targets.words import accuracy, beware, frames, omitted
from kfgen.emit.watch.quiet import REASONS
from kfgen.model.filter import FilterModel

TARGET = "c"
TITLE = "C99 header, with a self-test"


@dataclass(frozen=True)
class Real:
    """A real type of C: its literals' suffix, its square root, what rounds it to whole numbers."""

    name: str
    suffix: str
    root: str
    macro: str
    whole: float
    """``1.5 2^m`` for m bits of mantissa: added and subtracted, it rounds to the nearest whole number."""
    word: str


REAL = {
    "float": Real("float", "f", "sqrtf", "KF_SQRT", 1.5 * 2.0**23, "uint32_t"),
    "double": Real("double", "", "sqrt", "KF_SQRT_D", 1.5 * 2.0**52, "uint64_t"),
}


class CPrinter(Printer):
    """C in the program's precision."""

    def __init__(self, program: Program | Border) -> None:
        super().__init__(program.n)
        self.program = program
        self.real = REAL[program.real]

    def number(self, value: float) -> str:
        """A literal that reads back to the same number."""
        kind = self.program.type
        with np.errstate(over="ignore", under="ignore"):
            rounded = kind(value)
        if not np.isfinite(rounded) or (value != 0.0 and abs(rounded) < np.finfo(kind).tiny):
            raise InputError(
                f"the number {value:.3g} is beyond the precision of {self.real.name}",
                remedy="Check the sizes and units of the noise file",
            )
        text = f"{rounded:.9g}" if kind is np.float32 else repr(float(rounded))
        return (text if "." in text or "e" in text else f"{text}.0") + self.real.suffix

    def ref(self, ref: Ref) -> str:
        """Arrays of the filter live in its struct."""
        text = super().ref(ref)
        return f"kf->{text}" if ref.name in self.program.arrays else text

    def row(self, i: str) -> str:
        """From a table."""
        return f"{self.program.name}_row[{i}]"

    def loop(self, head: tuple[str, str, str, bool], body: list[str]) -> list[str]:
        """``for``."""
        var, start, stop, down = head
        if down:
            first = f"{stop} - 1" if not stop.isdigit() else str(int(stop) - 1)
            return [f"for (int {var} = {first}; {var} >= {start}; {var}--) {{", *body, "}"]
        return [f"for (int {var} = {start}; {var} < {stop}; {var}++) {{", *body, "}"]

    def call(self, routine: str, arguments: list[str], merged: bool = False) -> str:
        """A static function of the header; one that takes variances has them given."""
        name = f"{self.program.name}_{routine}" + "_with_variance" * (routine in self.program.varied)
        called = f"{name}({', '.join(['kf', *arguments])})"
        if not merged:
            return f"{called};"
        return f"{{ const kf_status_t said = {called}; status = (said > status) ? said : status; }}"

    def whole(self, name: str, value: str) -> str:
        """A constant local."""
        return f"const int {name} = KF_CAST(int, {value});"

    def root(self, argument: str) -> str:
        """By a macro that firmware can replace."""
        return f"{self.real.macro}({argument})"

    def magnitude(self, argument: str) -> str:
        """By a comparison."""
        return f"(({argument} < {self.number(0.0)}) ? (-{argument}) : {argument})"

    def signum(self, argument: str) -> str:
        """By two comparisons, without a cast."""
        zero, one = self.number(0.0), self.number(1.0)
        return f"(({argument} > {zero}) ? {one} : (({argument} < {zero}) ? -{one} : {zero}))"

    def rounded(self, argument: str) -> str:
        """By a number so large that no digit is left behind the point."""
        whole = self.number(self.real.whole)
        return f"(({argument} + {whole}) - {whole})"

    def let(self, name: str, value: str) -> str:
        """A constant local."""
        return f"const {self.real.name} {name} = {value};"

    def store(self, target: str, value: str) -> str:
        """An assignment."""
        return f"{target} = {value};"

    def note(self, text: str) -> str:
        """A comment."""
        return f"/* {text} */"

    def flag(self, status: str) -> str:
        """The status is set."""
        return f"status = (status > KF_{status}) ? status : KF_{status};"

    def setting(self, name: str) -> str:
        """A macro of the header."""
        return f"{self.program.name.upper()}_PARAMETER({field_name(name)})"

    def comparison(self, c: Compare) -> str:
        """Each side in its own parentheses."""
        return f"{self.expression(c.a)} {c.op} {self.expression(c.b)}"

    def conjunction(self, texts: list[str]) -> str:
        """``&&``, each condition in its own parentheses."""
        return " && ".join(f"({text})" for text in texts)

    def branch(self, condition: str, body: list[str], orelse: list[str]) -> list[str]:
        """``if`` with braces always."""
        if not body:
            return [f"if (!({condition})) {{", *orelse, "}"]
        return [f"if ({condition}) {{", *body, *(["} else {", *orelse] if orelse else []), "}"]


@dataclass(frozen=True)
class DefaultArgument:
    """An argument that a shorter function gives to the longer one: its name, and the text of its numbers."""

    name: str
    size: int
    numbers: str


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
    internal: bool
    defaults: tuple[DefaultArgument, ...] = ()
    short_signature: str = ""


def _function(
    program: Program | Border, routine: Routine, printing: type[CPrinter] | None = None
) -> CFunction:
    real = program.real
    fixed = "" if routine.internal else "const "

    def signature(arguments: Sequence[Argument]) -> str:
        own = [f"{fixed}{real} {a.name}[{a.size}]" if a.size else f"{real} {a.name}" for a in arguments]
        return ", ".join([f"{program.name}_t *kf", *own])

    printer = (printing or CPrinter)(program)
    left_out = [a for a in routine.arguments if a.default]
    return CFunction(
        routine.name,
        routine.text,
        routine.operations,
        tuple((a.name, a.text) for a in routine.arguments),
        tuple(f"{real} {s.name}[{s.size}] = {{0}};" for s in routine.scratch if _uses(routine, s.name)),
        printer.body(routine),
        signature(routine.arguments),
        routine.internal,
        tuple(
            DefaultArgument(a.name, a.size, ", ".join(printer.expression(n) for n in a.default))
            for a in left_out
        ),
        signature(routine.required),
    )


def _uses(routine: Routine, name: str) -> bool:
    return name in names_of(routine.body)


def header(program: Program, unobservable: Sequence[str] = ()) -> str:
    """The header's text.

    Parameters
    ----------
    program : Program
    unobservable : sequence of str
        Directions that no measurement shows at rest, as the audit says them.
    """
    return render(
        "c/filter.h.j2",
        **_common(program),
        unobservable=unobservable,
        accuracy=accuracy(program.discrete, len(" * ")),
        omitted=omitted(program.discrete.model, len(" *   ")),
        beware=beware(program, len(" *   ")),
        status=STATUS,
        reasons=REASONS,
        field_name=field_name,
        states=list(enumerate(program.discrete.model.states)),
        constants=list(enumerate(program.constants)),
        rows=[place(program.n, i, 0) for i in range(program.n)],
        places=[program.covariance.order.index(i) for i in range(program.n)],
        settings=[
            (s, CPrinter(program).number(s.value), f"{program.name.upper()}_{s.name}")
            for s in program.settings.values()
        ],
        supervisor=list(enumerate(program.supervisor.places)),
        bytes=memory_bytes(program),
        horizon_bytes=horizon_bytes(program),
        sizes={"x": f"{program.name.upper()}_NX", program.covariance.ARRAY: f"{program.name.upper()}_NP"}
        | {HELD: f"{program.name.upper()}_N"},
        blocks=_blocks(program),
        helpers=[_function(program, r) for r in program.helpers],
        functions=[_function(program, r) for r in program.routines],
    )


def _common(program: Program) -> dict[str, Any]:
    """What every template of a filter knows."""
    discrete = program.discrete
    return {
        "name": program.name,
        "guard": f"{program.name.upper()}_H",
        "model": discrete.model,
        "version": kfgen.__version__,
        "hash": discrete.hash[:16],
        "program": program,
        "frames": frames(discrete.model),
        "form": program.covariance,
        "real": REAL[program.real],
        "discrete": discrete,
        "nominal": list(enumerate(discrete.nominal_names)),
        "nx": len(discrete.nominal_names),
        "np": program.covariance.size,
    }


def memory_bytes(program: Program) -> int:
    """What a filter takes."""
    return _bytes_of(program, program.arrays)


def horizon_bytes(program: Program) -> int:
    """What of that the delayed horizon takes."""
    if not program.horizon:
        return 0
    memory = program.delayed_memory
    return _bytes_of(program, memory.arrays | memory.waiting)


def _bytes_of(program: Program, arrays: Mapping[str, tuple[int, str]]) -> int:
    return sum(size for size, _ in arrays.values()) * np.dtype(program.type).itemsize


def _blocks(program: Program) -> list[tuple[str, str, int, int]]:
    """Name, meaning, first place and size of each block of the stored state."""
    names = list(program.discrete.nominal_names)
    blocks = [(identifier(b.name), b.title, b.nominal_names) for b in program.discrete.model.blocks]
    return [
        ("attitude" if "q_w" in stored else name, title, names.index(stored[0]), len(stored))
        for name, title, stored in blocks
        if stored
    ]


def unobservable_at_rest(model: FilterModel) -> tuple[str, ...]:
    """What the audit at rest says no measurement shows, in sentences.

    Nothing of a model that a driver acts on: it hides other directions at every temperature.
    """
    if model.drivers:
        return ()
    try:
        return tuple(d.sentence for d in unobservable_directions(model))
    except InputError as error:
        return (f"not known, for the audit has no exact answer: {error}",)


PLAIN = ("main.c", "CMakeLists.txt", "library.properties", "library.json")
"""Files around the header, each from the template of its name."""


def files(program: Program) -> dict[str, str]:
    """The emitted files by name."""
    calls = recorded(program)
    first = {c.routine: c for c in reversed(calls)}
    common = _common(program) | {
        "compared": program.compared,
        "calls": [(k, r.name, call_arguments(r)) for k, r in enumerate(program.routines[1:])],
        "first": [
            (r.name, [(a, v) for a, v in zip(r.required, _literals(program, r, first[r.name].inputs))])
            for r in program.routines[1:]
        ],
    }
    return {
        f"{program.name}.h": header(program, unobservable_at_rest(program.discrete.model)),
        **_geodetic(program, common),
        "selftest.c": render("c/selftest.c.j2", **common),
        f"{program.name}_vectors.h": _vectors(program, calls),
        **{name: render(f"c/{name}.j2", **common) for name in PLAIN},
        "zephyr/module.yml": render("c/module.yml.j2", **common),
        "zephyr/CMakeLists.txt": render("c/zephyr.txt.j2", **common),
    }


class BorderPrinter(CPrinter):
    """C of the border: its settings are macros."""

    def setting(self, name: str) -> str:
        """A macro of its header."""
        return f"{self.program.name.upper()}_{name}"


def _geodetic(program: Program, common: dict[str, Any]) -> dict[str, str]:
    """The header of the border, where there is one."""
    border = program.border
    if border is None:
        return {}
    functions = [_function(border, r, BorderPrinter) for r in border.routines]
    own = border.words | {"double": REAL[border.real], "border_functions": functions}
    return {f"{border.name}.h": render("c/geodetic.h.j2", **common, **own)}


def _literals(program: Program, routine: Routine, inputs: Sequence[float]) -> list[list[str]]:
    """The inputs of a call as literals, argument by argument."""
    printer = CPrinter(program)
    return [
        [printer.number(float(v)) for v in (value if isinstance(value, tuple) else (value,))]
        for value in split(routine, tuple(inputs))
    ]


def call_arguments(routine: Routine, of: str = "kf") -> str:
    """The arguments of a call of a routine on a filter, taken from an array ``in`` that has them in a row."""
    texts, at = [f"&{of}"], 0
    for a in routine.required:
        texts.append(f"&in[{at}]" if a.size else f"in[{at}]")
        at += a.size or 1
    return ", ".join(texts)


def _vectors(program: Program, calls: Sequence[RecordedCall]) -> str:
    """Inputs and expected values of a short scenario, as bit patterns."""
    numbers = {r.name: i for i, r in enumerate(program.routines[1:])}
    short = calls
    width = max(len(c.inputs) for c in short)
    inputs = [[*c.inputs, *([0.0] * (width - len(c.inputs)))] for c in short]
    return render(
        "c/vectors.h.j2",
        name=program.name,
        word=REAL[program.real].word,
        count=len(short),
        width=width,
        words=short[-1].words.size,
        routine=[numbers[c.routine] for c in short],
        inputs=[_bits(row, program) for row in inputs],
        expected=_bits(short[-1].words, program),
    )


def _bits(values: Sequence[float] | np.ndarray, program: Program) -> list[str]:
    exact = np.asarray(values, program.type)
    digits = 2 * exact.itemsize
    return [f"0x{int(w):0{digits}x}u{'ll' * (digits > 8)}" for w in exact.view(f"u{exact.itemsize}")]
