"""Hooks for firmware with several filters, its lanes: numbers by which to choose one, and what hands one over.

No policy is in them. `lane_health` writes how well the samples of each sensor fit (accepted or rejected, as a mean of
``y' S^-1 y`` over the squared gate), the age of the newest accepted sample, and the variances over those of the priors.
`take_over` gives a filter state and covariance of another one. What moves an estimate at once is told: by a hand-over,
and by the samples within `SETTLE_TIME` of a reset. Positions and velocities add up, turns multiply in navigation
axes, ``q = q_told x q_before``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kfgen.emit.check import MAX_NORM_ERROR
from kfgen.emit.covariance.joint import NIS
from kfgen.emit.covariance.packed import place
from kfgen.emit.guards import every, sensible, sum_of_squares
from kfgen.emit.ir.ir import (
    Argument,
    Bin,
    Compare,
    Expr,
    For,
    FunctionCall,
    Let,
    Num,
    Ref,
    Routine,
    Scratch,
    StatusFlag,
    Stmt,
    Store,
    When,
    add,
    mul,
    sub,
)
from kfgen.emit.targets.names import identifier
from kfgen.model.filter import FilterModel
from kfgen.model.parts.sensors import Sensor

if TYPE_CHECKING:
    from kfgen.emit.routines import Program
    from kfgen.emit.watch.supervisor import Supervisor

HEALTH, TAKE_OVER, TELL, VARIANCES = "lane_health", "take_over", "tell_jump", "lane_variances"
BEFORE, OUT, OTHER_X, OTHER_P = "before", "lane_var", "other_x", "other_cov"
MOST_GATES = 100.0
"""Squared gates that a sample counts for at most: one that is far off must not hide all that come after it."""
HEALTH_TEXT = (
    "How well this lane fits, for who has several: LANE_RATIO_... of each sensor, and LANE_RATIO, LANE_AGE, LANE_SHARE "
    "of the filter. The status is that of supervise."
)
TAKE_OVER_TEXT = (
    "State and stored covariance of another lane of the same filter; what that moves is told in JUMP_... BAD_INPUT, and "
    "nothing is taken, where they are no numbers, the quaternion is not of unit length, or a variance is not positive."
)


def jumping(model: FilterModel) -> tuple[str, ...]:
    """Stored components whose jumps are told: position, velocity, attitude."""
    names = [n for b in model.blocks if b.name in ("p", "v") for n in b.nominal_names]
    return (*names, *(model.attitude.nominal_names if model.attitude else ()))


def places(model: FilterModel) -> tuple[tuple[str, str], ...]:
    """Numbers of the supervisor that this takes."""
    words = [identifier(s.name).upper() for s in model.sensors]
    return (
        *(
            (f"TESTED_{w}", f"lanes: mean squared innovation of {w.lower()}, rejected samples too")
            for w in words
        ),
        *((f"LANE_RATIO_{w}", f"lanes: that over the squared gate, {w.lower()}") for w in words),
        ("LANE_RATIO", "lanes: the largest of them"),
        ("LANE_AGE", "lanes: since a sample of any sensor was accepted [s]"),
        ("LANE_SHARE", "lanes: mean of the variances over those of the priors"),
        *(
            (f"JUMP_{n.upper()}", f"lanes: what resets and hand-overs moved {n} by, since init")
            for n in jumping(model)
        ),
    )


def tested(program: Program, sensor: Sensor, gate: Expr) -> list[Stmt]:
    """A sample of a sensor came to its gate."""
    if not program.lanes:
        return []
    mean, weight = program.supervisor.at("TESTED", sensor.name), program.setting("NIS_WEIGHT")
    most = mul(Num(MOST_GATES), gate)
    grown = Store(mean, add(mean, mul(weight, sub(NIS, mean))))
    return [When(Compare("<=", NIS, most), (grown,), (Store(mean, add(mean, mul(weight, sub(most, mean)))),))]


def settling(program: Program) -> Compare:
    """A reset is so young that what samples move is told."""
    return Compare("<", program.supervisor.at("SINCE_RESET"), program.setting("SETTLE_TIME"))


def kept(program: Program) -> list[Stmt]:
    """The components that jump, before a correction."""
    names = program.discrete.nominal_names
    where = [names.index(n) for n in jumping(program.discrete.model)]
    return (
        [When(settling(program), tuple(Store(Ref(BEFORE, i), Ref("x", i)) for i in where))]
        if program.lanes
        else []
    )


def jumped(program: Program) -> list[Stmt]:
    """What a correction moved, after it."""
    return [When(settling(program), (FunctionCall(TELL, (Ref(BEFORE),)),))] if program.lanes else []


def scratch(program: Program) -> tuple[Scratch, ...]:
    """Of an update: the stored state before it."""
    return (Scratch(BEFORE, len(program.discrete.nominal_names)),) if program.lanes else ()


def internals(program: Program) -> tuple[Routine, ...]:
    """What tells a jump, and the variances of all states."""
    return (_tell(program), _variances(program)) if program.lanes else ()


def routines(program: Program) -> tuple[Routine, ...]:
    """What firmware calls."""
    return (_health(program), _take_over(program)) if program.lanes else ()


def _tell(program: Program) -> Routine:
    model, names = program.discrete.model, list(program.discrete.nominal_names)
    at = program.supervisor.number
    attitude = model.attitude.nominal_names if model.attitude else ()
    body: list[Stmt] = []
    for n in jumping(model):
        if n not in attitude:
            i, jump = names.index(n), at(f"JUMP_{n.upper()}")
            body.append(Store(jump, add(jump, sub(Ref("x", i), Ref(BEFORE, i)))))
    if attitude:
        q = [Ref("x", names.index(n)) for n in attitude]
        o = [Ref(BEFORE, names.index(n)) for n in attitude]
        back: list[Expr] = [o[0], *(sub(Num(0.0), c) for c in o[1:])]
        body += [Let(f"turn_{k}", e) for k, e in enumerate(product(q, back))]
        stored = [at(f"JUMP_{n.upper()}") for n in attitude]
        body += [
            Let(f"jump_{k}", e) for k, e in enumerate(product([Ref(f"turn_{k}") for k in range(4)], stored))
        ]
        body += [Store(j, Ref(f"jump_{k}")) for k, j in enumerate(stored)]
    given = Argument(BEFORE, len(names), "stored state before it")
    return Routine(TELL, "What moved the estimate at once is told.", (given,), tuple(body), internal=True)


def product(a: list[Ref] | list[Expr], b: list[Ref] | list[Expr]) -> list[Expr]:
    """The quaternion product, scalar first."""
    table = (((0, 0, 1), (1, 1, -1), (2, 2, -1), (3, 3, -1)), ((0, 1, 1), (1, 0, 1), (2, 3, 1), (3, 2, -1)),
             ((0, 2, 1), (1, 3, -1), (2, 0, 1), (3, 1, 1)), ((0, 3, 1), (1, 2, 1), (2, 1, -1), (3, 0, 1)))  # fmt: skip
    out: list[Expr] = []
    for row in table:
        total: Expr = Num(0.0)
        for i, j, sign in row:
            total = (add if sign > 0 else sub)(total, mul(a[i], b[j]))
        out.append(total)
    return out


def _variances(program: Program) -> Routine:
    """Of each state: the diagonal of P, or of U D U'."""
    form, n = program.covariance, program.n
    body: list[Stmt] = []
    for i, s in enumerate(form.order):
        body.append(Store(Ref(OUT, s), Ref(form.ARRAY, (i, i))))
        if form.NAME == "ud" and i + 1 < n:
            u = Ref(form.ARRAY, (i, "j"))
            more = mul(mul(u, u), Ref(form.ARRAY, ("j", "j")))
            body.append(For("j", i + 1, n, (Store(Ref(OUT, s), add(Ref(OUT, s), more)),)))
    given = Argument(OUT, n, "variances of the states")
    return Routine(VARIANCES, "The variances of all states.", (given,), tuple(body), internal=True)


