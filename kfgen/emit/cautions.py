"""What a user of emitted code should know of the choices that it was emitted with: a sentence each, with its remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kfgen.emit.covariance.forms import Packed
from kfgen.emit.horizon.memory import MARGIN
from kfgen.model.known_delays import known_delays
from kfgen.model.parts.earth_fixed import EarthFixed
from kfgen.model.parts.usual_noise import BIASES

if TYPE_CHECKING:
    from kfgen.emit.routines import Program


def cautions(program: Program) -> tuple[str, ...]:
    """Choices that are less than what there is, a sentence each; none where there is nothing to say.

    Parameters
    ----------
    program : Program
    """
    return (*_covariance(program), *_delays(program), *_positions(program), *_constants(program))


def _covariance(program: Program) -> list[str]:
    if program.form != Packed.NAME or program.real != "float":
        return []
    return [
        "The covariance itself in single precision is rounded until it is no longer positive, within minutes where "
        "process noise is small: emit with --form ud, or with --real double."
    ]


def _delays(program: Program) -> list[str]:
    model, said = program.discrete.model, list[str]()
    for sensor in model.sensors:
        delay = sum(known_delays(model, sensor).values())
        if delay <= program.horizon:
            continue
        how = (
            f"{sensor.name} is {delay:.3g} s late, beyond the horizon of {program.horizon:.3g} s"
            if program.horizon
            else f"{sensor.name} is {delay:.3g} s late and is fused at its arrival, its delay to first order of the motion"
        )
        said.append(
            f"{how}: in a manoeuvre the errors are larger than the covariance says: emit with --horizon {MARGIN * delay:.3g}, "
            "which fuses each sample at its own time."
        )
    return said


def _positions(program: Program) -> list[str]:
    if program.real != "float" or not isinstance(program.discrete.model.motion, EarthFixed):
        return []
    return [
        "A position in Earth axes in single precision has steps of half a metre: emit with --real double, or take local "
        "axes, whose header for latitude and longitude moves the origin along."
    ]


def _constants(program: Program) -> list[str]:
    A, W = (np.array(M.tolist(), dtype=object) for M in program.discrete.model.effect_dynamics)
    states = program.discrete.model.states[len(program.discrete.model.states) - len(A) :]
    still = [s.name for k, s in enumerate(states) if W[k, k] == 0 and not any(A[k])]
    if not still:
        return []
    asked = program.discrete.model.options.get(BIASES.name)
    remedy = (
        f"without --set {BIASES.name}={asked}"
        if asked
        else "with --noise, of a file with a random walk (K) or a Gauss-Markov process for them"
    )
    return [
        f"{', '.join(still)} are constants without process noise: after hours the filter no longer follows a bias that "
        f"wanders: emit {remedy}."
    ]
