"""A log as calls of a filter: how it starts, then sample by sample what it is given, late samples at their own times.

Every target that runs over a log gets its calls from here: what `kfgen run` computes and what the proof replays
through the emitted C are the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import MAX_QUANTITY
from kfgen.emit.routines import Program
from kfgen.emit.targets.names import argument
from kfgen.log.log import Log
from kfgen.log.pauses import in_words, pauses
from kfgen.model.filter import FilterModel
from kfgen.model.known_delays import shifts, without_shifts
from kfgen.model.parts.motion import AFTER, AT, BEFORE, INCREMENTS, SAMPLES, Input
from kfgen.model.parts.sensors import Sensor
from kfgen.model.plant.equations import Equations, Shown
from kfgen.run.alignment import align_attitude, constants_at_rest
from kfgen.run.driver_course import driver_course
from kfgen.run.own_times import OwnTimes

Array = NDArray[np.float64]
Given = dict[str, Array | float]
"""Arguments of a call by name [SI], in the order of the routine's."""

SLOWER_PERIODS = 1.5
"""Steps of a sensor's samples, in periods of the log, from which it has a rate of its own [1]."""
OFF = 0.05
"""Periods by which the samples of a log may be off those of a filter that counts them."""


@dataclass(frozen=True)
class FilterCall:
    """One call of a filter.

    Parameters
    ----------
    routine : str
    given : mapping of str to ndarray or float
        Its arguments by name [SI].
    row : int
        Of the log: where the sample stands, or the inputs.
    """

    routine: str
    given: Given
    row: int

    @property
    def sensor(self) -> str:
        """The sensor whose sample is fused; empty of a prediction."""
        return self.routine.removeprefix("update_") if self.routine.startswith("update_") else ""


