"""Proves that whatever is wrong with a file or an option, the command line says so and leaves nothing behind.

In process: exit status 2 and the words that name the place; the fixture raises on any other exception,
which is what a user would see as a traceback. Through a real process: one message on standard error that
begins with ``kfgen: ``, nothing on standard output, and a folder as it was before.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from typer.testing import Result

Cli = Callable[..., Result]

NOISE = 'format = "kfgen-noise-1"\n[{channel}]\nunit = "{unit}"\neffects = [{effects}]\n'
WHITE = '{effect="white_noise", N=1e-3}'


def rows(n: int = 300, header: str = "t [s],gyro_x [deg/s]") -> list[str]:
    values = np.random.default_rng(0).normal(size=n)
    return [header, *(f"{k / 100:.2f},{v:.6f}" for k, v in enumerate(values))]


def put(lines: list[str], name: str = "log.csv") -> str:
    Path(name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return name


def noise(
    channel: str = "gyro_x", unit: str = "deg/s", effects: str = WHITE, name: str = "noise.toml"
) -> str:
    Path(name).write_text(NOISE.format(channel=channel, unit=unit, effects=effects), encoding="utf-8")
    return name


def everything() -> dict[str, bytes | None]:
    """Every file and folder below the present one, hidden ones too, with its content."""
    return {str(p): p.read_bytes() if p.is_file() else None for p in sorted(Path().rglob("*"))}


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def refused(kfgen: Cli) -> Callable[..., str]:
    """Run a command that must be refused: exit status 2, nothing printed, nothing written."""

    def call(*words: object) -> str:
        before = everything()
        result = kfgen(*words)
        assert result.exit_code == 2, result.output
        assert everything() == before
        assert result.stdout == ""
        return f"{result.exception} {result.stderr}"

    return call


def test_the_good_log_is_accepted(kfgen: Cli) -> None:
    """Without this, a command that refuses everything would pass all the rest."""
    assert kfgen("identify", put(rows()), "-o", "noise.toml").exit_code == 0
    assert Path("noise.toml").is_file()


def changed(line: int, text: str) -> list[str]:
    lines = rows()
    lines[line - 1] = text
    return lines


LOGS = {
    "word in a cell": (changed(5, "0.03,oops"), ["'oops'", "line 5", "column 2", "gyro_x"]),
    "empty time": (changed(5, ",1"), ["empty", "line 5", "column 1"]),
    "missing cell": (changed(5, "0.03"), ["line 5", "1 cells instead of 2"]),
    "nan in time": (changed(5, "nan,1"), ["time", "sample 4"]),
    "time running backwards": (changed(5, "0.005,1"), ["time", "sample 4"]),
    "time that does not move on": (changed(5, "0.02,1"), ["time", "sample 4"]),
    "header twice": (rows(header="t [s],t [s]"), ["'t' twice", "line 1", "column 2"]),
    "unknown unit": (rows(header="t [s],gyro_x [furlong]"), ["furlong", "gyro_x"]),
    "no unit": (rows(header="t [s],gyro_x"), ["no unit", "gyro_x"]),
    "no time": (["gyro_x [deg/s]", *(r.split(",")[1] for r in rows()[1:])], ["--rate"]),
    "too few samples": (rows(20), ["20 samples", "gyro_x"]),
    "one sample": (rows(1), ["too few", "1 sample"]),
    "header only": (rows(0), ["numbers"]),
    "constant": ([rows()[0], *(f"{k / 100:.2f},5.0" for k in range(300))], ["never changes", "gyro_x"]),
    "values beyond squaring": (
        [rows()[0], *(f"{k / 100:.2f},{(-1) ** k * (k + 1)}e300" for k in range(300))],
        ["gyro_x"],
    ),
    "nothing to identify": (rows(header="t [s],temperature [degC]"), ["temperature"]),
}


HOLES = {
    "nan in a channel": (changed(5, "0.03,nan"), ["gyro_x", "1 samples", "missing"]),
    "inf in a channel": (changed(5, "0.03,inf"), ["gyro_x", "1 samples", "missing"]),
    "hole in time": ([*rows(), "9.0,1"], ["uneven", "t = 2.99 s"]),
}


@pytest.mark.parametrize("case", ["nan in a channel", "inf in a channel"])
def test_the_gap_draws_over_a_hole_and_says_so(case: str, kfgen: Cli) -> None:
    """It asked for a whole log before dropped samples were an effect: one that is missing is a finding now."""
    lines, words = HOLES[case]
    done = kfgen("gap", put(lines), "--model", noise(), "--json", "answer.json")
    assert done.exit_code == 0, done.output
    for word in words:
        assert word in done.stderr
    steps = json.loads(Path("answer.json").read_text(encoding="utf-8"))["steps"]
    assert "dropped_samples" in [s["effect"] for s in steps]


def test_the_gap_asks_for_one_log(refused: Callable[..., str]) -> None:
    """More is missing than there is."""
    lines, words = HOLES["hole in time"]
    path = put(lines)
    said = refused("gap", path, "--model", noise(), "-o", "better.toml", "--json", "answer.json")
    for word in [path, *words]:
        assert word in said


@pytest.mark.parametrize("case", HOLES)
def test_what_is_missing_is_said(case: str, kfgen: Cli) -> None:
    """Identification takes it as missing, and says so: how many, where."""
    done = kfgen("identify", put(HOLES[case][0]), "-o", "noise.toml")
    assert done.exit_code == 0
    assert "missing" in done.stderr
    assert "t = 2.99 s" in done.stderr or "t = 0.03 s" in done.stderr


@pytest.mark.parametrize("case", LOGS)
def test_a_wrong_log_is_refused(case: str, refused: Callable[..., str]) -> None:
    lines, words = LOGS[case]
    path = put(lines)
    said = refused("identify", path, "-o", "noise.toml", "--json", "answer.json", "--report", "page.html")
    for word in [path, *words]:
        assert word in said


@pytest.mark.parametrize("command", [("identify",), ("run", "ahrs6"), ("gap", "--model", "ahrs6")])
@pytest.mark.parametrize("name", ["gone.csv", "empty.csv", "log.xyz"])
def test_every_command_on_a_log_refuses_what_is_no_log(
    command: tuple[str, ...], name: str, refused: Callable[..., str]
) -> None:
    Path("empty.csv").touch()
    Path("log.xyz").write_text("t [s],a [m]\n0,1\n", encoding="utf-8")
    assert name in refused(*command, name)


def test_a_folder_is_no_log(refused: Callable[..., str]) -> None:
    Path("folder.csv").mkdir()
    assert "folder.csv" in refused("identify", "folder.csv")


OPTIONS = {
    "rate zero": (["identify", "log.csv", "--rate", 0], ["0", "--rate"]),
    "rate negative": (["identify", "log.csv", "--rate=-5"], ["-5", "--rate"]),
    "rate nan": (["identify", "log.csv", "--rate", "nan"], ["nan", "--rate"]),
    "rate inf": (["identify", "log.csv", "--rate", "inf"], ["inf", "--rate"]),
    "derive rate zero": (["derive", "gyro-static", "--rate", 0], ["--rate"]),
    "derive rate nan": (["derive", "gyro-static", "--rate", "nan"], ["--rate"]),
    "simulate rate negative": (["simulate", "gyro-static", "--rate=-1", "-o", "sim.csv"], ["--rate"]),
    "missing channel": (["identify", "log.csv", "--channels", "gyro_z"], ["'gyro_z'", "gyro_x", "log.csv"]),
    "missing column": (["identify", "log.csv", "--columns", "a=gz [deg/s]"], ["'gz'", "gyro_x", "log.csv"]),
    "column unit": (["identify", "log.csv", "--columns", "a=gyro_x [furlong]"], ["furlong", "--columns"]),
    "columns garbled": (["identify", "log.csv", "--columns", "nonsense"], ["'nonsense'", "--columns"]),
    "method": (["identify", "log.csv", "--method", "magic"], ["'magic'", "ml"]),
    "effect": (["identify", "log.csv", "--effects", "gremlins"], ["'gremlins'", "white_noise"]),
    "effect without driver": (
        ["identify", "log.csv", "--effects", "white_noise,temperature"],
        ["temperature"],
    ),
    "effect not at rest": (["identify", "log.csv", "--effects", "bias"], ["bias"]),
    "effect without noise": (["identify", "log.csv", "--effects", "rate_ramp"], ["rate_ramp"]),
    "effect twice": (["identify", "log.csv", "--effects", "white_noise,white_noise"], ["white_noise"]),
    "model to derive": (["derive", "perpetuum"], ["'perpetuum'", "ins15"]),
    "model to audit": (["audit", "perpetuum"], ["'perpetuum'", "ins15"]),
    "model to run": (["run", "perpetuum", "log.csv"], ["'perpetuum'", "ins15"]),
    "model of a gap": (["gap", "log.csv", "--model", "perpetuum"], ["'perpetuum'", "ins15"]),
    "model to emit": (["emit", "perpetuum", "--target", "c", "-o", "out"], ["'perpetuum'", "ins15"]),
    "model to simulate": (["simulate", "perpetuum", "-o", "sim.csv"], ["'perpetuum'", "ins15"]),
    "target": (["emit", "gyro-static", "--target", "cobol", "-o", "out"], ["'cobol'", "filterpy"]),
    "format": (["derive", "gyro-static", "--format", "rtf"], ["'rtf'", "latex"]),
    "order": (["derive", "gyro-static", "--order", 7], ["7", "1, 2 or 3"]),
    "step too long": (
        ["emit", "gyro-static", "--target", "c", "-o", "out", "--max-step", 1e6],
        ["--max-step"],
    ),
    "step negative": (["emit", "gyro-static", "--target", "c", "-o", "out", "--max-step=-1"], ["step"]),
    "step zero": (["emit", "gyro-static", "--target", "c", "-o", "out", "--max-step", 0], ["step"]),
    "step nan": (["emit", "gyro-static", "--target", "c", "-o", "out", "--max-step", "nan"], ["step"]),
    "manoeuvre": (["simulate", "ahrs6", "--manoeuvre", "looping", "-o", "sim.csv"], ["'looping'", "static"]),
    "manoeuvre to audit": (["audit", "ahrs6", "--manoeuvre", "looping"], ["'looping'", "static"]),
    "duration zero": (["simulate", "gyro-static", "--duration", 0, "-o", "sim.csv"], ["--duration"]),
    "duration negative": (["simulate", "gyro-static", "--duration=-3", "-o", "sim.csv"], ["--duration"]),
    "duration nan": (["simulate", "gyro-static", "--duration", "nan", "-o", "sim.csv"], ["--duration"]),
    "duration beyond counting": (
        ["simulate", "gyro-static", "--duration", 1e300, "-o", "sim.csv"],
        ["duration"],
    ),
    "seed negative": (["simulate", "gyro-static", "--seed=-1", "-o", "sim.csv"], ["seed"]),
    "suffix to simulate": (["simulate", "gyro-static", "--duration", 1, "-o", "sim.xyz"], ["'.xyz'"]),
    "noise file gone": (["derive", "gyro-static", "--noise", "gone.toml"], ["gone.toml", "no such file"]),
    "noise is a log": (["derive", "gyro-static", "--noise", "log.csv"], ["log.csv", "TOML"]),
    "run without inputs": (["run", "ahrs6", "log.csv"], ["log.csv", "gyro_y"]),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_a_wrong_option_is_refused(case: str, refused: Callable[..., str]) -> None:
    words, expected = OPTIONS[case]
    put(rows())
    said = refused(*words)
    for word in expected:
        assert word in said


@pytest.mark.parametrize(
    "words",
    [
        ["identify", "log.csv", "--no-such-option"],
        ["identify", "log.csv", "--rate", "fast"],
        ["identify"],
        ["plan", "noise.toml", "another.toml"],
        ["frobnicate"],
        ["emit", "gyro-static", "-o", "out"],
        ["gap", "log.csv"],
    ],
)
def test_wrong_usage_has_exit_status_2(words: list[str], kfgen: Cli) -> None:
    put(rows())
    before = everything()
    result = kfgen(*words)
    assert result.exit_code == 2
    assert result.stderr
    assert everything() == before


OUTPUTS = {
    "noise": ["identify", "log.csv", "-o", "nowhere/noise.toml"],
    "json": ["identify", "log.csv", "--json", "nowhere/a.json"],
    "page": ["list", "--report", "nowhere/page.html"],
    "npz": ["simulate", "gyro-static", "--duration", 1, "-o", "nowhere/sim.npz"],
    "csv": ["simulate", "gyro-static", "--duration", 1, "-o", "nowhere/sim.csv"],
}


@pytest.mark.parametrize("case", OUTPUTS)
def test_an_output_folder_that_does_not_exist_is_named(case: str, refused: Callable[..., str]) -> None:
    put(rows())
    said = refused(*OUTPUTS[case])
    assert "nowhere" in said
    assert "does not exist" in said


def test_a_refused_output_leaves_the_old_one_as_it_was(refused: Callable[..., str]) -> None:
    noise()
    refused("identify", put(rows(20)), "-o", "noise.toml")


# A gap.


GAPS = {
    "no shared channel": ({"channel": "accel_x"}, [], ["log.csv", "accel_x", "gyro_x"]),
    "no white noise": ({"effects": '{effect="rate_random_walk", K=1e-5}'}, [], ["gyro_x", "white_noise"]),
    "white noise of zero": ({"effects": '{effect="white_noise", N=0}'}, [], ["gyro_x", "white"]),
    "no effect": ({"effects": ""}, [], ["gyro_x", "white_noise"]),
    "other dimension": ({"unit": "m/s^2"}, [], ["gyro_x", "m/s^2"]),
    "channel of neither": ({}, ["--channels", "gyro_z"], ["'gyro_z'"]),
}


@pytest.mark.parametrize("case", GAPS)
def test_a_gap_that_cannot_be_asked_for_is_refused(case: str, refused: Callable[..., str]) -> None:
    given, options, words = GAPS[case]
    put(rows())
    noise(**given)
    said = refused("gap", "log.csv", "--model", "noise.toml", "-o", "better.toml", *options)
    for word in words:
        assert word in said


def test_a_library_model_that_shares_no_channel_is_refused(refused: Callable[..., str]) -> None:
    path = put(rows(header="t [s],pressure [hPa]"))
    said = refused("gap", path, "--model", "ahrs6")
    assert path in said
    assert "pressure" in said


@pytest.mark.parametrize(("n", "word"), [(100, "100 samples"), (255, "255 samples")])
def test_a_gap_needs_more_samples_than_a_fit(n: int, word: str, refused: Callable[..., str]) -> None:
    assert word in refused("gap", put(rows(n)), "--model", noise())


def test_a_gap_of_a_constant_channel_is_refused(refused: Callable[..., str]) -> None:
    path = put([rows()[0], *(f"{k / 100:.2f},5.0" for k in range(300))])
    assert "never changes" in refused("gap", path, "--model", noise())


def test_a_model_whose_channel_has_another_dimension_is_refused(refused: Callable[..., str]) -> None:
    said = refused("derive", "ahrs6", "--noise", noise(unit="m/s^2", effects=WHITE))
    assert "gyro_x" in said


def test_a_channel_name_that_no_noise_file_can_carry_leaves_no_broken_one(kfgen: Cli) -> None:
    result = kfgen("identify", put(rows(header="t [s],gyro x [deg/s]")), "-o", "noise.toml")
    if result.exit_code == 0:
        assert kfgen("derive", "gyro-static", "--noise", "noise.toml").exit_code == 0
    else:
        assert result.exit_code == 2
        assert not Path("noise.toml").exists()


# Folders of emitted filters.


@pytest.fixture(scope="module")
def emitted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """The files of an emitted filter for each target."""
    from kfgen.emit.folder import write_folder
    from kfgen.emit.routines import Program
    from kfgen.model.discretise import DiscreteModel
    from kfgen.model.library import build

    made = {}
    program = Program(DiscreteModel(build("gyro-static")))
    for target in ("c", "filterpy"):
        folder = tmp_path_factory.mktemp("emitted") / "f"
        write_folder(program, target, None, folder)
        made[target] = {
            p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8")
            for p in folder.rglob("*")
            if p.is_file()
        }
    return made


def unpack(files: dict[str, str], /, **manifest: object) -> str:
    """The files in a folder ``f``, its manifest changed."""
    Path("f").mkdir()
    for name, text in files.items():
        Path("f", name).parent.mkdir(exist_ok=True)
        Path("f", name).write_text(text, encoding="utf-8")
    if manifest:
        changed = {**json.loads(files["kfgen.json"]), **manifest}
        Path("f", "kfgen.json").write_text(json.dumps(changed), encoding="utf-8")
    return "f"


def test_the_good_folder_is_accepted(emitted: dict[str, dict[str, str]], kfgen: Cli) -> None:
    assert kfgen("verify", unpack(emitted["filterpy"])).exit_code == 0


def test_emit_does_not_touch_a_folder_of_other_files(refused: Callable[..., str]) -> None:
    Path("mine").mkdir()
    Path("mine", "thesis.tex").write_text("years of work", encoding="utf-8")
    said = refused("emit", "gyro-static", "--target", "c", "-o", "mine")
    assert "thesis.tex" in said
    assert "mine" in said


def test_emit_does_not_touch_another_file_beside_its_own(
    emitted: dict[str, dict[str, str]], refused: Callable[..., str]
) -> None:
    folder = unpack(emitted["c"])
    Path(folder, "thesis.tex").write_text("years of work", encoding="utf-8")
    assert "thesis.tex" in refused("emit", "gyro-static", "--target", "c", "-o", folder)


def test_emit_onto_a_file_is_refused(refused: Callable[..., str]) -> None:
    assert "log.csv" in refused("emit", "gyro-static", "--target", "c", "-o", put(rows()))


@pytest.mark.parametrize("name", ["gone", "empty", "log.csv"])
def test_verify_of_what_is_no_emitted_filter_is_refused(name: str, refused: Callable[..., str]) -> None:
    put(rows())
    Path("empty").mkdir()
    assert name in refused("verify", name)


GARBLED = {
    "empty": "",
    "cut off": "{",
    "a list": "[]",
    "a number": "3",
    "null": "null",
    "no files": '{"format": "kfgen-manifest-1"}',
    "files a text": '{"format": "kfgen-manifest-1", "files": "abc"}',
    "no format": '{"files": []}',
    "binary": "\x00",
    "nested deeply": "[" * 50000,
}
EMIT = ["emit", "gyro-static", "--target", "c", "-o"]


@pytest.mark.parametrize("case", GARBLED)
@pytest.mark.parametrize("command", [["verify"], EMIT], ids=["verify", "emit"])
def test_a_garbled_manifest_is_refused(
    case: str, command: list[str], emitted: dict[str, dict[str, str]], refused: Callable[..., str]
) -> None:
    folder = unpack({**emitted["c"], "kfgen.json": GARBLED[case]})
    assert "kfgen.json" in refused(*command, folder)


@pytest.mark.parametrize("entry", [["a"], {}, None, 3])
def test_emit_over_a_manifest_whose_files_are_no_names_is_refused(
    entry: object, emitted: dict[str, dict[str, str]], refused: Callable[..., str]
) -> None:
    assert refused(*EMIT, unpack(emitted["c"], files=[entry]))


MANIFEST = {
    "model unknown": {"model": "perpetuum"},
    "model a list": {"model": [1]},
    "another hash": {"model_hash": "0" * 64},
    "no hash": {"model_hash": None},
    "order a word": {"order": "first"},
    "order 7": {"order": 7},
    "rate null": {"rate": None},
    "rate zero": {"rate": 0},
    "step null": {"max_step": None},
    "step nan": {"max_step": float("nan")},
    "noise that is not there": {"noise": True},
    "target unknown": {"target": "cobol"},
    "target null": {"target": None},
}


@pytest.mark.parametrize("case", MANIFEST)
def test_a_manifest_with_a_wrong_entry_is_refused(
    case: str, emitted: dict[str, dict[str, str]], refused: Callable[..., str]
) -> None:
    folder = unpack(emitted["c"], **MANIFEST[case])
    assert refused("verify", folder)


@pytest.mark.parametrize("target", ["c", "filterpy"])
def test_a_core_that_is_not_known_is_refused(
    target: str, emitted: dict[str, dict[str, str]], refused: Callable[..., str]
) -> None:
    said = refused("verify", unpack(emitted[target]), "--core", "abacus")
    assert "'abacus'" in said
    assert "m4f" in said


# Through a real process.


def process(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "from kfgen.cli import main; main()", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


PROCESS = {
    "missing file": ["identify", "gone.csv", "-o", "noise.toml"],
    "word in a cell": ["identify", "word.csv", "-o", "noise.toml"],
    "nan in a channel": ["gap", "nan.csv", "--model", "walk.toml", "-o", "better.toml"],
    "no such output folder": ["simulate", "gyro-static", "--duration", 1, "-o", "nowhere/sim.npz"],
    "output is a folder": ["simulate", "gyro-static", "--duration", 1, "-o", "taken.csv"],
    "other files": ["emit", "gyro-static", "--target", "c", "-o", "."],
    "no emitted filter": ["verify", "."],
    "gap without white noise": ["gap", "log.csv", "--model", "walk.toml", "-o", "better.toml"],
}


@pytest.mark.parametrize("case", in_part(PROCESS))
def test_one_message_exit_status_2_and_nothing_left(case: str) -> None:
    put(rows())
    put(changed(5, "0.03,oops"), "word.csv")
    put(changed(5, "0.03,nan"), "nan.csv")
    noise(effects='{effect="rate_random_walk", K=1e-5}', name="walk.toml")
    Path("empty.csv").touch()
    Path("taken.csv").mkdir()
    before = everything()
    done = process(*PROCESS[case])
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("kfgen: ")
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
    assert everything() == before


def test_an_unknown_option_has_exit_status_2_and_no_traceback() -> None:
    done = process("identify", "log.csv", "--no-such-option")
    assert done.returncode == 2
    assert "--no-such-option" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
