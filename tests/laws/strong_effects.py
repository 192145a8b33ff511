"""Every effect of the catalogue at a strong size, where it may act: what the laws are tried on.

The laws of records at rest and of plants have strengths of their own, against the noise of their logs.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Any

from kfgen.effects import Effect, make


@dataclass(frozen=True)
class Strong:
    """An effect at a strong size.

    Parameters
    ----------
    effect : Effect
    where : tuple of str
        Channels or sensors of ``ahrs6`` and ``ins15`` where it acts; of a plant, states, inputs and channels.
    """

    effect: Effect
    where: tuple[str, ...]

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name


def strong(name: str, *where: str, **values: Any) -> Strong:
    """An effect at a strong size and where it acts."""
    return Strong(make(name, **values), where)


RATE = 0.05
"""A strong error of a rate [rad/s]."""
G = 9.80665
GYRO = ("gyro_x",)
BOTH = ("gyro_x", "accel_x")
TRIADS = ("gyro", "accel", "mag")

RESPONSE = {k: v for i in range(1, 17) for k, v in ((f"frequency_{i}", 2.0 + 3.0 * i), (f"gain_{i}", 0.8**i))}
"""Of a sensor that passes less and less."""

REST = (
    strong("white_noise", *BOTH, N=1e-2),
    strong("sample_noise", *BOTH, sd=0.1),
    strong("bias", *BOTH, value=RATE, sd=RATE),
    strong("bias_instability", *BOTH, B=1e-2),
    strong("power_law_noise", *BOTH, B=1e-2, slope=1.5),
    strong("rate_random_walk", *BOTH, K=1e-2),
    strong("gauss_markov", *BOTH, sigma=1e-2, tau=2.0),
    strong("quantisation", *BOTH, Q=1e-4),
    strong("rate_ramp", *BOTH, R=1e-3),
    strong("warm_up", *BOTH, size=RATE, tau=10.0),
    strong("sinusoid", *BOTH, amplitude=RATE, frequency=7.0, phase=0.3),
    strong("periodic_wave", *BOTH, size=RATE, period=2.0, duty=0.3, flank=0.05, start=0.4),
    strong("resonance", *BOTH, frequency=11.0, damping=0.02, rms=RATE),
    strong("low_pass", *BOTH, corner=5.0),
    strong("sensor_response", *BOTH, start=2.0, **RESPONSE),
    strong("random_telegraph", *BOTH, size=RATE, dwell=5.0),
    strong("bias_step", *BOTH, size=RATE, time=20.0),
    strong("noise_change", *BOTH, ratio=4.0, time=20.0),
    strong("outliers", *BOTH, share=0.02, sigma=10 * RATE),
    strong("intermittent_noise", *BOTH, ratio=5.0, share=0.3, lasting=2.0),
    strong("temperature", *BOTH, coefficient=1e-2),
    strong("temperature_squared", *BOTH, coefficient=1e-2),
    strong("temperature_rate", *BOTH, coefficient=1.0),
    strong("thermal_lag", *BOTH, lag=20.0, coefficient=1e-2),
    strong("thermal_hysteresis", *BOTH, width=0.5, coefficient=1e-2),
    strong("noise_temperature", *BOTH, slope=0.2),
    strong("air_pressure", *BOTH, coefficient=1e-4),
    strong("humidity", *BOTH, coefficient=1e-2),
    strong("supply_voltage", *BOTH, coefficient=1e-1),
    strong("supply_current", *BOTH, coefficient=1e-1),
)
SHARED = (strong("cross_axis_noise", rho=0.9),)
INERTIAL = (
    strong("scale_factor", *BOTH, coefficient=0.02),
    strong("scale_asymmetry", *BOTH, coefficient=0.02),
    strong("scale_temperature", *BOTH, coefficient=0.01),
    strong("nonlinearity", "gyro_x", k2=0.05, k3=0.02),
    strong("nonlinearity", "accel_x", k2=5e-3, k3=2e-4),
    strong("misalignment", "gyro_x", "accel_x", "gyro", "accel", xy=radians(1.0), xz=-radians(0.5)),
    strong("mounting", "imu", "mag", x=radians(2.0), y=-radians(1.0), z=radians(1.5)),
    strong("g_sensitivity", "gyro_x", "gyro", xx=1e-3, xy=-1e-3),
    strong("g_squared", "gyro_x", xx=1e-3 / G),
    strong("vibration_rectification", *BOTH, coefficient=1e-2),
    strong("earth_rate", "gyro", x=1e-2, y=0.0, z=-1e-2),
    strong("gravity_error", "accel", value=0.1),
    strong("lever_arm", "accel", "gnss", x=0.5, y=-0.2, z=0.1),
    strong("time_delay", *TRIADS, delay=0.02),
    strong("time_delay", "gnss", delay=0.2),
    strong("clock_drift", "gnss", rate=0.01),
    strong("bandwidth", *TRIADS, corner=5.0),
    strong("hard_iron", "mag", x=5e-6, y=-3e-6, z=2e-6),
    strong("soft_iron", "mag", xx=0.05, xy=0.02),
    strong("declination", "mag", angle=0.1),
    strong("static_pressure_error", "baro", coefficient=0.05),
    strong("magnetic_disturbance", "mag", x=5e-6, y=-3e-6, z=2e-6, time=10.0, duration=20.0),
)
FAULTS = (
    strong("axis_swap", *BOTH),
    strong("sign_error", *BOTH),
    strong("clipping", *BOTH, limit=0.2),
    strong("coarse_quantisation", *BOTH, step=0.1),
    strong("dead_zone", *BOTH, width=0.1),
    strong("dropped_samples", *BOTH, share=0.1),
    strong("repeated_samples", *BOTH, share=0.2),
    strong("stuck", *BOTH, time=10.0, lasting=10.0),
    strong("stuck_bit", *BOTH, bit=3),
    strong("timestamp_jitter", *BOTH, sigma=1e-3),
    strong("too_early", *BOTH, shift=0.05),
    strong("unit_error", *BOTH, factor=57.3),
    strong("sample_rate_error", *BOTH, factor=1.05),
)
REFERENCE = (
    strong("held_reference", "gyro_x", period=0.2),
    strong("other_motion", "gyro_x", correlation=0.1),
    strong("reversed_attitude", "gyro_x"),
    strong("rounded_reference", "gyro_x", step=0.01),
    strong("scalar_last_attitude", "gyro_x"),
    strong("stuck_reference", "gyro_x", share=0.2),
)
PLANT_RATE_HZ = 20.0
PLANT_DURATION_S = 20.0
LARGEST_DRIVE_V = max(
    abs(sin(0.9 * t) + 0.6 * sin(2.7 * t + 1.0) * cos(0.13 * t) + 0.3)
    for t in (k / PLANT_RATE_HZ for k in range(int(PLANT_RATE_HZ * PLANT_DURATION_S) + 1))
)
"""Of the input of the law's plant: a gap takes it for the one at which a square law changes nothing."""
PLANT = (
    strong("backlash", "y", width=0.1),
    strong("sensor_lag", "y", tau=0.15),
    strong("constant_input", "v", value=0.2),
    strong("coulomb_friction", "v", level=0.2, v0=0.02),
    strong("cubic_spring", "v", coefficient=4.0),
    strong("input_dead_zone", "u", width=0.2),
    strong("input_delay", "u", delay=0.15),
    strong("input_lag", "u", tau=0.2),
    strong("input_nonlinearity", "u", k2=0.2, k3=0.1),
    strong("parameter_error", "stiffness", value=0.5),
    strong("process_noise", "v", N=0.1),
    strong("quadratic_drag", "v", coefficient=0.5),
    strong("saturation", "u", limit=0.5),
    strong("spring", "v", coefficient=1.0),
    strong("square_law", "u", share=0.5, full=LARGEST_DRIVE_V),
    strong("viscous_friction", "v", coefficient=0.3),
)
EVERY = (*REST, *SHARED, *INERTIAL, *FAULTS, *REFERENCE, *PLANT)
ABSTRACT = {"lagged", "noise_level", "coupling"}
"""Families in the catalogue whose members are tried instead."""

