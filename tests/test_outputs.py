"""Proves that no command loses what it reads or what was there before: outputs against inputs and each other, special
files, permissions, all outputs or none, and what killed runs leave behind.
"""

from __future__ import annotations

import inspect
import os
import re
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from kfgen.core.errors import InputError
from kfgen.core.files import whole_file
from kfgen.core.files.outputs import READ_BY_NAME, WRITTEN
from kfgen.core.files.temporary import temporary_file
from kfgen.core.files.whole_file import all_or_none, publish, write_text, write_whole, write_whole_folder

Cli = Callable[..., Result]
NOISE = 'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\neffects = [{effect="white_noise", N=1e-3}]\n'


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    y = np.random.default_rng(0).normal(size=300)
    rows = [f"{k / 100:.2f},{v:.6f}" for k, v in enumerate(y)]
    Path("in.csv").write_text("\n".join(["t [s],gyro_x [deg/s]", *rows]) + "\n", encoding="utf-8")
    Path("n.toml").write_text(NOISE, encoding="utf-8")
    Path("link.csv").symlink_to("in.csv")
    Path("folder").mkdir()


def everything() -> dict[str, bytes | None]:
    return {str(p): p.read_bytes() if p.is_file() else None for p in sorted(Path().rglob("*"))}


LOST = {
    "log as json": "identify in.csv --json in.csv",
    "log as noise": "identify in.csv -o in.csv",
    "log as page": "identify in.csv --report in.csv",
    "log by another name": "identify in.csv --json folder/../in.csv",
    "log by a link": "identify in.csv --json link.csv",
    "log that is a link": "identify link.csv --json in.csv",
    "second log": "identify n.toml in.csv --json in.csv",
    "noise of plan": "plan n.toml --json n.toml",
    "noise of convert": "convert n.toml --to table --json n.toml",
    "noise of convert as output": "convert n.toml --to table -o n.toml",
    "model of gap": "gap in.csv --model n.toml -o n.toml",
    "proof of gap": "gap n.toml --model n.toml --proof in.csv --json in.csv",
    "noise of derive": "derive gyro-static --noise n.toml --report n.toml",
    "noise of simulate": "simulate gyro-static --noise n.toml -o n.toml",
    "manoeuvre": "simulate ahrs6 --manoeuvre n.toml -o n.toml",
    "log of run": "run gyro-static in.csv --json in.csv",
    "log of audit": "audit gyro-static --log in.csv --json in.csv",
    "log of denoise": "denoise in.csv --json in.csv",
    "log of denoise at rest": "denoise n.toml --at-rest in.csv -o in.csv",
    "logs of a fleet": "fleet i*.csv --json in.csv",
    "model of a fleet": "fleet in.csv --model n.toml --json n.toml",
    "noise in the folder of code": "emit gyro-static --noise folder/../n.toml --target c -o .",
    "folder of code": "verify folder --json folder/a.json",
    "one output twice": "identify in.csv -o x --json x",
    "one output three times": "identify in.csv --json y --report x -o ./x",
    "page in the folder of code": "emit gyro-static --target c -o out --report out/page.html",
    "answer in the folder of the demo": "demo --out out --json out/noise.toml",
}


@pytest.mark.parametrize("case", LOST)
def test_no_output_takes_an_input_or_another_output(case: str, kfgen: Cli) -> None:
    before = everything()
    done = kfgen(*LOST[case].split())
    assert done.exit_code == 2
    assert "overwrite" in str(done.exception)
    assert everything() == before


def test_every_path_of_a_command_is_an_input_or_an_output() -> None:
    """A new one must be named in `kfgen.core.files.outputs`: what its parameter holds depends on the version of typer."""
    from kfgen.cli.app import app

    paths = {
        name
        for command in app.registered_commands
        for name, annotation in inspect.get_annotations(command.callback, eval_str=False).items()
        if re.search(r"Path|Noise|Report|Output", str(annotation))
    }
    assert {"noise", "log", "logs", "report", "folder"} <= paths <= {*WRITTEN, *READ_BY_NAME}


