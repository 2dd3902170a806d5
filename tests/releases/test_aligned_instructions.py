"""Instructions that need aligned data, written down by hand."""

import pytest

from mjbench.releases import aligned_instructions
from mjbench.releases.moved_install import ImmovableError


@pytest.mark.parametrize(
    ("instruction", "message"),
    [
        ("62f17c482800", "aligned to 64 bytes"),  # vmovaps zmm0, [rax]
        ("62f17d48e700", "aligned to 64 bytes"),  # vmovntdq [rax], zmm0
        ("c4e27d2a00", "c4e27d2a00 needs aligned data"),  # vmovntdqa ymm0, [rax]
        ("62f17c282800", "62f17c282800 needs aligned data"),  # vmovaps ymm0, [rax], as AVX-512
        ("06", "no known instruction"),
    ],
)
def test_code_that_could_break_when_it_is_moved_is_refused(instruction: str, message: str) -> None:
    code = bytes.fromhex(instruction) + b"\x90" * 8
    with pytest.raises(ImmovableError, match=message):
        list(aligned_instructions.replacements(code, [(0, len(code))]))


@pytest.mark.parametrize(
    ("aligned", "unaligned"),
    [
        ("c5fc2800", "c5fc1000"),  # vmovaps ymm0, [rax]
        ("c5fd2900", "c5fd1100"),  # vmovapd [rax], ymm0
        ("c57d6f4108", "c57e6f4108"),  # vmovdqa ymm8, [rcx + 8]
        ("c4c17d7f0424", "c4c17e7f0424"),  # vmovdqa [r12], ymm0
        ("c5fde700", "c5fe7f00"),  # vmovntdq [rax], ymm0
        ("c5fc2b00", "c5fc1100"),  # vmovntps [rax], ymm0
        ("c5fc28c1", "c5fc28c1"),  # between registers
        ("c5f82800", "c5f82800"),  # 16 bytes, which stay aligned
    ],
)
def test_each_aligned_instruction_has_a_twin(aligned: str, unaligned: str) -> None:
    code = bytearray(bytes.fromhex(aligned))
    for place, byte in aligned_instructions.replacements(bytes(code), [(0, len(code))]):
        code[place] = byte
    assert code.hex() == unaligned