REST_RATE_HZ = 10.0
"""Samples per second of a log at rest."""
REST_DURATION_S = 300.0
"""Its length."""
SD = 0.1
"""Standard deviation of a sample of its white noise [rad/s]."""
MEAN_TEMPERATURE_K = 303.4
"""About the mean of the temperature of such a log: about it the square of the temperature is no line."""
AT_REST = (
    strong("white_noise", N=2.0 * SD / REST_RATE_HZ**0.5),
    strong("sample_noise", sd=2.0 * SD),
    strong("bias_instability", B=SD, shortest=10.0 / REST_RATE_HZ, longest=REST_DURATION_S),
    strong("power_law_noise", B=SD, slope=1.5, shortest=1.0 / REST_RATE_HZ, longest=REST_DURATION_S),
    strong("rate_random_walk", K=SD / 3.0),
    strong("gauss_markov", sigma=2.0 * SD, tau=2.0),
    strong("quantisation", Q=SD / REST_RATE_HZ),
    strong("rate_ramp", R=3.0 * SD / REST_DURATION_S),
    strong("warm_up", size=5.0 * SD, tau=40.0),
    strong("sinusoid", amplitude=SD, frequency=1.7, phase=0.3),
    strong("periodic_wave", size=SD, period=9.3, duty=0.35, flank=0.0, start=2.0),
    strong("resonance", frequency=2.3, damping=0.02, rms=SD),
    strong("low_pass", corner=2.0),
    strong("random_telegraph", size=2.0 * SD, dwell=20.0),
    strong("bias_step", size=2.0 * SD, time=100.0),
    strong("noise_change", ratio=3.0, time=100.0),
    strong("outliers", share=0.02, sigma=10.0 * SD),
    strong("intermittent_noise", ratio=4.0, share=0.3, lasting=5.0),
    strong("temperature", coefficient=0.5 * SD),
    strong("temperature_squared", coefficient=0.1 * SD, reference=MEAN_TEMPERATURE_K),
    strong("temperature_rate", coefficient=50.0 * SD),
    strong("thermal_lag", lag=20.0, coefficient=SD),
    strong("thermal_hysteresis", width=3.0, coefficient=SD),
    strong("noise_temperature", slope=0.1),
    strong("air_pressure", coefficient=0.01 * SD),
    strong("humidity", coefficient=20.0 * SD),
    strong("supply_voltage", coefficient=10.0 * SD),
    strong("supply_current", coefficient=10.0 * SD),
    strong("clipping", limit=2.0 * SD),
    strong("coarse_quantisation", step=2.0 * SD),
    strong("dead_zone", width=0.5 * SD),
    strong("dropped_samples", share=0.05),
    strong("repeated_samples", share=0.2),
    strong("sample_rate_error", factor=1.05),
    strong("stuck", time=100.0, lasting=30.0),
    strong("stuck_bit", bit=2),
    strong("timestamp_jitter", sigma=0.1 / REST_RATE_HZ),
    strong("unit_error", factor=57.3),
)
"""Strengths against white noise of `SD` in a record at rest."""
