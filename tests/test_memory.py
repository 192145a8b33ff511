"""Proves that what a filter keeps beside its state is right: late inputs, backlashes, and every effect of a plant in code.

Delays are compared with the exact integral of the shifted input, backlashes with the backlash operator written anew, whole
filters with logs of the plant's own simulation, which integrates breakpoints and knows no filter.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.effects import catalogue
from kfgen.effects.plant.terms import ParameterError, PlantEffect
from kfgen.emit.folder import read_folder, write_folder
from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name
from kfgen.log.log import Channel, Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.plant.drawn_process_noise import with_drawn_process_noise
from kfgen.model.plant.equations import filter_model
from kfgen.model.plant.file import parse_model
from kfgen.run.filter_calls import FilterCalls
from kfgen.run.run import load, run
from kfgen.simulate.simulate import simulate
from kfgen.verify.compare import verify

CART = """
format = "kfgen-model-1"
name = "cart"
[states]
q = { unit = "m", initial = "0 m", sd = "1e-6 m" }
v = { unit = "m/s", initial = "0 m/s", sd = "1e-6 m/s" }
[inputs]
u = "m/s^2"
[dynamics]
q = "v"
v = "u - 0.4*v - 1.5*q"
[measurements.place]
unit = "m"
expression = "q"
effects = [ { effect = "white_noise", N = "1e-4 m/sqrt(Hz)" }%s ]
"""
RATE = 50.0
SIZES = {
    "viscous_friction": 'v = [ { effect = "viscous_friction", coefficient = 0.5 } ]',
    "coulomb_friction": 'v = [ { effect = "coulomb_friction", level = 0.2, v0 = 0.05 } ]',
    "process_noise": 'v = [ { effect = "process_noise", N = 0.1 } ]',
    "quadratic_drag": 'v = [ { effect = "quadratic_drag", coefficient = 0.5 } ]',
    "constant_input": 'v = [ { effect = "constant_input", value = 0.3 } ]',
    "spring": 'v = [ { effect = "spring", coefficient = 1.0 } ]',
    "cubic_spring": 'v = [ { effect = "cubic_spring", coefficient = 1.0 } ]',
    "input_delay": 'u = [ { effect = "input_delay", delay = 0.13 } ]',
    "input_lag": 'u = [ { effect = "input_lag", tau = 0.1 } ]',
    "input_nonlinearity": 'u = [ { effect = "input_nonlinearity", k2 = 0.2, k3 = -0.05 } ]',
    "square_law": 'u = [ { effect = "square_law", share = 0.4, full = 0.8 } ]',
    "saturation": 'u = [ { effect = "saturation", limit = 0.6 } ]',
    "input_dead_zone": 'u = [ { effect = "input_dead_zone", width = 0.2 } ]',
    "sensor_lag": '{ effect = "sensor_lag", tau = 0.1 }',
    "backlash": '{ effect = "backlash", width = 0.2 }',
}


def text_of(entry: str = "") -> str:
    """The cart with an effect."""
    if entry.startswith("{"):
        return CART % f", {entry}"
    return CART % "" + (f"[dynamics_effects]\n{entry}\n" if entry else "")


def program_of(text: str, rate: float = RATE) -> Program:
    return Program(DiscreteModel.at_rate(filter_model(parse_model(text, "cart.toml")), rate))


def filter_of(program: Program) -> Any:
    return getattr(load(program), class_name(program))()


def pushed(n: int) -> np.ndarray:
    """Held levels of 0.4 s."""
    return np.repeat(np.random.default_rng(3).uniform(-1.0, 1.0, n), 20)[:n]


def log_of(text: str, n: int = 2000) -> Log:
    """Pushes, and what a plant of its own simulation shows of them."""
    from kfgen.model.plant.plant import simulate as simulated

    t, u = np.arange(n) / RATE, pushed(n)
    model, noises = with_drawn_process_noise(parse_model(text, "cart.toml"), t, np.random.default_rng(6))
    place = simulated(model, t, {"u": u} | noises).channels["place"][:, 0]
    noise = 1e-4 * RATE**0.5 * np.random.default_rng(5).standard_normal(n)
    return Log(t, {"u": Channel(u, "m/s^2"), "place": Channel(place + noise, "m")}, source="cart")


INTEGRATOR = """
format = "kfgen-model-1"
name = "tank"
[states]
h = "m"
[inputs]
q = "m/s"
[dynamics]
h = "q"
[measurements.level]
unit = "m"
expression = "h"
effects = [ { effect = "white_noise", N = "1 mm/sqrt(Hz)" } ]
[dynamics_effects]
q = [ { effect = "input_delay", delay = %r } ]
"""


@pytest.mark.parametrize("delay", [0.004, 0.02, 0.033, 0.1, 0.1071])
def test_a_late_input_is_the_integral_of_the_shifted_one(delay: float) -> None:
    kf, dt = filter_of(program_of(INTEGRATOR % delay)), 1.0 / RATE
    q = np.random.default_rng(1).standard_normal(40)
    total = np.concatenate([[0.0], np.cumsum(q) * dt])
    for k, value in enumerate(q):
        kf.predict(q_in=float(value), dt=dt)
        exact = np.interp((k + 1) * dt - delay, np.arange(41) * dt, total, left=0.0)
        assert kf.nominal[0] == pytest.approx(exact, abs=1e-12)


def test_a_refused_step_keeps_no_sample() -> None:
    kf = filter_of(program_of(INTEGRATOR % 0.06))
    kf.predict(q_in=1.0, dt=0.02)
    before = list(kf.nominal)
    assert kf.predict(q_in=5.0, dt=0.0).name == "BAD_STEP"
    assert list(kf.nominal) == before


def test_a_backlash_moves_with_the_state_once_it_is_used_up() -> None:
    program = program_of(text_of(SIZES["backlash"]))
    kf, stands, u = filter_of(program), 0.0, pushed(400)
    kf.gates = dict.fromkeys(kf.gates, 0.0)  # the filter looks, and corrects nothing
    for k in range(400):
        kf.update_place(z=np.zeros(1))
        stands = min(max(stands, kf.nominal[0] - 0.1), kf.nominal[0] + 0.1)
        assert -kf.innovation[0] == pytest.approx(stands, abs=1e-12)
        kf.predict(u_in=float(u[k]), dt=0.02)
    assert abs(stands) > 0.1  # it was taken along


def test_within_a_backlash_a_sample_says_nothing() -> None:
    kf = filter_of(program_of(text_of(SIZES["backlash"])))
    kf.P = np.diag([0.04, 0.01])
    kf.nominal[:] = [0.05, 0.0, 0.0]
    kf.update_place(z=np.array([0.02]))
    assert kf.P[0, 0] == 0.04
    kf.nominal[:] = [0.15, 0.0, 0.0]
    kf.update_place(z=np.array([0.05]))
    assert kf.P[0, 0] < 0.001


def test_there_is_an_entry_for_every_effect_of_a_plant() -> None:
    own = {n for n, c in catalogue().items() if issubclass(c, PlantEffect) and c is not ParameterError}
    assert own == set(SIZES)


@pytest.mark.parametrize("name", SIZES)
def test_a_filter_carries_every_effect_of_a_plant(name: str) -> None:
    """Of 2000 innovations the mean square is within 0.15 of one (5 standard deviations), without the effect it is beyond."""
    log = log_of(text_of(SIZES[name]))
    plain, carried = (
        float(np.mean(run(program_of(text), log).sensors["place"].nis))
        for text in (text_of(), text_of(SIZES[name]))
    )
    assert abs(carried - 1.0) < 0.15
    assert plain > 2.0


@pytest.mark.parametrize("name", SIZES)
@pytest.mark.parametrize("form", ["p", "ud"])
def test_every_effect_of_a_plant_is_in_code_that_is_proven(name: str, form: str, tmp_path: Path) -> None:
    program = program_of(text_of(SIZES[name]))
    write_folder(Program(program.discrete, form), "numpy", None, tmp_path / "made")
    (verdict,) = verify(read_folder(tmp_path / "made"), ["host"])
    assert verdict.differing == 0
    assert verdict.words > 1000


def test_the_words_of_the_c_are_those_of_the_reference(tmp_path: Path) -> None:
    text = text_of(SIZES["backlash"]) + f"[dynamics_effects]\n{SIZES['input_delay']}\n"
    write_folder(program_of(text), "c", None, tmp_path / "made")
    (verdict,) = verify(read_folder(tmp_path / "made"), ["host"])
    assert verdict.differing == 0
    header = (tmp_path / "made" / "cart.h").read_text(encoding="utf-8")
    assert "keeps it back by 0.13 s itself" in header
    assert "CART_X_U_AGO7" in header
    assert "U_AGO8" not in header


def test_a_motion_without_noise_is_listened_to_for_ever() -> None:
    """Its covariance fades as exp(-0.8 t), below what single precision can hold after two minutes."""
    text = text_of().replace("1e-6 m", "1 m")
    discrete = program_of(text).discrete
    log = simulate(discrete, "generic", 600.0, np.random.default_rng(0))
    from kfgen.verify.replay import replay

    played = replay(FilterCalls(Program(discrete, "ud"), log))
    assert not played.refused
    assert np.isfinite(played.calls[-1].words).all()


def test_a_log_of_another_rate_is_refused_where_samples_are_counted() -> None:
    program = program_of(text_of(SIZES["input_delay"]), rate=35.0)
    with pytest.raises(InputError, match="kept in samples at 35 Hz, but the log has 50 Hz"):
        run(program, log_of(text_of(), 100))


def test_a_slower_log_steps_at_the_rate_of_the_filter() -> None:
    program, log = program_of(text_of(SIZES["input_delay"]), rate=100.0), log_of(text_of(), 100)
    assert [len(list(FilterCalls(program, log).steps(k))) for k in (0, 50, 99)] == [2, 2, 0]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (text_of(SIZES["input_delay"].replace("0.13", "9.0")), "450 samples at 50 Hz, more than 256"),
        (text_of(f"{SIZES['backlash']}, {SIZES['sensor_lag']}"), "sensor_lag stands behind the backlash"),
        (text_of(f"{SIZES['backlash']}, {SIZES['backlash']}"), "backlash stands behind the backlash"),
    ],
)
def test_what_no_memory_holds_is_refused(text: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        _ = program_of(text).routines
