"""Whole filters as other generators write them, from the equations of one model: for `whole_filter.py`.

Each is C of functions ``predict`` and ``update_<sensor>`` without arguments, on the arrays x, P, in, k and z.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sympy as sp
from codegen import LIBRARY, FloatPrinter
from filter_equations import Equations

from kfgen.model.parts.sensors import Sensor


@dataclass(frozen=True)
class Peer:
    """A generated filter: declarations, and the body of each routine.

    Parameters
    ----------
    text : str
        C of functions ``predict`` and ``update_<sensor>`` without arguments, on the arrays x, P, in, k and z.
    packed : bool
        Whether P is the packed upper triangle.
    """

    text: str
    packed: bool = True


Pairs = Sequence[tuple[str, sp.Expr]]
Cse = Callable[[Sequence[sp.Expr]], tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]]


class ElementPrinter(FloatPrinter):
    """Elements of the packed triangle where they are stored."""

    def __init__(self, places: Mapping[str, str]) -> None:
        super().__init__()
        self.places = places

    def _print_Symbol(self, e: sp.Symbol) -> str:
        return self.places.get(e.name, e.name)

    def _print_Pow(self, e: sp.Pow) -> str:
        root = super()._print_Pow(e)
        return f"(1.0f/{root})" if e.exp == sp.Rational(-1, 2) else root


class Straight:
    """Routines as straight-line C by somebody's common subexpressions.

    Parameters
    ----------
    p : Equations
    cse : callable
    packed : bool
    """

    def __init__(self, p: Equations, cse: Cse, packed: bool = True) -> None:
        self.p, self.cse, self.packed, self.stages = p, cse, packed, 0
        self.P = sp.Matrix(p.n, p.n, lambda i, j: sp.Symbol(f"P_{min(i, j)}_{max(i, j)}"))
        self.places = {self.P[i, j].name: self.element(i, j) for i, j in p.entries}

    def element(self, i: int, j: int) -> str:
        """Where an element of P is stored."""
        return f"P[{self.p.entries.index((i, j)) if self.packed else i * self.p.n + j}]"

    def stage(self, outputs: Pairs, in_place: bool = True) -> str:
        """Statements; what names no element becomes a local."""
        self.stages += 1
        shared, reduced = self.cse([e for _, e in outputs])
        tag = {s: sp.Symbol(f"{s.name}_{self.stages}") for s, _ in shared}
        text = ElementPrinter(self.places if in_place else {})
        lines = [f"  const float {tag[s]} = {text.doprint(e.xreplace(tag))};" for s, e in shared]
        for (name, _), e in zip(outputs, reduced, strict=True):
            local = "" if "[" in name else "const float "
            lines.append(f"  {local}{name} = {text.doprint(e.xreplace(tag))};")
        return "\n".join(lines) + "\n"

    def known(self) -> str:
        """State, inputs and constants as locals."""
        p = self.p
        arrays = (("x", p.x), ("in", p.inputs), ("k", p.k))
        return "".join(
            f"  const float {s} = {name}[{i}]; (void){s};\n"
            for name, symbols in arrays
            for i, s in enumerate(symbols)
        )

    def predict(self) -> str:
        """State and covariance in one piece."""
        p = self.p
        Phi, Qd = (M.applyfunc(p.plain) for M in (p.Phi, p.Qd))
        new = Phi * self.P * Phi.T + Qd
        load = "".join(f"  const float {self.P[i, j]} = {self.element(i, j)};\n" for i, j in p.entries)
        # The scale of the quaternion is a factor of four new numbers, which common subexpressions find.
        outputs = [(f"x[{k}]", e) for k, e in enumerate(p.step)]
        outputs += [(self.element(i, j), new[i, j]) for i, j in p.entries]
        mirror = "".join(
            f"  {self.element(j, i)} = {self.element(i, j)};\n"
            for i, j in p.entries
            if i != j and not self.packed
        )
        return function("predict", self.known() + load + self.stage(outputs, in_place=False) + mirror)

    def innovations(self, sensor: Sensor) -> tuple[str, list[dict[int, sp.Expr]], list[sp.Symbol]]:
        """Innovations and Jacobians: statements; constants of the Jacobian stay as they are."""
        h, rows, _ = self.p.measurement(sensor)
        y = [sp.Symbol(f"r_{i}") for i in range(len(h))]
        outputs = [(s.name, sp.Symbol(f"z_{i}") - e) for i, (s, e) in enumerate(zip(y, h, strict=True))]
        named: list[dict[int, sp.Expr]] = []
        for i, row in enumerate(rows):
            named.append({j: e if e.is_number else sp.Symbol(f"H_{i}_{j}") for j, e in row.items()})
            outputs += [(f"H_{i}_{j}", e) for j, e in row.items() if not e.is_number]
        load = "".join(f"  const float z_{i} = z[{i}];\n" for i in range(len(h)))
        return load + self.stage(outputs), named, y

    def update(self, sensor: Sensor) -> str:
        """Every row's fusion generated, in place."""
        p = self.p
        text, rows, residuals = self.innovations(sensor)
        R = p.measurement(sensor)[2]
        dx = [sp.Integer(0)] * p.n
        for i, row in enumerate(rows):
            Ph = [sp.Add(*(e * self.P[k, j] for j, e in row.items())) for k in range(p.n)]
            b = [sp.Symbol(f"Ph_{i}_{k}") for k in range(p.n)]
            S, s, y = sp.symbols(f"S_{i} s_{i} y_{i}")
            text += self.stage([(v.name, e) for v, e in zip(b, Ph, strict=True)])
            text += self.stage([(S.name, sp.Add(*(e * b[j] for j, e in row.items())) + sp.Float(R[i]))])
            left = residuals[i] - sp.Add(*(e * dx[j] for j, e in row.items()))
            text += self.stage([(s.name, 1 / S), (y.name, left)])
            K = [sp.Symbol(f"K_{i}_{k}") for k in range(p.n)]
            text += self.stage([(v.name, e * s) for v, e in zip(K, b, strict=True)])
            new = [sp.Symbol(f"d_{i}_{k}") for k in range(p.n)]
            text += self.stage([(d.name, dx[k] + K[k] * y) for k, d in enumerate(new)])
            text += self.stage([(self.element(k, l), self.P[k, l] - K[k] * b[l]) for k, l in p.entries])
            dx = list(new)
        return function(f"update_{sensor.name}", self.known() + text + self.correction(dx))

    def correction(self, dx: Sequence[sp.Expr]) -> str:
        """The correction moves into the state."""
        given = dict(zip(self.p.dx, dx, strict=True))
        return self.stage([(f"x[{k}]", e.xreplace(given)) for k, e in enumerate(self.p.corrected)])

    def joseph(self, sensor: Sensor) -> str:
        """As PX4 has it: innovation, its variance and Jacobian generated; gain and Joseph's form in loops."""
        p = self.p
        text, rows, residuals = self.innovations(sensor)
        R = p.measurement(sensor)[2]
        text += f"  float dx[{p.n}] = {{0}};\n"
        for i, row in enumerate(rows):
            Ph = {j: sp.Add(*(e * self.P[j, l] for l, e in row.items())) for j in row}
            S = sp.Add(*(e * Ph[j] for j, e in row.items())) + sp.Float(R[i])
            text += self.stage([(f"S_{i}", S)])
            given = ", ".join(f"[{j}] = {ElementPrinter({}).doprint(sp.sympify(e))}" for j, e in row.items())
            inner = "".join(f" - H[{j}] * dx[{j}]" for j in row)
            text += f"  {{ const float H[{p.n}] = {{{given}}};\n"
            text += f"    joseph(H, S_{i}, {float(R[i]):.9g}f, {residuals[i]}{inner}, dx); }}\n"
        load = "".join(f"  const float d_{k} = dx[{k}];\n" for k in range(p.n))
        last = self.stage([(f"x[{k}]", e) for k, e in enumerate(p.corrected)])
        return function(f"update_{sensor.name}", self.known() + text + load + last)

    def whole(self, sensor: Sensor) -> str:
        """As TinyEKF has it: the whole sample with dense matrices."""
        p = self.p
        text, rows, residuals = self.innovations(sensor)
        R, m = p.measurement(sensor)[2], len(rows)
        given = ", ".join(
            f"[{i * p.n + j}] = {ElementPrinter({}).doprint(sp.sympify(e))}"
            for i, row in enumerate(rows)
            for j, e in row.items()
        )
        noise = ", ".join(f"[{i * m + i}] = {float(r):.9g}f" for i, r in enumerate(R))
        text += f"  const float H[{m * p.n}] = {{{given}}}, R[{m * m}] = {{{noise}}};\n"
        text += f"  const float y[{m}] = {{{', '.join(map(str, residuals))}}};\n  float dx[{p.n}];\n"
        text += f"  update_dense(H, R, y, dx, {m});\n"
        load = "".join(f"  const float d_{k} = dx[{k}];\n" for k in range(p.n))
        last = self.stage([(f"x[{k}]", e) for k, e in enumerate(p.corrected)])
        return function(f"update_{sensor.name}", self.known() + text + load + last)

    def dense_predict(self) -> str:
        """State by straight-line code, covariance by dense matrices."""
        p, n = self.p, self.p.n
        outputs = [(f"x[{k}]", e) for k, e in enumerate(p.step)]
        for name, M in (("F", p.Phi), ("Q", p.Qd)):
            outputs += [(f"{name}[{k}]", p.plain(e)) for k, e in enumerate(M) if e != 0]
        arrays = f"  static float F[{n * n}], Q[{n * n}], FP[{n * n}], Ft[{n * n}], FPFt[{n * n}];\n"
        multiply = f"""  multiply(F, P, FP, {n}); transpose(F, Ft, {n}); multiply(FP, Ft, FPFt, {n});
  for (int i = 0; i < {n * n}; i++) P[i] = FPFt[i] + Q[i];
"""
        return function("predict", self.known() + arrays + self.stage(outputs) + multiply)


