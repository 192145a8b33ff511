"""E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017.

Every number of the paper that can be had again, by section. Units are those of the paper: degrees, seconds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.arma import state_space
from kfgen.arma.equivalent import MARKOV_WHITE_WALK, Equivalent, condition
from kfgen.arma.estimate import estimate
from kfgen.core.errors import InputError
from kfgen.effects import Effect, make
from kfgen.identify.evidence.allan import allan_curve
from kfgen.identify.fit.bounds import relative_bound
from kfgen.identify.methods.arma import ArmaSolution, solve, unit_variance
from kfgen.identify.methods.asymptotes import read_asymptotes, short_white
from kfgen.identify.methods.ekf import run_ekf
from kfgen.identify.methods.saini import Parameters
from papers.row import Row, exact, over_seeds

Array = NDArray[np.float64]

POINT = Parameters(N=5.75e-2, B=1.55e-2, K=9e-4, beta=0.01)
"""Sec. 2.2."""
T, SAMPLES = 0.01, 100_000
SIGMAS = (35.6, 114.525)
"""White noise and quantisation of sec. 2."""
TABLE_1 = {100: (4.907, 11.558), 1000: (2.476, 4.147), 10_000: (0.543, 1.455)}
REMARK_3_4 = {500: 3.47, 1000: 3.02, 6000: 0.63}
FIGURE_3 = (0.02, 0.05, 0.1, 0.2, 0.5)
"""Sampling times [s] at which the error of beta is shown here; the figure's own points are not printed."""


def record(effects: Sequence[Effect], seed: int, n: int = SAMPLES, dt: float = T) -> Array:
    """Simulated samples [deg/s], shape (n,)."""
    t = np.asarray(np.arange(n) * dt, dtype=np.float64)
    parts = [e.simulate(t, np.random.default_rng([seed, i])) for i, e in enumerate(effects)]
    return np.asarray(np.sum(parts, axis=0), dtype=np.float64)


def as_deviation(B: float = POINT.B) -> Effect:
    """The Gauss-Markov process with B as its stationary standard deviation, the other common meaning."""
    return make("gauss_markov", sigma=B, tau=1.0 / POINT.beta)


def table_1(seeds: int) -> list[Row]:
    """Errors of the ARMA(0,1) of white noise and quantisation."""
    equivalent = Equivalent(("white_noise", "quantisation"))
    true = [float(v) for v in equivalent.moving_average(0.0, [s * s for s in SIGMAS])]
    rows = [exact("e0 by eq. (6)", "133.7", true[0]), exact("e1 by eq. (6)", "-98.1", true[1])]
    for n, printed in TABLE_1.items():
        errors = []
        for seed in range(seeds):
            w1, w2 = (
                s * np.random.default_rng([seed, i]).standard_normal(n + 1) for i, s in enumerate(SIGMAS)
            )
            found = estimate(w1[1:] + np.diff(w2), 0, 1)
            errors.append([found.sigma / true[0], found.sigma * found.theta[0] / true[1]])
        size = 100.0 * np.abs(np.array(errors) - 1.0).T
        for name, values, number in zip(("e0", "e1"), size, printed):
            rows.append(over_seeds(f"table 1: error of {name} [%], {n} readings", f"{number}", values))
    return rows


def figure_1() -> list[Row]:
    """Condition of M beside the bound of the sizes that it is said to limit."""
    rows = []
    for tau, dt in ((100.0, 0.01), (100.0, 0.1), (100.0, 1.0), (1.0, 1.0)):
        bound = relative_bound(
            (*POINT.effects()[::2], make("gauss_markov", sigma=POINT.B, tau=tau)), dt, SAMPLES
        )
        sizes = {name: bound[i, name] for i, name in ((1, "K"), (2, "sigma"))}
        words = ", ".join(f"{name} {100 * b:.2g} %" for name, b in sizes.items())
        printed = "9" if (tau, dt) == (100.0, 0.01) else "figure"
        rows.append(
            exact(f"log10 cond(M), tau {tau:g} s, T {dt:g} s", printed, np.log10(condition(tau, dt)),
                  f"bound in 1e5 samples, B as standard deviation: {words}")
        )  # fmt: skip
    return rows


