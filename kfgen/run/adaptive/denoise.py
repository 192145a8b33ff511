"""Denoising of a channel: its series tested, its ARMA process estimated, its filter run, and the price of it.

References
----------
.. [1] M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models, 2019.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.estimate import estimate
from kfgen.arma.process import Arma
from kfgen.arma.series import (
    MAX_ORDER_SAMPLES,
    Correlations,
    Order,
    SeriesTests,
    correlations,
    orders,
    series_tests,
)
from kfgen.core.errors import InputError
from kfgen.run import words
from kfgen.run.adaptive.cost import FilterCost, Noise, cost_of, noise_of
from kfgen.run.adaptive.loop import RATIO, WINDOW, Filtered, ScalarModel, run_filter
from kfgen.run.adaptive.rules import rule_named

Array = NDArray[np.float64]

ORDER = (2, 1)
"""Of the process, as in sec. 6 of [1]_."""


@dataclass(frozen=True)
class Settings:
    """What is asked for.

    Parameters
    ----------
    filter : str
        A key of `kfgen.run.adaptive.rules.rules`.
    order : tuple of int, optional
        ``(p, q)`` of the process; by Akaike's criterion where left out.
    estimator : str
        A key of `kfgen.arma.estimate.estimators`.
    window : int
        Innovations of which the mean square is taken.
    ratio : float
        R over Q.
    """

    filter: str = "shafkf-r"
    order: tuple[int, int] | None = ORDER
    estimator: str = "ml"
    window: int = WINDOW
    ratio: float = RATIO


@dataclass(frozen=True)
class RestStatistics:
    """What a channel is at rest.

    Parameters
    ----------
    level : float
        Its mean [U].
    process : Arma
        Of what is left.
    tests : SeriesTests
    correlations : Correlations
    orders : tuple of Order
        What was tried, the best first, where the order was left out.
    warnings : tuple of str
    """

    level: float
    process: Arma
    tests: SeriesTests
    correlations: Correlations
    orders: tuple[Order, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Denoised:
    """A filtered channel.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Filtered samples [U], its mean at rest put back.
    rest : RestStatistics
        The channel at rest.
    model : ScalarModel
        What is filtered with.
    filtered : Filtered
        Estimate, gain and innovations.
    before, after : Noise
        Read off the Allan deviation.
    cost : FilterCost
        What becomes of a true rate.
    """

    values: Array
    rest: RestStatistics
    model: ScalarModel
    filtered: Filtered
    before: Noise
    after: Noise
    cost: FilterCost

    def to_dict(self, unit: str) -> dict[str, Any]:
        """The numbers of the JSON, for a channel in `unit` (SI)."""
        c, used, tests = self.cost, self.filtered.nis > 0.0, self.rest.tests
        process = self.rest.process
        return {
            "unit": unit,
            "process": {"phi": process.phi, "theta": process.theta, "sigma": process.sigma},
            "level": self.rest.level,
            "before": {"N": self.before.N, "B": self.before.B, "drift": self.before.drift},
            "after": {"N": self.after.N, "B": self.after.B, "drift": self.after.drift},
            "cost": {
                "dc": c.dc,
                "dc_hidden": c.hidden,
                "delay_s": c.delay,
                "bandwidth_hz": c.bandwidth,
                "attenuation": c.attenuation,
                "sentence": c.words,
            },
            "mean_nis": float(np.mean(self.filtered.nis[used])) if used.any() else None,
            "tests": {v.name: {"p": v.p, "rejected": v.rejected} for v in tests.verdicts},
            "aic": {f"{o.model.order[0]},{o.model.order[1]}": o.aic for o in self.rest.orders},
            "skewness": tests.skewness,
            "kurtosis": tests.kurtosis,
        }


def at_rest(y: Array, settings: Settings) -> RestStatistics:
    """Test a channel at rest and estimate its process.

    A trend or changing power is said, and the process is estimated after a straight line is removed.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U]; those that are no numbers are left out.
    settings : Settings
        Order and estimator of the process.

    Returns
    -------
    RestStatistics

    Raises
    ------
    InputError
        The channel wanders or moves, so that no stationary process describes it, or it is too short or constant.
    """
    known = y[np.isfinite(y)]
    level = float(known.mean()) if known.size else 0.0
    series, said = known - level, []
    tests = series_tests(series)
    if tests.unit_root:
        raise InputError(
            f"the channel is not stationary: a unit root is not rejected (p = {tests.named('unit root').p:.2g}), "
            "so no ARMA process describes it",
            remedy="Give a log at rest with --at-rest, or cut this one",
        )
    if not tests.stationary:
        k = np.arange(series.size)
        series = series - np.polyval(np.polyfit(k, series, 1), k)
        said.append(words.STRAIGHT_LINE_REMOVED)
    if not tests.named("Ljung-Box").rejected:
        said.append(words.NOT_CORRELATED)
    series = series[:MAX_ORDER_SAMPLES]
    tried: tuple[Order, ...] = ()
    if settings.order is None:
        tried = tuple(orders(series, method=settings.estimator))
        process = tried[0].model
    elif settings.order == (0, 0):
        raise InputError("an order of 0,0 is none", remedy="Give --order 2,1")
    else:
        process = estimate(series, *settings.order, settings.estimator)
    return RestStatistics(level, process, tests, correlations(series), tried, tuple(said))


def denoise_samples(y: Array, dt: float, settings: Settings, rest: RestStatistics | None = None) -> Denoised:
    """Filter the samples of a channel.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U]; where one is no number the filter predicts.
    dt : float
        Sampling period [s].
    settings : Settings
    rest : RestStatistics, optional
        The channel at rest; of these samples where left out.

    Returns
    -------
    Denoised

    Raises
    ------
    InputError
        See `at_rest` and `kfgen.run.adaptive.loop.run_filter`.
    """
    rule = rule_named(settings.filter)
    rest = rest or at_rest(y, settings)
    model = ScalarModel.of(rest.process, settings.ratio)
    z = y - rest.level
    found = run_filter(z, model, rule, settings.window)
    whole = np.where(np.isfinite(z), z, found.estimate)
    again = found if np.isfinite(z).all() else run_filter(whole, model, rule, settings.window)
    return Denoised(
        found.estimate + rest.level,
        rest,
        model,
        found,
        noise_of(whole, dt),
        noise_of(found.estimate, dt),
        cost_of(whole, dt, model, rule, settings.window, again),
    )
