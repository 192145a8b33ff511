"""What the two filters on the state space of Saini share: start values, and effects from B, N, K and beta."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect, effect_named, make
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.methods.asymptotes import read_asymptotes, short_white, walk_through_end

Array = NDArray[np.float64]

TERMS = ("white_noise", "gauss_markov", "rate_random_walk")
"""What the state space has, no more and no less."""
NEGLIGIBLE = 1e-6
"""Share of N below which B, or K over a correlation time, is none."""
FIRST_TAU = 0.1
"""Of the record: the correlation time at which a search begins."""


@dataclass(frozen=True)
class Parameters:
    """The parameters of eqs (18)-(20) of Hemerly 2017.

    Parameters
    ----------
    N : float
        White noise [U/sqrt(Hz)].
    B : float
        Of ``g' = -beta g + beta B w`` [U/sqrt(Hz)].
    K : float
        Random walk [U/sqrt(s)].
    beta : float
        Inverse correlation time [1/s].
    """

    N: float
    B: float
    K: float
    beta: float

    def scaled(self, factor: float) -> Parameters:
        """In a unit of the output that is smaller by `factor`."""
        return Parameters(self.N * factor, self.B * factor, self.K * factor, self.beta)

    @property
    def has_markov(self) -> bool:
        """Whether B is of any size."""
        return self.B > NEGLIGIBLE * self.N

    @property
    def has_walk(self) -> bool:
        """Whether K is of any size."""
        return self.K / self.beta > NEGLIGIBLE * self.N

    def effects(self) -> tuple[Effect, ...]:
        """The same as effects, in the order of `TERMS`; those of no size are left out."""
        tau = 1.0 / self.beta
        saini = {m.name: m for m in effect_named("gauss_markov").meanings}["B_saini"]
        made = [make("white_noise", N=self.N)]
        if self.has_markov:
            made.append(make("gauss_markov", sigma=saini.to(self.B, {"tau": tau}), tau=tau))
        if self.has_walk:
            made.append(make("rate_random_walk", K=self.K))
        return tuple(made)


def first_guess(record: Evidence, y: Array) -> Parameters:
    """N by the variance of the first samples (step 1 of sec. 3), B and K by the Allan plot as in sec. 4.

    Where the plot has no rising slope, K is what its last point allows.

    Parameters
    ----------
    record : Evidence
        What is identified.
    y : ndarray, shape (n,)
        Its samples [SI].
    """
    curve = record.curve
    seen = read_asymptotes(curve)
    tau = FIRST_TAU * record.duration
    K = seen.K.size if seen.K else walk_through_end(curve)
    unit = make("gauss_markov", sigma=1.0, tau=tau)
    sigma = float(curve.deviation.min() / np.sqrt(unit.allan_variance(curve.tau).max()))
    B = make("gauss_markov", sigma=sigma, tau=tau).under("B_saini")
    return Parameters(short_white(y, record.dt), B, K, 1.0 / tau)


def check_terms(wanted: Sequence[str] | None, method: str) -> None:
    """Raises `InputError` where other effects are wanted than the state space has.

    Parameters
    ----------
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    method : str
        Said in the error.
    """
    if wanted and set(wanted) != set(TERMS):
        raise InputError(
            f"the state space of --method {method} has exactly {', '.join(TERMS)}",
            where="--effects",
            remedy="Leave --effects out, or use --method ml",
        )
