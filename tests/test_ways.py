"""Proves the emitted C on the less trodden ways: frames, options, loops, double precision, noise that waits, plants.

Every word after every call against the reference, on the host and on the Cortex-M4F.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.emit.folder import EmittedFilter, read_folder, write_folder
from kfgen.emit.geodetic.calls import border_calls
from kfgen.emit.reference import Machine
from kfgen.emit.routines import MAX_WAITING_PREDICTIONS, Program
from kfgen.emit.scenario import scenario, split
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.verify.compare import verify

CART = """
format = "kfgen-model-1"
name = "cart"
[parameters]
m = "2.0 kg"
[states]
p = { unit = "m", initial = "0 m", sd = "0.1 m" }
v = { unit = "m/s", initial = "0 m/s", sd = "0.3 m/s" }
[inputs]
u = "N"
[dynamics]
p = "v"
v = "(u - 0.4*v - 0.3*tanh(v/0.02) + 0.1*sin(3.0*p) + 0.05*exp(-p*p))/m"
[measurements.pos]
unit = "mm"
expression = "p"
effects = [ { effect = "white_noise", N = "0.2 mm/sqrt(Hz)" }, { effect = "bias", sd = "1 mm" } ]
[measurements.ang]
unit = "rad"
expression = "atan2(p, 2.0 + v*v) + sqrt(1.0 + p*p) + cos(p)"
effects = [ { effect = "white_noise", N = "0.02 rad/sqrt(Hz)" } ]
"""
"""A plant with every function that can be emitted but two."""


def walking() -> FilterModel:
    """ins15 whose gyros' biases walk."""
    model = build("ins15")
    for axis in "xyz":
        model = model.augment(f"gyro_{axis}", make("rate_random_walk", K=1e-6))
    return model


def cores() -> list[str]:
    emulated = all(importlib.util.find_spec(m) for m in ("ziglang", "unicorn", "elftools"))
    return [*(["host"] if shutil.which(os.environ.get("CC") or "cc") else []), *(["m4f"] if emulated else [])]


WAYS: list[Any] = [
    pytest.param("ins15", {"frame": "ecef"}, {"form": "p"}, marks=pytest.mark.long),
    pytest.param("ins15", {"frame": "ecef"}, {"form": "ud"}, marks=pytest.mark.long),
    pytest.param("ins15", {"lever_arm": "state"}, {"form": "ud"}, marks=pytest.mark.long),
    pytest.param("ins15", {"delay": "0.2 s"}, {"form": "p"}, marks=pytest.mark.long),
    ("ins15", {}, {"form": "ud", "loops": True}),
    pytest.param("ins15", {}, {"form": "p", "real": "double"}, marks=pytest.mark.long),
    pytest.param("ahrs6", {"scale_factors": "true"}, {"form": "p"}, marks=pytest.mark.long),
    ("ahrs6", {"scale_factors": "true"}, {"form": "ud", "loops": True}),
    pytest.param("cart", {}, {"form": "p"}, marks=pytest.mark.long),
    ("cart", {}, {"form": "ud", "loops": True}),
]


@pytest.mark.parametrize(("name", "options", "how"), in_part(WAYS), ids=str)
def test_no_word_differs(name: str, options: dict[str, str], how: dict[str, Any], tmp_path: Path) -> None:
    if not cores():
        pytest.skip("there is no C compiler on this machine, and no emulator (pip install 'kfgen[pil]')")
    file = tmp_path / "cart.toml"
    file.write_text(CART)
    program = Program(DiscreteModel(build(str(file) if name == "cart" else name, None, options)), **how)
    write_folder(program, "c", None, tmp_path / "c")
    for v in verify(read_folder(tmp_path / "c"), cores()):
        assert (v.differing, v.max_ulp) == (0, 0), v.core
        border = border_calls(program.border) if program.border else ()
        own = v.calls - len(border)
        assert v.words == own * program.word_count + sum(c.words.size for c in border) > 5000


def waits(q_interval: float) -> Program:
    return Program(DiscreteModel(walking()), "ud", q_interval=q_interval)


@pytest.mark.long
def test_the_proof_meets_noise_that_waits(tmp_path: Path) -> None:
    """The calls in which it comes in are run and counted: they are the dearest, and few."""
    program = waits(0.2)
    assert program.settling == 20 + len(program.slow)
    machine = Machine(program)
    machine.call("init")
    waited = []
    for call in scenario(program, 60):
        machine.call(call.routine, split(machine.routines[call.routine], call.inputs))
        if call.routine == "predict":
            waited.append(float(machine.arrays["waiting"][0]))
    began = [k for k in range(1, len(waited)) if waited[k] < waited[k - 1]]
    assert began in ([19], [20])
    if "m4f" not in cores():
        pytest.skip("the emulator is not installed (pip install 'kfgen[pil]')")
    write_folder(program, "c", None, tmp_path / "c")
    (verdict,) = verify(EmittedFilter(program, "c", tmp_path / "c"), ["m4f"])
    assert (verdict.differing, verdict.max_ulp) == (0, 0)
    plain = Program(DiscreteModel(build("ins15", None, {"biases": "constant"})), "ud")
    write_folder(plain, "c", None, tmp_path / "e")
    cheap = verify(EmittedFilter(plain, "c", tmp_path / "e"), ["m4f"])[0].cost.instructions["predict"]
    assert 1.5 * cheap < verdict.cost.instructions["predict"] < 2.5 * cheap


@pytest.mark.long
def test_noise_that_waits_for_longer_than_the_first_500_steps_is_met() -> None:
    program = waits(6.0)
    predictions = sum(c.routine == "predict" for c in scenario(program))
    assert predictions >= 2 * program.settling > 1000


def test_noise_does_not_wait_for_longer_than_the_proof() -> None:
    with pytest.raises(InputError, match="misses 3000 predictions"):
        waits(1.5 * MAX_WAITING_PREDICTIONS / 100.0)
    assert np.isfinite(waits(MAX_WAITING_PREDICTIONS / 100.0).q_interval)