def section_2_2(seeds: int) -> list[Row]:
    """N, B and K of one sensor by the ARMA model and by the Allan plot."""
    effects = POINT.effects()
    alpha = float(np.exp(-POINT.beta * T))
    sizes = [e for name in MARKOV_WHITE_WALK.names for e in effects if e.name == name]
    variances = [
        float(getattr(e, e.searched()[0].name)) ** 2 * unit_variance(e.name, alpha, T) for e in sizes
    ]
    e = [float(v) for v in MARKOV_WHITE_WALK.moving_average(alpha, variances)]
    rows = [exact(f"e{i}", "not printed", v) for i, v in enumerate(e)]
    rows.append(exact("length [min]", "16.167", SAMPLES * T / 60.0, "a slip: 1e5 samples at 100 Hz"))
    found = [solve(record(effects, k), T, MARKOV_WHITE_WALK.names) for k in range(seeds)]
    N = [next((float(e.N) for e in f.effects if e.name == "white_noise"), np.nan) for f in found]  # type: ignore[attr-defined]
    rows.append(
        over_seeds("ARMA: alpha", "-0.9783", [f.alpha for f in found], "true 0.9999; pole and zero cancel")
    )
    rows.append(over_seeds("ARMA: N", "0.0574", N))
    rows.append(over_seeds("ARMA: K", "useless", [_size(f.effects, "rate_random_walk") for f in found],
                           "true 9e-4; none for B in any seed"))  # fmt: skip
    printed = [_by_printed_16(f) for f in found]
    rows.append(
        over_seeds("ARMA: K by eq. (16) as printed", "off by orders of magnitude", [v[1] for v in printed])
    )
    rows.append(over_seeds("ARMA: sigma_1 by eq. (16) as printed", "off by orders of magnitude",
                           [v[0] for v in printed], f"true {np.sqrt(variances[0]):.2g}: its sign error does this"))  # fmt: skip
    with_B = [read_asymptotes(allan_curve(record(effects, k), T)) for k in range(seeds)]
    without = [read_asymptotes(allan_curve(record(effects[::2], k), T)) for k in range(seeds)]
    rows.append(over_seeds("Allan: N", "0.056", [r.N.size if r.N else np.nan for r in with_B]))
    rows.append(over_seeds("Allan: K", "1.1e-3", [r.K.size if r.K else np.nan for r in with_B],
                           "22.2 % off, not 18.2 % (which is relative to the estimate)"))  # fmt: skip
    rows.append(over_seeds("Allan: lowest point / 0.664", "1.2e-2", [r.B.size for r in with_B]))
    rows.append(
        over_seeds("the same without any B", "-", [r.B.size for r in without], "so it is no reading of B")
    )
    crossing = float(np.sqrt(2 * POINT.N * POINT.K / np.sqrt(3))) / 0.664282
    rows.append(exact("where N and K cross / 0.664", "-", crossing))
    bound = relative_bound(effects, T, SAMPLES)
    rows.append(exact("bound of ln sigma", "-", bound[1, "sigma"], "no method can tell this B in 16 minutes"))
    return rows


def _by_printed_16(found: ArmaSolution) -> tuple[float, float]:
    """sigma_1 and K [deg, s] by eq. (16) with the sign as printed; no number where a variance is negative."""
    a, e = found.alpha, found.model.sigma * found.model.ma
    s2 = e[0] * e[2] / a
    right = [-e[1] * (e[0] + e[2]) + (1 + a) ** 2 * s2, float(e @ e) - 2 * (1 + a + a**2) * s2]
    s1, s3 = np.linalg.solve([[1.0, a], [2.0, 1.0 + a**2]], right).tolist()
    return (float(np.sqrt(s1)) if s1 > 0 else np.nan), (float(np.sqrt(s3 / T)) if s3 > 0 else np.nan)


def _size(effects: Sequence[Effect], name: str) -> float:
    """The size of an effect, or no number."""
    found = [e for e in effects if e.name == name]
    return float(getattr(found[0], found[0].searched()[0].name)) if found else np.nan


