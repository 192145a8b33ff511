"""Words: the house speaks as the field does, and the glossary has every term it needs.

Words that were mended stay away from every text, name and file name: `BANNED` and `BANNED_NAMES` say what is said instead,
`ALLOWED` where another sense of a word is right. `FOLDERS` are the folders whose functions say what they take and give.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (
    "core",
    "log",
    "arma",
    "consumers",
    "manoeuvre",
    "effects/process",
    "effects/samples",
    "effects/faults",
)
"""Folders of the package whose public functions say what they take and give."""
BANNED = {
    r"\blump(s|ed)?\b": "interval at which process noise is added",
    r"\bplays?\b": "backlash; of a temperature: hysteresis",
    r"(?<!standard )(?<!allan )\bdeviations?\b": "standard deviation, or Allan deviation",
    r"\bmend(ed|s|ing)?\b": "updated model; of a file: correct",
    r"\bbeliev(e|es|ed|ing)\b": "assumed",
    r"\blattices?\b": "ADC grid, or grid",
    r"\bfreed\b": "observable, orthogonal part",
    r"\b(sought|foretold)\b": "looked for, predicted",
    r"\bodd\b": "unusual, invalid",
    r"\btaken (out|off|away|up)\b": "removed, subtracted, used up",
    r"\b(told|tells?) (\w+ )?apart\b": "distinguished, distinguishes",
    r"\btold from\b": "distinguished from",
    r"\b(lies?|stands?|kept|keeps) apart\b": "outlying, separate",
    r"\ba lead\b": "time advance",
    r"\b(every|each) room\b": "layer",
    r"\b(stands?|stood|standing) still\b": "stuck (of a channel), at rest (of a body)",
    r"\bturned round\b": "inverse, opposite",
    r"\b(poor|rich) (motion|excitation)\b": "little or much excitation",
    r"\bwandering\b": "driven by noise, random walk",
    r"\bpassed over\b": "skipped",
}
"""Patterns that a text must not have, and what to say instead."""
BANNED_NAMES = {
    **dict.fromkeys(("believed", "believes", "believe"), "assumed"),
    **dict.fromkeys(("play", "plays"), "backlash, hysteresis, calls"),
    **dict.fromkeys(("lattice", "lattices"), "adc_step, grid"),
    **dict.fromkeys(("lump", "lumps", "lumped"), "q_interval"),
    **dict.fromkeys(("mend", "mends", "mended"), "updated, corrected, interpolated"),
    **dict.fromkeys(("apart", "told", "foretold"), "distinct, outlying, distinguishable, predicted"),
    **dict.fromkeys(("odd", "oddity", "oddities"), "invalid, irregular"),
    **dict.fromkeys(
        ("freed", "sought", "taken", "lead", "wandering"), "what the thing is, in a word of the field"
    ),
}
"""Words of which no name in code and no file name is made, and what to say instead."""
ALLOWED = {
    ("docs/glossary.md", "believed"): "the entry that explains messages of older versions",
    ("docs/glossary.md", "mended"): "the entry that explains messages of older versions",
    ("benchmarks/gap/motion.py", "odd"): "odd numbers",
    ("kfgen/emit/ir/functions.py", "odd"): "odd multiples of a quarter turn",
    ("kfgen/effects/process/telegraph.py", "odd"): "an odd number of jumps",
    ("kfgen/audit/result.py", "freed_by"): "a key of the JSON, of `Direction` too",
    ("tests/test_audit.py", "freed_by"): "that key",
    ("examples/free_the_heading.py", "freed_by"): "that key",
}
"""Words in another sense, or that others rely on, by file, each with the reason."""
PACKAGE = sorted(p for folder in FOLDERS for p in (ROOT / "kfgen" / folder).rglob("*.py"))
CODE = sorted(
    p
    for folder in ("kfgen", "tests", "benchmarks", "examples", "tools")
    for p in (ROOT / folder).rglob("*.py")
    if p != Path(__file__).resolve()
)
PAGES = [
    *(ROOT / n for n in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "templates").rglob("*.j2")),
]
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


def name_of(path: Path) -> str:
    """A file by its path in the repository."""
    return path.relative_to(ROOT).as_posix()


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Every text of a module that has a blank in it: docstrings, parts of messages, comments in a row; with its line."""
    source = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value
    comments = [t for t in tokens(source) if t.type == tokenize.COMMENT]
    for _, row in groupby(enumerate(comments), lambda c: c[1].start[0] - c[0]):
        said = [t for _, t in row]
        yield said[0].start[0], " ".join(t.string.lstrip("# ") for t in said)


def tokens(source: str) -> Iterator[tokenize.TokenInfo]:
    """The tokens of a module."""
    return tokenize.generate_tokens(io.StringIO(source).readline)


