"""What a calibration is said to have, in words: what the log shows, what it leaves open, how to turn the sensor."""

from __future__ import annotations

from kfgen.core.numbers import few_digits, quantity
from kfgen.core.units import from_si

EACH_TURNED_ONCE = "each axis was turned once: no second turn checks the first. Turn each both ways"


def how_to_turn(axis: str) -> str:
    """Of readings that vary least along an axis."""
    return f"turn it so that its {axis} axis points up, down and sideways too"


def covers(sensor: str, share: float) -> str:
    """The share of the directions that readings cover.

    Parameters
    ----------
    sensor : str
    share : float
    """
    return f"the readings of {sensor} cover {100.0 * share:.0f} % of the directions"


def near_one_plane(sensor: str, share: float) -> str:
    """Of readings that lie near one plane.

    Parameters
    ----------
    sensor : str
    share : float
        Of the directions.
    """
    return f"{covers(sensor, share)} and lie near one plane: bias and scale across it cannot be distinguished"


def low_coverage(sensor: str, share: float) -> str:
    """Of readings that cover few directions.

    Parameters
    ----------
    sensor : str
    share : float
        Of the directions.
    """
    return f"{covers(sensor, share)}; numbers along the others are less well known than a full turn would make them"


def open_angle(label: str) -> str:
    """Of an angle between two axes that the poses leave open."""
    return f"{label}: the poses do not tell it; rest the sensor on an edge between these two axes"


def not_turned(axis: str) -> str:
    """Of an axis of a gyro about which there is no turn."""
    return f"{axis} was not turned, and is not calibrated"


def other_turns(count: int, angle_deg: float) -> str:
    """Of motions that are no turns by the known angle.

    Parameters
    ----------
    count : int
    angle_deg : float
        [deg].
    """
    return f"{count} motions between rests are no turn by {angle_deg:.4g} deg, and are left out"


def uneven_field(sensor: str, before: float, after: float) -> str:
    """Of a field that is not the same in all places.

    Parameters
    ----------
    sensor : str
    before, after : float
        Root mean square error of its length without and with the calibration [T].
    """
    return (
        f"{sensor}: the calibration takes the error of the length from {quantity(before, 'uT')} to "
        f"{quantity(after, 'uT')} only: the field is not the same in all places of the log, and the numbers describe it "
        "as much as the sensor. Turn the sensor in one place, away from iron"
    )


def misfit(sensor: str, times: float) -> str:
    """Of residuals so many times the noise."""
    return f"{sensor}: what is left is {few_digits(times)} times the noise; the intervals include it"


def readings(sensor: str, count: int, share: float) -> str:
    """How much was read of a sensor.

    Parameters
    ----------
    sensor : str
    count : int
        Poses, samples or turns.
    share : float
        Of the directions; of a gyro, of its axes.
    """
    if sensor == "gyro":
        return f"{count} turns about {round(3 * share)} axes"
    return f"{count} {'poses' if sensor == 'accel' else 'samples'}, {100.0 * share:.0f} % of the directions"


def error_of(sensor: str, before: float, after: float, unit: str) -> str:
    """What the calibration does to the error of a length, or of an angle.

    Parameters
    ----------
    sensor : str
    before, after : float
        Root mean squares [SI].
    unit : str
        In which they are shown.
    """
    what = "angle" if sensor == "gyro" else "length"
    return (
        f"root mean square error of the {what} {from_si(before, unit):.3g} {unit} before, "
        f"{from_si(after, unit):.3g} {unit} after"
    )
