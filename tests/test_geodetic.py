"""Proves latitude, longitude and height at the border, against the closed formulas of WGS 84 that are written down here.

A place in Earth axes is ``((N + h) cos L cos l, (N + h) cos L sin l, (N (1 - e^2) + h) sin L)``, N the radius of the prime
vertical; the local axes at another place turn it to north, east, down.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part

from kfgen.emit.emit import emit
from kfgen.emit.geodetic.origin import MAX_LATITUDE, Border
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.targets.loaded import beside, imported
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.verify.compare import verify

A, E2 = 6378137.0, 6.69437999014e-3
HOME = (math.radians(48.1), math.radians(11.6), 540.0)


def border(**options: str) -> Border:
    found = Program(DiscreteModel(build("ins15", None, options))).border
    assert found is not None
    return found


def started(**options: str) -> Machine:
    machine = Machine(border(**options))
    machine.call("init")
    assert machine.call("fix", [*HOME, [0.0, 0.0, 0.0]]) == "ORIGIN_SET"
    return machine


def earth(L: float, l: float, h: float) -> Any:
    N = A / math.sqrt(1.0 - E2 * math.sin(L) ** 2)
    flat = (N + h) * math.cos(L)
    return np.array([flat * math.cos(l), flat * math.sin(l), (N * (1.0 - E2) + h) * math.sin(L)])


def level(L: float, l: float) -> Any:
    """Earth axes to north, east, down."""
    s, c, sl, cl = math.sin(L), math.cos(L), math.sin(l), math.cos(l)
    return np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0], [-c * cl, -c * sl, -s]])


def around(distance: float) -> list[tuple[float, float, float]]:
    """Places about so far from home, in eight directions."""
    angles = np.arange(8) * math.pi / 4.0
    return [
        (
            HOME[0] + distance * math.cos(a) / 6.37e6,
            HOME[1] + distance * math.sin(a) / 6.37e6 / math.cos(HOME[0]),
            600.0,
        )
        for a in angles
    ]


def test_what_comes_in_comes_out() -> None:
    """To a micrometre at 100 km."""
    machine = started()
    for at in around(1e5):
        assert machine.call("fix", [*at, [0.0, 0.0, 0.0]]) == "OK"
        assert machine.call("to_place", [machine.arrays["local"].tolist()]) == "OK"
        off = machine.arrays["place"] - at
        assert np.abs(off * [6.4e6, 6.4e6, 1.0]).max() < 1e-6


@pytest.mark.parametrize("distance", [100.0, 1e3, 1e4])
def test_metres_are_those_of_the_tangent_plane_near_the_origin(distance: float) -> None:
    """Beside the closed formulas: a parallel's metres change with latitude, by d^2 tan L / R, and with height; the horizon dips."""
    allowed = distance**2 * math.tan(HOME[0]) / 6.37e6 + 60.0 * distance / 6.37e6
    machine = started()
    R, home = level(*HOME[:2]), earth(*HOME)
    for at in around(distance):
        machine.call("fix", [*at, [0.0, 0.0, 0.0]])
        exact = R @ (earth(*at) - home)
        off = machine.arrays["local"] - exact
        assert np.linalg.norm(off[:2]) < allowed
        assert off[2] == pytest.approx(-(distance**2) / 2.0 / 6.38e6, abs=0.02 * allowed + 1e-4)


def test_a_step_of_the_way_is_as_long_as_it_is() -> None:
    """A step of 1 m, 10 km from the origin: its size is off by d tan L / R, 0.18 %, at most; near it by nothing."""
    for distance, allowed in ((1e4, 1e4 * math.tan(HOME[0]) / 6.37e6 + 1e-5), (10.0, 1e-5)):
        machine = started()
        for L, l, _ in around(distance):
            lengths = []
            for d_L, d_l in ((1e-6, 0.0), (0.0, 1e-6)):
                found = []
                for k in (0.0, 1.0):
                    machine.call("fix", [L + k * d_L, l + k * d_l, HOME[2], [0.0, 0.0, 0.0]])
                    found.append(machine.arrays["local"].copy())
                true = np.linalg.norm(earth(L + d_L, l + d_l, HOME[2]) - earth(L, l, HOME[2]))
                lengths.append(np.linalg.norm(found[1] - found[0]) / true)
            assert np.abs(np.array(lengths) - 1.0).max() < allowed


def test_what_is_refused() -> None:
    machine = Machine(border())
    machine.call("init")
    p = [0.0, 0.0, 0.0]
    assert machine.call("to_place", [p]) == "BAD_INPUT", "no origin yet"
    nowhere = [(float("nan"), 0.0, 0.0), (1.01 * MAX_LATITUDE, 0.0, 0.0), (0.0, 7.0, 0.0), (0.0, 0.0, 2e5)]
    assert [machine.call("fix", [*at, p]) for at in nowhere] == ["BAD_INPUT"] * 4
    assert machine.call("fix", [*HOME, p]) == "ORIGIN_SET"
    assert machine.call("fix", [HOME[0] + 0.2, HOME[1], HOME[2], p]) == "TOO_FAR"
    assert machine.call("fix", [*HOME, [float("nan"), 0.0, 0.0]]) == "OK"


