"""Emulated microcontrollers: clang compiles, unicorn runs, every instruction is counted.

Counts are of executed instructions, the same on every machine; they are not cycles.
"""

from __future__ import annotations

import importlib.util
import subprocess
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import CheckFailed
from kfgen.emit.geodetic.origin import Border
from kfgen.emit.routines import Program
from kfgen.emit.scenario import REFUSED
from kfgen.emit.targets.templates import template_folder
from kfgen.verify.core import DRIVEN, InstructionCount, Words, place_of, write_harness
from kfgen.verify.host import contraction, missing
from kfgen.verify.zig import command, environment

FLASH, RAM, SIZE = 0x08000000, 0x20000000, 0x100000
STACK_TOP, STACK_SIZE, PAINT = RAM + 0x40000, 0x8000, 0xA5
RETURN = FLASH + 0xFFFF0
COUNTED_CALLS_PER_ROUTINE = 6
"""Calls of each routine that are counted; the rest runs without hooks, but for those about which noise that waits
comes in."""

FLAGS = (
    "-std=c99",
    "-O2",
    "-fno-math-errno",
    "-ffreestanding",
    "-fno-unwind-tables",
    "-fno-asynchronous-unwind-tables",
    "-ffunction-sections",
    "-fno-stack-protector",
    "-fno-sanitize=all",
    "-g0",
)


@dataclass(frozen=True)
class Family:
    """A family of cores as the emulator has it.

    Parameters
    ----------
    arch, modes, constants : str
        The emulator's names: architecture, its modes, the module of its registers.
    stack, link : str
        Registers.
    thumb_bit : int
        Added to the address of a routine.
    wait : bytes
        An instruction that jumps to itself.
    prepare : tuple of (str, int)
        Bits that are set in registers before the first call.
    """

    arch: str
    modes: tuple[str, ...]
    constants: str
    stack: str
    link: str
    thumb_bit: int
    wait: bytes
    long: Callable[[int], bool]
    """Whether an instruction that begins with this half word has four bytes."""
    prepare: tuple[tuple[str, int], ...] = ()


ARM = Family(
    "UC_ARCH_ARM",
    ("UC_MODE_THUMB", "UC_MODE_MCLASS"),
    "arm_const",
    "UC_ARM_REG_SP",
    "UC_ARM_REG_LR",
    1,
    b"\xfe\xe7",
    lambda half: half >> 11 in (0b11101, 0b11110, 0b11111),
)
RISCV = Family(
    "UC_ARCH_RISCV",
    ("UC_MODE_RISCV32",),
    "riscv_const",
    "UC_RISCV_REG_SP",
    "UC_RISCV_REG_RA",
    0,
    b"\x6f\x00\x00\x00",
    lambda half: half & 3 == 3,
    (("UC_RISCV_REG_MSTATUS", 0x6000),),
)


@dataclass(frozen=True)
class Chip:
    """A core: how it is compiled for, and which model the emulator takes."""

    title: str
    target: str
    cpu: str
    family: Family
    model: str = ""
    flags: tuple[str, ...] = ()


_HARD, _SOFT, _RISCV = "thumb-freestanding-eabihf", "thumb-freestanding-eabi", "riscv32-freestanding-none"
CHIPS: dict[str, Chip] = {
    "m4f": Chip("Cortex-M4F", _HARD, "cortex_m4+vfp4d16sp", ARM, "UC_CPU_ARM_CORTEX_M4"),
    "m7f": Chip("Cortex-M7F", _HARD, "cortex_m7+fp_armv8d16sp", ARM, "UC_CPU_ARM_CORTEX_M7"),
    "m33f": Chip("Cortex-M33F", _HARD, "cortex_m33+fp_armv8d16sp", ARM, "UC_CPU_ARM_CORTEX_M33"),
    "m4": Chip("Cortex-M4, soft float", _SOFT, "cortex_m4", ARM, "UC_CPU_ARM_CORTEX_M4"),
    "m0": Chip("Cortex-M0+, soft float", _SOFT, "cortex_m0plus", ARM, "UC_CPU_ARM_CORTEX_M0"),
    "rv32imfc": Chip("RV32IMFC", _RISCV, "generic_rv32+m+a+f+c", RISCV, flags=("-mabi=ilp32f",)),
    "rv32imc": Chip("RV32IMC, soft float", _RISCV, "generic_rv32+m+a+c", RISCV, flags=("-mabi=ilp32",)),
}