def section_2_3(seeds: int, steps: Sequence[float] = FIGURE_3) -> list[Row]:
    """N and B without K: eq. (17), and figure 3."""
    rows = []
    for meaning, markov in (("eq. (18)", POINT.effects()[1]), ("B as standard deviation", as_deviation())):
        effects = (make("white_noise", N=POINT.N), markov)
        for dt in steps if meaning != "eq. (18)" else (0.1,):
            found = [_without_walk(effects, k, dt) for k in range(seeds)]
            beta = [100.0 * abs(f[2] / POINT.beta - 1.0) for f in found]
            printed = "20 (0.02 of alpha)" if dt == 0.1 else "figure"
            rows.append(over_seeds(f"{meaning}, T {dt:g} s: error of beta [%]", printed, beta))
            if dt == 0.1:
                N = [100.0 * abs(f[0] / POINT.N - 1.0) for f in found]
                B = [100.0 * abs(f[1] / float(markov.sigma) - 1.0) for f in found]  # type: ignore[attr-defined]
                least = relative_bound(effects, dt, SAMPLES)
                rows.append(
                    over_seeds(f"{meaning}: error of N [%]", "0.21", N, f"bound {100 * least[0, 'N']:.2g}")
                )
                rows.append(over_seeds(f"{meaning}: error of B [%]", "2.17", B,
                                       f"bound {100 * least[1, 'sigma']:.3g}"))  # fmt: skip
    return rows


def _without_walk(effects: Sequence[Effect], seed: int, dt: float) -> tuple[float, float, float]:
    """N, sigma and beta by the ARMA(1,1); no numbers where it shows none."""
    try:
        found = solve(record(effects, seed, dt=dt), dt, ("white_noise", "gauss_markov"))
    except InputError:
        return np.nan, np.nan, np.nan
    markov = [e for e in found.effects if e.name == "gauss_markov"]
    tau = float(markov[0].tau) if markov else np.nan  # type: ignore[attr-defined]
    return _size(found.effects, "white_noise"), _size(found.effects, "gauss_markov"), 1.0 / tau


def section_3(seeds: int) -> list[Row]:
    """N from a few samples, and the augmented filter."""
    rows = []
    for n, printed in REMARK_3_4.items():
        errors = [
            100.0 * abs(short_white(record(POINT.effects(), k, n), T, n) / POINT.N - 1) for k in range(seeds)
        ]
        rows.append(over_seeds(f"remark 3.4: error of N [%] from {n} samples", f"{printed}", errors,
                               f"standard deviation {100 / np.sqrt(2 * n):.2g}"))  # fmt: skip
    rank = state_space.frozen_observability().subs(
        dict(zip(state_space.STATES, (5, 3, 4, 3, 1)))
    ).subs(state_space.SAMPLING_PERIOD, 1).rank()  # fmt: skip
    rows.append(Row("condition of the observability matrix", "1e22", "infinite", "exact",
                    f"its rank is {rank} of 5: B and K are each hidden by x1"))  # fmt: skip
    for factor in (1 / 3, 1.0, 3.0):
        start = Parameters(POINT.N, factor * POINT.B, factor * POINT.K, POINT.beta)
        ends = []
        for k in range(seeds):
            y = record(POINT.effects(), k)
            end = run_ekf(y - y.mean(), T, start).end
            ends.append((end.B / start.B, end.K / start.K))
        B, K = np.array(ends).T
        note = "started at the truth" if factor == 1.0 else f"started at {factor:.3g} of it"
        rows.append(over_seeds("EKF: B at its end / at its start", "does not vary much", B, note))
        rows.append(over_seeds("EKF: K at its end / at its start", "depends on the start", K, note))
    return rows


def section_4() -> list[Row]:
    """The recording is not published: what follows from its printed numbers."""
    N, K = 2.95e-2, 5.2e-3
    return [
        exact("N if the FPE 0.0625 were all white", "2.5e-2", float(np.sqrt(0.0625 * T))),
        exact("where its N and K cross / 0.664", "B = 1.74e-2", float(np.sqrt(2 * N * K / np.sqrt(3))) / 0.664282,
              "its B is near the crossing too"),
        Row("all else of sec. 4, figure 4", "-", note="the recording of the mAHRS is not public"),
    ]  # fmt: skip


def sections(seeds: int) -> list[tuple[str, list[Row]]]:
    """All sections with their rows."""
    slow = max(1, seeds // 3) if seeds < 30 else seeds
    steps = (0.1,) if seeds < 30 else FIGURE_3
    return [
        ("2. White noise and quantisation: ARMA(0,1)", table_1(max(seeds, 10))),
        ("Figure 1. Condition of M, and what limits", figure_1()),
        ("2.2 N, B and K: ARMA(1,2)", section_2_2(slow)),
        ("2.3 N and B: ARMA(1,1), figure 3", section_2_3(slow, steps)),
        ("3. The augmented extended Kalman filter", section_3(slow)),
        ("4. Experiment", section_4()),
    ]
