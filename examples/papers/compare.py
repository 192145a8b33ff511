"""All methods at the point of sec. 2.2 of Hemerly 2017, against the Cramér-Rao bound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.bounds import fisher
from kfgen.identify.identify import identify
from kfgen.identify.methods.asymptotes import read_asymptotes
from kfgen.identify.methods.saini import TERMS
from kfgen.report.page import columns
from papers.hemerly import POINT, SAMPLES, T, record

Array = NDArray[np.float64]

NAMES = ("N", "B", "K", "beta")
METHODS = ("arma", "ekf", "em", "asymptotes", "allan", "gmwm", "ml")


@dataclass(frozen=True)
class Score:
    """A method's errors.

    Parameters
    ----------
    given : dict of str to int
        In how many records it gives the parameter.
    error : dict of str to float
        Root mean square of the logarithm of its ratio to the truth, over those.
    median : dict of str to float
        Median ratio.
    """

    given: dict[str, int]
    error: dict[str, float]
    median: dict[str, float]


def estimates(y: Array, method: str) -> dict[str, float]:
    """What a method says of samples; B as of eq. (18)."""
    data = Record(np.asarray(np.arange(y.size) * T, dtype=np.float64), y)
    if method == "asymptotes":
        seen = read_asymptotes(data.curve)
        found = {"N": seen.N, "B": seen.B, "K": seen.K}
        return {k: v.size for k, v in found.items() if v is not None}
    try:
        fit = identify(data, TERMS if method in ("ml", "allan", "gmwm") else None, method).fit
    except InputError:
        return {}
    return {k: v for e in fit.effects for k, v in _called(e).items()}


def _called(effect: Effect) -> dict[str, float]:
    if effect.name == "gauss_markov":
        return {"B": effect.under("B_saini"), "beta": effect.under("beta")}
    return {p.name: float(getattr(effect, p.name)) for p in effect.searched()}


def compare(seeds: int) -> dict[str, Score]:
    """Every method over records of the same seeds."""
    found: dict[str, list[dict[str, float]]] = {m: [] for m in METHODS}
    for seed in range(seeds):
        y = record(POINT.effects(), seed)
        for method in METHODS:
            found[method].append(estimates(y, method))
    return {m: _score(rows) for m, rows in found.items()}


def _score(rows: list[dict[str, float]]) -> Score:
    given, error, median = {}, {}, {}
    for name in NAMES:
        logs = np.log([r[name] / getattr(POINT, name) for r in rows if r.get(name, 0.0) > 0.0])
        given[name] = int(logs.size)
        error[name] = float(np.sqrt(np.mean(logs**2))) if logs.size else np.nan
        median[name] = float(np.exp(np.median(logs))) if logs.size else np.nan
    return Score(given, error, median)


def bound() -> dict[str, float]:
    """The bound of the logarithm of each parameter, ``ln B = ln sigma + ln(2 tau) / 2``."""
    keys, J = fisher(POINT.effects(), T, SAMPLES)
    scale = np.sqrt(np.diag(J))
    C = np.linalg.inv(J / np.outer(scale, scale)) / np.outer(scale, scale)
    names = [name for _, name in keys]
    slopes = {"N": {"N": 1.0}, "B": {"sigma": 1.0, "tau": 0.5}, "K": {"K": 1.0}, "beta": {"tau": 1.0}}
    rows = {k: np.array([of.get(n, 0.0) for n in names]) for k, of in slopes.items()}
    return {k: float(np.sqrt(v @ C @ v)) for k, v in rows.items()}


def table(scores: dict[str, Score], seeds: int) -> str:
    """The comparison as text."""
    least = bound()
    rows = [["method", *(f"{n}: RMS ln (/ bound), median ratio, given" for n in NAMES)]]
    rows.append(["Cramér-Rao bound", *(f"{least[n]:.3g}" for n in NAMES)])
    for method, s in scores.items():
        cells = [
            f"{s.error[n]:.3g} ({s.error[n] / least[n]:.2g}), {s.median[n]:.3g}, {s.given[n]}/{seeds}"
            if s.given[n] else f"none, 0/{seeds}"
            for n in NAMES
        ]  # fmt: skip
        rows.append([method, *cells])
    return columns(rows)
