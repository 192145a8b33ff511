"""What a record at rest is said to have where it is compared, in words: samples left out or drawn, idle drivers."""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.core.numbers import moment


def no_measurements(count: int, channel: str, ends_s: tuple[float, float], kinds: Sequence[str]) -> str:
    """Of samples that are no measurements.

    Parameters
    ----------
    count : int
        How many.
    channel : str
    ends_s : (float, float)
        Times of the first and of the last [s].
    kinds : sequence of str
        Titles of the faults.
    """
    first, last = ends_s
    when = f"at {moment(first)} s" if first == last else f"between {moment(first)} and {moment(last)} s"
    return (
        f"{count} samples of {channel} {when} are no measurements ({' and '.join(kinds)}); they are left out"
    )


def drawn(count: int, channel: str) -> str:
    """Of missing samples over which assumed noise is drawn."""
    return f"{count} samples of {channel} are missing; assumed noise of the size beside is drawn over them"


def louder_by_a_clock(period_s: float) -> str:
    """Of noise that is louder and less loud with a period [s]."""
    return (
        f"the noise is louder every {period_s:.4g} s, by a clock, as a load that is switched makes it, or a log whose "
        "samples were interpolated: log them as the sensor gives them"
    )


def loses_unseen(loss_nats: float) -> str:
    """Of an addition that makes data worse which its fit did not see, by so many nats."""
    return f"it loses {loss_nats:.3g} nats on data that its fit did not see"


def interpolated_samples(count: int, channel: str) -> str:
    """Of outliers and samples that are no numbers in the means of a long log."""
    return f"{count} samples of {channel} are outliers or no numbers; the means have interpolated ones"


def compared_in_parts(first_s: float, whole_s: float, block_s: float, rate_hz: float) -> str:
    """Of a log that is too long to be searched at its full rate.

    Parameters
    ----------
    first_s, whole_s : float
        Length of the beginning and of all of it [s].
    block_s : float
        Of which means are taken [s].
    rate_hz : float
        Full rate.
    """
    return (
        f"the first {first_s:.4g} s are compared at {rate_hz:.6g} Hz, all {whole_s:.6g} s in means of {block_s:.3g} s: "
        "what is faster is not looked for after the first"
    )