def _health(program: Program) -> Routine:
    watch: Supervisor = program.supervisor
    lower = program.lowering()
    ratio, age, share = (watch.number(f"LANE_{n}") for n in ("RATIO", "AGE", "SHARE"))
    first = watch.at("AGE", watch.sensors[0])
    body: list[Stmt] = [Store(ratio, Num(0.0)), Store(age, first), Store(share, Num(0.0))]
    for s in program.discrete.model.sensors:
        gate, own, newest = (
            lower.places[f"gate_{s.name}"],
            watch.at("LANE_RATIO", s.name),
            watch.at("AGE", s.name),
        )
        positive = Compare(">", gate, Num(0.0))
        quotient = Bin("/", Bin("/", watch.at("TESTED", s.name), gate), gate)
        body.append(When(positive, (Store(own, quotient),), (Store(own, Num(MOST_GATES)),)))
        body.append(When(Compare(">", own, ratio), (Store(ratio, own),)))
        body.append(When(Compare("<", newest, age), (Store(age, newest),)))
    known = [i for i in range(program.n) if program.prior(i).value > 0.0]
    body.append(FunctionCall(VARIANCES, (Ref(OUT),)))
    for i in known:
        prior = program.prior(i)
        body.append(Store(share, add(share, Bin("/", Ref(OUT, i), mul(prior, prior)))))
    body.append(Store(share, mul(share, Num(1.0 / max(len(known), 1)))))
    body.append(FunctionCall("supervise", (), True))
    return Routine(HEALTH, HEALTH_TEXT, (), tuple(body), (Scratch(OUT, program.n),))


