"""Changes of the code that change no answer, each with its reason: no test can notice them, and none should.

An entry is a file, a piece of one of its lines, what is changed there ("" for whatever is), and why nobody can see it.
"""

from __future__ import annotations

SQUARE = "the matrix is square: one length is the other"
ONE_COLUMN = "only the first column is read"
START = "only where an iteration begins; it ends at the same point"
PATH = "only the way of an iteration, not its end"
ENDS = "only when an iteration ends, within its tolerance"
TIE = "at exact equality of two real numbers both sides are the same answer, or neither is more right"
COST = "only what it costs: the same numbers in another way"
ROUNDING = "below the rounding of the numbers"
SYMMETRIC = "the opposite of Gaussian noise is as probable"
GUARD = "a floor that keeps a division or a logarithm defined, far below anything that is measured"
EMPTY = "of a system without states, or without noise, the sums that are skipped are zero"
CAP = "a bound that keeps numbers finite and that no fit comes near"

SAME_ANSWER: tuple[tuple[str, str, str, str], ...] = (
    ("kfgen/core/linear.py", "MAX_SERIES_NORM", "", COST),
    ("kfgen/core/linear.py", "terms = _terms(float((norm / 2.0**doublings)", "", COST),
    ("kfgen/effects/linear_system.py", "if k and not form.deterministic:", "And -> Or", EMPTY),
    (
        "kfgen/effects/linear_system.py",
        "np.swapaxes(s[:, None, None] * np.eye(k) - A, 1, 2)",
        "Sub -> Add",
        "at the opposite frequency, whose density is the same",
    ),
    (
        "kfgen/effects/linear_system.py",
        "np.broadcast_to(_row(form)[:, None], (s.size, k, 1))",
        "1 -> 2",
        ONE_COLUMN,
    ),
    (
        "kfgen/effects/linear_system.py",
        "right = np.broadcast_to(row[:, None], (z.size, k, 1))",
        "1 -> 2",
        ONE_COLUMN,
    ),
    (
        "kfgen/effects/linear_system.py",
        "np.abs(1.0 - 1.0 / z) ** 2",
        "Div -> Mult",
        "z lies on the unit circle: z and 1 / z have the same distance from one",
    ),
    ("kfgen/effects/linear_system.py", "if k == 0 or form.deterministic:", "Or -> And", EMPTY),
    (
        "kfgen/effects/linear_system.py",
        "dt = float(t[-1] - t[0]) / (n - 1) if n > 1 else 0.0",
        "0.0 -> 1.0",
        "of one time the step is not used",
    ),
    (
        "kfgen/effects/linear_system.py",
        "y = y + linear.simulate(Phi, Qd, x0, n, rng)",
        "Add -> Sub",
        SYMMETRIC,
    ),
    ("kfgen/effects/process/stochastic.py", "bracket=(1.0, 2.0, 4.0), tol=1e-10", "", START),
    ("kfgen/identify/evidence/whittle.py", "overwrite_x=True", "True -> False", COST),
    ("kfgen/identify/evidence/whittle.py", "some = values > values[-1]", "Gt -> GtE", TIE),
    (
        "kfgen/identify/evidence/allan.py",
        "return 2 ** np.arange(max(1, int(np.log2(max(n, 12) / 6)) + 1)",
        "1 -> 2",
        "of twelve samples and more there are two octaves at least",
    ),
    (
        "kfgen/emit/covariance/packed.py",
        "max((s for s in special if s < run[0]), default=-1)",
        "0 -> 1",
        "no special column lies inside a run of columns",
    ),
    ("kfgen/gap/scene/newton.py", "least = best < len(by_damping[0])", "", PATH),
    ("kfgen/gap/scene/newton.py", "max(climb.damping * (1e-1 if least else 1e1), 1e-9)", "", PATH),
    ("kfgen/gap/scene/newton.py", "DAMPING_FACTORS = (1.0, 1e2, 1e4, 1e6)", "", PATH),
    ("kfgen/gap/scene/newton.py", "rcond=1e-13", "1e-13 -> 1.0000000000001", PATH),
    (
        "kfgen/identify/evidence/kalman.py",
        "t = np.round((t - t[0]) / dt * TIME_STEPS_PER_PERIOD)",
        "Sub -> Add",
        "only differences of times are used: another origin changes their rounding to a 64th of a period",
    ),
    (
        "kfgen/identify/evidence/kalman.py",
        "at = [known.index(key) if key in known else -1 for key in keys]",
        "1 -> 2",
        "any negative number says that a key is unknown",
    ),
    (
        "kfgen/model/discretise.py",
        "first = len(self.model.states) - self.model.effect_dynamics[0].rows",
        "0 -> 1",
        "the dynamics of the effects and the density that drives them have as many rows",
    ),
    (
        "kfgen/model/discretise.py",
        "fastest = max(float(poles.max(initial=0.0)), 1e-300)",
        "0.0 -> 1.0",
        "slower than one a second the longest step is a tenth of a second in either case",
    ),
    (
        "kfgen/model/discretise.py",
        "1.05 / rate if rate > 0.0 else 0.0",
        "0.0 -> 1.0",
        "a rate that is not positive is refused in the next line",
    ),
    ("kfgen/gap/core/whitener.py", "if grid.size < omega.size:", "Lt -> LtE", ROUNDING),
    ("kfgen/gap/scene/screen.py", "if gain > best.gain:", "Gt -> GtE", TIE),
    ("kfgen/gap/scene/screen.py", "B = A[:, distinct] / size[distinct]", "", "a basis of the same space"),
    ("kfgen/gap/scene/screen.py", "if distinct.any():", "", EMPTY),
    ("kfgen/gap/scene/screen.py", "rcond=1e-10, hermitian=True", "", COST),
    ("kfgen/gap/scene/newton.py", "if not values[best] > climb.value:", "Gt -> GtE", TIE),
    ("kfgen/gap/scene/posterior.py", "power, s = float(part @ part), 1.0", "1.0 -> 2.0", START),
    ("kfgen/gap/scene/posterior.py", "s *= math.exp(min(max(step, -1.0), 1.0))", "1.0 -> 2.0", PATH),
    ("kfgen/gap/scene/posterior.py", "if abs(step) < LEVEL_TOLERANCE:", "Lt -> LtE", TIE),
    ("kfgen/gap/scene/newton.py", "good = (size > 0.01", "Gt -> GtE", TIE),
    ("kfgen/gap/scene/newton.py", "good = (size > 0.01", "Lt -> LtE", TIE),
    (
        "kfgen/gap/scene/newton.py",
        "good = (size > 0.01",
        "100.0 -> 101.0",
        "a limit of a step, one percent further",
    ),
    ("kfgen/gap/scene/newton.py", "1e-8, 1e8)", "100000000.0 -> 100000001.0", ROUNDING),
    ("kfgen/gap/scene/newton.py", "tolerance = max(GAIN_TOLERANCE_NATS", "", ENDS),
    (
        "kfgen/gap/scene/newton.py",
        "if climb.gain > climb.coarse * GAIN_TOLERANCE_NATS:",
        "",
        "the derivatives of the point, or of one that is as good to a few thousandths of a nat",
    ),
    ("kfgen/gap/scene/newton.py", "H[np.arange(k, H.shape[0]), np.arange(k, H.shape[0])]", "0 -> 1", SQUARE),
    ("kfgen/gap/scene/newton.py", "scale = np.sqrt(np.maximum(np.diag(H), 1e-300))", "1e-300 -> 1.0", PATH),
    (
        "kfgen/run/adaptive/loop.py",
        "least = 1.0",
        "1.0 -> 2.0",
        "a pivot over the largest entry is never above one",
    ),
    (
        "kfgen/run/adaptive/loop.py",
        "out, gains, least = np.zeros((n, 5)), np.zeros(m), 1.0",
        "",
        "one column more that nobody reads; a pivot over the largest entry is never above one",
    ),
    ("kfgen/run/adaptive/loop.py", "for i in range(D.shape[0]):", "0 -> 1", SQUARE),
    ("kfgen/run/adaptive/loop.py", "for j in range(i + 1, D.shape[0]):", "0 -> 1", SQUARE),
    (
        "kfgen/run/adaptive/loop.py",
        "recent, filled, total, count = np.zeros(window), 0, 0.0, 0.0",
        "0.0 -> 1.0",
        "the sum is made anew at the first sample",
    ),
    ("kfgen/run/adaptive/loop.py", "if at == 0:", "", ROUNDING),
    ("kfgen/run/adaptive/loop.py", "prepare = compiled if z.size > FEW", "Gt -> GtE", COST),
    ("kfgen/run/adaptive/loop.py", "least < -1e-9 * float(np.trace(self.Q))", "Lt -> LtE", TIE),
)
"""File, piece of the line, change, reason."""


def reason(path: str, line: str, words: str) -> str:
    """Why a change cannot be noticed; empty where it could be.

    Parameters
    ----------
    path : str
        Of the module.
    line : str
        Of its source.
    words : str
        What is changed.
    """
    for file, piece, change, why in SAME_ANSWER:
        if file == path and piece in line and change in ("", words):
            return why
    return ""
