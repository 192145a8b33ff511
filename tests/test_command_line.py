"""Proves what a script or a terminal sees of every command: exit statuses, silence, the time that passes."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

import kfgen as package
from kfgen.core.elapsed import ElapsedTime, be_quiet, elapsed_time, warn

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
    shown.detail = "3 of 8"
    ends = time.monotonic() + 20.0
    while "3 of 8" not in stream.getvalue() and time.monotonic() < ends:
        time.sleep(0.01)
    shown.stop()
    text = stream.getvalue()
    assert re.search(r"\r\x1b\[Kkfgen gap: \d+ s, 3 of 8", text)
    assert text.endswith("\r\x1b[K")
    shown.stop()
    assert stream.getvalue() == text


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
