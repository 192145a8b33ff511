"""Proves that pages read well: their head, their links, their pictures in words; in a browser nothing sticks out.

The browser is Chromium, where it is installed; nothing of a page may ask for anything outside it.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from typer.testing import Result

from kfgen.report.page import Page, code, figure, heading, page_html, sentence, table, write_page
from kfgen.report.plots import bars_picture

Cli = Callable[..., Result]
CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)
FLAGS = (
    *(
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--enable-logging=stderr",
    ),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--dump-dom"),
)
VOID = {"meta", "br", "img", "link", "input", "hr", "use", "path", "rect"}


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A page of each kind, by the commands themselves."""
    from typer.testing import CliRunner

    from kfgen.cli.app import app

    home = tmp_path_factory.mktemp("pages")
    t = np.arange(4000) / 100.0
    rng = np.random.default_rng(5)
    y = rng.normal(0.0, 0.05, (2, t.size))
    y[0] += 0.05 * np.sin(2 * np.pi * 7.3 * t)
    head = "t [s],gyro_x [deg/s],gyro_y [deg/s]"
    np.savetxt(home / "log.csv", np.column_stack([t, *y]), delimiter=",", header=head, comments="")
    axes = ("gyro_x", "gyro_y")
    effect = '{ effect = "white_noise", N = "0.005 deg/s/sqrt(Hz)" }'
    text = "".join(f'[{c}]\nunit = "deg/s"\neffects = [ {effect} ]\n' for c in axes)
    (home / "noise.toml").write_text('format = "kfgen-noise-1"\n' + text)
    commands = {
        "gap": ["gap", home / "log.csv", "--model", home / "noise.toml", "--channels", "gyro_x"],
        "identify": ["identify", home / "log.csv", "--channels", "gyro_y", "--effects", "white_noise"],
        "audit": ["audit", "gyro-static"],
        "derive": ["derive", "ahrs6"],
        "emit": ["emit", "gyro-static", "--target", "c", "-o", home / "code"],
        "verify": ["verify", home / "code"],
        "convert": ["convert", home / "noise.toml", "--to", "px4", "--rate", "100"],
        "list": ["list", home / "log.csv"],
    }
    found = {}
    for name, words in commands.items():
        found[name] = home / f"{name}.html"
        result = CliRunner().invoke(app, [*map(str, words), "--report", str(found[name])])
        assert result.exit_code == 0, (name, result.output, result.exception)
    return found


NAMES = ("gap", "identify", "audit", "derive", "emit", "verify", "convert", "list")


