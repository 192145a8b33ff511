"""The pages as a site: each is reached from the first, every link and section holds, the reference is whole.

The long test builds it as ``make docs`` does: warnings are errors, notebooks run, and no page asks for anything outside.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest

import kfgen
from kfgen.core.result import Result

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = {str(p.relative_to(DOCS).with_suffix("")): p for p in sorted(DOCS.rglob("*.md"))}
TREE = re.compile(r"```\{toctree\}\n(.*?)```", re.S)


def text_of(page: str) -> str:
    return PAGES[page].read_text(encoding="utf-8")


def children(page: str) -> list[str]:
    """The pages that a page's toctrees name."""
    lines = [line.strip() for tree in TREE.findall(text_of(page)) for line in tree.splitlines()]
    folder = PAGES[page].parent.relative_to(DOCS)
    return [str(folder / line) for line in lines if line and not line.startswith(":")]


def anchor(heading: str) -> str:
    """The anchor of a heading, as MyST and GitHub make it."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower().replace("`", ""))
    return kept.replace(" ", "-")


def test_every_page_is_reached_from_the_first_and_stands_there_once() -> None:
    reached, queue = ["index"], ["index"]
    while queue:
        named = children(queue.pop())
        reached += named
        queue += named
    assert sorted(reached) == sorted(PAGES)


@pytest.mark.parametrize("page", PAGES)
def test_links_between_pages_hold(page: str) -> None:
    prose = re.sub(r"```.*?```", "", text_of(page), flags=re.S)
    for target, place in re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)", prose):
        file = PAGES[page].parent / target if target else PAGES[page]
        assert file.resolve().is_file(), f"{page}: {target}"
        if place:
            headings = re.findall(r"(?m)^#+ (.*)$", file.read_text(encoding="utf-8"))
            assert place in map(anchor, headings), f"{page}: {target}#{place}"


@pytest.mark.parametrize("page", PAGES)
def test_headings_go_down_one_step_at_a_time(page: str) -> None:
    prose = re.sub(r"```.*?```", "", text_of(page), flags=re.S)
    depths = [len(h) for h in re.findall(r"(?m)^(#+) ", prose)]
    if page != "changelog":  # another file is included there
        assert depths[0] == 1
        assert depths.count(1) == 1
    assert all(b - a <= 1 for a, b in pairwise(depths))


def every_result(base: type = Result) -> Iterator[type]:
    """The kinds of results that are imported."""
    for kind in base.__subclasses__():
        yield kind
        yield from every_result(kind)


def test_the_reference_has_every_verb_every_type_and_what_they_give() -> None:
    api = text_of("api")
    verbs = set(re.findall(r"autofunction:: (\w+)", api))
    assert verbs == set(kfgen.VERBS)
    classes = set(re.findall(r"auto(?:class|exception):: ([\w.]+)", api))
    homes = {f"{home}.{name}" for name, home in kfgen.TYPES.items()}
    for verb, home in kfgen.VERBS.items():
        given = getattr(importlib.import_module(home), verb).__annotations__.get("return", "")
        homes |= {f"{k.__module__}.{k.__name__}" for k in every_result() if k.__name__ == given}
    assert homes <= classes
    for name in classes:
        module, _, kind = name.rpartition(".")
        assert isinstance(getattr(importlib.import_module(module), kind), type)


def notebooks() -> list[str]:
    return [p for p in PAGES if p.startswith("notebooks/")]


@pytest.mark.parametrize("page", notebooks())
def test_notebooks_are_python_that_uses_the_verbs(page: str) -> None:
    cells = re.findall(r"```\{code-cell\} ipython3\n(.*?)```", text_of(page), re.S)
    tree = ast.parse("\n".join(cells))
    used = {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and ast.unparse(n.value) == "kf"}
    assert used <= set(kfgen.VERBS) | set(kfgen.TYPES)
    assert len(used) >= 4
    assert max(len(line) for cell in cells for line in cell.splitlines()) <= 100


class Requests(HTMLParser):
    """What a page loads when it is opened: scripts, styles, pictures; links that are followed on a click are none."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        place = named.get("href" if tag == "link" else "src")
        if place and (tag != "link" or "stylesheet" in str(named.get("rel"))):
            self.loaded.append(place)


def test_what_a_page_loads_is_seen() -> None:
    seen = Requests(
        '<script src="https://a.b/c.js"></script><a href="https://d.e"></a><link rel=stylesheet href=x>'
    )
    assert seen.loaded == ["https://a.b/c.js", "x"]


@pytest.mark.long
def test_the_site_is_built_without_a_warning_and_asks_for_nothing(tmp_path: Path) -> None:
    missing = [m for m in ("sphinx", "myst_nb", "furo") if importlib.util.find_spec(m) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} of the extra docs is not installed")
    words = ["-q", "-W", "--keep-going", "-b", "html", "-d", str(tmp_path / "trees")]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *words, str(DOCS), str(tmp_path / "html")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for page in PAGES:
        html = (tmp_path / "html" / f"{page}.html").read_text(encoding="utf-8")
        outside = [s for s in Requests(html).loaded if re.match(r"(?:https?:)?//", s)]
        assert outside == [], page
    for page in notebooks():
        html = (tmp_path / "html" / f"{page}.html").read_text(encoding="utf-8")
        assert html.count('class="cell_output') >= 4
        assert "<img" in html
    assert (tmp_path / "html" / "noise.schema.json").is_file()
