"""The console sessions of the README and of the pages in docs run and print what is shown; so do the examples.

Numbers may differ in their last digits between machines: they are compared by their first two. All sessions share one
folder: the README's comes first, and its files are those that the pages speak of.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import kfgen
from kfgen.demo import write_logs
from kfgen.effects.noise_model import parse_noise
from kfgen.manoeuvre.file import parse_manoeuvre
from kfgen.model.filter_file import parse_filter
from kfgen.model.plant.file import parse_model

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
VERBS = ("read_log", "identify", "build", "emit", "find_gap")


def has_verbs() -> bool:
    """Whether the package has the verbs that the README's Python calls."""
    try:
        return all(callable(getattr(kfgen, verb, None)) for verb in VERBS)
    except ImportError:
        return False


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a page in a language, in order."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.S)


def session(pages: list[Path]) -> list[tuple[str, list[str]]]:
    """Commands of pages in order, each with the lines that are shown of it."""
    found: list[tuple[str, list[str]]] = []
    for page in pages:
        for line in "".join(blocks(page, "console")).splitlines():
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


@pytest.mark.parametrize(
    ("pages", "least"),
    [(PAGES[:1], 4), pytest.param(PAGES, 12, marks=pytest.mark.long)],
    ids=["readme", "all"],
)
def test_console_sessions(pages: list[Path], least: int, tmp_path: Path) -> None:
    commands = session(pages)
    assert len(commands) >= least
    printed: dict[str, list[str]] = {}
    for command, shown in commands:
        if command not in printed:
            words = [sys.executable, "-m", *command.split()]
            done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{command}: {done.stderr}"
            printed[command] = done.stdout.splitlines()
        for line in shown:
            if "..." in line:
                continue
            alike = [p for p in printed[command] if shape(p) == shape(line)]
            assert alike, f"{command} no longer prints: {line}"
            assert any(close(p, line) for p in alike), f"{command}: {line} has become {alike}"


@pytest.mark.skipif(not has_verbs(), reason="the verbs of kfgen are not all there")
def test_python_of_the_readme(tmp_path: Path) -> None:
    write_logs(tmp_path / "out")
    for code in blocks(ROOT / "README.md", "python"):
        assert code.count("\n") <= 12
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert "temperature" in done.stdout


FORMATS = {
    "kfgen-noise-1": parse_noise,
    "kfgen-model-1": parse_model,
    "kfgen-filter-1": parse_filter,
    "kfgen-manoeuvre-1": parse_manoeuvre,
}


def test_files_that_are_shown_are_read() -> None:
    """The page of file formats shows one file of each, and its reader takes it."""
    shown = blocks(ROOT / "docs/files.md", "toml")
    formats = [str(tomllib.loads(text)["format"]) for text in shown]
    assert sorted(formats) == sorted(FORMATS)
    for name, text in zip(formats, shown, strict=True):
        assert FORMATS[name](text, "docs/files.md") is not None


def test_pages_are_short_and_their_links_resolve() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert readme.count("\n") <= 150
    for page in [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]:
        text = page.read_text(encoding="utf-8")
        for link in re.findall(r"\]\((?!http)([^)#]+)", text):
            assert (page.parent / link).exists(), f"{page.name}: {link}"
        if page.name != "CHANGELOG.md":
            cited = re.findall(r"`((?:kfgen|tests|examples|benchmarks|docs)/[\w/.]+)", text)
            assert [c for c in cited if not (ROOT / c).exists()] == [], page.name
        prose = re.sub(r"```.*?```", "", text, flags=re.S).splitlines()
        long = [line for line in prose if len(line) > 120 and not line.startswith(("|", "!", "    "))]
        assert long == [], page.name


def test_what_tests_cite_is_there() -> None:
    """A page that a test names, and the section of it, exist."""
    for test in sorted((ROOT / "tests").rglob("*.py")):
        for name, number in re.findall(r"([\w/]+\.md)(?:, (\d\.\d))?", test.read_text(encoding="utf-8")):
            if name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
                continue
            assert name.startswith("docs/"), f"{test.name} cites {name}"
            text = (ROOT / name).read_text(encoding="utf-8")
            assert not number or f"### {number} " in text, f"{test.name} cites {name}, {number}"


LONG_EXAMPLES = tuple(
    f"{n}.py"
    for n in (
        "gallery",
        "own_effect",
        "drone_magnetometer",
        "emitted_on_recordings",
        "hemerly_2017",
        "ahrs_on_recording",
        "tactical_alignment",
        "narasimhappa_2019",
        "identify_recording",
        "car_gnss",
    )
)


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(p.name, marks=pytest.mark.long if p.name in LONG_EXAMPLES else ())
        for p in sorted((ROOT / "examples").glob("*.py"))
    ],
)
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
            line
            for line in (ROOT / "docs/benchmarks.md").read_text(encoding="utf-8").splitlines()
            if " | " in line
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