def prose(path: Path) -> str:
    """A page without its blocks of code and without words in backticks or quotes."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.S)
    return re.sub(r"`[^`\n]*`|\"[^\"\n]*\"", "", text)


def found(text: str, where: str = "") -> list[str]:
    """The banned words of a text, each with what to say instead; names in backticks and of parameters are no words."""
    text = re.sub(r"`[^`\n]*`|^ *\w+(, \w+)* : ", "", text, flags=re.M)
    flat = " ".join(text.split()).lower()
    matches = ((re.search(p, flat), instead) for p, instead in BANNED.items())
    return [f"{m.group()} -> {i}" for m, i in matches if m and (where, m.group()) not in ALLOWED]


def words_in(name: str) -> set[str]:
    """The words that a name is made of."""
    return set(re.split(r"[_.\W]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()))


def banned_in(names: Iterable[str], where: str) -> list[str]:
    """The names that are made of banned words, each with what to say instead."""
    wrong = ((n, w) for n in sorted(set(names)) if (where, n) not in ALLOWED for w in sorted(words_in(n)))
    return [f"{n} -> {BANNED_NAMES[w]}" for n, w in wrong if w in BANNED_NAMES]


def test_texts_of_the_code() -> None:
    assert [
        f"{where}, line {line}: {word}"
        for path in CODE
        for where in [name_of(path)]
        for line, text in texts(path)
        for word in found(text, where)
    ] == []


def test_names_of_the_code() -> None:
    """Names that it uses, those of other modules too, and its own."""
    wrong = {}
    for path in CODE:
        where = name_of(path)
        names = [t.string for t in tokens(path.read_text(encoding="utf-8")) if t.type == tokenize.NAME]
        wrong[where] = banned_in([*names, where], where)
    assert {where: words for where, words in wrong.items() if words} == {}


def test_pages() -> None:
    wrong = {
        where: [*found(prose(p), where), *banned_in([where], where)] for p in PAGES for where in [name_of(p)]
    }
    assert {where: words for where, words in wrong.items() if words} == {}


def test_a_banned_word_is_found() -> None:
    assert found("the deviation of a lump") == [
        "lump -> interval at which process noise is added",
        "deviation -> standard deviation, or Allan deviation",
    ]
    assert found("an Allan\n    deviation beside a standard deviation") == []
    assert banned_in(["told_apart", "replay", "OddSamples"], "") == [
        "OddSamples -> invalid, irregular",
        *["told_apart -> distinct, outlying, distinguishable, predicted"] * 2,
    ]


def test_what_is_allowed_is_still_there() -> None:
    assert [(f, w) for f, w in ALLOWED if w not in (ROOT / f).read_text(encoding="utf-8")] == []


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
            inherited = {name for b in node.bases for name in _methods().get(ast.unparse(b), ())}
            for part in node.body:
                if isinstance(part, ast.FunctionDef) and part.name not in inherited:
                    yield f"{node.name}.{part.name}", part


@cache
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


def test_functions_say_what_they_take_and_give() -> None:
    """A public function of two or more arguments names each under Parameters, and what it returns."""
    silent = []
    for path, name, f in ((name_of(p), *of) for p in PACKAGE for of in functions(p)):
        arguments = [
            a.arg
            for a in (*f.args.posonlyargs, *f.args.args, *f.args.kwonlyargs)
            if a.arg not in ("self", "cls")
        ]
        if f.name.startswith("_") or len(arguments) < 2:
            continue
        said = (ast.get_docstring(f) or "").partition("Parameters\n---")[2]
        silent += [
            f"{path}: {name}: {a}" for a in arguments if not re.search(rf"^(\w+, )*{a}(, \w+)* :", said, re.M)
        ]
        if f.returns is not None and ast.unparse(f.returns) != "None" and "Returns\n---" not in said:
            silent.append(f"{path}: {name}: what it returns")
    assert silent == []


MAX_WORDS_OUT_OF_PLACE = 12
"""Words of a text that a module of mathematics may have beside its errors and its docstrings."""
SAYING = sorted(
    p
    for f in (
        *("identify/evidence", "identify/screening", "identify/fit", "calibrate", "run/adaptive", "gap/rest"),
        *("gap/core", "gap/plant", "simulate", "arma"),
    )
    for p in (ROOT / "kfgen" / f).glob("*.py")
    if p.name != "words.py"
)
"""Modules of mathematics in rooms whose sentences stand in one file."""


def sentences(path: Path) -> list[str]:
    """Long texts of a module that are neither of errors nor docstrings."""
    tree, elsewhere, out = ast.parse(path.read_text(encoding="utf-8")), set[int](), []
    for node in ast.walk(tree):
        error = isinstance(node, ast.Call) and ast.unparse(node.func) == "InputError"
        docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node, ast.Raise) or error or docstring:
            elsewhere |= {id(n) for n in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            elsewhere |= {id(n) for n in node.values}
        parts = node.values if isinstance(node, ast.JoinedStr) else [node]
        said = "".join(str(p.value) if isinstance(p, ast.Constant) else "#" for p in parts)
        if isinstance(node, ast.JoinedStr | ast.Constant) and id(node) not in elsewhere:
            out += [said] if len(said.split()) > MAX_WORDS_OUT_OF_PLACE else []
    return out


def test_sentences_stand_in_one_place_of_a_room() -> None:
    """In its `words`, not between formulas."""
    assert {name_of(path): out for path in SAYING if (out := sentences(path))} == {}


def test_a_sentence_out_of_place_is_found(tmp_path: Path) -> None:
    text = " ".join(["word"] * (MAX_WORDS_OUT_OF_PLACE + 1))
    module = tmp_path / "m.py"
    module.write_text(
        f'"""{text}"""\nx = f"{text} {{1}}"\ny = "short"\n\ndef f():\n    raise ValueError("{text}")\n'
    )
    assert sentences(module) == [f"{text} #"]


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


def test_constants_say_their_quantity() -> None:
    vague = {}
    for path in PACKAGE:
        names = {
            t.id.lstrip("_")
            for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.Assign | ast.AnnAssign)
            for t in (node.targets if isinstance(node, ast.Assign) else [node.target])
            if isinstance(t, ast.Name) and t.id.isupper()
        }
        # The interface of a consumer asks for a text RATE.
        vague[name_of(path)] = names & VAGUE - ({"RATE"} if "consumers" in path.parts else set())
    assert {where: names for where, names in vague.items() if names} == {}
