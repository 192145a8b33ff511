"""What a filter over a log is said to have shown, in words."""

from __future__ import annotations


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
