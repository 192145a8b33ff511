"""Proves the bounds of emitted code: intervals hold every number that the precision makes, theory's relations are kept,
planted faults are found, and neither hostile calls nor the reference do what the bounds rule out.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from in_part import in_part

from kfgen.core.errors import InputError
from kfgen.emit.folder import EmittedFilter, write_folder
from kfgen.emit.ir import functions
from kfgen.emit.ir.ir import Bin, Compare, Expr, Let, Num, Ref, Routine, StatusFlag, Store, Una, When, mul
from kfgen.emit.reference import Machine
from kfgen.emit.routines import REALS, Program
from kfgen.emit.scenario import scenario, split
from kfgen.emit.targets.c import header
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.report.proof import folder_answer
from kfgen.verify.bounds.bounds import RoutineBounds, routine_bounds
from kfgen.verify.bounds.hostile import hostile_calls
from kfgen.verify.bounds.interval import RAW, Arithmetic, KnownNumber, value
from kfgen.verify.bounds.walk import Assumed, Walk

NOTHING = Assumed({}, lambda let, known, walk: None)
X, Y = Ref("x"), Ref("y")


@cache
def program(name: str, form: str = "ud", real: str = "float") -> Program:
    return Program(DiscreteModel(build(name)), form, real)


@cache
def bounded(name: str, form: str = "ud", real: str = "float") -> dict[str, RoutineBounds]:
    p = program(name, form, real)
    return {r.name: routine_bounds(p, r) for r in p.entries}


def walked(body: tuple[Any, ...], real: str = "float", **names: KnownNumber) -> Walk:
    walk = Walk(real, 1, {}, NOTHING)
    walk.memory = {"out": [value(0.0, 0.0)]}
    walk.run(Routine("tried", "", (), ()), {})
    walk.names = dict(names)
    for statement in body:
        walk._statement(statement)
    return walk


SIZES = st.floats(-1e6, 1e6, allow_nan=False, width=32)
ENDS = st.tuples(SIZES, SIZES).map(sorted)


def trees(depth: int) -> st.SearchStrategy[Expr]:
    leaf: st.SearchStrategy[Expr] = st.sampled_from([X, Y, Num(0.3), Num(-7.0), Num(1.0)])
    if not depth:
        return leaf
    below = trees(depth - 1)
    two = st.builds(Bin, st.sampled_from(["+", "-", "*", "/"]), below, below)
    one = st.builds(Una, st.sampled_from(["neg", "abs", "sign", "sqrt", "rint"]), below)
    return st.one_of(leaf, two, two, one)


@given(tree=trees(4), x=ENDS, y=ENDS, shares=st.tuples(st.floats(0, 1), st.floats(0, 1)))
@settings(max_examples=500, deadline=None)
@pytest.mark.parametrize("real", in_part(["float", "double"]))
def test_an_interval_holds_what_the_precision_makes(
    real: str, tree: Expr, x: list[float], y: list[float], shares: tuple[float, float]
) -> None:
    """Of every point of the inputs, unless an operation is told to fail."""
    walk = Walk(real, 1, {}, NOTHING)
    walk.names = {"x": value(*x), "y": value(*y)}
    bound = walk.expression(tree)
    kind = REALS[real]
    point = {n: kind(lo + s * (hi - lo)) for n, (lo, hi), s in zip("xy", (x, y), shares)}
    point = {n: min(max(v, kind(e[0])), kind(e[1])) for (n, v), e in zip(point.items(), (x, y))}
    machine = Machine.__new__(Machine)
    machine.real, machine._numbers = kind, {}
    with np.errstate(all="ignore"):
        got = float(machine._value(tree, point))
    if not walk.open:
        assert bound.lo <= got <= bound.hi


def test_a_square_is_not_negative_and_a_share_not_more_than_one() -> None:
    """``d s s``, ``(c / (d + c s s)) d``, ``v / |v|``; plain intervals know none of them."""
    a = Arithmetic("float")
    c, d, s = value(0.0, 1e10), value(1e-6, 1e4), value(-1e3, 1e3)
    weighted = a.mul(a.mul(c, s), s)
    assert weighted.lo == 0.0
    new = a.add(d, weighted)
    share = a.div(c, new)
    assert a.mul(share, d).hi <= 1.001e10
    # s c / (d + c s^2) is largest where c s^2 = d: half the root of c / d.
    assert a.mul(s, share).most == pytest.approx(0.5 * math.sqrt(1e10 / 1e-6), rel=1e-3)
    v, w = value(-1e9, 1e9), value(-1e9, 1e9)
    length = a.sqrt(a.add(a.mul(v, v), a.add(a.mul(w, w), a.number(1.0))))
    assert a.mul(v, a.div(a.number(1.0), length)).most <= 1.001
    assert a.failed == []


@pytest.mark.parametrize("size", [1.0, 50.0, 1000.0])
@pytest.mark.parametrize("function", [functions.sine, functions.cosine])
def test_the_sine_of_a_large_angle_is_bounded(
    function: Callable[[Expr, functions.Let], Expr], size: float
) -> None:
    """The series is summed of what is left of the angle, which whole turns cannot make large."""
    body: list[Let] = []

    def let(e: Expr) -> Expr:
        body.append(Let(f"t{len(body)}", e))
        return Ref(f"t{len(body) - 1}")

    result = function(X, let)
    walk = walked((*body, Let("result", result)), x=value(-size, size))
    found = walk.names["result"]
    assert isinstance(found, KnownNumber)
    assert walk.open == {}
    # Half a turn is left, and intervals of a series with signs that alternate add up: sinh of it at most.
    assert found.most < 1.2 * math.sinh(math.pi / 2 + 0.1)


OVER = Let("over", Bin("/", Num(1.0), X))


@pytest.mark.parametrize(
    ("body", "x", "what"),
    [
        ((OVER,), value(-1.0, 1.0), "divides by what may be zero"),
        ((OVER,), value(1e-40, 1.0), "overflows"),
        ((Let("root", Una("sqrt", X)),), value(-1e-30, 1.0), "takes the root of what may be negative"),
        ((Let("large", Bin("*", X, X)),), value(0.0, 1e20), "overflows"),
        ((Let("read", Bin("+", X, Num(1.0))),), RAW, "works on what nothing has looked at"),
    ],
)
def test_a_planted_fault_is_found(body: tuple[Any, ...], x: KnownNumber, what: str) -> None:
    assert {o.what for o in walked(body, x=x).open} == {what}


@pytest.mark.parametrize("condition", [Compare(">", X, Num(0.5)), Compare("<=", Num(0.5), X)])
def test_a_guard_that_stands_before_it_is_seen(condition: Compare) -> None:
    assert walked((When(condition, (OVER,)),), x=value(-1.0, 1.0)).open == {}
    within = Compare("<=", mul(X, X), Num(1e6))
    square = Let("square", Bin("*", X, X))
    assert walked((When(within, (square,), (StatusFlag("BAD_INPUT"),)),), x=RAW).open == {}
    assert len(walked((When(within, (), (square,)),), x=RAW).open) == 1


def test_after_a_branch_a_number_is_one_or_the_other() -> None:
    branch = When(
        Compare(">", X, Num(0.0)), (Store(Ref("out", 0), Num(3.0)),), (Store(Ref("out", 0), Num(-5.0)),)
    )
    walk = walked((branch,), x=value(-1.0, 1.0))
    out = walk.memory["out"]
    assert isinstance(out, list)
    assert (out[0].lo, out[0].hi) == (-5.0, 3.0)


RARE = {"hold", "fuse_held", "recentre"}
"""Routines of held states, and what takes the word of the border."""


@pytest.mark.parametrize("form", in_part(["ud", "p"]))
@pytest.mark.parametrize("name", in_part(["ahrs6", "ins15"]))
def test_what_flies_is_proven(name: str, form: str) -> None:
    """No operation of predict and updates is open, but of what held states take; all of `ahrs6` is proven but its check."""
    found = bounded(name, form)
    main = [r for n, r in found.items() if n.startswith(("predict", "update"))]
    assert len(main) == 3
    open_ = {o.routine for r in main for o in r.open}
    assert open_ <= (RARE if name == "ins15" else set())
    assert [n for n in ("init", "align", "supervise") if found[n].open] == []


@pytest.mark.parametrize("form", in_part(["ud", "p"]))
def test_in_double_precision_held_states_are_proven_too(form: str) -> None:
    found = bounded("ins15", form, "double")
    assert {
        o.routine for n, r in found.items() if n.startswith(("predict", "update")) for o in r.open
    } == set()


def test_without_its_guards_nothing_is_proven() -> None:
    """The body of a prediction whose limits are removed works on any bit pattern."""
    p = program("ahrs6")
    (outer,) = p.predict.body
    assert isinstance(outer, When)
    bare = replace(p.predict, body=outer.body[:-1] + tuple(outer.body[-1].body))  # type: ignore[union-attr]
    found = routine_bounds(p, bare)
    assert {"works on what nothing has looked at"} <= {o.what for o in found.open}


class CountingMachine(Machine):
    """The reference, counting what it does."""

    done = 0

    def _value(self, e: Expr, env: Any) -> Any:
        self.done += isinstance(e, Bin) or (isinstance(e, Una) and e.op != "neg")
        return super()._value(e, env)


@pytest.mark.parametrize("form", ["ud", "p"])
def test_no_call_does_more_than_the_longest_way(form: str) -> None:
    """Over a scenario with samples that are rejected and followed; a calm prediction does nearly all of it."""
    p = program("ahrs6", form)
    machine, most = CountingMachine(p), dict[str, int]()
    machine.call("init")
    routines = {r.name: r for r in p.entries}
    for call in scenario(p):
        machine.done = 0
        machine.call(call.routine, split(routines[call.routine], call.inputs))
        most[call.routine] = max(most.get(call.routine, 0), machine.done)
    found = bounded("ahrs6", form)
    assert {n: m for n, m in most.items() if m > found[n].operations} == {}
    assert most["predict"] > 0.9 * found["predict"].operations
    assert most["update_mag"] > 0.5 * found["update_mag"].operations


def need_compiler() -> None:
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler on this machine")


def calls(p: Program, count: int, change: Callable[[str], str] = lambda text: text) -> Any:
    need_compiler()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{p.name}.h").write_text(change(header(p)), encoding="utf-8")
        return hostile_calls(p, Path(folder), count)


MANY = [pytest.param(1_000_000, marks=pytest.mark.long), 15_000]


@pytest.mark.parametrize("count", in_part(MANY))
@pytest.mark.parametrize(
    ("form", "real"),
    in_part([("ud", "float"), ("p", "float"), pytest.param("ud", "double", marks=pytest.mark.long)]),
)
@pytest.mark.parametrize("name", in_part(["ahrs6", "ins15"]))
def test_hostile_calls_raise_no_flag(name: str, form: str, real: str, count: int) -> None:
    found = calls(program(name, form, real), count)
    assert found.calls >= 0.9 * count
    assert 0.1 < found.refused / found.calls < 0.5
    assert (found.raised, found.spoiled) == ({}, 0)
    # The ranges that are assumed are those of the filter: hardly ever a call finds a number beyond one.
    assert found.beyond <= 1e-3 * found.calls
    assert 0.0 < found.used["covariance"] < 1.0


@pytest.mark.long
@pytest.mark.parametrize("real", ["float", "double"])
@pytest.mark.parametrize("name", ["ahrs25", "ins33"])
def test_hostile_calls_of_turned_columns_and_mixed_noise_raise_no_flag(name: str, real: str) -> None:
    """Thousands of steps of 1e-42 s overflowed here."""
    found = calls(program(name, "ud", real), 1_000_000)
    assert (found.raised, found.spoiled) == ({}, 0)
    assert found.beyond <= 1e-3 * found.calls


def test_hostile_calls_find_a_removed_limit() -> None:
    """Of the gyro: its square overflows then."""

    def unlimited(text: str) -> str:
        head, tail = text.split("#define AHRS6_MAX_GYRO ")
        return f"{head}#define AHRS6_MAX_GYRO 1e19f\n{tail.split(chr(10), 1)[1]}"

    found = calls(program("ahrs6"), 30_000, unlimited)
    assert any(name.startswith("predict: overflow") for name in found.raised)


def test_rejected_samples_widen_no_state_beyond_its_range() -> None:
    """A field of 1 mT where the Earth's is seen, for long: the attitude stays below its widest."""
    p = program("ahrs6")
    machine = Machine(p)
    machine.call("init")
    for _ in range(100):
        machine.call("predict", [(0.0, 0.0, 0.0), 0.01])
        machine.call("update_mag", [(9e-4, -9e-4, 9e-4)])
    sd = np.sqrt(np.diag(machine.covariance()))
    names = [s.name for s in p.discrete.model.states]
    attitude = p.discrete.model.attitude
    assert attitude is not None
    assert max(sd[names.index(n)] for n in attitude.error_names) < 30.0


