"""Words: the house speaks as the field does, and the glossary has every term it needs.

The list grows with the rooms: add a folder to `ROOMS` once its texts pass, a word to `BANNED` with what to say instead.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ROOMS = (
    "core",
    "log",
    "arma",
    "consumers",
    "manoeuvre",
    "effects/process",
    "effects/samples",
    "effects/faults",
)
"""Folders of the package whose docstrings and messages are read."""
NOT_YET = ("consumers/__init__.py", "core/tape.py", "manoeuvre/flight.py", "manoeuvre/truth.py")
"""Modules of these folders whose functions do not say yet what they take and give."""
BANNED = {
    r"\blumps?\b": "interval at which process noise is added",
    r"\b(a|the|its) play\b": "backlash",
    r"\b(?<!standard )(?<!allan )deviations?\b": "standard deviation, or Allan deviation",
    r"\bmend(ed|s|ing)?\b": "updated model; of a file: correct",
    r"\bbelieved\b": "assumed",
    r"\b(stands|stood) still\b": "stuck (of a channel), at rest (of a body)",
    r"\bturned round\b": "inverse, opposite",
    r"\b(poor|rich) (motion|excitation)\b": "little or much excitation",
    r"\bwandering\b": "driven by noise, random walk",
    r"\bpassed over\b": "skipped",
}
"""Patterns that a text must not have, and what to say instead."""
PACKAGE = sorted(p for room in ROOMS for p in (ROOT / "kfgen" / room).rglob("*.py"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
TERMS = (
    *(
        "N",
        "B",
        "K",
        "Q",
        "R",
        "sigma, tau",
        "Allan deviation",
        "Gauss-Markov process",
        "spectral line (tone)",
    ),
    *(
        "standard deviation",
        "innovation",
        "NIS",
        "NEES",
        "detection limit",
        "observable",
        "excitation",
        "p-adic rank",
    ),
    *("generic point", "considered (Schmidt) state", "P, UD", "register", "delay line", "frames", "prior"),
    *("samples after, before, at", "known effect, state effect", "effect", "driver", "backlash", "place"),
    *("world (rest, motion, plant)", "assumed model", "updated model", "omitted effect", "nat", "evidence"),
    "held-out data",
)


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Every text of a module that has a blank in it, docstrings and parts of messages, with its line."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value


def prose(path: Path) -> str:
    """A page without its blocks of code and without words in backticks or quotes."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.S)
    return re.sub(r"`[^`\n]*`|\"[^\"\n]*\"", "", text)


def found(text: str) -> list[str]:
    """The banned words of a text, each with what to say instead."""
    flat = " ".join(re.sub(r"`[^`\n]*`", "", text).split()).lower()
    return [f"{m.group()} -> {instead}" for p, instead in BANNED.items() if (m := re.search(p, flat))]


@pytest.mark.parametrize("path", PACKAGE, ids=lambda p: str(p.relative_to(ROOT / "kfgen")))
def test_texts_of_the_package(path: Path) -> None:
    assert [f"line {line}: {word}" for line, text in texts(path) for word in found(text)] == []


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.name)
def test_pages(path: Path) -> None:
    assert found(prose(path)) == []


def test_a_banned_word_is_found() -> None:
    assert found("the deviation of a lump") == [
        "lump -> interval at which process noise is added",
        "deviation -> standard deviation, or Allan deviation",
    ]
    assert found("an Allan\n    deviation beside a standard deviation") == []


def test_the_glossary_has_its_terms_once() -> None:
    text = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+?) \|", text, re.M)
    terms = [r for r in rows if r not in ("term", "---")]
    assert len(set(terms)) == len(terms)
    assert [t for t in TERMS if not any(r == t or r.startswith(f"{t} (") for r in terms)] == []


def functions(path: Path) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Public functions of a module, and methods that no base class declares, by their qualified names."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            inherited = {name for b in node.bases for name in METHODS.get(ast.unparse(b), ())}
            for part in node.body:
                if isinstance(part, ast.FunctionDef) and part.name not in inherited:
                    yield f"{node.name}.{part.name}", part


