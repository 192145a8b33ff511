"""`tune`: the noise of a filter by its own innovations over a log, the numbers to fly with beside those of the bench."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from kfgen.core.errors import InputError
from kfgen.core.result import Result, ShortTable
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.noise.noise_file import as_given, assumed_noise, with_sizes
from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
from kfgen.gap.flight.noise.tuned import TunedSize, shown_scales, sizes_of_part
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.scene.addition import relinearised
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import start_of
from kfgen.log.readers import LogOrPath, log_of
from kfgen.model.build import ModelSource, filter_file, filter_of
from kfgen.model.filter_file import FilterFile
from kfgen.run.filter_log import as_named_by

LEARNT_SHARE = 0.7
"""Share of the readings, the first, by whose sizes the others are judged."""


@dataclass(frozen=True, repr=False)
class Tuning(Result):
    """The sizes of a filter's noises that a log asks for.

    Parameters
    ----------
    model, source : str
        Of what, and from which log.
    sizes : tuple of TunedSize
    nis : mapping of str to (float, float)
        Mean squared normalised innovation of each channel with the assumed and with the estimated sizes; one is right.
    unseen_nats : (float, float)
        Log-likelihood of a reading of the last 30 % with the assumed sizes, and with those of the first 70 %.
    improved : FilterFile
        The filter with the sizes that the log shows.
    """

    model: str
    source: str
    sizes: tuple[TunedSize, ...]
    nis: dict[str, tuple[float, float]]
    unseen_nats: tuple[float, float]
    improved: FilterFile

    def summary(self) -> list[str]:
        """What came out."""
        before, after = self.unseen_nats
        said = f"{after - before:+.3g} nats a reading of aiding sensors on the last {100 * (1 - LEARNT_SHARE):.0f} % of them"
        return [f"{self.model} over {self.source}: noise tuned, {said}", *map(size_words, self.sizes)]

    def short_table(self) -> ShortTable:
        """Every size."""
        rows = [[s.group.where, *_numbers(s), "yes" if s.is_shown else "cannot tell"] for s in self.sizes]
        return ("white noise of", "times the assumed", "95 %", "shown by this log"), rows

    def to_dict(self) -> dict[str, Any]:
        """Sizes over what is assumed, mean squared normalised innovations, nats on the unseen part."""
        return {
            "model": self.model,
            "log": self.source,
            "sizes": [
                {"where": s.group.where, "times": s.times, "ci95": list(s.ci95), "shown": s.is_shown}
                for s in self.sizes
            ],
            "mean_nis": {c: {"before": a, "after": b} for c, (a, b) in self.nis.items()},
            "unseen_nats_per_reading": dict(zip(("before", "after"), self.unseen_nats)),
        }


def size_words(s: TunedSize) -> str:
    """A size in a sentence."""
    times, interval = _numbers(s)
    if not s.is_shown:
        return f"The white noise of {s.group.where}: this log cannot tell; fly faster turns and accelerations, or log longer"
    return f"The white noise of {s.group.where} is {times} times the assumed one (95 %: {interval})"


def _numbers(s: TunedSize) -> tuple[str, str]:
    return f"{s.times:.3g}", f"{s.ci95[0]:.3g} to {s.ci95[1]:.3g}"


def tune(model: ModelSource, log: LogOrPath) -> Tuning:
    """The noise of a filter by the innovations over a log: what its tests at rest become in motion.

    Parameters
    ----------
    model : FilterModel, str or Path
        A filter with an attitude and aiding sensors, as `kfgen.build` gives or takes it.
    log : Log or path-like
        With its inputs and the samples of an aiding sensor beside accelerometers and magnetometers.

    Returns
    -------
    Tuning

    Raises
    ------
    InputError
        The log has no aiding sensor of the filter, is too short or too slow, or the filter diverges over it.
    """
    built = filter_of(model)
    data = as_named_by(built, log_of(log))
    flight = flight_scene(data, built)
    if flight is None:
        raise InputError(
            f"the log has no samples of an aiding sensor of {built.name} beside its inputs, or the filter has no attitude",
            where=data.source,
            remedy="Give a log with gnss, barometer or airspeed; at rest, kfgen identify measures the noise",
        )
    fit = fitted(flight, start_of(flight))
    start, fit = relinearised(flight, fit)
    assert isinstance(start, FlightScene)  # a flight about another path is one
    found = start.tuned(fit.point)
    written = as_given(built, assumed_noise(built, data))
    improved = filter_file(built, with_sizes(written, built, shown_scales(found.sizes)))
    known = {u.name: u.value for u in found.unknowns}
    judged = _unseen(start.path.without(start.path.du, start.path.dz, known), found.path)
    return Tuning(built.name, data.source, found.sizes, _nis(start.path, found.path), judged, improved)


def _nis(before: FlownPath, after: FlownPath) -> dict[str, tuple[float, float]]:
    """Mean squares of the normalised innovations of each channel."""
    squares = [p.linear.normalised**2 for p in (before, after)]
    rows = before.rows
    return {
        c: (float(squares[0][rows.of(c)].mean()), float(squares[1][rows.of(c)].mean())) for c in rows.channels
    }


def _unseen(before: FlownPath, after: FlownPath) -> tuple[float, float]:
    """Nats of a reading of the last part, with the assumed sizes and with those that the first part asks for."""
    first = int(before.rows.at[int(LEARNT_SHARE * before.rows.at.size)])
    sizes = sizes_of_part(after, first)
    last = before.rows.at >= first
    nats = []
    for path in (replace(before, sizes=NoiseSizes()), replace(before, sizes=sizes)):
        nats.append(float(path.linear.nats_of_readings[last].mean()))
    return nats[0], nats[1]
