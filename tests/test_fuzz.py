"""Hostile inputs over the command line, of a fixed seed: no exception but kfgen's own, no hang, no number that is none.

Files are made by their structure and then damaged: cells, headers, units, keys, bytes. Options take values from a list
of hostile ones. The short part is in ``make test``; the long part, ``KFGEN_FUZZ`` inputs (2,000), in ``make test-long``.
A command may refuse (exit status 2, one message with a remedy) or answer (0 or 1, without nan or inf, in 10 s).
"""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from typer.testing import Result

Cli = Callable[..., Result]

SHORT_INPUTS = 120
LONG_INPUTS = int(os.environ.get("KFGEN_FUZZ", "2000"))
LIMIT_S = 10
"""Seconds of the processor that a small input may take."""
NO_NUMBER = re.compile(r"(?<![\w.'])[-+]?(nan|inf|infinity)(?![\w'])", re.I)
NUMBERS = (
    "0",
    "-1",
    "1e-300",
    "1e300",
    "nan",
    "inf",
    "-inf",
    "1e-9",
    "3",
    "1e9",
    "0x10",
    "",
    "1_0",
    "9" * 400,
)
UNITS = (
    "",
    "1",
    "deg/s",
    "m/s^2",
    "rad/s/sqrt(Hz)",
    "m^-9",
    "m^1e9",
    "furlong",
    "g/0",
    "%",
    "sqrt(m)",
    "((m",
    "Hz^999",
    "degC",
    "\u00b0/\u221ah",
)
NAMES = (
    "t",
    "gyro_x",
    "accel_y",
    "temperature",
    "ref_q_w",
    "tau",
    "adev",
    "",
    "#1",
    "a b",
    "\x1b[31m",
    "gyro_x",
    "mag_z",
)
FORMULAS = (
    "theta", "u - theta**0.5", "1/theta", "exp(exp(u))", "theta/0", "atan2(0, theta)", "-" * 70 + "u", "min(u", "__import__('os')",
    "9**9**9", "sin(t)", "log(-1)", "sqrt(u)", "max(u, theta)", "sign(theta)", "1e999", "theta if u else 0",
)  # fmt: skip
EFFECTS = (
    "white_noise",
    "gauss_markov",
    "sinusoid",
    "bias",
    "temperature",
    "outliers",
    "gremlin",
    "quantisation",
    "scale_factor",
)
PARAMETERS = (
    "N",
    "sigma",
    "tau",
    "K",
    "Q",
    "R",
    "B",
    "coefficient",
    "amplitude",
    "frequency",
    "phase",
    "x",
    "sd",
    "share",
    "size",
)
MODEL = """
format = "kfgen-model-1"
name = "p"
[states]
theta = {{ unit = "{}", initial = "{} rad", sd = "{} rad" }}
[inputs]
u = "rad/s"
[dynamics]
theta = "{}"
[measurements.angle]
unit = "rad"
expression = "{}"
effects = [ {{ effect = "{}", {} = {} }} ]
"""


