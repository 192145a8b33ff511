"""How long a covariance in single precision stays one: emitted forms and textbook forms against double precision.

Usage: python benchmarks/covariance_health.py [SECONDS] [--picture FILE.svg]

An ins15 at rest with the noise of an identified MEMS unit, and no floors under its variances: gyros 8.7e-5
rad/s/sqrt(Hz) and 1e-6 rad/s/sqrt(s), accelerometers 1e-3 m/s^2/sqrt(Hz) and 1e-5 m/s^2/sqrt(s), predictions at 250 Hz,
GNSS position and velocity at 5 Hz. Every minute: the smallest eigenvalue of the covariance scaled to a unit
diagonal (not positive: no covariance any more), and each standard deviation over that of double precision. An hour
by default.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from kfgen.core.files.whole_file import write_text
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.emit.routines import Program
from kfgen.emit.targets.c import header
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.report.plots import Line, series_picture
from kfgen.verify.host import compiler

RATE, AIDING, EVERY = 250, 5, 60.0
NOISE = {"gyro": ("rad/s", 8.7e-5, 1e-6), "accel": ("m/s^2", 1e-3, 1e-5)}

EMITTED = """
#include "ins15.h"
void run(long steps, long aid, long keep, double *out);
void run(long steps, long aid, long keep, double *out)
{
    static ins15_t kf;
    const REAL accel[3] = {0, 0, (REAL)-GRAVITY}, gyro[3] = {0, 0, 0}, zero[3] = {0, 0, 0};
    (void)ins15_init(&kf);
    for (long k = 1; k <= steps; k++) {
        (void)ins15_predict(&kf, accel, gyro, (REAL)DT);
        for (int i = 0; i < INS15_NX; i++) { kf.x[i] = 0; }
        kf.x[6] = 1;
        if (k % aid == 0) { (void)ins15_update_gnss_position(&kf, zero); (void)ins15_update_gnss_velocity(&kf, zero); }
        if (k % keep == 0) {
            for (int i = 0; i < 15; i++) { for (int j = 0; j < 15; j++) { *out++ = (double)ins15_get_covariance(&kf, i, j); } }
        }
    }
}
"""

TEXTBOOK = """
typedef float REAL;
enum { N = 15 };
static const REAL F[N][N] = {F_}, Q[N][N] = {Q_}, P0[N] = {P_}, R[6] = {R_};
static REAL P[N][N], T[N][N], A[N][N];
static void predict(void)
{
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) {
        REAL s = 0; for (int k = 0; k < N; k++) { s += F[i][k] * P[k][j]; } T[i][j] = s; }
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) {
        REAL s = 0; for (int k = 0; k < N; k++) { s += T[i][k] * F[j][k]; } P[i][j] = s + Q[i][j]; }
}
static void update(int m)
{
    const REAL S = P[m][m] + R[m];
    REAL K[N];
    for (int i = 0; i < N; i++) { K[i] = P[i][m] / S; }
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) { A[i][j] = ((i == j) ? (REAL)1 : (REAL)0) - ((j == m) ? K[i] : (REAL)0); }
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) { T[i][j] = P[i][j] - K[i] * P[m][j]; }
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) {
        REAL s = T[i][j];
        if (JOSEPH) { s = 0; for (int k = 0; k < N; k++) { s += T[i][k] * A[j][k]; } s += R[m] * K[i] * K[j]; }
        P[i][j] = s; }
    if (SYMMETRIC) { for (int i = 0; i < N; i++) for (int j = 0; j < i; j++) { P[i][j] = P[j][i] = (REAL)0.5 * (P[i][j] + P[j][i]); } }
}
void run(long steps, long aid, long keep, double *out);
void run(long steps, long aid, long keep, double *out)
{
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) { P[i][j] = (i == j) ? P0[i] : (REAL)0; }
    for (long k = 1; k <= steps; k++) {
        predict();
        if (k % aid == 0) { for (int m = 0; m < 6; m++) { update(m); } }
        if (k % keep == 0) { for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) { *out++ = (double)P[i][j]; } }
    }
}
"""


def discrete() -> DiscreteModel:
    """The filter with identified noise."""
    channels = {
        f"{triad}_{axis}": ChannelNoise(
            unit, (Term(make("white_noise", N=N)), Term(make("rate_random_walk", K=K)))
        )
        for triad, (unit, N, K) in NOISE.items()
        for axis in "xyz"
    }
    return DiscreteModel(build("ins15", NoiseModel(channels)), rate=float(RATE))


def emitted(form: str, real: str, q_interval: float = 0.0) -> dict[str, str]:
    """Files of an emitted filter with its driver."""
    driver = (
        EMITTED.replace("REAL", real).replace("GRAVITY", str(STANDARD_GRAVITY)).replace("DT", str(1.0 / RATE))
    )
    return {"run.c": driver, "ins15.h": header(Program(discrete(), form, real, q_interval=q_interval))}


def textbook(joseph: bool) -> dict[str, str]:
    """Full matrices: (I - K H) P and a symmetrised mean, or Joseph's form without."""
    d = discrete()
    values = dict.fromkeys(d.Phi.free_symbols | d.Qd.free_symbols, 0.0)
    values |= {s: 1.0 for s in values if s.name in ("R_nb_00", "R_nb_11", "R_nb_22")}
    values |= {s: -STANDARD_GRAVITY for s in values if s.name == "accel_z"}
    values |= {s: 1.0 / RATE for s in values if s.name == "dt"}
    F, Q = (np.array(M.subs(values), float) for M in (d.Phi, d.Qd))
    R = [d.measurement_variance(s, c) for s in d.model.sensors for c in s.channels]
    rows = {
        "F_": ", ".join("{" + ", ".join(f"{v:.9e}f" for v in row) + "}" for row in F),
        "Q_": ", ".join("{" + ", ".join(f"{v:.9e}f" for v in row) + "}" for row in Q),
        "P_": ", ".join(f"{s.prior**2:.9e}f" for s in d.model.states),
        "R_": ", ".join(f"{v:.9e}f" for v in R),
    }
    text = TEXTBOOK.replace("JOSEPH", str(int(joseph))).replace("SYMMETRIC", str(int(not joseph)))
    for word, row in rows.items():
        text = text.replace("{" + word + "}", "{" + row + "}")
    return {"run.c": text}


