"""Hostile inputs from random numbers: what people write and break in files, options, units and formulas.

`Hostile` has the pieces, `Commands` whole commands with their files, `Texts` what parsers take, `Files` logs of every
format, damaged. Each draws all from one generator: a seed gives the same inputs again.
"""

from __future__ import annotations

import gzip
import io
import json
import lzma
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

NO_NUMBER = re.compile(r"(?<![\w.'])[-+]?(nan|inf|infinity)(?![\w'])", re.I)
"""A number that is none, in words on a terminal."""
NUMBERS = (
    *("0", "-1", "1e-300", "1e300", "nan", "inf", "-inf", "1e-9", "3", "1e9", "0x10", "", "1_0", "9" * 400),
)
UNITS = (
    *("", "1", "deg/s", "m/s^2", "rad/s/sqrt(Hz)", "m^-9", "m^1e9", "furlong", "g/0", "%", "sqrt(m)", "((m"),
    *("Hz^999", "degC", "\u00b0/\u221ah"),
)
NAMES = (
    *(
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
    ),
    "mag_z",
)
FORMULAS = (
    *(
        "theta",
        "u - theta**0.5",
        "1/theta",
        "exp(exp(u))",
        "theta/0",
        "atan2(0, theta)",
        "-" * 70 + "u",
        "min(u",
    ),
    *("__import__('os')", "9**9**9", "sin(t)", "log(-1)", "sqrt(u)", "max(u, theta)", "sign(theta)", "1e999"),
    "theta if u else 0",
)
EFFECTS = (
    *(
        "white_noise",
        "gauss_markov",
        "sinusoid",
        "bias",
        "temperature",
        "outliers",
        "gremlin",
        "quantisation",
    ),
    "scale_factor",
)
PARAMETERS = (
    *("N", "sigma", "tau", "K", "Q", "R", "B", "coefficient", "amplitude", "frequency", "phase", "x", "sd"),
    *("share", "size"),
)
TOKENS = (
    *(
        "deg",
        "s",
        "m",
        "g",
        "Hz",
        "sqrt",
        "(",
        ")",
        "/",
        "*",
        "^",
        "-",
        "2",
        "1.5",
        "0",
        "1e9",
        "h",
        "uT",
        " ",
        "%",
    ),
    *("rad", "K", "degC", "1/2", "\u221a", "N", "V", "**", ".", ",", "u", "milli"),
)
"""Pieces of units."""
SYMBOLS = (
    *(
        "theta",
        "u",
        "t",
        "1",
        "0",
        "2.5",
        "1e300",
        "1e-300",
        "+",
        "-",
        "*",
        "/",
        "**",
        "(",
        ")",
        ",",
        "sin(",
        "exp(",
    ),
    *(
        "log(",
        "sqrt(",
        "min(",
        "max(",
        "atan2(",
        "sign(",
        "abs(",
        "tanh(",
        "lambda",
        "[",
        "omega",
        "=",
        ".",
        "\n",
    ),
)
"""Pieces of formulas."""
MODEL = """
format = "kfgen-model-1"
name = "pendulum"
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
FILTER = """
format = "kfgen-filter-1"
name = "{}"
model = "{}"
sensors = [{}]
[options]
delay = "{}"
[initial]
heading = {{ value = "{}", sd = "{}" }}
[noise.gyro_x]
unit = "{}"
effects = [ {{ effect = "{}", {} = {}, as = "{}" }} ]
"""
MANOEUVRE = """
format = "kfgen-manoeuvre-1"
name = "{}"
[[segment]]
duration = "{}"
rate = ["{}", "{}", 0]
acceleration = ["{}", 0, {}]
"""


class Hostile:
    """Pieces that are mostly right and now and then hostile."""

    def __init__(self, seed: int | list[int]) -> None:
        self.rng = np.random.default_rng(seed)

    def pick(self, values: tuple[str, ...]) -> str:
        return values[int(self.rng.integers(len(values)))]

    def often(self, good: str, values: tuple[str, ...], share: float = 0.3) -> str:
        """The good value mostly, one of the hostile ones now and then."""
        return self.pick(values) if self.rng.random() < share else good

    def damaged(self, data: bytes, untouched: float = 0.7) -> bytes:
        """Bytes changed, cut out or doubled, but for a share that stays as it is."""
        if self.rng.random() < untouched or len(data) < 4:
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

    def some(self, pieces: tuple[str, ...], most: int) -> str:
        """A few pieces in a row."""
        return "".join(self.pick(pieces) for _ in range(int(self.rng.integers(1, most))))


class Texts(Hostile):
    """What each parser of text takes."""

    def broken(self, text: str) -> str:
        """Text whose bytes were damaged, sometimes."""
        return self.damaged(text.encode("utf-8", "replace"), 0.5).decode("utf-8", "replace")

    def unit(self) -> str:
        return self.broken(self.some(TOKENS, 8))

    def quantity(self) -> str:
        return f"{self.often('1.5', NUMBERS, 0.5)} {self.often('deg/s', UNITS, 0.5)}"

    def formula(self) -> str:
        return self.broken(self.often(self.some(SYMBOLS, 12), FORMULAS, 0.3))

    def noise(self) -> str:
        value = self.often("1e-3", tuple(f'"{n} {u}"' for n, u in zip(NUMBERS, UNITS)) + NUMBERS[:10])
        effect, parameter = self.often("white_noise", EFFECTS), self.often("N", PARAMETERS, 0.2)
        unit = self.often("deg/s", UNITS, 0.1)
        return (
            f'format = "kfgen-noise-1"\n[gyro_x]\nunit = "{unit}"\n'
            f'effects = [{{effect="{effect}", {parameter}={value}}}]\n'
        )

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
        return MODEL.format(*given, formula, seen, *effect)

    def filter(self) -> str:
        return FILTER.format(
            self.often("f", NAMES, 0.1),
            self.often("ahrs6", ("ins15", "ins99", "", "../x"), 0.2),
            self.often('"mag"', ('"gremlin"', "3", "", '"mag", "mag"'), 0.2),
            self.quantity(),
            self.often("30 deg", NUMBERS, 0.2),
            self.often("5 deg", NUMBERS, 0.2),
            self.often("rad/s", UNITS, 0.1),
            self.often("white_noise", EFFECTS, 0.2),
            self.often("N", PARAMETERS, 0.2),
            self.often("1e-4", NUMBERS[:11], 0.2),
            self.often("known", ("state", "gremlin", ""), 0.3),
        )

    def manoeuvre(self) -> str:
        formulas = ("0", "sin(t)", "t**2", *FORMULAS, *NUMBERS)
        return MANOEUVRE.format(
            self.often("m", NAMES, 0.1),
            self.often("2 s", NUMBERS, 0.2),
            *(self.pick(formulas) for _ in range(3)),
            self.often("0", NUMBERS[:11], 0.2),
        )


class Files(Hostile):
    """Logs of every format that is read, damaged; each maker gives the suffix and the bytes."""

    def table(self) -> tuple[list[str], np.ndarray]:
        """Names with units and a few rows."""
        n = int(self.rng.choice([0, 1, 3, 12]))
        names = [self.often(g, NAMES, 0.1) for g in ("t", "gyro_x", "accel_y")]
        units = [self.often(g, UNITS, 0.1) for g in ("s", "deg/s", "m/s^2")]
        y = self.rng.standard_normal((n, 3)) * 10.0 ** self.rng.uniform(-9, 9, 3)
        y[:, :1] = np.arange(n)[:, None] * 0.01
        return [f"{a} [{u}]" for a, u in zip(names, units)], y

    def csv(self) -> bytes:
        head, y = self.table()
        cells = [[f"{v:.6g}" for v in row] for row in y]
        for row in cells:
            if self.rng.random() < 0.1:
                row[int(self.rng.integers(3))] = self.pick(NUMBERS)
        mark = self.often(",", (";", "\t", " ", "|"), 0.2)
        return ("\n".join([mark.join(head), *map(mark.join, cells)]) + "\n").encode("utf-8", "replace")

    def json_lines(self) -> bytes:
        head, y = self.table()
        return "\n".join(json.dumps(dict(zip(head, row))) for row in y.tolist()).encode("utf-8", "replace")

    def npy(self) -> bytes:
        kind = self.often("f8", ("f4", "i2", "U3", "c8", "?", "M8[s]", "O"), 0.5)
        out = io.BytesIO()
        y = (100 * self.rng.standard_normal((4, 3))).astype("i8" if "M8" in kind else "f8")
        np.save(out, y.astype(kind), allow_pickle=True)
        return out.getvalue()

    def npz(self) -> bytes:
        out = io.BytesIO()
        keys = ("gyr", "acc", "t", "fs", "meta", "kfgen_units", "quat")
        np.savez(out, **{self.pick(keys): self.rng.standard_normal((8, 3)) for _ in range(3)})
        return out.getvalue()

    def pos(self) -> bytes:
        rows = [
            f"2024/01/01 00:00:{k:02d}.000  46.0 7.0 {400 + k}.0  1  9 0.01 0.01 0.02 0 0 0 0.0 1.0"
            for k in range(5)
        ]
        return (
            "% program   : RTKLIB\n%  GPST  latitude(deg) longitude(deg)  height(m)\n" + "\n".join(rows)
        ).encode()

    def gz(self) -> bytes:
        return gzip.compress(self.damaged(self.csv()), mtime=0)

    def xz(self) -> bytes:
        return lzma.compress(self.damaged(self.csv()), preset=0)

    def mat(self) -> bytes:
        from scipy.io import savemat

        out = io.BytesIO()
        savemat(out, {"t": np.arange(4) * 0.01, "gyr": self.rng.standard_normal((4, 3))})
        return out.getvalue()

    def file(self, kind: str) -> bytes:
        """A log of a format, its bytes damaged half of the time."""
        return self.damaged(getattr(self, kind)(), 0.5)


KINDS = {"csv": "csv", "json_lines": "jsonl", "npy": "npy", "npz": "npz", "pos": "pos", "gz": "csv.gz", "xz": "csv.xz", "mat": "mat"}  # fmt: skip
"""Formats that are made here, with the suffix of each."""


class Commands(Texts):
    """Commands with the files that they need."""

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

    def archive(self) -> str:
        kinds = ("f8", "f4", "i2", "U3", "c8", "?", "M8[s]")
        shapes = [(300, 3), (300,), (0, 3), (), (2, 2, 2), (300, 1)]
        shape = shapes[int(self.rng.integers(len(shapes)))]
        arrays: dict[str, Any] = {
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

    def put(self, name: str, text: str) -> str:
        Path(name).write_bytes(self.damaged(text.encode("utf-8", "replace")))
        return name

    def noise_file(self) -> str:
        return self.put("n.toml", self.noise())

    def model_file(self) -> str:
        return self.put("p.toml", self.model())

    def makers(self) -> tuple[Callable[[], list[str]], ...]:
        """What writes the files of a command and says its words."""
        number, unit = self.often("100", NUMBERS, 0.7), self.pick(UNITS)
        noise, model, log = self.noise_file, self.model_file, self.log
        return (
            lambda: ["identify", log(), "--effects", self.often("white_noise", EFFECTS)],
            lambda: ["identify", log(), "--rate", number, "--effects", "white_noise"],
            lambda: ["identify", log(), "--columns", f"gyro_x=#{self.pick(NUMBERS)} [{unit}]", "--effects", "white_noise"],
            lambda: ["identify", self.archive(), "--effects", "white_noise"],
            lambda: ["run", "gyro-static", log(), "--noise", noise()],
            lambda: ["plan", noise(), "--rate", number],
            lambda: ["plan", noise(), "--wanted", number],
            lambda: ["convert", noise(), "--to", "table", "--safety", number],
            lambda: ["derive", "gyro-static", "--noise", noise(), "--rate", number],
            lambda: ["derive", model()],
            lambda: ["audit", model(), "--duration", self.often("1", NUMBERS)],
            lambda: ["simulate", model(), "-o", "s.csv", "--duration", self.often("1", NUMBERS, 0.2)],
            lambda: ["simulate", "gyro-static", "--noise", noise(), "-o", "s.csv", "--duration", "1", "--rate", number],
            lambda: ["emit", model(), "--target", "numpy", "-o", "code", "--json", "a.json"],
            lambda: ["denoise", log(), "--filter", "kf", "--window", self.pick(("0", "1", "15", "-3", "999999"))],
        )  # fmt: skip

    def command(self) -> list[str]:
        """A command with its files written."""
        makers = self.makers()
        return makers[int(self.rng.integers(len(makers)))]()


class Comparisons(Commands):
    """Commands that take longer: logs against models, filters over logs, manoeuvres, fleets, calibrations."""

    def manoeuvre_file(self) -> str:
        return self.put("m.toml", self.manoeuvre())

    def makers(self) -> tuple[Callable[[], list[str]], ...]:
        """What writes the files of a command and says its words."""
        number, unit, name = self.often("100", NUMBERS, 0.3), self.pick(UNITS), self.pick(NAMES)
        noise, model, log = self.noise_file, self.model_file, self.log
        return (
            lambda: ["gap", log(), "--model", noise()],
            lambda: ["gap", log(), "--model", noise(), "--rate", number, "--channels", name],
            lambda: ["gap", log(), "--model", model()],
            lambda: ["gap", log(), "--model", "gyro-static"],
            lambda: ["gap", self.archive(), "--model", "ahrs6"],
            lambda: ["run", model(), log()],
            lambda: ["run", "gyro-static", log(), "--smooth"],
            lambda: ["run", "gyro-static", log(), "--tune", "-o", "tuned.toml"],
            lambda: ["run", "ahrs6", self.archive(), "--sensor", name],
            lambda: ["audit", "gyro-static", "--log", log()],
            lambda: ["audit", "ins15", "--manoeuvre", self.manoeuvre_file(), "--duration", "1", "--want", f"phi_D={number} {unit}"],
            lambda: ["simulate", "ahrs6", "--manoeuvre", self.manoeuvre_file(), "--duration", "1", "-o", "s.csv"],
            lambda: ["simulate", "ahrs6", "--duration", "1", "--vibration", f"{number} {unit}", "--decoy", name, "-o", "s.csv"],
            lambda: ["calibrate", self.archive(), "--turn", f"{number} {unit}", "--field", f"{self.pick(NUMBERS)} uT"],
            lambda: ["fleet", log(), "--jobs", "1", "--rate", number],
        )  # fmt: skip
