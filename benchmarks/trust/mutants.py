"""Do the fast tests notice when a core module computes something else? Small changes of its code, one at a time.

Usage: python benchmarks/trust/mutants.py [--count 300] [--minutes 60] [--seed 0] [--only PART] [--record F] [--docs]

A change swaps a comparison, an operator, a number, `and` with `or`, `min` with `max`, or takes the opposite of a condition. What
only makes messages, annotations or names is left alone. The tests of the module run in a forked process with the changed
source; that a test fails, or that they take too long, means that the change was noticed. Survivors are printed with
their line, and with the reason where `same_answer.py` has one why no answer changes. ``--record`` keeps what was tried
in a file, a line each as it ends: a run with the same file goes on where that one ended. ``--again`` tries the survivors
of that file once more, with the tests of now; ``--docs`` writes the table into the page.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib.abc
import importlib.util
import io
import json
import os
import random
import re
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT)]

from docs_table import write_table  # noqa: E402
from same_answer import reason  # noqa: E402

LIMIT_S = 60
"""Seconds of the processor after which a change counts as noticed: it never ends."""
HAND = "tests/formulas/test_{}_by_hand.py"
EVIDENCE, PROCESSES, FIT, STEPS, CODE, ADAPTIVE = (
    HAND.format(n) for n in ("evidence", "processes", "scene_fit", "steps", "code", "adaptive")
)
CORE = "tests/test_core_formulas.py"
PARTS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "core": (("kfgen/core/linear.py", f"{EVIDENCE} {CORE} tests/test_linear.py", ""), ("kfgen/core/units.py", f"{CORE} tests/test_units.py", "")),
    "effects": (
        ("kfgen/effects/linear_system.py", f"{PROCESSES} {CORE} tests/test_effects.py", ""),
        ("kfgen/effects/process/stochastic.py", f"{PROCESSES} {CORE} tests/test_effects.py", ""),
    ),
    "identify": (
        ("kfgen/identify/evidence/whittle.py", f"{EVIDENCE} {CORE} tests/test_identify.py", "by_hand or sine_transform or ordinates_are or bound_is or information or looked_at or constant_offset or bins or band or stand_alone"),
        ("kfgen/identify/evidence/shapes.py", f"{EVIDENCE} {CORE} tests/test_identify.py", "by_hand or bound_is or information or constant_offset or shape"),
        ("kfgen/identify/evidence/allan.py", f"{EVIDENCE} {CORE} tests/test_allan.py", ""),
        ("kfgen/identify/evidence/kalman.py", f"{EVIDENCE} tests/test_kalman.py", ""),
    ),
    "gap/core": (
        ("kfgen/gap/scene/newton.py", f"{FIT} tests/test_gap_engine.py tests/test_gap_search.py", ""),
        ("kfgen/gap/core/search.py", "tests/test_gap_search.py", ""),
        ("kfgen/gap/scene/screen.py", f"{FIT} tests/test_gap_engine.py", ""),
        ("kfgen/gap/core/whitener.py", "tests/test_whitened.py tests/test_gap_engine.py", ""),
    ),
    "discretise": (("kfgen/model/discretise.py", f"{STEPS} {CORE} tests/test_discretise.py", ""),),
    "emit": (
        ("kfgen/emit/update.py", f"{CODE} {CORE} tests/test_emit.py", "by_hand or gated_by_its_length or batch_kalman and (gyro-static or ahrs6-1) or far_row or gated_sample_is_said and gyro-static or own_variance or at_its_constant"),
        ("kfgen/emit/covariance/packed.py", f"{CODE} {CORE} tests/test_budgets.py tests/test_emit.py", "by_hand or rows_are or than_three_rows or one_loop or covariance_prediction or (batch_kalman or dense_formula) and p- and (gyro-static or ahrs6-1)"),
        ("kfgen/emit/ir/lower.py", f"{CODE} tests/test_emit.py", "by_hand or dense_formula and p-False and (gyro-static or ahrs6-1)"),
    ),
    "run": (
        ("kfgen/run/adaptive/rules.py", f"{ADAPTIVE} {CORE} tests/test_adaptive.py", "by_hand or bounds or nis_returns or q_follows or knows_is_best or calm or by_chance or sage_husa"),
        ("kfgen/run/adaptive/loop.py", f"{ADAPTIVE} {CORE} tests/test_adaptive.py", "by_hand or bounds or filterpys or nis_returns or q_follows"),
    ),
}  # fmt: skip
"""Modules with the tests that are theirs, and which of them."""
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    **{
        ast.Lt: ast.LtE,
        ast.LtE: ast.Lt,
        ast.Gt: ast.GtE,
        ast.GtE: ast.Gt,
        ast.Eq: ast.NotEq,
        ast.NotEq: ast.Eq,
    },
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult},
    **{
        ast.And: ast.Or,
        ast.Or: ast.And,
        ast.In: ast.NotIn,
        ast.NotIn: ast.In,
        ast.Is: ast.IsNot,
        ast.IsNot: ast.Is,
    },
}
RENAMED = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any"}


@dataclass(frozen=True)
class Mutant:
    """A change: which node of the module's tree, in words."""

    path: str
    node: int
    line: int
    words: str


