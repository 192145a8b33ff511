"""The same covariance prediction from several generators, on one emulated core: what each costs.

Usage: python benchmarks/codegen.py [--docs] [MODEL ...]

Models are library names (ahrs6, ins15 and ins23 without an argument). Each generator gets the model's Phi and
Qd and writes C in single precision for ``P <- Phi P Phi' + Qd``; the C is compiled for a Cortex-M4F (clang -O2, no
contraction), run on the emulator, compared with double precision, and counted: executed flops, instructions,
stack, code, and the seconds of processor time that the generator took from Phi and Qd to C. CasADi and SymForce take
part where they are installed (``pip install casadi symforce``); both libraries' import time is not in the figure.
``--docs`` writes the table of ins15 and ins23 into ``docs/benchmarks.md``, with what kfgen leads or lags by.

The terms are equal: noise that turns with the body comes with R R' = I used up to all; P is the packed upper triangle
to all but the dense ones, and what a generator takes to get its numbers from there and back is counted.

Two bounds go with the flops. ``changes`` are the stored numbers that the step changes (entries of P's upper triangle, or
of U and D): a new value takes an operation at least, so nothing goes below one flop for each; ``each`` is the flops
over them. Much tighter, for P in place: a row of Phi with m entries beside the diagonal takes 2 m (n - 1) flops for the
row and 3 m for its diagonal, and noise one for each variance that it drives; entries of Phi and the rotation are free there.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import sympy as sp
from generator_table import Measured, write
from sympy.printing.c import C99CodePrinter

from kfgen.emit.ir.ir import Num, Ref, Routine
from kfgen.emit.ir.symbols import Atoms, transition
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.routines import Program
from kfgen.emit.targets.c import CPrinter
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.symbols.rotation import matrix_of
from kfgen.verify.emulated import CHIPS, Board


class FloatPrinter(C99CodePrinter):
    """Single precision, whole powers as products."""

    def _print_Pow(self, e: sp.Pow) -> str:
        base = self.parenthesize(e.base, 100)
        if e.exp.is_Integer and abs(e.exp) <= 4:
            product = "*".join([base] * abs(int(e.exp)))
            return f"({product})" if e.exp > 0 else f"(1.0f/({product}))"
        return f"__builtin_sqrtf({self._print(e.base)})"

    def _print_Float(self, e: sp.Float) -> str:
        text = f"{float(e):.9g}"
        return f"{text if '.' in text or 'e' in text else text + '.0'}f"

    def _print_Rational(self, e: sp.Rational) -> str:
        return self._print_Float(sp.Float(e))

    def _print_Integer(self, e: sp.Integer) -> str:
        return f"{int(e)}.0f"


def flops(e: sp.Expr) -> int:
    """``+ - * /`` of an expression as it is printed."""
    inner = sum(flops(a) for a in e.args)
    if e.is_Add:
        return inner + len(e.args) - 1
    if e.is_Mul:
        return inner + sum(1 for a in e.args if a != -1) - 1
    if e.is_Pow and e.exp.is_Integer:
        return flops(e.base) + abs(int(e.exp)) - 1 + int(bool(e.exp < 0))
    return inner


def stepped(model: str) -> DiscreteModel:
    """With biases that keep their value, for which each generator has the same to do: the noise of walks waits with `ud`."""
    return DiscreteModel(build(model, None, {"biases": "constant"}))


@dataclass
class Problem:
    """One model's step in symbols of its state, constants and inputs."""

    discrete: DiscreteModel

    def __post_init__(self) -> None:
        attitude = self.discrete.model.attitude
        assert attitude is not None
        self.rotation = dict(zip(attitude.nominal, matrix_of(attitude.quaternion), strict=True))
        # Of all alike: noise that turns with the body is written with R R' = I used up, which no generator finds.
        short = Atoms(self.discrete).orthonormal
        self.Phi, self.Qd = self.discrete.Phi, self.discrete.Qd.applyfunc(short)
        self.n = self.Phi.rows
        found = (self.Phi.free_symbols | self.Qd.free_symbols) - set(attitude.nominal)
        self.symbols = sorted(found | set(attitude.quaternion), key=str)
        self.entries = [(i, j) for i in range(self.n) for j in range(i, self.n)]

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers for the symbols, and a covariance, in single precision."""
        rng = np.random.default_rng(1)
        known = {c.name: c.value for c in self.discrete.model.constants} | {"dt": 0.01}
        x = np.array([known.get(s.name, rng.normal() * 0.3) for s in self.symbols])
        q = [k for k, s in enumerate(self.symbols) if s.name.startswith("q_")]
        x[q] /= np.linalg.norm(x[q])
        A = rng.normal(size=(self.n, 2 * self.n))
        return x.astype(np.float32), (A @ A.T / (2 * self.n)).astype(np.float32)

    def wanted(self, x: np.ndarray, P: np.ndarray) -> np.ndarray:
        """In double precision."""
        matrices = [self.Phi.subs(self.rotation), self.Qd.subs(self.rotation)]
        numbers = dict(zip(self.symbols, map(float, x), strict=True))
        Phi, Qd = (np.array(M.subs(numbers), float) for M in matrices)
        return np.asarray(Phi @ P.astype(float) @ Phi.T + Qd)


def changes(p: Problem, form: str) -> int:
    """Stored numbers that the step changes, by double precision."""
    x, P = p.values()
    old, new = P.astype(float), p.wanted(x, P)
    if form == "ud":
        a, b = factors(old), factors(new)
        return int((np.abs(b - a) > 1e-12 * np.abs(a)).sum())
    return int((old != new)[np.triu_indices(p.n)].sum())


@dataclass(frozen=True)
class Code:
    """What a generator wrote: C that changes ``P`` (its packed upper triangle, or all of it) from ``x``, and its flops."""

    text: str
    flops: int
    packed: bool = True


def unpacked(p: Problem) -> str:
    """The symbols as locals."""
    return "".join(f"  const float {s.name} = in[{k}]; (void){s.name};\n" for k, s in enumerate(p.symbols))


def straight(p: Problem, outputs: Sequence[sp.Expr], store: Callable[[int, str], str]) -> tuple[str, int]:
    """Statements for expressions by sympy's cse, and their flops."""
    shared, reduced = sp.cse(outputs, symbols=sp.numbered_symbols("t_"), order="none")
    text = FloatPrinter()
    lines = [f"  const float {s} = {text.doprint(e)};" for s, e in shared]
    lines += [f"  {store(k, text.doprint(e))}" for k, e in enumerate(reduced)]
    return "\n".join(lines) + "\n", sum(flops(e) for _, e in shared) + sum(map(flops, reduced))