def test_nothing_is_computed_before_the_outputs_are_proven(
    kfgen: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is no log would be refused by the reader: the output is refused first."""
    Path("in.csv").write_text("rubbish\n", encoding="utf-8")
    for words in ("-o nowhere/x", "--json folder", "-o out.toml --report nowhere/x.html"):
        said = str(kfgen("identify", "in.csv", *words.split()).exception)
        assert "output" in said
        assert "rubbish" not in said


def test_all_outputs_or_none(kfgen: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page fails at the end, as on a disk that is full: the noise file and the answer do not appear."""

    def full(self: Path, *_: object, **__: object) -> int:
        raise OSError(28, "No space left on device", str(self))

    before = everything()
    monkeypatch.setattr("kfgen.report.page.page_html", lambda _: "x")
    write = Path.write_text
    monkeypatch.setattr(
        Path, "write_text", lambda p, text, **how: (full if text == "x" else write)(p, text, **how)
    )
    done = kfgen("identify", "in.csv", "-o", "n.toml", "--json", "a.json", "--report", "p.html")
    assert done.exit_code == 2
    assert str(done.exception).startswith("p.html: the output cannot be written: no space left on device.")
    assert everything() == before
    monkeypatch.undo()


def test_a_failed_check_still_writes_its_answer(kfgen: Cli) -> None:
    Path("bad.csv").write_text("rubbish\n", encoding="utf-8")
    done = kfgen("fleet", "in.csv", "bad.csv", "--jobs", 1, "--json", "a.json")
    assert done.exit_code == 1
    assert Path("a.json").is_file()


def test_a_link_is_followed_and_permissions_are_kept(kfgen: Cli) -> None:
    Path("folder/real.toml").write_text("old", encoding="utf-8")
    Path("folder/real.toml").chmod(0o600)
    Path("out.toml").symlink_to("folder/real.toml")
    Path("new.json").symlink_to("folder/new.json")
    assert kfgen("identify", "in.csv", "-o", "out.toml", "--json", "new.json").exit_code == 0
    assert Path("out.toml").is_symlink()
    assert Path("new.json").is_symlink()
    assert "white_noise" in Path("folder/real.toml").read_text("utf-8")
    assert stat.S_IMODE(Path("folder/real.toml").stat().st_mode) == 0o600
    assert Path("folder/new.json").is_file()


def test_the_permissions_of_a_new_file_are_those_that_the_user_wants() -> None:
    old = os.umask(0o027)
    try:
        write_text("a", "a")
        with write_whole_folder("b"):
            pass
    finally:
        os.umask(old)
    assert [stat.S_IMODE(Path(p).stat().st_mode) for p in "ab"] == [0o640, 0o750]


def test_a_device_stays_a_device(kfgen: Cli) -> None:
    before = os.stat("/dev/null")
    assert kfgen("list", "--json", "/dev/null", "--report", "/dev/null").exit_code == 0
    after = os.stat("/dev/null")
    assert stat.S_ISCHR(after.st_mode)
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)


def test_a_pipe_is_written_and_stays(kfgen: Cli) -> None:
    os.mkfifo("pipe")
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append(Path("pipe").read_text("utf-8")))
    reader.start()
    assert kfgen("list", "--json", "pipe").exit_code == 0
    reader.join(20.0)
    assert got[0].startswith("{")
    assert stat.S_ISFIFO(os.stat("pipe").st_mode)


def process(*words: str, stdout: object = subprocess.PIPE) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", "from kfgen.cli import main; main()", *words],
        stdout=stdout,  # type: ignore[call-overload]
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.long
def test_standard_output_by_its_name_goes_where_it_goes() -> None:
    """A shell's ``> file`` is not replaced: page and text follow each other in it."""
    with Path("out").open("w") as out:
        assert process("list", "--json", "/dev/stdout", stdout=out).wait() == 0
    text = Path("out").read_text("utf-8")
    assert text.startswith("{")
    assert "ins15" in text.rpartition("}")[2]


@pytest.mark.parametrize("words", ["emit gyro-static --target c -o", "demo --out"])
@pytest.mark.parametrize("place", ["in.csv", "/dev/null"])
def test_a_file_is_no_folder(words: str, place: str, kfgen: Cli) -> None:
    before = everything()
    done = kfgen(*words.split(), place)
    assert done.exit_code == 2
    assert str(done.exception).startswith(f"{place}: it is no folder. Give")
    assert everything() == before


