"""Python: a subclass of filterpy's extended Kalman filter with error-state injection."""

from __future__ import annotations

from typing import Any

import kfgen
from kfgen.core.errors import InputError
from kfgen.emit.align_routine import AlignRoutine
from kfgen.emit.check import MAX_NORM_ERROR, widest
from kfgen.emit.covariance.forms import Packed
from kfgen.emit.gather import memory as gathering
from kfgen.emit.guards import MAX_SUM, SHORTEST_STEP_S
from kfgen.emit.ir.ir import STATUS, Argument, Routine, Stmt
from kfgen.emit.moving.moving import MovingAlign
from kfgen.emit.routines import Program
from kfgen.emit.settings import gates, sample_variance, squared_gate
from kfgen.emit.targets.names import identifier
from kfgen.emit.targets.printer import PythonPrinter
from kfgen.emit.targets.selftest import FILE, nearly, recorded, selftest
from kfgen.emit.targets.templates import render
from kfgen.emit.targets.words import beware, frames, omitted
from kfgen.emit.update import LEAST_SEEN, widened_share
from kfgen.emit.watch import lanes
from kfgen.emit.watch.biases import bounded
from kfgen.emit.watch.quiet import REASONS
from kfgen.emit.watch.rest_routine import detect_rest
from kfgen.emit.watch.supervisor import ARRAY
from kfgen.model.parts.sensors import Sensor

TARGET = "filterpy"
TITLE = "Python class on filterpy's ExtendedKalmanFilter, in double precision"


def _function(routine: Routine, n: int) -> dict[str, object]:
    made = {"transition": ["Phi"], "noise": ["Qd"], "expect": ["h", "H"], "length": ["length"]}
    outputs = made.get(routine.name.split("_")[0], [])
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


def _limits(program: Program, arguments: tuple[Argument, ...]) -> list[tuple[str, str]]:
    """Arguments by name, with the text of what no number of theirs may exceed."""
    printer = PythonPrinter(program.n)
    return [(a.name, printer.expression(program.input_limit(a.name))) for a in arguments]


def _methods(program: Program) -> list[dict[str, str]]:
    """The supervisor's methods."""
    watch, lower = program.supervisor, program.lowering()
    made: list[tuple[str, str, str, list[Stmt], str]] = [
        ("_elapsed", ", dt: float", "A step goes by.", watch.elapsed(), ""),
        ("_missed", ", dt: float", "A step goes by without a prediction.", watch.missed(), ""),
        (
            "_resynchronise",
            "",
            "Where too many steps were missed, nothing that was known holds.",
            watch.resynchronise(),
            "",
        ),
        (
            "_changed",
            "".join(f", {t}: Vector" for t in watch.triads) + ", dt: float",
            "Whether inputs change.",
            watch.changed(),
            "",
        ),
        ("_lost", "", "All states go back to their priors.", watch.widen(), ""),
        ("supervise", "", watch.condition.text, list(watch.condition.body), "status"),
    ]
    for sensor in program.discrete.model.sensors:
        s, gate = sensor.name, squared_gate(lower, sensor)
        made += [
            (
                f"_rejected_{s}",
                "",
                "It is counted; whether that has gone on for too long.",
                [*lanes.tested(program, sensor, gate), *watch.rejected(s)],
                "due",
            ),
            (f"_reset_{s}", "", "What comes before its states are widened.", watch.reset(s), ""),
            (
                f"_accepted_{s}",
                ", status: Status",
                "A sample was fused.",
                [*lanes.tested(program, sensor, gate), *watch.accepted(s, gate)],
                "guard",
            ),
        ]
    made += _of_lanes(program)
    limits = "Biases beyond their bounds are held there."
    made.append(("_bounded", ", status: Status", limits, bounded(program), "bounded"))
    made += [
        ("align", _typed(r.arguments), r.text, list(AlignRoutine(program).body(())), "aligned")
        for r in program.align
    ]
    made += [("gather", _typed(r.arguments), r.text, list(r.body), "gathered") for r in program.gather]
    return [
        *(_method(program, *m) for m in made),
        *(
            _plain(program, r)
            for r in (
                *detect_rest(program),
                *program.delayed,
                *program.recentre,
                *_moving(program),
            )
        ),
    ]