class Board:
    """A chip with a program on it, whose functions are called one by one and counted.

    Parameters
    ----------
    chip : Chip
    source : Path
        C, with a table ``vectors`` of what it must keep, as the harness has it.
    folder : Path
        Of the headers that it includes.
    scratch : Path
        Where the program is built.
    contract : bool
        Fused products and sums.
    counted : callable
        Whether a call is counted, by its function and its number, from zero on.

    Raises
    ------
    MissingExtra
        There is no emulator or no cross compiler.
    CheckFailed
        The source does not compile.
    """

    def __init__(
        self,
        chip: Chip,
        source: Path,
        folder: Path,
        scratch: Path,
        contract: bool = False,
        counted: Callable[[str, int], bool] = lambda function, number: number < COUNTED_CALLS_PER_ROUTINE,
    ) -> None:
        for module in ("unicorn", "elftools"):
            if importlib.util.find_spec(module) is None:
                raise missing("pil", f"the emulator ({module})")
        elf = _build(chip, source, folder, scratch / "filter.elf", contract)
        self.symbols, segments, self.sizes = _load(elf)
        self._family = chip.family
        self._registers = importlib.import_module(f"unicorn.{chip.family.constants}")
        self._machine = _machine(chip, self._registers, segments)
        self._counted, self._calls = counted, Counter[str]()
        self._counts: dict[str, list[int]] = {}
        self._stacks: dict[str, int] = {}
        self._blocks: dict[tuple[int, int], int] = {}
        self._running = 0

    def write(self, symbol: str, values: NDArray[Any], first: int = 0) -> None:
        """Numbers into a variable, from its element `first` on.

        Parameters
        ----------
        symbol : str
            The variable's.
        values : ndarray
            In the type of the variable.
        first : int
            The element that gets the first of them.
        """
        self._machine.mem_write(self.symbols[symbol] + first * values.itemsize, values.tobytes())

    def read(self, symbol: str, size: int) -> bytes:
        """Bytes of a variable.

        Parameters
        ----------
        symbol : str
            The variable's.
        size : int
            [B]
        """
        return bytes(self._machine.mem_read(self.symbols[symbol], size))

    def call(self, function: str) -> None:
        """Run a function without arguments, and count it where it is one of the calls that are counted."""
        from unicorn import UC_HOOK_BLOCK

        uc, family = self._machine, self._family
        counts = self._counts.setdefault(function, [])
        hook = None
        number = self._calls[function]
        self._calls[function] = number + 1
        if self._counted(function, number):
            self._running = 0
            uc.ctl_flush_tb()  # blocks that were translated without a hook would not be counted
            hook = uc.hook_add(UC_HOOK_BLOCK, self._block)
            uc.mem_write(STACK_TOP - STACK_SIZE, bytes([PAINT]) * STACK_SIZE)
        uc.reg_write(getattr(self._registers, family.stack), STACK_TOP)
        uc.reg_write(getattr(self._registers, family.link), RETURN | family.thumb_bit)
        uc.emu_start(self.symbols[function] | family.thumb_bit, RETURN)
        if hook is not None:
            uc.hook_del(hook)
            counts.append(self._running)
            painted = np.frombuffer(uc.mem_read(STACK_TOP - STACK_SIZE, STACK_SIZE), np.uint8)
            touched = np.flatnonzero(painted != PAINT)
            deep = STACK_SIZE - int(touched[0]) if touched.size else 0
            self._stacks[function] = max(self._stacks.get(function, 0), deep)

    def _block(self, uc: Any, address: int, size: int, _: object) -> None:
        """Count the instructions of a translated block, of two or four bytes each."""
        if (address, size) not in self._blocks:
            code = np.frombuffer(uc.mem_read(address, size), np.uint16)
            count = at = 0
            while at < code.size:
                at += 2 if self._family.long(int(code[at])) else 1
                count += 1
            self._blocks[address, size] = count
        self._running += self._blocks[address, size]

    def cost(self) -> InstructionCount:
        """Executed instructions, stack and code of each function, and of all."""
        return InstructionCount(
            {f: max(c) for f, c in self._counts.items()},
            max(self._stacks.values(), default=0),
            self.sizes[".text"],
            dict(self._stacks),
            {f: self.sizes[f] for f in self._counts},
            {f: min(c) for f, c in self._counts.items()},
        )


