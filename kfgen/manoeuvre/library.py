"""The manoeuvres that simulation and audit know by name (static, s-turn, figure-8 ...), as data.

Durations are shares of the whole length ``T``, so that a manoeuvre fills a log of any length. A new manoeuvre is one
entry here, or a file of the user's.
"""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.core.expression import read_expression
from kfgen.manoeuvre.manoeuvre import EXPRESSION_NAMES, Manoeuvre, Segment, Triple

Row = tuple[str, str, str]
ZERO_ROW: Row = ("0", "0", "0")


def _triple(row: Row) -> Triple:
    x, y, z = (read_expression(text, EXPRESSION_NAMES, "library") for text in row)
    return x, y, z


def _part(duration: str, rate: Row = ZERO_ROW, acceleration: Row = ZERO_ROW, body: Row = ZERO_ROW) -> Segment:
    return Segment(
        read_expression(duration, EXPRESSION_NAMES, "library"),
        _triple(rate),
        _triple(acceleration),
        _triple(body),
    )


def _turns(*axes: Sequence[str]) -> tuple[Segment, ...]:
    """Rests with a turn between them about each of some body axes."""
    share = f"T/{2 * len(axes) + 1}"
    still = _part(share)
    return (still, *(s for axis in axes for s in (_part(share, (axis[0], axis[1], axis[2])), still)))


_QUARTER_TURN_RATE = "11*pi/2/T"
_CIRCLE_RATE = "4*pi/T"
_ARC_RAD = "1.2"

_ENTRIES = (
    Manoeuvre("static", "at rest, level, heading north", (_part("T"),)),
    Manoeuvre(
        "yaw-turn",
        "half a turn about the vertical",
        (_part("T/3"), _part("T/3", ("0", "0", "3*pi/T")), _part("T/3")),
        usual=30.0,
    ),
    Manoeuvre(
        "two-position",
        "two rests, a quarter turn about the vertical between them",
        (_part("0.45*T"), _part("0.1*T", ("0", "0", "5*pi/T")), _part("0.45*T")),
        usual=60.0,
    ),
    Manoeuvre(
        "six-position",
        "six rests, each axis up and down",
        _turns(
            (_QUARTER_TURN_RATE, "0", "0"),
            (_QUARTER_TURN_RATE, "0", "0"),
            (_QUARTER_TURN_RATE, "0", "0"),
            ("0", "0", _QUARTER_TURN_RATE),
            ("0", "0", "11*pi/T"),
        ),
        usual=120.0,
    ),
    Manoeuvre(
        "hover",
        "on the spot, turning slowly about the vertical",
        (_part("T", ("0", "0", "0.2")),),
        usual=30.0,
    ),
    Manoeuvre("cruise", "straight and level at 20 m/s", (_part("T"),), velocity=(20.0, 0.0, 0.0), usual=30.0),
    Manoeuvre(
        "accelerate",
        "north from rest, and braking again",
        (
            _part("T/3"),
            _part("T/3", acceleration=("1", "0", "0")),
            _part("T/3", acceleration=("-1", "0", "0")),
        ),
        usual=15.0,
    ),
    Manoeuvre(
        "s-turn",
        "level, at 10 m/s, a turn to the right and one to the left",
        (
            _part("T/2", ("0", "0", f"2*{_ARC_RAD}/T"), body=("0", f"20*{_ARC_RAD}/T", "0")),
            _part("T/2", ("0", "0", f"-2*{_ARC_RAD}/T"), body=("0", f"-20*{_ARC_RAD}/T", "0")),
        ),
        velocity=(10.0, 0.0, 0.0),
        usual=20.0,
    ),
    Manoeuvre(
        "figure-8",
        "level, at 10 m/s, a circle to the right and one to the left",
        (
            _part("T/2", ("0", "0", _CIRCLE_RATE), body=("0", f"10*{_CIRCLE_RATE}", "0")),
            _part("T/2", ("0", "0", f"-{_CIRCLE_RATE}"), body=("0", f"-10*{_CIRCLE_RATE}", "0")),
        ),
        velocity=(10.0, 0.0, 0.0),
        usual=40.0,
    ),
    Manoeuvre(
        "drive",
        "a car on a plane: speed and heading vary",
        (
            _part(
                "T",
                ("0", "0", "0.3*sin(0.4*t)"),
                body=("sin(0.5*t)", "0.3*sin(0.4*t)*(10 + 2*(1 - cos(0.5*t)))", "0"),
            ),
        ),
        velocity=(10.0, 0.0, 0.0),
        usual=30.0,
    ),
    # Bank of cosine 0.8 and sine 0.6: in a steady turn its tangent is the centripetal acceleration over gravity.
    Manoeuvre(
        "coordinated-turn",
        "a steady banked turn at constant speed and height",
        (_part("T", ("0", "0.15", "0.2"), body=("0", "0.6*g", "-0.45*g")),),
        velocity=(29.41995, 0.0, 0.0),
        attitude=(3.0, 1.0, 0.0, 0.0),
        usual=30.0,
    ),
    Manoeuvre(
        "generic",
        "rates and accelerations about all axes",
        (
            _part(
                "T",
                ("0.5*sin(2*pi*0.11*t)", "0.4*sin(2*pi*0.17*t)", "0.6*sin(2*pi*0.07*t)"),
                ("sin(2*pi*0.05*t)", "1.5*sin(2*pi*0.083*t)", "0.7*sin(2*pi*0.13*t)"),
            ),
        ),
        usual=60.0,
    ),
)

LIBRARY: dict[str, Manoeuvre] = {m.name: m for m in _ENTRIES}
"""By name."""
