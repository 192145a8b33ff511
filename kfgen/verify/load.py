"""What a whole filter asks of a processor: its calls in a second, and the instructions that they take."""

from __future__ import annotations

import math
from collections.abc import Mapping

from kfgen.core.errors import InputError
from kfgen.emit.routines import Program
from kfgen.verify.core import CoreVerdict

NOISY = "predict with the noise of a bias"
"""Predictions in which noise comes in that has waited: the dearest ones."""


def calls_a_second(program: Program, rates: Mapping[str, float]) -> dict[str, float]:
    """How often each routine of a filter is called, by name.

    Parameters
    ----------
    program : Program
        Its prediction runs at the rate that it was emitted for.
    rates : mapping of str to float
        Of sensors by name [Hz]; where one is left out, that of its noise, else the usual one of such sensors.

    Raises
    ------
    InputError
        A sensor that there is not, or no rate.
    """
    discrete = program.discrete
    known = [s.name for s in discrete.model.sensors]
    for name, rate in rates.items():
        if name not in known:
            raise InputError(
                f"{discrete.model.name} has no sensor '{name}'",
                where="--sensor-rate",
                remedy=f"It has {', '.join(known)}" if known else "Leave it out",
            )
        if not 0.0 < rate < math.inf:
            raise InputError(
                f"the rate of {name} must be positive, not {rate:g} Hz",
                where="--sensor-rate",
                remedy=f"Write it like --sensor-rate {name}=10",
            )
    usual = {
        s.name: discrete.rates.get(s.name, s.usual_rate or discrete.rate) for s in discrete.model.sensors
    }
    noisy = min(len(program.slow) / program.noise_waits, discrete.rate) if program.slow else 0.0
    predictions = {"predict": discrete.rate - noisy} | ({NOISY: noisy} if noisy else {})
    return predictions | {f"update_{n}": r for n, r in (usual | dict(rates)).items()}


def load_sentence(verdict: CoreVerdict, calls: Mapping[str, float]) -> str:
    """Instructions of a second on a core that counts them; empty for others.

    Parameters
    ----------
    verdict : CoreVerdict
    calls : mapping of str to float
        As `calls_a_second` has them.
    """
    total = instructions_a_second(verdict, calls)
    if total is None:
        return ""
    called = ", ".join(f"{rate:g} {name}" for name, rate in calls.items())
    return (
        f"a second of {called} takes {total:.0f} instructions on {verdict.core}: {total / 1e6:.3g} MHz at one "
        "instruction a cycle"
    )


def instructions_a_second(verdict: CoreVerdict, calls: Mapping[str, float]) -> float | None:
    """The most that a second takes, by the most that each routine took; None of a core that does not count.

    Where noise of biases waits, a prediction in which none comes in takes the least of those counted.

    Parameters
    ----------
    verdict : CoreVerdict
    calls : mapping of str to float
        As `calls_a_second` has them.
    """
    counted = dict(verdict.cost.instructions)
    if NOISY in calls and "predict" in counted:
        counted |= {NOISY: counted["predict"], "predict": verdict.cost.least["predict"]}
    if not calls or not set(calls) <= set(counted):
        return None
    return sum(rate * counted[name] for name, rate in calls.items())