def test_the_answer_says_what_is_assumed(tmp_path: Path) -> None:
    need_compiler()
    write_folder(program("ahrs6"), "c", None, tmp_path / "c")
    answer = folder_answer(tmp_path / "c", ["host"], bounded=True)
    assert answer.ok
    assert "assumed, covariance: " in answer.text
    assert answer.data["routines"]["predict"]["open"] == []
    assert answer.data["hostile"]["raised"] == {}
    with pytest.raises(InputError, match="ask for one of both"):
        folder_answer(tmp_path / "c", ["host"], faults=True, bounded=True)
    with pytest.raises(InputError, match="the core 'z80' counts nothing"):
        folder_answer(tmp_path / "c", ["z80"], bounded=True)


def test_a_python_module_has_none(tmp_path: Path) -> None:
    write_folder(program("ahrs6"), "numpy", None, tmp_path / "py")
    with pytest.raises(InputError, match="Emit it with --target c"):
        folder_answer(tmp_path / "py", ["host"], bounded=True)


@pytest.mark.long
def test_a_core_counts_the_longest_calls(tmp_path: Path) -> None:
    """Rejected samples and held states take more than calm ones: the most is told, for every routine that was called."""
    pytest.importorskip("unicorn")
    pytest.importorskip("ziglang")
    pytest.importorskip("elftools")
    write_folder(program("ahrs6"), "c", None, tmp_path / "c")
    from kfgen.verify.bounds.bounds import bounds
    from kfgen.verify.compare import verify

    emitted = EmittedFilter(program("ahrs6"), "c", tmp_path / "c")
    hostile = bounds(emitted, ["m4f"], calls=5_000).instructions["m4f"]
    calm = verify(emitted, ["m4f"])[0].cost.instructions
    assert hostile["update_mag"] > 1.2 * calm["update_mag"]
    assert hostile["predict"] >= calm["predict"]
