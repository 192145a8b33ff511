"""Proves manoeuvres: their files, their motion in numbers against closed forms, and clear errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.manoeuvre.file import manoeuvre, parse_manoeuvre, quaternion
from kfgen.manoeuvre.flight import wanted
from kfgen.manoeuvre.library import LIBRARY
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.manoeuvre.truth import along
from kfgen.model.library import build

HEAD = 'format = "kfgen-manoeuvre-1"\n'
G = 9.80665


@dataclass
class Truth:
    f_b: np.ndarray
    v_n: np.ndarray
    p_n: np.ndarray
    R_nb: np.ndarray


def truth(m: Manoeuvre, t: np.ndarray) -> Truth:
    found = along(build("ins15"), wanted(m, t), {})
    rows = [[f"accel_{a}" for a in "xyz"], [f"v_{a}" for a in "NED"], [f"p_{a}" for a in "NED"]]
    f_b, v_n, p_n = (np.column_stack([found[n] for n in row]) for row in rows)
    R = np.column_stack([found[f"R_nb_{i}{j}"] for i in range(3) for j in range(3)]).reshape(-1, 3, 3)
    return Truth(f_b, v_n, p_n, R)


def parsed(text: str) -> Any:
    return parse_manoeuvre(HEAD + text, "m.toml")


@pytest.mark.parametrize("name", LIBRARY)
def test_every_library_manoeuvre_fills_any_length(name: str) -> None:
    for T in (30.0, 600.0):
        assert LIBRARY[name].starts(T)[-1] == pytest.approx(T, rel=1e-12)


def test_steady_turn_is_a_circle_without_side_force() -> None:
    """Radius V / r; the specific force of a coordinated turn lies along the body's vertical, g / cos(bank)."""
    t = np.linspace(0.0, 2 * np.pi / 0.25, 20001)
    true = truth(LIBRARY["coordinated-turn"], t)
    assert true.f_b == pytest.approx(np.tile([0.0, 0.0, -G / 0.8], (t.size, 1)), abs=1e-3)
    assert true.v_n[-1] == pytest.approx(true.v_n[0], abs=0.02)
    east = true.p_n[:, 1]
    assert east.max() - east.min() == pytest.approx(2 * 29.41995 / 0.25, rel=1e-3)


def test_six_positions_hold_every_axis_up_and_down() -> None:
    t = np.linspace(0.0, 1100.0, 11001)
    true = truth(LIBRARY["six-position"], t)
    middles = [500 + 2000 * k for k in range(6)]
    shown = {tuple(np.round(true.f_b[k] / G).astype(int).tolist()) for k in middles}
    assert shown == {(0, 0, -1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0), (-1, 0, 0)}


def test_yaw_turn_ends_half_way_round() -> None:
    true = truth(LIBRARY["yaw-turn"], np.arange(3001) * 0.01)
    assert true.R_nb[-1] == pytest.approx(np.diag([-1.0, -1.0, 1.0]), abs=1e-9)


def test_file_with_units_and_expressions() -> None:
    m = parsed(
        'velocity = ["36 km/h", 0, 0]\nattitude = ["90 deg", 0, 0]\n'
        '[[segment]]\nduration = "1 min"\nrate = ["90 deg/s", 0.5, "sin(t)/T"]\n'
        '[[segment]]\nstart = "60 s"\nduration = 2\nacceleration = ["g", "-1 m/s^2", "0.5*t"]\n'
    )
    assert m.length == pytest.approx(62.0)
    assert m.velocity == pytest.approx((10.0, 0.0, 0.0))
    rate, acceleration, _ = m.values(np.array([0.0, 3.0, 61.0, 62.0]))
    assert rate[1] == pytest.approx([np.pi / 2, 0.5, np.sin(3.0) / 62.0])
    assert acceleration[2] == pytest.approx([G, -1.0, 0.5])
    assert np.abs(rate[2]).max() == 0.0
    assert truth(m, np.arange(3.0)).R_nb[0] == pytest.approx(
        np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), abs=1e-12
    )


def test_quaternion_of_angles_turns_yaw_then_pitch_then_roll() -> None:
    from scipy.spatial.transform import Rotation

    wanted = Rotation.from_euler("ZYX", [0.3, -0.4, 1.1]).as_quat(scalar_first=True)
    assert quaternion(1.1, -0.4, 0.3) == pytest.approx(wanted)


BAD = {
    "no segment": ("", "no segment"),
    "empty list": ("segment = []\n", "no segment"),
    "zero": ('[[segment]]\nduration = "0 s"\n', "segment 1"),
    "negative": ("[[segment]]\nduration = -3\n", "positive"),
    "infinite": ("[[segment]]\nduration = inf\n", "not finite"),
    "not a number": ("[[segment]]\nduration = nan\n", "not finite"),
    "no duration": ("[[segment]]\nrate = [0, 0, 1]\n", "no duration"),
    "overlap": ("[[segment]]\nduration = 5\n[[segment]]\nstart = 4\nduration = 5\n", "overlaps"),
    "gap": ("[[segment]]\nduration = 5\n[[segment]]\nstart = 6\nduration = 5\n", "gap"),
    "two axes": ("[[segment]]\nduration = 5\nrate = [0, 1]\n", "list of three"),
    "unit": ('[[segment]]\nduration = 5\nrate = ["3 m", 0, 0]\n', "rate 1"),
    "unknown name": ('[[segment]]\nduration = 5\nrate = ["speed*t", 0, 0]\n', "'speed'"),
    "call": ('[[segment]]\nduration = 5\nrate = ["__import__(1)", 0, 0]\n', "__import__"),
    "key": ("[[segment]]\nduration = 5\nspin = 3\n", "'spin'"),
    "moving duration": ('[[segment]]\nduration = "t"\n', "depend on t"),
    "velocity": ("velocity = 3\n[[segment]]\nduration = 5\n", "list of three"),
}


@pytest.mark.parametrize(("text", "said"), BAD.values(), ids=BAD)
def test_bad_file_says_what_and_where(text: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        parsed(text)
    assert said in str(error.value)
    assert "m.toml" in str(error.value)


def test_infinite_expression_says_when() -> None:
    m = parsed('[[segment]]\nduration = 5\nrate = ["1/(t - 2)", 0, 0]\n')
    with pytest.raises(InputError, match="2 s after the start"):
        m.values(np.arange(6.0))


def test_other_format_and_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="kfgen-manoeuvre-1"):
        parse_manoeuvre('format = "kfgen-model-1"', "m.toml")
    with pytest.raises(InputError, match="no such file"):
        manoeuvre(str(tmp_path / "gone.toml"))
    with pytest.raises(InputError, match="no TOML"):
        parse_manoeuvre("][", "m.toml")


def test_simulation_flies_a_file(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "spin.toml"
    path.write_text(HEAD + '[[segment]]\nduration = "2 s"\nrate = [0, 0, "0.5"]\n')
    log = tmp_path / "log.npz"
    done = kfgen("simulate", "ahrs6", "--manoeuvre", path, "--duration", 4, "--rate", 50, "-o", log)
    assert done.exit_code == 0, done.output
    from kfgen.log.readers import read_log

    q = read_log(log).channels["ref_q_z"].values
    assert q[-1] == pytest.approx(np.sin(0.5), abs=0.01)
