"""Effects hidden in real recordings of sensors at rest.

What is assumed is what ``kfgen identify`` and then ``kfgen gap`` make of a piece of a recording before anything is
hidden in it: without the hidden effect both agree. What is assumed about a piece already is not hidden in it. The size
that is worth a number of nats is reckoned over the piece's own periodogram. Before anything is hidden, samples are spread
evenly within a step of the recording's ADC grid, and afterwards rounded to it again: without a hidden effect they are
those that were stored. Thermometer and decoys are drawn as for records of sensors that never were.

The recordings are those of ``../shared/data`` (or of KFGEN_DATA); the world is empty where they are absent.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from case import Array, Case, Request
from effects import EFFECTS
from scipy.fft import dct
from sensor import THERMOMETER_NOISE, Recording, Sensor, climate

DATA = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")
LEFT_OUT = ("cross_axis_noise",)
"""Effects that need a second axis whose noise is known."""
BEFORE_THE_ADC = ("quantisation", "low_pass")
"""Effects that come before the converter: the samples of a coarse one, rounded twice, would lose them again."""
ROUNDS = 3
"""Times that the assumed model is updated until nothing is found in the piece as it is."""
WIDTH = 0.04
"""Half-width of the average over the periodogram, of the frequency."""
LEAST = 6
"""Ordinates to either side that it takes at least."""


@dataclass(frozen=True)
class Piece:
    """Part of a channel of a recording.

    Parameters
    ----------
    column : int
        Of the array; -1: it has one.
    scale : float
        From what is stored to `unit`.
    """

    file: str
    array: str
    column: int
    channel: str
    unit: str
    scale: float
    rate: float
    start: int
    count: int

    def stored(self) -> Array:
        """Samples as stored."""
        with np.load(DATA / f"{self.file}.npz") as recording:
            x = np.asarray(recording[self.array], dtype=np.float64)
        return (
            x[self.start : self.start + self.count, self.column]
            if x.ndim > 1
            else x[self.start :][: self.count]
        )


def pieces() -> list[Piece]:
    """Parts of the recordings that are there."""
    g = 9.80665
    out = [
        Piece("static/mpu6050_static_450s", array, k, f"{kind}_{'xyz'[k]}", unit, scale, 100.0, start, 14_000)
        for start in (300, 14_500, 28_700)
        for array, kind, unit, scale in (
            ("gyr_counts", "gyro", "deg/s", 1.0 / 131.0),
            ("acc_counts", "accel", "m/s^2", g / 16384.0),
        )
        for k in range(3)
    ]
    out += [
        Piece(
            "static/gyro_875mdps_warmup", "gyr_counts", -1, "gyro_x", "deg/s", 0.00875, 100.0, start, 24_000
        )
        for start in (120_000, 150_000, 180_000, 210_000)
    ]
    out += [
        Piece("static/tof_vl53l0x_1h", "dist_mm", -1, "range", "m", 1e-3, 55.6, start, 20_000)
        for start in (20_000, 120_000)
    ]
    return [p for p in out if (DATA / f"{p.file}.npz").is_file()]


def adc_step(y: Array) -> float:
    """The step of the values that occur."""
    steps = np.diff(np.unique(y))
    return float(steps[steps > 1e-6 * np.ptp(y)].min())


@dataclass(frozen=True, eq=False)
class Base(Sensor):
    """A piece as the sensor of records: its samples, their ADC grid, and what is assumed about them."""

    samples: Array | None = None
    step: float = 0.0
    text: str = ""

    def passed(self, n: int) -> Array:
        """All of it: nobody knows what came after the filter."""
        return self.spectrum(n)

    def spectrum(self, n: int) -> Array:
        """The periodogram, averaged over neighbours."""
        assert self.samples is not None
        P = np.square(dct(self.samples - self.samples.mean(), norm="ortho")[1:])
        total = np.concatenate([[0.0], np.cumsum(P)])
        k = np.arange(P.size)
        half = np.maximum(LEAST, (WIDTH * k).astype(int))
        lo, hi = np.maximum(k - half, 0), np.minimum(k + half + 1, P.size)
        return np.asarray((total[hi] - total[lo]) / (hi - lo))


@cache
def base_of(index: int) -> Base | None:
    """None where what is found in a piece has no end: it is no base for a hidden effect."""
    p = pieces()[index]
    y = p.stored() * p.scale
    text = _assumed(p, y)
    if not text:
        return None
    white = float(np.std(np.diff(y)) / np.sqrt(2.0))
    name = f"{Path(p.file).name}:{p.channel}:{p.start}"
    offset = float(np.median(y))
    return Base(
        name, p.channel, p.unit, p.rate, y.size, white, offset=offset,
        samples=y - offset, step=adc_step(y), text=text,
    )  # fmt: skip


def _assumed(p: Piece, y: Array) -> str:
    """The text of the noise file with which ``kfgen gap`` finds nothing in the piece; empty if there is none."""
    from typer.testing import CliRunner

    from kfgen.cli.app import app

    with tempfile.TemporaryDirectory() as folder:
        log, model, answer = (Path(folder) / name for name in ("log.csv", "model.toml", "answer.json"))
        head = f"t [s],{p.channel} [{p.unit}]"
        table = np.column_stack([np.arange(y.size) / p.rate, y])
        np.savetxt(log, table, fmt=["%.9f", "%.10g"], delimiter=",", header=head, comments="")
        CliRunner().invoke(app, ["identify", str(log), "-o", str(model)], catch_exceptions=False)
        for k in range(ROUNDS):
            updated = Path(folder) / f"updated{k}.toml"
            words = ["gap", str(log), "--model", str(model), "--json", str(answer), "-o", str(updated)]
            CliRunner().invoke(app, words, catch_exceptions=False)
            model = updated if updated.is_file() else model
            if json.loads(answer.read_text(encoding="utf-8"))["verdict"] == "no_gap":
                return model.read_text(encoding="utf-8")
    return ""


def requests(count: int, strengths: Sequence[float], nulls: int, seeds: np.random.Generator) -> list[Request]:
    """Every effect at every strength; null records: pieces as they are, with decoys."""
    if not pieces():
        print(f"no recordings in {DATA}: nothing to hide effects in", file=sys.stderr)
        return []
    names = [n for n in EFFECTS if n not in LEFT_OUT]
    out = [
        Request("real", "single", (name,), X, i, int(seeds.integers(2**47)))
        for X in strengths
        for name in names
        for i in range(count)
    ]
    return out + [Request("real", "null", (), 0.0, i, int(seeds.integers(2**47))) for i in range(nulls)]


def make(request: Request) -> Case:
    """Build one record."""
    rng = request.rng()
    base = None
    while base is None or any(f'"{name}"' in base.text for name in request.effects):
        base = base_of(int(rng.integers(len(pieces()))))
    assert base.samples is not None
    n = base.n
    temperature = climate(rng, n, base.dt)
    warmth = temperature + THERMOMETER_NOISE * rng.standard_normal(n)
    again = not set(request.effects) & set(BEFORE_THE_ADC)
    within = base.step * (np.random.default_rng([request.seed, 1]).random(n) - 0.5) if again else np.zeros(n)
    r = Recording(base, rng, n, base.samples + within, np.zeros(n), temperature, warmth)
    hidden = tuple(EFFECTS[name](r, request.strength) for name in request.effects)
    channels = r.channels()
    if again:
        steps = np.round((channels[base.channel][0] - base.offset) / base.step)
        channels[base.channel] = (base.offset + steps * base.step, base.unit)
    t = np.arange(n) * base.dt
    return Case(request, base.name, hidden, t, channels, base.text)
