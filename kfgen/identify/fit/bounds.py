"""The Cramér-Rao bound of the parameters of a noise model, and the record that reaches one.

Whittle's Fisher information of the differenced samples over a record of n of them,
``J_ab = 1/2 sum_j (d ln S_j / d a) (d ln S_j / d b)`` at ``omega_j = pi j / (n + 1)``, in logarithms of
the parameters, so that a bound is a relative error.

References
----------
.. [1] P. Whittle, 1953; M. B. Priestley, Spectral Analysis and Time Series, 1981, sec. 6.1.5.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.identify.evidence.peaks import SpectralPeak, spectral_peaks, split_edges
from kfgen.identify.evidence.shapes import Key
from kfgen.identify.evidence.whittle import density_of_differences

Array = NDArray[np.float64]

Bands = Sequence[tuple[float, float]]

MIN_SHARE_OF_INFORMATION = 1e-13
"""Share of information below which a direction has none."""


def fisher(
    effects: Sequence[Effect], dt: float, *lengths: int, skip: Bands = ()
) -> tuple[tuple[Key, ...], Array]:
    """Fisher information of the logarithms of the parameters of the random effects.

    Parameters
    ----------
    effects : sequence of Effect
    dt : float
        Sampling period [s].
    lengths : int
        Samples of each record of the sensor.
    skip : sequence of (lo, hi)
        Bands [Hz] that are not looked at.

    Returns
    -------
    keys : tuple of Key
    J : ndarray, shape (k, k)
    """
    omega, weight = nominal(lengths, dt, skip, spectral_peaks(effects))
    keys = tuple((i, p.name) for i, e in enumerate(effects) if not e.coefficients() for p in e.estimated())

    def log_density(key: Key, shift: float) -> Array:
        moved = [e.shifted(key[1], shift) if i == key[0] else e for i, e in enumerate(effects)]
        return np.log(density_of_differences(moved, omega, dt, 1))

    if not keys:
        return keys, np.zeros((0, 0))
    h = 1e-4
    slopes = np.array([(log_density(k, h) - log_density(k, -h)) / (2 * h) for k in keys])
    return keys, 0.5 * (slopes * weight) @ slopes.T


def nominal(
    lengths: Sequence[int], dt: float, skip: Bands = (), peaks: Sequence[SpectralPeak] = ()
) -> tuple[Array, Array]:
    """Ordinates of records, by bins.

    Parameters
    ----------
    lengths : sequence of int
        Samples of each record.
    dt : float
        Sampling period [s].
    skip : sequence of (lo, hi)
        Bands [Hz] that are not looked at.
    peaks : sequence of SpectralPeak
        About which bins are finer.

    Returns
    -------
    omega : ndarray, shape (m,)
        Angular frequencies [rad per sample].
    count : ndarray, shape (m,)
        How many ordinates each stands for.
    """
    parts = [_grid(n, dt, skip, peaks) for n in lengths]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _grid(n: int, dt: float, skip: Bands, peaks: Sequence[SpectralPeak]) -> tuple[Array, Array]:
    edges = np.unique(np.concatenate([np.arange(min(n, 65)), np.geomspace(64, n, 400)]).round())
    edges = split_edges(edges[edges <= n].astype(np.int64), peaks, dt, n)
    weight = np.diff(edges)
    for lo, hi in skip:
        band = np.minimum(np.array([lo, hi]) * (2.0 * dt * (n + 1)), n)  # as numbers of ordinates
        weight = weight - np.diff(np.clip(edges, *band))
    omega = np.asarray(0.5 * (edges[1:] + edges[:-1] + 1.0) * (np.pi / (n + 1)), dtype=np.float64)
    return omega, np.asarray(np.maximum(weight, 0.0), dtype=np.float64)


def relative_bound(effects: Sequence[Effect], dt: float, *lengths: int, skip: Bands = ()) -> dict[Key, float]:
    """The smallest relative standard deviation that an unbiased estimate of each parameter can have.

    Parameters
    ----------
    effects : sequence of Effect
        With their values [SI].
    dt : float
        Sampling period [s].
    lengths : int
        Samples of each record of the sensor.
    skip : sequence of (lo, hi)
        Bands [Hz] that are not looked at.

    Returns
    -------
    dict
        Relative standard deviation by parameter; infinite where nothing is known.
    """
    keys, J = fisher(effects, dt, *lengths, skip=skip)
    scale = np.sqrt(np.diag(J))
    if not (scale > 0.0).all():
        return {key: float("inf") if not s > 0.0 else _alone(s) for key, s in zip(keys, scale.tolist())}
    values, vectors = np.linalg.eigh(J / np.outer(scale, scale))
    # A direction without information: no parameter in it can be known.
    inverse = np.where(
        values > MIN_SHARE_OF_INFORMATION, 1.0 / np.maximum(values, MIN_SHARE_OF_INFORMATION), np.inf
    )
    with np.errstate(invalid="ignore"):
        variance = np.nansum(
            np.where(vectors**2 > MIN_SHARE_OF_INFORMATION, vectors**2 * inverse, 0.0), axis=1
        )
    return dict(zip(keys, (np.sqrt(variance) / scale).tolist()))


def _alone(scale: float) -> float:
    """The bound of a parameter that nothing else can be mixed up with."""
    return 1.0 / scale


def seconds_for(
    effects: Sequence[Effect], dt: float, key: Key, wanted: float = 0.2, skip: Bands = ()
) -> float:
    """The length of record [s] at which the bound of one parameter is `wanted` (infinite if beyond).

    Parameters
    ----------
    effects : sequence of Effect
        With their values [SI].
    dt : float
        Sampling period [s].
    key : Key
        Index of the effect, name of its parameter.
    wanted : float
        Relative standard deviation.
    skip : sequence of (lo, hi)
        Bands [Hz] that are not looked at.
    """
    lo, hi = 3.0, 15.0

    def bound(exponent: float) -> float:
        return relative_bound(effects, dt, int(10.0**exponent), skip=skip)[key]

    if bound(hi) > wanted:
        return float("inf")
    while hi - lo > 0.01:
        middle = 0.5 * (lo + hi)
        lo, hi = (lo, middle) if bound(middle) < wanted else (middle, hi)
    return float(10.0**hi * dt)
