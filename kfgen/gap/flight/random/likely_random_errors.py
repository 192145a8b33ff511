"""Random errors of channels that a flight asks for: random walks and Gauss-Markov processes.

All channels and correlation times are looked at by the same backward pass: were a random error of a channel there, the products of
the innovations with what unit errors at single times do to them would be larger than by chance [1]_. How large they are by
chance, of white innovations through the same pass, is known beforehand. The promising ones become states of the filter, and
their sizes and times are those with which its innovations are most likely.

References
----------
.. [1] P. de Jong and J. Penzer, Diagnosing shocks in time series, J. Amer. Statist. Assoc. 93(442), 1998.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, make
from kfgen.effects.series import OF_A_COEFFICIENT
from kfgen.gap.flight.linear.linear_flight import LinearFlight
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.random.random_error import random_error_of
from kfgen.gap.scene.evidence import parameter_width
from kfgen.gap.scene.random_error import FittedRandomError
from kfgen.gap.scene.scene import Placed, Scene

Array = NDArray[np.float64]

CORRELATION_TIMES_S = (1.0, 4.0, 15.0, 60.0)
"""Of the Gauss-Markov processes that are looked at first."""
CHANCE_DRAWS = 24
"""Series of white innovations by which is seen what chance does."""
MIN_SCREEN_NATS = 4.0
"""Expected gain below which nothing is fitted."""
FITTED_CHANNELS = 2
"""Channels of which every kind is fitted, the best of the screen."""
FIT_STEPS = 24
"""Evaluations of the likelihood of one fit."""
CURVATURE_STEP = 0.2
"""Of a logarithm, by which the likelihood is differentiated twice."""
SIZE_WIDTH = 0.5 * OF_A_COEFFICIENT
"""Width of the prior of the logarithm of a size: that of a coefficient of one sign, for a walk competes with a ramp."""
MAX_SD_OF_LOG = 2.0
"""Of a parameter of which the flight says little."""


def likely_random_errors(
    path: FlownPath, scene: Scene, channels: Sequence[str], residual: Array, known: Array
) -> list[FittedRandomError]:
    """Random errors that are worth a look, fitted, by evidence.

    Parameters
    ----------
    path : FlownPath
        Smoothed with what was found subtracted.
    scene : Scene
        Of that path: what its parameters may be.
    channels : sequence of str
        Inputs and channels of aiding sensors.
    residual : ndarray, shape (rows,)
        Normalised innovations in the order of time, less what is fitted anyway.
    known : ndarray, shape (rows, k)
        Orthonormal directions of the innovations that are fitted anyway.
    """
    starts = _screened(path, channels, residual, known)
    found = [_fitted(path.linear, path.log.dt, scene, s) for s in starts]
    choice = float(np.log(2 * len(channels) + 1))
    costs = [choice + f.placed.effect.rarer_by_nats() for f in found]
    found = [replace(f, evidence=f.evidence - c, occam=f.occam - c) for f, c in zip(found, costs)]
    return sorted(found, key=lambda f: -f.evidence)


def _units() -> list[Effect]:
    """The random errors that are looked at first, of size one."""
    times = CORRELATION_TIMES_S
    return [make("rate_random_walk", K=1.0), *(make("gauss_markov", sigma=1.0, tau=tau) for tau in times)]


def _screened(path: FlownPath, channels: Sequence[str], residual: Array, known: Array) -> list[Placed]:
    """Of the most promising channels every kind, with a size and a time to start from."""
    rng = np.random.default_rng(0)
    chance = rng.standard_normal((residual.size, CHANCE_DRAWS))
    chance -= known @ (known.T @ chance)
    seen, *drawn = [_energies(path, channels, s) for s in (residual, *chance.T)]
    more, variance = seen - np.mean(drawn, axis=0), np.maximum(np.var(drawn, axis=0), 1e-300)
    gain = np.where(more > 0.0, 0.5 * more**2 / variance, 0.0)
    promising = [i for i in np.argsort(-gain.max(axis=1)).tolist() if gain[i].max() > MIN_SCREEN_NATS]
    best: dict[tuple[str, str], Placed] = {}
    for i in promising[:FITTED_CHANNELS]:
        for k in np.argsort(gain[i]).tolist():  # the last of a kind stays
            if more[i, k] > 0.0:
                unit, size = _units()[k], float(np.sqrt(2.0 * more[i, k] / variance[i, k]))
                best[unit.name, channels[i]] = Placed(_sized(unit, size), channels[i])
    return list(best.values())


def _sized(unit: Effect, size: float) -> Effect:
    name = next(p.name for p in unit.parameters() if p.kind == "size")
    return replace(unit, **{name: size})


def _energies(path: FlownPath, channels: Sequence[str], series: Array) -> Array:
    """Squared products with a series, weighed by where each random error is driven, shape (channels, units)."""
    from scipy.signal import lfilter

    of_inputs, of_readings = path.linear.products(series)
    g = np.zeros((len(channels), path.log.t.size))
    for i, channel in enumerate(channels):
        if channel in path.equations.channels:
            g[i] = of_inputs[:, path.equations.channels.index(channel)]
        else:
            at = path.rows.of(channel)
            np.add.at(g[i], path.rows.at[at], of_readings[at])
    out = []
    for unit in _units():
        w = random_error_of(Placed(unit, ""), path.log.dt)
        r = lfilter([1.0], [1.0, -w.Phi[0, 0]], g[:, ::-1], axis=1)
        out.append(w.Qd[0, 0] * np.sum(r**2, axis=1) + w.P0[0, 0] * r[:, -1] ** 2)
    return np.column_stack(out)


def _fitted(linear: LinearFlight, dt: float, scene: Scene, start: Placed) -> FittedRandomError:
    """A random error with its most likely size and time."""
    from scipy.optimize import minimize

    names = [p.name for p in start.effect.parameters()]
    bare = linear.log_likelihood

    def there(x: Array) -> Placed:
        values = dict(zip(names, np.exp(x).tolist()))
        return replace(start, effect=replace(start.effect, **values))

    def gain(x: Array) -> float:
        value = linear.with_random_error(random_error_of(there(x), dt)).filtered().log_likelihood
        return value - bare if np.isfinite(value) else -1e9

    x0 = np.log([float(getattr(start.effect, n)) for n in names])
    simplex = np.vstack([x0, x0 + 0.7 * np.eye(x0.size)])
    limits = {"maxfev": FIT_STEPS, "initial_simplex": simplex, "xatol": 0.03, "fatol": 0.03}
    x = np.asarray(minimize(lambda x: -gain(x), x0, method="Nelder-Mead", options=limits).x)
    value, sd, volume = _curvature(gain, x)
    sizes = start.effect.sizes()
    widths = [SIZE_WIDTH if n in sizes else parameter_width(scene, start.effect, n) for n in names]
    evidence = value + volume - float(np.sum(np.log(widths)))
    ci95 = {n: (float(np.exp(v - 1.96 * s)), float(np.exp(v + 1.96 * s))) for n, v, s in zip(names, x, sd)}
    return FittedRandomError(there(x), ci95, evidence, evidence - value)


def _curvature(gain: Callable[[Array], float], x: Array) -> tuple[float, Array, float]:
    """Value at a maximum, standard deviations there, shape (k,), and the logarithm of the volume beneath it."""
    steps = CURVATURE_STEP * np.eye(x.size)
    top = gain(x)
    H = np.empty((x.size, x.size))
    for i, a in enumerate(steps):
        H[i, i] = 2.0 * top - gain(x + a) - gain(x - a)
        for j, b in enumerate(steps[:i]):
            H[i, j] = H[j, i] = 0.25 * (gain(x + a - b) + gain(x - a + b) - gain(x + a + b) - gain(x - a - b))
    values, vectors = np.linalg.eigh(H / CURVATURE_STEP**2)
    values = np.maximum(values, MAX_SD_OF_LOG**-2)
    volume = 0.5 * x.size * float(np.log(2.0 * np.pi)) - 0.5 * float(np.log(values).sum())
    return top, np.sqrt(np.diag((vectors / values) @ vectors.T)), volume
