"""The README's console session and the examples run, and say what the README shows.

Numbers may differ in their last digits between machines: they are compared by their first two.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def session() -> list[tuple[str, list[str]]]:
    """Commands of the README in order, each with the lines that it shows."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found: list[tuple[str, list[str]]] = []
    for block in re.findall(r"```console\n(.*?)```", text, re.S):
        for line in block.splitlines():
            if line.startswith("$ "):
                found.append((line[2:], []))
            else:
                found[-1][1].append(line)
    return found


def shape(line: str) -> str:
    """A line with its spaces folded and its numbers masked."""
    return NUMBER.sub("#", " ".join(line.split()))


def close(a: str, b: str) -> bool:
    """Whether the numbers of two lines of the same shape agree to about two digits."""
    pairs = zip(NUMBER.findall(a), NUMBER.findall(b), strict=True)
    return all(abs(float(x) - float(y)) <= 0.03 * max(abs(float(x)), abs(float(y))) for x, y in pairs)


def test_console_session(tmp_path: Path) -> None:
    commands = session()
    assert len(commands) >= 8
    for command, shown in commands:
        words = [sys.executable, "-m", *command.split()]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        printed = done.stdout.splitlines()
        for line in shown:
            if "..." in line:
                continue
            alike = [p for p in printed if shape(p) == shape(line)]
            assert alike, f"{command} no longer prints: {line}"
            assert any(close(p, line) for p in alike), f"{command}: {line} has become {alike}"


@pytest.mark.parametrize("example", sorted(p.name for p in (ROOT / "examples").glob("*.py")))
def test_example_runs(example: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / example],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env=dict(os.environ),
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    if example == "gallery.py":
        shown = [
            line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if " | " in line
        ]
        for row in (line for line in done.stdout.splitlines() if line.startswith("|")):
            alike = [line for line in shown if shape(line) == shape(row)]
            assert any(close(line, row) for line in alike), f"the gallery no longer shows {row}"
    assert len((ROOT / "examples" / example).read_text(encoding="utf-8").splitlines()) <= 70


def test_no_machine_path_in_the_tree() -> None:
    """No registry host, no path of a machine stands in a file of the project."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False).stdout
    bad = re.compile("pypi" + r"\.org|python" + "hosted|/wo" + "rk/|/ro" + "ot/")
    files = [ROOT / f for f in listed.splitlines() if not f.endswith((".svg", ".png"))]
    wrong = [
        f.name for f in files if f.is_file() and bad.search(f.read_text(encoding="utf-8", errors="ignore"))
    ]
    assert wrong == []
