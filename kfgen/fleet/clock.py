"""Sensors whose clock is not that of their rate: one factor of time in their lines, their low-pass and their noise.

A log whose rate is stated too low by a factor k has every frequency too low by k, and its white noise N too high by the
root of k, for the same samples are taken to stand for a longer time. Each of these may differ for a reason of its own;
that all of them differ by the same factor is a clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.fleet.answer import LogAnswer

Array = NDArray[np.float64]

MIN_SENSORS = 4
"""Sensors of which one can be unlike the others."""
MAX_LOG_FACTOR = 0.35
"""Logarithm of a factor that is looked for."""
MIN_LOG_FACTOR = 0.03
MIN_LINE_SHARE = 0.5
"""Share of the others that have a line, for it to be the fleet's."""
LINE_SD, CORNER_SD, NOISE_SD = 0.01, 0.06, 0.06
"""Standard deviations of the logarithm of frequencies, of corners, and of N between sensors of one kind, at least."""
AGREEING_DEVIATIONS = 2.5
"""Standard deviations within which two factors are one."""
MIN_AGREEING_SHARE = 0.75
"""Of corners and N of all channels, that one factor must explain where no line says it."""
GAIN_BESIDE_A_LINE, GAIN_WITHOUT_A_LINE = 6.0, 36.0
"""Twice the log-likelihood that corners and N gain by the factor of a line; by their own, for they differ by themselves."""
KINDS = ("lines", "low-pass", "N")
OWN_LINE = "a line in its place"
"""A sign against any factor."""


@dataclass(frozen=True)
class ClockFactor:
    """A sensor that is sampled faster, or slower, than its log says.

    Parameters
    ----------
    log : str
    factor : float
        True rate over the stated one.
    ci95 : (float, float)
    by : tuple of str
        What says so: ``lines``, ``low-pass``, ``N``.
    """

    log: str
    factor: float
    ci95: tuple[float, float]
    by: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """In words, without the name of the log."""
        per_cent = 100.0 * abs(self.factor - 1.0)
        lo, hi = self.ci95
        return (
            f"{' and '.join(self.by)} differ from those of the others by one factor of time, {self.factor:.3g} "
            f"({lo:.3g} to {hi:.3g}): it is sampled {per_cent:.2g} % {'faster' if self.factor > 1 else 'slower'} than its "
            "log says. Give its own rate with --rate"
        )


@dataclass(frozen=True)
class _Shift:
    """One sign of a factor: its logarithm, the standard deviation of that, and what shows it."""

    log_factor: float
    sd: float
    kind: str


def clock_factors(answers: Mapping[str, LogAnswer]) -> tuple[ClockFactor, ...]:
    """The sensors whose lines, low-pass and noise differ from the others' by one factor of time.

    Parameters
    ----------
    answers : mapping of str to LogAnswer
        By log.
    """
    if len(answers) < MIN_SENSORS:
        return ()
    found = [_factor(log, answers[log], [a for n, a in answers.items() if n != log]) for log in answers]
    return tuple(f for f in found if f is not None)


def _factor(log: str, own: LogAnswer, others: Sequence[LogAnswer]) -> ClockFactor | None:
    """The factor of one sensor against the others; None where at least two kinds do not agree on one."""
    shifts = [s for channel in own.frequencies for s in _shifts(channel, own, others)]
    # A line says the factor at once; without one it is what corners and noise say together.
    groups = [[s] for s in shifts if s.kind == "lines"] or [[s for s in shifts if s.kind == "low-pass"]]
    tried = [_tried(group, [s for s in shifts if s.kind != "lines"]) for group in groups if group]
    best = max((t for t in tried if t), key=lambda t: t[0], default=None)
    if best is None:
        return None
    _, agreeing = best
    mean, sd = _mean(agreeing)
    if abs(mean) < max(MIN_LOG_FACTOR, AGREEING_DEVIATIONS * sd):
        return None
    ends = np.exp(mean + 1.96 * sd * np.array([-1.0, 1.0])).tolist()
    kinds = tuple(k for k in KINDS if any(s.kind == k for s in agreeing))
    return ClockFactor(log, float(np.exp(mean)), (ends[0], ends[1]), kinds)


