"""Proves what a script or a terminal sees of every command: exit statuses, silence, the time that passes."""

from __future__ import annotations

import io
import re
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from typer.testing import CliRunner, Result

import kfgen as package
from kfgen.cli.app import app
from kfgen.core import elapsed
from kfgen.core.elapsed import ElapsedTime, be_quiet, count, counted, elapsed_time, warn
from kfgen.core.time_budget import time_budget
from kfgen.report.help import COMMAND_GROUPS, EXAMPLES, wrapped

Cli = Callable[..., Result]
ROOT = Path(__file__).resolve().parents[1]
MODEL = """format = "kfgen-noise-1"
[gyro_x]
unit = "deg/s"
effects = [ { effect = "white_noise", N = "0.005 deg/s/sqrt(Hz)" } ]
"""


@pytest.fixture
def log(tmp_path: Path) -> Callable[[float], Path]:
    """Forty seconds of the model's noise with a line of an amplitude; the seed is one whose noise is no finding."""

    def write(amplitude: float) -> Path:
        t = np.arange(4000) / 100.0
        y = np.random.default_rng(5).normal(0.0, 0.05, t.size) + amplitude * np.sin(2 * np.pi * 7.3 * t)
        path = tmp_path / f"log{amplitude}.csv"
        np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="t [s],gyro_x [deg/s]", comments="")
        return path

    (tmp_path / "model.toml").write_text(MODEL)
    return write


@pytest.mark.parametrize(
    ("amplitude", "words", "status"),
    [(0.05, ("--fail-on-gap",), 3), (0.0, ("--fail-on-gap",), 0)],
)
def test_a_gap_ends_with_3_where_it_is_asked_to(
    log: Callable[[float], Path],
    tmp_path: Path,
    kfgen: Cli,
    amplitude: float,
    words: tuple[str, ...],
    status: int,
) -> None:
    improved = tmp_path / "improved.toml"
    answer = kfgen("gap", log(amplitude), "--model", tmp_path / "model.toml", "-o", improved, *words)
    assert answer.exit_code == status
    assert improved.exists()
    assert ("sinusoid" in improved.read_text()) == bool(amplitude)
    assert ("The model changes by" in answer.output) == bool(amplitude)


def test_quiet_leaves_the_answer_and_errors(tmp_path: Path, kfgen: Cli) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    words = ("convert", tmp_path / "model.toml", "--to", "px4", "--rate", "100")
    loud, quiet = kfgen(*words), kfgen("--quiet", *words)
    assert "warning: " in loud.stderr
    assert quiet.stderr == ""
    assert quiet.stdout == loud.stdout
    assert "warning: " in kfgen(*words).stderr  # and not for ever
    assert kfgen("--quiet", "identify", tmp_path / "none.csv").exit_code == 2


