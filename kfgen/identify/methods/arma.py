"""The equivalent ARMA model as a method: the model is estimated, its noises are solved for.

References
----------
.. [1] E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017,
   sec. 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.equivalent import Equivalent
from kfgen.arma.estimate import estimate
from kfgen.arma.process import Arma
from kfgen.core import linear
from kfgen.core.errors import InputError
from kfgen.effects import Effect, effect_named
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.estimate import Estimate
from kfgen.identify.methods.series import samples, stated

Array = NDArray[np.float64]

USUAL = ("white_noise", "gauss_markov", "rate_random_walk")
"""N, B and K: the three noises of [1]_, sec. 2.1."""
NEAR = 1e-9
"""How near to 0 or 1 the autoregression may be and still have a correlation time."""


def unit_variance(name: str, alpha: float, dt: float) -> float:
    """The variance [U^2] of the white noise inside a noise of size one, sampled every `dt` [s].

    Parameters
    ----------
    alpha : float
        ``exp(-dt / tau)`` of a Gauss-Markov process.
    """
    cls = effect_named(name)
    values = {p.name: 1.0 if p.kind == "size" else correlation_time(alpha, dt) for p in cls.searched()}
    form = cls(**values).form()
    if form.order:
        _, Qd = linear.van_loan(np.array(form.A, float), np.array(form.W, float), dt)
        return float(Qd[0, 0])
    return float(form.V) / dt + float(form.Z) / dt**2


def correlation_time(alpha: float, dt: float) -> float:
    """``tau`` [s] of ``alpha = exp(-dt / tau)``, eq. (11) of [1]_.

    Parameters
    ----------
    alpha : float
        Coefficient of the sampled process.
    dt : float
        Sampling period [s].
    """
    return float(-dt / np.log(min(max(alpha, NEAR), 1.0 - NEAR)))


@dataclass(frozen=True)
class ArmaSolution:
    """The noises behind an ARMA model.

    Parameters
    ----------
    model : Arma
        Of the samples, or of their differences.
    alpha : float
        Its autoregression: ``exp(-dt / tau)`` of a Gauss-Markov process, where it is between 0 and 1.
    variances : dict of str to float
        Of the white noise inside each noise [U^2]; a negative one is none.
    effects : tuple of Effect
        Those that are possible.
    """

    model: Arma
    alpha: float
    variances: dict[str, float]
    effects: tuple[Effect, ...]


def solve(y: Array, dt: float, names: Sequence[str], method: str = "ml") -> ArmaSolution:
    """Estimate the equivalent ARMA model of samples and solve for its noises.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U].
    dt : float
        Sampling period [s].
    names : sequence of str
        Keys of `kfgen.arma.equivalent.SOURCES`.
    method : str
        An estimator of `kfgen.arma.estimate`.

    Raises
    ------
    InputError
        The names have no such model, or the samples determine none.
    """
    equivalent = Equivalent(tuple(names))
    series = np.diff(y) if equivalent.differenced else y - y.mean()
    if equivalent.p + equivalent.q:
        model = estimate(series, equivalent.p, equivalent.q, method)
    else:
        model = Arma((), (), float(np.std(series)))
    return solved(model, equivalent, dt)


def solved(model: Arma, equivalent: Equivalent, dt: float) -> ArmaSolution:
    """The noises behind an ARMA model of the equivalent's order, eqs (15)-(16) of [1]_ with the right sign."""
    alpha = model.phi[0] if model.phi else 0.0
    e = (model.sigma * model.ma).tolist()
    e += [0.0] * (equivalent.q + 1 - len(e))
    variances = dict(zip(equivalent.names, equivalent.variances(alpha, e)))
    real = 0.0 < alpha < 1.0
    effects = []
    for name, variance in variances.items():
        timed = any(p.kind == "time" for p in effect_named(name).searched())
        if variance > 0.0 and (real or not timed):
            size = float(np.sqrt(variance / unit_variance(name, alpha, dt)))
            values = {p.name: size if p.kind == "size" else correlation_time(alpha, dt)
                      for p in effect_named(name).searched()}  # fmt: skip
            effects.append(effect_named(name)(**values))
    return ArmaSolution(model, alpha, variances, tuple(effects))


def by_arma(record: Evidence, wanted: Sequence[str] | None) -> Estimate:
    """The equivalent ARMA model of the wanted noises, N, B and K otherwise.

    A noise whose variance comes out negative, or whose correlation time is none, is left out and said so.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    """
    names = tuple(wanted or USUAL)
    y = samples(record, "arma")
    found = solve(y, record.dt, names)
    kept = [e.name for e in found.effects]
    said = []
    if any(effect_named(n).searched()[1:] for n in names) and not 0.0 < found.alpha < 1.0:
        said.append(
            f"the autoregression is {found.alpha:.4g}, which is no exp(-dt/tau): the ARMA model shows no "
            "Gauss-Markov process (its pole and a root of its moving average cancel)"
        )
    lost = [n for n in names if n not in kept]
    if lost:
        said.append(
            f"the equivalent ARMA model gives no positive variance for {', '.join(lost)}, left out; "
            "--method ml says what the log can tell of it"
        )
    if not kept:
        raise InputError(
            "the equivalent ARMA model gives no noise at all", remedy="Use --method ml, or name fewer effects"
        )
    return stated(record, found.effects, said)
