"""Proves that emission stays in seconds of processor time: library models, every option of the largest, orders of a step."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from in_part import in_part

from kfgen.core.errors import InputError
from kfgen.emit.emit import emit
from kfgen.emit.routines import Program
from kfgen.emit.targets.c import CPrinter
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import LIBRARY, build
from kfgen.model.option import STATE, Choice, Kind, Names, OrState, YesNo

MOST_S = 20.0
BUSY = 3.0
"""A processor that is busy with other work counts up to so many times the seconds."""
LARGEST = ("ahrs25", "ins23", "ins33")
"""Models that have the options of all others, and more states."""
TURNING = {"transport_rate": "true", "earth_rate": "true", "gravity_model": "normal"}
QUICK = [("hemerly-ekf", {}, "ud"), ("ins15", TURNING, "ud")]
CASES = [
    *((n, {}, "ud") for n in LIBRARY if n != "hemerly-ekf"),
    ("ins15", TURNING, "p"),
    *(("ins23", TURNING, form) for form in ("p", "ud")),
    ("ins33", TURNING, "ud"),
    *((name, {"frame": "ecef"}, "ud") for name in ("ins15", "ins23", "ins33")),
    ("ins23", {"delay": "0.1 s", "lever_arm": "state"}, "ud"),
    ("ins15", {"attitude_error": "right-invariant", "earth_rate": "true"}, "ud"),
    ("ahrs6", {"acceleration": "bounded"}, "ud"),
]


@pytest.mark.parametrize(
    ("name", "options", "form"),
    [*QUICK[:1], *(pytest.param(*c, marks=pytest.mark.long) for c in [*QUICK[1:], *CASES])],
)
def test_emission_takes_seconds(name: str, options: dict[str, str], form: str, tmp_path: Path) -> None:
    begun = time.process_time()
    made = emit(build(name, None, options), tmp_path / "f", "c", form)
    assert time.process_time() - begun < MOST_S
    assert len(made.files) > 5


def values(kind: Kind, default: str) -> list[str]:
    """What an option may be beside its default; of numbers none, which leave the equations as they are."""
    if isinstance(kind, OrState):
        return [STATE]
    if isinstance(kind, YesNo):
        return ["true", "false"]
    if isinstance(kind, Names):
        return [f"{default},{n}" for n in kind.known if n not in default.split(",")]
    return list(kind.names) if isinstance(kind, Choice) else []


def choices(name: str) -> list[dict[str, str]]:
    """Every value of every option of a model, alone, in each of its frames."""
    out = []
    for frame in LIBRARY[name].variants():
        for o in LIBRARY[name].options(frame):
            others = [v for v in values(o.kind, o.default) if v != o.default and o.name not in frame]
            out += [{**frame, o.name: v} for v in others]
    return out


CHOICES = [(n, c) for n in LARGEST for c in choices(n)]


def test_every_option_is_among_the_choices() -> None:
    """But numbers, and what says which options there are."""
    for name, entry in LIBRARY.items():
        for frame in entry.variants():
            known = {o.name for o in entry.options(frame) if values(o.kind, o.default)} - {"frame"}
            assert known <= {o for _, c in CHOICES for o in c}, name


@pytest.mark.long
@pytest.mark.parametrize(("name", "options"), CHOICES, ids=lambda v: str(v).replace("'", ""))
def test_every_option_of_the_largest_models_is_emitted_in_seconds(
    name: str, options: dict[str, str], tmp_path: Path
) -> None:
    begun = time.process_time()
    try:
        model = build(name, None, options)
    except InputError as error:  # a sensor that the motion cannot serve, or that its input is already
        pytest.skip(str(error))
    emit(model, tmp_path / "f")
    assert time.process_time() - begun < BUSY * MOST_S


@pytest.mark.parametrize(
    ("name", "order", "most"), in_part([("ins15", 2, 1900), ("ins15", 3, 2200), ("ins21", 2, 3000)])
)
def test_a_higher_order_multiplies_nothing_out_that_gets_longer(name: str, order: int, most: int) -> None:
    """An entry of the corrected inputs of ins33 had 100,000 operations at order 2, where that of the raw ones has 942."""
    assert Program(DiscreteModel(build(name), order), "ud").predict.operations <= most


@pytest.mark.long
def test_every_number_of_a_third_order_in_earth_axes_is_one_of_single_precision() -> None:
    """Multiplied out, the gravity of the ellipsoid had a coefficient of 7.69e-39, which is none."""
    program = Program(DiscreteModel(build("ins23", None, {"frame": "ecef"}), 3), "ud")
    assert "const float" in CPrinter(program).body(program.predict)