def function(name: str, body: str) -> str:
    """A routine without arguments."""
    return f"static void {name}(void) {{\n{body}}}\n"


JOSEPH = """static float PH[N_], K[N_];
static __attribute__((noinline)) void joseph(const float *H, float S, float R, float y, float *dx) {
  for (int i = 0; i < N_; i++) { float s = 0.0f;
    for (int j = 0; j < N_; j++) s += P[i * N_ + j] * H[j];
    K[i] = s / S; PH[i] = s; }
  for (int i = 0; i < N_; i++) for (int j = 0; j < N_; j++) P[i * N_ + j] -= K[i] * PH[j];
  for (int i = 0; i < N_; i++) { float s = 0.0f;
    for (int j = 0; j < N_; j++) s += P[i * N_ + j] * H[j];
    PH[i] = s; }
  for (int i = 0; i < N_; i++) for (int j = 0; j <= i; j++) {
    P[i * N_ + j] = P[i * N_ + j] - PH[i] * K[j] + K[i] * R * K[j]; P[j * N_ + i] = P[i * N_ + j]; }
  for (int i = 0; i < N_; i++) dx[i] += K[i] * y; }
"""
DENSE = (
    LIBRARY
    + """
static __attribute__((noinline)) void product(const float *a, const float *b, float *c, int m, int n, int o) {
  for (int i = 0; i < m; i++) for (int j = 0; j < o; j++) {
    c[i * o + j] = 0.0f; for (int k = 0; k < n; k++) c[i * o + j] += a[i * n + k] * b[k * o + j]; } }
static __attribute__((noinline)) void update_dense(const float *H, const float *R, const float *y, float *dx, int m) {
  static float Ht[3 * N_], PHt[3 * N_], S[9], V[9], G[3 * N_], GH[N_ * N_], GHP[N_ * N_];
  for (int i = 0; i < m; i++) for (int j = 0; j < N_; j++) Ht[j * m + i] = H[i * N_ + j];
  product(P, Ht, PHt, N_, N_, m); product(H, PHt, S, m, N_, m);
  for (int i = 0; i < m * m; i++) { S[i] += R[i]; V[i] = 0.0f; }
  for (int i = 0; i < m; i++) V[i * m + i] = 1.0f;
  for (int i = 0; i < m; i++) { const float over = 1.0f / S[i * m + i];
    for (int j = 0; j < m; j++) { S[i * m + j] *= over; V[i * m + j] *= over; }
    for (int k = 0; k < m; k++) if (k != i) { const float f = S[k * m + i];
      for (int j = 0; j < m; j++) { S[k * m + j] -= f * S[i * m + j]; V[k * m + j] -= f * V[i * m + j]; } } }
  product(PHt, V, G, N_, m, m); product(G, y, dx, N_, m, 1); product(G, H, GH, N_, m, N_);
  for (int i = 0; i < N_; i++) for (int j = 0; j < N_; j++) GH[i * N_ + j] = (i == j ? 1.0f : 0.0f) - GH[i * N_ + j];
  product(GH, P, GHP, N_, N_, N_);
  for (int i = 0; i < N_ * N_; i++) P[i] = GHP[i]; }
"""
)


