"""`ProcessNoise`: white noise that drives a state of a plant, which no two runs have in common.

References
----------
.. [1] A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970, sec. 4.9.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from kfgen.effects.effect import parameter
from kfgen.effects.plant.terms import PlantEffect


@dataclass(frozen=True)
class ProcessNoise(PlantEffect):
    """White noise added to the derivative of a state, ``dx/dt = f + w`` [1]_: gusts, a rough road, turbulence, chatter.

    A filter has it as the driving noise of this state, and its ``Qd`` with it.
    """

    N: Any = parameter("U/sqrt(Hz)", "size")

    acts: ClassVar[str] = "state"
    prior_penalty_nats: ClassVar[float] = 10.0
    """It takes up some of whatever a model lacks: of a spring of 34 nats that was missed it took 9."""
    name: ClassVar[str] = "process_noise"
    title: ClassVar[str] = "process noise of a state"
    separating_experiment: ClassVar[str] = (
        "the same run twice: what repeats is an error of the model, the rest is process noise"
    )
    sentence_template: ClassVar[str] = "is driven by white noise of {N}"


def root_density(effects: Sequence[PlantEffect]) -> float:
    """Root density of the process noises among the effects of a state, which are independent [SI/sqrt(Hz)]."""
    return math.sqrt(sum(float(e.N) ** 2 for e in effects if isinstance(e, ProcessNoise)))