def test_a_link_that_leads_to_itself_stays(kfgen: Cli) -> None:
    Path("loop").symlink_to("pool")
    Path("pool").symlink_to("loop")
    assert "loop: the output cannot be written" in str(kfgen("list", "--json", "loop").exception)
    assert Path("loop").is_symlink()


def test_a_disk_is_not_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "is_block_device", lambda _: True)
    with pytest.raises(InputError, match="it is a disk"):
        write_text("/dev/null", "x")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everything")
def test_a_protected_file_is_not_replaced(kfgen: Cli) -> None:
    Path("n.toml").chmod(0o400)
    assert "permission" in str(kfgen("identify", "in.csv", "-o", "n.toml").exception)


def test_a_name_of_any_length_that_the_system_allows(kfgen: Cli) -> None:
    assert kfgen("list", "--json", "x" * 255).exit_code == 0
    said = str(kfgen("list", "--json", "x" * 256).exception)
    assert "file name too long" in said
    assert "Errno" not in said
    assert ".kfgen" not in said


def test_what_a_killed_run_left_is_removed_by_the_next_and_what_lives_stays() -> None:
    script = (
        "import sys, time; from kfgen.core.files.whole_file import *\n"
        "with write_whole('a.json') as f, write_whole_folder('code'):\n"
        " f.write_text('half'); print('.', flush=True); time.sleep(60)"
    )
    runs = [
        subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) for _ in range(2)
    ]
    try:
        for run in runs:
            assert run.stdout is not None
            run.stdout.readline()
        assert len(list(Path().glob(".a.json.*"))) == 2
        runs[0].send_signal(signal.SIGKILL)
        runs[0].wait()
        write_text("a.json", "whole")
        with write_whole_folder("code"):
            pass
        assert len(list(Path().glob(".a.json.*"))) == 1
        assert len(list(Path().glob(".code.*"))) == 1
    finally:
        for run in runs:
            run.kill()
            run.wait()
    write_text("a.json", "whole")
    assert list(Path().glob(".a.json.*")) == []


def test_a_folder_that_a_killed_run_had_moved_aside_comes_back() -> None:
    with write_whole_folder("code") as fresh:
        (fresh / "main.c").write_text("mine")
    Path("code").rename(".code.abcdefgh.kfgen-old")
    with suppress(ZeroDivisionError), write_whole_folder("code"):
        assert Path("code/main.c").read_text() == "mine"
        raise ZeroDivisionError
    assert Path("code/main.c").read_text() == "mine"
    assert list(Path().glob(".code.*")) == []


def test_outputs_that_belong_together_appear_together() -> None:
    with all_or_none(["a", "b"]):
        write_text("a", "1")
        write_text("other", "3")
        assert [Path(p).exists() for p in ("a", "other")] == [False, True]
        write_text("b", "2")
        publish()
        assert [Path(p).read_text() for p in "ab"] == ["1", "2"]
    with suppress(KeyError), all_or_none(["a", "b"]):
        write_text("a", "9")
        raise KeyError
    assert Path("a").read_text() == "1"
    assert list(Path().glob(".?.*")) == []


def test_an_error_of_an_input_is_not_blamed_on_the_output() -> None:
    with pytest.raises(FileNotFoundError), write_whole("a"):
        Path("gone").read_text()
    assert not Path("a").exists()


def test_two_writers_of_one_file_leave_one_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = ["x" * 100_000, "y" * 100_000]

    def write(text: str) -> None:
        for _ in range(200):
            write_text("shared", text)

    failed: list[object] = []
    monkeypatch.setattr(threading, "excepthook", failed.append)
    writers = [threading.Thread(target=write, args=(t,)) for t in texts]
    for w in writers:
        w.start()
    seen = set()
    while any(w.is_alive() for w in writers):
        if Path("shared").exists():
            seen.add(Path("shared").read_text())
        time.sleep(0.001)
    assert seen <= set(texts)
    assert failed == []


def test_locks_are_let_go() -> None:
    path, handle = temporary_file(Path("a").absolute())
    os.close(handle)
    write_text("a", "whole")
    assert not path.exists()
    assert whole_file._TOGETHER.get() is None
