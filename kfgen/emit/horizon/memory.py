"""What the delayed horizon keeps: a ring of inputs and outputs, a queue of measurements, and the present state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING

from kfgen.core.errors import InputError
from kfgen.emit.ir.ir import Argument, Cell, For, Ref, Scratch, Stmt, Store, Whole, mul, sub
from kfgen.model.known_delays import known_delays
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.sensors import Sensor

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

RING, QUEUE, HORIZON, PRESENT = "ring", "queue", "horizon", "present"
FAR = 1e30
"""Time of an empty place of the queue, and before the first call."""
MARGIN = 1.2
"""Of the horizon over the longest delay that the filter's file knows."""
RATE_MARGIN = 2.0
"""Of the queue over a sensor's usual rate; no sensor is faster than the inputs."""
MAX_STEPS = 1000
"""That a ring may hold."""
PLACES = {
    "AT": "row of the ring that is taken next",
    "STARTED": "1 once the present state has begun",
    "CLOCK": "time of the filter, begins again every second [s]",
    "NEXT": "time of the first measurement that waits, on that clock [s]",
}
SETTINGS = (
    Constant("TAU_PRESENT", "s", 0.25, "time in which the present state follows the filter"),
    Constant("STAMP_TOLERANCE", "s", 1e-3, "a sample so near to the end of a step is fused there"),
)