def covariance(p: Problem) -> sp.Matrix:
    """P in symbols, both halves the same."""
    return sp.Matrix(p.n, p.n, lambda i, j: sp.Symbol(f"P_{min(i, j)}_{max(i, j)}"))


def loaded(p: Problem) -> str:
    """The upper half of P as locals, from the packed triangle that kfgen's filters have too."""
    return "".join(f"  const float P_{i}_{j} = P[{k}];\n" for k, (i, j) in enumerate(p.entries))


def stored(k: int, text: str) -> str:
    """An element of the new P."""
    return f"P[{k}] = {text};"


def sympy_dense(p: Problem) -> Code:
    """sympy: the product written out, then common subexpressions."""
    Phi, Qd = p.Phi.subs(p.rotation), p.Qd.subs(p.rotation)
    new = Phi * covariance(p) * Phi.T + Qd
    body, count = straight(p, [new[i, j] for i, j in p.entries], stored)
    return Code(f"static void predict(void) {{\n{unpacked(p)}{loaded(p)}{body}}}\n", count)


def dense(p: Problem, multiply: str) -> Code:
    """F and Q as full matrices, then loops."""
    Phi, Qd = p.Phi.subs(p.rotation), p.Qd.subs(p.rotation)
    places = [("F", k, e) for k, e in enumerate(Phi) if e != 0] + [
        ("Q", k, e) for k, e in enumerate(Qd) if e != 0
    ]
    body, count = straight(p, [e for *_, e in places], lambda k, t: f"{places[k][0]}[{places[k][1]}] = {t};")
    n = p.n
    buffers = f"  static float F[{n * n}], Q[{n * n}];\n"
    text = f"static void predict(void) {{\n{unpacked(p)}{buffers}{body}{multiply.replace('N_', str(n))}}}\n"
    return Code(text, count + 2 * n * n * (2 * n - 1) + n * n, packed=False)


