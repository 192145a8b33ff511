"""`Case`: a log with something hidden in it, what is assumed about it, and the truth kept separately."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SI = {
    "deg/s": math.pi / 180.0,
    "deg": math.pi / 180.0,
    "rad/s": 1.0,
    "rad": 1.0,
    "m/s^2": 1.0,
    "m": 1.0,
    "m/s": 1.0,
    "uT": 1e-6,
    "V": 1.0,
    "A": 1.0,
    "N": 1.0,
    "N m": 1.0,
    "%": 1e-2,
    "": 1.0,
    "degC": 1.0,
}
"""Factors to SI of the units used here; ``degC`` is only ever a difference."""


OBVIOUS = 1e6
"""A strength that stands for effects of the size that people meet, whatever they are worth."""


@dataclass(frozen=True)
class Request:
    """What to build.

    Parameters
    ----------
    world : str
        ``static``, ``real``, ``motion`` or ``plant``.
    kind : str
        ``single``, ``null``, ``pair``, ``triple``, ``withheld``, ``unknown``, ``near``, ``integrity``.
    effects : tuple of str
        What is hidden.
    strength : float
        Expected gain less penalty [nats] of each.
    index : int
        Number within the cell; the variant (sensor, motion, length) follows from it.
    seed : int
    """

    world: str
    kind: str
    effects: tuple[str, ...]
    strength: float
    index: int
    seed: int

    @property
    def id(self) -> str:
        """Name of the folder; says nothing about the truth but the order."""
        return f"{self.world}-{self.seed:012x}"

    def rng(self) -> np.random.Generator:
        """The generator of random numbers of this case."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True)
class Hidden:
    """One hidden effect.

    Parameters
    ----------
    effect : str
        Its name in the catalogue, or a description where the catalogue has none.
    channel : str
    parameters : mapping
        True values [SI].
    nats : float
        Expected gain of log-likelihood over the assumed model.
    penalty : float
        Subtracted from it to give the strength [nats].
    also : tuple of str
        Other names that describe exactly the same change of the model.
    deviations : mapping
        Standard deviations of the true values, where they are not known exactly [SI].
    """

    effect: str
    channel: str
    parameters: Mapping[str, float]
    nats: float = math.nan
    penalty: float = 0.0
    also: tuple[str, ...] = ()
    deviations: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """A log, an assumed model and the truth.

    Parameters
    ----------
    variant : str
        Sensor, motion or plant.
    hidden : tuple of Hidden
    t : array, (n,)
        Time stamps [s].
    channels : mapping of str to (array, str)
        Values in the unit named.
    model : str
        Text of the noise or model file.
    base : mapping of str to float
        Assumed noise of the first channel in its own unit (``N``, ``sigma``, ``tau``), for baselines.
    """

    request: Request
    variant: str
    hidden: tuple[Hidden, ...]
    t: Array
    channels: Mapping[str, tuple[Array, str]]
    model: str
    base: Mapping[str, float] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write ``folder/<id>/log.csv`` and ``model.toml``; return that folder."""
        place = folder / self.request.id
        place.mkdir(parents=True, exist_ok=True)
        names = ["t [s]", *(f"{name} [{unit}]" for name, (_, unit) in self.channels.items())]
        np.savetxt(
            place / "log.csv",
            np.column_stack([self.t, *(values for values, _ in self.channels.values())]),
            fmt=["%.9f", *["%.10g"] * len(self.channels)],
            delimiter=",",
            header=",".join(names),
            comments="",
        )
        (place / "model.toml").write_text(self.model, encoding="utf-8")
        return place

    def write_truth(self, folder: Path) -> Path:
        """Write ``folder/<id>.json``, separate from the log; return it."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.request.id}.json"
        path.write_text(json.dumps(self.truth(), indent=1), encoding="utf-8")
        return path

    def truth(self) -> dict[str, Any]:
        """The truth as plain data."""
        r = self.request
        return {
            "id": r.id,
            "world": r.world,
            "kind": r.kind,
            "variant": self.variant,
            "strength": r.strength,
            "seed": r.seed,
            "cell": "+".join(r.effects) or "null",
            "samples": int(self.t.size),
            "hidden": [
                {
                    "effect": h.effect,
                    "channel": h.channel,
                    "parameters": {k: float(v) for k, v in h.parameters.items()},
                    "nats": float(h.nats),
                    "penalty": float(h.penalty),
                    "also": list(h.also),
                    "deviations": {k: float(v) for k, v in h.deviations.items()},
                }
                for h in self.hidden
            ],
        }


def noise_file(channels: Mapping[str, tuple[str, Mapping[str, float]]]) -> str:
    """The text of a noise file: channel to (unit, ``N``, ``sigma``, ``tau`` in that unit)."""
    lines = ['format = "kfgen-noise-1"', ""]
    for name, (unit, numbers) in channels.items():
        lines += [f"[{name}]", f'unit = "{unit}"', "effects = ["]
        lines.append(f'  {{ effect = "white_noise", N = "{numbers["N"]:.10g} {unit}/sqrt(Hz)" }},')
        if numbers.get("sigma"):
            lines.append(
                f'  {{ effect = "gauss_markov", sigma = "{numbers["sigma"]:.10g} {unit}",'
                f' tau = "{numbers["tau"]:.10g} s" }},'
            )
        lines += ["]", ""]
    return "\n".join(lines)
