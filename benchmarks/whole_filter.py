"""The same whole filter from several generators, on one emulated core: what each routine and a second of it cost.

Usage: python benchmarks/whole_filter.py [--docs] [MODEL ...]

Models are library names (ahrs6, ins15 and ins23 without an argument). A filter is the prediction of state and covariance
and the fusion of each sensor's sample: innovation, Jacobian, gain, covariance, correction of the state. All get the
same equations (step, Phi, Qd with R R' = I used up, expected measurements and H, correction), in single precision, and
the covariance as its packed upper triangle but where a peer stores all of it; what is packed or copied is counted. A
sample's rows are fused one by one, with the innovation of a later row at the corrected state, but for TinyEKF's,
which inverts the covariance of the whole sample. The results of each routine are compared with double precision.

Of SymForce there are two filters: the fusion generated as well (row by row, in place), and the fusion as PX4 has it, with
generated innovations and Jacobians and Joseph's form in loops over the full matrix. CasADi's is one graph a routine.
``kfgen`` is the equations alone, as the others have them; ``kfgen, emitted`` is the call of the emitted header, with limits
of inputs, gate, supervisor and the looks at the new state and covariance, which no other generator writes.

Counted on the emulated Cortex-M4F (clang -O2, no contraction): executed additions, subtractions, products, divisions and
roots, and executed instructions, of one accepted sample each. A second has 100 predictions, and samples at `RATES`.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from codegen import NEEDS, factors
from filter_equations import Equations
from generator_table import Cost, write_whole
from peer_filters import PEERS, function

from kfgen.emit.covariance.scalars import fused
from kfgen.emit.ir.ir import Argument, Routine, Scratch, Stmt
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.predict import propagated
from kfgen.emit.routines import Program
from kfgen.emit.state import inject
from kfgen.emit.targets.c import CPrinter, call_arguments, header
from kfgen.emit.update import linearised, variances
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.parts.sensors import Sensor
from kfgen.verify.core import place_of
from kfgen.verify.emulated import CHIPS, Board

RATES = {
    "predict": 100,
    "accel": 100,
    "mag": 50,
    "gnss_position": 10,
    "gnss_velocity": 10,
    "airspeed": 10,
}
"""Calls in a second of flight."""
TOLERANCE = 2e-5
"""Largest error of a state over its standard deviation, and of the covariance over those of its states."""
FUSED = {0b0000: 2, 0b0001: 2, 0b1001: 2, 0b1010: 2}
"""Operations of products that are added, by their opcode in the instruction's word."""
ONE = {0b0010, 0b0011, 0b1000}
"""Opcodes of a product, of a sum or difference, and of a quotient."""
OTHER, ROOT = 0b1011, 0b0001


def arithmetic(code: np.ndarray, long: Callable[[int], bool]) -> int:
    """Operations of the floating-point unit in a block of Thumb code: sums, products, quotients and roots."""
    at = found = 0
    while at < code.size:
        first = int(code[at])
        if not long(first):
            at += 1
            continue
        second = int(code[at + 1])
        at += 2
        if first & 0xFF00 != 0xEE00 or second & 0x0E10 != 0x0A00:
            continue
        opcode = first >> 4 & 0b1011
        if opcode == OTHER:
            found += int(first & 0xF == ROOT and second >> 6 & 0b11 == 0b11)
        else:
            found += FUSED.get(opcode, int(opcode in ONE))
    return found


class CountingBoard(Board):
    """A board that counts floating-point operations beside instructions."""

    def __init__(self, source: Path, folder: Path) -> None:
        super().__init__(CHIPS["m4f"], source, folder, folder)
        self.flops = 0
        self._found: dict[tuple[int, int], int] = {}

    def _block(self, uc: Any, address: int, size: int, data: object) -> None:
        super()._block(uc, address, size, data)
        if (address, size) not in self._found:
            code = np.frombuffer(uc.mem_read(address, size), np.uint16)
            self._found[address, size] = arithmetic(code, self._family.long)
        self.flops += self._found[address, size]