def by_sympy(outputs: Sequence[sp.Expr]) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Common subexpressions as sympy finds them."""
    shared, reduced = sp.cse(outputs, symbols=sp.numbered_symbols("t_"), order="none")
    return list(shared), list(reduced)


def by_symforce(outputs: Sequence[sp.Expr]) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """SymForce's own."""
    import symforce.symbolic as sf

    symbols = sorted(set().union(*(sp.sympify(e).free_symbols for e in outputs)), key=str)
    own = [sf.Symbol(s.name) for s in symbols]
    made = sp.lambdify(symbols, list(outputs), modules=[{"sqrt": sf.sqrt}])(*own)
    shared, reduced = sf.sympy.cse([sf.S(e) for e in made])
    known = {s.name: s for s in symbols} | {str(s): sp.Symbol(str(s)) for s, _ in shared}
    back = lambda e: sp.sympify(str(e), locals=known)  # noqa: E731
    return [(known[str(s)], back(e)) for s, e in shared], [back(e) for e in reduced]


def generated(p: Equations, cse: Cse) -> Peer:
    """Every routine by somebody's common subexpressions."""
    made = Straight(p, cse)
    return Peer(made.predict() + "".join(made.update(s) for s in p.sensors))


def px4(p: Equations) -> Peer:
    """SymForce's prediction and innovations, Joseph's form in loops."""
    made = Straight(p, by_symforce, packed=False)
    updates = "".join(made.joseph(s) for s in p.sensors)
    return Peer(JOSEPH.replace("N_", str(p.n)) + made.predict() + updates, packed=False)