def test_longitude_wraps() -> None:
    machine = Machine(border())
    machine.call("init")
    machine.call("fix", [0.5, math.pi - 1e-5, 0.0, [0.0, 0.0, 0.0]])
    assert machine.call("fix", [0.5, -math.pi + 1e-5, 0.0, [0.0, 0.0, 0.0]]) == "OK"
    assert machine.arrays["local"][1] == pytest.approx(2e-5 * A * math.cos(0.5), rel=2e-3)
    machine.call("to_place", [machine.arrays["local"].tolist()])
    assert machine.arrays["place"][1] == pytest.approx(-math.pi + 1e-5, abs=1e-12)


def test_the_constants_of_a_filter_are_those_of_its_origin() -> None:
    """As the model computes them at that latitude."""
    own = border(earth_rate="true")
    assert [n for _, n in own.known] == ["W_N", "W_D"]
    machine = started(earth_rate="true")
    there = build("ins15", None, {"earth_rate": "true", "latitude": "48.1 deg"})
    wanted = {c.name: c.value for c in there.constants}
    origin = machine.arrays["origin"]
    assert origin[6:].tolist() == pytest.approx([wanted["W_N"], wanted["W_D"]], rel=1e-12)


@pytest.mark.parametrize("k", in_part(range(5)))
@pytest.mark.parametrize("bad", in_part([math.nan, math.inf, -1e30]))
def test_an_origin_that_is_none_does_not_move_a_filter(k: int, bad: float) -> None:
    machine = Machine(Program(DiscreteModel(build("ins15", None, {"earth_rate": "true"})), "ud"))
    machine.call("init")
    before = [machine.arrays[name].tolist() for name in ("x", "k")]
    given = [2000.0, 300.0, 1.0, 1.001, 5e-5, -5e-5]
    given[k] = bad
    assert machine.call("recentre", [given[:2], given[2:4], given[4:]]) == "BAD_INPUT"
    assert [machine.arrays[name].tolist() for name in ("x", "k")] == before
    assert machine.call("recentre", [[2000.0, 300.0], [1.0, 1.001], [5e-5, -5e-5]]) == "OK"
    assert machine.arrays["x"][0] == -2000.0


@pytest.fixture(scope="module")
def emitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("geodetic")
    emit("ins15", folder / "f", "numpy", horizon=0.1)
    return folder / "f"


@pytest.mark.long
def test_a_filter_flies_on_over_the_origin_that_moves(emitted: Path) -> None:
    """30 km to the north-east in single precision: latitude and longitude of the estimate have no jump beyond 2 mm."""
    geodetic = beside(emitted / "ins15_geodetic.py").Geodetic()
    kf = imported(emitted / "ins15.py").Ins15()
    said = []
    for k in range(31):
        at = (HOME[0] + k * 7e2 / 6.37e6, HOME[1] + k * 7e2 / 6.37e6 / math.cos(HOME[0]), HOME[2])
        if k:
            geodetic.fix(*at, [0.0, 0.0, 0.0])
            kf.x[:3] = geodetic.local  # the filter is where the fix is
            geodetic.to_place(kf.x[:3])
        before = geodetic.place.copy()
        kf.delayed_predict([0.0, 0.0, -9.8], [0.0, 0.0, 0.0], 0.01)
        kf.present[:3] = kf.x[:3]
        status, z = geodetic.fix_of(kf, *at)
        said.append(status.name)
        if status.name == "RECENTRED":
            assert np.abs(kf.x[:2]).max() < 1e-3
            assert np.abs(kf.present[:2]).max() < 1e-3
            geodetic.to_place(kf.x[:3])
            assert np.abs((geodetic.place - before) * [6.4e6, 4.3e6, 1.0]).max() < 2e-3
            assert np.abs(z[:2]).max() < 2e-3
    assert said[0] == "ORIGIN_SET"
    assert said.count("RECENTRED") == 2
    assert set(said[1:]) == {"OK", "RECENTRED"}


@pytest.mark.long
@pytest.mark.parametrize("core", ["host", "hostcpp", "m4f"])
def test_every_core_has_its_words(core: str, tmp_path: Path) -> None:
    emit("ins9", tmp_path / "f", "c")
    assert verify(tmp_path / "f", [core]).ok


def test_a_filter_without_a_place_has_no_border() -> None:
    assert Program(DiscreteModel(build("ahrs6"))).border is None
    assert Program(DiscreteModel(build("ins15", None, {"frame": "ecef"}))).border is None
