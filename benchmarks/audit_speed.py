"""How long ``audit`` takes, and what others say and take: sympy's rank, python-control, pybounds.

Usage: python benchmarks/audit_speed.py [library|large|growth|sympy|pybounds ...]

Each measurement runs in a fresh interpreter: importing and deriving the model count. Seconds are of the wall clock,
and of the processor in brackets, which a busy machine does not lengthen. pybounds is not a dependency: pip install pybounds.
"""

from __future__ import annotations

import subprocess
import sys
import time

LIMIT = 120.0
"""Seconds after which a peer is given up."""

LIBRARY = """
from kfgen.audit.audit import audit
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.library import build
answer = audit(build("ins15"))
print(f"ins15, {1 + len(answer.table.manoeuvres)} manoeuvres, nullity {answer.first.nullity}", end="")
"""

LARGE = """
from kfgen.audit.exact.chain import along
from kfgen.audit.exact.plan import Plan
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.library import build
options = {"lever_arm": "state", "sensors": "gnss_position,mag,barometer", "field": "vector", "hard_iron": "true"}
model = build("ins33", None, options)
plan = Plan(model, tuple(model.sensors))
(h,) = along(plan, [LIBRARY["generic"]])
print(f"{plan.size} states, generic: rank {plan.size - h.nullity}", end="")
"""

GROWTH = """
import time
from dataclasses import replace
from kfgen.audit.exact.chain import along
from kfgen.audit.exact.plan import Plan
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.library import build
model = build("ins15")
plan = Plan(model, tuple(model.sensors))
along(plan, [LIBRARY["s-turn"]])
for count in (1, 4, 16, 64):
    start = time.process_time()
    along(plan, [replace(LIBRARY["two-position"], velocity=(float(k), 0.0, 0.0)) for k in range(count)])
    print(f"{count} manoeuvres {time.process_time() - start:.2f} s;", end=" ")
"""

SYMPY = """
import sympy as sp
n = {states}
t = sp.Symbol("t")
R = sp.Matrix(3, 3, lambda i, j: sp.Function(f"R{{i}}{{j}}")(t))
w = sp.Matrix([sp.Function(f"w{{i}}")(t) for i in range(3)])
f = sp.Matrix([sp.Function(f"f{{i}}")(t) for i in range(3)])
W = sp.Matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
known = dict(zip([e.diff(t) for e in R], R * W))
a = R * f
skew = sp.Matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
O, I = sp.zeros(3), sp.eye(3)
if n == 6:
    F, H = sp.Matrix([[O, -R], [O, O]]), sp.Matrix([[skew, O]])
else:
    F = sp.Matrix([[O, I, O, O, O], [O, O, -skew, -R, O], [O, O, O, O, -R], [O] * 5, [O] * 5])
    H = sp.Matrix([[I, O, O, O, O]])
rows, block = [H], H
for _ in range(3 if n == 6 else 5):
    block = (block.diff(t).subs(known) + block * F).applyfunc(sp.expand)
    rows.append(block)
print(f"sympy: generic motion, {{n}} states: rank {{sp.Matrix.vstack(*rows).rank()}}", end="")
"""

PYBOUNDS = """
import numpy as np
import pybounds
from casadi import cos, sin, tan
def f(x, u):
    v, (r, p, y), ba, bg = x[3:6], x[6:9], x[9:12], x[12:15]
    a = [u[k] - ba[k] for k in range(3)]
    w = [u[3 + k] - bg[k] for k in range(3)]
    side, up = sin(r) * a[1] + cos(r) * a[2], cos(r) * a[1] - sin(r) * a[2]
    level = cos(p) * a[0] + sin(p) * side
    turn = sin(r) * w[1] + cos(r) * w[2]
    return [*v, cos(y) * level - sin(y) * up, sin(y) * level + cos(y) * up, -sin(p) * a[0] + cos(p) * side + 9.80665,
            w[0] + tan(p) * turn, cos(r) * w[1] - sin(r) * w[2], turn / cos(p), *([0 * v[0]] * 6)]
def h(x, u):
    return [x[k] for k in range(6)]
names = [f"s{k}" for k in range(15)]
s = pybounds.Simulator(f, h, dt=0.1, state_names=names, input_names=[f"u{k}" for k in range(6)], measurement_names=names[:6])
t = np.arange(40) * 0.1
u = np.zeros((t.size, 6))
u[:, 2] = -9.80665
O = pybounds.EmpiricalObservabilityMatrix(s, np.zeros(15), u).O
print(f"pybounds: at rest, 15 states: numpy's rank of its matrix {np.linalg.matrix_rank(O)} (exact: 11)", end="")
"""


def measured(title: str, script: str) -> None:
    """Run a script in a fresh interpreter and print what it says and took."""
    timed = script + "\nimport time; print('|', time.process_time())"
    start = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", timed],
            capture_output=True,
            text=True,
            timeout=LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        print(f"{title}: no answer within {LIMIT:g} s")
        return
    seconds = time.perf_counter() - start
    if done.returncode:
        print(f"{title}: failed: {done.stderr.strip().splitlines()[-1]}")
        return
    said, _, processor = done.stdout.strip().splitlines()[-1].rpartition("|")
    print(f"{said.strip()}: {seconds:.2f} s ({float(processor):.2f} s)")


SCRIPTS = {
    "library": [LIBRARY],
    "large": [LARGE],
    "growth": [GROWTH],
    "sympy": [SYMPY.format(states=6), SYMPY.format(states=15)],
    "pybounds": [PYBOUNDS],
}


def main() -> None:
    """Run what is asked for; everything when nothing is."""
    for name in sys.argv[1:] or SCRIPTS:
        for script in SCRIPTS[name]:
            measured(name, script)


if __name__ == "__main__":
    main()
