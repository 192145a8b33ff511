"""Emulated microcontrollers: clang compiles, unicorn runs, every instruction is counted.

Counts are of executed instructions, the same on every machine; they are not cycles.
"""

from __future__ import annotations

import importlib.util
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kfgen.emit.covariance import packed_size
from kfgen.emit.routines import Program
from kfgen.emit.templates import template_folder
from kfgen.errors import CheckFailed
from kfgen.verify.core import Cost, Words, write_harness
from kfgen.verify.host import missing
from kfgen.verify.zig import command, environment

FLASH, RAM, SIZE = 0x08000000, 0x20000000, 0x100000
STACK_TOP, STACK_SIZE, PAINT = RAM + 0x40000, 0x8000, 0xA5
RETURN = FLASH + 0xFFFF0
COUNTED = 6
"""Calls of each routine that are counted; the rest runs without hooks."""

FLAGS = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
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
class Chip:
    """A Cortex-M core: how it is compiled for, and which model the emulator takes."""

    title: str
    target: str
    cpu: str
    model: str


CHIPS: dict[str, Chip] = {
    "m4f": Chip("Cortex-M4F", "thumb-freestanding-eabihf", "cortex_m4+vfp4d16sp", "UC_CPU_ARM_CORTEX_M4"),
    "m7f": Chip("Cortex-M7F", "thumb-freestanding-eabihf", "cortex_m7+fp_armv8d16sp", "UC_CPU_ARM_CORTEX_M7"),
    "m33f": Chip(
        "Cortex-M33F", "thumb-freestanding-eabihf", "cortex_m33+fp_armv8d16sp", "UC_CPU_ARM_CORTEX_M33"
    ),
    "m4": Chip("Cortex-M4, soft float", "thumb-freestanding-eabi", "cortex_m4", "UC_CPU_ARM_CORTEX_M4"),
    "m0": Chip("Cortex-M0+, soft float", "thumb-freestanding-eabi", "cortex_m0plus", "UC_CPU_ARM_CORTEX_M0"),
}


class Emulated:
    """The filter on an emulated chip."""

    def __init__(self, chip: Chip, program: Program, source: Path, scratch: Path) -> None:
        for module in ("unicorn", "elftools"):
            if importlib.util.find_spec(module) is None:
                raise missing("pil", f"the emulator ({module})")
        elf = _build(chip, program, source, scratch)
        self._program = program
        self._symbols, segments, self._text = _load(elf)
        self._count = len(program.discrete.nominal_names) + packed_size(program.n)
        self._machine = _machine(chip, segments)
        self._counts: dict[str, list[int]] = {}
        self._stack = 0
        self._blocks: dict[tuple[int, int], int] = {}
        self._running = 0

    def call(self, routine: str, inputs: Sequence[float]) -> None:
        """Run one routine on the filter."""
        from unicorn import UC_HOOK_BLOCK
        from unicorn import arm_const as arm

        uc = self._machine
        uc.mem_write(self._symbols["in"], np.asarray(inputs, np.float32).tobytes())
        counts = self._counts.setdefault(routine, [])
        hook = None
        if len(counts) < COUNTED:
            self._running = 0
            hook = uc.hook_add(UC_HOOK_BLOCK, self._block)
            uc.mem_write(STACK_TOP - STACK_SIZE, bytes([PAINT]) * STACK_SIZE)
        uc.reg_write(arm.UC_ARM_REG_SP, STACK_TOP)
        uc.reg_write(arm.UC_ARM_REG_LR, RETURN | 1)
        uc.emu_start(self._symbols[f"call_{routine}"] | 1, RETURN)
        if hook is not None:
            uc.hook_del(hook)
            counts.append(self._running)
            painted = np.frombuffer(uc.mem_read(STACK_TOP - STACK_SIZE, STACK_SIZE), np.uint8)
            touched = np.flatnonzero(painted != PAINT)
            self._stack = max(self._stack, STACK_SIZE - int(touched[0]) if touched.size else 0)

    def _block(self, uc: Any, address: int, size: int, _: object) -> None:
        """Count the instructions of a translated block: Thumb's are two or four bytes."""
        if (address, size) not in self._blocks:
            code = np.frombuffer(uc.mem_read(address, size), np.uint16)
            count = at = 0
            while at < code.size:
                at += 2 if int(code[at]) >> 11 in (0b11101, 0b11110, 0b11111) else 1
                count += 1
            self._blocks[address, size] = count
        self._running += self._blocks[address, size]

    def words(self) -> Words:
        """State and covariance as bit patterns."""
        return np.frombuffer(self._machine.mem_read(self._symbols["kf"], 4 * self._count), np.uint32).copy()

    def cost(self) -> Cost:
        """Executed instructions, deepest stack, size of the code."""
        return Cost({r: max(c) for r, c in self._counts.items()}, self._stack, self._text)


def _build(chip: Chip, program: Program, source: Path, scratch: Path) -> Path:
    harness = write_harness(program, scratch, bare=True)
    elf = scratch / "filter.elf"
    call = [
        *command(),
        "-target",
        chip.target,
        f"-mcpu={chip.cpu}",
        *FLAGS,
        "-T",
        str(template_folder() / "verify" / "link.ld"),
        f"-I{source}",
        str(harness),
        "-o",
        str(elf),
    ]
    done = subprocess.run(call, capture_output=True, text=True, check=False, env=environment())
    if done.returncode:
        raise CheckFailed(f"{program.name}.h does not compile for {chip.title}: {done.stderr.strip()[:2000]}")
    return elf


def _load(elf: Path) -> tuple[dict[str, int], list[tuple[int, bytes]], int]:
    """Symbols, loadable segments and the size of the code."""
    from elftools.elf.elffile import ELFFile

    with open(elf, "rb") as file:
        image = ELFFile(file)
        table = image.get_section_by_name(".symtab")
        symbols = {
            s.name: int(s["st_value"]) & ~1 if s["st_info"]["type"] == "STT_FUNC" else int(s["st_value"])
            for s in table.iter_symbols()
        }
        segments = [
            (int(s["p_paddr"]), bytes(s.data()))
            for s in image.iter_segments()
            if s["p_type"] == "PT_LOAD" and s["p_filesz"] > 0
        ]
        text = image.get_section_by_name(".text")
        return symbols, segments, int(text["sh_size"])


def _machine(chip: Chip, segments: list[tuple[int, bytes]]) -> Any:
    from unicorn import UC_ARCH_ARM, UC_MODE_MCLASS, UC_MODE_THUMB, Uc
    from unicorn import arm_const as arm

    uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
    uc.ctl_set_cpu_model(getattr(arm, chip.model))
    uc.mem_map(FLASH, SIZE)
    uc.mem_map(RAM, SIZE)
    uc.mem_write(RETURN, b"\xfe\xe7")
    for address, data in segments:
        uc.mem_write(address, data)
    return uc
