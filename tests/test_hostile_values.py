"""Proves that values far from any sensor get one message, and that no number that is none leaves kfgen unexplained.

Each case ended in a traceback, a hang, or an answer of nan or inf with exit status 0.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hostile import MODEL, NO_NUMBER
from in_part import in_part
from typer.testing import Result

from kfgen.core.errors import InputError
from kfgen.core.linear import van_loan
from kfgen.core.terminal import ending_of, json_text, printable
from kfgen.core.units import parse_unit
from kfgen.report.identify import _bound

Cli = Callable[..., Result]
NOISE = 'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\neffects = [{effect="white_noise", N=1e-3}]\n'
MANOEUVRE = 'format = "kfgen-manoeuvre-1"\nname = "x"\n[[segment]]\nduration = "2 s"\n{}\n'
T = np.arange(1500) / 100.0


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("n.toml").write_text(NOISE, encoding="utf-8")


def log(y: np.ndarray, name: str = "log.csv", dt: float = 0.01) -> str:
    rows = np.column_stack([np.arange(y.size) * dt, y])
    np.savetxt(name, rows, delimiter=",", header="t [s],gyro_x [deg/s]", comments="", fmt="%.17g")
    return name


def white(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(T.size)


def refused(kfgen: Cli, *words: object) -> str:
    done = kfgen(*words)
    assert done.exit_code == 2, done.output
    assert done.stdout == ""
    assert isinstance(done.exception, InputError)
    assert done.exception.remedy
    return str(done.exception)


SMOOTH = {
    "ramp": T,
    "parabola": 3.0 + T**2,
    "sine": np.sin(T),
    "exponential": np.exp(T),
    "counter": np.arange(T.size, dtype=float),
}


@pytest.mark.parametrize("case", SMOOTH)
@pytest.mark.parametrize("words", [("identify",), ("gap", "--model", "n.toml")], ids=lambda w: w[0])
def test_a_series_without_noise_is_no_record(case: str, words: tuple[str, ...], kfgen: Cli) -> None:
    said = refused(kfgen, *words, log(SMOOTH[case]))
    assert "log.csv" in said
    assert "gyro_x" in said
    assert "no noise" in said


@pytest.mark.parametrize("size", [1e8, 1e-30])
def test_noise_far_from_the_model_is_not_compared(size: float, kfgen: Cli) -> None:
    """It is identified, and a gap says why there is nothing to compare: 27 s and 78 s before."""
    done = kfgen("identify", log(size * white()), "--json", "a.json")
    assert done.exit_code == 0
    assert not NO_NUMBER.search(done.stdout)
    said = refused(kfgen, "gap", "log.csv", "--model", "n.toml")
    assert "times what the model says" in said


@pytest.mark.long
def test_a_record_of_one_sample_in_eleven_days(kfgen: Cli) -> None:
    done = kfgen("gap", log(white(), dt=1e6), "--model", "n.toml")
    assert done.exit_code in (0, 1)
    assert not NO_NUMBER.search(done.stdout)


@pytest.mark.parametrize("share", [0.45, 0.5, 0.55])
def test_samples_lost_at_random_are_no_change_of_the_rate(share: float, kfgen: Cli) -> None:
    """The density is that of the samples that are there: 1 deg/s every 0.01 s, 0.1 deg/s/sqrt(Hz) within 8 %."""
    y = white(3)
    y[np.random.default_rng(1).random(y.size) < share] = np.nan
    done = kfgen("identify", log(y), "--effects", "white_noise", "--json", "a.json")
    assert done.exit_code == 0, done.exception
    effects = json.loads(Path("a.json").read_text("utf-8"))["channels"]["gyro_x"]["effects"]
    assert effects[0]["parameters"]["N"]["value"] == pytest.approx(np.radians(0.1), rel=0.08)


def test_a_channel_of_half_the_rate_keeps_its_own(kfgen: Cli) -> None:
    y = white(3)
    y[1::2] = np.nan
    done = kfgen("identify", log(y), "--effects", "white_noise", "--json", "a.json")
    assert json.loads(Path("a.json").read_text("utf-8"))["channels"]["gyro_x"]["rate_hz"] == pytest.approx(50)
    assert done.exit_code == 0


UNITS = [
    "m^1e99999999",
    "m^1e-99999999",
    "m^99999999",
    "((m^999)^999)^999",
    "m^(1/99999999)",
    "m" * 9999,
    "*".join("m" * 900),
]


@pytest.mark.parametrize("unit", UNITS, ids=lambda u: u[:20])
def test_a_unit_beyond_any_number_is_refused_at_once(unit: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_unit(unit)
    assert len(str(caught.value)) < 1500


OPTIONS = {
    "a column of many digits": ["identify", "log.csv", "--columns", "x=#" + "9" * 5000],
    "safety": ["convert", "n.toml", "--to", "table", "--safety", "1e308"],
    "no safety": ["convert", "n.toml", "--to", "table", "--safety", "1e-308"],
    "rate of a consumer": ["convert", "n.toml", "--to", "table", "--rate", "1e300"],
    "rate of a plan": ["plan", "n.toml", "--rate", "1e300"],
    "slow plan": ["plan", "n.toml", "--rate", "1e-300"],
    "accuracy of a plan": ["plan", "n.toml", "--wanted", "1e-300"],
    "length of an audit": ["audit", "ins15", "--duration", "1e300"],
    "rate of an audit": ["audit", "ins15", "--rate", "1e300"],
    "rate of a model": ["derive", "ins15", "--rate", "1e300"],
}


@pytest.mark.parametrize("case", OPTIONS)
def test_an_option_beyond_any_sensor_is_refused(case: str, kfgen: Cli) -> None:
    log(white())
    refused(kfgen, *OPTIONS[case])


def test_a_plan_for_a_noise_of_zero(kfgen: Cli) -> None:
    Path("n.toml").write_text(NOISE.replace("N=1e-3", "N=0"), encoding="utf-8")
    assert "n.toml" in refused(kfgen, "plan", "n.toml")


@pytest.mark.parametrize("size", ["1e300", "1e80 deg/s/sqrt(Hz)"])
def test_a_size_whose_square_is_no_number(size: str, kfgen: Cli) -> None:
    Path("n.toml").write_text(NOISE.replace("1e-3", f'"{size}"'), encoding="utf-8")
    assert "beyond anything that is measured" in refused(kfgen, "derive", "gyro-static", "--noise", "n.toml")


def test_a_short_audit_says_no_infinite_number(kfgen: Cli) -> None:
    done = kfgen("audit", "ins15", "--duration", 0.005, "--json", "a.json")
    assert done.exit_code == 0
    assert not NO_NUMBER.search(done.stdout)


@pytest.mark.parametrize(
    "formula",
    ["u - theta**0.5", "u - log(theta)", "u - sqrt(theta - 1)", "u - 2**2**2**2**2**(9*theta+1)", "u/theta"],
)
def test_an_equation_without_a_derivative_at_the_start(formula: str, kfgen: Cli) -> None:
    Path("p.toml").write_text(
        MODEL.format("rad", "0", "0.1", formula, "theta", "white_noise", "N", '"0.2 mrad/sqrt(Hz)"'),
        encoding="utf-8",
    )
    done = kfgen("audit", "p.toml")
    assert done.exit_code in (0, 2)
    assert not NO_NUMBER.search(done.stdout)
    if done.exit_code == 2:
        assert "p.toml" in str(done.exception) or "pendulum" in str(done.exception)


MANOEUVRES = {
    "start": 'start = "t"',
    "acceleration": 'acceleration = ["1e300 m/s^2", 0, 0]',
    "rate": 'rate = ["1e300", 0, 0]',
    "growing": 'acceleration = ["t**20*1e300", 0, 0]',
}


@pytest.mark.parametrize("case", MANOEUVRES)
@pytest.mark.parametrize("command", ["audit ins15", "simulate ins15 --duration 2 -o sim.csv"])
def test_a_manoeuvre_that_nothing_can_fly(case: str, command: str, kfgen: Cli) -> None:
    Path("m.toml").write_text(MANOEUVRE.format(MANOEUVRES[case]), encoding="utf-8")
    assert "m.toml" in refused(kfgen, *command.split(), "--manoeuvre", "m.toml")


def test_a_hundred_thousand_columns(kfgen: Cli) -> None:
    """31 s before; the message does not list them all."""
    n = 100_000
    rows = [",".join(f"c{k} [m]" for k in range(n)), *[",".join("1" * n)] * 2]
    Path("wide.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert len(refused(kfgen, "identify", "wide.csv", "--rate", 1, "--channels", "nothing")) < 1000


WIDE = [
    "gap wide.csv --model n.toml --rate 1",
    "denoise wide.csv --rate 1",
    "run ahrs6 log.csv --noise wide.toml",
]


@pytest.mark.parametrize("words", WIDE)
def test_a_message_does_not_list_a_thousand_channels(words: str, kfgen: Cli) -> None:
    names = [f"c{k}" for k in range(1000)]
    rows = [",".join(f"{c} [m]" for c in names), *[",".join("1" for _ in names)] * 2]
    Path("wide.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    noise = "".join(f'[{c}]\nunit = "m"\neffects = [{{effect="white_noise", N=1}}]\n' for c in names)
    Path("wide.toml").write_text('format = "kfgen-noise-1"\n' + noise, encoding="utf-8")
    log(white())
    assert len(refused(kfgen, *words.split())) < 1000


def test_a_model_without_white_noise_is_refused_before_anything_is_compared(
    kfgen: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two channels the second one's: the first was searched before, and all of nine in 31 s."""
    y = np.column_stack([T, white(), white(1)])
    np.savetxt("two.csv", y, delimiter=",", header="t [s],a [m],b [m]", comments="")
    noise = '[{}]\nunit = "m"\neffects = [{{effect="{}", {}=0.1}}]\n'
    text = noise.format("a", "white_noise", "N") + noise.format("b", "bias", "sd")
    Path("n.toml").write_text('format = "kfgen-noise-1"\n' + text, encoding="utf-8")
    monkeypatch.setattr("kfgen.gap.at_rest.channel_gap", lambda *_: pytest.fail("a channel was compared"))
    assert "the model of b has no white noise" in refused(kfgen, "gap", "two.csv", "--model", "n.toml")