class Change(ast.NodeTransformer):
    """Counts the places of a tree where something can be changed, and changes one of them."""

    def __init__(self, wanted: int = -1) -> None:
        self.wanted, self.at = wanted, -1
        self.found: list[tuple[int, str]] = []

    def _here(self, node: ast.AST, words: str) -> bool:
        self.at += 1
        self.found.append((getattr(node, "lineno", 0), words))
        return self.at == self.wanted

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        return node  # a message

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        node.body = [self.visit(n) if isinstance(n, ast.FunctionDef | ast.ClassDef) else n for n in node.body]
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.body = [self.visit(n) for n in node.body]
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.value = self.visit(node.value) if node.value else None
        return node

    def visit_Module(self, node: ast.Module) -> ast.AST:
        node.body = [self.visit(n) if isinstance(n, ast.FunctionDef | ast.ClassDef) else n for n in node.body]
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        new = SWAPPED.get(type(node.ops[0]))
        if new and self._here(node, f"{type(node.ops[0]).__name__} -> {new.__name__}"):
            node.ops[0] = new()  # type: ignore[assignment]
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        new = SWAPPED.get(type(node.op))
        text = isinstance(node.left, ast.JoinedStr) or isinstance(node.right, ast.JoinedStr)
        if new and not text and self._here(node, f"{type(node.op).__name__} -> {new.__name__}"):
            node.op = new()  # type: ignore[assignment]
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        new = SWAPPED[type(node.op)]
        if self._here(node, f"{type(node.op).__name__} -> {new.__name__}"):
            node.op = new()  # type: ignore[assignment]
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.USub | ast.Not) and self._here(node, f"without {type(node.op).__name__}"):
            return node.operand
        return node

    def visit_If(self, node: ast.If) -> ast.AST:
        self.generic_visit(node)
        if not any(isinstance(n, ast.Raise) for n in node.body) and self._here(node, "opposite condition"):
            node.test = ast.UnaryOp(ast.Not(), node.test)
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        number = isinstance(node.value, int | float) and not isinstance(node.value, bool)
        if number and self._here(node, f"{node.value} -> {node.value + 1}"):
            return ast.copy_location(ast.Constant(node.value + 1), node)
        if isinstance(node.value, bool) and self._here(node, f"{node.value} -> {not node.value}"):
            return ast.copy_location(ast.Constant(not node.value), node)
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        name = node.func
        word = name.id if isinstance(name, ast.Name) else name.attr if isinstance(name, ast.Attribute) else ""
        if word in RENAMED and self._here(node, f"{word} -> {RENAMED[word]}"):
            if isinstance(name, ast.Name):
                name.id = RENAMED[word]
            elif isinstance(name, ast.Attribute):
                name.attr = RENAMED[word]
        return node


