"""Proves that nobody is held to know what an input was before the log: what is late or lags may show another one.

Expected motions are closed solutions of ``T' = g q - k (T - Ta)``. Half-widths are those of 95 %: a time is held to 2.5 of
them (1e-6). Seeds are fixed; a sound log is falsely alarmed at 0.2 % by the battery.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray
from scipy.integrate import quad

from kfgen.effects.plant.terms import InputDelay, InputLag, Saturation
from kfgen.model.plant.signal import Signal

Array = NDArray[np.float64]
Cli = Callable[..., Result]
HEATER = """format = "kfgen-model-1"
name = "heater"
[parameters]
k = "0.01 1/s"
g = "0.5 K/s"
Ta = "23 K"
[states]
T = "K"
[inputs]
q = ""
[dynamics]
T = "g*q - k*(T - Ta)"
[measurements.temp]
unit = "K"
expression = "T"
effects = [ { effect = "white_noise", N = "0.3 K/sqrt(Hz)" } ]
"""
DT, N = 2.0, 1500


def warmed(acting: Array, first: float) -> Array:
    """The temperature where `acting` is the held input of each tenth of a sample."""
    h, T, out = DT / 10, first, []
    for k, q in enumerate(acting):
        if k % 10 == 0:
            out.append(T)
        rest = 23.0 + 50.0 * q
        T = rest + (T - rest) * np.exp(-0.01 * h)
    return np.array(out)


@pytest.fixture
def asked(kfgen: Cli, tmp_path: Path) -> Callable[[Array, Array], list[dict[str, Any]]]:
    def ask(q: Array, temp: Array) -> list[dict[str, Any]]:
        """What is missing, step by step."""
        noise = 0.3 / np.sqrt(DT) * np.random.default_rng(41).standard_normal(N)
        path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
        table = np.column_stack([np.arange(N) * DT, q, temp + noise])
        np.savetxt(path, table, delimiter=",", header="t [s],q [1],temp [K]", comments="", fmt="%.12g")
        model.write_text(HEATER, encoding="utf-8")
        done = kfgen("gap", path, "--model", model, "--json", out)
        assert done.exit_code == 0, done.output
        answer = json.loads(out.read_text(encoding="utf-8"))
        assert answer["verdict"] == "effects_found"
        steps: list[dict[str, Any]] = answer["steps"]
        return steps

    return ask


def switched(on: float) -> Array:
    """A heater that is on at first, or off, and is switched every so often."""
    lengths = np.random.default_rng(9).integers(30, 90, 40)
    return np.repeat((np.arange(40) + on) % 2, lengths)[:N].astype(np.float64)


@pytest.mark.long
def test_a_dead_time_while_the_input_is_on_from_the_start(asked: Callable[..., Any]) -> None:
    """The heater was off before the log: for 6 s it does not heat although the log has it on."""
    q = switched(1.0)
    late = np.concatenate([np.zeros(30), np.repeat(q, 10)])[: 10 * N]
    (step,) = asked(q, warmed(late, 23.0))
    assert step["effect"] == "input_delay"
    lo, hi = step["parameters"]["delay"]["ci95"]
    assert abs(6.0 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo) < 1.0


@pytest.mark.long
@pytest.mark.parametrize("on", [0.0, pytest.param(1.0, marks=pytest.mark.long)])
def test_what_is_the_same_is_as_probable(on: float, asked: Callable[..., Any]) -> None:
    """A lag before a linear plant at rest is one behind it: whichever is named, the other is as probable as it."""
    q, h = switched(on), DT / 10
    acting, now = np.empty(10 * N), 0.0
    for k, wanted in enumerate(np.repeat(q, 10)):
        after = wanted + (now - wanted) * np.exp(-h / 8.0)
        acting[k], now = 0.5 * (now + after), after
    (step,) = asked(q, warmed(acting, 23.0))
    both = {"input_lag", "sensor_lag"}
    assert {step["effect"], *step["indistinguishable"]} == both
    assert (
        step["probability"] < 0.75
    )  # by symmetry a half; priors of what was before differ by less than a nat


@pytest.mark.parametrize("is_held", [True, False])
def test_columns_that_are_alike_are_computed_once(is_held: bool) -> None:
    """What acts in each column is what acts in a signal of that column alone, and alike columns are one."""
    t, u = np.arange(9) * 0.1, np.array([1.0, 2.0, -1.0, 0.5, 0.5, 3.0, 0.0, 1.0, 2.0])
    late, lag = np.array([0.2, 0.37, 0.2, 0.2]), np.array([0.3, 0.3, 0.3, 0.1])
    before = np.array([0.0, -1.0, 0.0, 0.0])
    signal = Signal.of(t, u, is_held, [InputDelay(late), InputLag(lag), Saturation(np.full(4, 1.5))], before)
    assert signal.before.size == 3  # the first column and the third are alike
    times = np.linspace(0.0, 0.8, 33)
    for j in range(4):
        changes = [InputDelay(late[j]), InputLag(lag[j]), Saturation(1.5)]
        alone = Signal(t, u, is_held, changes, before[j : j + 1])
        assert signal.nodes(0, 8, 3)[..., j] == pytest.approx(alone.nodes(0, 8, 3)[..., 0], abs=1e-12)
        assert signal.at(times)[:, j] == pytest.approx(alone.at(times)[:, 0], abs=1e-12)
    assert signal.samples == pytest.approx(np.tile(np.minimum(u, 1.5)[:, None], 4))


@pytest.mark.parametrize("change", [InputDelay(0.37), InputLag(0.3)])
def test_an_input_that_was_another_one(change: Any) -> None:
    """Its integral over each step is that of the closed solution, by quadrature."""
    t, u, before = np.arange(8) * 0.1, np.array([1.0, 2.0, -1.0, 0.5, 0.5, 3.0, 0.0, 1.0]), -2.5
    signal = Signal(t, u, True, [change], np.array([before]))

    def held(s: float) -> float:
        return float(u[min(int(s / 0.1 + 1e-12), 7)]) if s >= 0.0 else 1.0 + before

    def acting(s: float) -> float:
        if isinstance(change, InputDelay):
            return held(s - 0.37)
        x, k = 1.0 + before, 0
        while (k + 1) * 0.1 <= s:
            x, k = u[k] + (x - u[k]) * np.exp(-0.1 / 0.3), k + 1
        return float(u[k] + (x - u[k]) * np.exp(-(s - 0.1 * k) / 0.3))

    means = signal.nodes(0, 7, 1)[:, 0, :, 0] @ (
        [1.0] if isinstance(change, InputDelay) else [1 / 6, 4 / 6, 1 / 6]
    )
    for k in range(7):
        points = [p for p in 0.37 + t if 0.1 * k < p < 0.1 * (k + 1)]
        exact = quad(acting, 0.1 * k, 0.1 * (k + 1), points=points or None, limit=200)[0] / 0.1
        assert means[k] == pytest.approx(exact, abs=1e-6)