def tiny(p: Equations) -> Peer:
    """Dense matrices throughout."""
    made = Straight(p, by_sympy, packed=False)
    updates = "".join(made.whole(s) for s in p.sensors)
    return Peer(DENSE.replace("N_", str(p.n)) + made.dense_predict() + updates, packed=False)


def casadi(p: Equations) -> Peer:
    """One graph a routine; what it returns is copied back."""
    import casadi as ca

    known, half = ca.SX.sym("known", len(p.known)), ca.SX.sym("P", len(p.entries))
    P = ca.SX(p.n, p.n)
    for k, (i, j) in enumerate(p.entries):
        P[i, j] = P[j, i] = half[k]
    symbols = [known[k] for k in range(known.shape[0])]

    def of(expressions: Sequence[sp.Expr], more: Sequence[sp.Symbol] = (), values: Sequence[Any] = ()) -> Any:
        made = sp.lambdify([*p.known, *more], list(expressions), modules=[{"sqrt": ca.sqrt}])(
            *symbols, *values
        )
        return ca.vertcat(*made)

    def matrix(M: sp.Matrix) -> Any:
        out = ca.SX(p.n, p.n)
        for k, e in enumerate(M):
            if e != 0:
                out[k // p.n, k % p.n] = of([p.plain(e)])
        return out

    Phi = matrix(p.Phi)
    functions = {"predict": ((known, half), of(p.step), Phi @ P @ Phi.T + matrix(p.Qd))}
    for sensor in p.sensors:
        h, rows, R = p.measurement(sensor)
        z, expected, new, dx = ca.SX.sym("z", len(h)), of(h), P, ca.SX(p.n, 1)
        for i, row in enumerate(rows):
            H = ca.SX(1, p.n)
            for j, e in row.items():
                H[0, j] = of([e])
            Ph = new @ H.T
            K = Ph / (H @ Ph + float(R[i]))
            dx, new = dx + K * (z[i] - expected[i] - H @ dx), new - K @ Ph.T
        values = [dx[k] for k in range(p.n)]
        functions[f"update_{sensor.name}"] = (known, half, z), of(p.corrected, p.dx, values), new
    text = ""
    for name, (arguments, x, P_new) in functions.items():
        packed = ca.vertcat(*(P_new[i, j] for i, j in p.entries))
        f = ca.Function(f"{name}_graph", list(arguments), ca.cse([x, packed]))
        with tempfile.TemporaryDirectory() as folder:
            options = {"casadi_real": "float", "with_header": False, "casadi_int": "int"}
            generator = ca.CodeGenerator(f"{name}.c", options)
            generator.add(f)
            made = Path(generator.generate(folder + "/")).read_text()
        text += "\n".join(line for line in made.replace("casadi_", f"{name}_").splitlines())
        text += called(p, name, len(arguments))
    return Peer("#define sqrt __builtin_sqrtf\n" + text.replace("#include <math.h>", ""))


def called(p: Equations, name: str, arguments: int) -> str:
    """A routine that hands state, inputs and constants to a graph of CasADi and copies the results back."""
    sizes = (("x", len(p.x)), ("in", len(p.inputs)), ("k", len(p.k)))
    load, at = "", 0
    for array, size in sizes:
        load += f"  for (int i = 0; i < {size}; i++) known[{at} + i] = {array}[i];\n"
        at += size
    given = ", ".join(["known", "P", "z"][:arguments])
    body = f"""  static float known[{at}], out[{len(p.entries)}], new_x[{len(p.x)}];
{load}  const float *arg[{arguments}] = {{{given}}}; float *res[2] = {{new_x, out}};
  (void){name}_graph(arg, res, 0, 0, 0);
  for (int i = 0; i < {len(p.x)}; i++) x[i] = new_x[i];
  for (int i = 0; i < {len(p.entries)}; i++) P[i] = out[i];
"""
    return "\n" + function(name, body)


PEERS: dict[str, Callable[[Equations], Peer]] = {
    "TinyEKF-like": tiny,
    "SymForce, fusion as in PX4": px4,
    "sympy dense + cse": lambda p: generated(p, by_sympy),
    "CasADi": casadi,
    "SymForce, fusion generated": lambda p: generated(p, by_symforce),
}