def _of_lanes(program: Program) -> list[tuple[str, str, str, list[Stmt], str]]:
    """What tells a jump, and what follows a hand-over."""
    if not program.lanes:
        return []
    tell, *_ = lanes.internals(program)
    handed, (health, _) = lanes.handed(program.supervisor), lanes.routines(program)
    return [
        (f"_{tell.name}", ", before: list[float]", tell.text, list(tell.body), "told"),
        ("_handed", "", "A state that is another lane's begins here.", handed, ""),
        (health.name, "", health.text, list(health.body), "health"),
    ]


def _moving(program: Program) -> tuple[Routine, ...]:
    return MovingAlign(program, matrix=True).routines() if program.moving else ()


def _plain(program: Program, routine: Routine) -> dict[str, str]:
    """A routine as a method, which may call others."""
    printer = PythonPrinter(program.n)
    start = ["status, x, k, supervisor = Status.OK, self.nominal, self.constants, self.supervisor"]
    start += [f"{a} = self.{a}" for a in _lists(program)]
    start += [f"{s.name} = [0.0] * {s.size}" for s in routine.scratch]
    start += [
        f"{a.name} = [{', '.join(map(printer.expression, a.default))}] if {a.name} is None else {a.name}"
        for a in routine.arguments
        if a.default
    ]
    lines = [*(f"        {line}" for line in start), *printer.statements(routine.body, 2)]
    if any(s.name == "known" for s in routine.scratch):
        lines += [
            "        if known[0] > 0.0:",
            "            self._known(np.array(gain), spread[0], tilted[0])",
        ]
    return {
        "name": routine.name,
        "arguments": _typed(routine.arguments),
        "text": routine.text,
        "result": "Status",
        "body": "\n".join([*lines, "        return status"]),
    }


BEFORE = {
    "aligned": "        status, x, k = Status.OK, self.nominal, [*self.constants, *self.gates.values()]\n"
    "        gain, ahead, spread, tilted, why = [0.0] * len(STATES), [0.0] * 3, [0.0], [0.0], [0.0]\n",
    "status": "        status = Status.OK\n",
    "bounded": "        x = self.nominal\n",
    "due": "        due, nis, k = [0.0], [self.nis], [*self.constants, *self.gates.values()]\n",
    "health": "        status, k = Status.OK, [*self.constants, *self.gates.values()]\n"
    f"        {lanes.OUT} = [0.0] * len(STATES)\n",
    "told": "        x = self.nominal\n",
    "guard": "        nis, k = [self.nis], [*self.constants, *self.gates.values()]\n",
}
AFTER = {
    "gathered": "\n        return status",
    "aligned": "\n        if status is Status.OK:\n"
    "            self.constants[:] = k[:len(self.constants)]\n"
    "            self._known(np.array(gain), spread[0], tilted[0])\n"
    "        return status",
    "status": "\n        return status",
    "bounded": "\n        return status",
    "health": "\n        return status",
    "due": "\n        return due[0] > 0.0",
    "guard": "\n        return max(status, self._guarded())",
}
RESULT = {
    "gathered": "Status",
    "aligned": "Status",
    "status": "Status",
    "bounded": "Status",
    "health": "Status",
    "due": "bool",
    "guard": "Status",
}


def _method(
    program: Program, name: str, arguments: str, text: str, body: list[Stmt], ends: str
) -> dict[str, str]:
    """A method on the supervisor's numbers: what it returns is said by how it ends."""
    lines = "\n".join(PythonPrinter(program.n).statements(tuple(body), 2)) or "        pass"
    start = f"        {ARRAY} = self.{ARRAY}\n"
    if ends == "gathered":
        start += "        status = Status.OK\n"
        start += "".join(f"        {a} = self.{a}\n" for a in gathering(program.discrete.model))
    return {
        "name": name,
        "arguments": arguments,
        "text": text,
        "result": RESULT.get(ends, "None"),
        "body": BEFORE.get(ends, "") + start + lines + AFTER.get(ends, ""),
    }


def _typed(arguments: tuple[Argument, ...]) -> str:
    return "".join(
        f", {a.name}: {'Vector' if a.size else 'float'}{' | None = None' if a.default else ''}"
        for a in arguments
    )


