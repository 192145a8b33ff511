"""How a filter adapts: each rule is one small class over one algorithm.

A rule sees traces only: the squared innovation, its mean over a window, what the filter predicts of it (``H P H'``),
and the nominal noise R. It answers by factors on P, R and Q, so that covariances stay symmetric; they are bounded, so
that they stay positive definite. The same numbers adapt a filter of one channel (`kfgen.run.adaptive.loop`, compiled)
and an emitted one (`kfgen.run.adaptive.wrapper`).

To add a rule, write a subclass of `Rule`; `rules` finds it.

References
----------
.. [1] M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models, 2019, secs 4-5. The printed
   equations are followed as far as their text; factors are those of its references [3]_ and [4]_.
.. [2] A. H. Mohamed and K. P. Schwarz, Adaptive Kalman filtering for INS/GPS, J. Geodesy 73(4), 1999.
.. [3] Y. Yang and T. Xu, An adaptive Kalman filter based on Sage windowing weights and variance components,
   J. Navigation 56(2), 2003.
.. [4] Y. Yang and W. Gao, Comparison of adaptive factors in Kalman filters on navigation results, J. Navigation
   58(3), 2005.
.. [5] A. P. Sage and G. W. Husa, Adaptive filtering with unknown prior statistics, Proc. JACC, 1969.
"""

from __future__ import annotations

from functools import cache
from typing import ClassVar, NamedTuple

from kfgen.core.errors import InputError


class Seen(NamedTuple):
    """What a rule sees at a sample.

    Parameters
    ----------
    updates : float
        So many before this one.
    now : float
        The squared innovation.
    mean : float
        Its mean over the window, this one included.
    predicted : float
        Trace of ``H P H'`` before the update.
    noise : float
        Trace of the nominal R.
    chance : float
        What the mean may reach by chance (95 %), in units of its expectation.
    """

    updates: float
    now: float
    mean: float
    predicted: float
    noise: float
    chance: float


class Factors(NamedTuple):
    """What a rule answers.

    Parameters
    ----------
    fade : float
        On the predicted P.
    r : float
        On R, kept for the next sample.
    once : float
        On R, at this sample only.
    q : float
        On Q, kept.
    """

    fade: float
    r: float
    once: float
    q: float


class Bounds(NamedTuple):
    """The box of the factors."""

    least_r: float = 1e-4
    most_r: float = 1e6
    most_fade: float = 1e3
    least_q: float = 1e-4
    most_q: float = 1e6


class Rule:
    """A rule.

    Attributes
    ----------
    name, title : str
    """

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""

    @staticmethod
    def adapt(seen: Seen, before: Factors, forgetting: float) -> Factors:
        """Factors from what is seen; compiled where numba is there, so in numbers only."""
        raise NotImplementedError


class Conventional(Rule):
    """Nothing adapts, sec. 4.1 of [1]_."""

    name = "kf"
    title = "conventional Kalman filter"

    @staticmethod
    def adapt(seen: Seen, before: Factors, forgetting: float) -> Factors:
        """Ones."""
        return Factors(1.0, 1.0, 1.0, 1.0)


class InnovationR(Rule):
    """``R = C_V - H P H'`` with the window's covariance of innovations, sec. 4.2 of [1]_; Q stays."""

    name = "iae"
    title = "innovation-based adaptive filter (IAE-AKF), R adapts"

    @staticmethod
    def adapt(seen: Seen, before: Factors, forgetting: float) -> Factors:
        """R explains what P does not."""
        return Factors(1.0, (seen.mean - seen.predicted) / seen.noise, 1.0, 1.0)


class InnovationQ(Rule):
    """Q grows while innovations are larger than predicted and shrinks while they are smaller; R stays [2]_."""

    name = "iae-q"
    title = "innovation-based adaptive filter, Q adapts"

    @staticmethod
    def adapt(seen: Seen, before: Factors, forgetting: float) -> Factors:
        """A step towards agreement, as slow as the memory: P answers Q with a delay."""
        ratio = min(max(seen.mean / (seen.predicted + seen.noise), 0.1), 10.0)
        return Factors(1.0, 1.0, 1.0, before.q * ratio ** (1.0 - forgetting))


