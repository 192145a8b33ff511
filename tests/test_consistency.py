"""Filters of the library are as sure as they should be: NEES and NIS of simulated flights against chi-square bands.

Every flight draws its own start, biases, constants and noise from what the filter assumes; its truth is integrated on a
grid much finer than the samples, and its sensors have their own rates. Bands are two-sided; all numbers of this file
together leave theirs by chance with probability `ALARM`, so each with `ALARM` over their `count`. Innovations of a filter
that is right are white: the NIS of its samples are independent and add to chi-square, which
`test_the_nis_of_flights_differ_as_independent_ones_do` holds. The seeds are fixed, so a test that passes keeps passing.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from kfgen.effects import make
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.known_delays import shifts, without_shifts
from kfgen.model.library import build
from kfgen.model.symbols.blocks import Attitude
from kfgen.run.run import load
from kfgen.simulate.simulate import simulate

ALARM = 0.01
"""Probability that chance alone makes a number of this file leave its band."""
RATE = 50.0
SMALL = 0.1
"""Share of the priors that is drawn and assumed: small enough for a linear filter."""

Case = tuple[str, tuple[tuple[str, str], ...]]


@cache
def program(case: Case) -> Program:
    """The model with what it leaves out left out, and its start assumed a share of its prior."""
    model = build(case[0], None, dict(case[1]))
    noise = {
        c: tuple(make("bias", sd=SMALL * e.sd) if e.name == "bias" else e for e in es)  # type: ignore[attr-defined]
        for c, es in model.noise.items()
    }
    motion = model.motion
    motion.blocks = tuple(replace(b, prior=SMALL * b.prior) for b in motion.blocks)
    for s in model.sensors:
        s.blocks = tuple(replace(b, prior=SMALL * b.prior) for b in s.blocks)
    model = FilterModel(model.name, model.title, motion, model.sensors, noise)
    return Program(DiscreteModel(model, order=2, rate=RATE))


def biases(program: Program, seed: int) -> tuple[dict[str, float], DiscreteModel]:
    """Truth of the biases, and a model that simulates them."""
    model, rng = program.discrete.model, np.random.default_rng(1000 + seed)
    noise: dict[str, tuple[Any, ...]] = {}
    truth: dict[str, float] = {}
    for a in model.attached:
        effect: Any = a.effect
        if effect.name == "bias":
            truth[model.states[a.states[0]].name] = float(effect.sd * rng.normal())
            effect = make("bias", value=truth[model.states[a.states[0]].name])
        noise[a.channel] = (*noise.get(a.channel, ()), effect)
    return truth, DiscreteModel(replace(model, noise=noise), order=2, rate=RATE)


@cache
def flown(
    case: Case, manoeuvre: str, duration: float, seed: int
) -> tuple[float, dict[str, tuple[float, int]]]:
    """NEES of the whole state at the end, and the sum and the number of rows of each sensor's NIS."""
    p = program(case)
    model = p.discrete.model
    truth, simulated = biases(p, seed)
    log = simulate(simulated, manoeuvre, duration, np.random.default_rng(seed))
    x = {n.removeprefix("ref_"): c.values for n, c in log.channels.items() if n.startswith("ref_")}
    kf = getattr(load(p), class_name(p))()
    kf.gates = dict.fromkeys(kf.gates, np.inf)  # what is unlikely counts as well
    rng = np.random.default_rng(2000 + seed)
    error = dict(
        zip((s.name for s in model.states), rng.normal(size=p.n) * np.sqrt(np.diag(kf.P)), strict=True)
    )
    start: list[float] = []
    for b in model.blocks:
        if isinstance(b, Attitude):
            q = Rotation.from_quat([x[f"q_{a}"][0] for a in "wxyz"], scalar_first=True)
            E = Rotation.from_rotvec([-error[n] for n in b.error_names])
            start += list((q * E if b.convention.side.body else E * q).as_quat(scalar_first=True))
        elif b in model.motion.blocks[:2]:
            start += [x[n][0] - error[n] for n in b.error_names]
        else:
            start += list(b.start)  # the truth was drawn about it
    kf.nominal[:] = [*start, *[0.0] * (len(p.discrete.nominal_names) - len(start))]
    inputs = {i.name: np.column_stack([log.values(c) for c in i.channels]) for i in model.motion.inputs}
    takes = {r.name: {a.name for a in r.arguments} for r in p.pieces}
    kf.constants[:] = list(({c.name: c.value for c in model.constants} | without_shifts(model)).values())
    late = {s.name: round(shifts(model).get(s.name, 0.0) * RATE) for s in model.sensors}  # in rows
    nis = dict.fromkeys((s.name for s in model.sensors), (0.0, 0))
    for k in range(log.n):
        for s in model.sensors:
            row = k + late[s.name]  # a sample is fused at its own time, where a known delay is over
            z = np.array([log.channels[c].values[row] if row < log.n else np.nan for c in s.channels])
            if not np.isfinite(z).all():
                continue
            extra = {n: v[k] for n, v in inputs.items() if n in takes[f"expect_{s.name}"]}
            getattr(kf, f"update_{s.name}")(z, **extra)
            total, rows = nis[s.name]
            nis[s.name] = total + kf.nis, rows + len(s.channels)
        if k < log.n - 1:
            kf.predict(**{n: v[k] for n, v in inputs.items()}, dt=1.0 / RATE)
    end = dict(zip(p.discrete.nominal_names, kf.nominal, strict=True))
    e: list[float] = []
    for b in model.blocks:
        if isinstance(b, Attitude):
            true, q = (
                Rotation.from_quat([v[f"q_{a}"] for a in "wxyz"], scalar_first=True)
                for v in ({n: x[n][-1] for n in b.nominal_names}, end)
            )
            e += list((q.inv() * true if b.convention.side.body else true * q.inv()).as_rotvec())
        else:
            e += [x[n][-1] - end[n] for n in b.error_names]
    e += [truth[s.name] - end[s.name] for s in model.states[len(e) :]]
    scale = np.sqrt(np.diag(kf.P))
    unit = np.array(e) / scale
    return float(unit @ np.linalg.solve(kf.P / np.outer(scale, scale), unit)), nis


