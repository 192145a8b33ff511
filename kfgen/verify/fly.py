"""Flights of an emitted filter through every fault: reported after, right after, how wrong, and whether the floors hold."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.core.elapsed import counted
from kfgen.core.errors import InputError
from kfgen.core.result import Result, ShortTable
from kfgen.emit.folder import EmittedFilter
from kfgen.emit.routines import Program
from kfgen.emit.targets import c
from kfgen.emit.watch.rest import ROUTINE as DETECT_REST
from kfgen.model.parts.motion import NED
from kfgen.verify.core import Core
from kfgen.verify.faults import FAULTS, RIGHT_WITHIN_S, WRONG_WITHIN_S, FlightFault, spoiled
from kfgen.verify.flight import AFTER_S, START_S, TrialFlight, flight

Array = NDArray[np.float64]
SETTLED_S = 20.0
"""From which on a position may be judged."""
SIGMAS = 3.0
"""A position that is farther off, all axes together, is wrong."""
STORED_BEFORE_S = 2.0
HALF_TURN = np.array([0.5, 0.0, 0.0, 3.0**0.5 / 2.0])
"""A quaternion of 120 deg about down."""
ROUTINES = {"gnss_position": "position", "gnss_velocity": "velocity", "mag": "field"}
"""Sensors that a flight has samples of, by the array that has them."""


@dataclass(frozen=True)
class FaultVerdict:
    """How a filter came through a fault.

    Parameters
    ----------
    fault : FlightFault
    core : str
    reported : float
        Until a status said it [s]; infinite: never.
    right : float
        From the fault's end until the position was right for good [s].
    wrong : float
        Longest time that it was wrong while every status said OK [s].
    worst : float
        Largest error of position [m].
    finite : bool
        Whether every number stayed one.
    """

    fault: FlightFault
    core: str
    reported: float
    right: float
    wrong: float
    worst: float
    finite: bool

    @property
    def missed(self) -> tuple[str, ...]:
        """The floors that were missed, in words."""
        found = []
        if self.reported > self.fault.reported_within:
            found.append(f"reported after {self.reported:.3g} s")
        if self.right > RIGHT_WITHIN_S:
            found.append(f"right after {self.right:.3g} s")
        if self.wrong > WRONG_WITHIN_S:
            found.append(f"wrong for {self.wrong:.3g} s while it says OK")
        return (*found, *(() if self.finite else ("a number is none",)))

    @property
    def row(self) -> list[str]:
        """For a table."""
        reported = "not" if np.isinf(self.reported) else f"{self.reported:.1f} s"
        floors = "; ".join(self.missed) or "held"
        return [self.fault.title, self.core, reported, f"{self.right:.1f} s", f"{self.worst:.3g} m", floors]


HEAD = ("fault", "core", "reported after", "right after", "worst error", "floors")


@dataclass(frozen=True, repr=False)
class FaultFlights(Result):
    """A filter through every fault.

    Parameters
    ----------
    model_hash : str
        SHA-256 of the filter's equations and numbers.
    verdicts : tuple of FaultVerdict
    """

    model_hash: str
    verdicts: tuple[FaultVerdict, ...]

    def __iter__(self) -> Iterator[FaultVerdict]:
        return iter(self.verdicts)

    @property
    def ok(self) -> bool:
        """Whether every floor holds."""
        return not any(v.missed for v in self.verdicts)

    def summary(self) -> list[str]:
        """Which floors were missed."""
        wrong = [v for v in self.verdicts if v.missed]
        if wrong:
            return [f"{v.fault.title} on {v.core}: {'; '.join(v.missed)}" for v in wrong]
        return [
            f"All {len(self.verdicts)} flights hold the floors: what shows at once is reported within 1 s, the position is within "
            f"{SIGMAS:g} standard deviations {RIGHT_WITHIN_S:g} s after its end, and never beyond them for "
            f"{WRONG_WITHIN_S:g} s while the filter says OK"
        ]

    def short_table(self) -> ShortTable:
        """A row for each flight."""
        return HEAD, [v.row for v in self.verdicts]

    def to_dict(self) -> dict[str, Any]:
        """The numbers of each flight."""
        return {
            "format": "kfgen-faults-1",
            "kfgen": kfgen.__version__,
            "model_hash": self.model_hash,
            "ok": self.ok,
            "flights": [
                {
                    "fault": v.fault.title,
                    "core": v.core,
                    "reported_after_s": None if np.isinf(v.reported) else v.reported,
                    "right_after_s": v.right,
                    "wrong_while_ok_s": v.wrong,
                    "worst_error_m": v.worst,
                    "finite": v.finite,
                    "missed": list(v.missed),
                }
                for v in self.verdicts
            ],
        }


def fly_faults(
    emitted: EmittedFilter,
    cores: Sequence[str] = ("host",),
    faults: Sequence[FlightFault] = FAULTS,
    seed: int = 1,
) -> FaultFlights:
    """Fly a filter in C through faults, on each core.

    Parameters
    ----------
    emitted : EmittedFilter
        In C, with accelerometers, gyros, and position and velocity of GNSS in north, east, down.
    cores : sequence of str
        Names of cores, see `kfgen.list_all`.
    faults : sequence of FlightFault
        All of them where left out; those that need a part that the filter has not are not flown.
    seed : int
        Of biases and noise.

    Returns
    -------
    FaultFlights

    Raises
    ------
    InputError
        A filter in another language or without these inputs and sensors, or an unknown core.
    CheckFailed
        The header does not compile.
    MissingExtra
        The emulator is not installed.
    """
    from kfgen.verify.compare import maker_of

    program = emitted.program
    _check(emitted)
    known = {r.name for r in program.entries}
    faults = [f for f in faults if f.needs in known or not f.needs]
    field = np.array([_constant(program, "mag_N", 20e-6), 0.0, _constant(program, "mag_D", 44e-6)])
    verdicts = []
    for name in cores:
        make = maker_of(name, contract=False)
        with tempfile.TemporaryDirectory(prefix="kfgen-faults-") as scratch:
            core = make(program, emitted.folder, Path(scratch))
            for fault in counted(faults, f"flights on {name}"):
                rng = np.random.default_rng(seed)
                seconds = START_S + fault.seconds + AFTER_S
                calm = flight(program.discrete.rate, seconds, field, rng, fault.motion)
                flown = _Pilot(program, core, spoiled(calm, fault), fault).fly()
                verdicts.append(flown.verdict(name))
    return FaultFlights(emitted.model_hash, tuple(verdicts))


def _constant(program: Program, name: str, default: float) -> float:
    model = program.discrete.model
    start = dict(zip(program.discrete.nominal_names, program.discrete.start))
    return {**{k.name: k.value for k in model.constants}, **start}.get(name, default)


def _check(emitted: EmittedFilter) -> None:
    model = emitted.program.discrete.model
    if emitted.target != c.TARGET:
        raise InputError(
            f"a filter in {emitted.target} is not flown through faults",
            where="--faults",
            remedy="Emit it with --target c",
        )
    inputs = {i.name for i in model.motion.inputs} | {s.name for s in model.sensors}
    lacking = sorted({"accel", "gyro", "gnss_position", "gnss_velocity"} - inputs)
    if lacking or model.motion.axes != NED or model.drivers:
        why = (
            f"it lacks {', '.join(lacking)}"
            if lacking
            else "its axes are not north, east, down, or it has drivers"
        )
        raise InputError(
            f"{model.name} is not flown through faults: {why}",
            where="--faults",
            remedy="Take a filter with accel, gyro, gnss_position and gnss_velocity, such as ins15",
        )


@dataclass(frozen=True)
class _Record:
    """What a flight left: at each fix its time [s], error [m], trace of the position's covariance [m^2], status, finite."""

    fault: FlightFault
    t: Array
    error: Array
    trace: Array
    status: NDArray[np.int64]
    reported: float
    finite: bool

    def verdict(self, core: str) -> FaultVerdict:
        """Against the truth of the flight, on that core."""
        end = START_S + self.fault.seconds
        judged = self.t > SETTLED_S
        wrong = judged & ~(self.error**2 <= SIGMAS**2 * self.trace)
        last = float(self.t[wrong].max(initial=0.0))
        run = longest = 0.0
        step = float(self.t[1] - self.t[0])
        for bad in wrong & (self.status == 0):
            run = run + step if bad else 0.0
            longest = max(longest, run)
        worst = float(np.max(self.error[judged], initial=0.0))
        return FaultVerdict(
            self.fault, core, self.reported, max(last - end, 0.0), longest, worst, self.finite
        )