def _take_over(program: Program) -> Routine:
    names, form = list(program.discrete.nominal_names), program.covariance
    x = Argument(OTHER_X, len(names), "stored state of the other lane")
    P = Argument(OTHER_P, form.size, f"its {form.TITLE}")
    body: list[Stmt] = [
        For(
            "i",
            0,
            len(names),
            (Store(Ref(BEFORE, "i"), Ref("x", "i")), Store(Ref("x", "i"), Ref(OTHER_X, "i"))),
        ),
        For("i", 0, form.size, (Store(Ref(form.ARRAY, "i"), Ref(OTHER_P, "i")),)),
        FunctionCall(TELL, (Ref(BEFORE),)),
        *handed(program.supervisor),
    ]
    looked = [Compare(">", Ref(OTHER_P, place(program.n, i, i)), Num(0.0)) for i in range(program.n)]
    attitude = program.discrete.model.attitude
    if attitude:
        square = sum_of_squares([Ref(OTHER_X, names.index(n)) for n in attitude.nominal_names])
        low, high = (Num(1.0 + s * MAX_NORM_ERROR) for s in (-1.0, 1.0))
        looked += [Compare(">=", square, low), Compare("<=", square, high)]
    bad = (StatusFlag("BAD_INPUT"),)
    inner = When(every(looked), tuple(body), bad)
    numbers = [*(sensible([Ref(OTHER_X, i) for i in range(len(names))]),)] if names else []
    stored = sensible([Ref(OTHER_P, i) for i in range(form.size)])
    outer = inner
    for condition in (stored, *numbers):
        outer = When(condition, (outer,), bad)
    return Routine(TAKE_OVER, TAKE_OVER_TEXT, (x, P), (outer,), (Scratch(BEFORE, len(names)),))


def handed(watch: Supervisor) -> list[Stmt]:
    """What the supervisor makes of a state that is not its own: a reset, with nothing rejected yet."""
    resets = watch.at("RESETS")
    begin = [
        Store(watch.at(q, s), Num(0.0)) for s in watch.sensors for q in ("REJECTED", "MEAN_NIS", "TESTED")
    ]
    return [*begin, Store(watch.at("SINCE_RESET"), Num(0.0)), Store(resets, add(resets, Num(1.0)))]
