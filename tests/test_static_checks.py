"""Proves that compilers and sanitizers have nothing to say of the emitted C, and that they would say it.

The whole library in both forms and precisions is `benchmarks/static_checks.py`, whose table stands in `docs/emit.md`.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from pathlib import Path

import pytest
from in_part import in_part

from kfgen.emit.routines import Program
from kfgen.emit.targets.c import header
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.verify.bounds.hostile import write_hostile
from kfgen.verify.host import LANGUAGES, WARNINGS
from kfgen.verify.zig import command, environment

SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
CASES = [
    pytest.param("ahrs6", "ud", "float"),
    pytest.param("ins15", "ud", "double", marks=pytest.mark.long),
    pytest.param("ins15", "p", "float", marks=pytest.mark.long),
]


def written(name: str, form: str, real: str, folder: Path) -> Program:
    program = Program(DiscreteModel(build(name)), form, real)
    (folder / f"{program.name}.h").write_text(header(program), encoding="utf-8")
    write_hostile(program, folder)
    return program


@pytest.mark.parametrize(("name", "form", "real"), in_part(CASES))
@pytest.mark.parametrize("language", in_part(LANGUAGES))
def test_clang_warns_of_nothing(language: str, name: str, form: str, real: str, tmp_path: Path) -> None:
    """Conversions, signs, promotions, shadows and old casts; an enumeration that becomes an `int` is said."""
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("ziglang is not installed (pip install 'kfgen[pil]')")
    program = written(name, form, real, tmp_path)
    chosen = LANGUAGES[language]
    call = [*command(chosen.zig), *chosen.flags, *WARNINGS, "-O0", "-c"]
    call += [str(tmp_path / "harness.c"), "-o", str(tmp_path / "harness.o")]
    done = subprocess.run(call, capture_output=True, text=True, check=False, env=environment())
    assert done.returncode == 0, done.stderr[:2000]
    path = tmp_path / f"{program.name}.h"
    spoiled = path.read_text(encoding="utf-8").replace("KF_CAST(int, i)", "i")
    if language == "host":
        path.write_text(spoiled, encoding="utf-8")
        assert subprocess.run(call, capture_output=True, check=False, env=environment()).returncode != 0


def ran(folder: Path) -> subprocess.CompletedProcess[str]:
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    program = folder / "hostile"
    call = ["gcc", "-std=c99", "-g", "-O1", *SANITIZERS, "-DHOSTILE_MAIN=50", str(folder / "hostile.c")]
    made = subprocess.run([*call, "-o", str(program), "-lm"], capture_output=True, text=True, check=False)
    if "cannot find" in made.stderr:
        pytest.skip("the libraries of the sanitizers are not installed")
    assert made.returncode == 0, made.stderr[:2000]
    return subprocess.run([str(program)], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("name", "form", "real"), CASES)
def test_sanitizers_find_nothing_in_hostile_calls(name: str, form: str, real: str, tmp_path: Path) -> None:
    written(name, form, real, tmp_path)
    done = ran(tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.long
def test_sanitizers_find_a_call_beyond_the_table(tmp_path: Path) -> None:
    written("ahrs6", "ud", "float", tmp_path)
    path = tmp_path / "hostile.c"
    text = path.read_text(encoding="utf-8")
    assert text.count("% CALLS]") == 1
    path.write_text(text.replace("% CALLS]", "% (CALLS + 5)]"), encoding="utf-8")
    done = ran(tmp_path)
    assert done.returncode != 0
    assert "runtime error: index" in done.stderr or "AddressSanitizer" in done.stderr
