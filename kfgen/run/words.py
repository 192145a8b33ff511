"""What a filter over a log is said to have shown, in words."""

from __future__ import annotations

import numpy as np

STRAIGHT_LINE_REMOVED = (
    "the channel is not stationary (its power has a trend or comes and goes): a straight line is removed before the "
    "ARMA process is estimated; give a log at rest with --at-rest if it moves"
)
NOT_CORRELATED = "its samples are not correlated: an ARMA process has nothing to predict in white noise"


def consistency(sensor: str, mean_nis: float, updates: int, expected95: tuple[float, float]) -> str:
    """Whether the innovations of a sensor are as large as the filter expects.

    Parameters
    ----------
    sensor : str
    mean_nis : float
        Mean of its normalised innovations squared.
    updates : int
        Over how many.
    expected95 : (float, float)
        Between which ends that mean is in 95 of 100 runs of a consistent filter.
    """
    lo, hi = expected95
    said = f"{sensor}: mean NIS {mean_nis:.3g} over {updates} updates"
    ends = f"{lo:.3g} to {hi:.3g}, 95 %"
    if mean_nis > hi:
        return f"{said}, above that of a consistent filter ({ends}): it assumes too little noise, or an effect is missing"
    if mean_nis < lo:
        return f"{said}, below that of a consistent filter ({ends}): it assumes more noise than there is"
    return f"{said}, as of a consistent filter ({ends})"


def beyond_gate(count: int, updates: int, gate: float) -> str:
    """How many samples the emitted filter would reject.

    Parameters
    ----------
    count : int
        Samples beyond the gate.
    updates : int
        All of them.
    gate : float
        Standard deviations.
    """
    return (
        f"{count} of {updates} samples {'is' if count == 1 else 'are'} beyond the gate of {gate:g} standard deviations: "
        "the emitted filter would reject what this run fuses"
    )


def assumes_exact_field(components: str, tilt_rad: float, error: str) -> str:
    """Of a magnetic field that the filter takes as exact although the log's first second says it, where a NIS is too large.

    Parameters
    ----------
    components : str
        Their names and values.
    tilt_rad : float
        Standard deviation of the tilt then.
    error : str
        What it makes of them.
    """
    return (
        f"The filter takes the magnetic field ({components}) as exact, but it is that of the log's first second, with "
        f"the tilt that the accelerometer's bias leaves then (1 sd: {np.degrees(tilt_rad):.2g} deg, {error} of the "
        "field): an error of it turns the filter away from what positions and velocities say. Let the field be states "
        "(--set field=state)."
    )


def suppresses_motion(gain: float, as_noise: bool) -> str:
    """Of a filter that takes a true rate away.

    Parameters
    ----------
    gain : float
        For a constant rate.
    as_noise : bool
        Whether slow noise is suppressed by the same.
    """
    same = ", and slow noise by no more" if as_noise else ""
    return f"it suppresses motion with the noise (gain {gain:.3g} for a constant rate{same}): do not use it as a denoiser"


def scales_small_rates(gain: float) -> str:
    """Of a filter that keeps only rates that stand out of the noise, and scales others."""
    return f"it keeps a rate that stands out of the noise and scales one that does not by {gain:.3g}"


def only_low_passes(late_s: float) -> str:
    """Of a filter that leaves slow noise, with the delay of a step [s]."""
    return f"it only low-passes: slow noise stays as it is, a step comes {late_s:.3g} s late"


def lowers_slow_noise(attenuation: float) -> str:
    """Of a filter that keeps rates and lowers slow noise to a share."""
    return f"it keeps a constant rate and lowers slow noise to {attenuation:.3g}"