def loops(p: Problem) -> Code:
    """Dense loops: T = F P, P = T F' + Q."""
    return dense(
        p,
        """  float T[N_ * N_];
  for (int i = 0; i < N_; i++) for (int j = 0; j < N_; j++) {
    float s = 0.0f; for (int k = 0; k < N_; k++) s += F[i * N_ + k] * P[k * N_ + j]; T[i * N_ + j] = s; }
  for (int i = 0; i < N_; i++) for (int j = 0; j < N_; j++) {
    float s = 0.0f; for (int k = 0; k < N_; k++) s += T[i * N_ + k] * F[j * N_ + k]; P[i * N_ + j] = s + Q[i * N_ + j]; }
""",
    )


def tiny(p: Problem) -> Code:
    """The same as a small library does it: product, transpose, product and sum, each with a buffer."""
    return dense(
        p,
        """  float FP[N_ * N_], Ft[N_ * N_], FPFt[N_ * N_];
  multiply(F, P, FP, N_); transpose(F, Ft, N_); multiply(FP, Ft, FPFt, N_);
  for (int i = 0; i < N_ * N_; i++) P[i] = FPFt[i] + Q[i];
""",
    )


LIBRARY = """
static __attribute__((noinline)) void multiply(const float *a, const float *b, float *c, int n) {
  for (int i = 0; i < n; i++) for (int j = 0; j < n; j++) {
    c[i * n + j] = 0.0f; for (int k = 0; k < n; k++) c[i * n + j] += a[i * n + k] * b[k * n + j]; } }
static __attribute__((noinline)) void transpose(const float *a, float *b, int n) {
  for (int i = 0; i < n; i++) for (int j = 0; j < n; j++) b[j * n + i] = a[i * n + j]; }
"""


