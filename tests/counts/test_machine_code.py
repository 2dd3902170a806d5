"""Machine code of hand-assembled functions: what is the same at other addresses, what is not."""

import pytest
from assembly import (
    ADD,
    COPY,
    LOAD_FAR_FIELD,
    LOAD_FIELD,
    NOP,
    PADDING,
    RETURN,
    ROOT,
    SUBTRACT,
    add_number,
    call,
    far_jump_if_zero,
    jump_if_zero,
    load_constant,
    pass_fifth,
)
from hypothesis import given
from hypothesis import strategies as st

from mjbench.counts import machine_code
from mjbench.counts.machine_code import Instruction, Surroundings
from mjbench.counts.records import CodeChange

NOWHERE = Surroundings()


def decoded(*code: bytes, address: int = 0x1000) -> list[Instruction]:
    return machine_code.decode(b"".join(code), address, NOWHERE)


def change(old: list[Instruction], new: list[Instruction]) -> CodeChange:
    return machine_code.compare(old, new)


def test_a_function_at_another_address_is_identical() -> None:
    code = (LOAD_FIELD, jump_if_zero(3), COPY, RETURN)
    assert change(decoded(*code), decoded(*code, address=0x7770)) is CodeChange.IDENTICAL


def test_padding_is_no_code() -> None:
    code = (LOAD_FIELD, RETURN)
    assert decoded(*code, PADDING, NOP) == decoded(*code)


def test_fields_of_a_struct_that_grew_are_offsets_only() -> None:
    near, far = (LOAD_FIELD, ADD, RETURN), (LOAD_FAR_FIELD, ADD, RETURN)
    assert change(decoded(*near), decoded(*far)) is CodeChange.OFFSETS


def test_other_lengths_and_alignment_of_the_same_instructions_are_offsets_only() -> None:
    near = (jump_if_zero(3), COPY, ADD, RETURN)
    far = (far_jump_if_zero(4), COPY, NOP, ADD, RETURN)
    assert change(decoded(*near), decoded(*far)) is CodeChange.OFFSETS


@pytest.mark.parametrize(
    "other",
    [
        (jump_if_zero(3), COPY, SUBTRACT, ADD, RETURN),  # another instruction
        (jump_if_zero(3), COPY, ADD, RETURN),  # one less
        (jump_if_zero(6), COPY, ADD, ADD, RETURN),  # a branch to another instruction
        (far_jump_if_zero(6), COPY, ADD, ADD, RETURN),
        (jump_if_zero(3), COPY, ADD, b"\x06", ADD, RETURN),  # bytes that are no instruction
    ],
)
def test_other_instructions_are_changed_code(other: tuple[bytes, ...]) -> None:
    code = (jump_if_zero(3), COPY, ADD, ADD, RETURN)
    assert change(decoded(*code), decoded(*other)) is CodeChange.CHANGED


def test_a_sum_by_lea_is_a_number_and_not_an_offset() -> None:
    sums = [bytes.fromhex(f"8d47{n:02x}") for n in (5, 6)]  # lea eax, [rdi + n]
    fields = [bytes.fromhex(f"488d47{n:02x}") for n in (5, 6)]  # lea rax, [rdi + n]
    assert change(*(decoded(code) for code in sums)) is CodeChange.CHANGED
    assert change(*(decoded(code) for code in fields)) is CodeChange.OFFSETS


def test_a_large_number_that_is_added_is_an_offset_if_fields_moved_as_far() -> None:
    grown = decoded(LOAD_FAR_FIELD, add_number(0x1200))
    assert change(decoded(LOAD_FIELD, add_number(0x1000)), grown) is CodeChange.OFFSETS
    assert change(decoded(LOAD_FIELD, add_number(0x1100)), grown) is CodeChange.CHANGED
    assert change(decoded(add_number(0x1000)), decoded(add_number(0x1200))) is CodeChange.CHANGED


def test_a_large_factor_of_an_index_is_the_size_of_a_struct() -> None:
    sizes = [bytes.fromhex(f"4869c0{low}020000") for low in ("48", "60")]  # imul rax, rax, size
    factors = [bytes.fromhex(f"486bc0{n}") for n in ("03", "04")]  # imul rax, rax, n
    assert change(*(decoded(code) for code in sizes)) is CodeChange.OFFSETS
    assert change(*(decoded(code) for code in factors)) is CodeChange.CHANGED


def test_constants_are_compared_by_their_content() -> None:
    def loaded(content: bytes | None, place: int, address: int) -> list[Instruction]:
        def constant_at(asked: int, size_bytes: int) -> bytes | None:
            assert (asked, size_bytes) == (place, 8)
            return content

        surroundings = Surroundings(constant_at=constant_at)
        return machine_code.decode(load_constant(place, address), address, surroundings)

    one, two = b"\x01" * 8, b"\x02" * 8
    assert change(loaded(one, 0x10, 0x1000), loaded(one, 0x90, 0x3000)) is CodeChange.IDENTICAL
    assert change(loaded(one, 0x10, 0x1000), loaded(two, 0x10, 0x1000)) is CodeChange.CHANGED
    assert change(loaded(None, 0x10, 0x1000), loaded(None, 0x90, 0x3000)) is CodeChange.IDENTICAL


def calling(callee: str | None, *before: bytes, target: int = 0x5000) -> list[Instruction]:
    code = b"".join(before)
    code += call(target, 0x1000 + len(code))
    return machine_code.decode(code, 0x1000, Surroundings({target: callee}.get))


def test_callees_are_compared_by_name() -> None:
    assert change(calling("f"), calling("f", target=0x9000)) is CodeChange.IDENTICAL
    assert change(calling("f"), calling("g")) is CodeChange.CHANGED
    assert machine_code.compare(calling("f"), calling("g"), {"f": "g"}) is CodeChange.IDENTICAL
    assert change(calling(None), calling(None)) is CodeChange.IDENTICAL


def test_a_line_of_source_code_that_moved_is_no_change() -> None:
    old, new = (calling("mj_stackAllocInfo", pass_fifth(line), COPY) for line in (820, 816))
    assert change(old, new) is CodeChange.OFFSETS
    assert change(old, old) is CodeChange.IDENTICAL
    old, new = (calling("mju_zero", pass_fifth(number), COPY) for number in (820, 816))
    assert change(old, new) is CodeChange.CHANGED


def test_similarity_is_of_mnemonics_in_their_order() -> None:
    code = decoded(LOAD_FIELD, ADD, SUBTRACT, COPY, RETURN)
    other_registers = decoded(LOAD_FIELD, ADD, SUBTRACT, bytes.fromhex("4889f7"), RETURN)
    assert machine_code.similarity(code, other_registers) == 1.0
    assert machine_code.similarity(code, decoded(ROOT, ROOT, ROOT, ROOT)) == 0.0
    assert machine_code.similarity(code, decoded(*[LOAD_FIELD, ADD, SUBTRACT] * 2)) == 4 / 7
    assert machine_code.similarity([], []) == 0.0


@given(code=st.binary(max_size=40))
def test_any_bytes_are_identical_to_themselves(code: bytes) -> None:
    assert change(decoded(code), decoded(code)) is CodeChange.IDENTICAL