OWN = {"kfgen p": ("p", False), "kfgen ud": ("ud", False), "kfgen p, emitted": ("p", True), "kfgen ud, emitted": ("ud", True)}  # fmt: skip
"""Form of the covariance, and whether the emitted call is measured."""


def bare(program: Program, name: str, arguments: Sequence[Argument], body: list[Stmt], scratch: Sequence[Scratch], more: str) -> str:  # fmt: skip
    """A routine of equations alone, on the emitted filter's memory."""
    routine = Routine(name, "", tuple(arguments), tidy(tuple(body)), tuple(scratch))
    arrays = "".join(f"  float {s.name}[{s.size}] = {{0}}; (void){s.name};\n" for s in scratch)
    given = [f"const float {a.name}[{a.size}]" if a.size else f"float {a.name}" for a in arguments]
    head = f"static void bare_{name}({', '.join([f'{program.name}_t *kf', *given])})"
    status = "  kf_status_t status = KF_OK; (void)status;\n"
    return f"{head} {{\n{status}{more}{arrays}{CPrinter(program).body(routine)}\n}}\n"


def kfgen_text(program: Program, emitted: bool) -> str:
    """The emitted header, its equations alone, and calls."""
    name = program.name
    out, calls = "", ""
    sensors = {f"update_{s.name}": s for s in program.discrete.model.sensors}
    for routine in program.routines[1:]:
        if routine.name == "predict":
            body, scratch = propagated(program, guarded=False), program.covariance.predict_scratch
            out += bare(program, "predict", routine.arguments, body, scratch, "")
        else:
            sensor = sensors[routine.name]
            body, rows, y = linearised(program, sensor, program.lowering())
            for i, (H, residual) in enumerate(zip(rows, y, strict=True)):
                body += fused(program.covariance, i, H, residual, variances(program, sensor).default[i])
            body += inject(program)
            scratch = (Scratch("dx", program.n), *program.covariance.scratch)
            out += bare(program, routine.name, routine.required, body, scratch, "")
        prefix = name if emitted else "bare"
        place = "in" if routine.name == "predict" else "z"
        given = call_arguments(routine).replace("in[", f"{place}[")
        calls += function(routine.name, f"  (void){prefix}_{routine.name}({given});\n")
    begin = f"static {name}_t kf;\nvoid begin(void); void begin(void) {{ {name}_init(&kf); }}\n"
    return f'#include "{name}.h"\n{out}{begin}{calls}'


def program_text(p: Equations, text: str, own: bool, names: Sequence[str]) -> str:
    """The whole program: variables, routines, an entry for each."""
    constants = ", ".join(f"{float(c.value):.9g}f" for c in p.discrete.model.constants) or "0.0f"
    kept = ["in", "z", *(["kf", "begin"] if own else ["P", "x", "k"]), *(f"call_{n}" for n in names)]
    variables = f"float in[{len(p.inputs)}];\nfloat z[8];\n"
    if not own:
        variables += f"float x[{len(p.x)}];\nfloat P[{p.n * p.n}];\n"
        variables += f"float k[{max(len(p.k), 1)}] = {{{constants}}};\n"
    entries = "".join(f"void call_{n}(void);\nvoid call_{n}(void) {{ {n}(); }}\n" for n in names)
    text = text.replace("static " + f"{p.discrete.model.name}_t kf;", f"{p.discrete.model.name}_t kf;")
    table = ", ".join(f"(const void *){'' if n.startswith(('call_', 'begin')) else '&'}{n}" for n in kept)
    return f"""{variables}{text}{entries}int main(void);
int main(void) {{ return 0; }}
__attribute__((section(".vectors"), used)) const void *const vectors[] = {{ {table} }};
"""


