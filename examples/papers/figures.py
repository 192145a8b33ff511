"""Figures 1 and 2 of Hemerly 2017, and beside them what they do not show."""

from __future__ import annotations

import numpy as np

from kfgen.arma.equivalent import condition
from kfgen.effects import make
from kfgen.identify.evidence.allan import allan_curve
from kfgen.identify.fit.bounds import relative_bound
from kfgen.identify.methods.asymptotes import Asymptote, read_asymptotes
from kfgen.report.page import PagePart, figure
from kfgen.report.plots import AFTER, BEFORE, MEASURED, Line, Map, allan_picture, maps_picture
from papers.hemerly import POINT, T, as_deviation, record

TAUS, STEPS = np.geomspace(1.0, 1000.0, 13), np.geomspace(0.01, 1.0, 11)
HOURS = 3.0


def figure_1() -> PagePart:
    """cond(M) over correlation and sampling time; the bound of sigma and K in a record of some hours."""
    cond = np.array([[np.log10(condition(tau, dt)) for tau in TAUS] for dt in STEPS])
    bound = np.array([[_bounds(tau, dt) for tau in TAUS] for dt in STEPS])
    maps = [
        Map("log10 cond(M), figure 1", TAUS, STEPS, cond),
        Map(f"log10 bound of sigma, {HOURS:g} h", TAUS, STEPS, np.log10(bound[:, :, 0])),
        Map(f"log10 bound of K, {HOURS:g} h", TAUS, STEPS, np.log10(bound[:, :, 1])),
    ]
    picture = maps_picture(maps, "correlation time [s]", "sampling time [s]", "figure-1")
    words = (
        "Figure 1 beside the Cramér-Rao bound with B as standard deviation. The condition number changes ten thousandfold with the "
        "sampling time, the bound hardly: the data limit, not the system of equations."
    )
    return figure(picture, words)


def _bounds(tau: float, dt: float) -> tuple[float, float]:
    white, _, walk = POINT.effects()
    n = int(HOURS * 3600.0 / dt)
    bound = relative_bound((white, make("gauss_markov", sigma=POINT.B, tau=float(tau)), walk), float(dt), n)
    return bound[1, "sigma"], bound[2, "K"]


def figure_2(seed: int = 0) -> PagePart:
    """The Allan plot with the asymptotes that are read, and what the noises give on average."""
    curve = allan_curve(record(POINT.effects(), seed), T)
    seen = read_asymptotes(curve)

    def line(label: str, unit: str, size: Asymptote | None, color: str) -> list[Line]:
        if size is None:
            return []
        effect = make(unit, **{"white_noise": {"N": size.size}, "rate_random_walk": {"K": size.size}}[unit])
        return [Line(label, curve.tau, np.sqrt(effect.allan_variance(curve.tau)), color, dashed=True)]

    def truth(label: str, color: str, *parts: int) -> Line:
        effects = [POINT.effects()[i] for i in parts]
        return Line(label, curve.tau, np.sqrt(sum(e.allan_variance(curve.tau) for e in effects)), color)

    lines = [
        *line("-1/2 as read", "white_noise", seen.N, AFTER),
        *line("+1/2 as read", "rate_random_walk", seen.K, BEFORE),
        truth("N, K and B of eq. (18)", MEASURED, 0, 1, 2),
        truth("N and K alone", BEFORE, 0, 2),
    ]
    markov = np.sqrt(as_deviation().allan_variance(curve.tau))
    lines.append(Line("B as standard deviation, alone", curve.tau, markov, "#7a8794", dashed=True))
    words = (
        f"Figure 2: lowest point / 0.664 = {seen.B.size:.3g} deg/s (printed: 1.2e-2); N and K alone give a curve that "
        "cannot be distinguished from that with B."
    )
    return figure(allan_picture(curve, lines, "deg/s", 1.0, "figure-2"), words)
