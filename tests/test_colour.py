"""Colours are for a person at a terminal: verdict, warnings and errors; a pipe and a file get the plain text."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from kfgen.core.elapsed import warn
from kfgen.core.errors import InputError
from kfgen.core.terminal import ending_of, painted
from kfgen.report.page import Answer, Page

GREEN, YELLOW, RED = (f"\x1b[1;{n}m" for n in (32, 33, 31))


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[[], Terminal]:
    """Makes standard output and error those of a terminal that has colours, once the test runs."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")

    def begun() -> Terminal:
        screen = Terminal()
        monkeypatch.setattr(sys, "stdout", screen)
        monkeypatch.setattr(sys, "stderr", screen)
        return screen

    return begun


def answer(good: bool | None, ok: bool = True) -> Answer:
    return Answer("It holds.\nfigures", {}, Page("t", (), ("It holds.",), good), ok)


def test_a_verdict_has_its_colour_on_a_terminal(terminal: Callable[[], Terminal]) -> None:
    terminal()
    assert answer(True).shown() == f"{GREEN}It holds.\x1b[0m\nfigures"
    assert answer(False).shown() == f"{YELLOW}It holds.\x1b[0m\nfigures"
    assert answer(None, ok=False).shown() == f"{YELLOW}It holds.\x1b[0m\nfigures"
    assert answer(None).shown() == "It holds.\nfigures"  # nothing was hoped for


def test_warnings_and_errors_have_theirs(terminal: Callable[[], Terminal]) -> None:
    screen = terminal()
    warn("the log \x1b[2J is short")
    assert screen.getvalue() == f"{YELLOW}warning:\x1b[0m the log \\x1b[2J is short\n"
    error = InputError("the unit is missing", where="n.toml", remedy="Add it")
    assert ending_of(error) == (2, f"{RED}kfgen:\x1b[0m n.toml: the unit is missing. Add it")
    assert ending_of(KeyboardInterrupt()) == (130, "")


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_who_wants_no_colour_gets_none(
    name: str, value: str, terminal: Callable[[], Terminal], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    screen = terminal()
    assert answer(False).shown() == "It holds.\nfigures"
    assert painted("warning:", "attention", screen) == "warning:"


def test_an_empty_no_color_is_none(terminal: Callable[[], Terminal], monkeypatch: pytest.MonkeyPatch) -> None:
    """As no-color.org has it."""
    monkeypatch.setenv("NO_COLOR", "")
    assert painted("x", "error", terminal()) == f"{RED}x\x1b[0m"


def test_a_pipe_gets_the_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (tmp_path / "out").open("w") as pipe:
        monkeypatch.setattr(sys, "stdout", pipe)
        assert answer(False).shown() == "It holds.\nfigures"