def mutants_of(path: str) -> list[Mutant]:
    """Every change of a module."""
    change = Change()
    change.visit(ast.parse((ROOT / path).read_text(encoding="utf-8")))
    return [Mutant(path, k, line, words) for k, (line, words) in enumerate(change.found)]


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds one module with its change in it."""

    def __init__(self, mutant: Mutant) -> None:
        self.mutant = mutant
        self.name = mutant.path.removesuffix(".py").replace("/", ".")

    def find_spec(self, fullname: str, path: object, target: object = None) -> object:
        """The changed module by its name."""
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, ROOT / self.mutant.path, loader=self)

    def create_module(self, spec: object) -> None:
        """As usual."""

    def exec_module(self, module: ModuleType) -> None:
        """Run the changed source."""
        path = ROOT / self.mutant.path
        tree = Change(self.mutant.node).visit(ast.parse(path.read_text(encoding="utf-8")))
        exec(compile(ast.fix_missing_locations(tree), str(path), "exec"), module.__dict__)


def started(mutant: Mutant | None, tests: str, which: str) -> int:
    """A forked process, kfgen not yet imported, in which the tests run with a change; it ends with 0 if they pass."""
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            import pytest

            signal.setitimer(signal.ITIMER_PROF, LIMIT_S)  # SIGPROF ends the process
            if mutant is not None:
                sys.meta_path.insert(0, Changed(mutant))
            for stream in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
            words = [str(ROOT / t) for t in tests.split() if (ROOT / t).is_file()]
            words += [
                "-q",
                "-x",
                "-p",
                "no:cacheprovider",
                "-p",
                "no:xdist",
                "-m",
                "not long",
                *(["-k", which] if which else []),
            ]
            with contextlib.redirect_stdout(io.StringIO()):
                os._exit(int(pytest.main(words)))
        os._exit(1)
    return child


def rounds(
    parts: dict[str, tuple[tuple[str, str, str], ...]], seed: int
) -> Iterator[tuple[str, Mutant, str, str]]:
    """Mutants in an order by chance, each part in turn."""
    order: dict[str, list[tuple[Mutant, str, str]]] = {}
    for part, modules in parts.items():
        each = [(m, tests, which) for path, tests, which in modules for m in mutants_of(path)]
        order[part] = random.Random(seed).sample(each, len(each))
    while any(order.values()):
        for part, left in order.items():
            if left:
                yield part, *left.pop()


@dataclass(frozen=True)
class Trial:
    """A change that was tried."""

    part: str
    path: str
    node: int
    line: int
    words: str
    is_noticed: bool

    @property
    def reason(self) -> str:
        """Why nobody can notice it; empty where it was noticed, or could be."""
        if self.is_noticed:
            return ""
        source = (ROOT / self.path).read_text(encoding="utf-8").splitlines()
        return reason(self.path, source[self.line - 1], self.words)


class Record:
    """What was tried, in a file that grows with each trial; without a path nothing is kept."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.trials: dict[tuple[str, int], Trial] = {}
        for line in path.read_text(encoding="utf-8").splitlines() if path and path.exists() else ():
            trial = Trial(**json.loads(line))
            self.trials[trial.path, trial.node] = trial

    def add(self, trial: Trial) -> None:
        """A trial that ended, the last of its change counts."""
        self.trials[trial.path, trial.node] = trial
        if self.path:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(trial)) + "\n")
        if not trial.is_noticed:
            why = trial.reason and f" ({trial.reason})"
            print(f"survives: {trial.path}:{trial.line}: {trial.words}{why}", flush=True)


