"""Which topics of a PX4 log are which channels: sources of each sensor, the preferred one first.

Field names are those of the message definitions of PX4 v1.6 to v1.17 (https://docs.px4.io, uORB message reference).
Axes of the vehicle are forward, right, down, those of positions and velocities north, east, down, as kfgen has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class TopicSource:
    """A topic that has a sensor's channels.

    Parameters
    ----------
    topic : str
    fields : mapping of str to (str, str)
        By channel: the topic's field and its unit.
    increments : mapping of str to str
        By the beginning of channels' names: the field with the interval [us] by which an increment is divided.
    late : str
        Field with the sample's time after the topic's stamp [us]; empty where the stamp is the sample's.
    """

    topic: str
    fields: Mapping[str, tuple[str, str]]
    increments: Mapping[str, str] = field(default_factory=dict)
    late: str = ""


def _triad(sensor: str, name: str, unit: str) -> dict[str, tuple[str, str]]:
    return {f"{sensor}_{axis}": (f"{name}[{k}]", unit) for k, axis in enumerate("xyz")}


def _axes(sensor: str, unit: str) -> dict[str, tuple[str, str]]:
    return {f"{sensor}_{axis}": (axis, unit) for axis in "xyz"}


IMU = (
    TopicSource(
        "vehicle_imu",
        {**_triad("gyro", "delta_angle", "rad/s"), **_triad("accel", "delta_velocity", "m/s^2")},
        {"gyro": "delta_angle_dt", "accel": "delta_velocity_dt"},
    ),
    TopicSource(
        "sensor_combined",
        {**_triad("gyro", "gyro_rad", "rad/s"), **_triad("accel", "accelerometer_m_s2", "m/s^2")},
    ),
    TopicSource("sensor_gyro", _axes("gyro", "rad/s")),
)
"""Inertial sensors; samples of the first two are means over the interval before their stamp."""
ACCELEROMETER = TopicSource("sensor_accel", _axes("accel", "m/s^2"))
"""What stands beside `sensor_gyro`."""
INTERVAL = {"vehicle_imu": "delta_angle_dt", "sensor_combined": "gyro_integral_dt"}
"""The field with the interval that a sample is the mean over: [us], in logs before v1.7 [s]."""
CLIPPING = ("delta_angle_clipping", "delta_velocity_clipping", "gyro_clipping", "accelerometer_clipping")
"""Fields that are not zero where a sample was clipped."""

AIDING: Mapping[str, tuple[TopicSource, ...]] = {
    "magnetometer": (
        TopicSource("vehicle_magnetometer", _triad("mag", "magnetometer_ga", "gauss")),
        TopicSource("sensor_mag", _axes("mag", "gauss")),
        TopicSource(
            "sensor_combined",
            _triad("mag", "magnetometer_ga", "gauss"),
            late="magnetometer_timestamp_relative",
        ),
    ),
    "barometer": (
        TopicSource(
            "vehicle_air_data",
            {"baro_height": ("baro_alt_meter", "m"), "pressure": ("baro_pressure_pa", "Pa")},
        ),
        TopicSource("sensor_baro", {"pressure": ("pressure", "Pa")}),
        TopicSource(
            "sensor_combined", {"baro_height": ("baro_alt_meter", "m")}, late="baro_timestamp_relative"
        ),
    ),
    "airspeed": (
        TopicSource("airspeed", {"airspeed": ("true_airspeed_m_s", "m/s")}),
        TopicSource("airspeed_validated", {"airspeed": ("true_airspeed_m_s", "m/s")}),
    ),
    "range": (TopicSource("distance_sensor", {"range": ("current_distance", "m")}),),
    "battery": (
        TopicSource("battery_status", {"current": ("current_a", "A"), "voltage": ("voltage_v", "V")}),
    ),
    "temperature": (
        TopicSource("vehicle_imu_status", {"temperature": ("temperature_gyro", "degC")}),
        TopicSource("sensor_gyro", {"temperature": ("temperature", "degC")}),
        TopicSource("sensor_accel", {"temperature": ("temperature", "degC")}),
    ),
    "vibration": (TopicSource("vehicle_imu_status", {"vibration": ("accel_vibration_metric", "m/s^2")}),),
    "throttle": (
        TopicSource("actuator_controls_0", {"throttle": ("control[3]", "1")}),
        TopicSource("vehicle_thrust_setpoint", {"throttle": ("xyz[2]", "1")}),
    ),
}
"""Aiding sensors and drivers, by what they measure."""
STATUS, CLIPPED = "vehicle_imu_status", "accel_clipping"
"""Topic of an inertial sensor's state, and its counters of clipped samples, axis by axis."""
GNSS = ("vehicle_gps_position", "sensor_gps")
"""Topics of GNSS receivers; units of their fields changed with v1.14."""
MOTORS = "actuator_motors"
"""Topic of what each motor is asked for, 0 to 1."""