def casadi(p: Problem) -> Code:
    """CasADi: a graph that shares everything, symmetric P, out of place: what it returns is copied back."""
    import casadi as ca

    x = ca.SX.sym("x", len(p.symbols))
    half = ca.SX.sym("P", len(p.entries))
    P = ca.SX(p.n, p.n)
    for k, (i, j) in enumerate(p.entries):
        P[i, j] = P[j, i] = half[k]
    Phi, Qd = (ca.SX(p.n, p.n) for _ in range(2))
    symbols = [x[k] for k in range(x.shape[0])]
    for M, source in ((Phi, p.Phi), (Qd, p.Qd)):
        for k, e in enumerate(source.subs(p.rotation)):
            if e != 0:
                M[k // p.n, k % p.n] = sp.lambdify(p.symbols, e, modules=[{"sqrt": ca.sqrt}])(*symbols)
    new = Phi @ P @ Phi.T + Qd
    f = ca.Function("step", [x, half], [ca.cse(ca.vertcat(*(new[i, j] for i, j in p.entries)))])
    with tempfile.TemporaryDirectory() as folder:
        generator = ca.CodeGenerator("step.c", {"casadi_real": "float", "with_header": False})
        generator.add(f)
        text = Path(generator.generate(folder + "/")).read_text()
    text = text.replace("#include <math.h>", "#define sqrt __builtin_sqrtf")
    call = f"""static void predict(void) {{
  static float out[{len(p.entries)}];
  const float *arg[2] = {{in, P}}; float *res[1] = {{out}};
  (void)step(arg, res, 0, 0, 0);
  for (int i = 0; i < {len(p.entries)}; i++) P[i] = out[i];
}}
"""
    counted = (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_TWICE)
    count = sum(f.instruction_id(k) in counted for k in range(f.n_instructions()))
    return Code(text + call, count)


def symforce(p: Problem) -> Code:
    """SymForce: its own symbols and its own common subexpressions, P as its users write it."""
    import symforce.symbolic as sf

    symbols = [sf.Symbol(s.name) for s in p.symbols]
    names = [sf.Symbol(f"P_{i}_{j}") for i, j in p.entries]
    P, Phi, Qd = (sf.Matrix(p.n, p.n) for _ in range(3))
    for s, (i, j) in zip(names, p.entries, strict=True):
        P[i, j] = P[j, i] = s
    for M, source in ((Phi, p.Phi), (Qd, p.Qd)):
        for k, e in enumerate(source.subs(p.rotation)):
            if e != 0:
                M[k // p.n, k % p.n] = sp.lambdify(p.symbols, e, modules=[{"sqrt": sf.sqrt}])(*symbols)
    new = Phi * P * Phi.T + Qd
    shared, reduced = sf.sympy.cse([new[i, j] for i, j in p.entries])
    text = FloatPrinter()
    known = {s.name: s for s in p.symbols}
    back_to = lambda e: sp.sympify(str(e), locals=known)  # noqa: E731
    pairs = [(back_to(s), back_to(e)) for s, e in shared]
    out = [back_to(e) for e in reduced]
    lines = [f"  const float {s} = {text.doprint(e)};" for s, e in pairs]
    lines += [f"  {stored(k, text.doprint(e))}" for k, e in enumerate(out)]
    body = "\n".join(lines)
    count = sum(flops(e) for _, e in pairs) + sum(map(flops, out))
    return Code(f"static void predict(void) {{\n{unpacked(p)}{loaded(p)}{body}\n}}\n", count)


def kfgen(p: Problem, form: str = "p") -> Code:
    """The covariance part of what kfgen emits."""
    program = Program(p.discrete, form)
    rows, noise = transition(p.discrete, program.atoms)
    lower = program.lowering()
    # Densities as numbers, as the others have them; in a header they are settings, which compilers fold.
    lower.places |= {s.name: Num(float(v)) for s, v in p.discrete.named_noise[1].values()}
    flat = [e for row in rows.values() for e in row.values()] + list(noise.values())
    body = program.atoms.make(lower, flat)
    values, statements = lower.many(flat)
    body += statements
    atoms = []
    for value in values:
        atom, made = lower.let(value, "f")
        atoms.append(atom)
        body += made
    stream = iter(atoms)
    Phi = {i: {j: next(stream) for j in row} for i, row in rows.items()}
    Qd = {key: next(stream) for key in noise}
    body += program.covariance.predict(Phi, Qd)
    step = Routine("predict", "", program.predict.arguments, tidy(body), program.covariance.predict_scratch)
    size = program.covariance.size
    stored = f"static struct {{ float x[64]; float {program.covariance.ARRAY}[{size}]; float k[16]; }} state, *const kf = &state;\n"
    where = lower.places
    fixed = []
    for k, s in enumerate(p.symbols):
        place = where.get(s.name)
        if isinstance(place, Ref) and place.name in ("x", "k"):
            fixed.append(f"  state.{place.name}[{place.index}] = in[{k}];")
    given = {}
    for k, s in enumerate(p.symbols):
        place = where.get(s.name)
        if isinstance(place, Ref) and place.name not in ("x", "k"):
            given[place.name, place.index] = k
    arrays = "".join(
        f"  const float {a.name}[{a.size}] = {{{', '.join(f'in[{given[a.name, i]}]' if (a.name, i) in given else '0.0f' for i in range(a.size))}}}; (void){a.name};\n"
        if a.size
        else f"  const float {a.name} = in[{given[a.name, None]}];\n"
        for a in step.arguments
    )
    put = "".join(f"  state.{program.covariance.ARRAY}[{k}] = start[{k}];\n" for k in range(size))
    get = "".join(f"  P[{k}] = state.{program.covariance.ARRAY}[{k}];\n" for k in range(len(p.entries)))
    text = f"""{stored}static float start[{size}];
void load(void); void unload(void);
void load(void) {{
{chr(10).join(fixed)}
{put}}}
static void predict(void) {{
{arrays}{CPrinter(program).body(step)}
}}
void unload(void) {{
{get}}}
"""
    return Code(text, step.operations)


def kfgen_ud(p: Problem) -> Code:
    """The same on the factors U and D."""
    return kfgen(p, "ud")


GENERATORS: dict[str, Callable[[Problem], Code]] = {
    "TinyEKF-like": tiny,
    "dense loops": loops,
    "sympy dense + cse": sympy_dense,
    "SymForce": symforce,
    "CasADi": casadi,
    "kfgen p": kfgen,
    "kfgen ud": kfgen_ud,
}
NEEDS = {"SymForce": "symforce", "CasADi": "casadi"}


def source(p: Problem, code: Code) -> str:
    """The whole program: variables, the generated function, an entry."""
    own = "load" in code.text
    keep = "(const void *)call_predict, (const void *)in, (const void *)P"
    keep += ", (const void *)load, (const void *)unload, (const void *)start" if own else ""
    return f"""float in[{len(p.symbols)}];
float P[{p.n * p.n}];
{LIBRARY if "multiply(" in code.text else ""}
{code.text}
void call_predict(void);
void call_predict(void) {{ predict(); }}
int main(void);
int main(void) {{ return 0; }}
__attribute__((section(".vectors"), used)) const void *const vectors[] = {{ {keep} }};
"""


def factors(P: np.ndarray) -> np.ndarray:
    """U with D on its diagonal, packed."""
    L = np.linalg.cholesky(P.astype(float)[::-1, ::-1])[::-1, ::-1]
    U = L / np.diag(L)
    np.fill_diagonal(U, np.diag(L) ** 2)
    return U[np.triu_indices(len(P))]


def measure(p: Problem, name: str) -> Measured:
    """One row of the table."""
    began = time.process_time()
    code = GENERATORS[name](p)
    seconds = time.process_time() - began
    x, P = p.values()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "step.c"
        path.write_text(source(p, code))
        board = Board(CHIPS["m4f"], path, Path(folder), Path(folder))
        board.write("in", x)
        upper = np.triu_indices(p.n)
        board.write("P", P[upper] if code.packed else P)
        own = "load" in board.symbols
        if own:
            start = factors(P) if name.endswith("ud") else P[upper]
            board.write("start", start.astype(np.float32))
            board.call("load")
        board.call("call_predict")
        if own:
            board.call("unload")
        read = np.frombuffer(board.read("P", P.nbytes), np.float32).astype(float)
        got = read.reshape(P.shape)
        if code.packed:
            got = np.zeros(P.shape)
            got[upper] = read[: len(upper[0])]
            got = got if name.endswith("ud") else got + np.triu(got, 1).T
        cost = board.cost()
        size = sum(board.sizes.get(f, 0) for f in FUNCTIONS)
    if name.endswith("ud"):
        U = np.triu(got, 1) + np.eye(p.n)
        got = U @ np.diag(np.diag(got)) @ U.T
    wanted = p.wanted(x, P)
    sd = np.sqrt(np.diag(wanted))
    error = np.abs((got - wanted) / np.outer(sd, sd)).max()
    assert error < 1e-5, f"{name} is wrong by {error:.2g}"
    least = changes(p, "ud" if name.endswith("ud") else "p")
    called, stack = cost.instructions["call_predict"], cost.stacks["call_predict"]
    return Measured(name, code.flops, least, called, stack, size, seconds, float(error))


FUNCTIONS = ("call_predict", "predict", "multiply", "transpose", "step", "casadi_f0")
"""Whose code counts, as far as the compiler has left them on their own."""


def bound(p: Problem) -> int:
    """Flops below which no in-place elementary congruence goes: entries of Phi free, noise only added."""
    off = [sum(1 for j in range(p.n) if j != i and p.Phi[i, j] != 0) for i in range(p.n)]
    rows = sum(2 * m * (p.n - 1) + 3 * m for m in off)
    return rows + sum(1 for i in range(p.n) if p.Qd[i, i] != 0)


def main() -> None:
    """The table of each model."""
    docs, words = "--docs" in sys.argv, [w for w in sys.argv[1:] if w != "--docs"]
    load = os.getloadavg()[0]
    found: dict[str, list[Measured]] = {}
    bounds: dict[str, int] = {}
    for model in words or (["ins15", "ins23"] if docs else ["ahrs6", "ins15", "ins23"]):
        p = Problem(stepped(model))
        bounds[model], found[model] = bound(p), []
        print(
            f"{model}: {p.n} states; an elementary congruence cannot do with less than {bounds[model]} flops, entries of Phi free"
        )
        print("  generator            flops  changes   each  M4F ins   stack    code  gen [cpu s]  error")
        for name in GENERATORS:
            if find_spec(NEEDS.get(name, "sympy")) is None:
                print(f"  {name:18} not installed")
                continue
            found[model].append(measure(p, name))
            print(found[model][-1].line, flush=True)
    if docs:
        write(found, bounds, load)


if __name__ == "__main__":
    main()