def _methods() -> dict[str, set[str]]:
    """Names of the methods of each class of the package, with those of its bases."""
    own: dict[str, set[str]] = {}
    bases: dict[str, list[str]] = {}
    for path in (ROOT / "kfgen").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                own.setdefault(node.name, set()).update(
                    p.name for p in node.body if isinstance(p, ast.FunctionDef)
                )
                bases.setdefault(node.name, []).extend(ast.unparse(b) for b in node.bases)

    def every(name: str) -> set[str]:
        return own.get(name, set()).union(*(every(b) for b in bases.get(name, ()) if b != name))

    return {name: every(name) for name in own}


METHODS = _methods()
DOCUMENTED = [p for p in PACKAGE if p.relative_to(ROOT / "kfgen").as_posix() not in NOT_YET]


@pytest.mark.parametrize("path", DOCUMENTED, ids=lambda p: str(p.relative_to(ROOT / "kfgen")))
def test_functions_say_what_they_take_and_give(path: Path) -> None:
    """A public function of two or more arguments names each under Parameters, and what it returns."""
    silent = []
    for name, f in functions(path):
        arguments = [
            a.arg
            for a in (*f.args.posonlyargs, *f.args.args, *f.args.kwonlyargs)
            if a.arg not in ("self", "cls")
        ]
        if f.name.startswith("_") or len(arguments) < 2:
            continue
        said = (ast.get_docstring(f) or "").partition("Parameters\n---")[2]
        silent += [f"{name}: {a}" for a in arguments if not re.search(rf"^(\w+, )*{a}(, \w+)* :", said, re.M)]
        if f.returns is not None and ast.unparse(f.returns) != "None" and "Returns\n---" not in said:
            silent.append(f"{name}: what it returns")
    assert silent == []


VAGUE = frozenset(
    [
        "BEHIND",
        "BESIDE",
        "BINS",
        "BLIND",
        "BLOCK",
        "CELL",
        "CELLS",
        "CHUNK",
        "CIRCLE",
        "CLOSE",
        "CLOSED",
        "COARSE",
        "DEEPEST",
        "DIGITS",
        "DRAWS",
        "ENDS",
        "ENOUGH",
        "EXACT",
        "FAR",
        "FEW",
        "FEWEST",
        "FINE",
        "FIRST",
        "GRID",
        "HALF",
        "JITTER",
        "KNOWN",
        "LAGS",
        "LARGEST",
        "LAST",
        "LEAK",
        "LEAST",
        "LEVEL",
        "LEVELS",
        "LONG",
        "LONGEST",
        "LOWER",
        "MARGIN",
        "MOST",
        "NARROW",
        "NEAR",
        "ODDS",
        "ONE",
        "OVER",
        "PLENTY",
        "PROMISING",
        "RATE",
        "RATIO",
        "REST",
        "RISEN",
        "ROUNDS",
        "SAME",
        "SEGMENTS",
        "SET",
        "SEVERAL",
        "SHARE",
        "SHORT",
        "SHORTEST",
        "SIZES",
        "SLOWEST",
        "SMALL",
        "STILL",
        "STOP",
        "STORED",
        "SURE",
        "SURELY",
        "TIMES",
        "TINY",
        "TOP",
        "TRUST",
        "UNEVEN",
        "USUAL",
        "WIDTHS",
    ]
)
"""Names of constants that say neither what is counted nor in which unit."""


@pytest.mark.parametrize("path", PACKAGE, ids=lambda p: str(p.relative_to(ROOT / "kfgen")))
def test_constants_say_their_quantity(path: Path) -> None:
    names = {
        t.id.lstrip("_")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for t in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(t, ast.Name) and t.id.isupper()
    }
    # The interface of a consumer asks for a text RATE.
    assert names & VAGUE <= ({"RATE"} if path.parent.name == "consumers" else set())