def _lists(program: Program) -> dict[str, tuple[int, str]]:
    """Arrays that a filter has beside those of its template."""
    own = gathering(program.discrete.model)
    return own | program.delayed_memory.arrays | program.delayed_memory.waiting if program.horizon else own


def class_name(program: Program) -> str:
    """The name of the emitted class."""
    return "".join(part.capitalize() for part in program.name.split("_"))


def files(program: Program) -> dict[str, str]:
    """The emitted files by name; raises as `module` does."""
    from kfgen.emit.targets.plain import geodetic

    emitted = module(program) | geodetic(program, "nominal")
    calls = recorded(program)
    found = f"[*kf.nominal, *kf.P[np.triu_indices({program.n})], *kf.supervisor]"
    return emitted | {FILE: selftest(program, class_name(program), calls, nearly(program, calls), found)}


def _sensor(program: Program, s: Sensor, arguments: tuple[Argument, ...]) -> dict[str, Any]:
    """A sensor as the template needs it."""
    share, printer, H = s.gated_length()[1], PythonPrinter(program.n), program.discrete.H(s)
    return {
        "name": s.name,
        "title": s.title,
        "unit": s.unit,
        "channels": s.channels,
        "period": s.period,
        "R": [printer.expression(sample_variance(program.discrete, s, c)) for c in s.channels],
        "widened": [
            widened_share(program, [j for j in range(program.n) if row[j] != 0]) for row in H.tolist()
        ],
        "least": f"MIN_{identifier(s.name).upper()}" if s.min_length else "",
        "share": share,
        "shortest": (1.0 - share) ** 2,
        "longest": (1.0 + share) ** 2,
        "limits": [
            ("z", f"MAX_{identifier(s.name).upper()}_SAMPLE"),
            *_limits(program, arguments),
        ],
        "extra": _call(arguments),
        "typed": _typed(arguments),
        "texts": [(a.name, a.text) for a in arguments],
    }


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
    discrete, attitude = program.discrete, program.discrete.model.attitude
    pieces = {r.name: r for r in program.pieces}
    sensors = [_sensor(program, s, pieces[f"expect_{s.name}"].arguments) for s in discrete.model.sensors]
    step = pieces["step"].arguments
    longest = max((pieces[n].arguments for n in ("step", "transition", "noise")), key=len)
    text = render(
        "filterpy/filter.py.j2",
        name=program.name,
        model=discrete.model,
        version=kfgen.__version__,
        frames=frames(discrete.model),
        omitted=omitted(discrete.model, len("    ")),
        beware=beware(program, len("    ")),
        hash=discrete.hash[:16],
        n=program.n,
        klass=class_name(program),
        nominal=discrete.nominal_names,
        start=discrete.start,
        states=discrete.model.states,
        constants=discrete.model.constants,
        settings=program.settings.values(),
        supervisor=program.supervisor.places,
        supervisor_start=program.supervisor.start,
        methods=_methods(program),
        priors=[program.prior(i).name for i in range(program.n)],
        widest=[sd.name for sd in widest(program)],
        least_seen=LEAST_SEEN,
        lanes=program.lanes,
        since_reset=program.supervisor.at("SINCE_RESET").index,
        quaternion=[discrete.nominal_names.index(n) for n in attitude.nominal_names] if attitude else [],
        errors=AlignRoutine(program).errors if program.align else [],
        reasons=REASONS,
        gathering={a: size for a, (size, _) in _lists(program).items()},
        present=program.delayed_memory.names if program.horizon else (),
        norm_error=MAX_NORM_ERROR,
        gates={s.name: g.value for s, g in zip(discrete.model.sensors, gates(discrete.model))},
        huge=MAX_SUM,
        status=STATUS,
        shortest=SHORTEST_STEP_S,
        longest=discrete.max_step,
        rows=program.rows,
        triads=program.supervisor.triads,
        given=_limits(program, longest[:-1]),
        functions=[_function(r, program.n) for r in program.pieces],
        sensors=sensors,
        inputs=_typed(longest),
        texts=[(a.name, a.text) for a in longest],
        step=_call(step),
        transition=_call(pieces["transition"].arguments),
        noise=_call(pieces["noise"].arguments),
    )
    return {f"{program.name}.py": text}
