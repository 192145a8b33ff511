"""The estimates of a filter over a log, as a log of their own: what `kfgen run -o` writes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.core.units import parse_unit
from kfgen.log.log import Channel, Log
from kfgen.model.filter import FilterModel
from kfgen.model.symbols.blocks import Attitude
from kfgen.run.run import FilterRun

Array = NDArray[np.float64]


def estimates(result: FilterRun, model: FilterModel) -> Log:
    """Every stored state, ``sd_`` of every error state, ``innovation_`` of every channel with its ``sd_innovation_``.

    Of every sensor ``nis_``, the squared innovation of the whole sample over its covariance, ``nis_over_gate_``, the same
    over the square of the emitted filter's gate, and ``accepted_``: one, or zero where the emitted filter would reject it.

    Parameters
    ----------
    result : FilterRun
        Of that model.
    model : FilterModel

    Returns
    -------
    Log
        At the times of the run; innovations, NIS and decisions are missing where a sensor had no sample.
    """
    units = {n: "" if isinstance(b, Attitude) else b.unit for b in model.blocks for n in b.nominal_names}
    units |= {s.name: s.unit for s in model.states if s.name not in units}
    channels = {n: _channel(x, units.get(n, "")) for n, x in zip(result.names, result.estimate.T)}
    for state, x in zip(model.states, result.deviation.T):
        channels[f"sd_{state.name}"] = _channel(x, state.unit)
    for name, run in result.updated.items():
        sensor, rows = model.sensor(name), np.searchsorted(result.t, run.t)
        for before, values in (("innovation", run.innovation), ("sd_innovation", run.deviation)):
            for c, x in zip(sensor.channels, values.T if values is not None else ()):
                channels[f"{before}_{c}"] = _channel(_at(rows, x, result.t.size), model.channel_units[c])
        decided = {"nis": run.nis, "nis_over_gate": run.over_gate, "accepted": run.is_accepted.astype(float)}
        for before, x in decided.items():
            channels[f"{before}_{name}"] = _channel(_at(rows, x, result.t.size), "")
    return Log(result.t, channels, source=f"{result.model} over {result.source}")


def _channel(values: Array, unit: str) -> Channel:
    return Channel.of(values, parse_unit(unit).si)


def _at(rows: NDArray[np.intp], values: Array, size: int) -> Array:
    out = np.full(size, np.nan)
    out[rows] = values
    return out
