"""Proves the exact engine on the known answers of ``docs/observability.md``: the count of each row, and its directions."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from audit_models import (
    DELAY,
    FEATURE,
    IRON,
    LEVER,
    NAV_FIELD,
    W_D,
    W_N,
    CoriolisStrapdown,
    EarthStrapdown,
    G,
    Misaligned,
    ScaledStrapdown,
    With,
    ahrs,
    antenna,
    both_fields,
    camera,
    flown,
    gravity,
    heading,
    hidden,
    holds,
    ins,
    iron,
    late,
    magnetic,
    model,
    own_field,
    part,
    plant,
)

from kfgen.audit.exact.chain import along
from kfgen.audit.exact.plan import Plan
from kfgen.manoeuvre.library import LIBRARY
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.parts.motion import Rotating, Strapdown
from kfgen.model.parts.sensors import GnssPosition, GnssVelocity

STATIC, GENERIC, HOVER = LIBRARY["static"], LIBRARY["generic"], LIBRARY["hover"]
NORTH = flown(part(a=(1, 0, 0)))
VARYING_N = flown(part("10", a=(1, 0, 0)), part("10", a=(-2, 0, 0)), part("10", a=("t", 0, 0)))
VARYING_NE = flown(part("10", a=(1, 0, 0)), part("10", a=(0, 2, 0)), part("10", a=("-t", 1, 0)))


def turned(angle: str) -> Manoeuvre:
    return flown(part("300"), part("30", rate=(0, 0, f"{angle}/30")), part("300"))


PLANE = LIBRARY["drive"]
TILTS = ({"phi_E": 1, "ba_x": -G}, {"phi_N": 1, "ba_y": G})
MEMS = ({"phi_D": 1}, {"bg_z": 1}, *TILTS)
EARTH = (
    {"phi_D": 1, "bg_y": W_N},
    {"phi_E": 1, "bg_x": W_D, "bg_z": -W_N, "ba_x": -G},
    {"phi_N": 1, "phi_D": W_D / W_N, "ba_y": G},
)
FIELD_D = Fraction(44, 20)

SCALED = model(ScaledStrapdown(), GnssPosition())
VIO = model(With(Strapdown(), FEATURE), camera)


ROWS: dict[str, tuple[FilterModel, Manoeuvre, int, tuple[dict[str, Any], ...]]] = {
    "3 earth, static": (ins(EarthStrapdown()), STATIC, 3, EARTH),
    "4 no earth, static": (ins(), STATIC, 4, MEMS),
    "5 no earth, constant acceleration": (
        ins(),
        NORTH,
        4,
        # Only the rotation about the specific force (1, 0, -g) needs no bias; about other axes it does.
        ({"phi_N": -1 / G, "phi_D": 1}, {"phi_E": 1, "ba_x": -G, "ba_z": -1}, {"phi_N": 1, "ba_y": G}),
    ),
    # The tilt may stay, hidden by ba = -f x phi and bg = -w x phi, with f = (1, 0, -g).
    "5 earth, constant acceleration": (
        ins(EarthStrapdown()),
        NORTH,
        3,
        (
            {"phi_D": 1, "ba_y": 1, "bg_y": W_N},
            {"phi_E": 1, "ba_x": -G, "ba_z": -1, "bg_x": W_D, "bg_z": -W_N},
            {"phi_N": 1, "ba_y": G, "bg_y": -W_D},
        ),
    ),
    "6 varying, north": (ins(), VARYING_N, 1, ({"phi_N": 1, "ba_y": G},)),
    "6 varying, north and east": (ins(), VARYING_NE, 0, ()),
    "9 earth, quarter turn": (ins(EarthStrapdown()), turned("pi/2"), 0, ()),
    "9 earth, half turn": (ins(EarthStrapdown()), turned("pi"), 0, ()),
    "11 heading": (ins(None, heading), STATIC, 2, TILTS),
    "13 camera": (VIO, GENERIC, 4, tuple({f"f1_{a}": 1, f"p_{a}": 1} for a in "NED")),
    "14 none": (ahrs(), GENERIC, 6, ()),
    "14 accel, static": (ahrs(gravity), STATIC, 2, ({"phi_D": 1}, {"bg_z": 1})),
    "14 accel, yaw": (ahrs(gravity), LIBRARY["yaw-turn"], 2, ({"phi_D": 1}, {"bg_z": 1})),
    "14 accel, generic": (ahrs(gravity), GENERIC, 1, ({"phi_D": 1},)),
    "14 mag, static": (
        ahrs(magnetic),
        STATIC,
        2,
        ({"phi_N": 1, "phi_D": FIELD_D}, {"bg_x": 1, "bg_z": FIELD_D}),
    ),
    "14 mag, generic": (ahrs(magnetic), GENERIC, 1, ({"phi_N": 1, "phi_D": FIELD_D},)),
    "14 both, static": (ahrs(gravity, magnetic), STATIC, 0, ()),
    # Yaw by one radian turns the field by its north part towards east: the iron takes it back.
    "15 iron, static": (
        model(With(Rotating(), IRON), gravity, iron),
        STATIC,
        1,
        ({"phi_D": 1, "h_y": Fraction("2e-5")},),
    ),
    "15 iron, yaw": (model(With(Rotating(), IRON), gravity, iron), HOVER, 0, ()),
    "18 scales, generic": (SCALED, GENERIC, 0, ()),
    "18 scales, static": (
        SCALED,
        STATIC,
        10,
        (
            {"phi_D": 1},
            {"bg_z": 1},
            *({f"sg_{a}": 1} for a in "xyz"),
            *({f"sa_{a}": 1} for a in "xy"),
        ),
    ),
    "18 scales, on a plane": (SCALED, PLANE, 3, ({"sg_x": 1}, {"sg_y": 1})),
    "21 delay, constant velocity": (
        model(With(Strapdown(), DELAY), late, GnssVelocity()),
        LIBRARY["cruise"],
        5,
        ({"p_N": 20, "td": 1}, *MEMS),
    ),
    "21 delay, accelerated": (model(With(Strapdown(), DELAY), late), GENERIC, 0, ()),
}


@pytest.mark.parametrize(("m", "manoeuvre", "nullity", "directions"), ROWS.values(), ids=ROWS)
def test_row(
    m: FilterModel, manoeuvre: Manoeuvre, nullity: int, directions: tuple[dict[str, Any], ...]
) -> None:
    h = hidden(m, manoeuvre)
    assert h.nullity == nullity
    for d in directions:
        assert holds(m, h, **d), d


def test_row_18_on_a_plane_the_down_accelerometer_has_one_sum() -> None:
    """Specific force down is always -g: its scale and its bias show as one, ``ba_z = -g sa_z`` around zero."""
    (h,) = along(Plan(SCALED, SCALED.sensors), [PLANE], generic=False)
    assert h.nullity == 3
    for direction in ({"sg_x": 1}, {"sg_y": 1}, {"sa_z": 1, "ba_z": -G}):
        assert holds(SCALED, h, **direction)


ALIGNMENT = """
name = "alignment"
[parameters]
g = "9.80665 m/s^2"
W_N = "4.375269e-5 rad/s"
W_D = "-5.833692e-5 rad/s"
[states]
vN = "m/s"
vE = "m/s"
phiN = "rad"
phiE = "rad"
phiD = "rad"
bgN = "rad/s"
bgE = "rad/s"
bgD = "rad/s"
baN = "m/s^2"
baE = "m/s^2"
[dynamics]
vN = "g*phiE + baN"
vE = "-g*phiN + baE"
phiN = "W_D*phiE - bgN"
phiE = "W_N*phiD - W_D*phiN - bgE"
phiD = "-W_N*phiE - bgD"
bgN = "0"
bgE = "0"
bgD = "0"
baN = "0"
baE = "0"
[measurements.north]
unit = "m/s"
expression = "vN"
effects = [ { effect = "white_noise", N = "0.01 m/s/sqrt(Hz)" } ]
[measurements.east]
unit = "m/s"
expression = "vE"
effects = [ { effect = "white_noise", N = "0.01 m/s/sqrt(Hz)" } ]
"""


def test_row_2_stationary_alignment() -> None:
    m = plant(ALIGNMENT)
    h = hidden(m, STATIC)
    assert h.nullity == 3
    assert holds(m, h, phiD=1, bgE=W_N)
    assert holds(m, h, phiE=1, bgN=W_D, bgD=-W_N, baN=-G)
    assert holds(m, h, phiN=1, phiD=W_D / W_N, baE=G)


HEMERLY = """
name = "gyro"
[states]
x1 = "1"
x2 = "1"
B = "1"
K = "1"
beta = "1"
[dynamics]
x1 = "x2"
x2 = "-beta*x2"
B = "0"
K = "0"
beta = "0"
[measurements.y]
unit = "1"
expression = "K*beta*x1 + sqrt(K**2 + beta**2*B**2)*x2"
effects = [ { effect = "white_noise", N = "0.01 1/sqrt(Hz)" } ]
"""


def test_row_1_parameters_of_a_gyro_as_states_leave_two_hidden() -> None:
    """Along the motion ``y = K (beta x1 + x2) + (r - K) x2 exp(-beta t)``: three numbers for five states."""
    assert hidden(plant(HEMERLY), STATIC).nullity == 2


WHEELS = build("ins15", None, {"sensors": "odometer,non_holonomic"})
FACTS: dict[str, tuple[FilterModel, Manoeuvre, int, tuple[dict[str, Any], ...]]] = {
    # In a steady turn about the vertical a tilt that turns with the body is hidden by biases of the body.
    "hovering": (
        ins(),
        HOVER,
        4,
        (
            {"phi_D": 1},
            {"bg_z": 1},
            {"phi_N": 1, "ba_y": G, "bg_y": Fraction(-1, 5)},
            {"phi_E": 1, "ba_x": -G, "bg_x": Fraction(1, 5)},
        ),
    ),
    # Wheels show speed along the body only: place and heading stay free, on a plane and at any speed.
    "wheels, on a plane": (
        WHEELS,
        PLANE,
        4,
        ({"p_N": 1}, {"p_E": 1}, {"p_D": 1}, {"phi_D": 1, "v_E": 10}),
    ),
    "wheels, at rest": (WHEELS, STATIC, 7, ({"p_N": 1}, {"p_E": 1}, {"p_D": 1}, *MEMS)),
    "steady turn": (ins(), LIBRARY["coordinated-turn"], 3, ()),
    # At rest the arm adds to position; nothing distinguishes them, beside the four of row 4.
    "lever arm, static": (model(With(Strapdown(), LEVER), antenna), STATIC, 7, ()),
    # The arm's horizontal part circles: the biases hide it, as they hide tilts; heading turns it. The rate is seen.
    "lever arm, hovering": (
        model(With(Strapdown(), LEVER), antenna),
        HOVER,
        6,
        (
            {"l_z": 1, "p_D": -1},
            {"l_x": 1, "p_N": -1, "v_E": Fraction(-1, 5), "ba_x": Fraction(-1, 25)},
            {"l_y": 1, "p_E": -1, "v_N": Fraction(1, 5), "ba_y": Fraction(-1, 25)},
        ),
    ),
    # With the Coriolis force a constant acceleration is no constant specific force.
    "coriolis, constant acceleration": (
        ins(CoriolisStrapdown()),
        NORTH,
        1,
        ({"phi_E": 1, "ba_x": -G, "ba_z": -1, "bg_x": W_D, "bg_z": -W_N},),
    ),
    "lever arm, generic": (model(With(Strapdown(), LEVER), antenna), GENERIC, 0, ()),
    # An unknown field in the navigation frame turns with the heading, which gravity does not show.
    "earth field, static": (model(With(Rotating(), NAV_FIELD), gravity, own_field), STATIC, 1, ()),
    "earth field, generic": (model(With(Rotating(), NAV_FIELD), gravity, own_field), GENERIC, 1, ()),
    "misalignment matrix, generic": (model(Misaligned(), GnssPosition()), GENERIC, 0, ()),
    # At rest one specific force is seen: of the nine entries only the third column acts, as the biases do.
    "misalignment matrix, static": (model(Misaligned(), GnssPosition()), STATIC, 13, ()),
}


@pytest.mark.parametrize(("m", "manoeuvre", "nullity", "directions"), FACTS.values(), ids=FACTS)
def test_fact(
    m: FilterModel, manoeuvre: Manoeuvre, nullity: int, directions: tuple[dict[str, Any], ...]
) -> None:
    test_row(m, manoeuvre, nullity, directions)


def test_unknown_field_and_iron_at_rest_and_turning() -> None:
    m = model(With(With(Rotating(), NAV_FIELD), IRON), gravity, both_fields)
    assert hidden(m, STATIC).nullity == 4
    assert hidden(m, HOVER).nullity == 2
    assert hidden(m, GENERIC).nullity == 1
