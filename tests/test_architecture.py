"""The house: layers, style, types, sizes, and what must never be in it."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted((ROOT / "kfgen").rglob("*.py"))
BIN = Path(sys.executable).parent


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(BIN / words[0]), *words[1:]], cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    "words",
    [("lint-imports",), ("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",)],
    ids=" ".join,
)
def test_tool_is_content(words: tuple[str, ...]) -> None:
    done = run(*words)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_module_has_a_layer() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    layers = {p.relative_to(ROOT / "kfgen").parts[0].removesuffix(".py") for p in FILES} - {
        "__init__",
        "__main__",
    }
    assert [r for r in layers if f"kfgen.{r}" not in text] == []


def functions(tree: ast.AST) -> list[ast.FunctionDef]:
    return [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]


def test_files() -> None:
    assert {str(p.relative_to(ROOT)): said for p in FILES if (said := objections(p))} == {}


def objections(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    said = ["longer than 400 lines"] if text.count("\n") > 400 else []
    said += [] if ast.get_docstring(tree) else ["has no docstring"]
    for f in functions(tree):
        assert f.end_lineno is not None
        said += [f"{f.name} is too long"] if f.end_lineno - f.lineno > 70 else []
        documented = f.name.startswith("_") or ast.get_docstring(f) or nested(tree, f)
        said += [] if documented else [f"{f.name} has no docstring"]
    calls = {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    said += [f"calls {name}" for name in sorted(calls & {"eval", "exec", "sympify", "parse_expr"})]
    return said + (["prints"] if "print" in calls and path.parent.name != "cli" else [])


def nested(tree: ast.AST, f: ast.FunctionDef) -> bool:
    return any(f in ast.walk(g) and f is not g for g in functions(tree))


def test_no_second_allan_variance() -> None:
    """The closed forms of Allan variances stand nowhere: they follow from the declarations."""
    code = {p.name: re.sub(r'""".*?"""', "", p.read_text("utf-8"), flags=re.S) for p in FILES}
    places = {
        name for name, text in code.items() for word in ("/ tau**2", "tau / 3", "log(2)") if word in text
    }
    assert places == {"linear_system.py"}


def test_light_start() -> None:
    """The help comes up without a single heavy library."""
    script = (
        "import sys, kfgen.cli.app; "
        "print([m for m in ('numpy','scipy','sympy','control','filterpy','matplotlib','jinja2') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