class SageHusa(Rule):
    """``R <- (1 - d) R + d (v v' - H P H')``, ``d = (1 - b) / (1 - b^(k+1))``, sec. 4.3 of [1]_.

    Q stays: one innovation cannot say which of the two is wrong, and both together diverge.
    """

    name = "sage-husa"
    title = "Sage-Husa adaptive filter (SHAKF)"

    @staticmethod
    def adapt(seen: Seen, before: Factors, forgetting: float) -> Factors:
        """A fading memory of what P does not explain."""
        d = (1.0 - forgetting) / (1.0 - forgetting ** (seen.updates + 1.0))
        return Factors(1.0, (1.0 - d) * before.r + d * (seen.now - seen.predicted) / seen.noise, 1.0, 1.0)


class FadingP(Rule):
    """Sage-Husa with the first transitive factor: P grows by ``1 / a1 = tr C_V / tr C``, sec. 5.1 of [1]_.

    The factor acts beyond what the window shows by chance: without that P grows every other sample.
    """

    name = "shafkf-p"
    title = "Sage-Husa adaptive fading filter, P adapts (SHAFKF-P)"

    @staticmethod
    def adapt(seen: Seen, before: Factors, forgetting: float) -> Factors:
        """The window's excess goes to P, eq. (10) of [4]_."""
        d = (1.0 - forgetting) / (1.0 - forgetting ** (seen.updates + 1.0))
        r = (1.0 - d) * before.r + d * (seen.now - seen.predicted) / seen.noise
        excess = seen.mean / (seen.predicted + before.r * seen.noise)
        return Factors(excess if excess > seen.chance else 1.0, r, 1.0, 1.0)


class FadingR(Rule):
    """The same with the second transitive factor: what is left goes to R by ``a2``, sec. 5.2 of [1]_."""

    name = "shafkf-r"
    title = "Sage-Husa adaptive fading filter, P and R adapt (SHAFKF-R)"

    @staticmethod
    def adapt(seen: Seen, before: Factors, forgetting: float) -> Factors:
        """Stage two sees the innovations against what stage one made of P."""
        d = (1.0 - forgetting) / (1.0 - forgetting ** (seen.updates + 1.0))
        r = (1.0 - d) * before.r + d * (seen.now - seen.predicted) / seen.noise
        noise = before.r * seen.noise
        excess = seen.mean / (seen.predicted + noise)
        fade = excess if excess > seen.chance else 1.0
        left = seen.mean / (fade * seen.predicted + noise)
        return Factors(fade, r, left if left > seen.chance else 1.0, 1.0)


def rules() -> dict[str, type[Rule]]:
    """Every rule by its name."""
    return {cls.name: cls for cls in Rule.__subclasses__()}


def rule_named(name: str, where: str = "--filter") -> type[Rule]:
    """The rule of that name; raises `InputError`, which says where it was asked for, where there is none."""
    if name not in rules():
        raise InputError(
            f"there is no filter '{name}'", where=where, remedy=f"Known are {', '.join(rules())}"
        )
    return rules()[name]


@cache
def by_chance(window: int, rows: int = 1) -> float:
    """The 95 % point of the mean of `window` normalised squared innovations of `rows` rows, over its expectation."""
    from scipy.stats import chi2

    return float(chi2.ppf(0.95, window * rows) / (window * rows))


def bounded(factors: Factors, bounds: Bounds) -> Factors:
    """Factors inside their box; compiled where numba is there."""
    return Factors(
        min(max(factors.fade, 1.0), bounds.most_fade),
        min(max(factors.r, bounds.least_r), bounds.most_r),
        min(max(factors.once, 1.0), bounds.most_r),
        min(max(factors.q, bounds.least_q), bounds.most_q),
    )
