"""Records of a sensor at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from case import Case, Hidden, Request
from effects import EFFECTS, FAMILIES, ORDER
from irregular import INTEGRITY, NEAR, UNKNOWN
from sensor import SENSORS, Recording, record

LENGTHS = (0, 4000, 0, 60000, 10000)
"""Samples of the null records; 0: the sensor's own."""
STACK = 100.0
"""Strength of each effect of a stack, of unknown effects, near misses, and a withheld thermometer."""
STAND_INS = (
    "unknown",
    "rate_random_walk",
    "gauss_markov",
    "bias_instability",
    "power_law_noise",
    "warm_up",
    "rate_ramp",
    "sinusoid",
)
"""What may be said of a temperature effect without a thermometer: that it is unknown, or a drift."""


def requests(count: int, strengths: Sequence[float], nulls: int, seeds: np.random.Generator) -> list[Request]:
    """All cells, `count` cases in each."""
    cells: list[tuple[str, tuple[str, ...], float]] = []
    cells += [("single", (name,), X) for X in strengths for name in EFFECTS]
    cells += [("withheld", ("temperature",), STACK)]
    cells += [("unknown", (name,), STACK) for name in UNKNOWN]
    cells += [("near", (name,), STACK) for name in NEAR]
    cells += [("integrity", (name,), 0.0) for name in INTEGRITY]
    out = [
        Request("static", kind, names, X, i, int(seeds.integers(2**47)))
        for kind, names, X in cells
        for i in range(count)
    ]
    for kind, size in (("pair", 2), ("triple", 3)):
        for i in range(4 * count):
            names = _stack(seeds, size)
            out.append(Request("static", kind, names, STACK, i, int(seeds.integers(2**47))))
    return out + [Request("static", "null", (), 0.0, i, int(seeds.integers(2**47))) for i in range(nulls)]


def _stack(rng: np.random.Generator, size: int) -> tuple[str, ...]:
    families = rng.choice(len(FAMILIES), size, replace=False)
    names = [str(rng.choice(FAMILIES[k])) for k in families]
    return tuple(sorted(names, key=lambda n: ORDER.index(n) if n in ORDER else len(ORDER)))


def make(request: Request, samples: int = 0) -> Case:
    """Build one record, of so many samples; zero: of the sensor's own length, and of `LENGTHS` where nothing is hidden."""
    rng = request.rng()
    sensor = SENSORS[request.index % len(SENSORS)]
    if "random_telegraph" in request.effects and sensor.sigma:  # its strength is that over white noise
        sensor = SENSORS[request.index % len(SENSORS) - 1]
    if request.kind == "null":
        return _null(request, rng, samples or LENGTHS[request.index % len(LENGTHS)])
    r = record(sensor, rng, samples)
    if request.kind == "integrity":
        return _fault(request, r)
    catalogue = {**EFFECTS, **UNKNOWN, **NEAR}
    hidden = [catalogue[name](r, request.strength) for name in request.effects]
    if request.kind == "withheld":
        hidden = [replace(h, also=STAND_INS) for h in hidden]
    return _case(request, r, hidden)


def _case(request: Request, r: Recording, hidden: Sequence[Hidden]) -> Case:
    channels = r.channels(thermometer=request.kind != "withheld")
    return Case(request, r.sensor.name, tuple(hidden), r.elapsed, channels, r.model(), r.sensor.numbers)


def _null(request: Request, rng: np.random.Generator, n: int) -> Case:
    sensor = SENSORS[request.index % len(SENSORS)]
    sensor = replace(sensor, offset=sensor.offset + float(rng.normal(0.0, 20.0)) * sensor.white)
    return _case(request, record(sensor, rng, n), ())


def _fault(request: Request, r: Recording) -> Case:
    name = request.effects[0]
    t, y, values, kept = INTEGRITY[name](r, r.elapsed, r.values())
    channels = {k: (v[kept], unit) for k, (v, unit) in r.channels().items()}
    channels[r.sensor.channel] = (y, r.sensor.unit)
    hidden = (Hidden(name, r.sensor.channel, values),)
    return Case(request, r.sensor.name, hidden, t, channels, r.model(), r.sensor.numbers)