def test_a_file_of_an_emitted_folder_that_the_user_changed_stays(kfgen: Cli) -> None:
    words = ["emit", "gyro-static", "--target", "c", "-o", "code"]
    assert kfgen(*words).exit_code == 0
    assert kfgen(*words).exit_code == 0
    changed = next(Path("code").rglob("*.c"))
    changed.write_text("/* my own */", encoding="utf-8")
    said = refused(kfgen, *words)
    assert changed.name in said
    assert "--force" in said
    assert changed.read_text("utf-8") == "/* my own */"
    assert kfgen(*words, "--force").exit_code == 0
    assert changed.read_text("utf-8") != "/* my own */"


@pytest.mark.parametrize(
    "key", in_part(["order", "max_step", "rate", "q_interval", "form", "real", "options", "model"])
)
@pytest.mark.parametrize("value", in_part([None, [], "x", -1e300, True]), ids=repr)
def test_a_manifest_with_null(key: str, value: object, kfgen: Cli) -> None:
    assert kfgen("emit", "gyro-static", "--target", "filterpy", "-o", "code").exit_code == 0
    manifest = json.loads(Path("code/kfgen.json").read_text("utf-8"))
    Path("code/kfgen.json").write_text(json.dumps(manifest | {key: value}), encoding="utf-8")
    done = kfgen("verify", "code")
    assert done.exit_code in (0, 2)


