"""The verb `simulate`: a log from a filter model, with its true motion and every effect of its channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from kfgen.log.log import Log
from kfgen.model.build import ModelSource, NoiseSource, filter_of
from kfgen.model.discretise import DiscreteModel
from kfgen.simulate.simulate import simulate as simulated


def simulate(  # noqa: PLR0913 - the choices of one command
    model: ModelSource,
    manoeuvre: str | Path = "static",
    duration: float = 60.0,
    rate: float = 100.0,
    seed: int = 0,
    *,
    noise: NoiseSource | None = None,
    rates: Mapping[str, float] | None = None,
    decoys: Sequence[str] = (),
    vibration: float = 0.0,
) -> Log:
    """A log of every input and sensor of a filter, with the truth as ``ref_`` channels.

    Parameters
    ----------
    model : FilterModel, str or Path
        A filter of `kfgen.build`, the name of a library model, or the path of a filter file or a model file.
    manoeuvre : str or Path
        A manoeuvre of the library (see `kfgen.list_all`), or a manoeuvre file.
    duration : float
        Length of the log [s].
    rate : float
        Samples per second [Hz].
    seed : int
        Of the random numbers; the same seed gives the same log.
    noise : NoiseModel or path-like, optional
        The effects of the channels; only beside a name or a path.
    rates : mapping of str to float, optional
        Samples per second of sensors [Hz] by name, ``{"gnss": 5.0}``; that of the log for all others.
    decoys : sequence of str
        Drivers in the log on which nothing depends, ``temperature`` for example.
    vibration : float
        Of a vibration that comes and goes on every axis, root mean square [m/s^2].

    Returns
    -------
    Log

    Raises
    ------
    InputError
        As in `kfgen.build`, no such manoeuvre, or a duration of less than two samples.
    """
    discrete = DiscreteModel.at_rate(filter_of(model, noise), rate)
    rng = np.random.default_rng(seed)
    return simulated(
        discrete, str(manoeuvre), duration, rng, rates=rates, decoys=tuple(decoys), vibration=vibration
    )