@dataclass(frozen=True)
class FilterCalls:
    """A log for a filter.

    Parameters
    ----------
    program : Program
    log : Log
        With the model's inputs and drivers; sensors whose channels it lacks are left out.
    known : mapping of str to float
        Stored states that are known better than by alignment [SI].

    Raises
    ------
    InputError
        An input is missing or not a number, a sample is too large for any sensor, a sensor is of another epoch, or no
        sensor is in the log.
    """

    program: Program
    log: Log
    known: Mapping[str, float] = field(default_factory=dict)

    GATE: ClassVar[float] = float("inf")
    """Every sample counts: the innovations of these calls are its result."""

    def __post_init__(self) -> None:
        model = self.program.discrete.model
        strangers = sorted(self.known.keys() - set(self.program.discrete.nominal_names))
        if strangers:
            raise InputError(
                f"{model.name} stores no '{strangers[0]}'",
                where="start",
                remedy=f"It stores {', '.join(self.program.discrete.nominal_names)}",
            )
        self._check_sizes()
        self._check_epochs()
        _ = self.inputs
        self._check_rate()
        if not self._samples:
            raise InputError(
                f"no sensor of {model.name} is in the log",
                where=self.log.source,
                remedy="It knows " + ", ".join(c for s in model.sensors for c in s.channels),
            )

    def _check_sizes(self) -> None:
        """One sample whose square is no number would leave no estimate after it that is one."""
        for name, channel in self.log.channels.items():
            if (np.abs(channel.values) > MAX_QUANTITY).any():
                raise InputError(
                    f"channel {name} has samples beyond anything that is measured",
                    where=self.log.source,
                    remedy="Check the column and its unit",
                )

    def _check_epochs(self) -> None:
        """Sensors without a sample in the time of the log would silently aid nothing."""
        for sensor in self.program.discrete.model.sensors:
            said = next((self.log.unplaced[c] for c in sensor.channels if c in self.log.unplaced), "")
            if said:
                raise InputError(
                    f"{sensor.name} is of another epoch: {said}, and none is between",
                    where=self.log.source,
                    remedy="Log both by one clock, or name the sensors that the filter shall have (--sensor, or `sensors` of its file)",
                )

    def _check_rate(self) -> None:
        """A filter that keeps samples of an input counts its delay in periods of its own rate."""
        discrete = self.program.discrete
        late, periods = discrete.model.motion.late, self.log.dt * discrete.rate
        if late and abs(periods - max(round(periods), 1)) > OFF:
            raise InputError(
                f"the delay of {late[0].channel} is kept in samples at {discrete.rate:g} Hz, but the log has {1.0 / self.log.dt:.6g} Hz",
                where=self.log.source,
                remedy=f"Emit the filter with --rate {1.0 / self.log.dt:.6g}",
            )

    @cached_property
    def inputs(self) -> dict[str, Array]:
        """Inputs and drivers by argument, shape (n,) or (n, 3)."""
        model = self.program.discrete.model
        triads = {argument(i.name): _input(self.log, i) for i in model.motion.inputs}
        return triads | {argument(d): driver_course(self.log, d) for d in model.drivers}

    @property
    def samples(self) -> str:
        """What a sample of the inputs stands for: as it is asked for, else as the log says, else as the model takes it."""
        model = self.program.discrete.model
        usual = str(model.motion.chosen.get(SAMPLES.name, AFTER))
        return usual if SAMPLES.name in model.options else self.log.samples or usual

    @cached_property
    def _acting(self) -> dict[str, Array]:
        """What acts from each sample to the next."""
        motion = self.program.discrete.model.motion
        triads = {argument(i.name) for i in motion.inputs}
        return {n: over_steps(v, self.samples) if n in triads else v for n, v in self.inputs.items()}

    @cached_property
    def _samples(self) -> dict[str, Array]:
        """Samples of the sensors that are in the log, shape (n, rows)."""
        return {
            s.name: np.column_stack([self.log.channel(c).values for c in s.channels])
            for s in self.program.discrete.model.sensors
            if all(c in self.log.channels for c in s.channels)
        }

    @cached_property
    def _aligned(self) -> tuple[dict[str, float], dict[str, float]]:
        """Stored states and constants at the start, by name."""
        model = self.program.discrete.model
        x = dict(zip(self.program.discrete.nominal_names, self.program.discrete.start))
        k = {c.name: float(c.value) for c in model.constants}
        if not isinstance(model.motion, Equations) and model.attitude is not None:
            align_attitude(self.program, self.log, x, k)
        for s, i, name in _shown(self.program):
            if s.channels[i] in self.log.channels:
                x[name] = self._first(s.channels[i])
        for m in self.program.discrete.memories:
            x[m.name] = self._first(m.channel)
        x |= {n: v.value for n, v in model.initial.items() if n in x}
        return x | {n: float(v) for n, v in self.known.items()}, k

    def _first(self, channel: str) -> float:
        """The first sample of a channel that is a number; zero where there is none."""
        values = self.log.channels[channel].values if channel in self.log.channels else np.zeros(0)
        good = values[np.isfinite(values)]
        return float(good[0]) if good.size else 0.0

    @property
    def start(self) -> list[float]:
        """The stored state [SI]: attitude from what points up and north at rest, blocks from the sensors that show them."""
        return list(self._aligned[0].values())

    @property
    def constants(self) -> list[float]:
        """The model's constants [SI], some of them as the sensors show them at rest; a delay is over at a sample's own time."""
        return list((self._aligned[1] | without_shifts(self.program.discrete.model)).values())

    @property
    def assumed_exact(self) -> dict[str, float]:
        """The constants that the alignment takes from the log [SI], where no noise stands for their errors."""
        sensors = [
            s for s in self.program.discrete.model.sensors if s.name in self._samples and not s.left_out
        ]
        return {n: self._aligned[1][n] for n in constants_at_rest(sensors)}

    @property
    def through_pauses(self) -> tuple[str, ...]:
        """What is to be said of the pauses of the log: one sentence, or none."""
        if not pauses(self.log):
            return ()
        return (
            f"{in_words(self.log)}: the filter holds the last reading of its inputs until it ends, and what it "
            "estimates from then on is not to be trusted. Cut the log there",
        )

    @cached_property
    def delays(self) -> dict[str, float]:
        """By how much the samples of sensors come after their own times, as the filter knows [s]."""
        return shifts(self.program.discrete.model)

    @cached_property
    def _own_times(self) -> OwnTimes:
        return OwnTimes.of(np.asarray(self.log.t), self.log.dt, self.present, self.delays)

    @cached_property
    def present(self) -> dict[str, Array]:
        """The samples that are to be used, shape (n, rows), the others not numbers."""
        x, k = self._aligned
        present = {name: z.copy() for name, z in self._samples.items()}
        for s in self.program.discrete.model.sensors:
            if s.name in present:
                present[s.name][~s.plausible(present[s.name], x | k)] = np.nan
        return present

    @cached_property
    def _takes(self) -> dict[str, tuple[str, ...]]:
        """Names of the arguments of each sensor's update beside the sample, and of the prediction beside the step."""
        takes = {r.name: tuple(a.name for a in r.arguments) for r in self.program.pieces}
        stepping = set().union(*(takes[n] for n in ("step", "transition", "noise")))
        found = {name: takes[f"expect_{name}"] for name in self._samples}
        return found | {"predict": tuple(n for n in self.inputs if n in stepping)}

    def updates(self, k: int) -> Iterator[FilterCall]:
        """The sensors that have a sample of time k, with the arguments of their updates."""
        late = self._own_times.at(k)
        for name, samples in self.present.items():
            rows = [s.row for s in late if s.name == name] if name in self.delays else [k]
            for row in rows:
                if np.isfinite(samples[row]).all():
                    given = {n: self.inputs[n][k] for n in self._takes[name]}
                    yield FilterCall(f"update_{name}", {"z": samples[row], **given}, row)

    def steps(self, k: int) -> Iterator[FilterCall]:
        """From sample k to the next: predictions, none of them longer than the longest step, and what was taken between.

        Through a gap the input is held: nothing better is known of it. What keeps samples of a late input steps on
        by about one period of the filter's rate at a time.
        """
        acting = {n: v[k] for n, v in self._acting.items()}
        stepping = {n: acting[n] for n in self._takes["predict"]}
        for length, late in self._own_times.between(k):
            parts = self._parts(length)
            for _ in range(parts):
                yield FilterCall("predict", {**stepping, "dt": length / parts}, k)
            for s in late:
                given = {n: acting[n] for n in self._takes[s.name]}
                yield FilterCall(f"update_{s.name}", {"z": self.present[s.name][s.row], **given}, s.row)

    def parts(self, k: int) -> int:
        """How many predictions there are from sample k to the next."""
        return sum(self._parts(length) for length, _ in self._own_times.between(k))

    def _parts(self, length: float) -> int:
        """Predictions of a time [s]."""
        discrete = self.program.discrete
        periods = round(length * discrete.rate) if discrete.model.motion.late else 1
        return max(1, ceil(length / discrete.max_step), periods)


