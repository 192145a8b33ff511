"""Single beside double precision over a log: what the rounding of the emitted filter does to its estimate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.numbers import finite
from kfgen.emit.routines import Program
from kfgen.log.log import Log
from kfgen.run.filter_calls import FilterCalls
from kfgen.run.run import FilterRun, run
from kfgen.verify.replay import Replay, replay

Array = NDArray[np.float64]

RATE_TOLERANCE_FRACTION = 0.01
"""Share by which a log's rate may differ from the one that a filter was emitted for."""
MAX_COMPARED_SAMPLES = 500
"""Samples, evenly over the log, at which the covariance is compared."""


@dataclass(frozen=True)
class Rounding:
    """The largest differences over a log between a filter in its own precision and filterpy's in double.

    Parameters
    ----------
    state, share, t : str, float, float
        The stored state that is off by most standard deviations, by how many, and when [s].
    attitude : float or None
        Largest angle between the two attitudes [rad]; None for a model without one.
    spread : float
        Largest relative difference of a standard deviation.
    """

    state: str
    share: float
    t: float
    attitude: float | None
    spread: float


@dataclass(frozen=True)
class OnLog:
    """What a log adds to a proof.

    Parameters
    ----------
    source, sha256 : str
        Of the log.
    seconds : float
        Its length [s].
    calls, refused : mapping of str to int
        Calls of each routine; answers of each status but OK.
    rounding : Rounding
    warnings : tuple of str
    """

    source: str
    sha256: str
    seconds: float
    calls: Mapping[str, int]
    refused: Mapping[str, int]
    rounding: Rounding
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The log, the calls, and the largest differences from double precision."""
        r = self.rounding
        return {
            "source": self.source,
            "sha256": self.sha256,
            "duration_s": self.seconds,
            "calls": dict(self.calls),
            "refused": dict(self.refused),
            "beside_double": {
                "attitude_rad": r.attitude,
                "state": r.state,
                "deviations": finite(r.share),
                "t_s": r.t,
                "relative_of_deviation": finite(r.spread),
            },
        }


def over_log(program: Program, log: Log, start: Mapping[str, float] | None = None) -> tuple[Replay, OnLog]:
    """The calls of a log, and what the rounding of the program does to its estimate.

    Parameters
    ----------
    program : Program
    start : mapping of str to float, optional
        Stored states that are known better than by alignment [SI].

    Raises
    ------
    InputError
        The log lacks an input of the model, or has none of its sensors.
    """
    played = replay(FilterCalls(program, log, start or {}))
    beside = rounding(program, played, run(Program(program.discrete), log, start=start))
    rate = program.discrete.rate
    warnings: tuple[str, ...] = ()
    if abs(log.dt * rate - 1.0) > RATE_TOLERANCE_FRACTION:
        warnings = (
            f"the filter was emitted for {rate:g} Hz and the log has {1.0 / log.dt:.6g} Hz: "
            f"noise of samples is assumed for the former (emit --rate {1.0 / log.dt:.6g})",
        )
    calls = Counter(c.routine for c in played.calls)
    found = OnLog(log.source, log.sha256, log.duration, calls, played.refused, beside, warnings)
    return played, found


def rounding(program: Program, played: Replay, double: FilterRun) -> Rounding:
    """Compare the reference's state and covariance after each sample of a log with a run in double precision over the same log.

    Parameters
    ----------
    program : Program
    played : Replay
        A log through the reference.
    double : FilterRun
        The run in double precision over the same log.
    """
    nx = len(double.names)
    start = np.array(played.start["x"], float)
    x = np.array([played.calls[e - 1].words[:nx] if e else start for e in played.ends], float)
    errors = [s.name for s in program.discrete.model.states]
    kept = [i for i, n in enumerate(double.names) if n in errors]
    sd = double.deviation[:, [errors.index(double.names[i]) for i in kept]]
    share = np.abs(x - double.estimate)[:, kept] / sd
    angle = None
    names = [double.names[i] for i in kept]
    attitude = program.discrete.model.attitude
    if attitude is not None:
        angle = _angle(x, double)
        least = double.deviation[:, [errors.index(n) for n in attitude.error_names]].min(axis=1)
        share, names = np.column_stack([share, angle / least]), [*names, "attitude"]
    k, i = np.unravel_index(int(np.argmax(np.nan_to_num(share, nan=np.inf))), share.shape)
    return Rounding(
        names[i],
        float(share[k, i]),
        float(double.t[k]),
        None if angle is None else float(angle.max()),
        _spread(program, played, double),
    )


def _angle(x: Array, double: FilterRun) -> Array:
    """Between the two attitudes at each sample [rad], by the sine: the cosine of so small an angle is one."""
    q = [double.names.index(f"q_{a}") for a in "wxyz"]
    (w, a), (W, A) = ((e[:, q[0]], e[:, q[1:]]) for e in (x, double.estimate))
    between = w[:, None] * A - W[:, None] * a - np.cross(a, A)
    return np.asarray(2.0 * np.arcsin(np.minimum(np.linalg.norm(between, axis=1), 1.0)))


def _spread(program: Program, played: Replay, double: FilterRun) -> float:
    nx, form = len(double.names), program.covariance
    worst = 0.0
    for k in range(0, len(played.ends), max(1, len(played.ends) // MAX_COMPARED_SAMPLES)):
        if played.ends[k]:
            P = np.array(form.matrix(played.calls[played.ends[k] - 1].words[nx:].tolist()))
            sd = np.sqrt(np.maximum(np.diag(P), 0.0))
            worst = max(worst, float(np.abs(sd / double.deviation[k] - 1.0).max()))
    return worst