def run(files: dict[str, str], seconds: float) -> np.ndarray:
    """The covariance every minute, shape (minutes, 15, 15)."""
    steps, keep = round(seconds * RATE), round(EVERY * RATE)
    out = np.empty((steps // keep, 15, 15))
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text)
        words = [
            "-O2",
            "-ffp-contract=off",
            "-fPIC",
            "-shared",
            f"{folder}/run.c",
            "-o",
            f"{folder}/run.so",
            "-lm",
        ]
        subprocess.run([*compiler(), *words], check=True)
        library = ctypes.CDLL(f"{folder}/run.so")
        library.run.argtypes = [ctypes.c_long] * 3 + [ctypes.c_void_p]
        library.run(steps, RATE // AIDING, keep, out.ctypes.data)
    return out


def smallest(P: np.ndarray) -> float:
    """The smallest eigenvalue with the diagonal scaled to one; of a negative variance, minus one."""
    d = np.diag(P)
    if not (d > 0.0).all():
        return -1.0
    return float(np.linalg.eigvalsh((P + P.T) / 2.0 / np.sqrt(np.outer(d, d))).min())


def main() -> None:
    """The table, and the picture where one is asked for."""
    words = sys.argv[1:]
    picture = words[words.index("--picture") + 1] if "--picture" in words else None
    seconds = float(words[0]) if words and not words[0].startswith("-") else 3600.0
    forms = {
        "double, p": emitted("p", "double"),
        "float, ud": emitted("ud", "float"),
        "float, ud, q interval 0.2 s": emitted("ud", "float", 0.2),
        "float, p": emitted("p", "float"),
        "float, textbook (I-KH)P": textbook(joseph=False),
        "float, textbook Joseph": textbook(joseph=True),
    }
    runs = {name: run(files, seconds) for name, files in forms.items()}
    true = np.sqrt(np.array([np.diag(P) for P in runs["double, p"]]))
    print(
        f"ins15 at rest, {seconds:g} s, {round(seconds * RATE)} predictions, {round(seconds * AIDING)} aidings"
    )
    print(
        "  form                      first bad  smallest eigenvalue  negative variances  sigma / sigma of double"
    )
    lines = []
    colors = ["#1b2430", "#1f5fa8", "#2f855a", "#c4452f", "#b7791f", "#7a8794"]
    t = EVERY * np.arange(1, len(true) + 1) / 60.0
    for (name, P), color in zip(runs.items(), colors, strict=True):
        least = np.array([smallest(p) for p in P])
        variances = np.array([np.diag(p) for p in P])
        ratio = np.sqrt(np.where(variances > 0, variances, np.nan)) / true
        bad = f"{t[np.argmax(least <= 0.0)]:.0f} min" if (least <= 0.0).any() else "never"
        span = f"{np.nanmin(ratio):.4g} .. {np.nanmax(ratio):.4g}"
        print(
            f"  {name:25} {bad:>9}  {least.min():>+19.3g}  {int((variances <= 0).any(axis=0).sum()):>18}  {span}"
        )
        lines.append(Line(name, t, np.maximum(least, -0.2), color))
    if picture:
        drawn = series_picture(lines, "smallest normalised eigenvalue", "covariance-health", "time [min]")
        write_text(picture, drawn.svg)
        print(f"picture: {picture}")


if __name__ == "__main__":
    main()
