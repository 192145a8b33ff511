"""What was found in a flight, in words: what a noise is made of, outages of the receiver, what the motion does not excite."""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.gap.core.result import DetectionLimit, NoiseSplit, OutageDrift
from kfgen.manoeuvre.library import LIBRARY

MIN_SAID_FACTOR_LEFT = 1.5
"""Size of a noise over the assumed one above which it is said to be unexplained."""
MAX_NOT_EXCITED_SAID = 4
"""Effects that one manoeuvre would excite, of which the names are said in a sentence."""
MIN_RATIO_OF_WORSE_DRIFT = 1.5
"""Of the drift in outages with what was found over that as assumed, from which on it is advised against."""

PARKED = (
    "the vehicle is parked: it never moves in this log, so that no effect that comes with motion can show; "
    "give a log in which it moves"
)


def noise_factor_sentence(f: NoiseSplit) -> str:
    """Why a noise looks larger, in words."""
    lo, hi = f.ci95
    shares = [f"{p.factor:.3g} {p.cause} of {p.where}" for p in f.parts]
    left = [f"{f.left:.3g} unexplained"] if f.left >= MIN_SAID_FACTOR_LEFT or not shares else []
    return (
        f"With nothing named the noise of {f.channel} would seem {f.times:.3g} times as large as assumed "
        f"(95 %: {lo:.3g} to {hi:.3g}): {' x '.join([*shares, *left])}"
    )


def outage_sentence(before: OutageDrift, after: OutageDrift) -> str:
    """What outages cost before and after."""
    n = f"{before.count} outages" if before.count > 1 else "one outage"
    worse = after.metres > MIN_RATIO_OF_WORSE_DRIFT * before.metres
    return (
        f"Without GNSS for {before.seconds:g} s the filter drifts {before.metres:.3g} m as assumed and {after.metres:.3g} m "
        f"updated ({n} in the last part of the log)"
        + (
            "; for outages keep what was assumed, until a log with more of them says otherwise"
            if worse
            else ""
        )
    )


def not_excited_sentence(limits: Sequence[DetectionLimit]) -> str:
    """What the motion does not excite, and which manoeuvres would, the one that shows most first.

    Parameters
    ----------
    limits : sequence of DetectionLimit
        Those of effects that are not excited.
    """
    by_manoeuvre: dict[str, list[str]] = {}
    for m in limits:
        by_manoeuvre.setdefault(m.manoeuvre, []).append(f"{m.effect.name} of {m.where}")
    best = sorted((n for n in by_manoeuvre if n), key=lambda n: -len(by_manoeuvre[n]))
    said = [_shown_by(n, list(dict.fromkeys(by_manoeuvre[n]))) for n in best]
    if "" in by_manoeuvre:
        said.append(f"no manoeuvre is known for {_some(list(dict.fromkeys(by_manoeuvre[''])))}")
    number = "one effect" if len(limits) == 1 else f"{len(limits)} numbers of effects"
    return f"The motion of this log does not excite {number}, which it cannot show: {'; '.join(said)}"


def _shown_by(manoeuvre: str, effects: Sequence[str]) -> str:
    return f"{manoeuvre} ({LIBRARY[manoeuvre].title}, {LIBRARY[manoeuvre].length:g} s) would excite {_some(effects)}"


def _some(names: Sequence[str]) -> str:
    more = len(names) - MAX_NOT_EXCITED_SAID
    return ", ".join(names[:MAX_NOT_EXCITED_SAID]) + (f" and {more} more" if more > 0 else "")