def rates_in(log: Log, model: FilterModel) -> dict[str, float]:
    """How often sensors have a sample, by name [Hz], of those that are slower than the log: by the median of their steps."""
    found = {}
    for s in model.sensors:
        if all(c in log.channels for c in s.channels):
            there = np.isfinite([log.channels[c].values for c in s.channels]).all(axis=0)
            step = float(np.median(np.diff(log.t[there]))) if there.sum() > 1 else 0.0
            if step > SLOWER_PERIODS * log.dt:
                found[s.name] = 1.0 / step
    return found


def _input(log: Log, given: Input) -> Array:
    """An input, shape (n,) or (n, 3); zeros where a quiet one is not in the log."""
    if given.quiet and not any(c in log.channels for c in given.channels):
        values = np.zeros((log.n, len(given.channels)))
    else:
        values = np.column_stack([log.values(c) for c in given.channels])
    return values[:, 0] if given.scalar else values


def over_steps(values: Array, samples: str) -> Array:
    """What acts from each sample to the next, by what a sample stands for."""
    later = np.concatenate([values[1:], values[-1:]])
    own = {AFTER: 1.0, AT: 0.5, BEFORE: 0.0, INCREMENTS: 0.0}[samples]
    return np.asarray(own * values + (1.0 - own) * later)


def _shown(program: Program) -> list[tuple[Sensor, int, str]]:
    """Sensors that show a stored state: with the row, and the state's name.

    A plant's state that starts unknown starts where a sensor shows it.
    """
    model = program.discrete.model
    motion = model.motion
    if isinstance(motion, Equations):
        return [
            (s, 0, s.value.name)
            for s in model.sensors
            if isinstance(s, Shown) and motion.starts_unknown(s.value)
        ]
    places = {b.name: b.nominal_names for b in model.blocks}
    return [(s, i, n) for s in model.sensors if s.shows in places for i, n in enumerate(places[s.shows])]