def _tried(group: list[_Shift], rest: list[_Shift]) -> tuple[float, list[_Shift]] | None:
    """What the other signs gain by the factor of a group, and all that agree; None where they do not bear it out."""
    lines = any(s.kind == "lines" for s in group)
    signs = [s for s in rest if s.kind != OWN_LINE]
    mean, _ = _mean(group if lines else signs)
    agreeing = sum(abs(s.log_factor - mean) < AGREEING_DEVIATIONS * s.sd for s in signs)
    if not lines and agreeing < MIN_AGREEING_SHARE * len(signs):
        return None
    gains = {k: sum(_gain(s, mean) for s in rest if s.kind == k) for k in (*KINDS, OWN_LINE)}
    kinds = [k for k in KINDS if gains[k] > 0.0]
    total = sum(gains.values())
    if len(kinds) + lines < 2 or total < (GAIN_BESIDE_A_LINE if lines else GAIN_WITHOUT_A_LINE):
        return None
    return total, [*(group if lines else ()), *(s for s in rest if s.kind in kinds)]


def _mean(shifts: Sequence[_Shift]) -> tuple[float, float]:
    """The weighted mean of the logarithms, and its standard deviation."""
    weight = np.array([s.sd**-2 for s in shifts])
    mean = float(weight @ np.array([s.log_factor for s in shifts]) / weight.sum())
    return mean, max(float(weight.sum()) ** -0.5, LINE_SD / 2.0)


def _gain(shift: _Shift, mean: float) -> float:
    """Twice the log-likelihood of a sign at a factor over that at none."""
    return float((shift.log_factor**2 - (shift.log_factor - mean) ** 2) / shift.sd**2)


def _shifts(channel: str, own: LogAnswer, others: Sequence[LogAnswer]) -> list[_Shift]:
    """What the lines, the low-pass and the noise of a channel say of a factor."""
    found = []
    there = [a.frequencies[channel] for a in others if channel in a.frequencies]
    mine = own.frequencies[channel]
    for line in _common([f.lines for f in there]):
        near = [float(np.log(line / f)) for f in mine.lines]
        if any(abs(r) < AGREEING_DEVIATIONS * LINE_SD for r in near):
            found.append(_Shift(0.0, LINE_SD, OWN_LINE))
        else:
            found += [_Shift(r, LINE_SD, "lines") for r in near if abs(r) < MAX_LOG_FACTOR]
    corners = [f.corner for f in there if f.corner > 0.0]
    if mine.corner > 0.0 and len(corners) > MIN_LINE_SHARE * len(there):
        spread = max(float(np.std(np.log(corners))), CORNER_SD)
        found.append(_Shift(float(np.log(np.median(corners) / mine.corner)), spread, "low-pass"))
    N, rest = _noise(own, channel), [v for a in others if (v := _noise(a, channel)) > 0.0]
    if N > 0.0 and len(rest) >= MIN_SENSORS - 1:
        log_rest = np.log(rest)
        spread = 1.4826 * float(np.median(np.abs(log_rest - np.median(log_rest))))
        found.append(_Shift(2.0 * float(np.log(N) - np.median(log_rest)), 2.0 * max(spread, NOISE_SD), "N"))
    return found


def _common(lines: Sequence[tuple[float, ...]]) -> list[float]:
    """The frequencies [Hz] that more than half of the sensors have."""
    every = sorted(f for own in lines for f in own)
    found: list[float] = []
    for f in every:
        near = [g for own in lines for g in own if abs(np.log(g / f)) < 2.0 * LINE_SD]
        sensors = sum(any(abs(np.log(g / f)) < 2.0 * LINE_SD for g in own) for own in lines)
        middle = float(np.median(near))
        if sensors > MIN_LINE_SHARE * len(lines) and all(
            abs(np.log(middle / g)) > 2.0 * LINE_SD for g in found
        ):
            found.append(middle)
    return found


def _noise(answer: LogAnswer, channel: str) -> float:
    """N of a channel; zero without one."""
    found = [e for e in answer.effects if (e.channel, e.effect) == (channel, "white_noise")]
    return found[0].parameters["N"].value if found else 0.0
