"""What noise and biases the channels of a library model have where no noise file says so."""

from __future__ import annotations

from kfgen.core.channel_names import acts_on
from kfgen.effects import Effect, make
from kfgen.effects.noise_model import NoiseModel, Term
from kfgen.model.option import Choice, Option
from kfgen.model.parts.motion import Input, MotionModel
from kfgen.model.parts.sensor import Sensor

WANDER, CONSTANT, NONE = "wander", "constant", "none"
BIASES = Option(
    "biases",
    "biases where no noise file says otherwise, as states: in random walk, or constant; or none of the inputs",
    Choice((WANDER, CONSTANT, NONE), {"true": CONSTANT, "false": NONE}),
    WANDER,
)


def with_usual_noise(
    motion: MotionModel, aiding: tuple[Sensor, ...], noise: NoiseModel | None, biases: str
) -> dict[str, tuple[Term, ...]]:
    """The terms of a noise file and, where it does not know them, the white noise and biases that sensors usually have.

    Parameters
    ----------
    motion : MotionModel
    aiding : tuple of Sensor
    noise : NoiseModel, optional
    biases : str
        `WANDER`, `CONSTANT` or `NONE`; a sensor says itself whether it has any.

    Returns
    -------
    dict of str to tuple of Term
        By channel, or by sensor where the file has them so.
    """
    known = {place: n.terms for place, n in (noise.channels if noise else {}).items()}
    out: dict[str, tuple[Term, ...]] = {}
    parts: list[Input | Sensor] = [*motion.inputs, *aiding]
    for part in parts:
        biased = part.biases if isinstance(part, Sensor) else biases != NONE
        walk = part.K if biases != CONSTANT else 0.0
        for channel in part.channels:
            own = known.get(channel, ())
            shared = (
                t for place, ts in known.items() if place != channel and acts_on(place, channel) for t in ts
            )
            effects = [t.effect for t in (*own, *shared)]
            usual = _usual(effects, getattr(part, "N", 0.0), part.bias_prior if biased else 0.0, walk)
            white = [Term(e) for e in usual if e.form().V]
            out[channel] = (*white, *own, *(Term(e) for e in usual if not e.form().V))
    every = tuple(out)
    wide = {p: ts for p, ts in known.items() if p not in out and any(acts_on(p, c) for c in every)}
    return {c: ts for c, ts in (out | wide).items() if ts}


def _usual(effects: list[Effect], N: float, bias_sd: float, K: float) -> list[Effect]:
    """What a channel has beside the effects that are known: its default noise, and a bias if `bias_sd` is not zero.

    A file that says the white noise of a channel has measured it: its bias wanders as the file says, or not at all.
    """
    systems = [e.form() for e in effects]
    measured = any(s.V for s in systems)
    moved = any(w != 0 for s in systems for row in s.W for w in row)
    out = [make("white_noise", N=N)] if N and not measured else []
    if bias_sd and not any(e.name == "bias" for e in effects):
        out.append(make("bias", sd=bias_sd))
    if bias_sd and K and not measured and not moved:
        out.append(make("rate_random_walk", K=K))
    return out
