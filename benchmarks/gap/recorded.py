"""Effects hidden in real recordings of sensors that a hand moves beside an optical attitude, and nothing hidden.

What is assumed of a sensor is its noise at rest, at the start of a trial, with what ``kfgen gap`` finds in the first part of
its motion, in a few rounds. The second part, which none of that saw, is the case: as it is, or with an effect planted in its
readings. Of a part as it is, every name is one too many.

What is planted adds to the sensor's own errors, which nobody knows. So the same is planted in the first part, too, and an
interval is held against what was found there, with its standard deviation: what is the sensor's own is in both.

The recordings are trials of BROAD (D. Laidig et al., Data 6(7):72, 2021, CC BY 4.0) in ``../shared/data`` (or KFGEN_DATA);
the world is empty where they are absent.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from case import OBVIOUS, Array, Case, Hidden, Request
from real import DATA, adc_step
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

AXES = "xyz"
REST_S, FIRST_S, SECOND_S = (1.0, 28.0), (38.0, 97.0), (97.0, 154.0)
"""Parts of a trial [s]: at rest, in motion, in motion."""
ROUNDS = 2
"""Times that the assumed model is updated from the first part."""
SENSORS = {"gyro": ("gyr", "rad/s"), "mag": ("mag", "uT")}
Plant = Callable[[np.random.Generator, Array, dict[str, Array]], tuple[Array, str, dict[str, float]]]


def _trials() -> list[Path]:
    return sorted((DATA / "dynamic").glob("broad_*.npz"))


def _scale(rng: np.random.Generator, y: Array, log: dict[str, Array]) -> tuple[Array, str, dict[str, float]]:
    i, s = int(rng.integers(3)), float(rng.choice([-0.01, 0.01]))
    return y * (1.0 + s * (np.arange(3) == i)), f"gyro_{AXES[i]}", {"coefficient": s}


def _misalignment(
    rng: np.random.Generator, y: Array, log: dict[str, Array]
) -> tuple[Array, str, dict[str, float]]:
    i, j = (int(k) for k in rng.choice(3, 2, replace=False))
    out = y.copy()
    out[:, i] += 0.02 * y[:, j]
    return out, f"gyro_{AXES[i]}", {f"{AXES[i]}{AXES[j]}": 0.02}


def _square(rng: np.random.Generator, y: Array, log: dict[str, Array]) -> tuple[Array, str, dict[str, float]]:
    i = int(rng.integers(3))
    out = y.copy()
    out[:, i] += 0.02 * y[:, i] ** 2
    return out, f"gyro_{AXES[i]}", {"k2": 0.02}


def _late(rng: np.random.Generator, y: Array, log: dict[str, Array]) -> tuple[Array, str, dict[str, float]]:
    t = log["t"]
    return np.array([np.interp(t - 0.02, t, c) for c in y.T]).T, "all", {"delay": 0.02}


def _lagged(rng: np.random.Generator, y: Array, log: dict[str, Array]) -> tuple[Array, str, dict[str, float]]:
    a = float(np.exp(-2.0 * np.pi * 4.0 * float(np.median(np.diff(log["t"])))))
    return lfilter([1.0 - a], [1.0, -a], y, axis=0, zi=a * y[:1])[0], "all", {"corner": 4.0}


def _hard(rng: np.random.Generator, y: Array, log: dict[str, Array]) -> tuple[Array, str, dict[str, float]]:
    v = rng.standard_normal(3)
    h = 5.0 * v / np.linalg.norm(v)
    return y + h, "mag", dict(zip(AXES, (1e-6 * h).tolist()))


def _soft(rng: np.random.Generator, y: Array, log: dict[str, Array]) -> tuple[Array, str, dict[str, float]]:
    i, j = (int(k) for k in rng.choice(3, 2, replace=False))
    out = y.copy()
    out[:, i] += 0.05 * y[:, j]
    out[:, j] += 0.05 * y[:, i]
    return out, "mag", {f"{AXES[i]}{AXES[j]}": 0.05, f"{AXES[j]}{AXES[i]}": 0.05}


def _attitude(quat: Array) -> Rotation:
    """Of the optical reference; where it has lost the body, its last one before, or the first."""
    seen = np.linalg.norm(quat, axis=1) > 0.5
    last = np.maximum.accumulate(np.where(seen, np.arange(seen.size), int(np.argmax(seen))))
    return Rotation.from_quat(quat[last], scalar_first=True)


def _magnet(rng: np.random.Generator, y: Array, log: dict[str, Array]) -> tuple[Array, str, dict[str, float]]:
    """A source in the room for a quarter of the time."""
    t, v = log["t"], rng.standard_normal(3)
    start = float(t[0] + rng.uniform(0.2, 0.5) * (t[-1] - t[0]))
    there = (t >= start) & (t < start + 0.25 * (t[-1] - t[0]))
    source = _attitude(log["quat"]).inv().apply(8.0 * v / np.linalg.norm(v))
    return y + source * there[:, None], "mag", {}


EFFECTS: dict[str, tuple[str, Plant]] = {
    "scale_factor": ("gyro", _scale),
    "misalignment": ("gyro", _misalignment),
    "nonlinearity": ("gyro", _square),
    "time_delay": ("gyro", _late),
    "hard_iron": ("mag", _hard),
    "soft_iron": ("mag", _soft),
    "magnetic_disturbance": ("mag", _magnet),
    "bandwidth": ("mag", _lagged),
}
"""Sensor in whose readings an effect is planted, of a size that people meet."""


def _part(trial: Path, between: tuple[float, float]) -> dict[str, Array]:
    """Time and arrays of a part of a trial."""
    with np.load(trial) as stored:
        t = np.arange(stored["gyr"].shape[0]) / float(stored["fs"])
        rows = (t >= between[0]) & (t < between[1])
        return {"t": t[rows]} | {k: stored[k][rows].astype(float) for k in ("gyr", "acc", "mag", "quat")}


def _columns(part: dict[str, Array], sensor: str, y: Array | None = None) -> dict[str, tuple[Array, str]]:
    """The channels of a log: a sensor, and an accelerometer and the attitude beside it."""
    key, unit = SENSORS[sensor]
    read = part[key] if y is None else y
    out = {f"{sensor}_{a}": (read[:, k], unit) for k, a in enumerate(AXES)}
    out |= {f"accel_{a}": (part["acc"][:, k], "m/s^2") for k, a in enumerate(AXES)}
    return out | {f"ref_q_{a}": (part["quat"][:, k], "") for k, a in enumerate("wxyz")}


def _kfgen(*words: str | Path) -> None:
    """A command of kfgen."""
    from typer.testing import CliRunner

    from kfgen.cli.app import app

    CliRunner().invoke(app, [str(w) for w in words], catch_exceptions=False)


@cache
def _assumed(trial: Path, sensor: str) -> str:
    """The text of the noise file: at rest, and with what is found in the first part."""
    names = ",".join(f"{sensor}_{a}" for a in AXES)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for name, between in (("rest", REST_S), ("first", FIRST_S)):
            part = _part(trial, between)
            channels = {k: v for k, v in _columns(part, sensor).items() if name == "first" or k in names}
            _write(place / f"{name}.csv", part["t"], channels)
        model = place / "model.toml"
        _kfgen("identify", place / "rest.csv", "--channels", names, "-o", model)
        for k in range(ROUNDS):
            updated = place / f"updated{k}.toml"
            answer = place / "answer.json"
            _kfgen("gap", place / "first.csv", "--model", model, "-o", updated, "--json", answer)
            model = updated if updated.is_file() else model
            if not json.loads(answer.read_text(encoding="utf-8"))["steps"]:
                break
        return model.read_text(encoding="utf-8")


def _planted(
    name: str, part: dict[str, Array], rng: np.random.Generator
) -> tuple[Array, str, dict[str, float]]:
    """Readings with an effect, where it is, and its numbers; what is planted comes before the converter."""
    sensor, plant = EFFECTS[name]
    y = part[SENSORS[sensor][0]]
    steps = np.array([adc_step(c) for c in y.T])
    y, where, values = plant(rng, y, part)
    return np.round(y / steps) * steps, where, values


def _found_first(trial: Path, name: str, rng: np.random.Generator) -> dict[str, tuple[float, float]]:
    """Numbers of an effect that is planted in the first part, and their standard deviations; none where it is not found."""
    sensor, part = EFFECTS[name][0], _part(trial, FIRST_S)
    y, where, _ = _planted(name, part, rng)
    with tempfile.TemporaryDirectory() as folder:
        log, model, answer = (Path(folder) / n for n in ("log.csv", "model.toml", "answer.json"))
        _write(log, part["t"], _columns(part, sensor, y))
        model.write_text(_assumed(trial, sensor), encoding="utf-8")
        _kfgen("gap", log, "--model", model, "--json", answer)
        steps: list[dict[str, Any]] = []
        if answer.is_file():
            steps = json.loads(answer.read_text(encoding="utf-8"))["steps"]
    found = [s["parameters"] for s in steps if s["effect"] == name and s["channel"] in (where, sensor)]
    return {
        k: (v["value"], (v["ci95"][1] - v["ci95"][0]) / 3.92)
        for k, v in (found[0] if found else {}).items()
        if v.get("ci95") and None not in v["ci95"]
    }


def _write(path: Path, t: Array, channels: dict[str, tuple[Array, str]]) -> None:
    head = ",".join(["t [s]", *(f"{name} [{unit}]" for name, (_, unit) in channels.items())])
    table = np.column_stack([t, *(v for v, _ in channels.values())])
    np.savetxt(path, table, fmt="%.10g", delimiter=",", header=head, comments="")


def requests(count: int, strengths: Sequence[float], nulls: int, seeds: np.random.Generator) -> list[Request]:
    """Every effect in trials one after the other; and parts as they are, of both sensors."""
    if not _trials():
        print(f"no recordings in {DATA}: nothing to hide effects in", file=sys.stderr)
        return []
    out = [
        Request("recorded", "single", (name,), OBVIOUS, i, int(seeds.integers(2**47)))
        for name in EFFECTS
        for i in range(count)
    ]
    return out + [Request("recorded", "null", (), 0.0, i, int(seeds.integers(2**47))) for i in range(nulls)]


def make(request: Request) -> Case:
    """Build one record."""
    rng = request.rng()
    trials = _trials()
    name = request.effects[0] if request.effects else ""
    if not name:
        trial, sensor = trials[request.index % len(trials)], tuple(SENSORS)[request.index // len(trials) % 2]
    else:
        sensor = EFFECTS[name][0]
        tried = [trials[t] for t in rng.permutation(len(trials))]
        trial = next((t for t in tried if f'"{name}"' not in _assumed(t, sensor)), tried[0])
    part = _part(trial, SECOND_S)
    y, hidden = part[SENSORS[sensor][0]], tuple[Hidden, ...]()
    if name:
        y, where, _ = _planted(name, part, deepcopy(rng))
        found = _found_first(trial, name, rng)
        twin = {"time_delay": ("bandwidth",), "bandwidth": ("time_delay",)}.get(name, ())
        values, deviations = ({k: v[i] for k, v in found.items()} for i in (0, 1))
        hidden = (Hidden(name, where, values, also=twin, deviations=deviations),)
    variant = f"{trial.stem.split('_')[1]}-{sensor}"
    return Case(request, variant, hidden, part["t"], _columns(part, sensor, y), _assumed(trial, sensor))