class Measurement:
    """One generator's filter on the board.

    Parameters
    ----------
    p : Equations
    name : str
        Of the generator.
    """

    def __init__(self, p: Equations, name: str) -> None:
        self.p, self.name = p, name
        self.given, self.P = p.values()
        self.names = ["predict", *(f"update_{s.name}" for s in p.sensors)]
        self.own = OWN.get(name)

    def costs(self) -> Iterator[tuple[str, Cost]]:
        """Each routine with its cost, once its result is right."""
        p = self.p
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            self.program = Program(p.discrete, self.own[0]) if self.own else None
            if self.own and self.program:
                self.packed, text = True, kfgen_text(self.program, self.own[1])
                (folder / f"{self.program.name}.h").write_text(header(self.program))
            else:
                peer = PEERS[self.name](p)
                self.packed, text = peer.packed, peer.text
            path = folder / "filter.c"
            path.write_text(program_text(p, text, bool(self.own), self.names))
            for name in self.names:
                board = CountingBoard(path, folder)
                sensor = next((s for s in p.sensors if f"update_{s.name}" == name), None)
                yield name, self.cost(board, name, sensor)

    def cost(self, board: CountingBoard, name: str, sensor: Sensor | None) -> Cost:
        """One call."""
        p = self.p
        if sensor is None:
            x, P = p.predicted(self.given, self.P)
        else:
            z, x, P = p.updated(sensor, self.given, self.P)
            board.write("z", z)
        board.write("in", self.given[len(p.x) : len(p.x) + len(p.inputs)])
        self.put(board)
        board.flops = 0
        board.call(f"call_{name}")
        sd = np.sqrt(np.diag(P))
        got_x, got_P = self.get(board)
        wrong = max(
            np.abs((got_P - P) / np.outer(sd, sd)).max(), np.abs(got_x - x).max() / max(1.0, np.abs(x).max())
        )
        assert wrong < TOLERANCE, f"{name} of {self.name} is wrong by {wrong:.2g}"
        cost = board.cost()
        call = f"call_{name}"
        return Cost(board.flops, cost.instructions[call], cost.stacks[call], board.sizes[".text"])

    def put(self, board: CountingBoard) -> None:
        """State and covariance onto the board."""
        upper = np.triu_indices(self.p.n)
        x = self.given[: len(self.p.x)]
        if not self.program:
            board.write("x", x)
            board.write("P", self.P[upper] if self.packed else self.P)
            return
        board.call("begin")
        order = list(self.program.covariance.order)
        P = self.P[np.ix_(order, order)]
        stored = factors(P).astype(np.float32) if self.program.form == "ud" else P[upper]
        board.write("kf", x, place_of(self.program, "x"))
        board.write("kf", stored, place_of(self.program, self.program.covariance.ARRAY))

    def get(self, board: CountingBoard) -> tuple[np.ndarray, np.ndarray]:
        """State and covariance from the board."""
        n, nx = self.p.n, len(self.p.x)
        if not self.program:
            x = np.frombuffer(board.read("x", 4 * nx), np.float32)
            P = np.frombuffer(board.read("P", 4 * n * n), np.float32)
            if self.packed:
                full = np.zeros((n, n))
                full[np.triu_indices(n)] = P[: n * (n + 1) // 2]
                P = full + np.triu(full, 1).T
            return x.astype(float), P.reshape(n, n).astype(float)
        total = sum(size for size, _ in self.program.arrays.values())
        kf = np.frombuffer(board.read("kf", 4 * total), np.float32)
        at, first = place_of(self.program, self.program.covariance.ARRAY), place_of(self.program, "x")
        stored = kf[at : at + n * (n + 1) // 2].astype(float)
        return kf[first : first + nx].astype(float), np.array(self.program.covariance.matrix(list(stored)))


def main() -> None:
    """The table of each model."""
    docs, words = "--docs" in sys.argv, [w for w in sys.argv[1:] if w != "--docs"]
    load = os.getloadavg()[0]
    found: dict[str, dict[str, dict[str, Cost]]] = {}
    for model in words or ["ahrs6", "ins15", "ins23"]:
        p = Equations(DiscreteModel(build(model)))
        found[model] = {}
        for name in [*PEERS, *OWN]:
            needs = NEEDS.get(name.split(",")[0])
            if needs and find_spec(needs) is None:
                print(f"{model} {name}: not installed", flush=True)
                continue
            found[model][name] = dict(Measurement(p, name).costs())
            print(
                model, name, {n: (c.flops, c.instructions) for n, c in found[model][name].items()}, flush=True
            )
    if docs:
        write_whole(found, RATES, load)


if __name__ == "__main__":
    main()
