"""`RecordedChannel`: a channel of a plant's log, made ready to be compared with a simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import parse_unit
from kfgen.effects import Effect
from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import PlantEffect
from kfgen.effects.process.stochastic import has_white_noise
from kfgen.gap.core.whitener import Whitener
from kfgen.log.course import own_period_s
from kfgen.log.log import Log
from kfgen.model.plant.user import Measurement, UserModel

Array = NDArray[np.float64]

MIN_GAP_STEPS = 3.0
"""Usual steps of time beyond which samples are missing."""
MAX_DISTANCE_SD = 1e3
"""Standard deviations of the data at which a simulation that diverges is held."""


@dataclass(frozen=True)
class RecordedChannel:
    """One compared channel: the samples that it has, their values less what is assumed about the sensor [SI]."""

    at: NDArray[np.intp]
    values: Array
    whitener: Whitener

    @property
    def noise(self) -> float:
        """Standard deviation of the white noise of a sample [SI]."""
        return 1.0 / float(self.whitener.weight[-1])

    @property
    def deviation(self) -> float:
        """Standard deviation of its values [SI]."""
        return float(np.std(self.values))

    def share_left(self, simulated: Array) -> float:
        """Share of its power that a simulation, of shape (n, 1), leaves."""
        return float(np.mean(self.left(simulated) ** 2)) / max(self.deviation, self.noise) ** 2

    def left(self, simulated: Array) -> Array:
        """Measured less simulated, shape (n, points), finite even where the simulation is not."""
        far = MAX_DISTANCE_SD * max(float(np.ptp(self.values)), self.noise)
        left = self.values[:, None] - simulated[self.at]
        # In turn to either side: one side all along would be a constant, which something else might explain.
        side = far * (1.0 - 2.0 * (np.arange(self.at.size) % 2))[:, None]
        return np.where(np.abs(np.where(np.isfinite(left), left, np.inf)) < far, left, side)

    def begun(self, effect: SensorChange, t: Array, shown: Array) -> Array:
        """Whitened, one standard deviation of what a sensor may have begun with, shape (n, points); zero where nothing."""
        found = effect.begun(t[self.at], shown[self.at])
        if found is None or not np.isfinite(found).all():
            return np.zeros((self.at.size, shown.shape[1]))
        return self.whitener.ordinates(found)


def check_unit(log: Log, name: str, unit: str, model: UserModel) -> None:
    """Raise `InputError` where a channel of the log has another dimension than the model's.

    Parameters
    ----------
    log : Log
    name : str
        Of the channel.
    unit : str
        That the model has.
    model : str
        Its name.
    """
    given = log.channel(name).unit
    if not parse_unit(given).same_dimension(parse_unit(unit)):
        raise InputError(
            f"channel {name} is in {given or '1'} in the log, {model.name} needs {unit or '1'}",
            where=log.source,
            remedy="Correct the unit in the header, or in the model file",
        )


def check_near(
    model: UserModel, recorded: Mapping[str, RecordedChannel], shown: Mapping[str, Array], words: str
) -> None:
    """Raise `InputError` where simulated channels, shape (n, 1), are farther from the log than that from its mean.

    Parameters
    ----------
    model : UserModel
    recorded : mapping of str to RecordedChannel
    shown : mapping of str to ndarray
        Simulated channels [SI].
    words : str
        How it was simulated, said in the error.
    """
    for name, r in recorded.items():
        if float(np.sqrt(np.mean(r.left(shown[name]) ** 2))) > float(np.std(r.values)):
            raise InputError(
                f"{model.name} does not follow the log: {words}, a simulation is nowhere near {name}, "
                "however often it starts anew",
                where=model.path,
                remedy="Check the equations and what is assumed about their numbers: a gap is looked for in a model that is nearly right",
            )


def recorded_of(model: UserModel, log: Log, name: str) -> RecordedChannel:
    """The samples of a channel, less the deterministic effects that are assumed about it.

    Parameters
    ----------
    model : UserModel
    log : Log
    name : str
        Of the measurement.
    """
    measurement = model.measurements[name]
    check_unit(log, name, measurement.unit, model)
    effects = effects_assumed_of(measurement, log, name)
    if not has_white_noise(effects):
        raise InputError(
            f"the model of {name} has no white noise",
            where=model.path,
            remedy="Give it an effect white_noise",
        )
    values = np.asarray(log.channel(name).values)
    at = np.flatnonzero(np.isfinite(values))
    if at.size < 8:
        raise InputError(f"channel {name} has {at.size} samples", where=log.source, remedy="Log more")
    y = values[at] - _assumed(effects, log, at)
    steps = np.diff(log.t[at])
    dt = float(np.mean(steps[steps <= MIN_GAP_STEPS * np.median(steps)]))
    return RecordedChannel(at, y, Whitener.of(effects, at.size, dt, constant=True))


def effects_assumed_of(measurement: Measurement, log: Log, name: str) -> list[Effect]:
    """The noise and the errors that are assumed of a channel of a log, without what changes the plant.

    Parameters
    ----------
    measurement : Measurement
    log : Log
    name : str
        Of the measurement.
    """
    noise = measurement.noise.in_record(own_period_s(log, name), log.duration)
    return [e for e in noise.effects if not isinstance(e, PlantEffect)]


def _assumed(effects: Sequence[Effect], log: Log, at: NDArray[np.intp]) -> Array:
    """What the deterministic effects of a channel give [SI], shape (n,)."""
    t = np.asarray(log.t)[at] - log.t[0]
    total = np.zeros(at.size)
    for e in effects:
        if e.coefficients():
            drive = {e.driver: log.values(e.driver)[at]} if e.driver else None
            total = total + e.mean(t, drive)
    return total