def test_dynamics_beyond_any_number_give_none() -> None:
    Phi, Qd = van_loan(np.array([[np.inf]]), np.eye(1), 0.1)
    assert np.isnan([Phi, Qd]).all()


def test_an_answer_with_a_number_that_is_none_is_not_given() -> None:
    with pytest.raises(InputError, match=r"channels.gyro_x\[1\]"):
        json_text({"channels": {"gyro_x": [1.0, float("nan")]}})


# What reaches the terminal.


def test_control_codes_of_a_file_do_not_reach_the_terminal(kfgen: Cli) -> None:
    assert printable("a\x1b[31m\x00\x9b\udcff\n\tb") == "a\\x1b[31m\\x00\\x9b\\udcff\n\tb"
    text = Path(log(white())).read_text("utf-8").replace("gyro_x", "gyro\x1b[31m_x")
    Path("log.csv").write_text(text, encoding="utf-8")
    done = kfgen("identify", "log.csv", "--effects", "white_noise")
    assert "\x1b" not in done.output


def process(*words: bytes | str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, "-c", "from kfgen.cli import main; main()", *words],
        capture_output=True,
        env={**os.environ, **environment},
        check=False,
    )


@pytest.mark.long
def test_a_name_that_is_no_utf8() -> None:
    Path(log(white())).rename(os.fsdecode(b"l\xff.csv"))
    done = process("identify", b"l\xff.csv", "--effects", "white_noise", "-o", "o.toml", "--report", "p.html")
    assert done.returncode == 0, done.stderr
    assert process("plan", "o.toml").returncode == 0
    done = process("identify", b"gone\xff.csv")
    assert done.returncode == 2
    assert done.stderr.startswith(b"kfgen: gone")
    assert b"Traceback" not in done.stderr


