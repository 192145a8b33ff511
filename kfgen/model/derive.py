"""The verb `derive`: the matrices of a filter, with what a reader must know beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp

import kfgen
from kfgen.core.result import Result, ShortTable
from kfgen.model.build import ModelSource, NoiseSource, filter_of
from kfgen.model.discretise import DiscreteModel
from kfgen.model.effects_in_words import effects_in_words
from kfgen.model.parts.motion import Input
from kfgen.model.parts.sensor import Sensor


@dataclass(frozen=True, repr=False)
class Derivation(Result):
    """The equations of a filter.

    Parameters
    ----------
    discrete : DiscreteModel
        The filter model and its step.
    """

    discrete: DiscreteModel

    @cached_property
    def matrices(self) -> dict[str, sp.Matrix]:
        """By letter: F, G, W (noise density), ``H sensor`` of each sensor, Phi and Qd."""
        d = self.discrete
        sensors = {f"H {s.name}": d.H(s) for s in d.model.sensors}
        return {"F": d.model.F, "G": d.model.G, "W": d.model.W, **sensors, "Phi": d.Phi, "Qd": d.Qd}

    @property
    def parts(self) -> list[Input | Sensor]:
        """The inputs and the sensors."""
        return [*self.discrete.model.motion.inputs, *self.discrete.model.sensors]

    @property
    def assumptions(self) -> list[str]:
        """Frame, error convention, and the noise that is added for what the model leaves out."""
        model, said = self.discrete.model, []
        if model.attitude is not None:
            axes = ", ".join(model.motion.axes)
            said.append(f"Navigation axes {axes}; R_nb takes body to navigation axes")
            said.append(f"Error: {model.convention.title}; {model.convention.equation}")
        for part in self.parts:
            if part.left_out:
                said.append(
                    f"{part.name}: {part.left_out:g} {part.unit}/sqrt(Hz) is added to its noise for what the model "
                    "leaves out (off with --set left_out=false)"
                )
        return said + effects_in_words(model)

    def summary(self) -> list[str]:
        """The model and the sizes of its matrices."""
        model = self.discrete.model
        sizes = ", ".join(f"{letter} {M.rows} x {M.cols}" for letter, M in self.matrices.items())
        return [f"{model.name}: {model.title}", f"{len(model.states)} states; {sizes}", *self.assumptions[:3]]

    def short_table(self) -> ShortTable:
        """The error states."""
        rows = [[s.name, s.unit, s.title, f"{s.prior:.3g}"] for s in self.discrete.model.states]
        return ("state", "unit", "meaning", "prior standard deviation"), rows

    def to_dict(self) -> dict[str, Any]:
        """States, options, conventions and every entry of every matrix as text."""
        model = self.discrete.model
        return {
            "format": "kfgen-derive-1",
            "kfgen": kfgen.__version__,
            "model": model.name,
            "hash": model.hash,
            "states": [{"name": s.name, "unit": s.unit, "title": s.title} for s in model.states],
            "options": dict(model.options),
            "convention": model.convention.name if model.attitude else None,
            "equation": model.convention.equation if model.attitude else None,
            "effects": [
                {"effect": e.effect.name, "channel": e.where, "as": "known" if e.known else "state"}
                for e in model.errors
            ],
            "omitted": [o._asdict() for o in model.omitted],
            "left_out": {
                p.name: {"value": p.left_out, "unit": f"{p.unit}/sqrt(Hz)"} for p in self.parts if p.left_out
            },
            "matrices": {
                letter: [[str(M[i, j]) for j in range(M.cols)] for i in range(M.rows)]
                for letter, M in self.matrices.items()
            },
        }


def derive(
    model: ModelSource, noise: NoiseSource | None = None, rate: float = 100.0, order: int = 1
) -> Derivation:
    """States, F, G, H, Phi and Qd of a filter.

    Parameters
    ----------
    model : FilterModel, str or Path
        A filter of `kfgen.build`, the name of a library model, or the path of a filter file or a model file.
    noise : NoiseModel or path-like, optional
        The effects of the channels; only beside a name or a path.
    rate : float
        Sampling rate [Hz].
    order : int
        Order in the step of the motion's coupling, 1 to 3.

    Raises
    ------
    InputError
        As in `kfgen.build`, or a rate or an order that is none.
    """
    return Derivation(DiscreteModel.at_rate(filter_of(model, noise), rate, order))