class Emulated:
    """The filter on an emulated chip."""

    def __init__(
        self,
        chip: Chip,
        program: Program | Border,
        source: Path,
        scratch: Path,
        contract: bool = False,
        counted: Callable[[str, int], bool] | None = None,
    ) -> None:
        harness = write_harness(program, scratch, bare=True)
        self._board = Board(chip, harness, source, scratch, contract, counted or _counted(program))
        self._program, self._type = program, np.dtype(program.type)
        self._bytes = self._type.itemsize * program.word_count

    def call(self, routine: str, inputs: Sequence[float]) -> None:
        """Run one routine on the filter."""
        self._board.write("in", np.asarray(inputs, self._type))
        self._board.call(f"call_{routine}")

    def put(self, array: str, values: Sequence[float]) -> None:
        """Write the first numbers of one of the filter's arrays."""
        self._board.write(DRIVEN, np.asarray(values, self._type), place_of(self._program, array))

    def status(self) -> int:
        """Number of the status that the last call returned."""
        size = self._board.sizes["last_status"]
        return int.from_bytes(self._board.read("last_status", size), "little")

    def words(self) -> Words:
        """State and covariance as bit patterns."""
        return np.frombuffer(self._board.read(DRIVEN, self._bytes), f"u{self._type.itemsize}")

    def cost(self) -> InstructionCount:
        """Of each routine, and of all."""
        cost = self._board.cost()
        named = [
            {f.removeprefix("call_"): v for f, v in of.items()}
            for of in (cost.instructions, cost.stacks, cost.texts, cost.least)
        ]
        return InstructionCount(named[0], cost.stack_bytes, cost.text_bytes, *named[1:])


def _counted(program: Program | Border) -> Callable[[str, int], bool]:
    """The first calls, predictions in which noise that waits comes in (some are refused before), and behind the horizon."""
    if isinstance(program, Border):
        return lambda function, number: True
    due, delayed = program.settling, {f"call_{r.name}" for r in program.delayed}
    first = range(COUNTED_CALLS_PER_ROUTINE)
    noisy = range(due - len(program.slow) - 2, due + len(REFUSED) + 2) if due else ()
    return lambda function, number: (
        number in first or function in delayed or (function == "call_predict" and number in noisy)
    )


def _build(chip: Chip, source: Path, folder: Path, elf: Path, contract: bool) -> Path:
    call = [
        *command(),
        "-target",
        chip.target,
        f"-mcpu={chip.cpu}",
        *FLAGS,
        *chip.flags,
        contraction(contract),
        "-T",
        str(template_folder() / "verify" / "link.ld"),
        f"-I{folder}",
        str(source),
        "-o",
        str(elf),
    ]
    done = subprocess.run(call, capture_output=True, text=True, check=False, env=environment())
    if done.returncode:
        raise CheckFailed(f"{source.name} does not compile for {chip.title}: {done.stderr.strip()[:2000]}")
    return elf


def _load(elf: Path) -> tuple[dict[str, int], list[tuple[int, bytes]], dict[str, int]]:
    """Symbols, loadable segments, and the sizes of the functions and of all the code."""
    from elftools.elf.elffile import ELFFile

    with open(elf, "rb") as file:
        image = ELFFile(file)
        table = list(image.get_section_by_name(".symtab").iter_symbols())
        symbols = {
            s.name: int(s["st_value"]) & ~1 if s["st_info"]["type"] == "STT_FUNC" else int(s["st_value"])
            for s in table
        }
        segments = [
            (int(s["p_paddr"]), bytes(s.data()))
            for s in image.iter_segments()
            if s["p_type"] == "PT_LOAD" and s["p_filesz"] > 0
        ]
        sizes = {s.name: int(s["st_size"]) for s in table}
        sizes[".text"] = int(image.get_section_by_name(".text")["sh_size"])
        return symbols, segments, sizes


def _machine(chip: Chip, registers: Any, segments: list[tuple[int, bytes]]) -> Any:
    import unicorn

    family = chip.family
    mode = sum(getattr(unicorn, m) for m in family.modes)
    uc = unicorn.Uc(getattr(unicorn, family.arch), mode)
    if chip.model:
        uc.ctl_set_cpu_model(getattr(registers, chip.model))
    uc.mem_map(FLASH, SIZE)
    uc.mem_map(RAM, SIZE)
    uc.mem_write(RETURN, family.wait)
    for address, data in segments:
        uc.mem_write(address, data)
    for register, bits in family.prepare:
        number = getattr(registers, register)
        uc.reg_write(number, uc.reg_read(number) | bits)
    return uc
