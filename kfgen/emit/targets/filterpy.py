"""Python: a subclass of filterpy's extended Kalman filter with error-state injection."""

from __future__ import annotations

import kfgen
from kfgen.core.errors import InputError
from kfgen.emit.covariance.forms import Packed
from kfgen.emit.ir.ir import STATUS, Argument, Routine
from kfgen.emit.routines import GATE, MAX_INPUT_SQUARE_SUM, Program
from kfgen.emit.targets.printer import PythonPrinter
from kfgen.emit.targets.selftest import FILE, nearly, recorded, selftest
from kfgen.emit.targets.templates import render
from kfgen.emit.targets.words import frames, omitted

TARGET = "filterpy"
TITLE = "Python class on filterpy's ExtendedKalmanFilter, in double precision"


def _function(routine: Routine, n: int) -> dict[str, object]:
    outputs = {"transition": ["Phi"], "noise": ["Qd"]}.get(
        routine.name, ["h", "H"] if routine.name.startswith("expect_") else []
    )
    arguments = ["x: list[float]", "k: list[float]", *(f"{o}: Vector" for o in outputs)]
    arguments += [f"{a.name}: {'Vector' if a.size else 'float'}" for a in routine.arguments]
    return {
        "name": f"_{routine.name}",
        "text": routine.text,
        "arguments": ", ".join(arguments),
        "body": PythonPrinter(n).body(routine) or "    pass",
    }


def _call(arguments: tuple[Argument, ...]) -> str:
    return "".join(f", {a.name}" for a in arguments)


def _typed(arguments: tuple[Argument, ...]) -> str:
    return "".join(f", {a.name}: {'Vector' if a.size else 'float'}" for a in arguments)


def class_name(program: Program) -> str:
    """The name of the emitted class."""
    return "".join(part.capitalize() for part in program.name.split("_"))


def files(program: Program) -> dict[str, str]:
    """The emitted files by name; raises as `module` does."""
    emitted = module(program)
    calls = recorded(program)
    found = f"[*kf.nominal, *kf.P[np.triu_indices({program.n})]]"
    return emitted | {FILE: selftest(program, class_name(program), calls, nearly(program, calls), found)}


def module(program: Program) -> dict[str, str]:
    """The emitted module by name.

    Raises
    ------
    InputError
        The program wants factors or loops, which filterpy has not.
    """
    if program.form != Packed.NAME or program.loops:
        raise InputError(
            "filterpy keeps the covariance itself, as a matrix",
            where="--form" if program.form != Packed.NAME else "--loops",
            remedy="Leave it out, or use --target numpy or c",
        )
    discrete = program.discrete
    pieces = {r.name: r for r in program.pieces}
    sensors = [
        {
            "name": s.name,
            "title": s.title,
            "unit": s.unit,
            "channels": s.channels,
            "period": s.period,
            "R": [discrete.measurement_variance(s, c) for c in s.channels],
            "extra": _call(pieces[f"expect_{s.name}"].arguments),
            "typed": _typed(pieces[f"expect_{s.name}"].arguments),
            "texts": [(a.name, a.text) for a in pieces[f"expect_{s.name}"].arguments],
            "scalars": [a.name for a in pieces[f"expect_{s.name}"].arguments],
        }
        for s in discrete.model.sensors
    ]
    step = pieces["step"].arguments
    longest = max((pieces[n].arguments for n in ("step", "transition", "noise")), key=len)
    text = render(
        "filterpy/filter.py.j2",
        name=program.name,
        model=discrete.model,
        version=kfgen.__version__,
        frames=frames(discrete.model),
        omitted=omitted(discrete.model, len("    ")),
        hash=discrete.hash[:16],
        n=program.n,
        klass=class_name(program),
        nominal=discrete.nominal_names,
        start=discrete.start,
        states=discrete.model.states,
        constants=program.constants[:-1],
        gate=GATE,
        huge=MAX_INPUT_SQUARE_SUM,
        status=STATUS,
        longest=discrete.max_step,
        rows=program.rows,
        given=[a.name for a in longest[:-1]],
        functions=[_function(r, program.n) for r in program.pieces],
        sensors=sensors,
        inputs=_typed(longest),
        texts=[(a.name, a.text) for a in longest],
        step=_call(step),
        transition=_call(pieces["transition"].arguments),
        noise=_call(pieces["noise"].arguments),
    )
    return {f"{program.name}.py": text}