class _Pilot:
    """A filter on a core, and the flight that it is given.

    Parameters
    ----------
    program : Program
    core : Core
    flight : TrialFlight
        With the fault in it.
    fault : FlightFault
    """

    def __init__(self, program: Program, core: Core, flight: TrialFlight, fault: FlightFault) -> None:
        self.program, self.core, self.flight, self.fault = program, core, flight, fault
        self.names = program.discrete.nominal_names
        self.nx = len(self.names)
        sensors = {s.name for s in program.discrete.model.sensors}
        self.given = {f"update_{n}": getattr(flight, a) for n, a in ROUTINES.items() if n in sensors}
        self.rests = program.resting is not None
        self.reported = np.inf
        self.worst = 0

    def _call(self, routine: str, inputs: Sequence[float], t: float) -> None:
        self.core.call(routine, inputs)
        status = self.core.status()
        if status:
            self.worst = max(self.worst, status)
            if t >= START_S - 1e-9:
                self.reported = min(self.reported, max(t - START_S, 0.0))

    def _place(self, values: dict[str, float]) -> None:
        """Numbers of the state, by name."""
        x = self._words()[: self.nx].tolist()
        for name, value in values.items():
            x[self.names.index(name)] = value
        self.core.put("x", x)

    def _words(self) -> NDArray[np.floating[Any]]:
        return self.core.words().view(self.program.type)

    def _turned(self) -> None:
        q = [f"q_{a}" for a in "wxyz"]
        own = self._words()[[self.names.index(n) for n in q]].astype(float)
        w, x, y, z = own
        tw, _, _, tz = HALF_TURN
        turned = (tw * w - tz * z, tw * x - tz * y, tw * y + tz * x, tw * z + tz * w)
        self._place(dict(zip(q, turned)))

    def fly(self) -> _Record:
        """Step by step, fix by fix."""
        f = self.flight
        stored: NDArray[Any] = np.zeros(0)
        self.core.call("init", ())
        start = dict(zip((f"q_{a}" for a in "wxyz"), f.attitude.tolist()))
        self._place(start | dict(zip(("v_N", "v_E", "v_D"), f.start.tolist())))
        inputs = np.column_stack([f.accel, f.gyro, f.dt]).tolist()
        begin = 0
        rows, statuses = [], []
        for m, last in enumerate(f.fixes.tolist()):
            t = float(f.t[last])
            self.worst = 0
            if t >= START_S - STORED_BEFORE_S and not stored.size:
                stored = self._words()
            if t >= START_S - 1e-9 and begin <= round(START_S * self.program.discrete.rate):
                self._happens(stored)
            for k in range(begin, last + 1):
                if f.called[k]:
                    self._call("predict", inputs[k], float(f.t[k]))
                    if self.rests:
                        self._call(DETECT_REST, inputs[k], float(f.t[k]))
            begin = last + 1
            if not f.absent[m]:
                for routine, samples in self.given.items():
                    self._call(routine, samples[m].tolist(), t)
            self._call("supervise", (), t)
            rows.append(self._words())
            statuses.append(self.worst)
        return self._record(np.array(rows, dtype=np.float64), np.array(statuses))

    def _happens(self, stored: NDArray[Any]) -> None:
        """What happens to the filter itself as the fault begins."""
        if self.fault.event == "turned":
            self._turned()
        elif self.fault.event == "restored":
            self.core.call("init", ())
            at = self.nx + self.program.covariance.size
            self.core.put("x", stored[: self.nx].tolist())
            self.core.put(self.program.covariance.ARRAY, stored[self.nx : at].tolist())

    def _record(self, words: Array, status: NDArray[np.int64]) -> _Record:
        f, places = self.flight, [self.names.index(n) for n in ("p_N", "p_E", "p_D")]
        error = np.linalg.norm(words[:, places] - f.truth, axis=1)
        form = self.program.covariance
        stored = words[:, self.nx : self.nx + form.size]
        variances = form.variances(stored)
        states = [s.name for s in self.program.discrete.model.states]
        trace = variances[:, [states.index(n) for n in ("p_N", "p_E", "p_D")]].sum(axis=1)
        estimate = words[:, : self.nx + form.size]
        finite = bool(np.isfinite(estimate).all())
        return _Record(self.fault, f.t[f.fixes], error, trace, status, self.reported, finite)