def tried(order: Iterator[tuple[str, Mutant, str, str]], jobs: int, minutes: float, record: Record) -> None:
    """Try what is not in the record."""
    until, running = time.monotonic() + 60.0 * minutes, {}
    left = (one for one in order if (one[1].path, one[1].node) not in record.trials)
    while True:
        while len(running) < jobs and time.monotonic() < until and (one := next(left, None)):
            running[started(*one[1:])] = one
        if not running:
            return
        child, status = os.wait()
        part, mutant, _, _ = running.pop(child)
        record.add(Trial(part, **vars(mutant), is_noticed=status != 0))


def again(record: Record) -> None:
    """Survivors without a reason, tried with the tests of now."""
    for trial in [t for t in record.trials.values() if not (t.is_noticed or t.reason)]:
        ((_, tests, which),) = (m for m in PARTS[trial.part] if m[0] == trial.path)
        mutant = Mutant(trial.path, trial.node, trial.line, trial.words)
        record.add(replace(trial, is_noticed=os.waitpid(started(mutant, tests, which), 0)[1] != 0))


ROW = re.compile(r"\| ([^|]+) \| (\d+) \| (\d+) \| (\d+) \(\d+ %\) \| (\d+) \| \d+ \|")


def table(trials: list[Trial], of: dict[str, int], page: str = "") -> str:
    """Markdown: by part how many were tried, noticed, and have a reason why they cannot be; other parts as a page has them."""
    rows = [
        "| part | changes possible | tried | noticed by the fast tests | change no answer | neither |",
        "|---|---|---|---|---|---|",
    ]
    counts = {name: [int(n) for n in numbers] for name, *numbers in ROW.findall(page) if name in PARTS}
    for part in dict.fromkeys(t.part for t in trials):
        own = [t for t in trials if t.part == part]
        counts[part] = [of[part], len(own), sum(t.is_noticed for t in own), sum(bool(t.reason) for t in own)]
    counts = {part: counts[part] for part in PARTS if part in counts}
    counts["all"] = [sum(column) for column in zip(*counts.values(), strict=True)]
    for part, (possible, count, noticed, same) in counts.items():
        share = f"{100 * noticed / max(count, 1):.0f} %"
        rows.append(
            f"| {part} | {possible} | {count} | {noticed} ({share}) | {same} | {count - noticed - same} |"
        )
    return "\n".join(rows)


def main() -> int:
    """Try changes until there are enough, or the time is over."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", default="", help="one part")
    parser.add_argument("--record", type=Path, help="file that keeps what was tried")
    parser.add_argument("--again", action="store_true", help="try the survivors of the record once more")
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    os.chdir(ROOT)
    parts = {p: m for p, m in PARTS.items() if not given.only or p == given.only}
    of = {p: sum(len(mutants_of(path)) for path, _, _ in m) for p, m in parts.items()}
    for heavy in (
        "numpy",
        "scipy.stats",
        "scipy.optimize",
        "scipy.signal",
        "sympy",
        "hypothesis",
        "pytest",
        "filterpy.kalman",
        "typer.testing",
    ):
        importlib.import_module(heavy)
    record = Record(given.record)
    if given.again:
        again(record)
        return shown(record, of, given.docs)
    for modules in parts.values():
        for path, tests, which in modules:
            if os.waitpid(started(None, tests, which), 0)[1]:
                print(f"the tests of {path} fail without a change: {tests} -k '{which}'", flush=True)
                return 2
    tried(islice(rounds(parts, given.seed), given.count), given.jobs, given.minutes, record)
    return shown(record, of, given.docs)


def shown(record: Record, of: dict[str, int], is_for_docs: bool) -> int:
    """Print the table, and write it into the page where that is wanted: its rows of parts that were not tried stay."""
    trials = list(record.trials.values())
    print(table(trials, of))
    if is_for_docs:
        page = (ROOT / "docs/trust.md").read_text(encoding="utf-8").partition("<!-- table mutants -->")[2]
        write_table("trust.md", "mutants", table(trials, of, page.partition("<!-- end mutants -->")[0]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
