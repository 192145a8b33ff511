"""States and effects that a model has too much of, seen before any measurement: they cost time and tell nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from kfgen.effects.process.stochastic import GaussMarkov
from kfgen.model.filter import FilterModel

TAU_TOLERANCE_FRACTION = 1e-9
"""Relative difference of time constants that are equal."""


def lint(
    model: FilterModel, duration: float | None = None, unobservable: Sequence[frozenset[str]] = ()
) -> tuple[str, ...]:
    """Warnings in words.

    Parameters
    ----------
    model : FilterModel
    duration : float, optional
        Of the record [s].
    unobservable : sequence of set of str
        The states of each direction that is unobservable along the richest manoeuvre.
    """
    return tuple(
        dict.fromkeys(
            [
                *_equal_times(model),
                *_slow(model, duration),
                *_idle(model, unobservable),
                *_redundant(model, unobservable),
            ]
        )
    )


def _equal_times(model: FilterModel) -> Iterator[str]:
    for channel, effects in model.noise.items():
        found = [e for e in effects if isinstance(e, GaussMarkov)]
        for k, a in enumerate(found):
            for b in found[k + 1 :]:
                if abs(float(a.tau) - float(b.tau)) <= TAU_TOLERANCE_FRACTION * float(a.tau):
                    sigma = float(np.hypot(float(a.sigma), float(b.sigma)))
                    yield (
                        f"{channel} has two Gauss-Markov effects of the same tau = {float(a.tau):g} s: only their sum shows. "
                        f"Make them one, of sigma = {sigma:.4g}"
                    )


def _slow(model: FilterModel, duration: float | None) -> Iterator[str]:
    if duration is None:
        return
    for channel, effects in model.noise.items():
        for e in effects:
            if isinstance(e, GaussMarkov) and float(e.tau) > 3.0 * duration:
                K = float(e.sigma) * float(np.sqrt(2.0 / float(e.tau)))
                yield (
                    f"{channel} has a Gauss-Markov effect of tau = {float(e.tau):g} s, slower than the {duration:g} s looked at: "
                    f"that is a random walk of K = {K:.3g} from an unknown start"
                )


def _idle(model: FilterModel, unobservable: Sequence[frozenset[str]]) -> Iterator[str]:
    """States without noise and without information: a constant that nothing shows."""
    alone = {next(iter(names)) for names in unobservable if len(names) == 1}
    driven = {s.name for s, g in zip(model.states, model.F.tolist()) if any(e != 0 for e in g)}
    noisy = {
        s.name
        for k, s in enumerate(model.states)
        if any(model.G[k, j] * model.W[j, j] != 0 for j in range(model.G.cols))
    }
    for s in model.states:
        if s.name in alone and s.name not in noisy | driven:
            yield f"{s.name} has no noise and no measurement shows it: leave it out, or the filter carries it for nothing"


def _redundant(model: FilterModel, unobservable: Sequence[frozenset[str]]) -> Iterator[str]:
    """Constants of the model that stay unobservable together, whatever is flown."""
    constants = {
        s.name
        for k, s in enumerate(model.states)
        if all(e == 0 for e in model.F.row(k)) and all(e == 0 for e in model.G.row(k))
    }
    tied = [names for names in unobservable if len(names) > 1 and names & constants]
    if not tied:
        return
    involved = set().union(*tied)
    matrices = _full_matrices(model, involved)
    advice = [f"make {m} triangular (take {', '.join(_below(model, m)[: len(tied)])} out)" for m in matrices]
    listed = ", ".join(sorted(involved & constants))
    yield (
        f"{len(tied)} redundant among {listed}: no motion distinguishes them. "
        + (advice[0].capitalize() if advice else "Fix as many of them as are redundant, or give them priors")
    )


def _full_matrices(model: FilterModel, involved: set[str]) -> list[str]:
    """Stems of full 3 x 3 matrices of states among those involved, accelerometers' first."""
    stems: dict[str, set[str]] = {}
    for s in model.states:
        stem, _, entry = s.name.rpartition("_")
        if len(entry) == 2 and set(entry) <= set("xyz"):
            stems.setdefault(stem, set()).add(s.name)
    full = [m for m, names in stems.items() if len(names) >= 6 and names & involved]
    return sorted(full, key=lambda m: ("a" not in m, m))


def _below(model: FilterModel, stem: str) -> list[str]:
    names = {s.name for s in model.states}
    return [n for n in (f"{stem}_{e}" for e in ("yx", "zx", "zy")) if n in names]