class Tags(HTMLParser):
    """The tags of a page, and which are open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.wrong: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID and (not self.open or self.open.pop() != tag):
            self.wrong.append(tag)


@pytest.mark.parametrize("name", in_part(NAMES))
def test_a_page_is_whole_and_says_what_it_shows(pages: dict[str, Path], name: str) -> None:
    text = pages[name].read_text(encoding="utf-8")
    tags = Tags(text)
    assert (tags.wrong, tags.open) == ([], [])
    anchors = {a["id"] for _, a in tags.found if a.get("id")}
    links = [str(a["href"])[1:] for tag, a in tags.found if tag == "a"]
    assert set(links) <= anchors
    assert sum(tag == "h1" for tag, _ in tags.found) == 1
    pictures = [a for tag, a in tags.found if a.get("role") == "img"]
    assert len(pictures) == text.count("<figure>")
    assert all(a.get("aria-label") for a in pictures)
    outside = [v for _, a in tags.found for k, v in a.items() if k in ("src", "href") and v and v[0] != "#"]
    assert outside == []
    assert not re.search(r"url\((?!#)", text)
    assert "prefers-color-scheme: dark" in text
    assert "<dt>written</dt>" in text


@pytest.mark.parametrize("name", ["gap", "identify", "audit", "emit", "verify", "convert"])
def test_a_page_begins_with_its_verdict(pages: dict[str, Path], name: str) -> None:
    text = pages[name].read_text(encoding="utf-8")
    verdict = re.search(r'<div class="verdict ?(\w*)">\s*<p>(.*?)</p>', text, re.S)
    assert verdict
    said = {
        "gap": ("bad", "gyro_x: an effect is missing from the model"),
        "identify": ("", "gyro_y: N 0.0"),
        "verify": ("good", "Bit-exact on host"),
        "convert": ("", "The parameters of noise.toml for PX4"),
        "emit": ("", "kfgen verify"),
    }
    wanted = said.get(name, ("", ""))
    assert wanted[1] in verdict.group(2)
    assert name == "audit" or verdict.group(1) == wanted[0]
    assert "<h2" not in text[: verdict.start()]


def test_the_updated_model_is_ready_to_be_copied(pages: dict[str, Path]) -> None:
    text = pages["gap"].read_text(encoding="utf-8")
    assert re.search(r"<summary>The updated model, ready to be copied</summary>", text)
    assert "sinusoid" in text.partition("ready to be copied")[2]
    assert re.search(r"<th[^>]*>closes</th>", text)


def test_the_date_is_that_of_the_build_where_it_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    write_page(Page("a"), tmp_path / "a.html")
    assert "2023-11-14 22:13 UTC" in (tmp_path / "a.html").read_text()


def test_names_that_look_like_markup_stay_text() -> None:
    evil = "<script>alert(1)</script>"
    parts = (heading(evil), sentence(evil), table((evil,), [[evil]], evil, True), code(evil, evil, True))
    text = page_html(
        Page(
            evil,
            (*parts, figure(bars_picture([evil], [1.0], evil, evil), f'"{evil}')),
            (evil,),
            True,
            ((evil, evil),),
        )
    )
    assert text.count("<script>") == 1
    assert "alert(1)</script>" not in text


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
@pytest.mark.parametrize("width", [390, 1200])
def test_nothing_sticks_out_in_a_browser(pages: dict[str, Path], tmp_path: Path, width: int) -> None:
    """Every page in a frame of that width, all folds open, and one that is too wide: the browser says what sticks out."""
    measured = (
        "for (const d of document.querySelectorAll('details')) d.open = true;"
        "const wide = [...document.querySelectorAll('body *')].filter(e => !e.closest('.scroll, .math, svg') &&"
        " e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName);"
        "parent.postMessage({name: location.pathname.split('/').pop().split('.')[0], wide, scroll: document.documentElement.scrollWidth, inner: innerWidth}, '*');"
    )
    frames = ""
    wide = tmp_path / "made.html"
    wide.write_text("<!DOCTYPE html><body><table style='width:1500px'></table></body>")
    for name, path in (*pages.items(), ("wide", wide)):
        copy = tmp_path / f"{name}.html"
        copy.write_text(
            path.read_text(encoding="utf-8").replace("</body>", f"<script>{measured}</script></body>")
        )
        frames += f'<iframe src="{copy.name}" style="width:{width}px;height:800px;border:0"></iframe>'
    listen = "addEventListener('message', e => { const p = document.createElement('pre'); p.textContent = JSON.stringify(e.data); document.body.append(p); });"
    (tmp_path / "all.html").write_text(f"<!DOCTYPE html><body><script>{listen}</script>{frames}</body>")
    words = [str(CHROMIUM), *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000"]
    done = subprocess.run(
        [*words, (tmp_path / "all.html").as_uri()], capture_output=True, text=True, check=False, timeout=120
    )
    found = [json.loads(m) for m in re.findall(r"<pre>(\{.*?\})</pre>", done.stdout)]
    assert len(found) == len(pages) + 1, done.stderr[-2000:]
    assert [f for f in found if f["name"] != "wide" and (f["wide"] or f["scroll"] > f["inner"])] == []
    assert next(f for f in found if f["name"] == "wide")["wide"] == ["TABLE"]
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