class Inputs:
    """Commands with the files that they need, from random numbers."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def pick(self, values: tuple[str, ...]) -> str:
        return values[int(self.rng.integers(len(values)))]

    def often(self, good: str, values: tuple[str, ...], share: float = 0.3) -> str:
        """The good value mostly, one of the hostile ones now and then."""
        return self.pick(values) if self.rng.random() < share else good

    def damaged(self, data: bytes) -> bytes:
        """Bytes changed, cut out or doubled, sometimes."""
        if self.rng.random() < 0.7 or len(data) < 4:
            return data
        out = bytearray(data)
        for _ in range(int(self.rng.integers(1, 6))):
            a, b = sorted(int(v) for v in self.rng.integers(0, len(out), 2))
            what = int(self.rng.integers(4))
            if what == 0:
                out[a] = int(self.rng.integers(256))
            elif what == 1 and b - a < len(out) - 4:
                del out[a:b]
            elif what == 2:
                out[a:a] = out[a : min(b, a + 40)]
            else:
                out[a:a] = self.pick(("\x00", "\xff", "[[", '"""', "\n\n", ",,,", "e999", "\u202e")).encode()
        return bytes(out)

    def log(self) -> str:
        n = int(self.rng.choice([0, 1, 3, 64, 260, 300]))
        names = [self.often(g, NAMES, 0.15) for g in ("t", "gyro_x", "accel_y")]
        units = [self.often(g, UNITS, 0.1) for g in ("s", "deg/s", "m/s^2")]
        scale = 10.0 ** self.rng.uniform(-30, 30, 2) if self.rng.random() < 0.2 else np.ones(2)
        y = self.rng.standard_normal((n, 2)) * scale
        if self.rng.random() < 0.2:
            y[self.rng.random(y.shape) < 0.3] = np.nan
        if self.rng.random() < 0.1:
            y[:] = np.round(y)
        step = float(self.rng.choice([0.01, 0.01, 0.01, 1e-9, 1e6]))
        t = np.cumsum(
            np.full(n, step) * (1.0 + 0.2 * self.rng.standard_normal(n) * (self.rng.random() < 0.2))
        )
        cells = [[f"{v:.9g}" for v in row] for row in np.column_stack([t, y])]
        for row in cells:
            if self.rng.random() < 0.01:
                row[int(self.rng.integers(3))] = self.pick(NUMBERS)
        head = ",".join(f"{a} [{u}]" for a, u in zip(names, units))
        return self.put("log.csv", "\n".join([head, *map(",".join, cells)]) + "\n")

    def npz(self) -> str:
        kinds = ("f8", "f4", "i2", "U3", "c8", "?", "M8[s]")
        shapes = [(300, 3), (300,), (0, 3), (), (2, 2, 2), (300, 1)]
        shape = shapes[int(self.rng.integers(len(shapes)))]
        arrays = {
            self.pick(("gyr", "acc", "t", "fs", "meta", "kfgen_units", "quat")): (
                100.0 * self.rng.standard_normal(shape)
            )
            .astype("i8" if "M8" in (kind := self.often("f8", kinds)) else "f8")
            .astype(kind)
            for _ in range(3)
        }
        np.savez(Path("log.npz"), **arrays)
        Path("log.npz").write_bytes(self.damaged(Path("log.npz").read_bytes()))
        return "log.npz"

    def noise(self) -> str:
        value = self.often("1e-3", tuple(f'"{n} {u}"' for n, u in zip(NUMBERS, UNITS)) + NUMBERS[:10])
        effect, parameter = self.often("white_noise", EFFECTS), self.often("N", PARAMETERS, 0.2)
        unit = self.often("deg/s", UNITS, 0.1)
        text = f'format = "kfgen-noise-1"\n[gyro_x]\nunit = "{unit}"\neffects = [{{effect="{effect}", {parameter}={value}}}]\n'
        return self.put("n.toml", text)

    def model(self) -> str:
        formula, seen = self.often("u - theta", FORMULAS, 0.5), self.often("theta", FORMULAS, 0.3)
        given = (
            self.often("rad", UNITS, 0.1),
            self.often("0", NUMBERS, 0.1),
            self.often("0.1", NUMBERS, 0.1),
        )
        effect = (
            self.often("white_noise", EFFECTS, 0.1),
            self.often("N", PARAMETERS, 0.1),
            self.often("1e-3", NUMBERS, 0.1),
        )
        return self.put("p.toml", MODEL.format(*given, formula, seen, *effect))

    def put(self, name: str, text: str) -> str:
        Path(name).write_bytes(self.damaged(text.encode("utf-8", "replace")))
        return name

    def command(self) -> list[str]:
        """A command with its files written."""
        number, unit = self.often("100", NUMBERS, 0.7), self.pick(UNITS)
        makers: tuple[Callable[[], list[str]], ...] = (
            lambda: ["identify", self.log(), "--effects", self.often("white_noise", EFFECTS)],
            lambda: ["identify", self.log(), "--rate", number, "--effects", "white_noise"],
            lambda: ["identify", self.log(), "--columns", f"gyro_x=#{self.pick(NUMBERS)} [{unit}]", "--effects", "white_noise"],
            lambda: ["identify", self.npz(), "--effects", "white_noise"],
            lambda: ["run", "gyro-static", self.log(), "--noise", self.noise()],
            lambda: ["plan", self.noise(), "--rate", number],
            lambda: ["plan", self.noise(), "--wanted", number],
            lambda: ["convert", self.noise(), "--to", "table", "--safety", number],
            lambda: ["derive", "gyro-static", "--noise", self.noise(), "--rate", number],
            lambda: ["derive", self.model()],
            lambda: ["audit", self.model(), "--duration", self.often("1", NUMBERS)],
            lambda: ["simulate", self.model(), "-o", "s.csv", "--duration", self.often("1", NUMBERS, 0.2)],
            lambda: ["simulate", "gyro-static", "--noise", self.noise(), "-o", "s.csv", "--duration", "1", "--rate", number],
            lambda: ["emit", self.model(), "--target", "numpy", "-o", "code", "--json", "a.json"],
            lambda: ["denoise", self.log(), "--filter", "kf", "--window", self.pick(("0", "1", "15", "-3", "999999"))],
        )  # fmt: skip
        return makers[int(self.rng.integers(len(makers)))]()


class Hang(BaseException):
    """A command that takes too long."""


def _alarm(_: int, __: FrameType | None) -> None:
    raise Hang


@pytest.fixture
def in_time() -> Iterator[None]:
    before = signal.signal(signal.SIGPROF, _alarm)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    signal.signal(signal.SIGPROF, before)


def fuzz(kfgen: Cli, count: int, seed: int, seconds: float = np.inf) -> list[str]:
    """What went wrong with `count` inputs: the command and what happened."""
    inputs, wrong, until = Inputs(seed), [], time.process_time() + seconds
    for k in range(count):
        if time.process_time() > until:
            break
        words = inputs.command()
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        try:
            done = kfgen(*words)
            if done.exit_code not in (0, 1, 2):
                wrong.append(f"{k} {words}: exit status {done.exit_code}")
            if done.exit_code != 2 and (match := NO_NUMBER.search(done.stdout)):
                wrong.append(f"{k} {words}: says {match.group()}")
            if done.exit_code == 2 and not str(done.exception):
                wrong.append(f"{k} {words}: refuses without a word")
        except Hang:
            wrong.append(f"{k} {words}: hangs")
        except Exception as error:
            wrong.append(f"{k} {words}: {type(error).__name__}: {error}"[:400])
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
    return wrong


def test_hostile_inputs(kfgen: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_time: None) -> None:
    monkeypatch.chdir(tmp_path)
    assert fuzz(kfgen, SHORT_INPUTS, 20261122, seconds=15.0) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_many_hostile_inputs(
    seed: int, kfgen: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_time: None
) -> None:
    monkeypatch.chdir(tmp_path)
    assert fuzz(kfgen, LONG_INPUTS // 4, seed) == []
