"""Compare the machine code of two functions, instruction by instruction, whatever their addresses.

Two builds of the same source differ in their addresses. So an address is compared by what lies
there:

- a branch within the function, by the instruction that it leads to;
- a call or a branch out of it, by the name of the function it leads to;
- data at an address relative to the instruction (rip), by its content where that is constant, such
  as a floating-point number of the source, and else not at all;
- data relative to another register, by the displacement, such as the offset of a struct's field;
- a number that is added, by its value; a large one is taken for the offset of a field where it
  grew by as much as a displacement in the same function. A large number that an index is multiplied
  by is taken for the size of a struct.

Functions that differ only in such offsets and sizes and in the names of callees execute the same
instructions, on data that lie elsewhere; they are told apart from those that changed. So are
functions that differ in how long an instruction is encoded, or in instructions that do nothing
(nop) and align others, because both follow from the size of displacements; and in the lines of
source code that MuJoCo passes to its allocator. Tables of branch targets (of a `switch`) are not
compared.

x86-64 only. Needs capstone.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Literal

import capstone
from capstone import x86

from mjbench.counts.records import CodeChange

# Functions that take the caller's line of source code, and the register of that argument, their
# fifth: mj_stackAllocInfo(d, bytes, alignment, caller, line) in MuJoCo's engine_memory.h.
_LINE_REGISTERS = {"mj_stackAllocInfo": x86.X86_REG_R8D, "stackalloc": x86.X86_REG_R8D}
# Smaller numbers are rather those of the source code than offsets of fields and sizes of structs.
MIN_LAYOUT_NUMBER = 256
_BRANCHES = frozenset((capstone.CS_GRP_JUMP, capstone.CS_GRP_CALL))


@dataclass(frozen=True, slots=True)
class Instruction:
    """What one instruction does, without addresses.

    Attributes:
      shape: the mnemonic and the operands; equal shapes do the same, perhaps to other data.
      displacements: of operands in memory, and large factors of 64-bit registers, such as the size
        of a struct.
      addends: large numbers added to 64-bit registers, such as the offset of a field.
      constants: read at addresses relative to the instruction; None where they are not constant.
      callee: name of the function that it calls or branches to; None for other instructions, and
        where the name is unknown.
      successor: number of the instruction in the same function that it branches to, not counting
        nops; None for other instructions.
    """

    shape: tuple[object, ...]
    size_bytes: int
    displacements: tuple[int, ...] = ()
    addends: tuple[int, ...] = ()
    constants: tuple[bytes | None, ...] = ()
    callee: str | None = None
    successor: int | None = None
    source_line: int | None = None  # that it passes to a function, to name it in a message

    @property
    def is_nop(self) -> bool:
        return not self.shape


@dataclass(frozen=True)
class Surroundings:
    """What a function's code refers to.

    Attributes:
      constant_at: returns that many bytes at an address; None where the program may change them,
        or where they depend on the address at which the library is loaded.
    """

    name_at: Callable[[int], str | None] = lambda address: None
    constant_at: Callable[[int, int], bytes | None] = lambda address, size_bytes: None


def decode(code: bytes, address: int, surroundings: Surroundings) -> list[Instruction]:
    """Return the instructions of a function, without the nops that pad its end."""
    disassembler = capstone.Cs(capstone.CS_ARCH_X86, capstone.CS_MODE_64)
    disassembler.detail = True
    disassembler.skipdata = True  # decode on behind bytes that are no instruction
    decoded = list(disassembler.disasm(code, address))
    while decoded and _is_nop(decoded[-1]):
        decoded.pop()
    numbers = accumulate((not _is_nop(i) for i in decoded), initial=0)
    successors = {i.address: number for i, number in zip(decoded, numbers, strict=False)}
    instructions = [_instruction(i, successors, surroundings) for i in decoded]
    for index in _line_arguments(decoded, instructions):
        line, size_bytes = decoded[index].operands[1].imm, decoded[index].size
        instructions[index] = Instruction(("mov", "line"), size_bytes, source_line=line)
    return instructions


def compare(
    baseline: Sequence[Instruction],
    candidate: Sequence[Instruction],
    renamed: Mapping[str, str] | None = None,
) -> CodeChange:
    """Return how code changed; `renamed` functions have another name in the candidate."""
    working = [[i for i in code if not i.is_nop] for code in (baseline, candidate)]
    pairs = list(zip(*working, strict=False))
    if len(working[0]) != len(working[1]) or any(_work_differs(old, new) for old, new in pairs):
        return CodeChange.CHANGED
    shifts = _shifts(pairs, "displacements")
    if not _shifts(pairs, "addends") <= {0} | shifts:
        return CodeChange.CHANGED
    names = renamed or {}
    for old, new in pairs:
        if old.callee and new.callee and new.callee not in (old.callee, names.get(old.callee)):
            return CodeChange.CHANGED
    has_same_layout = [i.size_bytes for i in baseline] == [i.size_bytes for i in candidate]
    has_same_references = all(
        (old.callee == new.callee or names.get(old.callee or "") == new.callee)
        and old.source_line == new.source_line
        for old, new in pairs
    )
    if has_same_layout and has_same_references and shifts <= {0}:
        return CodeChange.IDENTICAL
    return CodeChange.OFFSETS


def similarity(baseline: Sequence[Instruction], candidate: Sequence[Instruction]) -> float:
    """Return the share of their code that two functions have in common, from 0 to 1.

    It is the Sørensen–Dice coefficient of the triples of consecutive mnemonics, so what the
    compiler assigned to which register does not matter.
    """
    mnemonics = [[i.shape[0] for i in code if not i.is_nop] for code in (baseline, candidate)]
    old, new = (Counter(zip(each, each[1:], each[2:], strict=False)) for each in mnemonics)
    return 2 * (old & new).total() / max(1, old.total() + new.total())


def _shifts(
    pairs: Iterable[tuple[Instruction, Instruction]], numbers: Literal["displacements", "addends"]
) -> set[int]:
    """Return by how much numbers of the same instructions differ, candidate minus baseline."""
    return {
        after - before
        for old, new in pairs
        for before, after in zip(getattr(old, numbers), getattr(new, numbers), strict=True)
    }


def _work_differs(old: Instruction, new: Instruction) -> bool:
    has_other_constant = any(
        None not in pair and pair[0] != pair[1]
        for pair in zip(old.constants, new.constants, strict=False)
    )
    return has_other_constant or (old.shape, old.successor) != (new.shape, new.successor)


def _line_arguments(
    decoded: Sequence[capstone.CsInsn], instructions: Sequence[Instruction]
) -> Iterator[int]:
    for call, instruction in enumerate(instructions):
        register = _LINE_REGISTERS.get(instruction.callee or "")
        if register is None:
            continue
        for index in range(call - 1, -1, -1):
            if _is_branch(decoded[index]):
                break
            has_operands = not instructions[index].is_nop and _is_valid(decoded[index])
            operands = decoded[index].operands if has_operands else []
            if operands and operands[0].type == x86.X86_OP_REG and operands[0].reg == register:
                if decoded[index].id == x86.X86_INS_MOV and operands[1].type == x86.X86_OP_IMM:
                    yield index
                break


def _is_nop(instruction: capstone.CsInsn) -> bool:
    return bool(instruction.id == x86.X86_INS_NOP)


def _is_branch(instruction: capstone.CsInsn) -> bool:
    """Return whether an instruction branches or calls; bytes that are none have no groups."""
    return _is_valid(instruction) and not _BRANCHES.isdisjoint(instruction.groups)


def _is_valid(instruction: capstone.CsInsn) -> bool:
    return bool(instruction.id != x86.X86_INS_INVALID)


def _instruction(
    decoded: capstone.CsInsn, successors: Mapping[int, int], surroundings: Surroundings
) -> Instruction:
    """Return an instruction without its addresses; the numbers of its successors are by address."""
    if _is_nop(decoded):
        return Instruction((), decoded.size)
    if decoded.id == x86.X86_INS_INVALID:
        return Instruction((decoded.mnemonic, bytes(decoded.bytes)), decoded.size)
    if _is_branch(decoded) and decoded.operands and decoded.operands[0].type == x86.X86_OP_IMM:
        target = decoded.operands[0].imm
        successor = successors.get(target)
        callee = None if successor is not None else surroundings.name_at(target)
        return Instruction((decoded.mnemonic,), decoded.size, callee=callee, successor=successor)
    return _operation(decoded, surroundings)


def _operation(decoded: capstone.CsInsn, surroundings: Surroundings) -> Instruction:
    shape: list[object] = [decoded.mnemonic, decoded.sse_cc, decoded.avx_cc, decoded.avx_rm]
    displacements: list[int] = []
    addends: list[int] = []
    constants: list[bytes | None] = []
    operands = decoded.operands
    layout = {x86.X86_INS_ADD: addends, x86.X86_INS_IMUL: displacements}.get(decoded.id)
    # lea into 64 bits may compute the address of a field, into 32 bits it computes a number
    is_arithmetic = decoded.id == x86.X86_INS_LEA and operands[0].size < 8
    for operand in operands:
        shape += [operand.type, operand.size]
        if operand.type == x86.X86_OP_REG:
            shape.append(operand.reg)
        elif operand.type == x86.X86_OP_IMM:
            is_layout = operand.size == 8 and abs(operand.imm) >= MIN_LAYOUT_NUMBER
            numbers = layout if is_layout and layout is not None else shape
            numbers.append(operand.imm)
        elif operand.mem.base == x86.X86_REG_RIP:
            if decoded.id != x86.X86_INS_LEA:
                place = decoded.address + decoded.size + operand.mem.disp
                constants.append(surroundings.constant_at(place, operand.size))
        else:
            memory = operand.mem
            shape += [memory.segment, memory.base, memory.index, memory.scale]
            (shape if is_arithmetic else displacements).append(memory.disp)
    return Instruction(
        tuple(shape), decoded.size, tuple(displacements), tuple(addends), tuple(constants)
    )