def test_quiet_may_stand_anywhere(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from kfgen.cli import main

    (tmp_path / "model.toml").write_text(MODEL)
    line = ["kfgen", "convert", str(tmp_path / "model.toml"), "--to", "px4", "--rate", "100", "--quiet"]
    monkeypatch.setattr("sys.argv", line)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    said = capsys.readouterr()
    assert said.err == ""
    assert "EKF2_GYR_NOISE" in said.out


class Terminal(io.StringIO):
    """A stream that a person looks at."""

    def isatty(self) -> bool:
        return True


def test_the_time_is_shown_and_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kfgen.core.elapsed.EVERY_S", 0.01)
    stream = Terminal()
    shown = ElapsedTime("kfgen gap", stream, after_s=0.01)
    shown.details["count"] = lambda: "3 of 8"
    ends = time.monotonic() + 20.0
    while "3 of 8" not in stream.getvalue() and time.monotonic() < ends:
        time.sleep(0.01)
    shown.stop()
    text = stream.getvalue()
    assert re.search(r"\r\x1b\[Kkfgen gap: \d+ s, 3 of 8", text)
    assert text.endswith("\r\x1b[K")
    shown.stop()
    assert stream.getvalue() == text


@contextmanager
def shown(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """A command on a terminal; gives a clock [s] that the test sets."""
    now = [0.0]
    be_quiet(False)
    monkeypatch.setattr("sys.stderr", Terminal())
    monkeypatch.setattr("kfgen.core.elapsed.SHOWN_AFTER_S", 30.0)
    with elapsed_time("kfgen fleet"):
        monkeypatch.setattr("kfgen.core.elapsed.time.monotonic", lambda: now[0])
        yield now
        monkeypatch.undo()


def said_now() -> list[str]:
    current = elapsed._CURRENT.get()
    assert current is not None
    return [words() for words in current.details.values()]


def test_the_time_left_is_that_of_the_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four logs of 10 take 20 s: six take 30 s more, and one that is late leaves those after it."""
    with shown(monkeypatch) as now:
        count(0, 10)
        assert said_now() == ["0 of 10 logs"]
        now[0] = 20.0
        count(4, 10)
        assert said_now() == ["4 of 10 logs, about 30 s left"]
        now[0] = 23.0
        assert said_now() == ["4 of 10 logs, about 27 s left"]
        now[0] = 60.0
        assert said_now() == ["4 of 10 logs, about 25 s left"]
        count(10, 10)
        assert said_now() == ["10 of 10 logs"]


def test_no_time_is_said_of_what_differs_or_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with shown(monkeypatch) as now:
        count(0, 1)
        assert said_now() == []
        for name in counted(("gyro_x", "gyro_y"), "channels", alike=False):
            assert said_now() == [f"{int(name == 'gyro_y')} of 2 channels"]
            now[0] += 5.0
        assert said_now() == ["2 of 2 channels"]


def test_a_limit_is_said_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with shown(monkeypatch) as now, time_budget() as budget:
        now[0] = budget._clock
        with time_budget():
            assert said_now() == [f"at most {budget.search_s:.0f} s of search left"]
        budget.search_s = 0.0
        assert said_now() == ["the search is over"]


def test_what_is_done_at_once_shows_nothing() -> None:
    stream = Terminal()
    ElapsedTime("kfgen list", stream, after_s=5.0).stop()
    assert stream.getvalue() == ""


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()])
def test_nothing_is_shown_to_a_file_or_when_quiet(
    monkeypatch: pytest.MonkeyPatch, stream: io.StringIO
) -> None:
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr("kfgen.core.elapsed.SHOWN_AFTER_S", 0.0)
    be_quiet(stream.isatty())
    try:
        with elapsed_time("kfgen gap"):
            time.sleep(0.05)
        assert stream.getvalue() == ""
        warn("it is late")
        assert stream.getvalue() == ("" if stream.isatty() else "warning: it is late\n")
    finally:
        be_quiet(False)


def test_statuses_are_documented() -> None:
    text = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\d, ]+) \|", text, re.M)
    assert [int(n) for row in rows for n in row.split(",")] == [0, 1, 2, 3, 130, 143, 129]


def test_the_version_is_one() -> None:
    """In the package, in what is cited, in the changelog."""
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert cited
    assert cited.group(1) == package.__version__
    assert f"## {package.__version__}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


# Help.


def commands() -> dict[str, Any]:
    return typer.main.get_command(app).commands  # type: ignore[attr-defined, no-any-return]


def test_every_command_is_in_one_group_and_has_examples() -> None:
    grouped = [name for names in COMMAND_GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(commands())
    assert set(EXAMPLES) == {"kfgen", *grouped}


@pytest.mark.parametrize("of", EXAMPLES)
def test_examples_are_commands_of_ours(of: str) -> None:
    for _, line in EXAMPLES[of]:
        program, name, *words = shlex.split(line)
        assert program == "kfgen"
        assert of in ("kfgen", name)
        options = {o for p in commands()[name].params for o in (*p.opts, *p.secondary_opts)}
        assert {w for w in words if re.match(r"--?[a-z]", w)} <= options, line


@pytest.mark.parametrize("width", [60, 80, 200])
@pytest.mark.parametrize("words", [(), ("identify",), ("simulate",), ("convert",)])
def test_help_is_as_wide_as_the_terminal(words: tuple[str, ...], width: int) -> None:
    answer = CliRunner().invoke(app, [*words, "--help"], terminal_width=width)
    lines = answer.output.splitlines()
    assert max(map(len, lines)) <= width
    for title in ("Examples:", "Answer:" if words else "Noise of a sensor:"):
        assert title in lines


def test_a_long_example_goes_on_after_a_backslash() -> None:
    assert wrapped("kfgen gap 'a b.csv' --model m.toml", 24) == ["kfgen gap 'a b.csv' \\", "  --model m.toml"]