@dataclass(frozen=True)
class HorizonMemory:
    """The layout of the arrays of a horizon.

    Parameters
    ----------
    program : Program
    """

    program: Program

    @cached_property
    def rows(self) -> int:
        """Of the ring: steps that the filter runs behind; raises `InputError` where they are too many."""
        steps = ceil(self.program.horizon * self.program.discrete.rate - 1e-9)
        if steps > MAX_STEPS:
            raise InputError(
                f"a horizon of {self.program.horizon:g} s is {steps} steps at {self.program.discrete.rate:g} Hz",
                where="--horizon",
                remedy=f"Give {MAX_STEPS / self.program.discrete.rate:g} s or less, or gather increments at a lower rate",
            )
        return max(steps, 1)

    @cached_property
    def inputs(self) -> tuple[Argument, ...]:
        """Arguments of a prediction, the step last."""
        return self.program.predict.arguments

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Places in the stored state of what moves by itself or by inputs, the effects' states left out."""
        discrete = self.program.discrete
        effects = {s.name for s in discrete.model.states} - {
            n for b in discrete.model.blocks for n in b.error_names
        }
        pairs = zip(discrete.nominal_names, discrete.step)
        return tuple(i for i, (n, e) in enumerate(pairs) if n not in effects and str(e) != n)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the present state's numbers."""
        return tuple(self.program.discrete.nominal_names[i] for i in self.moving)

    @cached_property
    def quaternion(self) -> tuple[int, ...]:
        """Places of the attitude in the present state; none of a model without one."""
        attitude = self.program.discrete.model.attitude
        return tuple(self.names.index(n) for n in attitude.nominal_names) if attitude else ()

    @property
    def vectors(self) -> tuple[int, ...]:
        """Places of the other numbers in it."""
        return tuple(i for i in range(len(self.moving)) if i not in self.quaternion)

    @cached_property
    def _first(self) -> dict[str, int]:
        found, at = {}, 0
        for a in self.inputs:
            found[a.name] = at
            at += a.size or 1
        return found

    @property
    def width(self) -> int:
        """Numbers of a row of the ring."""
        return sum(a.size or 1 for a in self.inputs) + len(self.moving)

    def given(self, row: Whole, name: str, k: int = 0) -> Ref:
        """A number of an argument in a row of the ring."""
        return Ref(RING, Cell(row, self.width, self._first[name] + k))

    def kept(self, row: Whole, place: int) -> Ref:
        """A number of the present state in a row of the ring, without the corrections that it had by then."""
        return Ref(RING, Cell(row, self.width, self.width - len(self.moving) + place))

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """Of the model."""
        return self.program.discrete.model.sensors

    def room(self, sensor: Sensor) -> int:
        """Places of the queue for a sensor."""
        discrete = self.program.discrete
        usual = discrete.rates.get(sensor.name, sensor.usual_rate or discrete.rate)
        return ceil(min(RATE_MARGIN * usual, discrete.rate) * self.program.horizon - 1e-9) + 1

    def places(self, sensor: Sensor) -> range:
        """Its rows of the queue: samples of one time are fused in the order of the sensors."""
        first = sum(self.room(s) for s in self.sensors[: self.sensors.index(sensor)])
        return range(first, first + self.room(sensor))

    @property
    def entries(self) -> int:
        """Rows of the queue."""
        return sum(self.room(s) for s in self.sensors)

    def entry(self, row: Whole, column: int) -> Ref:
        """A number of a waiting measurement: its time, its rows, their variances."""
        return Ref(QUEUE, Cell(row, 1 + 2 * self.program.rows, column))

    def number(self, place: str) -> Ref:
        """One of `PLACES`."""
        return Ref(HORIZON, list(PLACES).index(place))

    def correction(self, place: int, before: bool = False) -> Ref:
        """What the present state was corrected by since the ring last began again, or in the turn before."""
        return Ref(HORIZON, len(PLACES) + place + len(self.moving) * before)

    def lags(self, sensor: Sensor) -> tuple[int, ...]:
        """Places among the constants of the known delays of all channels of a sensor."""
        names = [c.name for c in self.program.constants]
        return tuple(names.index(n) for n in known_delays(self.program.discrete.model, sensor))

    def moved(self) -> list[Stmt]:
        """Waiting positions less ``offset``, times ``scale``, of north and east."""
        pairs = [(axis, self.names.index(n)) for axis, n in enumerate(("p_N", "p_E"))]

        def shifted(r: Ref, axis: int) -> Stmt:
            return Store(r, mul(sub(r, Ref("offset", axis)), Ref("scale", axis)))

        kept = tuple(shifted(self.kept("row", place), axis) for axis, place in pairs)
        waiting = tuple(shifted(self.entry("waiting", 1 + axis), axis) for axis, _ in pairs)
        queues = [self.places(s) for s in self.sensors if s.shows == "p"]
        return [
            For("row", 0, self.rows, kept),
            *(For("waiting", q.start, q.stop, waiting) for q in queues),
        ]

    @property
    def arrays(self) -> dict[str, tuple[int, str]]:
        """Compared ones: size and meaning."""
        corrections = 2 * len(self.moving)
        return {
            PRESENT: (len(self.moving), "state at the newest inputs, see the places below"),
            HORIZON: (len(PLACES) + corrections, f"{', '.join(PLACES)} of the horizon, and corrections"),
        }

    @property
    def waiting(self) -> dict[str, tuple[int, str]]:
        """What waits: size and meaning."""
        width = 1 + 2 * self.program.rows
        return {
            RING: (self.rows * self.width, f"{self.rows} rows of inputs, step and present state"),
            QUEUE: (self.entries * width, f"{self.entries} measurements that wait"),
        }

    @property
    def scratch(self) -> tuple[Scratch, ...]:
        """Local arrays of the prediction."""
        triads = [Scratch(f"step_{a.name}", a.size) for a in self.inputs if a.size]
        sizes = sorted({len(s.channels) for s in self.sensors})
        samples = [Scratch(f"{name}_{size}", size) for size in sizes for name in ("sample_z", "sample_R")]
        lags = max((len(self.lags(s)) for s in self.sensors), default=0)
        return (*triads, *samples, *((Scratch("lag", lags),) if lags else ()), *LOCALS)


LOCALS = tuple(Scratch(n, 1) for n in ("left", "bound", "soonest", "follow"))
"""Time left in a step, until when samples are fused, the next of them, share of a difference that is corrected."""