ENDINGS = {
    "a full disk": (OSError(28, "No space left on device", "/x/.a.json.abcdefg8.kfgen"), 2, "/x/a.json: "),
    "no memory": (MemoryError(), 2, "not enough memory"),
    "a defect": (ZeroDivisionError("by nothing"), 2, "defect of kfgen"),
    "Ctrl-C": (KeyboardInterrupt(), 130, ""),
    "bad input": (InputError("a\x1bb", where="c"), 2, "c: a\\x1bb"),
}


@pytest.mark.parametrize("case", ENDINGS)
def test_the_end_of_a_command_is_one_message(case: str) -> None:
    error, status, words = ENDINGS[case]
    try:
        raise error
    except BaseException as caught:
        found, message = ending_of(caught)
    assert found == status
    assert words in message
    assert "Errno" not in message
    assert ".kfgen" not in message.replace("--kfgen", "")
    assert "\n" not in message


def test_samples_whose_square_is_no_number_are_not_filtered(kfgen: Cli) -> None:
    y = white()
    y[700] = 1e300
    assert "beyond anything that is measured" in refused(kfgen, "denoise", log(y), "--filter", "kf")
    Path("n.toml").write_text(NOISE, encoding="utf-8")
    for command in ("run gyro-static log.csv --noise n.toml", "audit gyro-static --log log.csv"):
        assert "beyond anything that is measured" in refused(kfgen, *command.split())


def test_a_filter_whose_jacobian_is_nothing_over_nothing_at_the_start_is_emitted(kfgen: Cli) -> None:
    """The derivative of a speed at rest is 0/0; the gate of the emitted code sees to it, and no warning is shown."""
    text = MODEL.format(
        "rad", "0", "0.1", "u - theta", "sqrt(theta**2 + 0*theta)", "white_noise", "N", "1e-3"
    )
    Path("p.toml").write_text(text, encoding="utf-8")
    done = kfgen("emit", "p.toml", "--target", "numpy", "-o", "code", "--json", "a.json")
    assert done.exit_code == 0
    assert done.stderr == ""
    assert not NO_NUMBER.search(Path("a.json").read_text("utf-8"))


def test_a_bound_beyond_the_number_itself_is_none() -> None:
    """A parameter at its edge had "bound 6.9e+11 %"."""
    assert _bound(0.2) == "bound 20 %"
    assert _bound(6.9e9) == _bound(float("inf")) == "no bound: the record does not show it"


@pytest.mark.parametrize("exponent", [-600, 0, 600])
def test_a_driver_of_any_size_is_smoothed_alike(exponent: int) -> None:
    """A power of two changes no digit, though the squares of such numbers are none."""
    from kfgen.identify.evidence.smoothed import smoothed

    y = np.cumsum(np.random.default_rng(2).standard_normal(300))
    assert (smoothed(np.ldexp(y, exponent)) == np.ldexp(smoothed(y), exponent)).all()
    assert (smoothed(np.zeros(20)) == 0.0).all()