@cache
def count() -> int:
    """Of the numbers that are judged: NEES and the NIS of each sensor, and the scatter of each sensor's NIS."""
    judged = [*SHORT, *TURNS * len(MANOEUVRES), *MANY]
    sensors = {case: len(build(case[0], None, dict(case[1])).sensors) for case in judged}
    return sum(1 + sensors[case] for case in judged) + sum(sensors[case] for case in SCATTER)


def in_band(total: float, freedom: int) -> bool:
    """Whether a sum of squares is one of independent unit normals, at the false alarm rate of one number of the file."""
    low, high = chi2.ppf([ALARM / count() / 2, 1 - ALARM / count() / 2], freedom)
    return bool(low < total < high)


def consistent(case: Case, duration: float, flights: int, manoeuvre: str = "generic") -> None:
    runs = [flown(case, manoeuvre, duration, seed) for seed in range(flights)]
    n = program(case).n
    nees = sum(r[0] for r in runs)
    assert in_band(nees, n * flights), nees / (n * flights)
    for sensor in runs[0][1]:
        total, rows = (sum(r[1][sensor][k] for r in runs) for k in (0, 1))
        assert in_band(total, int(rows)), (sensor, total / rows)


AHRS: Case = ("ahrs6", (("left_out", "false"),))
MOVED: Case = ("ahrs25", (("left_out", "false"), ("samples", "after")))
INS: Case = ("ins15", ())
MORE: list[Case] = [
    ("ins15", (("attitude_error", "local-quaternion"),)),
    ("ins15", (("frame", "ecef"),)),
    ("ins15", (("lever_arm", "state"), ("delay", "0.1 s"))),
    ("ins21", (("earth_rate", "true"), ("transport_rate", "true"), ("gravity_model", "normal"))),
    ("ins15", (("sensors", "gnss_position,heading,barometer,odometer"), ("wheel_scale", "true"))),
    ("ins33", ()),
]


SHORT = [AHRS, MOVED, INS]
TURNS: list[Case] = [AHRS, INS, ("ins21", ())]
MANOEUVRES = ["s-turn", "coordinated-turn"]
MANY = [AHRS, MOVED, INS, *MORE]
SCATTER = [AHRS, MOVED]
LONG = (MOVED, TURNS[2])
"""Cases that take minutes."""


def quick_first(cases: list[Case]) -> list[Any]:
    """Cases as parameters, those of minutes marked."""
    return [pytest.param(c, marks=pytest.mark.long if c in LONG else (), id=c[0]) for c in cases]


@pytest.mark.parametrize("case", in_part(quick_first(SHORT)))
def test_a_filter_is_as_sure_as_it_should_be(case: Case) -> None:
    consistent(case, 8.0, 8)


@pytest.mark.parametrize(
    "manoeuvre", in_part([MANOEUVRES[0], *(pytest.param(m, marks=pytest.mark.long) for m in MANOEUVRES[1:])])
)
@pytest.mark.parametrize("case", in_part(quick_first(TURNS)))
def test_a_filter_is_as_sure_as_it_should_be_in_turns(case: Case, manoeuvre: str) -> None:
    consistent(case, 8.0, 6, manoeuvre)


@pytest.mark.long
@pytest.mark.parametrize("case", MANY, ids=str)
def test_a_filter_is_as_sure_as_it_should_be_over_many_flights(case: Case) -> None:
    consistent(case, 30.0, 24)


@pytest.mark.long
@pytest.mark.parametrize("case", SCATTER, ids=str)
def test_the_nis_of_flights_differ_as_independent_ones_do(case: Case) -> None:
    """The sum of a flight varies by twice its rows; innovations that agree for a second would make it 50 times that."""
    runs = [flown(case, "generic", 30.0, seed)[1] for seed in range(24)]
    for sensor in runs[0]:
        z = np.array([(total - rows) / np.sqrt(2.0 * rows) for total, rows in (r[sensor] for r in runs)])
        assert in_band(float(np.sum((z - z.mean()) ** 2)), z.size - 1), (sensor, z.var(ddof=1))


def test_the_band_can_fail() -> None:
    """Errors half as large again as assumed leave it."""
    nees = sum(flown(INS, "generic", 8.0, seed)[0] for seed in range(8))
    assert not in_band(1.5**2 * nees, program(INS).n * 8)
