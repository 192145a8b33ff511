"""The verb `denoise`: the adaptive filters of channels of a log, with what they cost under motion.

References
----------
.. [1] M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models, 2019.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import kfgen
from kfgen.core.channel_names import some_of
from kfgen.core.elapsed import counted
from kfgen.core.errors import InputError
from kfgen.core.result import Result, ShortTable
from kfgen.identify.channels import checked
from kfgen.log.log import Channel, Log
from kfgen.log.readers import LogOrPath, log_of
from kfgen.run.adaptive.denoise import ORDER, Denoised, Settings, at_rest, denoise_samples
from kfgen.run.adaptive.loop import RATIO, WINDOW
from kfgen.run.adaptive.rules import rule_named

MAX_PROCESS_ORDER = 20
"""The largest p or q of an ARMA(p, q) process."""
FILTERED_UNASKED = ("gyro", "accel")
"""How the names of the channels begin that are filtered where none is named."""


@dataclass(frozen=True, repr=False)
class DenoisedLog(Result):
    """Filtered channels of a log.

    Parameters
    ----------
    raw : Log
        As it was given.
    channels : mapping of str to Denoised
        The filtered ones.
    settings : Settings
        What was asked for.
    """

    raw: Log
    channels: Mapping[str, Denoised]
    settings: Settings

    @property
    def log(self) -> Log:
        """The log with the filtered channels in place of the raw ones."""
        filtered = {n: Channel(d.values, self.raw.channels[n].unit) for n, d in self.channels.items()}
        return replace(self.raw, channels={**self.raw.channels, **filtered})

    @property
    def title(self) -> str:
        """The filter in words."""
        return rule_named(self.settings.filter).title

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of the log and of each channel at rest."""
        own = [f"{name}: {w}" for name, one in self.channels.items() for w in one.rest.warnings]
        return (*self.raw.warnings, *own)

    def summary(self) -> list[str]:
        """The filter, and what it does to each channel."""
        head = f"{self.title} over {self.raw.duration:.6g} s of {self.raw.source}"
        return [head, *(f"{name}: {one.cost.words}" for name, one in list(self.channels.items())[:4])]

    def short_table(self) -> ShortTable:
        """White noise and bias instability after by before, and the gain of a constant rate."""
        rows = [
            [
                name,
                *(
                    f"{value:.3g}"
                    for value in (one.after.N / one.before.N, one.after.B / one.before.B, one.cost.dc)
                ),
            ]
            for name, one in self.channels.items()
        ]
        return ("channel", "N after / before", "B after / before", "gain of a constant rate"), rows

    def to_dict(self) -> dict[str, Any]:
        """Process, noise before and after, and cost of each channel."""
        return {
            "format": "kfgen-denoise-1",
            "kfgen": kfgen.__version__,
            "log": self.raw.source,
            "sha256": self.raw.sha256,
            "filter": self.settings.filter,
            "window": self.settings.window,
            "channels": {name: d.to_dict(self.raw.channel(name).si) for name, d in self.channels.items()},
        }


def denoise(  # noqa: PLR0913 - the choices of one command
    log: LogOrPath,
    filter: str = "shafkf-r",
    channels: Sequence[str] | str | None = None,
    resting: LogOrPath | None = None,
    *,
    order: tuple[int, int] | str = ORDER,
    estimator: str = "ml",
    window: int = WINDOW,
    ratio: float = RATIO,
) -> DenoisedLog:
    """Filter channels of a log by the adaptive Kalman filters of Narasimhappa (2019).

    Parameters
    ----------
    log : Log or path-like
        Evenly sampled.
    filter : str
        The rule of adaptation: ``kf``, ``iae``, ``iae-q``, ``sage-husa``, ``shafkf-p`` or ``shafkf-r``.
    channels : sequence of str, or str with commas, optional
        Those to be filtered; gyros and accelerometers where left out.
    resting : Log or path-like, optional
        A log at rest from which the noise is estimated; `log` itself where left out.
    order : tuple of int, or str
        ``(p, q)`` of the ARMA process of the noise, also as ``"2,1"``; ``"auto"`` for Akaike's criterion.
    estimator : str
        Of the process, see `kfgen.list_all`.
    window : int
        Innovations whose mean square a rule looks at [samples].
    ratio : float
        R over Q; 980 in that paper.

    Returns
    -------
    DenoisedLog

    Raises
    ------
    InputError
        No such filter, order, estimator or channel, or a channel that wanders or moves where it should rest.
    """
    rule_named(filter)
    if not 0.0 < ratio < float("inf"):
        raise InputError(f"a ratio of {ratio:g} is none", where="--ratio", remedy="Give a positive number")
    settings = Settings(filter, _order(order), estimator, window, ratio)
    data = log_of(log)
    still = data if resting is None else log_of(resting)
    wanted = list(checked(channels) or [c for c in data.channels if c.startswith(FILTERED_UNASKED)])
    if not wanted:
        raise InputError(
            f"there is no gyro or accel among {some_of(data.channels)}",
            where=data.source,
            remedy="Name channels with --channels",
        )
    done = {name: _filtered(name, data, still, settings) for name in counted(wanted, "channels")}
    return DenoisedLog(data, done, settings)


def _filtered(name: str, data: Log, still: Log, settings: Settings) -> Denoised:
    """One channel; an error says which."""
    dt = data.uniform_dt()
    try:
        rest = at_rest(still.channel(name).values, settings)
        return denoise_samples(data.channel(name).values, dt, settings, rest)
    except InputError as error:
        where = error.where or f"{still.source}: channel {name}"
        raise InputError(error.what, where=where, remedy=error.remedy) from None


def _order(order: tuple[int, int] | str) -> tuple[int, int] | None:
    """``(p, q)``; None for the choice by Akaike's criterion."""
    if order == "auto":
        return None
    parts = order.split(",") if isinstance(order, str) else [str(n) for n in order]
    whole = [int(p) for p in parts if p.strip().isdigit()]
    if len(parts) != 2 or len(whole) != 2 or max(whole) > MAX_PROCESS_ORDER:
        raise InputError(
            f"'{order}' is no order of an ARMA process", where="--order", remedy="Write it like 2,1, or auto"
        )
    return whole[0], whole[1]
